"""CSV logs: recognise, and read through a column map. Parsing is pyarrow's; units, signs, time and the account of rows are ours.

The messages of a decoded CSV are the streams themselves, already in SI, FRD and NED; `offset` holds the row as an editor counts it
(the header is row 1).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv

from data_schemas.errors import CampaignError, LogError, PipelineError, raise_faults

from .column_map import ColumnMap, MappedColumn, column_map, dialect_map
from .decoded import ByteAccount, DecodedLog, LogStatus, Messages, RawFile, Skipped

NAME = "csv"
NUMBER = r"^\s*[-+]?(\d+\.?\d*([eE][-+]?\d+)?|\.\d+([eE][-+]?\d+)?|(?i:nan|inf|infinity))\s*$"
EXAMPLE = """
    time: {column: %s, unit: s}
    columns:
      - {column: %s, stream: depth, field: depth_m, unit: m}"""
HEADER_BYTES = 1 << 16
BLOCK = 1 << 20
NEWLINE = 10
NO_VALUE = "no value in the row"
REPEATED = "held value repeated"
Rows = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Head:
    """The first line of a file: its column names, its length in bytes, the text encoding and the separator."""

    names: tuple[str, ...]
    bytes: int
    encoding: str
    delimiter: str


class CsvReader:
    """Reader of CSV logs with a column map."""

    name = NAME

    def recognises(self, head: bytes) -> bool:
        """True for text whose first line has separated columns."""
        first = head.split(b"\n", 1)[0]
        return b"\0" not in head[:1024] and any(mark in first for mark in (b",", b";", b"\t"))

    def read(self, file: RawFile, wanted: frozenset[str] | None = None) -> DecodedLog:
        """The streams that the column map names; `wanted` limits them. Raises as `read_csv`."""
        return read_csv(file, wanted)[0]


CSV = CsvReader()


def read_csv(file: RawFile, wanted: frozenset[str] | None = None) -> tuple[DecodedLog, ColumnMap]:
    """The streams of a CSV log, and its checked column map.

    Raises:
        LogError: no column map, no header, cells that are not numbers (all together, with rows).
        CampaignError: the column map does not fit the file.
    """
    raw = file.columns
    head = header(file, None if raw is None else str(raw.get("delimiter", ",")))
    known = dialect_map(head.names) if raw is None else None
    raw, said = known if known is not None else (raw, None)
    if raw is None:
        raise LogError(
            "a CSV log needs a column map",
            file=file.name,
            row=1,
            value=", ".join(head.names),
            remedy="Write a YAML file that says what the columns are, and name it in the manifest (columns: FILE):"
            + EXAMPLE % (head.names[0], head.names[-1]),
        )
    mapping = column_map(raw, head.names, file=file.name)
    columns = [item for item in mapping.columns if wanted is None or item.stream in wanted]
    table, ragged = _parse(file, head, mapping, columns, str(raw.get("decimal", ".")))
    rows = _rows(file.buffer, table.num_rows, ragged)
    messages, idle, notes = _streams(table, columns, mapping, _time(table, mapping, rows, file.name), rows)
    unused = [name for name in head.names if name not in {item.column for item in mapping.columns} | {mapping.time}]
    if said is not None:
        notes.append(f"{file.name}: {said}")
    elif unused:
        notes.append(f"{file.name}: columns that the column map does not name: {', '.join(unused)}")
    log = DecodedLog(
        format="CSV",
        messages=messages,
        counts={name: len(item) for name, item in messages.items()},
        account=ByteAccount(file.buffer.size, file.buffer.size - head.bytes - ragged.bytes, head.bytes, (*ragged.skipped(), *idle)),
        status=_status(ragged, rows),
        notes=tuple(notes),
    )
    return log, mapping


def _status(ragged: Ragged, rows: Rows) -> LogStatus:
    if not ragged.lines.size:
        return "complete"
    return "truncated" if ragged.lines.size == 1 and (not rows.size or ragged.lines[0] > rows[-1]) else "damaged"


def header(file: RawFile, delimiter: str | None) -> Head:
    """Column names of the first line. Raises `LogError` for an empty file."""
    start = file.buffer[:HEADER_BYTES].tobytes()
    if not start.strip():
        raise LogError("the file is empty", file=file.name)
    encoding = "utf-8"
    line = start.split(b"\n", 1)[0]
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        encoding, text = "latin-1", line.decode("latin-1")
    if delimiter is None:
        delimiter = max(",;\t", key=text.count)
    names = tuple(next(csv.reader(io.StringIO(text.rstrip("\r")), delimiter=delimiter)))
    return Head(names, min(len(line) + 1, file.buffer.size), encoding, delimiter)


@dataclass(frozen=True)
class Ragged:
    """Rows with a wrong number of columns: their lines as an editor counts them (n,), their bytes, and the reason."""

    lines: Rows
    bytes: int
    reason: str

    def skipped(self) -> tuple[Skipped, ...]:
        if not self.lines.size:
            return ()
        return (Skipped(self.reason, self.bytes, int(self.lines.size), int(self.lines[0]), int(self.lines[-1])),)


def _parse(file: RawFile, head: Head, mapping: ColumnMap, columns: Sequence[MappedColumn], decimal: str) -> tuple[pa.Table, Ragged]:
    types: dict[str, pa.DataType] = {
        item.column: {"string": pa.string(), "bool": pa.bool_()}.get(item.dtype, pa.float64()) for item in columns
    }
    types[mapping.time] = pa.float64() if mapping.time_factor is not None else pa.string()
    ragged: list[Any] = []

    def skip(row: Any) -> str:
        ragged.append(row)
        return "skip"

    def read(types: Mapping[str, pa.DataType], threads: bool) -> pa.Table:
        ragged.clear()
        return pacsv.read_csv(
            pa.BufferReader(pa.py_buffer(file.buffer)),
            read_options=pacsv.ReadOptions(use_threads=threads, encoding=head.encoding),
            parse_options=pacsv.ParseOptions(delimiter=head.delimiter, invalid_row_handler=skip),
            convert_options=pacsv.ConvertOptions(
                include_columns=list(types),
                column_types=dict(types),
                null_values=list(mapping.missing),
                strings_can_be_null=True,
                decimal_point=decimal,
            ),
        )

    try:
        table = read(types, True)
    except pa.ArrowInvalid as fault:
        texts = read(dict.fromkeys(types, pa.string()), False)
        rows = _rows(file.buffer, texts.num_rows, _ragged(ragged, file.buffer))
        _raise_cells(texts, types, rows, file.name, decimal)
        raise LogError(f"cannot be read as CSV: {fault}", file=file.name) from None
    if ragged:
        # Only the reading on one thread tells which rows they were.
        read({mapping.time: pa.string()}, False)
    return table, _ragged(ragged, file.buffer)


def _raise_cells(texts: pa.Table, types: Mapping[str, pa.DataType], rows: Rows, file: str, decimal: str) -> None:
    """Name every cell that is no number, with its row."""
    faults: list[PipelineError] = []
    for name, kind in types.items():
        if kind != pa.float64():
            continue
        values = texts[name] if decimal == "." else pc.replace_substring(texts[name], decimal, ".")
        bad = np.flatnonzero(np.asarray(pc.fill_null(pc.invert(pc.match_substring_regex(values, NUMBER)), False)))
        for index in bad:
            faults.append(
                LogError(
                    "not a number",
                    file=file,
                    row=int(rows[index]),
                    field=name,
                    value=texts[name][int(index)].as_py(),
                    remedy="If this text stands for an empty cell, list it under 'missing' in the column map.",
                )
            )
    raise_faults(faults, file=file)


def _ragged(found: Sequence[Any], buffer: npt.NDArray[np.uint8]) -> Ragged:
    if not found:
        return Ragged(np.zeros(0, np.int64), 0, "")
    # The parser counts rows without blank lines, an editor counts these too.
    lines = _content_lines(buffer)[np.array(sorted(row.number - 1 for row in found))]
    reason = f"row with {found[0].actual_columns} columns in place of {found[0].expected_columns}"
    return Ragged(lines, sum(len(row.text.encode()) + 1 for row in found), reason)


def _content_lines(buffer: npt.NDArray[np.uint8]) -> Rows:
    """Numbers (from 1) of the lines that are not blank."""
    lines = buffer.tobytes().split(b"\n")
    return np.array([number for number, line in enumerate(lines, 1) if line not in (b"", b"\r")], np.int64)


def _rows(buffer: npt.NDArray[np.uint8], count: int, ragged: Ragged) -> Rows:
    """The row of each of `count` samples as an editor counts it."""
    ends = sum(int(np.count_nonzero(buffer[at : at + BLOCK] == NEWLINE)) for at in range(0, buffer.size, BLOCK))
    lines = ends + int(buffer[-1] != NEWLINE)
    if lines == count + 1:
        return np.arange(2, count + 2)
    content = _content_lines(buffer)[1:]
    content = content[~np.isin(content, ragged.lines)]
    return content if content.size == count else np.arange(2, count + 2)


def _time(table: pa.Table, mapping: ColumnMap, rows: Rows, file: str) -> npt.NDArray[np.float64]:
    """The time column in microseconds (n,), NaN where it is empty."""
    values = table[mapping.time]
    if mapping.time_factor is not None:
        return np.asarray(values.to_numpy(), dtype=np.float64) * mapping.time_factor
    result = np.full(len(values), np.nan)
    stamps = iso_microseconds(values)
    if stamps is None:
        bad = next(index for index, item in enumerate(values) if item.is_valid and iso_microseconds(pa.array([item.as_py()])) is None)
        raise LogError(
            "not an ISO 8601 time like the ones before",
            file=file,
            row=int(rows[bad]),
            field=mapping.time,
            value=values[bad].as_py(),
            allowed="2024-05-01T12:30:00.123 with or without a zone, all alike",
        )
    valid = np.asarray(values.is_valid())
    result[valid] = np.asarray(stamps.drop_null(), dtype=np.float64)
    return result


def declared_start_us(mapping: ColumnMap, file: str) -> int | None:
    """The time from which legs count, where the column map says so. Raises `CampaignError` if it is no time."""
    if mapping.start is None:
        return None
    if mapping.time_factor is not None and isinstance(mapping.start, int | float):
        return round(mapping.start * mapping.time_factor)
    stamps = iso_microseconds(pa.array([str(mapping.start)])) if mapping.time_factor is None else None
    if stamps is None:
        allowed = "a number in the unit of the time column" if mapping.time_factor is not None else "an ISO 8601 time"
        raise CampaignError("is no time", file=f"column map of {file}", field="time.start", value=mapping.start, allowed=allowed)
    return int(stamps[0].as_py())


def iso_microseconds(values: pa.ChunkedArray | pa.Array) -> pa.ChunkedArray | None:
    """ISO 8601 texts as microseconds since 1970 (UTC where no zone is given); None if they are not all of one kind."""
    for kind in (pa.timestamp("us"), pa.timestamp("us", "UTC")):
        try:
            return pc.cast(pc.cast(values, kind), pa.int64())
        except pa.ArrowInvalid:
            continue
    return None


def _streams(
    table: pa.Table, columns: Sequence[MappedColumn], mapping: ColumnMap, time_us: npt.NDArray[np.float64], rows: Rows
) -> tuple[dict[str, Messages], list[Skipped], list[str]]:
    """One `Messages` per stream. Rows without any value of the stream, and repeats of a held value, are no samples of it."""
    messages: dict[str, Messages] = {}
    idle: list[Skipped] = []
    notes: list[str] = []
    for stream in dict.fromkeys(item.stream for item in columns):
        fields = {item.field: _values(table[item.column], item) for item in columns if item.stream == stream}
        empty = _without_value(list(fields.values()), rows.size)
        kept = ~empty
        idle += _idle(f"{stream}: {NO_VALUE}", empty, rows)
        if empty.all():
            notes.append(f"{stream}: the mapped columns are empty, there is no sample")
            continue
        if stream in mapping.held:
            index = np.flatnonzero(kept)
            same = np.all([values[index[1:]] == values[index[:-1]] for values in fields.values()], axis=0)
            repeat = np.zeros(kept.size, bool)
            repeat[index[1:][same]] = True
            kept &= ~repeat
            idle += _idle(f"{stream}: {REPEATED}", repeat, rows)
        chosen: dict[str, npt.NDArray[Any]] = {"time_us": time_us, **fields}
        if not kept.all():
            chosen = {name: values[kept] for name, values in chosen.items()}
        messages[stream] = Messages(stream, chosen, rows if kept.all() else rows[kept])
    return messages, idle, notes


def _values(values: pa.ChunkedArray, item: MappedColumn) -> npt.NDArray[Any]:
    if item.dtype in ("string", "bool"):
        return np.array(values.to_pylist(), dtype=object)
    numbers = np.asarray(values.to_numpy(), dtype=np.float64)
    if item.factor != 1.0:
        numbers = numbers * item.factor
    return numbers + item.offset if item.offset != 0.0 else numbers


def _without_value(fields: Sequence[npt.NDArray[Any]], rows: int) -> npt.NDArray[np.bool_]:
    """Rows (n,) in which every field is empty."""
    empty = np.ones(rows, bool)
    for values in fields:
        # A sum that is a number has no NaN in it; most columns are full.
        with np.errstate(invalid="ignore"):
            full = values.dtype != object and not np.isnan(values.sum())
        if full:
            return np.zeros(rows, bool)
        empty &= _is_missing(values)
    return empty


def _is_missing(values: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    if values.dtype == object:
        return np.array([item is None for item in values], bool)
    missing: npt.NDArray[np.bool_] = np.isnan(values)
    return missing


def _idle(reason: str, rows: npt.NDArray[np.bool_], numbers: Rows) -> list[Skipped]:
    found = numbers[rows]
    return [Skipped(reason, 0, int(found.size), int(found[0]), int(found[-1]))] if found.size else []
