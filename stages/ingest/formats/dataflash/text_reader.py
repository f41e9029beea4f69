"""ArduPilot DataFlash logs as text (.log): recognise, and decode to columns with an
account of every byte.

One line is one record: message name, then the fields, separated by commas. FMT lines
declare names and formats as in binary logs, but numbers are printed in the declared
unit already. Lines that no FMT declares are counted. Numeric types are parsed by
pyarrow, a whole type at a time; types with text fields, and blocks with an unreadable
cell, line by line.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from pyarrow import csv

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer, Ints
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import ByteAccount, DecodedLog, LogStatus, Messages, Skipped
from auvid.stages.ingest.formats.dataflash.byte_account import UNDEFINED, covered_seconds
from auvid.stages.ingest.formats.dataflash.columns import Column, merge
from auvid.stages.ingest.formats.dataflash.definitions import UNKNOWN_FORMAT, WRONG_COLUMNS
from auvid.stages.ingest.formats.dataflash.metadata import (
    NEEDED,
    UNTIMED,
    Table,
    Units,
    parameters_of,
    texts_of,
)

FORMAT = "ArduPilot DataFlash text"
FMT_LINE = re.compile(rb"^FMT, ?\d+, ?\d+, ?\w", re.MULTILINE)
NAME = re.compile(rb"[A-Za-z][A-Za-z0-9_]*")
LABEL = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.]*")
NAME_BYTES = 4
BLOCK_BYTES = 1 << 20
PARSED_LINES = 1 << 14  # of one type at a time
FEW_LINES = 64  # below this a block is parsed line by line: setting up pyarrow takes longer

LEADING = "text before the first definition"
BLANK = "blank line"
CUT_OFF = "line cut off by the end of the file"
NO_RECORD = "line that is not a record"
WRONG_FIELDS = "line with a wrong number of fields"
UNREADABLE = "line with an unreadable number"
HARMLESS = frozenset({LEADING, BLANK})
DAMAGE = frozenset({NO_RECORD, WRONG_FIELDS, UNREADABLE})

CLOCKS = {"TimeUS": 1, "TimeMS": 1000}
LATEST_US = 1 << 62  # beyond it digits of a time stamp are damaged

Sliced = bytes | mmap.mmap
Declared = list[
    tuple[int, layout.Definition]
]  # the layouts of one name, each with the line from which it holds


@dataclass(frozen=True)
class Lines:
    """Every line of the file: `start`, `stop` (behind its line feed), number of
    `commas`, `name` (the letters before the first one).
    """

    start: Ints
    stop: Ints
    commas: Ints
    name: npt.NDArray[np.uint32]


@dataclass(frozen=True)
class Losses:
    """Numbers of the lines that gave nothing, by reason."""

    lines: Lines
    by_reason: dict[str, list[Ints]] = field(default_factory=dict)

    def add(self, reason: str, index: Ints) -> None:
        if index.size:
            self.by_reason.setdefault(reason, []).append(index)

    def skipped(self) -> tuple[Skipped, ...]:
        out = []
        for reason in sorted(self.by_reason):
            index = np.concatenate(self.by_reason[reason])
            start, stop = self.lines.start[index], self.lines.stop[index]
            out.append(
                Skipped(
                    reason,
                    int((stop - start).sum()),
                    index.size,
                    int(start.min()),
                    int(start.max()),
                )
            )
        return tuple(out)

    def status(self) -> LogStatus:
        reasons = set(self.by_reason) - HARMLESS
        return "complete" if not reasons else "truncated" if reasons == {CUT_OFF} else "damaged"

    def damaged(self) -> list[int]:
        parts = [part for reason in DAMAGE for part in self.by_reason.get(reason, ())]
        return sorted(self.lines.start[np.concatenate(parts)].tolist()) if parts else []


class DataFlashTextReader:
    """Reader of DataFlash logs in text form."""

    name = "dataflash_text"

    def recognises(self, head: bytes) -> bool:
        """True if a FMT line stands in the first bytes and no binary record starts the
        file.
        """
        return head[:2] != layout.MAGIC and FMT_LINE.search(head) is not None

    def read(self, file: RawFile, wanted: frozenset[str] | None = None) -> DecodedLog:
        """Decode a text log held in memory or memory-mapped.

        Args:
            file: name and bytes. wanted: message types to decode; None means all, FMT
            among them. All types are counted.

        Raises:
            LogError: the file is empty or no line of it can be read.
        """
        buffer = np.ascontiguousarray(file.buffer, np.uint8).reshape(-1)
        if buffer.size == 0:
            raise LogError(
                "the file is empty", file=file.name, remedy="Copy the log from the vehicle again."
            )
        if buffer.size <= NAME_BYTES or not (log := _decode(buffer, wanted)).counts:
            raise LogError(
                "no line declares a message format", file=file.name, allowed="a log with FMT lines"
            )
        return log


def split_lines(buffer: Buffer) -> Lines:
    """All lines of a file of more than four bytes; names are packed into four bytes, 0
    if no comma follows within or behind them.
    """
    feeds = np.flatnonzero(buffer == ord("\n")) + 1
    stop = feeds if feeds.size and feeds[-1] == buffer.size else np.append(feeds, buffer.size)
    start = np.concatenate([[0], stop[:-1]])
    count = np.zeros(start.size, np.int64)
    for block in range(0, buffer.size, BLOCK_BYTES):
        of = (
            start.searchsorted(
                np.flatnonzero(buffer[block : block + BLOCK_BYTES] == ord(",")) + block,
                side="right",
            )
            - 1
        )
        if of.size:
            count[of[0] : of[-1] + 1] += np.bincount(of - of[0])
    width = NAME_BYTES + 1
    first = np.minimum(
        start, buffer.size - width
    )  # a line nearer to the end of the file is too short for a record
    letters = (
        np.ndarray((buffer.size - width + 1,), f"V{width}", buffer, 0, (1,))[first]
        .view(np.uint8)
        .reshape(-1, width)
    )
    before_comma = np.logical_and.accumulate(letters != ord(","), axis=1)
    before_comma[(first != start) | before_comma[:, -1]] = False
    name = (letters * before_comma)[:, :NAME_BYTES].copy()
    return Lines(start, stop, count, name.view(np.uint32)[:, 0])


def _sliced(buffer: Buffer) -> Sliced:
    """What gives the bytes of a slice of the file: where the array stands on a mapped
    file or on bytes these themselves, else a copy.
    """
    base = buffer.base
    while isinstance(base, np.ndarray):
        base = base.base
    return (
        base
        if isinstance(base, bytes | mmap.mmap) and len(base) == buffer.size
        else buffer.tobytes()
    )


def _decode(buffer: Buffer, wanted: frozenset[str] | None) -> DecodedLog:
    data = _sliced(buffer)
    lines = split_lines(buffer)
    losses = Losses(lines)
    members = _members(data, lines, losses)
    declared, members["FMT"] = _declare(
        data, lines, members.get("FMT", np.zeros(0, np.int64)), losses
    )
    tables: dict[str, Table] = {}
    read: dict[str, list[Ints]] = {}
    for name, index in sorted(members.items()):
        if name not in declared:
            losses.add(UNDEFINED.format(name), index)
            continue
        parts = []
        for definition, chosen in _by_layout(declared[name], index):
            good = _with_all_fields(lines, definition, chosen, losses)
            if wanted is None or name in wanted or name in NEEDED:
                columns, good = _parse(data, lines, definition, good, losses)
                parts.append((columns, lines.start[good]))
            if good.size:
                read.setdefault(name, []).append(good)
        if name in read and parts:
            tables[name] = parts[0] if len(parts) == 1 else merge(parts)
    units = Units.of(tables)
    size = {
        name: sum(int((lines.stop[part] - lines.start[part]).sum()) for part in parts)
        for name, parts in read.items()
    }
    defining = sum(size[name] for name in layout.DEFINITION_NAMES & set(size))
    return DecodedLog(
        format=FORMAT,
        messages={
            name: Messages(name, *table, units.texts(declared[name][-1][1]))
            for name, table in tables.items()
            if wanted is None or name in wanted
        },
        counts={name: sum(part.size for part in parts) for name, parts in read.items()},
        account=ByteAccount(buffer.size, sum(size.values()) - defining, defining, losses.skipped()),
        status=losses.status(),
        seconds_lost=_seconds_lost(tables, losses.damaged()),
        parameters=parameters_of(tables.get("PARM")),
        texts=texts_of(tables.get("MSG")),
        notes=tuple(_notes(declared, list(read))),
    )


def _members(data: Sliced, lines: Lines, losses: Losses) -> dict[str, Ints]:
    """The line numbers of each message name; lines without one are put to the losses."""
    names, group = np.unique(lines.name, return_inverse=True)
    parts = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    members: dict[str, Ints] = {}
    last = lines.start.size - 1
    labels = [name.tobytes().rstrip(b"\0") for name in names]
    first = next(
        (int(index[0]) for label, index in zip(labels, parts, strict=True) if label == b"FMT"),
        last + 1,
    )
    unended = data[-1:] != b"\n"
    for raw, index in zip(labels, parts, strict=True):
        if unended and index[-1] == last:
            losses.add(CUT_OFF, index[-1:])
            index = index[:-1]
        if NAME.fullmatch(raw):
            members[raw.decode("ascii")] = index
            continue
        blank = np.array(
            [not data[lines.start[i] : lines.stop[i]].strip() for i in index.tolist()], np.bool_
        )
        losses.add(BLANK, index[blank])
        losses.add(LEADING, index[~blank & (index < first)])
        losses.add(NO_RECORD, index[~blank & (index > first)])
    return members


def _declare(
    data: Sliced, lines: Lines, index: Ints, losses: Losses
) -> tuple[dict[str, Declared], Ints]:
    """The layouts of each message name with the line numbers from which they hold, and
    the lines of FMT that are sound.

    Within one log no type is declared with other field names: a declaration that
    differs in nothing else is a damaged repetition.
    """
    declared: dict[str, Declared] = {"FMT": [(0, layout.FMT)]}
    sound = []
    begin = 0  # line with which the present log begins: the FMT of FMT
    for i in index.tolist():
        parts = [
            part.strip().decode("ascii", "backslashreplace")
            for part in data[lines.start[i] : lines.stop[i]].split(b",", 5)
        ]
        if len(parts) < 6 or not (parts[1].isdigit() and parts[2].isdigit()):
            losses.add(WRONG_FIELDS, np.array([i]))
            continue
        id, length, name, formats = int(parts[1]), int(parts[2]), parts[3], parts[4]
        columns = tuple(column.strip() for column in parts[5].split(",")) if parts[5] else ()
        unknown = not set(formats) <= set(layout.FIELD_FORMATS)
        if name != "FMT" and (
            unknown or len(columns) != len(formats) or not all(map(LABEL.fullmatch, columns))
        ):
            losses.add(UNKNOWN_FORMAT if unknown else WRONG_COLUMNS, np.array([i]))
            continue
        sound.append(i)
        definition = layout.Definition(id, length, name, formats, columns)
        line, known = declared.get(name, [(-1, None)])[-1]
        if name == "FMT":
            begin = i
        elif known is not None and line > begin and replace(known, columns=columns) == definition:
            if not _named(known) and _named(definition):
                declared[name][-1] = (line, definition)
        elif known != definition:
            declared.setdefault(name, []).append((i, definition))
    return declared, np.array(sound, np.int64)


def _named(definition: layout.Definition) -> bool:
    return not any(
        column[0].isdigit() for column in definition.columns
    )  # as cells do, which a damaged line takes for names


def _by_layout(declared: Declared, index: Ints) -> list[tuple[layout.Definition, Ints]]:
    """The lines under each layout; lines before the first declaration belong to it."""
    bounds = np.searchsorted(
        index, [0, *(begin for begin, _ in declared[1:]), np.iinfo(np.int64).max]
    )
    return [
        (definition, index[bounds[k] : bounds[k + 1]]) for k, (_, definition) in enumerate(declared)
    ]


def _is_text(char: str) -> bool:
    """Modes are printed by name; arrays as the logger likes."""
    return layout.FIELD_FORMATS[char].is_text or char in "Ma"


def _with_all_fields(
    lines: Lines, definition: layout.Definition, index: Ints, losses: Losses
) -> Ints:
    """The lines with one comma before each field. A last field of text may hold more; a
    type without fields has one comma or two.
    """
    commas, fields = lines.commas[index], len(definition.formats)
    good = commas == fields if fields else commas <= 2
    if fields and _is_text(definition.formats[-1]):
        good = commas >= fields
    losses.add(WRONG_FIELDS, index[~good])
    return index[good]


def _parse(
    data: Sliced, lines: Lines, definition: layout.Definition, index: Ints, losses: Losses
) -> tuple[dict[str, Column], Ints]:
    """The columns of the lines `index` and the numbers of the lines that could be read."""
    parts = [
        _parse_lines(data, lines, definition, index[at : at + PARSED_LINES])
        for at in range(0, max(index.size, 1), PARSED_LINES)
    ]
    if len(parts) == 1:
        columns, good = parts[0]
    else:
        good = np.concatenate([part for _, part in parts])
        columns = {
            name: _frozen(np.concatenate([part.pop(name) for part, _ in parts]))
            for name in list(parts[0][0])
        }
    losses.add(UNREADABLE, index[~good])
    return columns, index[good]


def _parse_lines(
    data: Sliced, lines: Lines, definition: layout.Definition, index: Ints
) -> tuple[dict[str, Column], npt.NDArray[np.bool_]]:
    """The columns of the lines that can be read, and which of `index` they are."""
    rows = [
        data[start:stop]
        for start, stop in zip(lines.start[index].tolist(), lines.stop[index].tolist(), strict=True)
    ]
    good = np.ones(index.size, np.bool_)
    if len(rows) >= FEW_LINES and definition.formats and not any(map(_is_text, definition.formats)):
        columns = _parse_block(b"".join(rows), definition)
        if columns is not None:
            return columns, good
    cells = [
        [cell.strip() for cell in row.split(b",", len(definition.formats))[1:]] for row in rows
    ]
    values: list[npt.NDArray[np.generic]] = []
    for k, char in enumerate(definition.formats):
        texts = [row[k] for row in cells]
        if _is_text(char):
            values.append(np.array(texts, "S") if texts else np.zeros(0, "S1"))
            continue
        numbers, readable = _numbers(texts, char)
        values.append(numbers)
        good &= readable
    return {
        name: _frozen(column[good]) for name, column in zip(definition.columns, values, strict=True)
    }, good


def _column_type(char: str) -> np.dtype[np.generic]:
    """Text may hold more digits than the binary field: integers become (u)int64, all
    other numbers float64.
    """
    form = layout.FIELD_FORMATS[char]
    kind = np.dtype(form.dtype).kind
    if form.factor is not None or kind == "f":
        return np.dtype(np.float64)
    return np.dtype(np.uint64 if form.dtype == "<u8" else np.int64)


def _parse_block(block: bytes, definition: layout.Definition) -> dict[str, Column] | None:
    """All columns of a type without text fields; None if a cell is no number."""
    names = [str(k) for k in range(len(definition.formats))]
    declared = [_column_type(char) for char in definition.formats]
    for types in (
        declared,
        [np.dtype(np.float64)] * len(names),
    ):  # firmware prints some integer fields with decimals
        try:
            table = csv.read_csv(
                pa.py_buffer(block),
                read_options=csv.ReadOptions(column_names=["name", *names], use_threads=False),
                parse_options=csv.ParseOptions(quote_char=False),
                convert_options=csv.ConvertOptions(
                    column_types={
                        name: pa.from_numpy_dtype(dtype)
                        for name, dtype in zip(names, types, strict=True)
                    },
                    include_columns=names,
                    null_values=[],
                ),
            )
        except pa.ArrowInvalid:
            continue
        values = [table[name].to_numpy() for name in names]
        return {
            name: _frozen(_fitted(*pair))
            for name, *pair in zip(definition.columns, values, declared, strict=True)
        }
    return None


def _fitted(
    values: npt.NDArray[np.generic], dtype: np.dtype[np.generic]
) -> npt.NDArray[np.generic]:
    """Numbers of an integer field that came as float64: integers if all of them are
    whole and exact, else as they are.
    """
    if values.dtype == dtype or dtype.kind == "f":
        return values
    numbers = values.astype(np.float64)
    exact = np.abs(numbers) < 2.0**53
    return (
        numbers.astype(dtype) if bool((exact & (numbers == np.floor(numbers))).all()) else numbers
    )


def _numbers(
    texts: Sequence[bytes], char: str
) -> tuple[npt.NDArray[np.generic], npt.NDArray[np.bool_]]:
    """The numbers in `texts`, and where they could be read (0 elsewhere)."""
    dtype = _column_type(char)
    readable = np.ones(len(texts), np.bool_)
    numbers: list[float] = []
    for i, text in enumerate(texts):
        try:
            numbers.append(float(text) if dtype.kind == "f" or b"." in text else int(text))
        except ValueError:
            numbers.append(0)
            readable[i] = False
    try:
        if all(isinstance(number, int) for number in numbers):
            return np.array(numbers, dtype), readable
        return _fitted(np.array(numbers, np.float64), dtype), readable
    except OverflowError:
        return np.array(numbers, np.float64), readable


def _frozen(column: npt.NDArray[np.generic]) -> Column:
    column.flags.writeable = False
    return column


def _seconds_lost(tables: Mapping[str, Table], starts: Sequence[int]) -> float:
    """Seconds between the records around damaged lines, from the decoded types that
    have a time.
    """
    parts = []
    for columns, offset in tables.values():
        for field_name, factor in CLOCKS.items():
            if next(iter(columns), None) == field_name:
                stamps = columns[field_name].astype(np.float64)
                sound = np.abs(stamps) * factor < LATEST_US
                parts.append((offset[sound], columns[field_name][sound].astype(np.int64) * factor))
    if not parts or not starts:
        return 0.0
    offset, times = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(offset)
    return covered_seconds(offset[order], times[order], starts)


def _notes(declared: Mapping[str, Declared], names: Sequence[str]) -> list[str]:
    notes = []
    clocks = {name: {definition.columns[:1] for _, definition in declared[name]} for name in names}
    if any(("TimeMS",) in first for first in clocks.values()):
        notes.append(
            "Times are milliseconds since boot (TimeMS), as firmware before 2015 writes them."
        )
    if set(names) <= layout.DEFINITION_NAMES:
        notes.append("The log holds definitions only, no recorded data.")
    several = [name for name in names if len(declared[name]) > 1]
    if several:
        notes.append(f"Declared with several layouts, joined by field name: {', '.join(several)}.")
    timeless = [
        name
        for name in names
        if name not in UNTIMED and not clocks[name] & {(field_name,) for field_name in CLOCKS}
    ]
    timeless = [
        name for name in timeless if "T" not in declared[name][-1][1].columns
    ]  # GPS records of old firmware have it as T
    if timeless:
        notes.append(f"Without a time field of the vehicle's clock: {', '.join(timeless)}.")
    return notes


DATAFLASH_TEXT = DataFlashTextReader()
