"""Section of a body without actuators, and the table of its stretches."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvid.hydro.arrays import Array
from auvid.stages.passive.motions import PassiveMotions
from auvid.stages.presentation import (
    Block,
    equation,
    panel,
    plot,
    remark,
    section,
    series,
    table,
    text,
)

DRAWN = 4
"""Stretches of a channel that are drawn; the table has all."""


def passive_table(motions: PassiveMotions) -> dict[str, Any]:
    """Return the columns of `passive_motions`."""
    heads = ("recording", "motion", "channel", "number", "t_s", "measured", "fitted")
    rows: dict[str, list[Any]] = {head: [] for head in heads}
    for motion, channel, number, leg, t_s, measured, fitted in stretches(motions):
        size = t_s.size
        for head, values in zip(
            heads,
            (
                [leg] * size,
                [motion] * size,
                [channel] * size,
                [number] * size,
                t_s.tolist(),
                measured.tolist(),
                fitted.tolist(),
            ),
            strict=True,
        ):
            rows[head] += values
    numbers = {head: np.array(rows[head], dtype=np.float64) for head in heads[4:]}
    return {**rows, "number": np.array(rows["number"], dtype=np.int64), **numbers}


def stretches(
    motions: PassiveMotions,
) -> list[tuple[str, str, int, str, Array, Array, Array]]:
    """Return motion, channel, number, leg, times, measured, fitted of all stretches."""
    rows: list[tuple[str, str, int, str, Array, Array, Array]] = []
    for channel, tow in motions.tow_fits.items():
        for number, (leg, item) in enumerate(motions.tows[channel]):
            good = np.isfinite(item.speed) & np.isfinite(item.force_N)
            x = item.speed[good]
            drag = tow.values[1] * x + tow.values[2] * x * np.abs(x)
            rows.append(("tow", channel, number, leg, item.t_s[good], item.force_N[good], drag))
    for channel, decay in motions.coast_fits.items():
        for at, simulated in zip(decay.used.tolist(), decay.simulated, strict=True):
            leg, record = motions.coasts[channel][at]
            thin = record.thinned()
            rows.append(("coast", channel, at, leg, thin.t_s, thin.speed, simulated))
    for channel, swings in motions.swings.items():
        for number, (leg, swing) in enumerate(swings):
            rows.append(("decay", channel, number, leg, swing.t_s, swing.measured, swing.simulated))
    return rows


def passive_section(motions: PassiveMotions, results: dict[str, Any]) -> dict[str, Any]:
    """Return the section: what these motions tell and what not, figures, plots."""
    blocks: list[Block] = [
        remark(words, "finding" if headline else "warning")
        for words, headline in _sentences(motions)
    ]
    blocks += [remark(words) for words in motions.both_ways.values()]
    blocks += [
        remark(
            f"Leg '{leg}' is towed with a sideslip of {np.degrees(angle):.0f} degrees: the line"
            " pulls against drag ahead and aside, and what stands as drag of one axis has both."
            " Tow it along that axis.",
            "warning",
        )
        for leg, angle in motions.oblique.items()
    ]
    blocks += [
        text(
            "Nothing on board drives the body. A tow gives drag in newtons by the force of its"
            " line; a coast gives drag over apparent mass, a swing restoring and damping over"
            " apparent inertia, and neither needs a force. What stands `by the file` takes the"
            " mass of the vehicle file, whose spread is in its interval."
        ),
        equation(
            r"\int T\,dt = m\,\Delta x + D_1\!\int x\,dt + D_2\!\int x|x|\,dt,\quad"
            r" \dot x=-(d_1x+d_2x|x|)+c,\quad \ddot y=-k\sin y-D_1\dot y-D_2\dot y|\dot y|",
            "tow, integrated over windows of 4 s; coast, with a constant of its own; swing",
        ),
        _figures(results),
    ]
    if motions.left_out:
        rows = [[words] for words in dict.fromkeys(motions.left_out)]
        blocks.append(table("Left out", ["what and why"], rows))
    drawn: dict[tuple[str, str], int] = {}
    for motion, channel, _, leg, t_s, measured, fitted in stretches(motions):
        count = drawn[motion, channel] = drawn.get((motion, channel), 0) + 1
        if count <= DRAWN:
            unit = _unit(motion, channel)
            lines = [
                series("measured", t_s, measured, "measured"),
                series("drag of the fit" if motion == "tow" else "fit", t_s, fitted, "predicted"),
            ]
            blocks.append(
                plot(f"{motion.capitalize()} in {channel}, {leg}", [panel(motion, unit, lines)])
            )
    look = (
        "The fit follows each coast to its end; one that stops short touched something or was"
        " pulled. A tow whose force lies off its drag for long met a current."
    )
    return section("Motion without thrust", blocks, order=20, look_for=look, is_open=True)


def _unit(motion: str, channel: str) -> str:
    if motion == "tow":
        return "N"
    if motion == "coast":
        return "rad/s" if channel == "yaw" else "m/s"
    return "m" if channel == "heave" else "rad"


def _sentences(motions: PassiveMotions) -> list[tuple[str, bool]]:
    """Return what there is and what is not known of it, and whether it is a finding."""
    words: list[tuple[str, bool]] = []
    for channel, fit in motions.tow_fits.items():
        mass = "tells its apparent mass too" if fit.free[0] else "is too steady to tell its mass"
        line = f"Towed in {channel}: the force of the line gives drag in newtons and {mass}."
        words.append((line, True))
        if not (fit.free[1] and fit.free[2]):
            line = (
                f"In {channel} the tows have about one speed, or a part of the drag comes out"
                " negative: linear and quadratic drag are not told apart."
            )
            words.append((line, False))
    words += [(line, False) for line in motions.odd.values()]
    for channel, decay in motions.coast_fits.items():
        tail = "" if channel in motions.tow_fits else "; newtons need a tow force or a known mass"
        line = f"{decay.coasts} coasts in {channel} give drag over apparent mass{tail}."
        words.append((line, True))
        if channel in motions.guessed:
            line = (
                f"Coasts in {channel} begin at peaks of its speed: if a line, a hand or a wave"
                " still pulled there, that is in the drag. Legs of role coast begin where you say."
            )
            words.append((line, False))
    for channel, swings in motions.swings.items():
        plural = "s" if len(swings) > 1 else ""
        line = f"{len(swings)} free decay{plural} of {channel}: frequency and damping."
        words.append((line, True))
    if motions.guessed_drifts:
        legs = ", ".join(map(repr, motions.guessed_drifts))
        line = (
            f"Leg {legs} is taken for a drift: it neither is towed nor coasts nor swings. Its path"
            " is the current only if nothing holds it, an anchor or a line, and no wind pushes it."
        )
        words.append((line, False))
    if motions.drifts:
        words.append(("A body that drifts with the water tells the current, not its drag.", False))
    return words


def _figures(results: dict[str, Any]) -> Block:
    rows = [
        [
            row["quantity"],
            row["value"],
            None if row["standard_error"] is None else 0.5 * (row["high"] - row["low"]),
            row["unit"],
            row["verdict"],
            row["note"],
        ]
        for row in results["rows"]
    ]
    heads = ["figure", "value", "± 95 %", "unit", "verdict", "by"]
    return table("What the motions tell", heads, rows)
