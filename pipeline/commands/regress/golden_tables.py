"""Golden error tables, and how far each cell may move.

One small CSV per use in the layout of McCarter 5.1 and 5.2, with J/J0 per axis.

Tables hold six significant digits, and figures are compared as printed. An undefined
ratio (no force on that axis) is an empty cell.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.store.atomic_files import readable
from auvid.stages.reference_check import MOVED, ReferenceCheck, Tolerance, check_rows

USES = ("training", "validation")
OTHER_FILES = ("stages.csv", "coefficients.csv", "free_run.csv", "results.csv")
"""Golden figures, which lie beside the tables (golden_figures.py)."""
COUNTS = ("n_bar", "rank")
FIXED = ("model", *COUNTS, "J", "J0", "ratio")
NEVER_EMPTY = (*COUNTS, "J", "J0")
TOLERANCES = "tolerances.yaml"
ALL = "all"
PRINTED_NAMES = {"n_bar": "n-bar", "ratio": "J/J0"}
"""Columns under other words in the thesis; those of an axis are J/J0."""

Row = Mapping[str, float | None]
"""One model: column (those of `FIXED` but model, then the axes) -> figure, None where
undefined.
"""
Tables = Mapping[str, Mapping[str, Row]]
"""Use -> model -> row, in the order of the error table."""


@dataclass(frozen=True)
class Departure:
    """A cell that left its tolerance, or what only one side has: then without a check.

    That is a use (model None), a model (column None) or a column, `missing` from the
    run or `new` in it. A golden figure has the `stage` that gave it; its file stands for
    the use, what it is of for the model.
    """

    kind: str
    use: str
    model: str | None = None
    column: str | None = None
    check: ReferenceCheck | None = None
    stage: str = ""

    @property
    def size(self) -> float:
        """The change in tolerances; infinite where there is none to measure it by."""
        times = self.check.times_tolerance if self.check else None
        return math.inf if times is None else times

    @property
    def axis(self) -> str:
        """Return the axis of the column."""
        return ALL if self.column in (None, *FIXED) else str(self.column)

    @property
    def document(self) -> dict[str, Any]:
        """Return the departure as JSON."""
        place = {"kind": self.kind, "use": self.use, "model": self.model, "column": self.column}
        if self.stage:
            return {"stage": self.stage, **place, **(self.check.document if self.check else {})}
        return {**place, "axis": self.axis, **(self.check.document if self.check else {})}


def departure_rows(departures: Sequence[Departure]) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the cells that left their tolerance."""
    checks = [((item.use, item.model, item.axis), item.check) for item in departures if item.check]
    return check_rows(("use", "model", "axis"), checks, MOVED)


def tables_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, dict[str, float | None]]]:
    """Return the golden tables of the rows of an error table.

    All legs together, six significant digits.
    """
    by_use: dict[str, dict[str, dict[str, float | None]]] = {}
    for row in rows:
        if row["leg"] != ALL:
            continue
        figures = by_use.setdefault(row["use"], {}).setdefault(
            row["model"], dict.fromkeys(FIXED[1:])
        )
        if row["axis"] == ALL:
            total = {
                "n_bar": row["n_bar"],
                "rank": row["rank"],
                "J": row["rms"],
                "J0": row["j0"],
                "ratio": row["ratio"],
            }
            figures |= {name: six_digits(value) for name, value in total.items()}
        else:
            figures[row["axis"]] = six_digits(row["ratio"])
    return by_use


