"""First screen of a campaign of axes: what they are for, what is lacking and why."""

from __future__ import annotations

from collections.abc import Mapping

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard, RankingRecord, UsableFor
from auvid.data_schemas.records.partial import MassFreeFigure, PartialFigures, TotalDrag
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Document
from auvid.stages.model_use import FITTED, axes_listed, partial_words, ratio_words
from auvid.stages.number_format import (
    fit_in_percent,
    fixed,
    places_of_error,
    printed_unit,
    significant,
    true_minus,
)
from auvid.stages.page.first_screen import (
    AXIS_WORDS,
    Alert,
    Fact,
    Figure,
    Level,
    Summary,
    Use,
    anchor,
)
from auvid.stages.presentation import degrees
from auvid.stages.report.summary.coefficient_table import assumed_most, coefficient_rows
from auvid.stages.report.summary.coefficient_text import findings
from auvid.stages.report.summary.model_summary import assumed_figures, damaged_logs, plural, warned

PLACE = anchor("fit_axes")
GOOD_PERCENT = 60.0
"""Least held-out fit of all fitted axes of a campaign that is called good."""


def summarise_axes(
    card: ModelCard,
    ranking: RankingRecord,
    logs: Mapping[str, LogInfo],
    sections: Mapping[str, Document],
    vehicle: Vehicle,
    shelf: Mapping[str, Vehicle],
) -> Summary:
    """Return the summary of a campaign of axes."""
    part = card.partial
    assert part is not None
    usable = ranking.usable
    words = partial_words(part, usable)
    fits: dict[str, float] = {
        axis: item.held_out_percent
        for axis, item in part.axes.items()
        if item.held_out_percent is not None
    }
    level: Level = "poor"
    if usable is not None:
        level = "good" if fits and min(fits.values()) >= GOOD_PERCENT else "fair"
    return Summary(
        level=level,
        headline=words[:1].upper() + words[1:].partition(";")[0],
        explanation=_explanation(part, fits, words),
        recommended=ranking.choice,
        judged_on="validation",
        facts=_facts(part, logs, card),
        models=(),
        identified=findings(card),
        missing=(*_missing(part), *damaged_logs(logs), *_assumed(part, vehicle)),
        warnings=warned(sections),
        figures=_figures(part),
        uses=uses_of(part, usable),
        rule=f"Judged by {ranking.rule}.",
        coefficients=coefficient_rows(card, vehicle, shelf),
        assumed_most=assumed_most(card),
        counted_in=AXIS_WORDS[part.unit_of_mass] if part.unit_of_mass is not None else "",
    )


def _explanation(part: PartialFigures, fits: Mapping[str, float], words: str) -> str:
    judged = [f"{AXIS_WORDS[axis]} {fit_in_percent(fit)}" for axis, fit in fits.items()]
    sentences = []
    if judged:
        sentences.append(
            f"Fit of the rate on what was held out: {', '.join(judged)} (100 % is the measured"
            " rate, 0 % its mean)."
        )
    rest = words.partition("; ")[2]
    if rest:
        sentences.append(f"{rest[:1].upper()}{rest[1:]}.")
    ratios = ratio_words(part)
    if ratios:
        sentences.append(ratios)
    if part.unit_of_mass is not None:
        sentences.append(
            "There are no newtons: damping stands over M, the apparent inertia of its own axis;"
            f" forces and the model file count in that of {AXIS_WORDS[part.unit_of_mass]}."
        )
    return " ".join(sentences)


def _facts(part: PartialFigures, logs: Mapping[str, LogInfo], card: ModelCard) -> tuple[Fact, ...]:
    facts = [
        Fact(
            f"{AXIS_WORDS[axis]}, held out",
            fit_in_percent(item.held_out_percent),
            item.name,
        )
        for axis, item in part.axes.items()
        if item.source == FITTED
    ]
    terms = [item for axis in card.axes.values() for item in axis.terms if item.term != "constant"]
    own = [item for item in terms if item.source is None]
    identified = sum(item.verdict == "identified" for item in own)
    facts.append(Fact("coefficients identified", f"{identified} of {len(own)}", "by these logs"))
    complete = [item for item in logs.values() if item.status == "complete"]
    count = sum(len(item.files) for item in logs.values())
    facts.append(Fact("logs complete", f"{len(complete)} of {len(logs)}", plural(count, "file")))
    return tuple(facts)


