"""Comparison of results with printed tables, with the errata of their source shown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import pyarrow as pa

from auvid.data_schemas.documents.published_values import (
    Evidence,
    PublishedRowEntry,
    PublishedTableEntry,
    PublishedValuesDocument,
)
from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import make_table
from auvid.stages.base import Collection, Document, Stage, every, port
from auvid.stages.number_format import as_printed, percent
from auvid.stages.presentation import Block, figure, remark, section, table, text
from auvid.stages.reference_check import (
    EACH,
    SHOWS,
    ReferenceCheck,
    Tolerance,
    check_rows,
    count_bounds,
)


@dataclass(frozen=True)
class Inputs:
    """The printed tables, if the manifest names them, and results by `stage/item`."""

    results: Collection[Document] = every("results")
    published: PublishedValuesDocument | None = port("published_values", optional=True)


@dataclass(frozen=True)
class Params:
    """None: what is required stands beside the printed values."""


@dataclass(frozen=True)
class Outputs:
    """One row per printed value; nothing for a campaign without printed tables."""

    comparison: pa.Table | None = port("comparison", optional=True)
    bounds: dict[str, Any] | None = port("results", optional=True)
    section: dict[str, Any] | None = port("section", optional=True)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Compare all tables.

    Raises `CampaignError` for figures that no stage has, all together.
    """
    if inputs.published is None:
        return Outputs()
    figures = {
        f"{part}:{row['quantity']}": row
        for part, document in inputs.results.items()
        for row in document["rows"]
    }
    raise_faults(list(_faults(inputs.published, figures)), file="the published values")
    rows = [
        compare_row(entry, row, figures) for entry in inputs.published.tables for row in entry.rows
    ]
    columns = {name: [row[name] for row in rows] for name in schema("comparison").columns}
    return Outputs(
        make_table("comparison", columns),
        _bounds(inputs.published, rows),
        _section(inputs.published, rows),
    )


def _bounds(
    published: PublishedValuesDocument, rows: list[dict[str, Any]]
) -> dict[str, Any] | None:
    """Return how many bounds are met, by table and by what they show; None without any."""
    figures = []
    for entry, kind in product(published.tables, SHOWS):
        required = [row for row in rows if (row["table"], row["evidence"]) == (entry.id, kind)]
        if required:
            met = sum(row["met"] for row in required)
            bounded = [row for row in required if row["bound"] and row["our_error"] is not None]
            worst = max(bounded, key=lambda row: abs(row["our_error"]), default=None)
            note = (
                None
                if worst is None
                else f"largest error {percent(abs(worst['our_error']), 2)} ({worst['quantity']})"
            )
            title = entry.id if kind == "method" else f"{entry.id}, {EACH[kind]}"
            figures.append(
                figure(
                    f"{title}: bounds met of {len(required)}",
                    float(met),
                    "1",
                    verdict="met" if met == len(required) else "missed",
                    note=note,
                    headline=True,
                    evidence=kind,
                )
            )
    return {"title": published.title, "rows": figures} if figures else None


def compare_row(
    table: PublishedTableEntry, row: PublishedRowEntry, figures: Mapping[str, Document]
) -> dict[str, Any]:
    """Return one row of schema `comparison`.

    Met: error, value and verdict are all as required; None where nothing is required.
    """
    figure = figures[row.ours] if row.ours is not None else {}
    value, spread = figure.get("value"), figure.get("standard_error")
    evidence, reason = table.evidence_of(row)
    entry: dict[str, Any] = {
        "table": table.id,
        "quantity": row.quantity,
        "unit": row.unit,
        "printed": row.printed,
        "corrected": row.corrected,
        "truth": row.to_be_found,
        "ours": None if value is None else row.offset + row.factor * value,
        "standard_error": None if spread is None else abs(row.factor) * spread,
        "bound": row.most_relative_error,
        "least": row.least,
        "most": row.most,
        "verdict": str(figure.get("verdict") or ""),
        "required_verdict": row.verdict or "",
        "evidence": evidence or "",
        "reason": reason,
        "source": row.ours or "",
        "note": row.note,
    }
    check = check_of(entry)
    printed = ReferenceCheck("", entry["printed"], reference=entry["truth"])
    return {
        **entry,
        "printed_error": printed.relative_change,
        "our_error": check.relative_change,
        "met": check.met,
    }


def check_of(row: Mapping[str, Any]) -> ReferenceCheck:
    """Return the check of a row of schema `comparison`."""
    return ReferenceCheck(
        row["quantity"],
        row["ours"],
        row["unit"],
        reference=row["truth"],
        tolerance=None if row["bound"] is None else Tolerance(relative=row["bound"]),
        low=row["least"],
        high=row["most"],
        status=row["verdict"],
        required_status=row["required_verdict"] or None,
        evidence=row["evidence"] or "method",
        evidence_reason=row["reason"],
    )


