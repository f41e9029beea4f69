"""First screen of the report: the model and its use, findings, what is missing.

The ranking and the choice are those of `validate`; model cards and the documents of
segments and logs give the rest.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial

from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.records.likelihood import LagFit
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import MeritRecord, ModelCard, RankingRecord, UsableFor
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, INSEPARABLE
from auvid.hydro.identification.selection.axis_terms import SPARSE
from auvid.stages.base import Document
from auvid.stages.model_use import (
    GUESS,
    TILTS,
    UNKNOWN,
    axes_listed,
    damping_of,
    damps,
    failing_axes,
    form_words,
    growth_words,
    listed,
    lost_tilts,
    recommendation,
    simulator,
    tipping_axes,
    unstable_axes,
)
from auvid.stages.number_format import (
    estimate,
    fixed,
    printed_unit,
    significant,
    term,
    true_minus,
)
from auvid.stages.page.first_screen import (
    ALL,
    AXIS_WORDS,
    NO_VALIDATION_LEG,
    Alert,
    Fact,
    Summary,
    Use,
    anchor,
)
from auvid.stages.presentation import degrees
from auvid.stages.report.summary.coefficient_table import (
    assumed_most,
    coefficient_name,
    coefficient_rows,
)
from auvid.stages.report.summary.coefficient_text import assumed_words, findings

_decimals = partial(fixed, places=2, empty="unknown")
OVERFIT = 2.0
MOST_MOVED = 3
"""Coefficients that are named with what the lag of the actuators moved them by."""
CLEARLY = 0.9
"""Ratio of two errors below which one is clearly the smaller."""
NO_RANKING = RankingRecord(
    models=[], choice=None, rule="", legs_left_out=0, horizon_s=None, usable=None
)


def summarise(
    cards: Mapping[str, ModelCard],
    ranking: RankingRecord,
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    sections: Mapping[str, Document],
    vehicle: Vehicle,
    shelf: Mapping[str, Vehicle],
) -> Summary:
    """Return the summary of one campaign."""
    models = tuple(ranking.models)
    judged = any(model.axes[ALL].validation is not None for model in models)
    chosen = next((model for model in models if model.name == ranking.choice), None)
    card = next((card for card in cards.values() if card.name == ranking.choice), None)
    level, headline, explanation = recommendation(ranking, chosen, judged)
    motion = None if chosen is None else chosen.motion
    missing = [
        *_missing(models, chosen, card, cards, segments, logs, judged),
        *([] if motion is None else [Alert(words, "models") for words in motion.remedies]),
        *_notes_on(chosen, sections),
    ]
    return Summary(
        coefficients=coefficient_rows(card, vehicle, shelf) if card is not None else (),
        assumed_most=assumed_most(card) if card is not None else "",
        reference=ranking.constant,
        level=level,
        headline=headline,
        explanation=explanation,
        recommended=ranking.choice,
        judged_on="validation" if judged else "training",
        facts=_facts(segments, logs, models, chosen, card),
        models=models,
        identified=findings(card) if card is not None else (),
        missing=(*missing, *assumed_figures(vehicle.document)),
        warnings=warned(sections),
        uses=_uses(ranking, chosen, card) if judged else (),
        rule=f"Chosen as {ranking.rule}." if chosen is not None else "",
        horizon_s=ranking.horizon_s,
        legs_left_out=ranking.legs_left_out,
    )


VERDICT_WORDS = {
    "holds": "holds",
    "unstable": "is unstable",
    "tips over": "tips over",
    "unknown": "may not hold",
    "not tried": "was not tried",
}
RESTS = {
    "identified": "from the data",
    "from the prior": "from the prior",
    "unknown": "unknown",
}


def _runs(model: MeritRecord, axis: str) -> bool:
    """Return whether the free runs of an axis err less than the guess."""
    error = model.axes[axis].free_run
    return error is not None and error < 1.0


def _uses(
    ranking: RankingRecord, chosen: MeritRecord | None, card: ModelCard | None
) -> tuple[Use, ...]:
    """Return a line per use with the axes and the limits of it; empty for no model."""
    usable = ranking.usable
    if chosen is None or usable is None or card is None:
        return ()
    uses = [Use("Forces", _some(usable.forces), _except(chosen))]
    horizon = f" after {ranking.horizon_s:g} s" if ranking.horizon_s is not None else ""
    other = simulator(ranking)
    if other:
        reason = (
            f"take {other}: as a whole free runs of this one err more than the guess of {GUESS}"
        )
    elif not chosen.runs:
        reason = "no free run says whether it can be simulated"
    elif chosen.lost:
        reason = f"{chosen.lost} of {chosen.runs} free runs leave all bounds"
    elif chosen.faults:
        reason = "; ".join(chosen.faults)
    elif not usable.simulation and not usable.under_attitude_hold:
        reason = f"its {chosen.runs} free runs hold, but{horizon} they are no better than {GUESS}"
        reason += _unexcited_damping(usable.forces, card)
    else:
        reason = f"all {chosen.runs} free runs hold;{horizon} they beat the guess of {GUESS}"
        steadied = usable.under_attitude_hold
        rest = [axis for axis in AXES if axis not in (*usable.simulation, *steadied)]
        upset = (*tipping_axes(chosen), *TILTS) if tipping_axes(chosen) else ()
        upset = tuple(axis for axis in upset if axis in rest and _runs(chosen, axis))
        left = [axis for axis in rest if axis not in upset and _runs(chosen, axis)]
        worse = [axis for axis in rest if axis not in (*upset, *left)]
        reason += f", but not in {axes_listed(worse)}" if worse else ""
        reason += f"; its own drive upsets it: not in {axes_listed(upset)}" if upset else ""
        reason += _left_out(left, usable, card)
        reason += _unexcited_damping([axis for axis in rest if axis in usable.forces], card)
        reason += (
            f"; {axes_listed(steadied)} where an autopilot holds roll and pitch" if steadied else ""
        )
        if set(TILTS) & set(rest) and chosen.motion is None:
            reason += ": in motions unlike those of the validation legs it may tip over"
    uses.append(Use("Simulation", "" if other else _some(usable.simulation), reason))
    if chosen.motion is not None:
        check = chosen.motion
        needs_own = check.verdict == "holds" and any(item.tips_in for item in check.ranges)
        title = "By itself" + ("" if needs_own else f" it {VERDICT_WORDS[check.verdict]}")
        uses.append(Use(title, "", true_minus(check.words)))
    words = "simulated, with damping identified and an error below half of the force"
    words = words if usable.control else f"it must be {words}"
    unstable = [axis for axis in unstable_axes(chosen) if axis in usable.simulation]
    words += f"; by itself the model is unstable in {axes_listed(unstable)}" if unstable else ""
    growth = growth_words(chosen, usable.control)
    words += f"; {growth}" if growth else ""
    rests: dict[str, list[str]] = {}
    for axis in TILTS:
        if axis not in usable.control:
            rests.setdefault(RESTS[damping_of(card, axis)], []).append(axis)
    tilts = [f"{axes_listed(axes)} damping {rest}" for rest, axes in rests.items()]
    if lost := lost_tilts(chosen):
        times = listed([f"{error:.{0 if error >= 10 else 1}f}" for error in lost.values()])
        words = (
            f"in {axes_listed(tuple(lost))} its free runs err {times} times as much as the guess"
            f" of {GUESS}"
        )
    uses.append(Use("Control design", _some(usable.control), "; ".join([words, *tilts])))
    parts = []
    for name, speed in usable.speeds.items():
        factor, unit = 1.0, ""
        if name in (*"uvwpqr", "V"):
            factor, unit = degrees("m/s" if name in (*"uvw", "V") else "rad/s")
        low, high = significant(factor * speed.low, 2), significant(factor * speed.high, 2)
        parts.append(f"{term('(' + name + ')')} {low} to {high} {unit}".rstrip())
    words = f"{', '.join(parts)}: the range of the training legs"
    uses.append(Use("Within", "", true_minus(words)))
    if words := form_words(chosen, {item.name: item.title for item in ranking.models}):
        uses.append(Use("Coefficients", "", words))
    if words := _water_words(card):
        uses.append(Use("Water", "", words))
    if card.lag is not None:
        uses.append(Use("Actuators", "", true_minus(_lag_words(card, card.lag))))
    return tuple(uses)


def _water_words(card: ModelCard) -> str:
    """Return the clear steady currents of the training logs; empty for none."""
    clear = {log: own for log, own in card.currents.items() if own.clear}
    if not clear:
        return ""
    dives = []
    for log, own in clear.items():
        north, east = (
            estimate(value, NORMAL_95 * sd)
            for value, sd in zip(own.value_m_s, own.sd_m_s, strict=True)
        )
        dives.append(f"{north} m/s to the north, {east} m/s to the east in log '{log}'")
    return true_minus(
        f"the forces show a steady current, {listed(dives)}; the velocities are over ground, and"
        " intervals count it (stages.fuse.current_m_s takes it off)"
    )


def _lag_words(card: ModelCard, lag: LagFit) -> str:
    """Return how late the actuators are, who says so, and what it moved most."""
    error = lag.standard_error_s
    late = estimate(lag.value_s, NORMAL_95 * error) if error else significant(lag.value_s)
    words = f"their force follows the record {late} s late, as "
    words += "the vehicle file states" if lag.verdict == "stated" else "the data show"
    if lag.verdict == INSEPARABLE and not lag.correlations:
        words += ", not separable from the lag of the velocity log"
    items = {(axis, item.term): item for axis, part in card.axes.items() for item in part.terms}
    shares = {
        place: abs(moved / value)
        for axis, terms in card.moved_by_lag.items()
        for term, moved in terms.items()
        if items[place := (axis, term)].verdict == IDENTIFIED and (value := items[place].value)
    }
    most = sorted(shares, key=lambda place: -shares[place])[:MOST_MOVED]
    parts = [
        f"{coefficient_name(*place)} by {significant(card.moved_by_lag[place[0]][place[1]], 2)} of"
        f" {significant(items[place].value, 2)} {printed_unit(items[place].unit)}"
        for place in most
    ]
    return words + (f"; it moved {listed(parts)}" if parts else "")


def _left_out(axes: Sequence[str], usable: UsableFor, card: ModelCard) -> str:
    """Return in words why axes whose free runs beat the guess are not simulated."""
    forceless = [axis for axis in axes if axis not in usable.forces]
    tilts = [axis for axis in axes if axis in TILTS and axis in usable.forces]
    others = [axis for axis in axes if axis not in (*forceless, *tilts)]
    words = ""
    if forceless:
        words += f"; not in {axes_listed(forceless)}, whose force it does not predict"
    if tilts:
        unknown = [axis for axis in TILTS if damping_of(card, axis) == UNKNOWN]
        words += f"; not in {axes_listed(tilts)}"
        words += f", as damping of {axes_listed(unknown)} is not from the data" if unknown else ""
    return words + (f"; not in {axes_listed(others)}" if others else "")


def _unexcited_damping(axes: Sequence[str], card: ModelCard) -> str:
    still = [axis for axis in axes if not damps(card, axis)]
    return f" ({axes_listed(still)}: damping not excited)" if still else ""


def _some(axes: Sequence[str]) -> str:
    return "no axis" if not axes else "all axes" if len(axes) == len(AXES) else axes_listed(axes)


def _except(chosen: MeritRecord) -> str:
    failing = failing_axes(chosen)
    if failing:
        return f"it does not hold in {listed(failing)}: there its error is larger than the force"
    return "the error is below the force on the validation legs"


def _facts(
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    models: Sequence[MeritRecord],
    chosen: MeritRecord | None,
    card: ModelCard | None,
) -> tuple[Fact, ...]:
    facts = []
    for use in ("training", "validation"):
        parts = [item for item in segments.values() if item.use == use]
        legs = len({item.leg for item in parts})
        note = f"{legs} leg{'s' * (legs != 1)}"
        note += f" in {len(parts)} segments" if len(parts) != legs else ""
        facts.append(Fact(use, f"{sum(item.duration_s for item in parts):.0f} s", note))
    complete = [item for item in logs.values() if item.status == "complete"]
    facts.append(
        Fact(
            "logs complete",
            f"{len(complete)} of {len(logs)}",
            plural(sum(len(item.files) for item in logs.values()), "file"),
        )
    )
    facts.append(
        Fact(
            "models fitted",
            str(len(models)),
            f"{chosen.title} taken" if chosen else "none taken",
        )
    )
    if card is not None:
        counts = _verdicts(card)
        total = sum(counts.values()) - counts["not applicable"]
        facts.append(
            Fact(
                "coefficients identified",
                f"{counts['identified']} of {total}",
                f"in {card.title}",
            )
        )
    return tuple(facts)


def _verdicts(card: ModelCard) -> Counter[str]:
    """Count the coefficients of each verdict, without the constant force per axis."""
    return Counter(
        term.verdict for axis in card.axes.values() for term in axis.terms if term.term != CONSTANT
    )


def _missing(
    models: Sequence[MeritRecord],
    chosen: MeritRecord | None,
    card: ModelCard | None,
    cards: Mapping[str, ModelCard],
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    judged: bool,
) -> list[Alert]:
    missing = []
    if segments and not judged:
        missing.append(
            Alert(
                NO_VALIDATION_LEG,
                anchor("validate"),
                "poor",
            )
        )
    best = chosen or (models[0] if models else None)
    if chosen is not None and card is not None:
        missing += [Alert(words, "models") for words in unlike_legs(chosen, card, models, cards)]
    if best is not None and judged:
        ratio = (best.axes[ALL].validation or 0) / (best.axes[ALL].training or math.inf)
        if ratio > OVERFIT:
            words = f"{best.title} fits the training legs {ratio:.1f} times better than it predicts"
            missing.append(Alert(f"{words} the validation legs.", "models"))
        never = [
            f"{AXIS_WORDS[axis]} ({axis})"
            for axis in AXES
            if models and all((model.axes[axis].validation or 0) > 1 for model in models)
        ]
        if never:
            words = f"No model predicts {listed(never)} on the validation legs"
            missing.append(Alert(f"{words}: every J/J0 is above 1.", "models", "poor"))
    any_card = card or next(iter(cards.values()), None)
    if any_card is not None:
        missing += _unexcited(any_card)
    if card is not None:
        missing += _undetermined(card)
    for name, log in logs.items():
        if log.status != "complete":
            lost = sum(item.seconds_lost for item in log.files)
            words = f"Log {name} is {log.status}" + (f": {lost:.1f} s are lost." if lost else ".")
            missing.append(Alert(words, anchor("ingest", name)))
    return missing


def unlike_legs(
    chosen: MeritRecord,
    card: ModelCard,
    models: Sequence[MeritRecord],
    cards: Mapping[str, ModelCard],
) -> list[str]:
    """Return training legs that a simpler sound model predicts better when left out.

    Such a leg is unlike the others, as new motion may be: a model of many terms that
    predicts legs like its own says nothing of it.
    """
    legs_of: dict[str, list[tuple[str, float, float]]] = {}
    for leg, own in card.held_out.items():
        simpler = [
            (error, model)
            for model in models
            if not model.faults and model.terms < chosen.terms
            if (error := cards[model.name].held_out.get(leg, {}).get(ALL)) is not None
        ]
        ratio = own.get(ALL)
        error, model = min(simpler, key=lambda item: item[0], default=(math.inf, chosen))
        if ratio is not None and error < CLEARLY * ratio:
            legs_of.setdefault(model.name, []).append((leg, error, ratio))
    words = []
    by_name = {model.name: model for model in models}
    for name, items in legs_of.items():
        model = by_name[name]
        legs, errors, ratios = zip(*items, strict=True)
        one = len(legs) == 1
        words.append(
            f"Left out, training leg{'' if one else 's'} {listed(legs)}"
            f" {'is' if one else 'are'} predicted better by {model.title}"
            f" ({model.terms} terms, J/J0 {_ratios(errors)}) than by {chosen.title}"
            f" ({chosen.terms}, {_ratios(ratios)}): in motion unlike the training legs take"
            f" {model.title}."
        )
    return words


def _ratios(values: Sequence[float]) -> str:
    return listed([f"{value:.2f}" for value in values])


def _notes_on(chosen: MeritRecord | None, sections: Mapping[str, Document]) -> tuple[Alert, ...]:
    """Return what stages note about the model to take, by its title."""
    if chosen is None:
        return ()
    notes = remarks(sections, "note")
    return tuple(Alert(words) for words in notes if words.startswith(f"{chosen.title} "))


def assumed_figures(
    vehicle: VehicleDocument, moved: str = "the coefficients shift or scale with them"
) -> tuple[Alert, ...]:
    count, words = assumed_words(vehicle)
    if not count:
        return ()
    sentence = f"{plural(count, 'figure')} assumed, not measured (sources: Provenance);"
    sentence += f" {moved}. {words}."
    return (Alert(sentence, anchor("provenance"), "good"),)


def _unexcited(card: ModelCard) -> list[Alert]:
    sentences = []
    for state, words, so in (
        ("not excited", "The training legs do not excite", "damping there is not determined"),
        ("weak", "The training legs hardly excite", "damping there is not to be trusted"),
    ):
        axes = [
            f"{AXIS_WORDS.get(axis, axis)} ({axis})"
            for axis, item in card.axes.items()
            if item.excitation == state
        ]
        if axes:
            sentences.append(Alert(f"{words} {listed(axes)}: {so}.", anchor("synthesise")))
    return sentences


def _undetermined(card: ModelCard) -> list[Alert]:
    counts = _verdicts(card)
    open_ = dict(_OPEN)
    if card.name == SPARSE:
        open_["weak"] = "are weak (their terms were chosen on the same legs)"
    parts = [f"{counts[name]} {words}" for name, words in open_.items() if counts[name]]
    if not parts:
        return []
    return [Alert(f"Of the coefficients of {card.title}, {listed(parts)}.", "coefficients", "good")]


_OPEN = {
    "weak": "are weak (size or sign is not sure)",
    "not excited": "are not excited",
    "inseparable": "cannot be told apart, only their combinations can",
    "not applicable": "do not apply to this vehicle",
}


def warned(sections: Mapping[str, Document]) -> tuple[Alert, ...]:
    """Return the warnings of all sections, once each."""
    return tuple(Alert(words) for words in dict.fromkeys(remarks(sections, "warning")))


def remarks(sections: Mapping[str, Document], level: str) -> list[str]:
    blocks = (block for document in sections.values() for block in document["blocks"])
    return [
        str(block["text"])
        for block in blocks
        if block["kind"] == "remark" and block["level"] == level
    ]


def damaged_logs(logs: Mapping[str, LogInfo]) -> list[Alert]:
    """Return an alert for each log that is not complete."""
    return [
        Alert(f"Log {name} is {log.status}.", anchor("ingest", name))
        for name, log in logs.items()
        if log.status != "complete"
    ]


def plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
