"""A column map drafted from the header and the values of a CSV file.

What the name of a column does not say is taken from its values, or assumed, and then
the draft says so.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.streams import STREAMS
from auvid.hydro.arrays import Array
from auvid.stages.base import RawFile
from auvid.stages.columns import POSITION
from auvid.stages.ingest.formats.csv.clock_digits import (
    CLOCK_DIGITS,
    clock_seconds,
    counts_like_a_clock,
)
from auvid.stages.ingest.formats.csv.column_map import TEXT_TIMES
from auvid.stages.ingest.formats.csv.column_names import (
    QUATERNION,
    TIME,
    NamedColumn,
    named_columns,
)
from auvid.stages.ingest.formats.csv.column_proposal import quoted
from auvid.stages.ingest.formats.csv.draft.answered_commands import answered_commands
from auvid.stages.ingest.formats.csv.draft.pose_draft import (
    TURNED_AXES,
    in_upward_axes,
    is_turned,
    pose_unit,
    pose_velocities,
    with_pose,
)
from auvid.stages.ingest.formats.csv.pose_columns import lacking_fields
from auvid.stages.ingest.formats.csv.reader import TIME_OF_DAY, header, iso_microseconds

MOST_BYTES = 1 << 24
"""Values of the first so many bytes decide on units."""
FULL_TURN = 6.4
"""An angle beyond it [rad] is in degrees."""
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Length of a unit of time [s]."""
UNIX_TIMES = ((9e17, "ns"), (9e14, "us"), (9e11, "ms"), (9e8, "s"))
"""Unix time of this century in the unit is beyond this number."""
POSSIBLE_STEPS = (5e-4, 10.0)
"""Steps [s] between rows of a log."""
PULSES = (800.0, 2200.0)
FEWEST_OUTPUTS = 3
NEAR_ONE, NEAR_GRAVITY = (0.8, 1.2), (8.5, 11.0)
"""Median length of an accelerometer at rest in g and in m/s^2."""
FASTEST_M_S, FASTEST_CM_S = 15.0, 300.0
"""Larger velocities (99th percentile) are in cm/s, and beyond that in mm/s."""
FASTEST_RAD_S = 8.0
"""Larger rates (99th percentile) are in deg/s."""
HELD_SHARE = 0.5
PRESSURES = ("mbar", "dbar", "bar", "kPa", "Pa")
WORLD_OR_BODY = re.compile(r"[xyz]$")
"""End of a velocity's name that may as well be of world axes."""
FROM_ABOVE = "up"
"""Mark of a height that is negative under water."""
MATCHED, MATCHED_REVERSED = "matched", "matched reversed"
"""Marks of commands that were matched to the axis that answers them."""
NAMED_COMMAND, NAMED_REVERSED = "named", "named reversed"
"""Marks of commands whose axis the user names."""
REVERSED = (FROM_ABOVE, MATCHED_REVERSED, NAMED_REVERSED)
NO_NAME = "no name tells this"
BETWEEN_RUNS_S = 10.0
"""Runs with the same columns are looked at one behind the other with such a pause."""
SPOKEN = {"phi_rad": "roll", "theta_rad": "pitch", "psi_rad": "yaw"}
COMMANDS = re.compile(r"^(?:cmd|command|u|tau|ctrl|control|input|joy|axis|demand) ?\d+$")
LARGEST_COMMAND = 1.5
GLIDER_UNITS = {
    "pressure_pa": ("dbar", "Pa", 12e3),
    "pitch_rad": ("rad", "deg", 1.6),
    "buoyancy_drive_m3": ("m^3", "cm^3", 0.02),
    "density_kg_m3": ("g/cm^3", "kg/m^3", 2.0),
    "temperature_K": ("degC", "K", 200.0),
    "speed_m_s": ("m/s", "cm/s", 5.0),
}
"""Field of a glider -> unit, and the one of values beyond a limit."""
AXIS_NAMES = dict(zip("uvwpqr", ("surge", "sway", "heave", "roll", "pitch", "yaw"), strict=True))
NAMED = 12


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
    remarks: tuple[str, ...] = field(default_factory=tuple)
    span_s: tuple[float, float] = (0.0, 0.0)
    """First and last time of the file."""

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
        """The streams that the draft fills."""
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
        document: dict[str, Any] = {"time": dict(self.time)}
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
        lines += [f"# check: {remark}" for remark in self.remarks]
        time = ", ".join(f"{key}: {quoted(value)}" for key, value in self.time.items())
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


