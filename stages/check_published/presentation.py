"""Section, tables and figures of printed values beside ours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from auvid.data_schemas.documents.published_values import (
    PRINTED_VALUES,
    Evidence,
    PublishedFigureEntry,
    PublishedLineEntry,
    PublishedValuesDocument,
)
from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.data_schemas.tables import column
from auvid.stages.base import Collection
from auvid.stages.columns import clock
from auvid.stages.number_format import as_printed
from auvid.stages.presentation import (
    Block,
    fold,
    panel,
    plot,
    remark,
    section,
    series,
    table,
    text,
)
from auvid.stages.reference_check import (
    EACH,
    SHOWS,
    ReferenceCheck,
    Tolerance,
    check_rows,
)


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


HEADS: dict[Evidence, str] = {
    "method": "tests",
    "construction": "by construction",
    "tuned": "tuned",
    "unprinted": "not printed",
}
"""What bounds show, in heads of columns."""
EVIDENCE_NOTE = (
    "A bound tests the method where the method could have missed the value. It holds by"
    " construction where the twin flew the value and the chain inverts the twin: what it"
    " shows is that the two agree. It is tuned where a value was set so that it is met."
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
    return ["table", *(HEADS[kind] for kind in used), "bounds", "met"], cells


def evidence_reasons(rows: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return rows of quantities, what their bounds show, and why: one per reason."""
    reasons: dict[tuple[Evidence, str], list[str]] = {}
    for row in rows:
        if row["evidence"]:
            reasons.setdefault((row["evidence"], row["reason"]), []).append(row["quantity"])
    return [[", ".join(names), EACH[kind], reason] for (kind, reason), names in reasons.items()]


def _percent(share: float | None) -> str:
    return "" if share is None else as_printed(100.0 * share, places=2)


def figure_blocks(
    figures: Sequence[PublishedFigureEntry], tables: Collection[pa.Table]
) -> list[Block]:
    """Return the figures of the source, drawn from our tables, on its axes.

    What the source states of a curve is a level line. Raises `CampaignError` for tables,
    columns and recordings that are not there, all together.
    """
    raise_faults(list(_line_faults(figures, tables)), file="the published values")
    return [_figure_block(entry, tables) for entry in figures]


def _figure_block(entry: PublishedFigureEntry, tables: Collection[pa.Table]) -> Block:
    lines = []
    spans: list[float] = []
    for number, line in enumerate(entry.lines):
        rows = _rows(line, tables[line.table])
        t = clock(rows)
        spans += [float(t[0]), float(t[-1])]
        role = "measured" if number == 0 else f"line {number}"
        lines.append(series(f"ours: {line.name}", t, line.factor * column(rows, line.column), role))
    ends = np.array([min(spans), max(spans)])
    lines += [
        series(f"printed: {name}", ends, np.full(2, value), "true")
        for name, value in entry.printed.items()
    ]
    return plot(
        f"{entry.id}: {entry.title}",
        [panel(entry.label, entry.unit, lines)],
        group=entry.id,
        look_for=entry.note,
    )


def _rows(line: PublishedLineEntry, rows: pa.Table) -> pa.Table:
    if line.recording is None:
        return rows
    return rows.filter(pc.equal(rows.column("recording"), line.recording))


def _line_faults(
    figures: Sequence[PublishedFigureEntry], tables: Collection[pa.Table]
) -> Iterator[PipelineError]:
    for f, entry in enumerate(figures):
        for index, line in enumerate(entry.lines):
            at = f"figures[{f}].lines[{index}]"
            if line.table not in tables:
                yield CampaignError(
                    "no stage has this table",
                    field=f"{at}.table",
                    value=line.table,
                    remedy=nearest(line.table, tables) or "Run the stages that find it first.",
                )
                continue
            rows = tables[line.table]
            for name in (line.column, *["recording"] * (line.recording is not None)):
                if name not in rows.column_names:
                    yield CampaignError(
                        "the table has no such column",
                        field=f"{at}.column",
                        value=name,
                        allowed=rows.column_names,
                        remedy=nearest(name, rows.column_names),
                    )
                    break
            else:
                if _rows(line, rows).num_rows == 0:
                    recordings = pc.unique(rows.column("recording")).to_pylist()
                    yield CampaignError(
                        "no such recording",
                        field=f"{at}.recording",
                        value=line.recording,
                        allowed=recordings,
                        remedy=nearest(str(line.recording), recordings),
                    )


def published_section(
    published: PublishedValuesDocument,
    rows: Sequence[Mapping[str, Any]],
    figures: Iterable[Block] = (),
) -> dict[str, Any]:
    """Return the section: what bounds show, what is missed, figures, tables, errata."""
    checks = [check_of(row) for row in rows]
    missed = [
        f"{row['table']}, {check.quantity}: {check.shortfall}"
        for row, check in zip(rows, checks, strict=True)
        if check.met is False
    ]
    is_printed = published.reference == PRINTED_VALUES
    blocks: list[Block] = [
        text(
            f"Printed: {published.source}. Errors are relative to what is to be found: the print"
            " unless a column says otherwise."
            if is_printed
            else f"True values: {published.source}. Errors are relative to them."
        )
    ]
    if any(check.met is not None for check in checks):
        blocks.append(table("What the bounds show", *evidence_table(rows), note=EVIDENCE_NOTE))
    blocks += [*(remark(words, "warning") for words in missed), *figures]
    for entry in published.tables:
        notes = [entry.note, f"Errata {', '.join(entry.errata)}." if entry.errata else ""]
        of_table = [row for row in rows if row["table"] == entry.id]
        reasons = evidence_reasons(of_table)
        if len(reasons) == 1:
            ((_, shows, reason),) = reasons
            notes.append(f"Each bound {shows}: {reason}.")
        title = f"{entry.id}: {entry.title}"
        members = [
            table(title, *printed_rows(of_table, "note"), note=" ".join(filter(None, notes)))
        ]
        if len(reasons) > 1:
            of_reasons = ("quantity", "its bound", "because")
            members.append(table(f"{entry.id}: what its bounds show", of_reasons, reasons))
        blocks += fold(title, members)
    if published.errata:
        heads = ("erratum", "where", "printed", "corrected or recomputed", "confidence", "shown")
        cells = [
            [item.id, item.where, item.printed, item.corrected, item.confidence, item.shown]
            for item in published.errata
        ]
        blocks += fold("Errata of the source", [table("Errata of the source", heads, cells)])
    return section(
        "Printed tables beside ours" if is_printed else "True values beside ours",
        blocks,
        order=2,
        look_for=(
            "Which bounds are missed; an erratum explains where the print cannot be met."
            if is_printed
            else "Which bounds are missed."
        ),
    )
