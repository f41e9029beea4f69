"""Comparison of results with printed tables, with the errata of their source shown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import make_table
from auvid.stages.base import Collection, Document, Stage, every, port
from auvid.stages.number_format import as_printed, percent
from auvid.stages.presentation import Block, figure, remark, section, table, text
from auvid.stages.reference_check import ReferenceCheck, Tolerance, check_rows, count_met


@dataclass(frozen=True)
class Inputs:
    """The printed tables, if the manifest names them, and results by `stage/item`."""

    results: Collection[Document] = every("results")
    published: Document | None = port("published_values", optional=True)


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

    Raises `CampaignError` for figures that no stage has, all together, and for tables
    that name unknown errata.
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
        compare_row(entry["id"], row, figures)
        for entry in inputs.published["tables"]
        for row in entry["rows"]
    ]
    columns = {name: [row[name] for row in rows] for name in schema("comparison").columns}
    return Outputs(
        make_table("comparison", columns),
        _bounds(inputs.published, rows),
        _section(inputs.published, rows),
    )


def _bounds(published: Document, rows: list[dict[str, Any]]) -> dict[str, Any] | None:
    """Return how many requirements are met, by table; None without requirements."""
    figures = []
    for entry in published["tables"]:
        required = [row for row in rows if row["table"] == entry["id"] and row["met"] is not None]
        if required:
            met = sum(row["met"] for row in required)
            bounded = [row for row in required if row["bound"] and row["our_error"] is not None]
            worst = max(bounded, key=lambda row: abs(row["our_error"]), default=None)
            note = (
                None
                if worst is None
                else f"largest error {percent(abs(worst['our_error']), 2)} ({worst['quantity']})"
            )
            verdict = "met" if met == len(required) else "missed"
            title = f"{entry['id']}: bounds met of {len(required)}"
            figures.append(
                figure(title, float(met), "1", verdict=verdict, note=note, headline=True)
            )
    return {"title": str(published["title"]), "rows": figures} if figures else None


def compare_row(name: str, row: Document, figures: Mapping[str, Document]) -> dict[str, Any]:
    """Return one row of schema `comparison`.

    Met: error, value and verdict are all as required; None where nothing is required.
    """
    figure = figures.get(row.get("ours", ""), {})
    factor, value = float(row.get("factor", 1.0)), figure.get("value")
    spread = figure.get("standard_error")
    values = {
        "printed": row["printed"],
        "corrected": row.get("corrected"),
        "truth": row.get("truth", row.get("corrected", row["printed"])),
        "ours": None if value is None else float(row.get("offset", 0.0)) + factor * value,
        "standard_error": None if spread is None else abs(factor) * spread,
        "bound": row.get("most_relative_error"),
        "least": row.get("least"),
        "most": row.get("most"),
    }
    entry: dict[str, Any] = {
        "table": name,
        "quantity": str(row["quantity"]),
        "unit": str(row["unit"]),
        **{key: None if value is None else float(value) for key, value in values.items()},
        "verdict": str(figure.get("verdict") or ""),
        "required_verdict": str(row.get("verdict") or ""),
        "source": str(row.get("ours", "")),
        "note": str(row.get("note", "")),
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
        (*heads, "printed error %", "our error %", *more), labelled, ("required", "verdict")
    )


VALUES = ("printed", "corrected", "truth", "ours")


def _percent(share: float | None) -> str:
    return "" if share is None else as_printed(100.0 * share, places=2)


BOUNDS = ("most_relative_error", "least", "most", "verdict")


def _faults(published: Document, figures: Mapping[str, Document]) -> Iterator[PipelineError]:
    known = {entry["id"] for entry in published.get("errata") or ()}
    for t, entry in enumerate(published["tables"]):
        for name in entry.get("errata") or ():
            if name not in known:
                yield CampaignError(
                    "no such erratum",
                    field=f"tables[{t}].errata",
                    value=name,
                    remedy=nearest(name, known),
                )
        for index, row in enumerate(entry["rows"]):
            if "ours" in row and row["ours"] not in figures:
                remedy = nearest(row["ours"], figures) or "Run the stages that find it first."
                yield CampaignError(
                    "no stage has this figure",
                    field=f"tables[{t}].rows[{index}].ours",
                    value=row["ours"],
                    remedy=remedy,
                )
            if "ours" not in row and any(key in row for key in BOUNDS):
                yield CampaignError(
                    "a bound needs a figure",
                    field=f"tables[{t}].rows[{index}]",
                    value=row["quantity"],
                )


def _section(published: Document, rows: list[dict[str, Any]]) -> dict[str, Any]:
    checks = [check_of(row) for row in rows]
    missed = [
        f"{row['table']}, {check.quantity}: {check.shortfall}"
        for row, check in zip(rows, checks, strict=True)
        if check.met is False
    ]
    blocks: list[Block] = [
        text(
            f"Printed: {published['source']}. Errors are relative to what is to be found: the print"
            " unless a column says otherwise."
        )
    ]
    if any(check.met is not None for check in checks):
        words = f"{count_met(checks)} bounds on the printed tables are met."
        blocks.append(remark(words, "warning" if missed else "finding"))
    blocks += [remark(words, "warning") for words in missed]
    for entry in published["tables"]:
        notes = [
            str(entry.get("note", "")),
            f"Errata {', '.join(entry['errata'])}." if entry.get("errata") else "",
        ]
        own = printed_rows([row for row in rows if row["table"] == entry["id"]], "note")
        title = f"{entry['id']}: {entry['title']}"
        blocks.append(table(title, *own, note=" ".join(filter(None, notes))))
    errata = published.get("errata") or ()
    if errata:
        heads = ("erratum", "where", "printed", "corrected or recomputed", "confidence", "shown")
        keys = ("id", "where", "printed", "corrected", "confidence", "shown")
        cells = [[entry.get(key, "") for key in keys] for entry in errata]
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
