"""What a single-channel run shows in the report and in the recording."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.bench.persistence_of_excitation import PERSISTENT, WINDOWS
from auvid.hydro.identification.bench.single_channel import (
    CHANNELS,
    DAMPING,
    ChannelEstimate,
    symbols,
)
from auvid.stages.columns import span_text
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
from auvid.stages.rlse.figures import CLEAR, TOO_FAST
from auvid.stages.rlse.run_of_leg import LegRun

CHAPTER = "Single channels"
SETTLED_AFTER = 0.1
"""Share of a run that the history plots leave out: the first estimates are those of the
prior.
"""


def still_section(leg: str, found: LegRun, reason: str) -> dict[str, Any]:
    """The section of a leg whose channel was never excited."""
    words = (
        f"{leg}: {found.channel} was never excited ({reason}), so that nothing is identified"
        " from it."
    )
    return section(
        _title(leg, found),
        [remark(words, "warning"), *map(remark, found.said)],
        order=20,
        chapter=CHAPTER,
    )


def channel_section(
    leg: str,
    found: LegRun,
    estimate: ChannelEstimate,
    results: dict[str, Any],
    *,
    filter_rate: float,
    dry: float,
) -> dict[str, Any]:
    """Verdict, figures by both methods, damping models, run, histories and persistence
    of excitation.
    """
    excited = estimate.excitation[estimate.chosen]
    words = f"{leg}: {excited.words(_columns(found, estimate.chosen))}"
    blocks: list[Block] = [remark(words, "finding" if excited.status == PERSISTENT else "warning")]
    if not estimate.fits[estimate.chosen].resolved:
        blocks.append(
            remark(
                f"{leg}: {TOO_FAST}. Masses, and ratios to them, are not determined; sample faster,"
                " and step the command.",
                "warning",
            )
        )
    blocks += [
        remark(f"{leg}: {item}", "warning")
        for item in (*found.warnings, *_unphysical(found, estimate, dry))
    ]
    blocks += [
        text(
            f"{found.channel.capitalize()} from {found.measured},"
            f" {span_text((found.data.run.grid_s[0], found.data.run.grid_s[-1]))}. Two estimates:"
            " recursive least squares of the filtered static form (43)-(50) shows how the figures"
            " settle; output error, started from it, fits the simulated run to the measured one"
            " and gives the figures to take, because noise in the measured velocity biases a"
            " regression but not a simulation. Damping is chosen by the last third of the run,"
            " predicted with figures from the first two."
        ),
        *[remark(item) for item in (*found.said, *_sensed(found, estimate))],
        equation(*_equation(found)),
        _methods_table(found, estimate, results),
        _damping_table(found, estimate),
        _run_plot(found, estimate),
        _history_plot(found, estimate, filter_rate),
        _excitation_plot(found, estimate),
    ]
    look = (
        "The chosen model follows the run on its last third too; the histories stand still long"
        " before the end; C_n keeps its height."
    )
    return section(_title(leg, found), blocks, order=20, look_for=look, chapter=CHAPTER)


def channel_views(leg: str, found: LegRun, estimate: ChannelEstimate) -> dict[str, Any]:
    """The run with every damping model, and the recursive estimates of the chosen one."""
    names = list(DAMPING)
    run = {
        "entity": f"rlse/{leg}/run",
        "table": "channel_run",
        "columns": ["measured", *(name.replace(" ", "_") for name in names)],
        "names": ["measured", *(f"{name} damping" for name in names)],
        "roles": ["measured", *names],
        "tab": "Answer",
        "unit": _signal_unit(found),
    }
    histories = [
        {
            "entity": f"rlse/{leg}/{quantity}/history",
            "table": "channel_history",
            "columns": [quantity],
            "names": [f"{label}, recursive"],
            "roles": ["fused"],
            "tab": "Histories",
            "unit": unit,
            "filter": {"damping": estimate.chosen},
            "spread": [f"{quantity}_sd"],
        }
        for quantity, label, unit in _quantities(found, estimate.chosen)
    ]
    excited = {
        "entity": f"rlse/{leg}/excitation/history",
        "table": "channel_history",
        "columns": ["smallest_eigenvalue"],
        "names": ["smallest eigenvalue of C_n"],
        "roles": ["measured"],
        "tab": "Histories",
        "unit": "1",
        "filter": {"damping": estimate.chosen},
    }
    return {"groups": [run, *histories, excited]}


def _title(leg: str, found: LegRun) -> str:
    return f"{found.channel.capitalize()} of leg {leg}"


def _columns(found: LegRun, name: str) -> tuple[str, ...]:
    index = CHANNELS.index(found.channel)
    x = "uvwpqr"[index]
    linear, quadratic = DAMPING[name]
    drive = "the command" if found.normalised else f"{'XYZKMN'[index]}_prop"
    return tuple(
        word
        for word, has in (
            (x, linear),
            (f"{x}|{x}|", quadratic),
            (drive, True),
            ("the constant force", found.data.constant),
        )
        if has
    )


def _sensed(found: LegRun, estimate: ChannelEstimate) -> list[str]:
    """The lag of the thrust and the constant of the sensor, where they were found."""
    fit, words = estimate.fits[estimate.chosen].fit, []
    if estimate.lag is not None:
        words.append(
            f"The force follows its command with a time constant of {estimate.lag.value_s:.2g} s"
            f" (standard error {estimate.lag.standard_error_s:.1g} s), found with the figures:"
            " thrusters coming to speed, or a velocity logged late."
        )
    if fit.bias[0] != 0.0:
        what = (
            "the sensor's zero"
            if CHANNELS.index(found.channel) > 2
            else "a current, or the sensor's zero"
        )
        words.append(
            f"Constant of the {found.measured}, found with the figures: {fit.bias[0]:+.2g}"
            f" {_signal_unit(found)} ({what})."
        )
    return words


def _unphysical(found: LegRun, estimate: ChannelEstimate, dry: float) -> list[str]:
    """Signs that no body in water has, of the chosen damping model, where they are
    clear of zero.
    """
    fit, names = estimate.fits[estimate.chosen], symbols(found.channel)
    damping = ((names.linear, 1), (names.quadratic, 2))
    wrong = [
        name
        for name, index in damping
        if fit.values[index] > CLEAR * fit.standard_errors[index] > 0.0
    ]
    words = (
        [
            f"{', '.join(wrong)} come out positive: damping that feeds energy in. Look for another"
            " channel that moved."
        ]
        if wrong
        else []
    )
    added = dry - float(fit.values[0])
    if fit.resolved and not found.normalised and added > CLEAR * fit.standard_errors[0]:
        unit = names.units[0]
        words.append(
            f"{names.added} comes out positive, {added:.3g} {unit}: {names.mass} of the vehicle,"
            f" {dry:.4g} {unit}, is more than {names.mass} - {names.added}. Is it the vehicle as it"
            " was driven, and the thrust its own?"
        )
    return words


def _equation(found: LegRun) -> tuple[str, str]:
    index = CHANNELS.index(found.channel)
    x, axis, names = "uvwpqr"[index], "XYZKMN"[index], symbols(found.channel)
    mass = f"{names.mass}-{axis}_{{\\dot {x}}}"
    latex = f"({mass})\\dot {x}={axis}_{x}{x}+{axis}_{{{x}|{x}|}}{x}|{x}|+{axis}_{{prop}}"
    if found.data.restoring:
        latex += f"-R\\sin\\{'phi' if index == 3 else 'theta'}"
    if found.data.constant:
        latex += "+C"
    return (
        latex,
        (
            "one channel by itself, Alberti (61)-(64) corrected; what the other channels couple in"
            " is neglected"
        ),
    )


def _quantities(found: LegRun, name: str) -> list[tuple[str, str, str]]:
    names, (linear, quadratic) = symbols(found.channel), DAMPING[name]
    units = _units(found)
    rows = (
        ("mass", f"{names.mass} - {names.added}", True),
        ("linear", names.linear, linear),
        ("quadratic", names.quadratic, quadratic),
    )
    return [(key, label, unit) for (key, label, has), unit in zip(rows, units, strict=True) if has]


def _units(found: LegRun) -> tuple[str, str, str]:
    """Units of mass, linear and quadratic damping, by the whole command where that is
    all that is known.
    """
    if not found.normalised:
        return symbols(found.channel).units[:3]
    length = "m" if CHANNELS.index(found.channel) < 3 else "rad"
    return f"command s^2/{length}", f"command s/{length}", f"command s^2/{length}^2"


def _methods_table(found: LegRun, estimate: ChannelEstimate, results: dict[str, Any]) -> Block:
    figures = {item["quantity"]: item for item in results["rows"]}
    rows = []
    for item in results["rows"]:
        if item["headline"]:
            recursive = figures.get(f"{item['quantity']} ({estimate.chosen}, recursive)", {})
            rows.append(
                [
                    item["quantity"],
                    item["unit"],
                    recursive.get("value"),
                    recursive.get("standard_error"),
                    item["value"],
                    item["standard_error"],
                    item["low"],
                    item["high"],
                    item["verdict"],
                ]
            )
    heads = (
        "figure",
        "unit",
        "recursive",
        "standard error",
        "output error",
        "standard error",
        "low",
        "high",
        "verdict",
    )
    note = (
        "Intervals are 95 %, coloured residuals allowed for; mass and inertia of the vehicle file"
        " count as exact."
    )
    return table(f"Methods side by side, {estimate.chosen} damping", heads, rows, note=note)


def _damping_table(found: LegRun, estimate: ChannelEstimate) -> Block:
    names, unit = symbols(found.channel), _signal_unit(found)
    rows = []
    for name, fit in estimate.fits.items():
        m, one, two, _ = fit.values
        linear, quadratic = DAMPING[name]
        chosen = "chosen" if name == estimate.chosen else ""
        rows.append(
            [
                name,
                m if fit.resolved else None,
                one if linear else None,
                two if quadratic else None,
                fit.rmse,
                fit.held_out,
                chosen,
            ]
        )
    heads: list[str | tuple[str, str]] = [
        "damping",
        *zip(
            (f"{names.mass} - {names.added}", names.linear, names.quadratic),
            _units(found),
            strict=True,
        ),
        ("RMSE", unit),
        ("RMSE, last third", unit),
        "",
    ]
    note = (
        "Chosen by the last third; of nearly equal ones (5 %) the simpler, unless the term that it"
        " leaves out is clear of zero."
    )
    return table("Damping models (as Table 9)", heads, rows, note=note)


def _run_plot(found: LegRun, estimate: ChannelEstimate) -> Block:
    run, at = estimate.data.run, estimate.data.samples
    t = run.grid_s[at]
    lines = [series("measured", t, found.signal, "raw")]
    lines += [
        series(f"{name} damping", t, fit.simulated[at], name) for name, fit in estimate.fits.items()
    ]
    drive = np.append(run.force_left, run.force_right[-1])[at]
    unit = "1" if found.normalised else symbols(found.channel).units[3]
    panels = [
        panel(found.measured, _signal_unit(found), lines),
        panel("driven by", unit, [series("force", t, drive, "thrusters")]),
    ]
    look = "Which damping follows fast and slow parts alike."
    return plot("Measured and simulated", panels, group=f"rlse {found.channel}", look_for=look)


def _history_plot(found: LegRun, estimate: ChannelEstimate, rate: float) -> Block:
    recursive, fit = estimate.recursive[estimate.chosen], estimate.fits[estimate.chosen]
    t = recursive.estimate.t_s
    rows = slice(int(SETTLED_AFTER * t.size), None)
    panels = []
    for index, (_, label, unit) in enumerate(_quantities(found, "linear and quadratic")):
        if fit.standard_errors[index] == 0.0:  # not in this damping model, or not determined
            continue
        value, spread = recursive.values[rows, index], NORMAL_95 * recursive.spread[rows, index]
        lines = [
            series("recursive", t[rows], value, "fused"),
            series("95 % low", t[rows], value - spread, "band"),
            series("95 % high", t[rows], value + spread, "band"),
            series("output error", t[[rows.start, -1]], np.full(2, fit.values[index]), "predicted"),
        ]
        panels.append(panel(label, unit, lines))
    note = (
        f"Filter rate {rate:g} rad/s; the first tenth, which the prior rules, is not shown. The"
        " lines stand still before the end."
    )
    return plot(
        f"Recursive estimates over time, {estimate.chosen} damping",
        panels,
        group=f"rlse {found.channel}",
        look_for=note,
    )


def _excitation_plot(found: LegRun, estimate: ChannelEstimate) -> Block:
    lines = [
        series(f"{name} damping", item.t_s, item.smallest, name)
        for name, item in estimate.excitation.items()
    ]
    spread = ", ".join(f"{item.spread:.1f} ({name})" for name, item in estimate.excitation.items())
    look = (
        "A line that falls towards zero has lost its excitation. Information spread over windows"
        f" of {WINDOWS}: {spread}."
    )
    panels = [panel("eigenvalue", "1", lines)]
    return plot(
        "Smallest eigenvalue of C_n (52), columns of unit RMS",
        panels,
        group=f"rlse {found.channel}",
        look_for=look,
    )


def _signal_unit(found: LegRun) -> str:
    rotation = CHANNELS.index(found.channel) > 2
    if found.data.run.rate.size:
        return "rad/s" if rotation else "m/s"
    return "rad" if rotation else "m"
