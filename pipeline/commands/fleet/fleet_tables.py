"""The tables of a fleet: runs, findings, verdicts and coefficients, as Parquet."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

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
from auvid.stages.page.first_screen import ALL, AXIS_WORDS

Rows = list[dict[str, Any]]
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


class GrowingTables:
    """The tables of a fleet, which take its logs one after another.

    Rows become Arrow as they come: as Python objects those of a thousand dives would take
    gigabytes.
    """

    def __init__(self) -> None:
        self._lines: dict[str, Rows] = {name: [] for name in TABLES}
        self._parts: dict[str, list[pa.Table]] = {name: [] for name in TABLES}

    def add(self, row: FleetRow) -> None:
        """Add the rows of a log."""
        for name, make in MAKERS.items():
            self._lines[name] += make(row)
            if len(self._lines[name]) >= MOST_LINES:
                self._to_arrow(name)

    def write(self, fleet: FleetFolder) -> None:
        """Write the four tables of a fleet."""
        for name, parts in self._parts.items():
            self._to_arrow(name)
            table = pa.concat_tables(parts)
            write_atomically(fleet.table(name), encode(table, TABLES[name], file=name))

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