def _missing(part: PartialFigures) -> list[Alert]:
    """Return which axes are lacking and what would give them, one alert per remedy."""
    by_remedy: dict[tuple[str, str], list[str]] = {}
    for axis, item in part.lacking.items():
        by_remedy.setdefault((item.verdict, item.remedy), []).append(axis)
    alerts = [
        Alert(f"{axes_listed(axes).capitalize()}: {verdict}. {remedy}", PLACE)
        for (verdict, remedy), axes in by_remedy.items()
    ]
    alerts += [
        Alert(
            f"{AXIS_WORDS[axis].capitalize()} is not from these logs: {item.name}; nothing here"
            " judges it.",
            PLACE,
        )
        for axis, item in part.axes.items()
        if item.source != FITTED
    ]
    if part.unit_of_mass is not None:
        alerts.append(
            Alert(
                "No newtons: one bollard pull or a measured mass gives them.",
                PLACE,
            )
        )
    return alerts


def _assumed(part: PartialFigures, vehicle: Vehicle) -> tuple[Alert, ...]:
    return assumed_figures(vehicle.document) if part.unit_of_mass is None else ()


def uses_of(part: PartialFigures, usable: UsableFor | None) -> tuple[Use, ...]:
    """Return what a model of some axes is for, none where it is for nothing."""
    if usable is None:
        return ()
    lacking = "no axis is lacking"
    if part.lacking:
        lacking = f"{axes_listed(list(part.lacking))} held as at the start"
    needs = "damping identified and a held-out fit of half or more"
    uses = [
        Use("Simulation", axes_listed(usable.simulation), lacking),
        Use("Control design", axes_listed(usable.control), needs)
        if usable.control
        else Use("Control design", "no axis", f"it needs {needs}"),
    ]
    parts = []
    for name, speed in usable.speeds.items():
        factor, unit = degrees("m/s" if name in "uvw" else "rad/s")
        low, high = (significant(factor * end, 2) for end in (speed.low, speed.high))
        parts.append(f"{name} {low} to {high} {unit}")
    uses.append(Use("Within", "", true_minus(f"{', '.join(parts)}: the range of what was fitted")))
    return tuple(uses)


def _figures(part: PartialFigures) -> tuple[Figure, ...]:
    """Return the figures of each axis, its drag at one speed first."""
    return tuple(
        figure
        for axis in AXES
        for figure in (
            *(_drag(item) for item in part.total_drag if item.axis == axis),
            *(_figure(item) for item in part.without_newtons if item.axis == axis),
        )
    )


def _drag(item: TotalDrag) -> Figure:
    """Return a drag at a speed with its interval, and beside it that of noise alone."""
    places = places_of_error((item.interval_95[1] - item.interval_95[0]) / 2.0)
    low, high = (fixed(end, places) for end in item.interval_95)
    noise = significant(100.0 * NORMAL_95 * item.standard_error / item.value, 2)
    return Figure(
        AXIS_WORDS[item.axis],
        item.words,
        f"{fixed(item.value, places)} {printed_unit(item.unit)}",
        f"{low} to {high}",
        item.verdict,
        f"linear and quadratic part together; noise alone ± {noise} %",
    )


def _figure(item: MassFreeFigure) -> Figure:
    """Return a figure that needs no newtons, angles in degrees but for damping."""
    ends = item.interval_95
    unit = printed_unit(item.unit)
    value, interval = significant(item.value), ""
    if ends is not None and ends[1] > ends[0]:
        places = places_of_error((ends[1] - ends[0]) / 2.0)
        value = fixed(item.value, places)
        interval = f"{fixed(ends[0], places)} to {fixed(ends[1], places)}"
    return Figure(
        AXIS_WORDS[item.axis],
        item.quantity,
        true_minus(f"{value} {unit}"),
        true_minus(interval),
        item.verdict,
        "",
    )
