"""The tables of a fleet: runs, findings, verdicts and coefficients, as Parquet.

What an earlier call has read of a log, and its rows, are kept until something changes.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa

from auvid.data_schemas.checks import checks
from auvid.data_schemas.errors import UsageError, nearest
from auvid.data_schemas.records.fleet import FleetRun, FleetVerdict, LogSurvey
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.pipeline.commands.fleet.fleet_folder import TABLES, FleetFolder
from auvid.pipeline.store.artefacts import encode, load
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.pipeline.store.file_hashes import FileHashes, hash_bytes
from auvid.stages.page.first_screen import ALL, AXIS_WORDS

Rows = list[dict[str, Any]]
D = TypeVar("D", LogSurvey, FleetRun)
MEMORY = ".rows.json"
"""File of a fleet: what its tables were made of, log by log."""
MOST_LINES = 10_000
"""Of a table that wait as Python objects."""
INSTALLATION, THRUSTERS = "installation", "thrusters"
"""In place of a model: figures of how sensors sit, and strengths of thrusters."""
UNNAMED = "not named"
"""Vehicle of a log that names none."""
VELOCITY_OF = dict(zip(AXES, "uvwpqr", strict=True))


@dataclass(frozen=True)
class FleetRow:
    """A log of a fleet: id, paths, log used in its place, survey and result."""

    log: str
    files: tuple[str, ...]
    same_as: str
    survey: LogSurvey
    result: FleetRun

    @property
    def state(self) -> str:
        """Done, partly or refused."""
        return self.result.state

    @property
    def outline(self) -> FleetRow:
        """Return the row without what only the tables need, most of its size."""
        survey = self.survey.model_copy(update={"motion": None, "findings": []})
        result = self.result.model_copy(update={"verdicts": [], "coefficients": []})
        return replace(self, survey=survey, result=result)


@dataclass(frozen=True)
class KeptRows:
    """The rows of a log as its tables hold them: first row and number, by table.

    `made_of`: hash of all that they depend on. `outline`: its result without what only
    the tables need.
    """

    made_of: str
    rows: Mapping[str, Sequence[int]]
    outline: FleetRun


class FleetMemory:
    """Documents by their content, and rows by what they were made of.

    What has not changed is neither read nor validated again. Nothing is lost with the
    file of the memory but time.
    """

    def __init__(self, fleet: FleetFolder, hashes: FileHashes, code: str) -> None:
        self._file, self._hashes, self._code = fleet.root / MEMORY, hashes, code
        self._used: dict[str, str] = {}
        try:
            self._before = json.loads(self._file.read_bytes())
            self._keys: dict[str, str] = self._before["keys"]
            self.totals: dict[str, int] = self._before["totals"]
            usable = self._before["auvid"] == code and all(
                hashes.of(fleet.table(name)) == self._before["tables"][name] for name in TABLES
            )
            self.logs = self._rows(self._before["logs"]) if usable else {}
        except (OSError, ValueError, LookupError, TypeError):
            self._before, self._keys, self.totals, self.logs = {}, {}, {}, {}

    @staticmethod
    def _rows(logs: Mapping[str, Any]) -> dict[str, KeptRows]:
        return {
            log: KeptRows(item["made_of"], item["rows"], FleetRun.model_validate(item["outline"]))
            for log, item in logs.items()
        }

    def hash_of(self, path: Path) -> str:
        """Return the hash of a document; empty where there is none."""
        try:
            return self._hashes.of(path)
        except OSError:
            return ""

    def key_of(self, kind: type[D], path: Path) -> str | None:
        """Return the key of a document; None where it is not there, or not whole."""
        document_hash = self.hash_of(path)
        if document_hash not in self._keys:
            try:
                self.read(kind, path)
            except (OSError, ValueError):
                return None
        key = self._used[document_hash] = self._keys[document_hash]
        return key

    def read(self, kind: type[D], path: Path) -> D:
        """Return a document, and remember its key."""
        document_bytes = path.read_bytes()
        document = kind.model_validate_json(document_bytes)
        document_hash = hash_bytes(document_bytes)
        self._used[document_hash] = self._keys[document_hash] = document.key
        return document

    def save(
        self, tables: Mapping[str, str], totals: Mapping[str, int], logs: Mapping[str, KeptRows]
    ) -> None:
        """Write hashes and lengths of the tables of this call, and rows by log."""
        after = {
            "auvid": self._code,
            "keys": self._used,
            "tables": dict(tables),
            "totals": dict(totals),
            "logs": {
                log: {
                    "made_of": item.made_of,
                    "rows": dict(item.rows),
                    "outline": item.outline.model_dump(),
                }
                for log, item in logs.items()
            },
        }
        if after != self._before:
            write_atomically(self._file, json.dumps(after).encode())


class GrowingTables:
    """The tables of a fleet, which take its logs one after another.

    Rows become Arrow as they come: as Python objects those of a thousand dives would take
    gigabytes. Rows of a log of which nothing has changed are those of the last call.
    """

    def __init__(self, fleet: FleetFolder, memory: FleetMemory) -> None:
        self._fleet, self._memory = fleet, memory
        self._lines: dict[str, Rows] = {name: [] for name in TABLES}
        # Tables, and rows of those of the last call.
        self._parts: dict[str, list[pa.Table | range]] = {name: [] for name in TABLES}
        self._totals: Counter[str] = Counter()
        self._logs: dict[str, KeptRows] = {}

    def take(self, log: str, made_of: str) -> FleetRun | None:
        """Add the rows of a log as they were, and return the outline of its result.

        None, and nothing is added, where they were not `made_of` the same.
        """
        kept = self._memory.logs.get(log)
        if kept is None or kept.made_of != made_of:
            return None
        for name, (first, count) in kept.rows.items():
            if self._lines[name]:
                self._to_arrow(name)
            parts = self._parts[name]
            if parts and isinstance(parts[-1], range) and parts[-1].stop == first:
                first = parts.pop().start
            parts.append(range(first, kept.rows[name][0] + count))
        counts = {name: count for name, (_, count) in kept.rows.items()}
        self._note(log, made_of, counts, kept.outline)
        return kept.outline

    def add(self, row: FleetRow, made_of: str) -> None:
        """Add the rows of a log."""
        counts = {}
        for name, make in MAKERS.items():
            lines = make(row)
            counts[name] = len(lines)
            self._lines[name] += lines
            if len(self._lines[name]) >= MOST_LINES:
                self._to_arrow(name)
        self._note(row.log, made_of, counts, row.outline.result)

    def _note(self, log: str, made_of: str, counts: Mapping[str, int], outline: FleetRun) -> None:
        rows = {name: [self._totals[name], count] for name, count in counts.items()}
        self._logs[log] = KeptRows(made_of, rows, outline)
        self._totals.update(counts)

    def write(self) -> None:
        """Write the tables that changed, and what the next call may take of them."""
        hashes = {}
        for name, parts in self._parts.items():
            path, memory = self._fleet.table(name), self._memory
            if memory.logs and parts == [range(memory.totals[name])] and not self._lines[name]:
                hashes[name] = memory.hash_of(path)
                continue
            self._to_arrow(name)
            ranges = any(isinstance(part, range) for part in parts)
            earlier: Any = load(path, TABLES[name]) if ranges else None
            tables = [
                earlier.slice(part.start, len(part)) if isinstance(part, range) else part
                for part in parts
            ]
            # The schema of a table that was read lacks some of one that is made: such goes first.
            table = pa.concat_tables([tables[-1].slice(0, 0), *tables])
            table_bytes = encode(table, TABLES[name], file=name)
            write_atomically(path, table_bytes)
            hashes[name] = hash_bytes(table_bytes)
        self._memory.save(hashes, self._totals, self._logs)

    def _to_arrow(self, name: str) -> None:
        lines, columns = self._lines[name], schema(TABLES[name]).columns
        cells = {key: [line[key] for line in lines] for key in columns}
        self._parts[name].append(make_table(TABLES[name], cells))
        self._lines[name] = []


def read_table(fleet: FleetFolder, name: str, columns: Sequence[str] = ()) -> pa.Table:
    """Return a table of a fleet, or some columns of it.

    Raises `UsageError` for a name that there is not.
    """
    if name not in TABLES:
        raise UsageError(
            "no such table of a fleet", value=name, allowed=TABLES, remedy=nearest(name, TABLES)
        )
    table: pa.Table = load(fleet.table(name), TABLES[name], columns=columns)
    return table


def _head(row: FleetRow) -> dict[str, Any]:
    return {
        "log": row.log,
        "vehicle": row.survey.vehicle,
        "start_utc": row.survey.start_utc,
    }


def _run_rows(row: FleetRow) -> Rows:
    survey, result = row.survey, row.result
    own = {item.axis: item for item in result.verdicts if item.recommended}
    every = own.get(ALL)
    severities = [item.severity for item in survey.findings]
    by_axis: dict[str, Any] = {}
    for axis, word in AXIS_WORDS.items():
        part = own.get(axis)
        by_axis |= {
            word: "" if part is None else part.damping,
            f"ratio_{word}": _ratio(part),
            f"use_{word}": "" if part is None else part.use,
            f"speed_{word}": result.speeds.get(VELOCITY_OF[axis]),
        }
    return [
        {
            **_head(row),
            "file": row.files[0],
            "files": len(row.files),
            "state": row.state,
            "reason": result.reason,
            "same_as": row.same_as,
            "kind": survey.kind,
            "format": ", ".join(survey.formats),
            "status": survey.status,
            "duration_s": survey.duration_s,
            "legs": survey.legs,
            "legs_s": survey.legs_s,
            "errors": severities.count("error"),
            "warnings": severities.count("warning"),
            "model": result.model,
            "ratio": _ratio(every),
            "identified": 0 if every is None else every.identified,
            "coefficients": 0 if every is None else every.coefficients,
            **by_axis,
            "firmware": survey.conditions.get("firmware", ""),
            "board": survey.conditions.get("board", ""),
            "battery_v": survey.conditions.get("battery_v"),
            "mean_depth_m": survey.conditions.get("mean_depth_m"),
            "headline": result.headline,
            "report": result.report,
            "recording": result.recording,
        }
    ]


def _ratio(verdict: FleetVerdict | None) -> float | None:
    """Return J/J0 on the validation legs, else on the training legs."""
    if verdict is None:
        return None
    return verdict.training if verdict.validation is None else verdict.validation


def _finding_rows(row: FleetRow) -> Rows:
    if row.same_as:
        return []
    return [
        {
            **_head(row),
            "finding": item.id,
            "severity": item.severity,
            "stops": checks()[item.id].stops,
            "stream": item.stream or "",
            "value": item.value,
            "threshold": item.threshold,
            "unit": item.unit,
            "text": item.text,
            "remedy": item.remedy,
        }
        for item in row.survey.findings
    ]


def _verdict_rows(row: FleetRow) -> Rows:
    return [{**_head(row), **vars(item)} for item in row.result.verdicts]


def _coefficient_rows(row: FleetRow) -> Rows:
    rows = []
    for item in row.result.coefficients:
        value, error = item.value, item.standard_error
        half = None if error is None or value is None else NORMAL_95 * error
        interval = {
            "low": None if half is None or value is None else value - half,
            "high": None if half is None or value is None else value + half,
        }
        rows.append({**_head(row), "kind": row.survey.kind, **vars(item), **interval})
    return rows


MAKERS: Mapping[str, Callable[[FleetRow], Rows]] = {
    "runs": _run_rows,
    "findings": _finding_rows,
    "verdicts": _verdict_rows,
    "coefficients": _coefficient_rows,
}
"""Table -> its rows of one log."""


def finite(value: float | None) -> bool:
    """Return whether a cell holds a number."""
    return value is not None and math.isfinite(value)