def draft_columns(
    file: RawFile, *runs: RawFile, commands: Mapping[str, str] | None = None
) -> ColumnDraft:
    """Return a column map drafted from a file's names and values.

    runs: further files with the same columns, for one map together. commands: axis
    (surge, sway ..., with a minus where the column is reversed) of each column that is a
    command. Raises `LogError` where the first line names no columns, or no column is the
    time.
    """
    head = header(file, None)
    texts, decimal = _cells(file, head.names, head.delimiter, head.encoding)
    if head.names and all(_is_number(name) for name in head.names if name.strip()):
        raise LogError(
            "the first line holds numbers, no names of columns",
            file=file.name,
            row=1,
            value=", ".join(head.names[:4]),
            remedy="Put a line with the names of the columns above it: time_s,depth_m,...",
        )
    values = {name: _numbers(cells, decimal) for name, cells in texts.items()}
    columns = [item for item in named_columns(head.names) if item.name in texts]
    time, time_check = _time(columns, values, texts, file.name)
    rest = [item for item in columns if item.name != time["column"]]
    rest = _with_pulses(with_pose(rest), values)
    t_s = _seconds(time, values[time["column"]], texts[time["column"]])
    draft = ColumnDraft(file.name, time, time_check, (), head.delimiter, decimal)
    finite = t_s[np.isfinite(t_s)]
    draft = replace(draft, span_s=(float(finite[0]), float(finite[-1])))
    for run in runs:
        more, _ = _cells(run, head.names, head.delimiter, head.encoding)
        own = {name: _numbers(cells, decimal) for name, cells in more.items()}
        later = _seconds(time, own[time["column"]], more[time["column"]])
        t_s = np.append(t_s, later - np.nanmin(later) + np.nanmax(t_s) + BETWEEN_RUNS_S)
        values = {name: np.append(values[name], own[name]) for name in values}
    named = dict(commands or {})
    rest = [_as_command(item, named[item.name]) if item.name in named else item for item in rest]
    if named:
        rest = [item if item.name in named else _without_guess(item) for item in rest]
    velocities = pose_velocities(rest, values, t_s)
    if not named:
        rest = _with_commands(rest, values, t_s, velocities)
    return _with_columns(draft, _in_frame(rest, values, t_s, velocities), values)


def _in_frame(
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
    t_s: Array,
    velocities: Mapping[str, Array],
) -> list[NamedColumn]:
    """Return the columns with the pose turned to z up where commands show that."""
    axes = {f"command_{name}": axis for axis, name in AXIS_NAMES.items()}
    by_axis = {
        axes[item.place[1]]: values[item.name] * (-1.0 if item.frame == NAMED_REVERSED else 1.0)
        for item in columns
        if item.place is not None and item.place[1] in axes
    }
    if not velocities or not is_turned(by_axis, velocities, t_s):
        return list(columns)
    # Matched commands are reversed because the frame is.
    turned = {f"command_{AXIS_NAMES[axis]}" for axis in TURNED_AXES}
    return [
        replace(item, frame=MATCHED)
        if item.frame == MATCHED_REVERSED and item.place and item.place[1] in turned
        else item
        for item in in_upward_axes(columns)
    ]


def _as_command(item: NamedColumn, axis: str) -> NamedColumn:
    """Return a column as the command of an axis that the user named."""
    mark = NAMED_REVERSED if axis.startswith("-") else NAMED_COMMAND
    return replace(item, place=("actuators", f"command_{axis.lstrip('-')}"), frame=mark)


def _without_guess(item: NamedColumn) -> NamedColumn:
    """Return a column that is no command where the user named all of these."""
    is_command = item.place is not None and item.place[1].startswith("command_")
    return replace(item, place=None) if is_command or COMMANDS.search(item.words) else item


def _fixes_without_depth(
    chosen: dict[tuple[str, str], NamedColumn],
) -> dict[tuple[str, str], NamedColumn]:
    """Return northing and easting as fixes where there is no third coordinate."""
    flat = {("position", "x_m"): ("fixes", "north_m"), ("position", "y_m"): ("fixes", "east_m")}
    if not set(flat) <= set(chosen) or ("position", "z_m") in chosen:
        return chosen
    if not all("ing" in chosen[place].words for place in flat):
        return chosen
    return {flat.get(place, place): item for place, item in chosen.items()}


