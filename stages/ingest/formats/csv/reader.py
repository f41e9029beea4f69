"""CSV logs: recognise, and read through a column map.

Parsing is pyarrow's; units, signs, time and the account of rows are ours. The messages
of a decoded CSV are the streams themselves, already in SI, FRD and NED; `offset` holds
the row as an editor counts it (the header is row 1).
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv

from auvid.data_schemas.errors import CampaignError, LogError
from auvid.data_schemas.tables import column
from auvid.hydro.arrays import Array, Buffer, Ints, Mask
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import (
    ByteAccount,
    DecodedLog,
    LogReader,
    Messages,
    Skipped,
)
from auvid.stages.ingest.formats.accounting import covered_seconds
from auvid.stages.ingest.formats.csv.clock_digits import (
    CLOCK_DIGITS,
    DAY_S,
    clock_seconds,
    counts_like_a_clock,
)
from auvid.stages.ingest.formats.csv.column_map import (
    ColumnMap,
    MappedColumn,
    column_map,
    dialect_map,
    late_columns,
)
from auvid.stages.ingest.formats.csv.column_proposal import proposed_map
from auvid.stages.ingest.formats.csv.pose_columns import (
    WORLD_VELOCITY,
    Fields,
    in_own_axes,
    right_order,
    velocity_in_body_axes,
)
from auvid.stages.ingest.formats.csv.tolerant_lines import (
    ISO_TIME,
    Form,
    LateColumns,
    SoundRows,
    read_sound_rows,
)

MOTIVE, MOST_NAMED = b"Format Version,", 12
"""Start of an export of Motive, and how many columns of one a remedy names."""
HEADER_BYTES = 1 << 16
BLOCK = 1 << 20
NEWLINE = 10
CLOCK = re.compile(rb"\d\d?:\d\d")
"""What stands behind late columns: a time of day."""
TIME_OF_DAY = re.compile(r"\s*\d\d?:\d\d:\d\d(\.\d+)?\s*$")
SECOND_US = 1e6
UNIX_US = 9e14
"""Unix time of this century in microseconds is beyond this number."""
UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # byte order marks
TO_UTF_8 = "Save it as UTF-8: iconv -f UTF-16 -t UTF-8 %s > utf8_%s"
MARKS = (b",", b";", b"\t")
SEEN_LINES, FEWEST_COLUMNS = 40, 3
"""Lines at the start of a file in which names are looked for, and the fewest of them."""
NO_VALUE = "no value in the row"
REPEATED = "held value repeated"


@dataclass(frozen=True)
class Head:
    """First line of a file: column names, length in bytes, text encoding, separator."""

    names: tuple[str, ...]
    bytes: int
    encoding: str
    delimiter: str
    late: LateColumns | None = None


def recognises(head: bytes) -> bool:
    """Return whether this is text whose first line has separated columns."""
    first = head.split(b"\n", 1)[0]
    if _is_utf_16(head):
        return True
    if b"\0" in head[:1024]:
        return False
    return any(mark in first for mark in MARKS) or _names_row(head) is not None


def _is_utf_16(head: bytes) -> bool:
    """Return whether a text is UTF-16, by its mark or the zeros between letters."""
    start = head[:64]
    zeros = (start[::2], start[1::2])
    letters = len(start) > 8 and any(
        not any(zero) and all(32 <= byte < 127 or byte in b"\t\r\n" for byte in other)
        for zero, other in (zeros, zeros[::-1])
    )
    return head.startswith(UTF_16) or letters


def _names_row(start: bytes) -> int | None:
    """Return the row of the names of columns (2 ...) where other lines are above it.

    That is the first of as many cells as the rows below it, which holds no numbers, where
    the first line has less than half as many.
    """
    if any(byte < 32 and byte not in b"\t\r\n" for byte in start[:1024]):
        return None
    lines = [line.rstrip(b"\r") for line in start.split(b"\n")[:-1][:SEEN_LINES]]
    for mark in MARKS:
        counts = [line.count(mark) + 1 for line in lines]
        width = max(counts[-3:], default=1)
        if width < FEWEST_COLUMNS or counts[0] > width / 2 or min(counts[-3:]) < width:
            continue
        row = counts.index(width)
        if not any(re.fullmatch(rb"\s*[-+]?\d[\d.eE+-]*\s*", it) for it in lines[row].split(mark)):
            return row + 1
    return None


CSV = LogReader("csv", recognises, lambda file, message_types: read_csv(file, message_types)[0])


def read_csv(
    file: RawFile, message_types: frozenset[str] | None = None
) -> tuple[DecodedLog, ColumnMap]:
    """Return the streams of a CSV log, and its checked column map.

    Raises:
        LogError: no column map, no header, cells that are not numbers (all together,
        with rows). CampaignError: the column map does not fit the file.
    """
    raw = file.columns
    head = header(file, None if raw is None else str(raw.get("delimiter", ",")))
    late = _late_columns(file.buffer, head)
    if late is not None:
        names = (*head.names[: late.start], *late.names, *head.names[late.start :])
        head = replace(head, names=names, late=late)
    dialect = dialect_map(head.names) if raw is None else None
    raw, note = dialect or (raw, None)
    if raw is None:
        raise LogError(
            "a CSV log needs a column map",
            file=file.name,
            row=1,
            value=f"{len(head.names)} columns",
            allowed=(
                "a YAML file that says what the columns are, named in the manifest (columns: FILE)"
                " or by auvid check --columns FILE"
            ),
            remedy=proposed_map(head.names),
        )
    _check_separator(head, file.name)
    mapping = column_map(raw, head.names, file=file.name)
    columns = [
        item for item in mapping.columns if message_types is None or item.stream in message_types
    ]
    sound = _parse(file, head, mapping, columns, str(raw.get("decimal", ".")))
    rows = sound.rows
    time_us = _time(sound.table, mapping, rows, file.name) + mapping.shift_us
    messages, idle, notes = _streams(sound.table, columns, mapping, time_us, rows)
    lost, known_time = sound.losses.starts(), np.isfinite(time_us)
    skipped = (*sound.losses.skipped(), *idle)
    size, lost_bytes = file.buffer.size, sum(item.bytes for item in skipped)
    at_end = len(lost) == 1 and (not rows.size or lost[0] > rows[-1])
    unused = [
        name
        for name in head.names
        if name not in {item.column for item in mapping.columns} | {*mapping.of_time}
    ]
    if note is not None:
        notes.append(f"{file.name}: {note}")
    elif unused:
        notes.append(f"{file.name}: columns that the column map does not name: {', '.join(unused)}")
    if late is not None:
        notes.append(
            f"{file.name}: the header lacks {len(late.names)} columns ({late.names[0]} ...) that"
            " rows have: it was written before that part reported"
        )
    log = DecodedLog(
        format="CSV",
        messages=messages,
        counts={name: len(item) for name, item in messages.items()},
        account=ByteAccount(size, size - head.bytes - lost_bytes, head.bytes, skipped),
        status="complete" if not lost else "truncated" if at_end else "damaged",
        seconds_lost=covered_seconds(rows[known_time], time_us[known_time].astype(np.int64), lost),
        notes=(*notes, *sound.notes),
    )
    return log, mapping


def header(file: RawFile, delimiter: str | None) -> Head:
    """Return the column names of the first line.

    Raises `LogError` for an empty file and for a first line that names no columns.
    """
    start = file.buffer[:HEADER_BYTES].tobytes()
    if not start.strip():
        raise LogError("the file is empty", file=file.name)
    if _is_utf_16(start):
        raise LogError(
            "the file is UTF-16 text",
            file=file.name,
            allowed="UTF-8 or Latin-1",
            remedy=TO_UTF_8 % (file.name, file.name),
        )
    if start.removeprefix(b"\xef\xbb\xbf").startswith(MOTIVE):
        raise _export_of_motive(start.decode("utf-8-sig", errors="replace"), file.name)
    row = _names_row(start)
    if row is not None:
        lines = "line" if row == 2 else f"{row - 1} lines"
        raise LogError(
            f"the names of the columns stand in row {row}, and not in the first",
            file=file.name,
            row=1,
            value=start.split(b"\n", 1)[0][:60].decode("utf-8", errors="replace"),
            remedy=f"Delete the {lines} above the names: tail -n +{row} {file.name}",
        )
    encoding = "utf-8"
    line = start.split(b"\n", 1)[0]
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        encoding, text = "latin-1", line.decode("latin-1")
    if delimiter is None:
        delimiter = max(",;\t", key=text.count)
    try:
        names = tuple(next(csv.reader(io.StringIO(text.rstrip("\r")), delimiter=delimiter)))
    except csv.Error:
        what = "the first line has a stray carriage return or quotation mark in it"
        raise LogError(
            what,
            file=file.name,
            row=1,
            remedy="Mend the line that names the columns; lines end in LF or CR LF.",
        ) from None
    return Head(names, min(len(line) + 1, file.buffer.size), encoding, delimiter)


def _export_of_motive(text: str, file: str) -> LogError:
    """Return the error of an export of Motive, whose names stand in several lines.

    Its remedy writes them in one: the body, Rotation or Position, and the axis.
    """
    rows = list(csv.reader(io.StringIO(text)))
    last = next((n for n, row in enumerate(rows) if row[:1] == ["Frame"]), 0)
    kinds = next((row for row in rows[:last] if {"Rotation", "Position"} <= set(row)), [])
    bodies = next((row[2:] for row in rows[:last] if row[1:2] in (["Name"], [" Name"])), [])
    remedy = "Export one rigid body, with header information and without markers."
    if "Rotation Type" in rows[0] and "Quaternion" not in rows[0]:
        remedy = "Export it with rotation type Quaternion: its angles have another order."
    elif kinds and len(rows[last]) <= MOST_NAMED and len({*bodies} - {""}) <= 1:
        pairs = zip(kinds[2:], rows[last][2:], strict=False)
        names = ",".join([*rows[last][:2], *(f"{kind} {axis}".strip() for kind, axis in pairs)])
        remedy = (
            f"Write the names into one line: (echo '{names}'; tail -n +{last + 2} {file}) >"
            f" table_{file}. Its y is up (frame: y_up in a column map), where Motive's up axis"
            " was not set to Z; its commands may be a file beside it."
        )
    return LogError(
        "an export of OptiTrack Motive, whose names stand in several lines",
        file=file,
        row=1,
        allowed="one line of names",
        remedy=remedy,
    )


def _late_columns(buffer: Buffer, head: Head) -> LateColumns | None:
    """Return the columns that the header lacks if any row has that many more cells."""
    lacking = late_columns(head.names)
    if lacking is None:
        return None
    late, delimiter = LateColumns(*lacking), head.delimiter.encode()
    width, place = len(head.names) + len(late.names), late.start + len(late.names)
    for row in buffer.tobytes().split(b"\n")[1:]:
        cells = row.split(delimiter)
        if len(cells) == width:
            return late if CLOCK.match(cells[place]) else None
    return None


def _check_separator(head: Head, file: str) -> None:
    """Raise `LogError` for a single column whose name holds the separator of others."""
    other = (
        next((mark for mark in ";\t," if mark in head.names[0]), None)
        if len(head.names) == 1
        else None
    )
    if other is not None:
        words = {"\t": "a tab", ";": "a semicolon", ",": "a comma"}[other]
        remedy = (
            f"The columns are separated by {words}: add delimiter: {json.dumps(other)} to the"
            " column map, "
        )
        remedy += 'and decimal: "," if the numbers have a decimal comma.'
        raise LogError(
            f"the first line has no {head.delimiter!r} in it",
            file=file,
            row=1,
            value=head.names[0],
            remedy=remedy,
        )


def _parse(
    file: RawFile, head: Head, mapping: ColumnMap, columns: Sequence[MappedColumn], decimal: str
) -> SoundRows:
    """Return the columns of the file; line by line only if it is not wholly sound."""
    types: dict[str, pa.DataType] = {
        item.column: {"string": pa.string(), "bool": pa.bool_()}.get(item.dtype, pa.float64())
        for item in columns
    }
    clock = pa.float64() if mapping.time_factor is not None else ISO_TIME
    types |= dict.fromkeys(mapping.of_time, clock)
    form = Form(head.names, head.delimiter, decimal, mapping.missing, head.late)
    if head.late is not None:
        return read_sound_rows(file.buffer.tobytes(), types, form, file=file.name)
    try:
        # One thread at once: a stream of batches takes twice as long, and several
        # threads parse far ahead of what they convert.
        table = pacsv.read_csv(
            pa.BufferReader(pa.py_buffer(file.buffer)),
            read_options=pacsv.ReadOptions(encoding=head.encoding, use_threads=False),
            parse_options=pacsv.ParseOptions(delimiter=head.delimiter),
            convert_options=form.options(types),
        )
    except (pa.ArrowInvalid, UnicodeError):
        table = None
    rows = None if table is None else _rows(file.buffer, table.num_rows)
    if (
        table is None
        or rows is None
        or (mapping.time_factor is None and iso_microseconds(table[mapping.time]) is None)
    ):
        return read_sound_rows(file.buffer.tobytes(), types, form, file=file.name)
    return SoundRows(table, rows)


def _rows(buffer: Buffer, count: int) -> Ints | None:
    """Return the row of each of `count` samples as an editor counts it.

    None if they are not one to a line.
    """
    ends = sum(
        int(np.count_nonzero(buffer[at : at + BLOCK] == NEWLINE))
        for at in range(0, buffer.size, BLOCK)
    )
    lines = ends + int(buffer[-1] != NEWLINE)
    if lines == count + 1:
        return np.arange(2, count + 2)
    content = [
        number
        for number, line in enumerate(buffer.tobytes().split(b"\n"), 1)
        if line not in (b"", b"\r")
    ]
    return np.array(content[1:], np.int64) if len(content) == count + 1 else None


def _time(table: pa.Table, mapping: ColumnMap, rows: Ints, file: str) -> Array:
    """Return the time column in microseconds (n,), NaN where it is empty."""
    values = table[mapping.time]
    if mapping.time_factor is not None:
        numbers = column(table, mapping.time)
        if mapping.clock:
            return clock_seconds(numbers) * mapping.time_factor
        if mapping.time_factor == SECOND_US and counts_like_a_clock(numbers):
            raise LogError(
                "the time column is no seconds but the digits of a clock, which leap at each"
                " full minute",
                file=file,
                row=int(rows[0]),
                field=mapping.time,
                value=float(numbers[0]),
                remedy=f"Set unit: {CLOCK_DIGITS} for the time column.",
            )
        size = float(np.nanmedian(numbers)) if np.isfinite(numbers).any() else 0.0
        if mapping.time_factor == SECOND_US and size > UNIX_US:
            unit = "us" if size < UNIX_US * 1e3 else "ns"
            raise LogError(
                f"the time column is no seconds but Unix time in {unit}",
                file=file,
                row=int(rows[0]),
                field=mapping.time,
                value=float(numbers[0]),
                remedy=f"Set unit: {unit} for the time column, and epoch: unix.",
            )
        if mapping.nanoseconds is not None:
            within = column(table, mapping.nanoseconds)
            return numbers * mapping.time_factor + within * 1e-3
        return numbers * mapping.time_factor
    result = np.full(len(values), np.nan)
    stamps = iso_microseconds(values)
    if stamps is None:
        bad = next(
            index
            for index, item in enumerate(values)
            if item.is_valid and iso_microseconds(pa.array([item.as_py()])) is None
        )
        raise LogError(
            "not an ISO 8601 time like the ones before",
            file=file,
            row=int(rows[bad]),
            field=mapping.time,
            value=values[bad].as_py(),
            allowed="2024-05-01T12:30:00.123 with or without a zone, or 12:30:00.123, all alike",
        )
    valid = np.asarray(values.is_valid())
    result[valid] = np.asarray(stamps.drop_null(), dtype=np.float64)
    return result


def declared_start_us(mapping: ColumnMap, file: str) -> int | None:
    """Return the time from which legs count, where the column map declares it.

    Raises `CampaignError` if it is no time.
    """
    if mapping.start is None:
        return None
    if mapping.time_factor is not None and isinstance(mapping.start, int | float):
        start = clock_seconds([mapping.start])[0] if mapping.clock else mapping.start
        if math.isfinite(start):
            return round(float(start) * mapping.time_factor)
    stamps = (
        iso_microseconds(pa.array([str(mapping.start)])) if mapping.time_factor is None else None
    )
    if stamps is None:
        allowed = (
            f"a number in the unit of the time column{', a time of the day' * mapping.clock}"
            if mapping.time_factor is not None
            else "an ISO 8601 time"
        )
        raise CampaignError(
            "is no time",
            file=f"column map of {file}",
            field="time.start",
            value=mapping.start,
            allowed=allowed,
        )
    return int(stamps[0].as_py())


def iso_microseconds(values: pa.ChunkedArray | pa.Array) -> pa.ChunkedArray | None:
    """Return ISO 8601 texts as microseconds since 1970 (UTC where no zone is given).

    Times of day (12:30:05.2) count from the midnight before the first; a step back by
    more than half a day is midnight. None if they are not all of one kind.
    """
    texts = values.drop_null().to_pylist()
    if texts and all(isinstance(text, str) and TIME_OF_DAY.match(text) for text in texts):
        return _of_day(values)
    for kind in (pa.timestamp("us"), pa.timestamp("us", "UTC")):
        try:
            return pc.cast(pc.cast(values, kind), pa.int64())
        except pa.ArrowInvalid:
            continue
    return None


def _of_day(values: pa.ChunkedArray | pa.Array) -> pa.ChunkedArray:
    """Return times of day as microseconds from the midnight before the first."""
    seconds = [
        None
        if text is None
        else sum(float(part) * 60.0**k for part, k in zip(text.split(":"), (2, 1, 0), strict=True))
        for text in values.to_pylist()
    ]
    read_seconds = np.array([value for value in seconds if value is not None])
    days = np.cumsum(np.append(0, np.diff(read_seconds) < -0.5 * DAY_S))
    stamps = iter(np.rint((read_seconds + DAY_S * days) * 1e6).astype(np.int64).tolist())
    return pa.chunked_array(
        [pa.array([None if value is None else next(stamps) for value in seconds], pa.int64())]
    )


def _check_order(stream: str, fields: Fields, frame: str) -> None:
    """Raise `CampaignError` where the parts of a quaternion stand in another order."""
    order = right_order(fields, frame)
    if order:
        raise CampaignError(
            f"with the quaternion as it is mapped the vehicle lies on its back; taken for {order},"
            " it is upright",
            field=f"columns of stream {stream}",
            remedy="Correct the columns of the quaternion: q_w is its scalar part. Of a vehicle"
            " that does lie on its back map angles (phi_rad, theta_rad, psi_rad).",
        )


def _streams(
    table: pa.Table,
    columns: Sequence[MappedColumn],
    mapping: ColumnMap,
    time_us: Array,
    rows: Ints,
) -> tuple[dict[str, Messages], list[Skipped], list[str]]:
    """Return one `Messages` per stream.

    Ints without any value of the stream, and repeats of a held value, are no samples
    of it.
    """
    messages: dict[str, Messages] = {}
    idle: list[Skipped] = []
    notes: list[str] = []
    for stream in dict.fromkeys(item.stream for item in columns):
        fields = {
            item.field: _values(table[item.column], item)
            for item in columns
            if item.stream == stream
        }
        empty = _without_value(list(fields.values()), rows.size)
        kept = ~empty
        idle += _idle(f"{stream}: {NO_VALUE}", empty, rows)
        if empty.all():
            notes.append(f"{stream}: the mapped columns are empty, there is no sample")
            continue
        if stream in mapping.repeating:
            index = np.flatnonzero(kept)
            same = np.all(
                [values[index[1:]] == values[index[:-1]] for values in fields.values()], axis=0
            )
            repeat = np.zeros(kept.size, bool)
            repeat[index[1:][same]] = True
            kept &= ~repeat
            idle += _idle(f"{stream}: {REPEATED}", repeat, rows)
        frame = next((item.frame for item in columns if item.stream == stream and item.frame), "")
        chosen: dict[str, npt.NDArray[Any]] = {"time_us": time_us, **fields}
        if not kept.all():
            chosen = {name: values[kept] for name, values in chosen.items()}
        if not any(item.stream == "imu" for item in columns):  # else the gyro tells
            _check_order(stream, chosen, frame)
        chosen = in_own_axes(stream, chosen, frame)
        messages[stream] = Messages(stream, chosen, rows if kept.all() else rows[kept])
    velocity = messages.get("velocity")
    if velocity is not None and WORLD_VELOCITY[0] in velocity.columns:
        angles = messages.get("attitude") or messages.get("pose")
        if angles is None:
            notes.append(
                "velocity: north, east, down cannot be turned into body axes, the file has no"
                " attitude or pose"
            )
        frame = next((item.frame for item in columns if item.field in WORLD_VELOCITY), "")
        turned = velocity_in_body_axes(
            dict(velocity.columns), frame, None if angles is None else dict(angles.columns)
        )
        messages["velocity"] = replace(velocity, columns=turned)
    return messages, idle, notes


def _values(values: pa.ChunkedArray, item: MappedColumn) -> npt.NDArray[Any]:
    if item.dtype in ("string", "bool"):
        return np.array(values.to_pylist(), dtype=object)
    numbers = np.asarray(values.to_numpy(), dtype=np.float64)
    if item.factor != 1.0:
        numbers = numbers * item.factor
    return numbers + item.offset if item.offset != 0.0 else numbers


def _without_value(fields: Sequence[npt.NDArray[Any]], rows: int) -> Mask:
    """Return the rows (n,) in which every field is empty."""
    empty = np.ones(rows, bool)
    for values in fields:
        # A sum that is a number has no NaN in it; most columns are full.
        with np.errstate(invalid="ignore"):
            full = values.dtype != object and not np.isnan(values.sum())
        if full:
            return np.zeros(rows, bool)
        empty &= _is_missing(values)
    return empty


def _is_missing(values: npt.NDArray[Any]) -> Mask:
    if values.dtype == object:
        return np.array([item is None for item in values], bool)
    missing: Mask = np.isnan(values)
    return missing


def _idle(reason: str, rows: Mask, numbers: Ints) -> list[Skipped]:
    skipped = numbers[rows]
    return (
        [Skipped(reason, 0, int(skipped.size), int(skipped[0]), int(skipped[-1]))]
        if skipped.size
        else []
    )
