"""First screen of the report: recommended model, quality, findings, what is missing.

Everything here is computed from model cards, the error table and the documents of
segments and logs. The rule for the recommended model: of
the models whose J on the validation legs is within `CLOSE` of the smallest, the one
with the fewest terms; none, if the smallest J/J0 is 1 or more. Models of which a free
run is lost stand back where another one holds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import pyarrow as pa

from auvid.data_schemas.documents.vehicle import VehicleDocument
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.hydro.arrays import AXES
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.stages.base import Document
from auvid.stages.number_format import fixed
from auvid.stages.page.first_screen import AXIS_WORDS, Fact, Level, ModelScore, Score, Summary
from auvid.stages.report.summary.coefficient_text import assumed_words, findings
from auvid.stages.report.summary.simulation import Simulation, simulation

_decimals = partial(fixed, places=2, empty="unknown")
CLOSE = 1.05
OVERFIT = 2.0


def summarise(
    cards: Mapping[str, ModelCard],
    error_table: pa.Table | None,
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    sections: Mapping[str, Document],
    vehicle: VehicleDocument,
    free_run: pa.Table | None = None,
) -> Summary:
    """The summary of one campaign."""
    rows = error_table.to_pylist() if error_table is not None else []
    judged = any(row["use"] == "validation" for row in rows)
    models = _scores(rows, cards, "validation" if judged else "training")
    flown = simulation(free_run)
    recommended = choose(models, flown)
    card = next(
        (
            card
            for card in cards.values()
            if recommended is not None and card.name == recommended.name
        ),
        None,
    )
    missing = [
        *_missing(models, recommended, card, cards, segments, logs, judged),
        *_said_of(recommended, sections),
        *_unbounded(recommended, free_run),
    ]
    level, headline, explanation = _verdict(models, recommended, judged, flown)
    return Summary(
        level=level,
        headline=headline,
        explanation=explanation,
        recommended=recommended.name if recommended else None,
        judged_on="validation" if judged else "training",
        facts=_facts(segments, logs, models, recommended, card),
        models=models,
        identified=findings(card) if card is not None else (),
        missing=(*missing, *assumed_figures(vehicle)),
        warnings=_warnings(sections),
    )


def choose(models: Sequence[ModelScore], flown: Simulation | None = None) -> ModelScore | None:
    """Return the recommended model by the rule of this module, or None.

    None if no model is better than no model at all.
    """
    known = [
        model
        for model in models
        if model.j is not None and ((ratio := _judged(model.total)) is None or ratio < 1)
    ]
    if not known:
        return None
    if flown is not None and (stable := [model for model in known if flown.holds(model.name)]):
        known = stable
    smallest = known[0].j or 0.0
    return min(
        (model for model in known if (model.j or 0.0) <= CLOSE * smallest),
        key=lambda model: (model.terms, model.j),
    )


def _judged(score: Score) -> float | None:
    return score.validation if score.validation is not None else score.training


def _scores(
    rows: Sequence[Mapping[str, Any]], cards: Mapping[str, ModelCard], judge: str
) -> tuple[ModelScore, ...]:
    titles = {card.name: card.title for card in cards.values()}
    whole = {(row["use"], row["model"], row["axis"]): row for row in rows if row["leg"] == "all"}
    models = []
    for name in dict.fromkeys(row["model"] for row in rows):
        scores = tuple(
            Score(
                axis,
                _ratio(whole.get(("validation", name, axis))),
                _ratio(whole.get(("training", name, axis))),
            )
            for axis in ("all", *AXES)
        )
        total = whole.get((judge, name, "all"), {})
        j = total.get("rms")
        models.append(
            ModelScore(
                name=name,
                title=titles.get(name, name),
                terms=int(total.get("n_bar", 0)),
                rank=int(total.get("rank", 0)),
                j=j if j is not None and math.isfinite(j) else None,
                scores=scores,
            )
        )
    return tuple(
        sorted(models, key=lambda model: (math.inf if model.j is None else model.j, model.terms))
    )


def _ratio(row: Mapping[str, Any] | None) -> float | None:
    value = row["ratio"] if row else None
    return float(value) if value is not None and math.isfinite(value) else None


def _verdict(
    models: Sequence[ModelScore],
    recommended: ModelScore | None,
    judged: bool,
    flown: Simulation | None,
) -> tuple[Level, str, str]:
    if not models:
        return (
            "poor",
            "No model was identified",
            "There is no error table: the chain did not reach validation.",
        )
    best = models[0]
    if recommended is None:
        ratio = _judged(best.total)
        where = "on the validation legs" if judged else "on the training legs"
        return (
            "poor",
            "Use none of these models",
            (
                f"The best of them, {best.title}, has J/J0 = {_decimals(ratio)} {where}: predicting"
                " no force at all does as well."
            ),
        )
    if not judged:
        return (
            "poor",
            f"{recommended.title} fits best, but nothing judges it",
            (
                "The campaign has no validation leg."
                f" J/J0 = {_decimals(recommended.total.training)} is on the training legs alone"
                " and says nothing about prediction."
            ),
        )
    validation, training = recommended.total.validation, recommended.total.training
    failing = _failing(recommended)
    words = f"On the validation legs J/J0 = {_decimals(validation)}"
    words += f" (training {_decimals(training)})" if training is not None else ""
    words += (
        f": the error is {100 * (validation or 0):.0f} % of the force itself,"
        f" with {recommended.terms} terms"
    )
    words += (
        f", {recommended.rank} of which the data determine."
        if recommended.rank < recommended.terms
        else "."
    )
    if recommended is not best:
        words += (
            f" {best.title} has a smaller error ({_decimals(best.total.validation)}) with"
            f" {best.terms} terms"
        )
        lost = flown is not None and best.name in flown.lost
        words += ", but its free runs are lost." if lost else "."
    use, reason = _usable_for(recommended, flown)
    words += reason
    if failing:
        words += (
            f" It does not hold in {_listed(failing)}: there its error is larger than the force."
        )
    level: Level = "good" if (validation or 1) < 0.5 and not failing else "fair"
    return level, f"{recommended.title}: {use}" + (", with care" if level == "fair" else ""), words


def _usable_for(model: ModelScore, flown: Simulation | None) -> tuple[str, str]:
    """Return what a model can be used for, and why in a sentence."""
    forces = "use it to predict forces"
    if flown is None or model.name not in flown.useful:
        return forces, " No free run says whether it can be simulated."
    if not flown.holds(model.name):
        return f"{forces}, not to simulate", ""
    axes = flown.useful[model.name]
    if not axes:
        return (
            f"{forces}, not to simulate",
            f" Its free runs hold, but after {flown.horizon_s:g} s they are no better than"
            " expecting no change.",
        )
    named = _listed([AXIS_WORDS[axis] for axis in axes])
    rest = [AXIS_WORDS[axis] for axis in AXES if axis not in axes]
    reason = f" All its free runs hold; after {flown.horizon_s:g} s they predict {named} better"
    reason += " than expecting no change"
    reason += f", {_listed(rest)} not." if rest else "."
    return f"{forces} and to simulate {named}", reason


def _failing(model: ModelScore) -> list[str]:
    return [
        f"{AXIS_WORDS[score.axis]} ({score.axis})"
        for score in model.scores[1:]
        if score.validation is not None and score.validation > 1
    ]


def _facts(
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    models: Sequence[ModelScore],
    recommended: ModelScore | None,
    card: ModelCard | None,
) -> tuple[Fact, ...]:
    facts = []
    for use in ("training", "validation"):
        chosen = [item for item in segments.values() if item.use == use]
        legs = len({item.leg for item in chosen})
        note = f"{legs} leg{'s' * (legs != 1)}"
        note += f" in {len(chosen)} segments" if len(chosen) != legs else ""
        facts.append(Fact(use, f"{sum(item.duration_s for item in chosen):.0f} s", note))
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
            f"{recommended.title} taken" if recommended else "none taken",
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
    models: Sequence[ModelScore],
    recommended: ModelScore | None,
    card: ModelCard | None,
    cards: Mapping[str, ModelCard],
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    judged: bool,
) -> list[str]:
    missing = []
    if segments and not judged:
        missing.append(
            "There is no validation leg: give one leg `use: validation`, so that the models are"
            " judged on data they have not seen."
        )
    best = recommended or (models[0] if models else None)
    if best is not None and judged:
        ratio = (best.total.validation or 0) / (best.total.training or math.inf)
        if ratio > OVERFIT:
            missing.append(
                f"{best.title} fits the training legs {ratio:.1f} times better than it predicts"
                " the validation legs."
            )
        never = [
            f"{AXIS_WORDS[axis]} ({axis})"
            for index, axis in enumerate(AXES, start=1)
            if models and all((model.scores[index].validation or 0) > 1 for model in models)
        ]
        if never:
            missing.append(
                f"No model predicts {_listed(never)} on the validation legs: every J/J0 is above 1."
            )
    any_card = card or next(iter(cards.values()), None)
    if any_card is not None:
        missing += _unexcited(any_card)
    if card is not None:
        missing += _undetermined(card)
    for name, log in logs.items():
        if log.status != "complete":
            lost = sum(item.seconds_lost for item in log.files)
            missing.append(
                f"Log {name} is {log.status}" + (f": {lost:.1f} s are lost." if lost else ".")
            )
    return missing


def _said_of(recommended: ModelScore | None, sections: Mapping[str, Document]) -> tuple[str, ...]:
    """What stages note about the model to take, by its title."""
    return (
        ()
        if recommended is None
        else tuple(
            words
            for words in remarks(sections, "note")
            if words.startswith(f"{recommended.title} ")
        )
    )


def _unbounded(recommended: ModelScore | None, free_run: pa.Table | None) -> list[str]:
    """Return a note if the recommended model diverges in simulation.

    A small force error does not promise that a model holds when it is simulated by
    itself.
    """
    rows = [
        row
        for row in (free_run.to_pylist() if free_run is not None else [])
        if recommended is not None and row["model"] == recommended.name
    ]
    gone = [row for row in rows if row["diverged"]]
    if recommended is None or not gone:
        return []
    worst = max(gone, key=lambda row: row["diverged"] / row["starts"])
    first = min(row["first_divergence_s"] for row in gone)
    words = (
        f"Simulated by itself from measured states, {recommended.title} leaves all bounds in"
        f" {worst['diverged']} of {worst['starts']} runs"
    )
    return [
        f"{words} of {worst['horizon_s']:g} s, the first after {first:.1f} s: predict forces with"
        " it, do not put it into a simulator."
    ]


def assumed_figures(vehicle: VehicleDocument) -> tuple[str, ...]:
    count, words = assumed_words(vehicle)
    if not count:
        return ()
    return (
        (
            f"{plural(count, 'figure')} assumed, not measured (sources: Provenance); the"
            f" coefficients shift or scale with them. {words}."
        ),
    )


def _unexcited(card: ModelCard) -> list[str]:
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
            sentences.append(f"{words} {_listed(axes)}: {so}.")
    return sentences


def _undetermined(card: ModelCard) -> list[str]:
    counts = _verdicts(card)
    parts = [f"{counts[name]} {words}" for name, words in _OPEN.items() if counts[name]]
    return [f"Of the coefficients of {card.title}, {_listed(parts)}."] if parts else []


_OPEN = {
    "weak": "are weak (the interval reaches zero or nearly)",
    "not excited": "are not excited",
    "inseparable": "cannot be told apart, only their combinations can",
    "not applicable": "do not apply to this vehicle",
}


def _warnings(sections: Mapping[str, Document]) -> tuple[str, ...]:
    """Warnings of all sections, once each."""
    return tuple(dict.fromkeys(remarks(sections, "warning")))


def remarks(sections: Mapping[str, Document], level: str) -> list[str]:
    blocks = (block for document in sections.values() for block in document["blocks"])
    return [
        str(block["text"])
        for block in blocks
        if block["kind"] == "remark" and block["level"] == level
    ]


def plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
