"""What the report and the recording show of fitted axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.axes.judgement import STRAIGHT, ShapeVerdict
from auvid.hydro.identification.regression.assumed_figures import INERTIA_RATIO
from auvid.stages.columns import VELOCITY
from auvid.stages.fit_axes.card import lacking_axis, words_of
from auvid.stages.fit_axes.clocks import clock_words
from auvid.stages.fit_axes.fitted import AxisFits, AxisMotion, FittedAxis, Together
from auvid.stages.fit_axes.markers import markers_words
from auvid.stages.fit_axes.thrusters import share_of, untold_words, weak_words
from auvid.stages.model_use import axes_listed, ratio_words
from auvid.stages.number_format import LEAST_FIT, fit_in_percent, significant
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.presentation import (
    Block,
    degrees,
    fold,
    half_95,
    panel,
    plot,
    remark,
    section,
    series,
    table,
    text,
    view,
)

ORDER = 50
RATE_OF = dict(zip(AXES, VELOCITY, strict=True))
"""Axis -> column of the velocity along it."""
LOOK_FOR = (
    "Held-out fits near those of training, dives that agree, and time constants with narrow"
    " intervals. 100 % is the measured rate itself, 0 % its mean."
)


COVERAGE_BENT = (
    "Beside a dead band and a curve that are fitted, 95 % intervals of axes fitted together held"
    " 84 % of the true values of made-up laboratories (95 % where commands act along a straight"
    " line): take them for a fifth wider."
)
"""Measured on commands that step between samples (decision 0061)."""


def shared_words(shape: ShapeVerdict) -> str:
    """Return what is known of thrusters that surge, sway and yaw share.

    >>> shared_words(ShapeVerdict(0.07, 0.01, 1.6, 0.05, "identified", True, 0.12)).split(": ")[0]
    'Surge, sway and yaw move as by four thrusters at the corners that share their commands'
    """
    return (
        "Surge, sway and yaw move as by four thrusters at the corners that share their commands:"
        " each has the sum of the three, with signs of its own, up to a full one, and acts beyond"
        f" {shape.dead_band:.2g} of full ({shape.dead_band_error:.1g}), with exponent"
        f" {shape.curve:.3g} ({shape.curve_error:.1g}) and by {abs(100.0 * shape.skew):.2g} % more"
        " one way than on average: taken as it flies what was held out better. Axis by axis such"
        " commands look straight, and linear drag comes out too large."
    )


def fit_section(fits: AxisFits, card: ModelCard) -> dict[str, Any]:
    """Return the section on fits, axes that are lacking, and what needs no newtons."""
    blocks: list[Block] = [
        text(
            "Each axis is fitted by output error over windows: simulated from the measured"
            f" state at the start of a window. Force: {fits.force}."
        )
    ]
    if fits.together is not None:
        blocks.append(remark(together_words(fits.together)))
        if fits.together.chosen:
            words = "" if card.partial is None else ratio_words(card.partial)
            blocks += [remark(words)] if words else []
            mixed = next((i.shape for i in fits.fitted if i.shape.mixed), None)
            if mixed is not None:
                blocks.append(remark(shared_words(mixed)))
            elif any(item.shape.word != STRAIGHT.word for item in fits.fitted):
                blocks.append(remark(COVERAGE_BENT, "warning"))
    if fits.markers is not None:
        wrong = fits.markers.departs and not fits.markers.used
        blocks.append(remark(markers_words(fits.markers), "warning" if wrong else "note"))
    warnings = [words for item in fits.fitted for words in item.warnings]
    blocks += [remark(words, "warning") for words in dict.fromkeys(warnings)]
    blocks += [remark(words, "warning") for words in weak_words(fits.thrusters)]
    blocks += [remark(words, "warning") for words in clock_words(fits.clocks, fits.common_clock)]
    blocks += _fit_tables(fits)
    if fits.lacking:
        rows = [
            [words_of(item.axis), item.verdict, item.words, lacking_axis(item).remedy]
            for item in fits.lacking
        ]
        blocks.append(table("Axes that are not fitted", ["axis", "verdict", "why", "remedy"], rows))
    blocks += _drags(card)
    blocks += _coefficients(card)
    blocks += _beside_damping(card)
    blocks += _free_of_newtons(card)
    blocks += _thrusters(fits)
    notes = [words for item in fits.fitted for words in item.notes]
    blocks += [remark(words) for words in dict.fromkeys(notes)]
    blocks += [item for fitted in fits.fitted for item in _plots(fitted)]
    return section("Axes", blocks, order=ORDER, look_for=LOOK_FOR, is_open=True)


def together_words(item: Together) -> str:
    """Return which axes were fitted together or one by one, and by what figure."""
    names = ", ".join(AXIS_WORDS[axis] for axis in item.axes)
    ratio = (
        "on windows and legs that were held out the error together is"
        f" {item.error_ratio:.2f} times that one by one (geometric mean of {item.pairs} figures)"
        if np.isfinite(item.error_ratio)
        else "nothing was compared"
    )
    if item.chosen:
        return f"Fitted together, with Coriolis force: {names}; {ratio}."
    if np.isposinf(item.error_ratio):
        ratio = "together, a free run over a leg is lost"
    helps = "" if np.isnan(item.error_ratio) else ", so that Coriolis force does not help here"
    return f"Fitted one by one, and no Coriolis force is in the model: {names}; {ratio}{helps}."


def _fit_tables(fits: AxisFits) -> list[Block]:
    heads: list[str | tuple[str, str]] = [
        "axis",
        ("held out", "%"),
        ("training", "%"),
        "windows",
        ("length", "s"),
        ("lag", "s"),
        "measured by",
        "held out are",
    ]
    rows = [
        [
            words_of(item.axis),
            _figure(item.held_out_percent),
            _figure(item.training_percent),
            item.windows,
            item.seconds,
            item.lag_s,
            item.measured_by,
            "; ".join(f"{part.what} {fit_in_percent(part.percent)}" for part in item.held_out)
            or "nothing",
        ]
        for item in fits.fitted
    ]
    note = "Held out: the lowest of the fits on what was held out. A lag without error is assumed."
    blocks = [table("Fit of the rate, axis by axis", heads, rows, note=note)]
    legs = [row for item in fits.fitted for row in _leg_rows(item)]
    if len({row[1] for row in legs}) > 1:
        blocks.append(
            table(
                "Leg by leg",
                ["axis", "leg", "use", ("fit", "%"), "windows", ("one free run over it", "%")],
                legs,
                note="Legs left out and those for validation are flown by a fit that does not use"
                " them, window by window and once from the first window to the last.",
            )
        )
    return blocks


def _leg_rows(item: FittedAxis) -> list[list[str | float | None]]:
    """Return rows of the legs of an axis: fitted, left out, not used and why."""
    name = words_of(item.axis)
    by_validation = dict(item.whole_legs)
    rows: list[list[str | float | None]] = [
        [name, leg, "validation" if leg in by_validation else "fitted", _figure(percent),
         windows, _figure(by_validation.get(leg))]
        for leg, (percent, windows) in item.per_leg.items()
    ]  # fmt: skip
    rows += [
        [name, part.what.removeprefix("leg "), "left out", _figure(part.percent), part.windows,
         _figure(part.one_run)]
        for part in item.held_out
        if part.what.startswith("leg ")
    ]  # fmt: skip
    return rows + [[name, leg, why, None, None, None] for leg, why in item.unused_legs.items()]


def _figure(percent: float | None) -> float | str | None:
    """Return a fit [%] for a table: words where it is far from any motion."""
    lost = percent is not None and percent < LEAST_FIT
    return fit_in_percent(percent) if lost else percent


def _drags(card: ModelCard) -> list[Block]:
    """Return the drag of each axis at one speed, the figure to use of weak parts."""
    if card.partial is None or not card.partial.total_drag:
        return []
    rows: list[list[str | float | None]] = [
        [f"{AXIS_WORDS[item.axis]}, {item.words}", item.value, *item.interval_95, item.unit,
         item.verdict, half_95(item.standard_error)]
        for item in card.partial.total_drag
    ]  # fmt: skip
    heads = ["figure", "value", "from", "to", "unit", "verdict", "± 95 % by noise"]
    note = (
        "Force over speed, linear and quadratic part together, with 95 % intervals by noise and"
        " thrust. The parts below share their error: where they are weak, this is the figure to"
        " use."
    )
    return [table("Drag at one speed", heads, rows, note=note)]


def _coefficients(card: ModelCard) -> list[Block]:
    rows = [
        [
            f"{axis}_{item.term.replace('*', '')}",
            item.value,
            half_95(item.standard_error),
            item.unit,
            item.verdict,
            item.source or "these logs",
        ]
        for axis, part in card.axes.items()
        for item in part.terms
    ]
    heads = ["coefficient", "value", "± 95 % by noise", "unit", "verdict", "from"]
    block = table("Coefficients", heads, rows, note=_ratio_note(card))
    block |= {"coefficients_of": card.name}
    inertia = [
        [
            f"{AXIS_WORDS[item.name[0]]} inertia",
            item.value,
            half_95(item.standard_error),
            item.unit,
            item.in_vehicle_file,
            item.verdict,
        ]
        for item in card.inertia
    ]
    blocks = [block] if rows else []
    if inertia:
        heads = ["apparent inertia", "value", "± 95 % by noise", "unit", "vehicle file", "verdict"]
        blocks.append(table("Inertia that the logs give", heads, inertia))
    return blocks


def _ratio_note(card: ModelCard) -> str:
    """Return what coefficients rest on that count in the inertia of another axis."""
    shares = {
        axis: part.terms[0].assumed_shifts[INERTIA_RATIO] / abs(part.terms[0].value)
        for axis, part in card.axes.items()
        if part.terms and part.terms[0].value and INERTIA_RATIO in part.terms[0].assumed_shifts
    }
    if not shares or card.partial is None or card.partial.unit_of_mass is None:
        return ""
    errors = ", ".join(
        f"{AXIS_WORDS[axis]} ± {significant(100.0 * NORMAL_95 * share, 2)} %"
        for axis, share in shares.items()
    )
    return (
        f"They count in the apparent inertia of {words_of(card.partial.unit_of_mass)}, by ratios of"
        f" the vehicle file that nobody measured: {errors} (95 %) besides noise. No motion of the"
        " model rests on them; over the inertia of its own axis damping stands below."
    )


def _beside_damping(card: ModelCard) -> list[Block]:
    """Return the righting moment and the forces that follow others, in one table."""
    part = card.partial
    if part is None or (part.righting is None and not part.cross_forces):
        return []
    rows: list[list[str | float | None]] = []
    if part.righting is not None:
        moment = part.righting
        rows.append(
            [f"righting moment ({axes_listed(moment.axes)})", moment.value, *_ends(moment),
             moment.unit, None]
        )  # fmt: skip
    rows += [
        [f"{AXIS_WORDS[item.axis]} by the force of {AXIS_WORDS[item.of]}, {item.lag_s:g} s late",
         item.value, *_ends(item), "1", item.verdict]
        for item in part.cross_forces
    ]  # fmt: skip
    return [table("Beside damping", ["figure", "value", "from", "to", "unit", "verdict"], rows)]


def _free_of_newtons(card: ModelCard) -> list[Block]:
    part = card.partial
    if part is None or not part.without_newtons:
        return []
    rows = [
        [words_of(item.axis), item.quantity, item.value, *_ends(item), item.unit, item.verdict]
        for item in part.without_newtons
    ]
    heads = ["axis", "figure", "value", "from", "to", "unit", "verdict"]
    note = "95 % intervals. These hold whatever the thrust in newtons is."
    # The first screen has them, too: here they are for the page's tables in full.
    blocks = fold("What needs no newtons", [table("", heads, rows, note=note)])
    if part.unit_of_mass is not None:
        blocks.append(
            remark(
                "There are no newtons in these logs: coefficients count in the apparent inertia of"
                f" {words_of(part.unit_of_mass)}. One bollard pull (`actuators: {{commands:"
                " {full_force: ...}}` of the vehicle file) or a measured mass (`fit_axes:"
                " {newtons_from: mass}`) turns all of it into newtons."
            )
        )
    if part.scale is not None:
        scale = part.scale
        unit = {"bollard pull": "N", "mass": "kg"}[scale.source]
        error = f" ± {100 * NORMAL_95 * scale.relative_sd:.2g} %" if scale.relative_sd else ""
        blocks.append(
            remark(
                f"Newtons follow from a {scale.source} on {words_of(scale.axis)}:"
                f" {significant(scale.value, 4)} {unit}{error}; its error is in every interval."
            )
        )
    return blocks


def _thrusters(fits: AxisFits) -> list[Block]:
    """Return how strong each thruster is against those like it."""
    if not fits.thrusters:
        return []
    rows: list[list[str | float | None]] = [
        [item.output, item.value, *_ends(item), ", ".join(map(str, item.others)),
         item.verdict]
        for item in map(share_of, fits.thrusters)
    ]  # fmt: skip
    heads = ["output", "over the others", "from", "to", "others: outputs", "verdict"]
    note = (
        "Force over that which its output says, over the median of the same of the others. From"
        " the prior: the motion does not tell it from the others."
    )
    why = [remark(words) for words in untold_words(fits.thrusters)]
    return [table("Thrusters against those like them", heads, rows, note=note), *why]


def _ends(item: Any) -> Sequence[float | None]:
    return (None, None) if item.interval_95 is None else item.interval_95


def _plots(item: FittedAxis) -> list[Block]:
    factor, unit = degrees("m/s" if item.axis in "XYZ" else "rad/s")
    return [
        plot(
            f"{AXIS_WORDS[item.axis].capitalize()}, leg {motion.leg}",
            [
                panel(
                    item.equation.speed,
                    unit,
                    [
                        series("measured", motion.t_s, factor * motion.measured, "measured"),
                        series("simulated", motion.t_s, factor * motion.simulated, "predicted"),
                    ],
                )
            ],
            group=motion.leg,
        )
        for motion in item.motion
        if np.isfinite(motion.simulated).any()
    ]


def fit_views(motions: Mapping[str, Sequence[AxisMotion]], axes: Sequence[str]) -> dict[str, Any]:
    """Return views: measured against simulated rates and depth, leg by leg."""
    groups = []
    for leg, parts in motions.items():
        where = f"axis_motion/{leg}"
        for axis in axes:
            for role in ("measured", "simulated"):
                column = f"{role}_{RATE_OF[axis]}"
                groups.append(
                    view(
                        f"axes/{leg}/{AXIS_WORDS[axis]}/{role}",
                        where,
                        [column],
                        ["measured" if role == "measured" else "predicted"],
                        tab="Answer",
                        names=[role],
                    )
                )
        if any(part.depth_simulated is not None for part in parts):
            groups += [
                view(
                    f"axes/{leg}/depth/{role}",
                    where,
                    [f"{role}_depth_m"],
                    ["measured" if role == "measured" else "predicted"],
                    tab="Answer",
                    names=[role],
                )
                for role in ("measured", "simulated")
            ]
    return {"groups": groups}