def six_digits(value: float | None) -> float | None:
    """Return a number as golden files have it; None where it is not finite."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.6g}")


def to_csv(table: Mapping[str, Row]) -> bytes:
    """Return the CSV of one use: a header and a row per model."""
    columns = list(dict.fromkeys(name for row in table.values() for name in row))
    lines = [",".join(["model", *columns])]
    for model, row in table.items():
        lines.append(
            ",".join(
                [model, *("" if row.get(name) is None else f"{row[name]:.6g}" for name in columns)]
            )
        )
    return ("\n".join(lines) + "\n").encode()


def read_tables(folder: Path) -> dict[str, dict[str, dict[str, float | None]]]:
    """Read the golden tables of a folder, empty if it holds none.

    Raises `CampaignError` with file, row and field for what is malformed.
    """
    names = sorted(path.name for path in folder.glob("*.csv"))
    file_names = [f"{use}.csv" for use in USES]
    for name in names:
        if name not in (*file_names, *OTHER_FILES):
            raise CampaignError(
                "no golden table is called this",
                file=folder / name,
                allowed=[*file_names, *OTHER_FILES],
                remedy=nearest(name, [*file_names, *OTHER_FILES]),
            )
    return {use: _read_csv(folder / f"{use}.csv") for use in USES if f"{use}.csv" in names}


def _read_csv(path: Path) -> dict[str, dict[str, float | None]]:
    with readable(path, file=path, what="golden table"):
        content = path.read_bytes()
    try:
        reader = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True)
        lines = [(reader.line_num, cells) for cells in reader if cells]
    except UnicodeDecodeError as fault:
        raise CampaignError(
            "not UTF-8 text", file=path, row=content[: fault.start].count(b"\n") + 1
        ) from None
    except csv.Error as fault:
        raise CampaignError(f"not valid CSV: {fault}", file=path, row=reader.line_num) from None
    if len(lines) < 2:
        raise CampaignError(
            "a header and at least one model are needed",
            file=path,
            remedy="Write it anew with --update.",
        )
    (_, header), *body = lines
    _check_header(header, path)
    faults: list[PipelineError] = []
    table: dict[str, dict[str, float | None]] = {}
    for line, cells in body:
        if len(cells) != len(header):
            faults.append(
                CampaignError(
                    f"{len(cells)} cells under {len(header)} headings",
                    file=path,
                    row=line,
                    value=cells[0],
                )
            )
            continue
        if cells[0] in table or not cells[0]:
            faults.append(
                CampaignError(
                    "each row needs a model of its own",
                    file=path,
                    row=line,
                    field="model",
                    value=cells[0],
                )
            )
            continue
        table[cells[0]] = row = {}
        for name, cell in zip(header[1:], cells[1:], strict=True):
            try:
                row[name] = _figure(name, cell.strip())
            except ValueError as fault:
                faults.append(
                    CampaignError(str(fault), file=path, row=line, field=name, value=cell)
                )
    raise_faults(faults, file=path)
    return table


def _check_header(header: list[str], path: Path) -> None:
    for place, name in enumerate(FIXED):
        if header[place : place + 1] != [name]:
            head = header[place] if place < len(header) else None
            raise CampaignError(
                "not the heading that stands here",
                file=path,
                row=1,
                field=name,
                value=head,
                allowed=f"{', '.join(FIXED)}, axes",
            )
    for place, name in enumerate(header):
        if not name or name in header[:place]:
            raise CampaignError(
                "each column needs a heading of its own",
                file=path,
                row=1,
                field=f"column {place + 1}",
                value=name,
            )


def _figure(name: str, cell: str) -> float | None:
    if not cell:
        if name in NEVER_EMPTY:
            raise ValueError("this cell may not be empty")
        return None
    try:
        value = float(cell)
    except ValueError:
        raise ValueError("not a number") from None
    if not math.isfinite(value) or value < 0:
        raise ValueError("not a finite number of at least 0")
    if name in COUNTS and value != int(value):
        raise ValueError("a count is a whole number")
    return value


def read_tolerances(path: Path, columns: Iterable[str]) -> dict[str, Tolerance]:
    """Return the tolerances of a folder, one for each of these columns.

    Raises `SchemaError` or `CampaignError` for unknown keys, columns without a
    tolerance and tolerances without a column.
    """
    file = load_yaml(path, what="tolerances")
    file.check("tolerances")
    entries, needed = file.value["columns"], list(dict.fromkeys(columns))
    faults: list[PipelineError] = []
    for name in needed:
        if name not in entries:
            faults.append(
                CampaignError("no tolerance for this column", file=path, field=f"columns.{name}")
            )
    for name, entry in entries.items():
        at = f"columns.{name}"
        if name not in needed:
            remedy = nearest(name, [column for column in needed if column not in entries])
            faults.append(
                CampaignError("no such column", file=path, field=at, allowed=needed, remedy=remedy)
            )
        elif not {"relative", "absolute"} & set(entry):
            faults.append(CampaignError("needs relative, absolute or both", file=path, field=at))
    raise_faults([file.located(fault) for fault in faults], file=path)
    return {name: Tolerance(**entry) for name, entry in entries.items()}


def columns_of(*tables: Tables) -> list[str]:
    """Return the columns of figures of all tables, each once."""
    return list(
        dict.fromkeys(
            name
            for table in tables
            for use in table.values()
            for row in use.values()
            for name in row
        )
    )


def compare(
    old: Tables, new: Tables, tolerances: Mapping[str, Tolerance]
) -> tuple[int, list[Departure]]:
    """Return how many cells hold, and what does not.

    First what is missing or new, then the largest departure in tolerances.
    """
    places = list(_compare(old, new, tolerances))
    departed = sorted(
        (item for item in places if item.check is None or not item.check.met),
        key=lambda item: (-item.size, item.kind == "changed"),
    )
    return len(places) - len(departed), departed


def _compare(old: Tables, new: Tables, tolerances: Mapping[str, Tolerance]) -> Iterator[Departure]:
    """Yield every cell that both have, and what only one has."""
    for use in dict.fromkeys((*old, *new)):
        if use not in old or use not in new:
            yield Departure(_only(use in old), use)
            continue
        before, now = old[use], new[use]
        for model in dict.fromkeys((*before, *now)):
            if model not in before or model not in now:
                yield Departure(_only(model in before), use, model)
                continue
            for column in dict.fromkeys((*before[model], *now[model])):
                if column not in before[model] or column not in now[model]:
                    yield Departure(_only(column in before[model]), use, model, column)
                else:
                    tolerance = tolerances[column]
                    check = ReferenceCheck(
                        PRINTED_NAMES.get(column, column if column in FIXED else "J/J0"),
                        now[model][column],
                        tolerance.unit,
                        reference=before[model][column],
                        tolerance=tolerance,
                    )
                    yield Departure("changed", use, model, column, check)


def _only(in_baseline: bool) -> str:
    return "missing" if in_baseline else "new"