def _cells(
    file: RawFile, names: Sequence[str], delimiter: str, encoding: str
) -> tuple[dict[str, list[str]], str]:
    """Return the cells of every column as text, and the decimal mark."""
    data = file.buffer[:MOST_BYTES].tobytes()
    if len(data) == MOST_BYTES:
        data = data[: data.rfind(b"\n") + 1]
    try:
        table = pacsv.read_csv(
            pa.BufferReader(data.decode(encoding, errors="replace").encode()),
            read_options=pacsv.ReadOptions(
                column_names=list(map(str, range(len(names)))), skip_rows=1
            ),
            parse_options=pacsv.ParseOptions(
                delimiter=delimiter, invalid_row_handler=lambda row: "skip"
            ),
            convert_options=pacsv.ConvertOptions(
                column_types={str(index): pa.string() for index in range(len(names))},
                strings_can_be_null=False,
            ),
        )
    except pa.ArrowInvalid as fault:
        raise LogError(f"cannot be read as CSV: {fault}", file=file.name) from None
    once = {name for name in names if list(names).count(name) == 1}
    cells = {
        name: [text.strip() for text in table[str(index)].to_pylist()]
        for index, name in enumerate(names)
        if name in once
    }
    sample = [text for column in cells.values() for text in column[:50] if text]
    commas = sum(bool(re.fullmatch(r"-?\d+,\d+(e-?\d+)?", text)) for text in sample)
    return cells, "," if delimiter != "," and commas > 0.2 * len(sample) else "."


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(cells: Sequence[str], decimal: str) -> Array:
    """Return cells as numbers (n,), nan for what is none."""
    array = np.full(len(cells), np.nan)
    for row, text in enumerate(cells):
        try:
            array[row] = float(text.replace(",", ".") if decimal == "," else text)
        except ValueError:
            continue
    return array


def _time(
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
    texts: Mapping[str, Sequence[str]],
    file: str,
) -> tuple[dict[str, str], str]:
    """Return the entry `time` of the map, and what of it was assumed."""
    named = [
        item for item in columns if TIME.search(item.words) or item.unit in ("s", "ms", "us", "ns")
    ]
    unnamed = [item for item in columns if item not in named]
    for item in named:
        entry = _clock(item, values[item.name], texts[item.name])
        if entry is not None:
            return entry
    for item in unnamed:
        steps = np.diff(values[item.name])
        if item.place is None and steps.size > 10 and (steps > 0.0).all():
            entry = _clock(item, values[item.name], texts[item.name])
            if entry is not None:
                return entry[0], f"no name says time; this column rises in every row; {entry[1]}"
    of_day = next(
        (item.name for item in named if re.match(r"\d\d?:\d\d", next(iter(texts[item.name]), ""))),
        None,
    )
    what = f"column {of_day} is a time of day, which has no date" if of_day else "no column rises"
    raise LogError(
        f"no column is the time of the rows: {what}",
        file=file,
        row=1,
        value=", ".join(item.name for item in named or columns[:6]) or "no column",
        allowed="seconds, ms, us or ns that rise, Unix time, or ISO 8601 text",
        remedy="Export the log with such a column, named time_s.",
    )


def _clock(
    item: NamedColumn, values: Array, texts: Sequence[str]
) -> tuple[dict[str, str], str] | None:
    """Return the entry of a time column, and what was assumed; None for no clock."""
    finite = values[np.isfinite(values)]
    if finite.size < 0.9 * len(texts) or finite.size < 3:
        filled = [text for text in texts[:200] if text]
        if len(filled) > 2 and iso_microseconds(pa.array(filled)) is not None:
            if TIME_OF_DAY.match(filled[0]):
                entry = {"column": item.name, "unit": "time_of_day", "epoch": "arbitrary"}
                return entry, "a time of day, without a date"
            return {"column": item.name, "unit": "iso8601", "epoch": "unix"}, ""
        return None
    steps = np.diff(finite)
    if np.count_nonzero(steps < 0.0) > 0.02 * steps.size or finite[-1] <= finite[0]:
        return None
    if counts_like_a_clock(finite):
        entry = {"column": item.name, "unit": CLOCK_DIGITS, "epoch": "arbitrary"}
        return entry, "the digits of a clock, without a date"
    size = float(np.median(finite))
    # A coarse clock repeats its stamps: rows over the whole time tell the rate.
    step = float(finite[-1] - finite[0]) / steps.size
    possible = [
        unit
        for unit, factor in SECONDS.items()
        if POSSIBLE_STEPS[0] <= step * factor <= POSSIBLE_STEPS[1]
    ]
    unix = next((unit for least, unit in UNIX_TIMES if size > least), None)
    if unix in possible and item.unit in ("", unix):
        return {"column": item.name, "unit": unix, "epoch": "unix"}, ""
    if item.unit in SECONDS:
        check = f"one row every {step * SECONDS[item.unit]:.3g} s in this unit"
        entry = {"column": item.name, "unit": item.unit, "epoch": "boot"}
        return entry, "" if item.unit in possible else check
    unit = next((unit for unit in possible if step * SECONDS[unit] <= 2.0), "s")
    return {
        "column": item.name,
        "unit": unit,
        "epoch": "boot",
    }, f"unit {unit} by the rate of the rows"


