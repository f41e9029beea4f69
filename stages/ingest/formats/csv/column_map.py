"""Column map of a CSV log, checked against the header, as factors to stream fields."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.data_schemas.records.logs import Accelerometer
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import NEEDED, STREAMS, csv_dialects
from auvid.data_schemas.units import NEUTRAL_US, convertible, factor_and_offset
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.stages.ingest.formats.csv.clock_digits import CLOCK_DIGITS
from auvid.stages.ingest.formats.csv.pose_columns import (
    EXTRA_FIELDS,
    lacking_fields,
    turned_together,
)

MICROSECONDS = "us"
TEXT_TIMES = ("iso8601", "time_of_day")
"""Times that are text: with a date, or 12:30:05.2 of one day (and the next)."""
DEFAULT_MISSING = (
    "",
    "NaN",
    "nan",
    "-nan",
    "NAN",
    "NA",
    "N/A",
    "n/a",
    "#N/A",
    "null",
    "NULL",
    "None",
)
OTHER_NAMES: Mapping[str, tuple[str, ...]] = {
    "roll": ("phi_rad", "gyro_x_rad_s"),
    "pitch": ("theta_rad", "gyro_y_rad_s"),
    "yaw": ("psi_rad", "gyro_z_rad_s"),
    "heading": ("psi_rad",),
    "surge": ("u_m_s",),
    "sway": ("v_m_s",),
    "heave": ("w_m_s",),
    "p": ("gyro_x_rad_s",),
    "q": ("gyro_y_rad_s",),
    "r": ("gyro_z_rad_s",),
}
"""Fields by what users call their axis."""
NORMALISED: Mapping[str, float] = {"1": 400.0, "percent": 4.0}
"""Units of a normalised output, and microseconds of one: full thrust is 1100 or 1900 us."""
WEIGHT_OF_WATER = 1025.0 * STANDARD_GRAVITY
"""Sea water, N/m^3: a pressure as the depth of so much water, zero where the sensor has it."""
HALF_TURN = 3.141592653589793 / 2

# Factor and offset (in SI) that turn a field of another frame into FRD and NED. Fields
# that are not named keep their sign.
FLIPPED_FLU = (
    *("v_m_s", "w_m_s", "gyro_y_rad_s", "gyro_z_rad_s", "accel_y_m_s2", "accel_z_m_s2"),
    *("theta_rad", "psi_rad", "y_m", "z_m", "depth_m"),
    *("command_sway", "command_heave", "command_pitch", "command_yaw"),
)
BODY = ("u_m_s", "v_m_s", "w_m_s", "gyro", "accel", "command")
FRAMES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "frd": {},
    "ned": {},
    "flu": dict.fromkeys(FLIPPED_FLU, (-1.0, 0.0)),
    # Roll, pitch and yaw of a forward-left-up body against east-north-up; a position's
    # field already names the axis that it feeds.
    "enu": {
        "theta_rad": (-1.0, 0.0),
        "psi_rad": (-1.0, HALF_TURN),
        "z_m": (-1.0, 0.0),
        "depth_m": (-1.0, 0.0),
    },
    "y_up": dict.fromkeys(("psi_rad", "z_m", "depth_m"), (-1.0, 0.0)),
}
OF_WORLD = ("enu", "y_up")
"""Frames that only a place and an attitude have."""


@dataclass(frozen=True)
class MappedColumn:
    """One column of the file: field in SI = factor * value in the file + offset.

    `dtype` is that of the field; `frame` that of a field which is turned with others.
    """

    column: str
    stream: str
    field: str
    factor: float
    offset: float
    dtype: str
    frame: str = ""


@dataclass(frozen=True)
class ColumnMap:
    """A checked column map.

    `time_factor` turns the time column into microseconds; None for ISO 8601 text. `clock`:
    once its digits (hhmmss) are seconds.
    """

    time: str
    time_factor: float | None
    epoch: str
    start: float | str | None
    columns: tuple[MappedColumn, ...]
    repeating: frozenset[str]
    missing: tuple[str, ...]
    accelerometer: Accelerometer | None
    shift_us: float = 0.0
    clock: bool = False
    nanoseconds: str | None = None

    @property
    def of_time(self) -> tuple[str, ...]:
        """Return the columns of the time."""
        return (self.time, *([self.nanoseconds] if self.nanoseconds else []))


def dialect_map(header: Sequence[str]) -> tuple[Mapping[str, Any], str] | None:
    """Return the column map of a program whose CSV files have this header, and a note.

    None for a header that no known program writes.
    """
    for dialect in csv_dialects().values():
        if set(dialect["recognise"]) <= set(header):
            present = [entry for entry in dialect["map"]["columns"] if entry["column"] in header]
            fields = {(entry["stream"], entry["field"]) for entry in present}
            columns = [
                entry
                for entry in present
                if all((entry["stream"], name) in fields for name in NEEDED[entry["stream"]])
            ]
            note = f"read as a log of {dialect['title']}: {dialect['note']}"
            return {**dialect["map"], "columns": columns}, note
    return None


def late_columns(header: Sequence[str]) -> tuple[int, tuple[str, ...]] | None:
    """Return place and names of columns that rows may have beyond this header.

    None where the header has them, or no known program writes it.
    """
    for dialect in csv_dialects().values():
        late = dialect.get("late")
        if late and {*dialect["recognise"], late["before"]} <= set(header):
            names = tuple(late["columns"])
            if not set(names) & set(header):
                return list(header).index(late["before"]), names
    return None


@dataclass
class MapFaults:
    """The faults of one column map, raised together."""

    where: str
    faults: list[PipelineError] = field(default_factory=list)

    def add(self, message: str, **details: Any) -> None:
        """Add a fault with field, value, allowed, remedy."""
        self.faults.append(CampaignError(message, file=self.where, **details))


def column_map(raw: Mapping[str, Any], header: Sequence[str], *, file: str) -> ColumnMap:
    """Return the column map of a file with this header.

    Raises all faults together: unknown column, stream, field, unit, frame.
    """
    where = f"column map of {file}"
    check_document(raw, "column_map", file=where)
    faults = MapFaults(where)
    entries = enumerate(raw["columns"])
    mapped = [_mapped(entry, f"columns[{index}]", header, faults) for index, entry in entries]
    columns = tuple(item for item in mapped if item is not None)
    time = raw["time"]
    time_factor = _time_factor(time, header, faults)
    _check_twice(raw["columns"], faults)
    if not faults.faults:
        _check_needed(columns, faults)
    if not faults.faults:
        for name in raw.get("held", ()):
            if name not in {item.stream for item in columns}:
                faults.add("no column is mapped to this stream", field="held", value=name)
    if "accelerometer" not in raw and any(item.field.startswith("accel_") for item in columns):
        faults.add(
            "missing key",
            field="accelerometer",
            allowed=("specific_force", "inertial", "derivative"),
            remedy=(
                "Say what the accelerometer columns measure: gravity and motion, motion only, or"
                " the rate of change of body velocity."
            ),
        )
    raise_faults(faults.faults, file=where)
    return ColumnMap(
        time=time["column"],
        time_factor=time_factor,
        epoch=time.get("epoch", "boot"),
        start=time.get("start"),
        columns=columns,
        repeating=frozenset(raw.get("held", ())),
        missing=tuple(dict.fromkeys((*DEFAULT_MISSING, *raw.get("missing", ())))),
        accelerometer=raw.get("accelerometer"),
        shift_us=1e6 * float(time.get("shift_s", 0.0)),
        clock=time["unit"] == CLOCK_DIGITS,
        nanoseconds=time.get("nanoseconds"),
    )


def _mapped(
    entry: Mapping[str, Any], path: str, header: Sequence[str], faults: MapFaults
) -> MappedColumn | None:
    before = len(faults.faults)
    column, stream, name = entry["column"], entry["stream"], entry["field"]
    _check_header(column, header, f"{path}.column", faults)
    if stream not in STREAMS:
        faults.add(
            "unknown stream",
            field=f"{path}.stream",
            value=stream,
            allowed=STREAMS,
            remedy=nearest(stream, STREAMS),
        )
        return None
    fields = {
        key: (spec.dtype, spec.unit)
        for key, spec in schema(stream).columns.items()
        if key != "time_us"
    }
    extra = EXTRA_FIELDS.get(stream, {})
    fields |= {key: ("float64", unit) for key, unit in extra.items()}
    if name not in fields:
        faults.add(
            f"unknown field of stream '{stream}'",
            field=f"{path}.field",
            value=name,
            allowed=fields if len(fields) <= 8 else [*list(fields)[:8], "..."],
            remedy=_by_other_name(name, fields) or nearest(name, fields),
        )
        return None
    frame = entry.get("frame")
    if frame in OF_WORLD and name.startswith(BODY):
        faults.add(
            "is a body axis",
            field=f"{path}.frame",
            value=frame,
            allowed=("frd", "flu"),
            remedy=f"{name} is along the body.",
        )
    dtype, unit = fields[name]
    factor, offset = 1.0, 0.0
    if name.startswith("pwm_") and entry["unit"] in NORMALISED:
        factor, offset = NORMALISED[entry["unit"]], NEUTRAL_US
    elif name.startswith("command_") and entry["unit"] == MICROSECONDS:
        factor, offset = 1.0 / NORMALISED["1"], -NEUTRAL_US / NORMALISED["1"]
    elif name == "depth_m" and convertible(entry["unit"], "Pa"):
        factor = factor_and_offset(entry["unit"], "Pa")[0] / WEIGHT_OF_WATER
    elif dtype not in ("string", "bool"):
        factor, offset = _unit(entry["unit"], unit, f"{path}.unit", faults)
    if len(faults.faults) > before:
        return None
    sign = float(entry.get("sign", 1))
    if turned_together(stream, name):
        return MappedColumn(column, stream, name, sign * factor, sign * offset, dtype, frame or "")
    turn, shift = FRAMES[frame or "frd"].get(name, (1.0, 0.0))
    factor, offset = sign * turn * factor, sign * (turn * offset + shift)
    return MappedColumn(column, stream, name, factor, offset, dtype)


def _by_other_name(name: str, fields: Iterable[str]) -> str | None:
    """Return the remedy for a field that is called by another name of its axis."""
    words = name.lower().split("_")
    fields_of_axis = [
        field for word in words for field in OTHER_NAMES.get(word, ()) if field in fields
    ]
    return f"Did you mean '{fields_of_axis[0]}'?" if fields_of_axis else None


def _check_header(column: str, header: Sequence[str], path: str, faults: MapFaults) -> None:
    count = list(header).count(column)
    if count == 0:
        remedy = nearest(column, header) or f"The file has: {', '.join(header)}."
        faults.add("the file has no such column", field=path, value=column, remedy=remedy)
    elif count > 1:
        faults.add(f"the file has {count} columns of this name", field=path, value=column)


def _unit(unit: str, target: str, path: str, faults: MapFaults) -> tuple[float, float]:
    text = re.sub(r"\brevs?\b", "revolution", unit)
    # pint counts a revolution as 2 pi, so that a speed in revolutions per second needs
    # a target with the same unit.
    goal = "revolution/s" if target == "1/s" and text not in ("1/s", "Hz", "hertz") else target
    if convertible(text, goal):
        return factor_and_offset(text, goal)
    gram = "pint reads 'g' as gram; write g0 for the standard acceleration of gravity."
    faults.add(
        "wrong unit",
        field=path,
        value=unit,
        allowed=f"a unit of {target} that pint knows",
        remedy=gram if unit in ("g", "G") else None,
    )
    return 1.0, 0.0


def _time_factor(time: Mapping[str, Any], header: Sequence[str], faults: MapFaults) -> float | None:
    _check_header(time["column"], header, "time.column", faults)
    if time.get("nanoseconds"):
        _check_header(time["nanoseconds"], header, "time.nanoseconds", faults)
        if time["unit"] != "s":
            faults.add(
                "nanoseconds stand within a second",
                field="time.unit",
                value=time["unit"],
                allowed="s, where time.nanoseconds names a column",
            )
    if time["unit"] in TEXT_TIMES:
        return None
    if time["unit"] == CLOCK_DIGITS:
        return 1e6
    if convertible(time["unit"], MICROSECONDS):
        return factor_and_offset(time["unit"], MICROSECONDS)[0]
    faults.add(
        "wrong unit",
        field="time.unit",
        value=time["unit"],
        allowed="a unit of time (s, ms, us, ns), iso8601, time_of_day or hhmmss",
    )
    return 1.0


def _check_twice(entries: Sequence[Mapping[str, Any]], faults: MapFaults) -> None:
    first: dict[tuple[str, str], str] = {}
    for entry in entries:
        stream, name, column = entry["stream"], entry["field"], entry["column"]
        if (stream, name) in first:
            value = f"{first[stream, name]}, {column}"
            faults.add(f"field {name} of stream {stream} is mapped twice", value=value)
        first.setdefault((stream, name), column)


def _check_needed(columns: Sequence[MappedColumn], faults: MapFaults) -> None:
    for stream in dict.fromkeys(item.stream for item in columns):
        mapped = {item.field for item in columns if item.stream == stream}
        missing = lacking_fields({(item.stream, item.field) for item in columns}, stream)
        frames = {item.frame for item in columns if item.stream == stream and item.frame}
        together = [
            item
            for item in columns
            if item.stream == stream and turned_together(stream, item.field)
        ]
        if len({item.frame for item in together}) > 1:
            faults.add(
                f"columns of stream '{stream}' are in several frames",
                field="columns",
                value=sorted(frames),
                remedy=f"Give all of {', '.join(item.field for item in together)} one frame.",
            )
        if missing:
            faults.add(
                f"stream '{stream}' is incomplete",
                field="columns",
                value=sorted(mapped),
                remedy=f"Map a column to {', '.join(missing)} too.",
            )
