"""A CSV column map checked against the header of its file, and turned into factors:
which column feeds which stream field, and how.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import NEEDED, STREAMS, csv_dialects
from auvid.data_schemas.units import convertible, factor_and_offset

MICROSECONDS = "us"
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
}


@dataclass(frozen=True)
class MappedColumn:
    """One column of the file: value of the field in SI = factor * value in the file +
    offset; `dtype` is that of the field.
    """

    column: str
    stream: str
    field: str
    factor: float
    offset: float
    dtype: str


@dataclass(frozen=True)
class ColumnMap:
    """A checked column map. `time_factor` turns the time column into microseconds; None
    for ISO 8601 text.
    """

    time: str
    time_factor: float | None
    epoch: str
    start: float | str | None
    columns: tuple[MappedColumn, ...]
    held: frozenset[str]
    missing: tuple[str, ...]
    accelerometer: str | None


def dialect_map(header: Sequence[str]) -> tuple[Mapping[str, Any], str] | None:
    """The column map of a program whose CSV files have this header, and a note; None
    for a header that no known program writes.
    """
    for dialect in csv_dialects().values():
        if set(dialect["recognise"]) <= set(header):
            present = [entry for entry in dialect["map"]["columns"] if entry["column"] in header]
            given = {(entry["stream"], entry["field"]) for entry in present}
            whole = {
                stream
                for stream, _ in given
                if all((stream, name) in given for name in NEEDED[stream])
            }
            columns = [entry for entry in present if entry["stream"] in whole]
            return {
                **dialect["map"],
                "columns": columns,
            }, f"read as a log of {dialect['title']}: {dialect['note']}"
    return None


def column_map(raw: Mapping[str, Any], header: Sequence[str], *, file: str) -> ColumnMap:
    """The column map of a file with this header. Raises all faults together: unknown
    column, stream, field, unit, frame.
    """
    where = f"column map of {file}"
    check_document(raw, "column_map", file=where)
    faults: list[PipelineError] = []
    columns = [
        item
        for index, entry in enumerate(raw["columns"])
        if (item := _mapped(entry, index, header, where, faults))
    ]
    time = raw["time"]
    time_factor = _time_factor(time, header, where, faults)
    _check_twice(raw["columns"], where, faults)
    if not faults:
        _check_needed(columns, where, faults)
    for name in raw.get("held", ()):
        if name not in {item.stream for item in columns} and not faults:
            faults.append(
                CampaignError(
                    "no column is mapped to this stream", file=where, field="held", value=name
                )
            )
    if "accelerometer" not in raw and any(item.field.startswith("accel_") for item in columns):
        remedy = (
            "Say what the accelerometer columns measure: gravity and motion, motion only, or the"
            " rate of change of body velocity."
        )
        faults.append(
            CampaignError(
                "missing key",
                file=where,
                field="accelerometer",
                allowed=("specific_force", "inertial", "derivative"),
                remedy=remedy,
            )
        )
    raise_faults(faults, file=where)
    return ColumnMap(
        time=time["column"],
        time_factor=time_factor,
        epoch=time.get("epoch", "boot"),
        start=time.get("start"),
        columns=tuple(columns),
        held=frozenset(raw.get("held", ())),
        missing=tuple(dict.fromkeys((*DEFAULT_MISSING, *raw.get("missing", ())))),
        accelerometer=raw.get("accelerometer"),
    )


def _mapped(
    entry: Mapping[str, Any],
    index: int,
    header: Sequence[str],
    where: str,
    faults: list[PipelineError],
) -> MappedColumn | None:
    path = f"columns[{index}]"
    before = len(faults)
    column, stream, name = entry["column"], entry["stream"], entry["field"]
    _check_header(column, header, f"{path}.column", where, faults)
    if stream not in STREAMS:
        remedy = nearest(stream, STREAMS)
        faults.append(
            CampaignError(
                "unknown stream",
                file=where,
                field=f"{path}.stream",
                value=stream,
                allowed=STREAMS,
                remedy=remedy,
            )
        )
        return None
    fields = {key: spec for key, spec in schema(stream).columns.items() if key != "time_us"}
    if name not in fields:
        remedy = nearest(name, fields)
        allowed = fields if len(fields) <= 8 else [*list(fields)[:8], "..."]
        faults.append(
            CampaignError(
                f"unknown field of stream '{stream}'",
                file=where,
                field=f"{path}.field",
                value=name,
                allowed=allowed,
                remedy=remedy,
            )
        )
        return None
    frame = entry.get("frame")
    if frame == "enu" and name.startswith(BODY):
        faults.append(
            CampaignError(
                "is a body axis",
                file=where,
                field=f"{path}.frame",
                value=frame,
                allowed=("frd", "flu"),
                remedy=f"{name} is along the body.",
            )
        )
    spec = fields[name]
    factor, offset = (
        (1.0, 0.0)
        if spec.dtype in ("string", "bool")
        else _unit(entry["unit"], spec.unit, path, where, faults)
    )
    if len(faults) > before:
        return None
    turn, shift = FRAMES[frame or "frd"].get(name, (1.0, 0.0))
    sign = float(entry.get("sign", 1))
    return MappedColumn(
        column, stream, name, sign * turn * factor, sign * (turn * offset + shift), spec.dtype
    )


def _check_header(
    column: str, header: Sequence[str], path: str, where: str, faults: list[PipelineError]
) -> None:
    count = list(header).count(column)
    if count == 0:
        remedy = nearest(column, header) or f"The file has: {', '.join(header)}."
        faults.append(
            CampaignError(
                "the file has no such column", file=where, field=path, value=column, remedy=remedy
            )
        )
    elif count > 1:
        faults.append(
            CampaignError(
                f"the file has {count} columns of this name", file=where, field=path, value=column
            )
        )


def _unit(
    unit: str, target: str, path: str, where: str, faults: list[PipelineError]
) -> tuple[float, float]:
    text = re.sub(r"\brevs?\b", "revolution", unit)
    # pint counts a revolution as 2 pi, so that a speed in revolutions per second needs
    # a target that says so.
    goal = "revolution/s" if target == "1/s" and text not in ("1/s", "Hz", "hertz") else target
    if convertible(text, goal):
        return factor_and_offset(text, goal)
    remedy = (
        "pint reads 'g' as gram; write g0 for the standard acceleration of gravity."
        if unit in ("g", "G")
        else None
    )
    faults.append(
        CampaignError(
            "wrong unit",
            file=where,
            field=f"{path}.unit",
            value=unit,
            allowed=f"a unit of {target} that pint knows",
            remedy=remedy,
        )
    )
    return 1.0, 0.0


def _time_factor(
    time: Mapping[str, Any], header: Sequence[str], where: str, faults: list[PipelineError]
) -> float | None:
    _check_header(time["column"], header, "time.column", where, faults)
    if time["unit"] == "iso8601":
        return None
    if not convertible(time["unit"], MICROSECONDS):
        faults.append(
            CampaignError(
                "wrong unit",
                file=where,
                field="time.unit",
                value=time["unit"],
                allowed="a unit of time (s, ms, us, ns) or iso8601",
            )
        )
        return 1.0
    return factor_and_offset(time["unit"], MICROSECONDS)[0]


def _check_twice(
    entries: Sequence[Mapping[str, Any]], where: str, faults: list[PipelineError]
) -> None:
    seen: dict[tuple[str, str], str] = {}
    for entry in entries:
        key = (entry["stream"], entry["field"])
        if key in seen:
            faults.append(
                CampaignError(
                    f"field {key[1]} of stream {key[0]} is mapped twice",
                    file=where,
                    value=f"{seen[key]}, {entry['column']}",
                )
            )
        seen.setdefault(key, entry["column"])


def _check_needed(columns: Sequence[MappedColumn], where: str, faults: list[PipelineError]) -> None:
    for stream in dict.fromkeys(item.stream for item in columns):
        given = {item.field for item in columns if item.stream == stream}
        lacking = [name for name in NEEDED[stream] if name not in given]
        if lacking:
            faults.append(
                CampaignError(
                    f"stream '{stream}' is incomplete",
                    file=where,
                    field="columns",
                    value=sorted(given),
                    remedy=f"Map a column to {', '.join(lacking)} too.",
                )
            )