def _seconds(time: Mapping[str, str], values: Array, texts: Sequence[str]) -> Array:
    """Return the time of every row (n,) [s]."""
    if time["unit"] == CLOCK_DIGITS:
        return clock_seconds(values)
    if time["unit"] not in TEXT_TIMES:
        return values * SECONDS[time["unit"]]
    stamps = iso_microseconds(pa.array([text for text in texts if text]))
    return np.zeros(1) if stamps is None else np.asarray(stamps.to_numpy()) / 1e6


def _with_commands(
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
    t_s: Array,
    velocities: Mapping[str, Array],
) -> list[NamedColumn]:
    """Return the columns with numbered commands at the axes that answer them.

    Only where no name tells a command or an output. velocities: those of a pose.
    """
    numbered = [
        item
        for item in columns
        if COMMANDS.search(item.words) and _percentile([values[item.name]]) <= LARGEST_COMMAND
    ]
    there = {item.place[0] for item in columns if item.place is not None and item not in numbered}
    if "actuators" in there or len(numbered) < 2 or t_s.size != values[columns[0].name].size:
        return list(columns)
    fields = {**dict(zip(("u_m_s", "v_m_s", "w_m_s"), "uvw", strict=True))}
    fields |= dict(zip(("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"), "pqr", strict=True))
    motions = {
        fields[item.place[1]]: values[item.name]
        for item in columns
        if item.place is not None and item.place[1] in fields
    }
    motions = motions or dict(velocities)
    commands = {item.name: values[item.name] for item in numbered}
    answers = {item.command: item for item in answered_commands(t_s, commands, motions)}
    placed = []
    for item in columns:
        answer = answers.get(item.name)
        if answer is not None:
            mark = MATCHED if answer.correlation > 0.0 else MATCHED_REVERSED
            item = replace(
                item, place=("actuators", f"command_{AXIS_NAMES[answer.axis]}"), frame=mark
            )
        elif item in numbered:
            item = replace(item, place=None)
        placed.append(item)
    return placed


def _with_columns(
    draft: ColumnDraft, columns: Sequence[NamedColumn], values: Mapping[str, Array]
) -> ColumnDraft:
    """Return the draft with its columns, units and remarks."""
    chosen: dict[tuple[str, str], NamedColumn] = {}
    for item in columns:
        filled = np.isfinite(values[item.name]).mean() if values[item.name].size else 0.0
        nameless = "press" in item.words and item.unit not in PRESSURES
        if item.place is not None and filled > 0.01 and not nameless:
            chosen.setdefault(item.place, item)
    remarks: list[str] = []
    chosen = _possible_outputs(chosen, values, remarks)
    chosen = _depth_of_others(chosen, columns, values)
    chosen = _fixes_without_depth(chosen)
    drafted = []
    for (stream, name), item in chosen.items():
        kind = name.split("_")[0] if stream in ("imu", "glider") else stream
        group = [
            values[other.name]
            for (own, field_name), other in chosen.items()
            if (stream != "pose" or (field_name in POSITION) == (name in POSITION))
            and kind in (own, field_name.split("_")[0])
            and not field_name.startswith("quality")
        ]
        unit, check = _unit(stream, name, item, group)
        if item.frame in (MATCHED, MATCHED_REVERSED):
            check = f"{NO_NAME}; {name.split('_')[1]} answers it best of all columns"
        if stream == "velocity" and WORLD_OR_BODY.search(item.words):
            check = "; ".join(filter(None, (check, "body axes assumed, forward right down")))
        if stream == "pose":
            words = (
                "z up: commands answer so" if item.frame else "ned, z down: else frame flu or enu"
            )
            check = "; ".join(filter(None, (check, f"frame {words}")))
        sign = -1 if item.frame in REVERSED else 1
        frame = item.frame if item.frame in ("frd", "flu") else ""
        drafted.append(DraftColumn(item.name, stream, name, unit, sign, frame, check))
    partial = {
        stream: lacking_fields(stream, [name for own, name in chosen if own == stream])
        for stream, _ in chosen
    }
    for stream, lack in partial.items():
        if lack:
            names = ", ".join(SPOKEN.get(name, name) for name in lack)
            remarks.append(f"{stream} is left out: nothing looks like {names}.")
    if (
        any(QUATERNION.search(item.words) for item in columns)
        and not {("attitude", "q_w"), ("pose", "q_w"), ("attitude", "phi_rad")} & set(chosen)
        and ("pose", "phi_rad") not in chosen
    ):
        remarks.append("a quaternion is left out: it needs four columns w, x, y and z.")
    kept = tuple(item for item in drafted if not partial[item.stream])
    used = {item.column for item in kept}
    unmatched = [
        item.name for item in columns if COMMANDS.search(item.words) and item.name not in used
    ]
    if unmatched and not any(item.field.startswith(("pwm_", "command_")) for item in kept):
        remarks.append(
            f"{', '.join(unmatched)} may be commands, and neither name nor motion tells of which"
            f" axis: name them with --commands surge={unmatched[0]},..."
        )
    return replace(
        draft,
        columns=kept,
        accelerometer=_accelerometer(kept, values),
        repeating=_repeating(kept, values),
        unused=tuple(item.name for item in columns if item.name not in used),
        remarks=tuple(remarks),
    )


