"""The report section, recording views and text tables of the stage validate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pyarrow as pa

from auvid.data_schemas.records.models import MeritRecord, ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.simulation.growth import Growth
from auvid.hydro.identification.regression.error_measures import TOTAL, ErrorMeasures
from auvid.stages.columns import AXIS_UNITS, force_columns
from auvid.stages.free_run import (
    FEWEST_ENDS,
    FIT,
    LONG_S,
    NAMES,
    PERSISTENCE,
    REST,
)
from auvid.stages.model_use import form_words
from auvid.stages.page.first_screen import NO_VALIDATION_LEG
from auvid.stages.presentation import (
    Block,
    fold,
    panel,
    plot,
    remark,
    section,
    series,
    symbol,
    table,
    text,
    unit_of,
    view,
)
from auvid.stages.validate.flight_presentation import flight_views, growth_words
from auvid.stages.validate.tables import ALL, Errors, RangeCovered, mean_force_errors

LAYOUT = {"validation": "McCarter Table 5.1", "training": "McCarter Table 5.2"}
CONSTANT_TITLE = "constant alone"
REFERENCE_TITLES = {PERSISTENCE: "no change (persistence)", REST: "no motion"}
"""The reference row: the mean force of the training legs and no model."""
FEW_LOST = 2
"""Models whose warning says what grows in them; of more of them a table does."""
MOTIONS = dict(zip(VELOCITIES, ("surge", "sway", "heave", "roll", "pitch", "yaw"), strict=True))
FAILED_RATIO = 1.0
OUTSIDE_SHARE = 0.05
"""Share of validation samples outside the training range from which on a warning is given."""


def validate_section(
    errors: Errors,
    cards: Mapping[str, ModelCard],
    covered: Mapping[str, RangeCovered],
    outside: Array,
    runs_and_plots: Sequence[Block],
    *,
    failed_ratio: float,
    first: Sequence[Block] = (),
    models: Sequence[MeritRecord] = (),
) -> dict[str, Any]:
    """Return the section: flight, verdicts, error tables, ranges, free runs, plots."""
    titles = {name: str(card.title) for name, card in cards.items()}
    reference = mean_force_errors(covered)
    blocks = [
        *first,
        *fold(
            "Force errors of every model",
            [
                *_verdicts(errors, cards, reference.get("validation", {}), failed_ratio),
                *[block for use in LAYOUT for block in _error_table(use, errors, cards, reference)],
                *_leg_table(errors, titles),
            ],
        ),
        *form_blocks(models),
        *fold("Range of motion: fitted in, judged in", _range_blocks(covered, outside)),
        *runs_and_plots,
    ]
    if "validation" not in covered:
        blocks.append(
            remark(NO_VALIDATION_LEG, "warning"),
        )
    look = "A good model follows the measured line where it has not seen the data."
    return section("Validation", blocks, order=10, look_for=look, is_open=True)


def form_blocks(models: Sequence[MeritRecord]) -> list[Block]:
    """Return a sentence for each model whose form the force does not have."""
    titles = {model.name: model.title for model in models}
    words = [
        f"{model.title}: {sentence}." for model in models if (sentence := form_words(model, titles))
    ]
    return fold("Models that have not the form of the force", list(map(text, words)))


def _of_all_legs(errors: Errors, use: str) -> dict[str, Mapping[str, ErrorMeasures]]:
    return {
        model: measures
        for (kind, leg, model), measures in errors.items()
        if (kind, leg) == (use, ALL)
    }


def _verdicts(
    errors: Errors,
    cards: Mapping[str, ModelCard],
    reference: Mapping[str, tuple[float, float]],
    failed: float,
) -> list[Block]:
    """Return a warning that names all models that fail on an axis, with their J/J0.

    A note per model that a constant force equals follows.
    """
    notes, failing = [], []
    judged = _of_all_legs(errors, "validation")
    for model, measures in judged.items():
        title, ratios = cards[model].title, {axis: measures[axis].normalised for axis in AXES}
        bad = [axis for axis, ratio in ratios.items() if ratio > failed]
        if bad:
            failing.append(f"{title} ({' '.join(bad)})")
        idle = [
            f"{axis} ({ratio:.2f} against {reference[axis][1]:.2f})"
            for axis, ratio in ratios.items()
            if cards[model].trim
            and axis in reference
            and ratio >= reference[axis][1]
            and min(ratio, measures[TOTAL].normalised) <= failed
        ]
        if idle:
            notes.append(
                remark(
                    f"{title} predicts no better than a constant force alone in {', '.join(idle)}."
                )
            )
    if not failing:
        return notes
    count = f"{len(failing)} of {len(judged)} models"
    if len(failing) == len(judged) > 1:
        count = "All models"
    reason = f"J/J0 exceeds {failed:g}"
    if failed == FAILED_RATIO:
        reason = "the error exceeds the force itself"
    words = f"{count} fail in some axes on validation, where {reason}: {', '.join(failing)}."
    return [remark(words, "warning"), *notes]


def _error_table(
    use: str,
    errors: Errors,
    cards: Mapping[str, ModelCard],
    reference: Mapping[str, Mapping[str, tuple[float, float]]],
) -> list[Block]:
    judged = _of_all_legs(errors, use)
    if not judged:
        return []
    rows: list[list[Any]] = []
    for model, measures in judged.items():
        card, total = cards[model], measures[TOTAL]
        sums = [total.sse, total.mae, total.mse, total.mad]
        by_axis = [measures[axis].rms for axis in AXES]
        rows.append([card.title, card.n_bar, card.identified, total.rms, *by_axis, *sums])
    j0 = next(iter(judged.values()))
    note = "J/J0 stands in the matrix under the answer. Totals mix N and N m, as the thesis has"
    note += f" them; MAD is the sum of the medians of the six axes. J0: {j0[TOTAL].j0:.3g} in all, "
    note += ", ".join(f"{axis} {j0[axis].j0:.3g} {AXIS_UNITS[axis]}" for axis in AXES) + "."
    if use in reference:
        by_axis = [reference[use][axis][0] for axis in (TOTAL, *AXES)]
        rows.append([CONSTANT_TITLE, 0, 0, *by_axis, *[None] * 4])
        note += " The last row is no model but the mean force of the training legs alone."
    heads: list[str | tuple[str, str]] = ["model", "n-bar", "identified", "J"]
    heads += [(f"J {axis}", AXIS_UNITS[axis]) for axis in AXES]
    title = f"{use.capitalize()} errors, in the layout of {LAYOUT[use]} and (4.22)-(4.27)"
    return [table(title, [*heads, "SSE", "MAE", "MSE", "MAD"], rows, note=note)]


def _leg_table(errors: Errors, titles: Mapping[str, str]) -> list[Block]:
    legs = sorted({(use, leg) for use, leg, _ in errors if leg != ALL})
    if len(legs) == len({use for use, _ in legs}):
        return []
    rows = [
        [title, *(errors[use, leg, model][TOTAL].normalised for use, leg in legs)]
        for model, title in titles.items()
    ]
    return [table("J/J0 of every leg", ["model", *(f"{leg} ({use})" for use, leg in legs)], rows)]


def _range_blocks(covered: Mapping[str, RangeCovered], outside: Array) -> list[Block]:
    """Return the range of each velocity in training and in validation.

    A warning names where the models have to extrapolate.
    """
    if not {"training", "validation"} <= set(covered):
        return []
    fitted, judged = covered["training"], covered["validation"]
    rows, beyond = [], []
    for index, name in enumerate(VELOCITIES):
        unit = "m/s" if index < 3 else "rad/s"
        low, high = judged.low[index], judged.high[index]
        share = outside[index] / judged.n
        rows.append([name, unit, fitted.low[index], fitted.high[index], low, high, 100.0 * share])
        if share >= OUTSIDE_SHARE:
            beyond.append(f"{MOTIONS[name]} ({100.0 * share:.0f} % of the time)")
    heads = ["velocity", "unit", "training lowest", "highest", "validation lowest", "highest"]
    blocks = [table("Range of motion: fitted in, judged in", [*heads, ("outside", "%")], rows)]
    if beyond:
        words = "The validation legs leave the range of the training legs, and every model"
        words += f" extrapolates there: {', '.join(beyond)}."
        blocks.insert(0, remark(words, "warning"))
    return blocks


def free_run_blocks(
    results: pa.Table, titles: Mapping[str, str], causes: Mapping[str, Growth]
) -> list[Block]:
    """Return a table per segment of the runs that stayed bounded.

    One warning names the models that left the bounds, and what grows in them.
    """
    rows = results.to_pylist()
    units = [(symbol(name), unit_of("free_run", name)) for name in NAMES]
    heads: list[str | tuple[str, str]] = ["model", ("after", "s"), "starts", "diverged", *units]
    blocks: list[Block] = []
    for segment, put_in in dict.fromkeys((row["segment"], row["as_measured"]) for row in rows):
        own = [row for row in rows if (row["segment"], row["as_measured"]) == (segment, put_in)]
        if put_in:  # one horizon is enough to see what the other axes owe to these
            horizon = max([h for row in own if (h := row["horizon_s"]) <= LONG_S], default=None)
            own = [row for row in own if row["horizon_s"] == (horizon or own[0]["horizon_s"])]
        bounded = [row for row in own if row["diverged"] < row["starts"]]
        note = (
            "RMS of simulated minus measured state at that time after a measured start, over the"
            " runs that stayed bounded."
        )
        title = f"Free run on {segment}: error of the state"
        if put_in:
            title = f"Free run on {segment}, as measured: {_put_in(put_in)}"
            note = "These axes are put in as measured, the others simulated: no model within"
            note += " limits has the damping of these axes from the data."
        if len(bounded) < len(own):
            note += f" {len(own) - len(bounded)} rows without a bounded run are left out."
        cells = [
            [
                {**titles, **REFERENCE_TITLES}[row["model"]],
                *(row[name] for name in ("horizon_s", "starts", "diverged", *NAMES)),
            ]
            for row in bounded
        ]
        if cells:
            blocks.append(table(title, heads, cells, note=note))
        blocks += _fits(f"Free run on {segment}: fit of the velocities", own, titles, put_in)
    free = [row for row in rows if not row["as_measured"]]
    lost = [model for model in titles if _is_lost(model, free)]
    if lost:
        words = f"Run freely, {len(lost)} of {len(titles)} models leave all bounds (10 m/s or 10"
        explained = causes if len(lost) <= FEW_LOST else {}
        words += f" rad/s): {', '.join(_with_growth(name, explained, titles) for name in lost)}."
        blocks.insert(0, remark(words, "warning"))
    return fold("Free runs of every model", blocks)


def _fits(
    title: str, rows: Sequence[Mapping[str, Any]], titles: Mapping[str, str], put_in: str
) -> list[Block]:
    """Return a table of the fits in % of velocities that move, if any does."""
    names = [name for name in FIT if name[0] not in put_in]
    fits = [[_fit(row[name]) for name in names] for row in rows]
    moving = [i for i in range(len(names)) if any(fit[i] for fit in fits)]
    cells = [
        [{**titles, **REFERENCE_TITLES}[row["model"]], row["horizon_s"], *(fit[i] for i in moving)]
        for row, fit in zip(rows, fits, strict=True)
        if any(fit)
    ]
    heads: list[str | tuple[str, str]] = [
        "model",
        ("after", "s"),
        *((names[i][0], "%") for i in moving),
    ]
    note = (
        "1 - RMS error / RMS departure of the measured velocity from its mean, at that time after"
        " each start: 100 is perfect, 0 no better than the mean, below 0 worse. Empty where fewer"
        f" than {FEWEST_ENDS} runs reach, or the measured velocity departs by less than 0.03 m/s or"
        " rad/s: a percentage of so little motion means nothing."
    )
    return [table(title, heads, cells, note=note)] if cells else []


def _fit(percent: float | None) -> str:
    return "" if percent is None or math.isnan(percent) else f"{percent:.0f}"


def cause_blocks(
    causes: Mapping[str, Growth], results: pa.Table, titles: Mapping[str, str]
) -> list[Block]:
    """Return a table of what makes each lost free run grow; none where none is lost."""
    first: dict[str, float] = {}
    for row in results.to_pylist():
        if row["diverged"] and not row["as_measured"]:
            name = row["model"]
            first[name] = min(first.get(name, math.inf), row["first_divergence_s"])
    rows = [
        [titles[name], first.get(name), cause.axis, cause.rate, cause.cause, cause.adds]
        for name, cause in causes.items()
    ]
    if not rows:
        return []
    note = (
        "About the measured state at which it is fastest, from the start of the run that is lost"
        " soonest until it is, under constant actuators. Cause: the coefficient that adds most to"
        " the growth, C (Coriolis force of the inertia) or G (righting moment); and what it adds."
    )
    heads: list[str | tuple[str, str]] = [
        "model", ("first lost", "s"), "axis", ("growth", "1/s"), "cause", ("adds", "1/s"),
    ]  # fmt: skip
    title = "Why free runs are lost"
    return fold(title, [table(title, heads, rows, note=note)])


def _put_in(velocities: str) -> str:
    return ", ".join(MOTIONS[name] for name in velocities.split())


def _with_growth(model: str, causes: Mapping[str, Growth], titles: Mapping[str, str]) -> str:
    """Return the title of a lost model and what grows: `Linear (roll grows ...)`."""
    words = growth_words(causes[model]) if model in causes else ""
    return titles[model] + (f" ({words})" if words else "")


def _is_lost(model: str, rows: Sequence[Mapping[str, Any]]) -> bool:
    return any(row["model"] == model and row["diverged"] for row in rows)


def prediction_plot(
    segment: SegmentRecord, t: Array, measured: Array, predicted: Mapping[str, Array]
) -> list[Block]:
    """Return the force of every model against the measured one (n, 6), axis by axis."""
    panels = [
        panel(
            axis,
            AXIS_UNITS[axis],
            [
                series("measured", t, measured[:, index], "measured"),
                *(series(name, t, force[:, index], name) for name, force in predicted.items()),
            ],
        )
        for index, axis in enumerate(AXES)
    ]
    title = f"Force on {segment.id}: every model against measurement (McCarter Figures 5.8-5.15)"
    look = "A model that follows the measured line here has not seen it before."
    return fold(title, [plot(title, panels, group="time", look_for=look)])


def validate_views(
    segments: Iterable[str], models: Iterable[str], choice: str | None, flown: Sequence[str]
) -> dict[str, Any]:
    """Return forces and errors of every model, and the flight of the chosen one."""
    names = list(models)
    groups = [] if choice is None else flight_views(choice, flown)
    for key in segments:
        for axis, column, measured in zip(
            AXES, force_columns("tau"), force_columns("tau_bar"), strict=True
        ):
            for model in names:
                force = view(
                    f"residual/{axis}/{model}",
                    f"predictions/{key}",
                    [column],
                    [model],
                    tab="Answer",
                    names=[f"{axis} {model}"],
                    filter={"model": model},
                )
                less = {"table": f"residual/{key}/residual", "columns": [measured]}
                error = {"entity": f"error/{axis}/{model}", "tab": "Error", "less": less}
                groups += [force, force | error]
    return {"groups": groups}


def tables_as_text(
    errors: Errors, cards: Mapping[str, ModelCard], covered: Mapping[str, RangeCovered]
) -> str:
    """Return the tables as plain text.

    As McCarter 5.1 and 5.2, with per-axis columns.
    """
    reference = mean_force_errors(covered)
    titles = ("model", CONSTANT_TITLE, *(str(card.title) for card in cards.values()))
    width = max(map(len, titles))

    def line(title: str, n_bar: int, identified: int, j: float, ratios: Iterable[float]) -> str:
        numbers = "".join(f"{ratio:9.3f}" for ratio in ratios)
        return f"{title:<{width}}{n_bar:>6}{identified:>12}{j:10.3f}{numbers}"

    lines: list[str] = []
    for use, layout in LAYOUT.items():
        judged = _of_all_legs(errors, use)
        if not judged:
            continue
        total = next(iter(judged.values()))[TOTAL]
        lines += [
            f"{use.capitalize()} ({layout}), J0 = {total.j0:.3f} (N and N m mixed); right of J/J0"
            " the same per axis",
            "",
            f"{'model':<{width}}{'n-bar':>6}{'identified':>12}{'J':>10}{'J/J0':>9}"
            + "".join(f"{axis:>9}" for axis in AXES),
        ]
        for model, measures in judged.items():
            card, ratios = cards[model], [measures[axis].normalised for axis in (TOTAL, *AXES)]
            lines.append(line(card.title, card.n_bar, card.identified, measures[TOTAL].rms, ratios))
        if use in reference:
            ratios = [reference[use][axis][1] for axis in (TOTAL, *AXES)]
            lines.append(line(CONSTANT_TITLE, 0, 0, reference[use][TOTAL][0], ratios))
        lines.append("")
    return "\n".join(lines)
