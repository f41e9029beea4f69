"""Comparison of results with printed tables, with the errata of their source shown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import pyarrow as pa

from auvid.data_schemas.documents.published_values import (
    PublishedRowEntry,
    PublishedTableEntry,
    PublishedValuesDocument,
)
from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import make_table
from auvid.stages.base import Collection, Document, Stage, every, port
from auvid.stages.check_published.presentation import (
    check_of,
    figure_blocks,
    published_section,
)
from auvid.stages.number_format import percent
from auvid.stages.presentation import figure
from auvid.stages.reference_check import EACH, SHOWS, ReferenceCheck


@dataclass(frozen=True)
class Inputs:
    """Printed tables, if the manifest names them; results and tables of all stages."""

    results: Collection[Document] = every("results")
    tables: Collection[pa.Table] = every("table")
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
        published_section(
            inputs.published, rows, figure_blocks(inputs.published.figures, inputs.tables)
        ),
    )


def _bounds(
    published: PublishedValuesDocument, rows: list[dict[str, Any]]
) -> dict[str, Any] | None:
    """Return how many bounds are met, by table and by what they show, or None."""
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
                    reference=published.reference,
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
