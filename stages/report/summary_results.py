"""The first screen of a bench or control campaign: the figures that its stages name, with intervals and verdicts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from stages.report.summary import Fact, Figure, Level, Summary, assumed_figures, plural, remarks
from stages.sections import Z95

Document = Mapping[str, Any]
DETERMINED = ("identified", "met", "measured", "held", "stable", "persistently exciting")
BOUNDS = ("met", "missed")


def summarise_results(
    results: Mapping[str, Document], logs: Mapping[str, Document], sections: Mapping[str, Document], vehicle: Document
) -> Summary:
    """The summary of documents of schema `results`, keyed `stage/item`: of their headlines, or of all figures where there is none.

    Bounds come first; further figures (other damping models, other methods) stand in the sections of their stages.
    """
    rows = [(str(document["title"]), row) for document in results.values() for row in document["rows"]]
    shown = sorted(
        [(part, row) for part, row in rows if row.get("headline")] or rows, key=lambda item: item[1].get("verdict") not in BOUNDS
    )
    good = [row for _, row in shown if row.get("verdict") in DETERMINED and row["value"] is not None]
    judged = [row for _, row in shown if row.get("verdict")]
    doubtful = [(part, row) for part, row in shown if row.get("verdict") and row not in good]
    warned = tuple(dict.fromkeys(remarks(sections, "warning")))
    level: Level = "good" if judged and not doubtful and not warned else "fair" if good or not judged else "poor"
    in_order = dict(sorted(sections.items(), key=lambda item: int(item[1]["order"])))
    found = tuple(dict.fromkeys(remarks(in_order, "finding")))
    return Summary(
        level=level,
        headline=_headline(len(judged), len(good), len(rows)),
        explanation=" ".join(found[:3]),
        take=None,
        judged_on="validation",
        facts=_facts(results, logs, rows, good, judged),
        models=(),
        identified=(),
        missing=(*_undetermined(doubtful), *_damaged(logs), *assumed_figures(vehicle)),
        warnings=warned,
        figures=tuple(_figure(part, row) for part, row in shown),
    )


def _headline(judged: int, good: int, rows: int) -> str:
    if not judged:
        return f"{plural(rows, 'figure')} found"
    if good == judged:
        return "Every figure that was asked for is determined" if judged > 1 else "The figure that was asked for is determined"
    return (
        f"{good} of {plural(judged, 'figure')} determined: the others say why not"
        if good
        else "The recordings determine none of the figures"
    )


def _facts(
    results: Mapping[str, Document],
    logs: Mapping[str, Document],
    rows: list[tuple[str, Document]],
    good: list[Document],
    judged: list[Document],
) -> tuple[Fact, ...]:
    facts = [Fact("parts", str(len(results)), plural(len(rows), "figure"))]
    if judged:
        facts.append(Fact("figures determined", f"{len(good)} of {len(judged)}", "with intervals below"))
    if logs:
        whole = sum(item["status"] == "complete" for item in logs.values())
        facts.append(Fact("logs complete", f"{whole} of {len(logs)}", plural(sum(len(item["files"]) for item in logs.values()), "file")))
    return tuple(facts)


def _undetermined(doubtful: list[tuple[str, Document]]) -> list[str]:
    found: dict[str, list[str]] = {}
    for part, row in doubtful:
        found.setdefault(f"{part}: {row['verdict']}", []).append(str(row["quantity"]))
    return [f"{head}: {', '.join(names)}." for head, names in found.items()]


def _damaged(logs: Mapping[str, Document]) -> list[str]:
    return [f"Log {name} is {log['status']}." for name, log in logs.items() if log["status"] != "complete"]


def _figure(part: str, row: Document) -> Figure:
    value, error, low, high = row["value"], row.get("standard_error"), row.get("low"), row.get("high")
    places = _places(value, error)
    words = "not determined" if value is None else f"{value:{places}} {_unit(row)}".rstrip()
    interval = "" if low is None or high is None else f"{low:{places}} to {high:{places}}"
    narrow = interval and f"{low:{places}}" == f"{high:{places}}"
    if (not interval or narrow) and error is not None and value is not None:
        interval = f"± {Z95 * error:.2g}"
    return Figure(part, str(row["quantity"]), words, interval, str(row.get("verdict") or ""), str(row.get("note") or ""))


def _unit(row: Document) -> str:
    """kg*m^2 as kg m²."""
    return "" if row["unit"] in ("1", "") else str(row["unit"]).replace("^2", "²").replace("*", " ")


def _places(value: float | None, error: float | None) -> str:
    """Format with as many digits as the standard error supports, three to six significant ones."""
    if not value or not error or not math.isfinite(error):
        return ".4g"
    places = 1 - math.floor(math.log10(error))
    return f".{max(0, min(places, 5 - math.floor(math.log10(abs(value)))))}f"