def _with_pulses(columns: Sequence[NamedColumn], values: Mapping[str, Array]) -> list[NamedColumn]:
    """Return the columns, with numbered ones that hold pulses as outputs.

    Only where no name tells an output.
    """
    if any(item.place is not None and item.place[1].startswith("pwm_") for item in columns):
        return list(columns)
    stems: dict[str, list[NamedColumn]] = {}
    for item in columns:
        match = re.fullmatch(r"(.*\D)(\d{1,2})", item.words)
        finite = values[item.name][np.isfinite(values[item.name])]
        pulses = finite.size and np.mean((finite >= PULSES[0]) & (finite <= PULSES[1])) >= 0.95
        if match and pulses and item.place is None:
            stems.setdefault(match[1], []).append(item)
    outputs = max(stems.values(), key=len, default=[])
    if len(outputs) < FEWEST_OUTPUTS:
        return list(columns)
    return [
        replace(item, place=("actuators", f"pwm_{int(item.words.split()[-1])}_us"))
        if item in outputs
        else item
        for item in columns
    ]


def _possible_outputs(
    chosen: dict[tuple[str, str], NamedColumn],
    values: Mapping[str, Array],
    remarks: list[str],
) -> dict[tuple[str, str], NamedColumn]:
    """Return the columns without outputs that are no pulses; outputs count from 1."""
    outputs = {place: item for place, item in chosen.items() if place[1].startswith("pwm_")}
    if not outputs:
        return chosen
    rest = {place: item for place, item in chosen.items() if place not in outputs}
    known_units = {item.unit for item in outputs.values() if item.unit}
    finite = np.concatenate([values[item.name] for item in outputs.values()])
    finite = finite[np.isfinite(finite) & (finite != 0.0)]
    inside = (finite >= PULSES[0]) & (finite <= PULSES[1])
    unit = "us" if finite.size and inside.mean() >= 0.95 else _normalised(finite)
    if not unit or known_units - {unit, "1"}:
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        remarks.append(
            f"outputs {', '.join(item.name for item in outputs.values())} are no pulses in us"
            f" ({low:g} to {high:g}); a column map takes pulses or normalised commands of each"
            " output, or commands of surge, sway, heave, roll, pitch, yaw."
        )
        return rest
    outputs = {place: replace(item, unit=unit) for place, item in outputs.items()}
    numbers = [int(name.split("_")[1]) for _, name in outputs]
    shift = 1 if 0 in numbers else 0
    if shift:
        remarks.append("outputs are counted from 0 in the file, from 1 here.")
    moved = {
        (stream, f"pwm_{int(name.split('_')[1]) + shift}_us"): item
        for (stream, name), item in outputs.items()
        if int(name.split("_")[1]) + shift <= 16
    }
    return rest | moved


def _normalised(finite: Array) -> str:
    """Return the unit of commands from -1 to 1 or from -100 to 100 %, '' for others."""
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    both = bool(finite.size) and float(finite.min()) < 0.0 < float(finite.max())
    if not both or largest > 100.0:
        return ""
    return "1" if largest <= 1.05 else "percent" if largest > 5.0 else ""


