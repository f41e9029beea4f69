"""A drafted column map, as a document and as text that says what to check."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from auvid.data_schemas.streams import STREAMS
from auvid.stages.ingest.formats.csv.column_proposal import ahead_words, quoted

NO_NAME = "no name tells this"
NAMED = 12
TWO_CLOCKS = "a clock of its own"
"""Check of a time whose zero nothing relates to that of the other files."""


@dataclass(frozen=True)
class DraftColumn:
    """A column of the draft; `check`: what of it was assumed, in words."""

    column: str
    stream: str
    field: str
    unit: str
    sign: int = 1
    frame: str = ""
    check: str = ""


@dataclass(frozen=True)
class ColumnDraft:
    """A drafted column map of a file."""

    file: str
    time: Mapping[str, str]
    time_check: str
    columns: tuple[DraftColumn, ...]
    delimiter: str = ","
    decimal: str = "."
    accelerometer: str = ""
    repeating: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    ahead: tuple[str, ...] = ()
    """Of `unused`, speeds through the water ahead."""
    remarks: tuple[str, ...] = field(default_factory=tuple)
    span_s: tuple[float, float] = (0.0, 0.0)
    """First and last time of the file."""
    position_noise: tuple[float, ...] = ()
    """Median change of slope of each of its positions from row to row, in their units."""
    commands_show: str = ""
    """Axes of its pose that commands show: frd, flu, or '' where they show none."""

    @property
    def command_unit(self) -> str:
        """Return the unit that its commands show, '' where there are none."""
        units = {item.unit for item in self.columns if item.field.startswith("command_")}
        return next((unit for unit in ("percent", "us") if unit in units), "1" if units else "")

    @property
    def matched(self) -> dict[str, str]:
        """Return columns of commands that no name tells, by axis, with their sign."""
        return {
            item.field.removeprefix("command_"): f"{'-' if item.sign < 0 else ''}{item.column}"
            for item in self.columns
            if item.check.startswith(NO_NAME)
        }

    @property
    def streams(self) -> tuple[str, ...]:
        """Return the streams that the draft fills."""
        there = {item.stream for item in self.columns}
        return tuple(name for name in STREAMS if name in there)

    def without(self, *streams: str) -> ColumnDraft:
        """Return the draft without these streams."""
        kept = tuple(item for item in self.columns if item.stream not in streams)
        gone = tuple(item.column for item in self.columns if item.stream in streams)
        repeating = tuple(name for name in self.repeating if name not in streams)
        accelerometer = "" if "imu" in streams else self.accelerometer
        return replace(
            self,
            columns=kept,
            repeating=repeating,
            accelerometer=accelerometer,
            unused=(*self.unused, *gone),
        )

    def on_clock_of(self, other: ColumnDraft) -> ColumnDraft:
        """Return the draft with its times moved to begin when another file does."""
        later_s = other.span_s[0] - self.span_s[0]
        moved = replace(self, time={**self.time, "epoch": other.time["epoch"]})
        return moved.shifted(later_s, f"{TWO_CLOCKS}: as if it began with {other.file}")

    def shifted(self, later_s: float, why: str) -> ColumnDraft:
        """Return the draft with its times moved, and in words why."""
        shift_s = float(self.time.get("shift_s", 0.0)) + later_s
        start, end = (time + later_s for time in self.span_s)
        return replace(
            self,
            time={**self.time, "shift_s": f"{shift_s:.3f}"},
            time_check=why,
            span_s=(start, end),
        )

    def document(self) -> dict[str, Any]:
        """Return the draft as the document of a column map."""
        columns = []
        for item in self.columns:
            entry: dict[str, Any] = {
                "column": item.column,
                "stream": item.stream,
                "field": item.field,
                "unit": item.unit,
            }
            entry |= {"sign": -1} if item.sign < 0 else {}
            entry |= {"frame": item.frame} if item.frame else {}
            columns.append(entry)
        time = {key: float(text) if key == "shift_s" else text for key, text in self.time.items()}
        document: dict[str, Any] = {"time": time}
        document |= {"delimiter": self.delimiter} if self.delimiter != "," else {}
        document |= {"decimal": self.decimal} if self.decimal != "." else {}
        document |= {"accelerometer": self.accelerometer} if self.accelerometer else {}
        document |= {"held": list(self.repeating)} if self.repeating else {}
        return document | {"columns": columns}

    def text(self) -> str:
        """Return the draft as YAML, with what to check beside each line."""
        lines = [
            "# What the columns are. Body axes forward, right, down; angles of roll, pitch, yaw."
        ]
        lines += [f"# check: {remark}" for remark in (*self.remarks, *ahead_words(self.ahead))]
        time = ", ".join(
            f"{key}: {value if key == 'shift_s' else quoted(value)}"
            for key, value in self.time.items()
        )
        lines.append(_checked(f"time: {{{time}}}", self.time_check))
        if self.delimiter != ",":
            lines.append(f"delimiter: {json.dumps(self.delimiter)}")
        if self.decimal != ".":
            lines.append(f"decimal: {json.dumps(self.decimal)}")
        if self.accelerometer:
            lines.append(
                _checked(
                    f"accelerometer: {self.accelerometer}",
                    "by its size at rest; specific_force holds gravity, inertial does not",
                )
            )
        if self.repeating:
            lines.append(
                _checked(
                    f"held: [{', '.join(self.repeating)}]",
                    "most rows repeat the last value; only new values count",
                )
            )
        lines.append("columns:")
        for item in self.columns:
            entry = (
                f"column: {quoted(item.column)}, stream: {item.stream}, field: {item.field},"
                f" unit: {quoted(item.unit)}"
            )
            entry += ", sign: -1" if item.sign < 0 else ""
            entry += f", frame: {item.frame}" if item.frame else ""
            lines.append(_checked(f"  - {{{entry}}}", item.check))
        if self.unused:
            more = f" and {len(self.unused) - NAMED} more" if len(self.unused) > NAMED else ""
            lines.append(f"# not used: {', '.join(map(quoted, self.unused[:NAMED]))}{more}")
        return "\n".join(lines) + "\n"


def _checked(line: str, check: str) -> str:
    return f"{line}  # check: {check}" if check else line
