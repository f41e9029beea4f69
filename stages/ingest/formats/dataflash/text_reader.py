"""ArduPilot DataFlash logs as text (.log): recognise, and decode to columns.

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
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from pyarrow import csv

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer, Ints, Mask
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import ByteAccount, Column, DecodedLog, LogReader, Messages
from auvid.stages.ingest.formats.accounting import (
    LATEST_US,
    Losses,
    covered_seconds,
    overlapping,
    status_of,
)
from auvid.stages.ingest.formats.dataflash.byte_account import UNDEFINED
from auvid.stages.ingest.formats.dataflash.columns import Table, merge
from auvid.stages.ingest.formats.dataflash.definitions import UNKNOWN_FORMAT, WRONG_COLUMNS
from auvid.stages.ingest.formats.dataflash.metadata import (
    METADATA,
    Units,
    layout_notes,
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
DAMAGE = (NO_RECORD, WRONG_FIELDS, UNREADABLE)

CLOCKS = {"TimeUS": 1, "TimeMS": 1000}

Sliced = bytes | mmap.mmap
# The layouts of one name, each with the line from which it holds.
Declared = list[tuple[int, layout.Definition]]


@dataclass(frozen=True)
class TextLines:
    """Lines of a file: `start`, `stop` (behind the line feed), number of `commas`.

    `name` is the letters before the first comma. `losses` collects what gave nothing.
    """

    start: Ints
    stop: Ints
    commas: Ints
    name: npt.NDArray[np.uint32]
    losses: Losses

    def lose(self, reason: str, index: Ints) -> None:
        """Account for lines that gave nothing."""
        self.losses.add(reason, self.start[index], self.stop[index] - self.start[index])

    def texts(self, data: Sliced, index: Ints) -> list[bytes]:
        """Return the text of some lines."""
        ends = zip(self.start[index].tolist(), self.stop[index].tolist(), strict=True)
        return [data[start:stop] for start, stop in ends]


def recognises(head: bytes) -> bool:
    """Return whether a FMT line stands in the first bytes of a text file."""
    return head[:2] != layout.MAGIC and FMT_LINE.search(head) is not None


def split_lines(buffer: Buffer) -> TextLines:
    """Return all lines of a file of more than four bytes.

    Names are packed into four bytes, 0 if no comma follows within or behind them.
    """
    feeds = np.flatnonzero(buffer == ord("\n")) + 1
    stop = feeds if feeds.size and feeds[-1] == buffer.size else np.append(feeds, buffer.size)
    start = np.concatenate([[0], stop[:-1]])
    count = np.zeros(start.size, np.int64)
    for block in range(0, buffer.size, BLOCK_BYTES):
        commas = np.flatnonzero(buffer[block : block + BLOCK_BYTES] == ord(",")) + block
        line = start.searchsorted(commas, side="right") - 1
        if line.size:
            count[line[0] : line[-1] + 1] += np.bincount(line - line[0])
    width = NAME_BYTES + 1
    # A line nearer to the end of the file is too short for a record.
    first = np.minimum(start, buffer.size - width)
    letters = overlapping(buffer, f"V{width}")[first].view(np.uint8).reshape(-1, width)
    before_comma = np.logical_and.accumulate(letters != ord(","), axis=1)
    before_comma[(first != start) | before_comma[:, -1]] = False
    name = (letters * before_comma)[:, :NAME_BYTES].copy()
    return TextLines(start, stop, count, name.view(np.uint32)[:, 0], Losses())


def _sliced(buffer: Buffer) -> Sliced:
    """Return what gives the bytes of a slice of the file.

    That is the mapped file or the bytes on which the array stands, else a copy.
    """
    base = buffer.base
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, bytes | mmap.mmap) and len(base) == buffer.size:
        return base
    return buffer.tobytes()


def decode_text_log(file: RawFile, message_types: frozenset[str] | None) -> DecodedLog:
    """Decode the `message_types` of a text log, FMT among them.

    Raises:
        LogError: no line of the file can be read.
    """
    buffer = file.buffer
    log = _decode(buffer, message_types) if buffer.size > NAME_BYTES else None
    if log is None or not log.counts:
        raise LogError(
            "no line declares a message format", file=file.name, allowed="a log with FMT lines"
        )
    return log


def _decode(buffer: Buffer, message_types: frozenset[str] | None) -> DecodedLog:
    data = _sliced(buffer)
    lines = split_lines(buffer)
    members = _members(data, lines)
    declared, members["FMT"] = _declare(data, lines, members.get("FMT", np.zeros(0, np.int64)))
    tables: dict[str, Table] = {}
    counts, sizes = {}, {}
    for name, index in sorted(members.items()):
        if name not in declared:
            lines.lose(UNDEFINED.format(name), index)
            continue
        parts = []
        read = [index[:0]]
        for definition, chosen in _by_layout(declared[name], index):
            good = _with_all_fields(lines, definition, chosen)
            if message_types is None or name in message_types or name in METADATA:
                columns, good = _parse(data, lines, definition, good)
                parts.append((columns, lines.start[good]))
            read.append(good)
        lines_read = np.concatenate(read)
        if lines_read.size:
            counts[name] = lines_read.size
            sizes[name] = int((lines.stop[lines_read] - lines.start[lines_read]).sum())
            if parts:
                tables[name] = merge(parts)
    units = Units.of(tables)
    defining = sum(sizes.get(name, 0) for name in layout.DEFINITION_NAMES)
    skipped = lines.losses.skipped()
    kinds: dict[tuple[str, ...], int] = {("TimeUS",): 1, ("TimeMS",): 2}
    layouts = {
        name: [(item, kinds.get(item.columns[:1], 0)) for _, item in declared[name]]
        for name in counts
    }
    return DecodedLog(
        format=FORMAT,
        messages={
            name: Messages(name, *table, units.texts(declared[name][-1][1]))
            for name, table in tables.items()
            if message_types is None or name in message_types
        },
        counts=counts,
        account=ByteAccount(buffer.size, sum(sizes.values()) - defining, defining, skipped),
        status=status_of(skipped, at_end=(CUT_OFF,), harmless=(LEADING, BLANK)),
        seconds_lost=_seconds_lost(tables, lines.losses.starts(*DAMAGE)),
        parameters=parameters_of(tables.get("PARM")),
        texts=texts_of(tables.get("MSG")),
        notes=layout_notes(layouts),
    )


def _members(data: Sliced, lines: TextLines) -> dict[str, Ints]:
    """Return the line numbers of each message name; lines without one are lost."""
    names, group = np.unique(lines.name, return_inverse=True)
    parts = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    members: dict[str, Ints] = {}
    last = lines.start.size - 1
    labels = [name.tobytes().rstrip(b"\0") for name in names]
    definitions = [part[0] for label, part in zip(labels, parts, strict=True) if label == b"FMT"]
    first = definitions[0] if definitions else last + 1
    unended = data[-1:] != b"\n"
    for raw, index in zip(labels, parts, strict=True):
        if unended and index[-1] == last:
            lines.lose(CUT_OFF, index[-1:])
            index = index[:-1]
        if NAME.fullmatch(raw):
            members[raw.decode("ascii")] = index
            continue
        blank = np.array([not text.strip() for text in lines.texts(data, index)], np.bool_)
        lines.lose(BLANK, index[blank])
        lines.lose(LEADING, index[~blank & (index < first)])
        lines.lose(NO_RECORD, index[~blank & (index > first)])
    return members


def _declare(data: Sliced, lines: TextLines, index: Ints) -> tuple[dict[str, Declared], Ints]:
    """Return the layouts of each message name, and the lines of FMT that are sound.

    Within one log no type is declared with other field names: a declaration that
    differs in nothing else is a damaged repetition.
    """
    declared: dict[str, Declared] = {"FMT": [(0, layout.FMT)]}
    sound = []
    begin = 0  # line with which the present log begins: the FMT of FMT
    for i, text in zip(index.tolist(), lines.texts(data, index), strict=True):
        parts = [part.strip().decode("ascii", "backslashreplace") for part in text.split(b",", 5)]
        if len(parts) < 6 or not (parts[1].isdigit() and parts[2].isdigit()):
            lines.lose(WRONG_FIELDS, np.array([i]))
            continue
        _, id, length, name, formats, labels = parts
        columns = tuple(column.strip() for column in labels.split(",")) if labels else ()
        unknown = not set(formats) <= set(layout.FIELD_FORMATS)
        wrong = len(columns) != len(formats) or not all(map(LABEL.fullmatch, columns))
        if name != "FMT" and (unknown or wrong):
            lines.lose(UNKNOWN_FORMAT if unknown else WRONG_COLUMNS, np.array([i]))
            continue
        sound.append(i)
        definition = layout.Definition(int(id), int(length), name, formats, columns)
        line, earlier = declared.get(name, [(-1, None)])[-1]
        if name == "FMT":
            begin = i
        elif (
            earlier is not None and line > begin and replace(earlier, columns=columns) == definition
        ):
            if not _is_named(earlier) and _is_named(definition):
                declared[name][-1] = (line, definition)
        elif earlier != definition:
            declared.setdefault(name, []).append((i, definition))
    return declared, np.array(sound, np.int64)


def _is_named(definition: layout.Definition) -> bool:
    """Return whether no field name begins as a cell that damage took for a name."""
    return not any(column[0].isdigit() for column in definition.columns)


def _by_layout(declared: Declared, index: Ints) -> list[tuple[layout.Definition, Ints]]:
    """Return the lines under each layout; lines before the first belong to it."""
    bounds = np.searchsorted(index, [begin for begin, _ in declared[1:]])
    return list(zip((item for _, item in declared), np.split(index, bounds), strict=True))


def _is_text(char: str) -> bool:
    """Return whether a field is text: modes are printed by name, arrays freely."""
    return layout.FIELD_FORMATS[char].is_text or char in "Ma"


def _with_all_fields(lines: TextLines, definition: layout.Definition, index: Ints) -> Ints:
    """Return the lines with one comma before each field.

    A last field of text may hold more; a type without fields has one comma or two.
    """
    commas, fields = lines.commas[index], len(definition.formats)
    good = commas == fields if fields else commas <= 2
    if fields and _is_text(definition.formats[-1]):
        good = commas >= fields
    lines.lose(WRONG_FIELDS, index[~good])
    return index[good]


def _parse(
    data: Sliced, lines: TextLines, definition: layout.Definition, index: Ints
) -> tuple[dict[str, Column], Ints]:
    """Return the columns of the lines `index`, and the lines that could be read."""
    parts = [
        _parse_rows(lines.texts(data, index[at : at + PARSED_LINES]), definition)
        for at in range(0, max(index.size, 1), PARSED_LINES)
    ]
    columns, good = parts[0]
    if len(parts) > 1:
        good = np.concatenate([part for _, part in parts])
        columns = {
            name: np.concatenate([part.pop(name) for part, _ in parts]) for name in list(columns)
        }
    for column in columns.values():
        column.flags.writeable = False
    lines.lose(UNREADABLE, index[~good])
    return columns, index[good]


def _parse_rows(rows: list[bytes], definition: layout.Definition) -> tuple[dict[str, Column], Mask]:
    """Return the columns of the lines that can be read, and which these are."""
    good = np.ones(len(rows), np.bool_)
    formats = definition.formats
    if len(rows) >= FEW_LINES and formats and not any(map(_is_text, formats)):
        columns = _parse_block(b"".join(rows), definition)
        if columns is not None:
            return columns, good
    cells = [[cell.strip() for cell in row.split(b",", len(formats))[1:]] for row in rows]
    values: list[Column] = []
    for k, char in enumerate(formats):
        texts = [row[k] for row in cells]
        if _is_text(char):
            values.append(np.array(texts, "S") if texts else np.zeros(0, "S1"))
            continue
        numbers, readable = _numbers(texts, char)
        values.append(numbers)
        good &= readable
    readable_values = (column[good] for column in values)
    return dict(zip(definition.columns, readable_values, strict=True)), good


def _column_type(char: str) -> np.dtype[np.generic]:
    """Return the dtype of a column of numbers.

    Text may hold more digits than the binary field: integers become (u)int64, all other
    numbers float64.
    """
    form = layout.FIELD_FORMATS[char]
    if form.factor is not None or np.dtype(form.dtype).kind == "f":
        return np.dtype(np.float64)
    return np.dtype(np.uint64 if form.dtype == "<u8" else np.int64)


def _parse_block(block: bytes, definition: layout.Definition) -> dict[str, Column] | None:
    """Return all columns of a type without text fields; None if a cell is no number."""
    declared = [_column_type(char) for char in definition.formats]
    names = [str(k) for k in range(len(declared))]
    floats = [np.dtype(np.float64)] * len(names)
    for types in (declared, floats):  # firmware prints some integer fields with decimals
        arrow = dict(zip(names, map(pa.from_numpy_dtype, types), strict=True))
        try:
            table = csv.read_csv(
                pa.py_buffer(block),
                read_options=csv.ReadOptions(column_names=["name", *names], use_threads=False),
                parse_options=csv.ParseOptions(quote_char=False),
                convert_options=csv.ConvertOptions(
                    column_types=arrow, include_columns=names, null_values=[]
                ),
            )
        except pa.ArrowInvalid:
            continue
        values = map(_fitted, (table[name].to_numpy() for name in names), declared)
        return dict(zip(definition.columns, values, strict=True))
    return None


def _fitted(values: Column, dtype: np.dtype[np.generic]) -> Column:
    """Return whole, exact float64 numbers of an integer field as integers."""
    if values.dtype == dtype or dtype.kind == "f":
        return values
    numbers = values.astype(np.float64)
    exact = (np.abs(numbers) < 2.0**53) & (numbers == np.floor(numbers))
    return numbers.astype(dtype) if exact.all() else numbers


def _numbers(texts: Sequence[bytes], char: str) -> tuple[Column, Mask]:
    """Return the numbers in `texts`, and where they could be read (0 elsewhere)."""
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


def _seconds_lost(tables: Mapping[str, Table], starts: Sequence[int]) -> float:
    """Return the seconds between the records around damaged lines.

    The clock is that of the decoded types that have a time.
    """
    parts = []
    for columns, offset in tables.values():
        name = next(iter(columns), "")
        if name in CLOCKS:
            sound = np.abs(columns[name].astype(np.float64)) * CLOCKS[name] < LATEST_US
            stamps = columns[name][sound].astype(np.int64) * CLOCKS[name]
            parts.append((offset[sound], stamps))
    if not parts or not starts:
        return 0.0
    offset, times = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(offset)
    return covered_seconds(offset[order], times[order], starts)


DATAFLASH_TEXT = LogReader("dataflash_text", recognises, decode_text_log)
