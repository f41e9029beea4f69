"""Comparison of results with printed tables, with the errata of their source shown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import make_table
from auvid.stages.base import Collection, Document, Stage, every, port
from auvid.stages.presentation import Block, figure, remark, section, table, text


@dataclass(frozen=True)
class Inputs:
    """The printed tables, if the manifest names them, and results by `stage/item`."""

    results: Collection[Document] = every("results")
    published: Document | None = port("published_values", optional=True)


@dataclass(frozen=True)
class Params:
    """None: what is asked stands beside the printed values."""


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
                ""
                if worst is None
                else f"largest error {100.0 * abs(worst['our_error']):.2g} % ({worst['quantity']})"
            )
            verdict = "met" if met == len(required) else "missed"
            title = f"{entry['id']}: bounds met of {len(required)}"
            figures.append(
                figure(title, float(met), "1", verdict=verdict, note=note or None, headline=True)
            )
    return {"title": str(published["title"]), "rows": figures} if figures else None


def compare_row(name: str, row: Document, figures: Mapping[str, Document]) -> dict[str, Any]:
    """Return one row of schema `comparison`.

    Met: error, value and verdict are all as required; None where nothing is required.
    """
    figure = figures[row["ours"]] if "ours" in row else None
    ours = _ours(row, figure)
    truth = row.get("truth", row.get("corrected", row["printed"]))
    error = _relative(ours, truth)
    bound, required_verdict = row.get("most_relative_error"), str(row.get("verdict") or "")
    verdict = str((figure or {}).get("verdict") or "")
    least, most = _number(row.get("least")), _number(row.get("most"))
    results: list[bool] = []
    if bound is not None:
        results.append(error is not None and abs(error) <= bound)
    if least is not None or most is not None:
        results.append(
            ours is not None and (least is None or ours >= least) and (most is None or ours <= most)
        )
    if required_verdict:
        results.append(verdict == required_verdict)
    spread = None if figure is None else figure.get("standard_error")
    return {
        "table": name,
        "quantity": str(row["quantity"]),
        "unit": str(row["unit"]),
        "printed": _number(row["printed"]),
        "corrected": _number(row.get("corrected")),
        "truth": _number(truth),
        "ours": ours,
        "standard_error": (
            None if spread is None else abs(float(row.get("factor", 1.0))) * float(spread)
        ),
        "printed_error": _relative(_number(row["printed"]), truth),
        "our_error": error,
        "bound": _number(bound),
        "least": least,
        "most": most,
        "verdict": verdict,
        "asked_verdict": required_verdict,
        "met": all(results) if results else None,
        "source": str(row.get("ours", "")),
        "note": str(row.get("note", "")),
    }


def _ours(row: Document, figure: Document | None) -> float | None:
    if figure is None or figure["value"] is None:
        return None
    return float(row.get("offset", 0.0)) + float(row.get("factor", 1.0)) * float(figure["value"])


def _number(value: Any) -> float | None:
    return None if value is None else float(value)


def _relative(value: float | None, truth: float | None) -> float | None:
    """(value - truth) / |truth|; None where one is not known, or the truth is 0."""
    if value is None or truth is None or truth == 0.0:
        return None
    return (value - truth) / abs(truth)


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
    required = [row for row in rows if row["met"] is not None]
    missed = [row for row in required if not row["met"]]
    blocks: list[Block] = [
        text(
            f"Printed: {published['source']}. Errors are relative to what is to be found: the print"
            " unless a column says otherwise."
        )
    ]
    if required:
        met = len(required) - len(missed)
        words = f"{met} of {len(required)} bounds on the printed tables are met."
        blocks.append(remark(words, "warning" if missed else "finding"))
    blocks += [
        remark(f"{row['table']}, {row['quantity']}: {_why(row)}", "warning") for row in missed
    ]
    for entry in published["tables"]:
        own = [row for row in rows if row["table"] == entry["id"]]
        notes = [
            str(entry.get("note", "")),
            f"Errata {', '.join(entry['errata'])}." if entry.get("errata") else "",
        ]
        heads, cells = _without_empty([_cells(row) for row in own])
        blocks.append(
            table(
                f"{entry['id']}: {entry['title']}", heads, cells, note=" ".join(filter(None, notes))
            )
        )
    errata = published.get("errata") or ()
    if errata:
        erratum_heads = (
            "erratum",
            "where",
            "printed",
            "corrected or recomputed",
            "confidence",
            "shown",
        )
        keys = ("id", "where", "printed", "corrected", "confidence", "shown")
        blocks.append(
            table(
                "Errata of the source",
                erratum_heads,
                [[entry.get(key, "") for key in keys] for entry in errata],
            )
        )
    return section(
        "Printed tables beside ours",
        blocks,
        order=2,
        look_for="Every bound is met; an erratum explains where the print cannot be.",
    )


HEADS: tuple[str | tuple[str, str], ...] = (
    "quantity",
    "unit",
    "printed",
    "corrected",
    "to be found",
    "ours",
    ("printed error", "%"),
    ("our error", "%"),
    ("asked", "%"),
    "at least",
    "at most",
    "verdict",
    "met",
    "note",
)


def _cells(row: Mapping[str, Any]) -> list[Any]:
    percent = [_percent(row[key]) for key in ("printed_error", "our_error", "bound")]
    met = "" if row["met"] is None else "yes" if row["met"] else "no"
    values = [_as_printed(row[key]) for key in ("printed", "corrected", "truth", "ours")]
    limits = ["" if row[key] is None else f"{row[key]:g}" for key in ("least", "most")]
    return [
        row["quantity"],
        row["unit"],
        *values,
        *percent,
        *limits,
        row["verdict"] if row["asked_verdict"] else "",
        met,
        row["note"],
    ]


def _as_printed(value: float | None) -> str:
    """Return four decimals, as the theses print; tiny values by their size.

    Text, so that the page does not round it again.
    """
    if value is None:
        return ""
    return f"{value:.4f}" if value == 0.0 or abs(value) >= 1e-3 else f"{value:.2e}"


def _percent(share: float | None) -> str:
    """Return two decimals of a percent, as the theses print; tiny values by size."""
    if share is None:
        return ""
    return f"{100.0 * share:.2f}" if share == 0.0 or abs(share) >= 1e-4 else f"{100.0 * share:.0e}"


def _without_empty(rows: list[list[Any]]) -> tuple[list[str | tuple[str, str]], list[list[Any]]]:
    """Return heads and cells of the columns that are not empty.

    Also dropped: the required value where it is the printed one.
    """
    kept = [
        index for index in range(len(HEADS)) if any(row[index] not in (None, "") for row in rows)
    ]
    names = [head if isinstance(head, str) else head[0] for head in HEADS]
    printed, truth, off = (
        names.index(name) for name in ("printed", "to be found", "printed error")
    )
    if all(row[printed] == row[truth] for row in rows):
        kept = [index for index in kept if index not in (truth, off)]
    return [HEADS[index] for index in kept], [[row[index] for index in kept] for row in rows]


def _why(row: Mapping[str, Any]) -> str:
    if row["ours"] is None and any(row[key] is not None for key in ("bound", "least", "most")):
        return f"no value was found ({row['verdict'] or 'no verdict'})"
    if (
        row["bound"] is not None
        and row["our_error"] is not None
        and abs(row["our_error"]) > row["bound"]
    ):
        return (
            f"off by {100.0 * abs(row['our_error']):.3g} %, asked at most"
            f" {100.0 * row['bound']:.3g} %"
        )
    for key, words, outside in (
        ("least", "at least", float.__lt__),
        ("most", "at most", float.__gt__),
    ):
        if row[key] is not None and outside(row["ours"], row[key]):
            return f"{row['ours']:.4g} {row['unit']}, asked {words} {row[key]:g}"
    return f"the verdict is '{row['verdict']}', asked '{row['asked_verdict']}'"


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