def _depth_of_others(
    chosen: dict[tuple[str, str], NamedColumn],
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
) -> dict[tuple[str, str], NamedColumn]:
    """Return the columns, with depth from altitude or z where none is named so."""
    if ("depth", "depth_m") in chosen or ("pose", "z_m") in chosen:
        return chosen
    for item in columns:
        if re.search(r"\b(?:altitude|alt|height)\b", item.words) and "amsl" not in item.words:
            finite = values[item.name][np.isfinite(values[item.name])]
            if finite.size and float(np.median(finite)) < 0.0:  # above the surface, so below it
                return chosen | {("depth", "depth_m"): replace(item, frame=FROM_ABOVE)}
    height = chosen.get(("position", "z_m")) or next(
        (item for item in columns if item.place == ("position", "z_m")), None
    )
    if height is None:
        return chosen
    below = float(np.nanmedian(values[height.name])) < 0.0
    return chosen | {("depth", "depth_m"): replace(height, frame=FROM_ABOVE if below else "")}


def _unit(stream: str, name: str, item: NamedColumn, group: Sequence[Array]) -> tuple[str, str]:
    """Return the unit of a column, and in words what was assumed of it."""
    if name.startswith("command_"):
        return "1", ""
    if name.startswith("pwm_"):
        return item.unit, "" if item.unit == "us" else "full command taken for 1100 or 1900 us"
    depth = "" if stream != "depth" or "depth" in item.words else f"depth from {item.name}"
    if depth and item.unit in PRESSURES:
        depth = "pressure as depth of sea water; its zero may not be the surface"
    if item.unit:
        return item.unit, depth
    size = _percentile(group)
    if stream == "glider":
        return _glider_unit(name, size)
    if stream == "pose":
        return pose_unit(name, size)
    if stream == "fixes" and name.endswith("_rad"):
        return "deg", "assumed"
    if stream == "attitude":
        return ("deg", "") if size > FULL_TURN else ("rad", "no value is beyond a turn in rad")
    if name.startswith("gyro"):
        return ("deg/s", "by its size") if size > FASTEST_RAD_S else ("rad/s", "by its size")
    if name.startswith("accel"):
        return ("g0", "by its size") if size < 4.0 else ("m/s^2", "by its size")
    if stream in ("velocity", "water_velocity"):
        unit = "m/s" if size < FASTEST_M_S else "cm/s" if size < FASTEST_CM_S else "mm/s"
        return unit, "by its size"
    if stream == "battery":
        return ("mV", "by its size") if size > 1000.0 else ("V", "by its size")
    assumed = {"propeller_rev_s": "rpm", "interval_s": "s", "quality": "1", "tow_force_n": "N"}
    return assumed.get(name, "m"), depth or "assumed"


def _glider_unit(name: str, size: float) -> tuple[str, str]:
    """Return the unit of a glider's column by the size of its values."""
    small, large, limit = GLIDER_UNITS[name]
    return (large if size > limit else small), "by its size"


def _percentile(group: Sequence[Array]) -> float:
    """Return the 99th percentile of the moduli of signals, 0 without any."""
    finite = np.concatenate([np.abs(each[np.isfinite(each)]) for each in group])
    return float(np.percentile(finite, 99.0)) if finite.size else 0.0


def _accelerometer(columns: Sequence[DraftColumn], values: Mapping[str, Array]) -> str:
    """Return what the accelerometer measures, by its length at rest; '' without one."""
    axes = [values[item.column] for item in columns if item.field.startswith("accel_")]
    if not axes:
        return ""
    length = float(np.nanmedian(np.sqrt(np.sum(np.square(axes), axis=0))))
    gravity = any(low < length < high for low, high in (NEAR_ONE, NEAR_GRAVITY))
    return "specific_force" if gravity or len(axes) < 3 else "inertial"


def _repeating(columns: Sequence[DraftColumn], values: Mapping[str, Array]) -> tuple[str, ...]:
    """Return the streams whose values mostly repeat those of the row before."""
    repeating = []
    for stream in ("velocity", "imu"):
        own = [values[item.column] for item in columns if item.stream == stream]
        if own:
            table = np.column_stack(own)
            same = (table[1:] == table[:-1]).all(axis=1)
            if same.size and same.mean() > HELD_SHARE and np.ptp(table[:, 0]) > 0.0:
                repeating.append(stream)
    return tuple(repeating)