def printed_rows(
    rows: Sequence[Mapping[str, Any]], *more: str
) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of one printed table beside ours, on page and terminal.

    `more`: further columns. Those that are empty in every row are left out, and the
    value to be found where it is the printed one.
    """
    same = all(row["printed"] == row["truth"] for row in rows)
    labelled = []
    for row in rows:
        printed, corrected, truth, ours = (as_printed(row[name], empty="") for name in VALUES)
        errors = [_percent(row[name]) for name in ("printed_error", "our_error")]
        if same:
            truth = errors[0] = ""
        labels = (row["quantity"], row["unit"], printed, corrected, truth, ours, *errors)
        labelled.append(((*labels, *(row[name] for name in more)), check_of(row)))
    heads = ("quantity", "unit", "printed", "corrected", "to be found", "ours")
    return check_rows(
        (*heads, "printed error %", "our error %", *more),
        labelled,
        ("required", "verdict", "shows"),
    )


EVIDENCE_NOTE = (
    "A bound tests the method where the method could have missed the print. It holds by"
    " construction where the twin flew the printed value and the chain inverts the twin: what it"
    " shows is that the two agree."
)
VALUES = ("printed", "corrected", "truth", "ours")


def evidence_table(rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the bounds of each table by what meeting them shows.

    The last row has the totals.
    """
    bounded = [row for row in rows if row["evidence"]]
    used = [kind for kind in SHOWS if any(row["evidence"] == kind for row in bounded)]
    tables = dict.fromkeys(row["table"] for row in bounded)
    parts = {
        **{name: [row for row in bounded if row["table"] == name] for name in tables},
        "all tables": bounded,
    }
    cells = [
        [
            name,
            *(str(sum(row["evidence"] == kind for row in own)) for kind in used),
            str(len(own)),
            str(sum(row["met"] for row in own)),
        ]
        for name, own in parts.items()
    ]
    return ["table", *(EACH[kind] for kind in used), "bounds", "met"], cells


def evidence_reasons(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return a sentence per reason why bounds show what they show."""
    reasons: dict[tuple[Evidence, str], list[str]] = {}
    for row in rows:
        if row["evidence"]:
            reasons.setdefault((row["evidence"], row["reason"]), []).append(row["quantity"])
    of_all = len(reasons) == 1
    return [
        f"{'' if of_all else ', '.join(names) + ': '}{EACH[kind]}, as {reason}."
        for (kind, reason), names in reasons.items()
    ]


def _percent(share: float | None) -> str:
    return "" if share is None else as_printed(100.0 * share, places=2)


def _faults(
    published: PublishedValuesDocument, figures: Mapping[str, Document]
) -> Iterator[PipelineError]:
    for t, entry in enumerate(published.tables):
        for index, row in enumerate(entry.rows):
            if row.ours is not None and row.ours not in figures:
                yield CampaignError(
                    "no stage has this figure",
                    field=f"tables[{t}].rows[{index}].ours",
                    value=row.ours,
                    remedy=nearest(row.ours, figures) or "Run the stages that find it first.",
                )


def _section(published: PublishedValuesDocument, rows: list[dict[str, Any]]) -> dict[str, Any]:
    checks = [check_of(row) for row in rows]
    missed = [
        f"{row['table']}, {check.quantity}: {check.shortfall}"
        for row, check in zip(rows, checks, strict=True)
        if check.met is False
    ]
    blocks: list[Block] = [
        text(
            f"Printed: {published.source}. Errors are relative to what is to be found: the print"
            " unless a column says otherwise."
        )
    ]
    if any(check.met is not None for check in checks):
        words = f"Bounds on the printed tables: {count_bounds(checks)}."
        blocks.append(remark(words, "warning" if missed else "finding"))
        blocks.append(table("What the bounds show", *evidence_table(rows), note=EVIDENCE_NOTE))
    blocks += [remark(words, "warning") for words in missed]
    for entry in published.tables:
        notes = [entry.note, f"Errata {', '.join(entry.errata)}." if entry.errata else ""]
        notes += evidence_reasons(row for row in rows if row["table"] == entry.id)
        own = printed_rows([row for row in rows if row["table"] == entry.id], "note")
        title = f"{entry.id}: {entry.title}"
        blocks.append(table(title, *own, note=" ".join(filter(None, notes))))
    if published.errata:
        heads = ("erratum", "where", "printed", "corrected or recomputed", "confidence", "shown")
        cells = [
            [item.id, item.where, item.printed, item.corrected, item.confidence, item.shown]
            for item in published.errata
        ]
        blocks.append(table("Errata of the source", heads, cells))
    return section(
        "Printed tables beside ours",
        blocks,
        order=2,
        look_for="Every bound is met; an erratum explains where the print cannot be.",
    )


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="check_published",
    summary="Printed tables beside the results, with the errata of their source",
    maps_over="campaign",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
    no_views="tables of single values have no series",
)
