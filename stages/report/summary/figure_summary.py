"""The first screen of a bench or control campaign: the figures that its stages name,
with intervals and verdicts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from auvid.data_schemas.documents.vehicle import VehicleDocument
from auvid.hydro.constants import NORMAL_95
from auvid.stages.base import Document
from auvid.stages.page.first_screen import Fact, Figure, Level, Summary
from auvid.stages.page.number_format import number, printed_unit
from auvid.stages.report.summary.coefficient_text import true_minus
from auvid.stages.report.summary.model_summary import assumed_figures, plural, remarks

DETERMINED = ("identified", "met", "measured", "held", "stable", "persistently exciting")
MET, MISSED = "met", "missed"
BOUNDS = (MET, MISSED)
BOUNDS_OF = ": bounds met of "
"""Between the name of a printed table and how many bounds are asked of it, in the
figures of the stage that compares.
"""
FEW = 6


def summarise_results(
    results: Mapping[str, Document],
    logs: Mapping[str, Document],
    sections: Mapping[str, Document],
    vehicle: VehicleDocument,
) -> Summary:
    """The summary of documents of schema `results`, keyed `stage/item`: of their
    headlines, or of all figures where there is none.

    Bounds on printed values stand apart; further figures (other damping models, other
    methods) stand in the sections of their stages.
    """
    rows = [
        (str(document["title"]), row) for document in results.values() for row in document["rows"]
    ]
    first = [(part, row) for part, row in rows if row.get("headline")] or rows
    bounds = [row for _, row in first if row.get("verdict") in BOUNDS]
    shown = [(part, row) for part, row in first if row.get("verdict") not in BOUNDS]
    good = [
        row for _, row in shown if row.get("verdict") in DETERMINED and row["value"] is not None
    ]
    judged = [row for _, row in shown if row.get("verdict")]
    missed = [row for row in bounds if row["verdict"] == MISSED]
    doubtful = [(part, row) for part, row in shown if row.get("verdict") and row not in good]
    warned = tuple(dict.fromkeys(remarks(sections, "warning")))
    asked = bool(judged or bounds)
    met, of = _counted(bounds)
    some = bool(good) or 2 * met > of or not asked
    level: Level = (
        "good"
        if asked and not doubtful and not missed and not warned
        else "fair"
        if some
        else "poor"
    )
    in_order = dict(sorted(sections.items(), key=lambda item: int(item[1]["order"])))
    found = tuple(dict.fromkeys(remarks(in_order, "finding")))
    return Summary(
        level=level,
        headline=_headline(len(judged), len(good), len(rows), bounds),
        explanation=_explanation(shown, found),
        take=None,
        judged_on="validation",
        facts=_facts(logs, rows, good, judged, bounds),
        models=(),
        identified=(),
        missing=(
            *(f"Missed beside the print: {_bound(row)}." for row in missed),
            *_undetermined(doubtful),
            *_damaged(logs),
            *assumed_figures(vehicle),
        ),
        warnings=warned,
        figures=tuple(_figure(part, row) for part, row in shown),
        bounds=tuple(_bound(row) for row in bounds),
    )


def _headline(judged: int, good: int, rows: int, bounds: list[Document]) -> str:
    met, of = _counted(bounds)
    held = (
        ""
        if not of
        else (
            "every bound on printed values is met"
            if met == of
            else f"{met} of {of} bounds on printed values met"
        )
    )
    if not judged:
        return held[:1].upper() + held[1:] if held else f"{plural(rows, 'figure')} found"
    if good == judged:
        words = (
            "Every figure that was asked for is determined"
            if judged > 1
            else "The figure that was asked for is determined"
        )
    else:
        words = (
            f"{good} of {plural(judged, 'figure')} determined"
            if good
            else "The recordings determine none of the figures"
        )
    return (
        f"{words}, {held}"
        if held
        else words
        if good in (judged, 0)
        else f"{words}: the others say why not"
    )


def _explanation(shown: list[tuple[str, Document]], found: tuple[str, ...]) -> str:
    """Few determined figures with their intervals; of many, what the stages say first
    of all.
    """
    known = [_figure(part, row) for part, row in shown if row["value"] is not None]
    if not known or len(known) > FEW:
        return " ".join(found[:2])
    parts: dict[str, list[str]] = {}
    for item in known:
        interval = f" ({item.interval})" if item.interval else ""
        parts.setdefault(item.part, []).append(f"{item.quantity} {item.value}{interval}")
    return " ".join(
        f"{part[:1].upper()}{part[1:]}: {', '.join(words)}." for part, words in parts.items()
    )


def _counted(bounds: list[Document]) -> tuple[int, int]:
    """How many bounds are met, and of how many; a figure that does not say how many it
    holds counts as one.
    """
    found = [(row, str(row["quantity"]).rpartition(BOUNDS_OF)) for row in bounds]
    met = sum(int(row["value"]) if title else row["verdict"] == MET for row, (title, _, _) in found)
    return met, sum(int(asked) if title else 1 for _, (title, _, asked) in found)


def _bound(row: Document) -> str:
    """`Table 4: 8 of 8 met, largest error 0.41 % (X_udot)`."""
    title, _, asked = str(row["quantity"]).rpartition(BOUNDS_OF)
    words = (
        f"{title}: {row['value']:g} of {asked} met"
        if title
        else f"{row['quantity']}: {row['verdict']}"
    )
    return f"{words}, {row['note']}" if row.get("note") else words


def _facts(
    logs: Mapping[str, Document],
    rows: list[tuple[str, Document]],
    good: list[Document],
    judged: list[Document],
    bounds: list[Document],
) -> tuple[Fact, ...]:
    facts = []
    if bounds:
        met, of = _counted(bounds)
        facts.append(
            Fact(
                "bounds met", f"{met} of {of}", f"on printed values, {plural(len(bounds), 'table')}"
            )
        )
    if judged:
        facts.append(
            Fact(
                "figures determined",
                f"{len(good)} of {len(judged)}",
                f"{len(rows)} with all methods and models",
            )
        )
    else:
        facts.append(Fact("figures", str(len(rows)), "in the sections below"))
    if logs:
        whole = sum(item["status"] == "complete" for item in logs.values())
        facts.append(
            Fact(
                "logs complete",
                f"{whole} of {len(logs)}",
                plural(sum(len(item["files"]) for item in logs.values()), "file"),
            )
        )
    return tuple(facts)


def _undetermined(doubtful: list[tuple[str, Document]]) -> list[str]:
    found: dict[str, list[str]] = {}
    for part, row in doubtful:
        found.setdefault(f"{part}: {row['verdict']}", []).append(str(row["quantity"]))
    return [f"{head}: {', '.join(names)}." for head, names in found.items()]


def _damaged(logs: Mapping[str, Document]) -> list[str]:
    return [
        f"Log {name} is {log['status']}."
        for name, log in logs.items()
        if log["status"] != "complete"
    ]


def _figure(part: str, row: Document) -> Figure:
    value, error, low, high = (
        row["value"],
        row.get("standard_error"),
        row.get("low"),
        row.get("high"),
    )
    places = _places(value, error)
    words = (
        "not determined" if value is None else true_minus(f"{value:{places}} {_unit(row)}".rstrip())
    )
    interval = (
        "" if low is None or high is None else true_minus(f"{low:{places}} to {high:{places}}")
    )
    narrow = bool(interval) and f"{low:{places}}" == f"{high:{places}}"
    if (not interval or narrow) and error is not None and value is not None:
        interval = f"± {number(float(f'{NORMAL_95 * error:.2g}'))}"
    return Figure(
        part,
        str(row["quantity"]),
        words,
        interval,
        str(row.get("verdict") or ""),
        str(row.get("note") or ""),
    )


def _unit(row: Document) -> str:
    """kg*m^2 as kg m²."""
    return "" if row["unit"] in ("1", "") else printed_unit(str(row["unit"]))


def _places(value: float | None, error: float | None) -> str:
    """Format with as many digits as the standard error supports, three to six
    significant ones.
    """
    if not value or not error or not math.isfinite(error):
        return ".4g"
    places = 1 - math.floor(math.log10(error))
    return f".{max(0, min(places, 5 - math.floor(math.log10(abs(value)))))}f"
