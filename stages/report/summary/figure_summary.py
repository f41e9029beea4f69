"""First screen of a bench or control campaign: named figures with their verdicts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from auvid.data_schemas.documents.published_values import PRINTED_VALUES, Evidence
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.records.logs import LogInfo
from auvid.hydro.constants import NORMAL_95
from auvid.stages.base import Document
from auvid.stages.model_use import listed
from auvid.stages.number_format import (
    fixed,
    in_words,
    places_of_error,
    printed_number,
    printed_unit,
    significant,
    true_minus,
    with_unit,
)
from auvid.stages.page.first_screen import (
    AXIS_WORDS,
    Alert,
    Fact,
    Figure,
    Level,
    Summary,
    anchor,
)
from auvid.stages.reference_check import EACH, SHOWS
from auvid.stages.report.summary.model_summary import (
    assumed_figures,
    damaged_logs,
    plural,
    remarks,
    warned,
)

DETERMINED = ("identified", "met", "measured", "held", "stable", "persistently exciting")
MET, MISSED = "met", "missed"
BOUNDS = (MET, MISSED)
BOUNDS_OF = ": bounds met of "
"""Between the name of a printed table and how many bounds are asked of it, in the
figures of the stage that compares.
"""
OF_LEG = " of leg "
"""Between channel and leg in the title of the figures of a leg."""
FEW = 6
TOGETHER = "mass with added mass"
SUBJECTS = (
    (r"(?:m|I_\w) - (?P<axis>[XYZKMN])_", TOGETHER),
    (r"(?P<axis>[XYZKMN])_\wdot", "added mass"),
    (r"(?P<axis>[XYZKMN])_\w", "damping"),
    (r"constant force", "constant force"),
    (r"I\b|I_", "inertia"),
    (r"C_D", "drag"),
    (r"C_L", "lift"),
    (r"angle of attack|alpha_0", "angle of attack"),
    (r"trim", "trim"),
)
"""Beginning of the name of a value -> what it is of, and whose axis."""
NOT_DETERMINED = "not determined"
RESULTS_MOVE = "the results change with them"
NO_LEGS: Mapping[str, str] = {}


def summarise_results(
    results: Mapping[str, Document],
    logs: Mapping[str, LogInfo],
    sections: Mapping[str, Document],
    vehicle: VehicleDocument,
    log_of: Mapping[str, str] = NO_LEGS,
) -> Summary:
    """Summarise documents of schema `results`, keyed `stage/item`; leg -> its log.

    Of their headlines, or of all figures where there is none.

    Bounds on printed or true values stand apart; further figures (other damping models, other
    methods) stand in the sections of their stages.
    """
    rows = [
        (str(document["title"]), row) for document in results.values() for row in document["rows"]
    ]
    first = [(part, row) for part, row in rows if row.get("headline")] or rows
    bounds = [row for _, row in first if row.get("verdict") in BOUNDS]
    figures = [(part, row) for part, row in first if row.get("verdict") not in BOUNDS]
    good = [
        row for _, row in figures if row.get("verdict") in DETERMINED and row["value"] is not None
    ]
    good_of = [(part, row) for part, row in figures if row in good]
    judged = [row for _, row in figures if row.get("verdict")]
    missed = [row for row in bounds if row["verdict"] == MISSED]
    doubtful = [(part, row) for part, row in figures if row.get("verdict") and row not in good]
    warnings = warned(sections)
    shortfalls = [(row, _shortfalls(row, warnings)) for row in missed]
    stated = {words for _, several in shortfalls for words in several}
    warnings = tuple(words for words in warnings if words not in stated)
    disagreements = _disagreements(good_of, log_of)
    has_verdicts = bool(judged or bounds)
    met, of = _counted(bounds)
    some = bool(good) or 2 * met > of or not has_verdicts
    level: Level = (
        "good"
        if has_verdicts and not doubtful and not missed and not warnings
        else "fair"
        if some
        else "poor"
    )
    in_order = dict(sorted(sections.items(), key=lambda item: int(item[1]["order"])))
    findings = tuple(_capitalised(words) for words in dict.fromkeys(remarks(in_order, "finding")))
    unjudged = f"{plural(len(rows), 'value')} found"
    if not has_verdicts and findings:
        unjudged, findings = findings[0].rstrip("."), findings[1:]
    elif not has_verdicts and len(figures) == 1 and figures[0][1]["value"] is not None:
        only = _figure(*figures[0])
        unjudged = f"{_capitalised(only.quantity)}: {only.value}"
    headline = _headline(len(judged), good_of, bounds) or unjudged
    return Summary(
        level=level,
        headline=headline + ("; the legs disagree" if disagreements else ""),
        explanation=_explanation(figures, findings, headline),
        recommended=None,
        judged_on="validation",
        facts=_facts(logs, rows, good, judged, bounds),
        models=(),
        identified=(),
        missing=(
            *(
                Alert(
                    f"{_a_bound(row)} is missed: {'; '.join(words)}.",
                    anchor("check_published"),
                    "poor" if _evidence(row) == "method" else "fair",
                )
                for row, words in shortfalls
            ),
            *disagreements,
            *_undetermined(doubtful),
            *damaged_logs(logs),
            *(assumed_figures(vehicle) if judged else assumed_figures(vehicle, RESULTS_MOVE)),
        ),
        warnings=warnings,
        figures=tuple(_figure(part, row) for part, row in figures),
        bounds=tuple(_bound(row) for row in bounds),
        bounds_on=_reference(bounds),
    )


def _headline(judged: int, good_of: list[tuple[str, Document]], bounds: list[Document]) -> str:
    """Return what is determined and the bounds met; empty where nothing is judged."""
    good = len([row for _, row in good_of if row.get("verdict")])
    tests, others = _tests(bounds), len(_tests(bounds)) < len(bounds)
    met, of = _counted(tests)
    if not bounds:
        bounds_met = ""
    elif not tests:
        bounds_met = f"no bound on {_reference(bounds)} tests the method"
    elif others and of == 1:
        bounds_met = f"the one bound that tests the method is {MET if met else MISSED}"
    elif others:
        count = f"all {of}" if met == of else f"{met} of {of}"
        bounds_met = f"{count} bounds that test the method are met"
    elif met == of:
        bounds_met = f"every bound on {_reference(bounds)} is met"
    else:
        bounds_met = f"{met} of {of} bounds on {_reference(bounds)} met"
    if not judged:
        return _capitalised(bounds_met)
    count = f"{good} of {plural(judged, 'value')}"
    subjects = _subjects(good_of)
    if not good:
        words = "The recordings determine none of the values"
    else:
        words = (
            f"{_capitalised(subjects)} determined: {count}" if subjects else (f"{count} determined")
        )
    return f"{words}; {bounds_met}" if bounds_met else words


def _subjects(good_of: list[tuple[str, Document]]) -> str:
    """Return what values are of: added mass and damping of surge and sway, inertia.

    Empty where a name tells none.
    """
    axes: dict[str, dict[str, None]] = {}
    for part, row in good_of:
        quantity = str(row["quantity"]).rpartition(": ")[2]
        for pattern, word in SUBJECTS:
            match = re.match(pattern, quantity)
            if match:
                letter = match.groupdict().get("axis")
                axis = AXIS_WORDS[letter] if letter else part.split()[0].lower()
                of_axis = {axis: None} if axis in AXIS_WORDS.values() else {}
                axes.setdefault(word, {}).update(of_axis)
                break
    if axes.get(TOGETHER, {}).keys() <= axes.get("added mass", {}).keys():
        axes.pop(TOGETHER, None)
    words_of: dict[tuple[str, ...], list[str]] = {}
    order = list(AXIS_WORDS.values())
    for word, own in axes.items():
        words_of.setdefault(tuple(sorted(own, key=order.index)), []).append(word)
    return ", ".join(
        f"{listed(words)} of {'all axes' if own == tuple(order) else listed(own)}"
        if own
        else listed(words)
        for own, words in words_of.items()
    )


def _capitalised(words: str) -> str:
    return words[:1].upper() + words[1:]


def _explanation(
    figures: list[tuple[str, Document]], findings: tuple[str, ...], headline: str
) -> str:
    """Return the explanation of a verdict, without ranges of what is there already.

    Few determined figures with their intervals; of many, what the stages state first.
    """
    if not any(row.get("verdict") for _, row in figures):
        words = (headline, *findings[:2])
        ranges = [
            item for item in _ranges(figures) if not any(item.split(":")[0] in w for w in words)
        ]
        return " ".join((*findings[:2], *ranges))
    with_value = [_figure(part, row) for part, row in figures if row["value"] is not None]
    if not with_value or len(with_value) > FEW:
        return " ".join(findings[:2])
    parts: dict[str, list[str]] = {}
    for item in with_value:
        interval = f" ({item.interval})" if item.interval else ""
        parts.setdefault(item.part, []).append(f"{item.quantity} {item.value}{interval}")
    return " ".join(
        f"{part[:1].upper()}{part[1:]}: {', '.join(words)}." for part, words in parts.items()
    )


def _ranges(figures: list[tuple[str, Document]]) -> list[str]:
    """Return least and largest value of a quantity that stands for several conditions.

    Quantity and condition are parted by the first comma of a name.
    """
    several: dict[str, list[Figure]] = {}
    for part, row in sorted(figures, key=lambda item: float(item[1]["value"] or 0.0)):
        name, _, condition = str(row["quantity"]).partition(", ")
        if condition and row["value"] is not None and row.get("low") is None:
            several.setdefault(in_words(name), []).append(
                replace(_figure(part, row), quantity=in_words(condition))
            )
    return [
        f"{name}: {items[0].value} ({items[0].quantity}) to {items[-1].value}"
        f" ({items[-1].quantity})."
        for name, items in several.items()
        if len(items) > 1
    ]


def _tests(bounds: list[Document]) -> list[Document]:
    """Return the figures whose bounds test the method."""
    return [row for row in bounds if row.get("evidence", "method") == "method"]


def _reference(bounds: list[Document]) -> str:
    """Return what bounds hold ours against: printed values, or true ones of a twin."""
    return str(bounds[0].get("reference", PRINTED_VALUES)) if bounds else PRINTED_VALUES


def _counted(bounds: list[Document]) -> tuple[int, int]:
    """Return how many bounds are met, and of how many.

    A figure that does not state how many it holds counts as one.
    """
    split = [(row, str(row["quantity"]).rpartition(BOUNDS_OF)) for row in bounds]
    met = sum(int(row["value"]) if title else row["verdict"] == MET for row, (title, _, _) in split)
    return met, sum(int(count) if title else 1 for _, (title, _, count) in split)


def _evidence(row: Document) -> Evidence:
    """Return what the bounds of a figure show."""
    evidence: Evidence = row.get("evidence", "method")
    return evidence


def _a_bound(row: Document) -> str:
    kind = _evidence(row)
    return "A bound" if kind == "method" else f"A bound that {EACH[kind]}"


def _shortfalls(row: Document, warnings: Sequence[str]) -> list[str]:
    """Return what falls short in a printed table, in words, or how many bounds do."""
    title = str(row["quantity"]).rpartition(BOUNDS_OF)[0].removesuffix(f", {EACH[_evidence(row)]}")
    return [words for words in warnings if title and words.startswith(f"{title}, ")] or [
        _bound(row)
    ]


def _bound(row: Document) -> str:
    """`Table 4: 8 of 8 met, largest error 0.41 % (X_udot)`."""
    title, _, count = str(row["quantity"]).rpartition(BOUNDS_OF)
    kind = _evidence(row)
    if kind in EACH:
        title = title.removesuffix(f", {EACH[kind]}")
    bounds = f"{count} bounds" if kind == "method" else f"{count} bounds that {SHOWS[kind]}"
    words = (
        f"{title}: {row['value']:g} of {bounds} met"
        if title
        else f"{row['quantity']}: {row['verdict']}"
    )
    return f"{words}, {row['note']}" if row.get("note") else words


def _facts(
    logs: Mapping[str, LogInfo],
    rows: list[tuple[str, Document]],
    good: list[Document],
    judged: list[Document],
    bounds: list[Document],
) -> tuple[Fact, ...]:
    facts = []
    if bounds:
        met, of = _counted(_tests(bounds))
        other_bounds = [
            f"{count} {words}"
            for kind, words in SHOWS.items()
            for _, count in [_counted([row for row in bounds if row.get("evidence") == kind])]
            if count and kind != "method"
        ]
        on = f"on {_reference(bounds)}, {plural(len(bounds), 'table')}"
        words = ", ".join(other_bounds) or on
        title = "bounds that test the method" if other_bounds else "bounds met"
        facts.append(Fact(title, f"{met} of {of}", words))
    if judged:
        facts.append(
            Fact(
                "values determined",
                f"{len(good)} of {len(judged)}",
                f"{len(rows)} with all methods and models",
            )
        )
    else:
        facts.append(Fact("figures", str(len(rows)), "in the sections below"))
    if logs:
        complete = [item for item in logs.values() if item.status == "complete"]
        facts.append(
            Fact(
                "logs complete",
                f"{len(complete)} of {len(logs)}",
                plural(sum(len(item.files) for item in logs.values()), "file"),
            )
        )
    return tuple(facts)


def _undetermined(doubtful: list[tuple[str, Document]]) -> list[Alert]:
    by_reason: dict[tuple[str, str], list[str]] = {}
    for part, row in doubtful:
        by_reason.setdefault((part, str(row["verdict"])), []).append(str(row["quantity"]))
    return [
        Alert(f"{_capitalised(verdict)}: {', '.join(names)} ({part}).")
        for (part, verdict), names in by_reason.items()
    ]


def _disagreements(
    determined: list[tuple[str, Document]], log_of: Mapping[str, str]
) -> list[Alert]:
    """Return values of a channel that two legs of a log give apart from each other.

    Both by the same model and method (`note`), so that the legs and not the models differ.
    """
    groups: dict[tuple[str, str, str, str], list[tuple[str, Document]]] = {}
    for part, row in determined:
        channel, _, leg = part.partition(OF_LEG)
        if leg in log_of and row.get("low") is not None and row.get("high") is not None:
            name = (log_of[leg], channel, str(row["quantity"]), str(row.get("note")))
            groups.setdefault(name, []).append((leg, row))
    alerts = []
    for (_, channel, quantity, _), items in groups.items():
        low = max(items, key=lambda item: float(item[1]["low"]))
        high = min(items, key=lambda item: float(item[1]["high"]))
        if low[1]["low"] > high[1]["high"]:
            figures = [_figure(leg, row) for leg, row in (high, low)]
            words = [f"{item.value} ({item.interval}) on leg {item.part}" for item in figures]
            alerts.append(
                Alert(
                    f"The legs disagree on {quantity} of {channel}: {' and '.join(words)}."
                    " Neither interval holds beyond its own leg: something that is not in the"
                    " model differs, as current, tether, trim or voltage."
                )
            )
    return alerts


def _figure(part: str, row: Document) -> Figure:
    """Return a figure with as many digits as its standard error supports, up to six."""
    value, error, low, high = (row.get(key) for key in ("value", "standard_error", "low", "high"))
    text = partial(significant, digits=4 if low is None else 3)
    if value and error:
        text = partial(fixed, places=places_of_error(NORMAL_95 * error, value))
    unit = printed_unit(str(row["unit"]))
    if unit == "percent":
        unit, text = "%", text if error else partial(fixed, places=0)
    words = with_unit(printed_number(text(value)), unit)
    interval = "" if low is None or high is None else f"{text(low)} to {text(high)}"
    narrow = bool(interval) and text(low) == text(high)
    if (not interval or narrow) and error is not None and value is not None:
        interval = f"± {printed_number(significant(NORMAL_95 * error, 2))}"
    return Figure(
        part,
        in_words(str(row["quantity"])),
        NOT_DETERMINED if value is None else true_minus(words),
        true_minus(interval),
        str(row.get("verdict") or ""),
        str(row.get("note") or ""),
    )
