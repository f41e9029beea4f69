"""Sound rows of a CSV file that pyarrow does not read as it is.

A line without the right number of cells or with a stray quotation mark is no row.
Neither is one with a cell that cannot be read, as long as these are few: many mean that
the column map does not fit the file, and then each is named.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv

from auvid.data_schemas.errors import LogError, PipelineError, raise_faults
from auvid.hydro.arrays import Ints
from auvid.stages.ingest.formats.accounting import Losses

NUMBER = r"^\s*[-+]?(\d+\.?\d*([eE][-+]?\d+)?|\.\d+([eE][-+]?\d+)?|(?i:nan|inf|infinity))\s*$"
TRUTH = r"^(?i:true|false|0|1)$"
ISO_8601 = r"^\s*\d{4}-\d\d-\d\d([T ]\d\d(:\d\d(:\d\d(\.\d{1,9})?)?)?(Z|[-+]\d\d(:?\d\d)?)?)?\s*$"
TEXT_TIME = rf"{ISO_8601}|^\s*\d\d?:\d\d:\d\d(\.\d{{1,9}})?\s*$"
ISO_TIME = pa.timestamp("us")  # stands for a column of ISO 8601 texts, which is read as text
PLACEHOLDER = "If this text stands for an empty cell, list it under 'missing' in the column map."
DECIMAL = 'If the numbers have a decimal comma, add decimal: "," to the column map.'
THOUSANDS = (
    "If the commas separate thousands, export the numbers without them; if they are decimal"
    ' commas, add decimal: "," to the column map.'
)
PATTERNS = {
    pa.float64(): (NUMBER, "not a number"),
    pa.bool_(): (TRUTH, "neither true nor false"),
    ISO_TIME: (TEXT_TIME, "not an ISO 8601 time"),
}
UNREADABLE_SHARE = 0.05  # of the rows
NAMED_CELLS = 3
WRONG_CELLS = "row that has not {} cells"
LONGEST_ROW = 1 << 19
"""Bytes of a row: the reader of tables takes none longer than its blocks of twice that."""
LONG_ROW = "row of more than half a megabyte"
STRAY_QUOTE = "row with a stray quotation mark"
UNREADABLE = "row with a cell that cannot be read"


@dataclass(frozen=True)
class LateColumns:
    """Columns from `start` on that the first rows do not have yet."""

    start: int
    names: Sequence[str]


@dataclass(frozen=True)
class Form:
    """Layout of rows: column names, separator, decimal mark, missing values."""

    names: Sequence[str]
    delimiter: str
    decimal: str
    missing: Sequence[str]
    late: LateColumns | None = None

    def filled(self, row: bytes) -> bytes:
        """Return a row with empty cells for the late columns if it lacks these."""
        mark = self.delimiter.encode()
        if self.late is None or row.count(mark) + 1 != len(self.names) - len(self.late.names):
            return row
        cells = row.split(mark)
        cells[self.late.start : self.late.start] = [b""] * len(self.late.names)
        return mark.join(cells)

    def options(self, types: Mapping[str, pa.DataType]) -> pacsv.ConvertOptions:
        """Return options to read the columns `types`."""
        return pacsv.ConvertOptions(
            include_columns=list(types),
            column_types={
                name: pa.string() if kind == ISO_TIME else kind for name, kind in types.items()
            },
            null_values=list(self.missing),
            strings_can_be_null=True,
            decimal_point=self.decimal,
        )


@dataclass
class SoundRows:
    """The rows that could be read, and the lines that gave nothing.

    `rows` (n,) are line numbers as an editor counts them, as are the places of the
    losses.
    """

    table: pa.Table
    rows: Ints
    losses: Losses = field(default_factory=Losses)
    notes: Sequence[str] = ()


def read_sound_rows(
    data: bytes, types: Mapping[str, pa.DataType], form: Form, *, file: str
) -> SoundRows:
    """Read the columns `types` of the rows that are sound, line by line.

    Text that is not UTF-8 is read as Latin-1. Raises `LogError` if so many cells cannot
    be read that the column map must be wrong, or if there is no row at all.
    """
    lines = data.split(b"\n")
    size = {number: len(line) + (number < len(lines)) for number, line in enumerate(lines, 1)}
    losses = Losses()
    texts, numbers = [], []
    cell = re.compile(
        rb'(?:"(?:[^"]|"")*"|[^"%b]*)(?:%b|$)' % ((re.escape(form.delimiter.encode()),) * 2)
    )
    for number, line in enumerate(lines[1:], 2):
        row = form.filled(line.rstrip(b"\r"))
        if not row:
            continue
        reason = _fault_of(row, form, cell)
        if reason is None:
            texts.append(_utf8(row))
            numbers.append(number)
        else:
            losses.add(reason, number, size[number])
    rows = np.array(numbers, np.int64)
    faults = _unreadable(
        _read(texts, dict.fromkeys(types, pa.string()), form, file), types, rows, form.decimal, file
    )
    bad = np.isin(rows, np.array([fault.row for fault in faults], np.int64))
    if bad.sum() > UNREADABLE_SHARE * rows.size:
        raise_faults(faults, file=file)
    for number in rows[bad].tolist():
        losses.add(UNREADABLE, number, size[number])
    table = _read(
        [text for text, left_out in zip(texts, bad.tolist(), strict=True) if not left_out],
        types,
        form,
        file,
    )
    notes = [
        f"{file}, row {fault.row}: {fault.field} is {fault.value!r}; the row is left out"
        for fault in faults[:NAMED_CELLS]
    ]
    return SoundRows(table, rows[~bad], losses, notes)


def _fault_of(row: bytes, form: Form, cell: re.Pattern[bytes]) -> str | None:
    if len(row) >= LONGEST_ROW:
        return LONG_ROW
    delimiter = form.delimiter.encode()
    count, place = row.count(delimiter) + 1, 0
    if b'"' in row:
        count = int(row.endswith(delimiter))
        while place < len(row):
            match = cell.match(row, place)
            if match is None or match.end() == place:
                return STRAY_QUOTE
            count, place = count + 1, match.end()
    return None if count == len(form.names) else WRONG_CELLS.format(len(form.names))


def _utf8(row: bytes) -> bytes:
    try:
        row.decode("utf-8")
    except UnicodeDecodeError:
        return row.decode("latin-1").encode("utf-8")
    return row


def _read(
    texts: Sequence[bytes], types: Mapping[str, pa.DataType], form: Form, file: str
) -> pa.Table:
    if not texts:
        raise LogError(
            "no row can be read",
            file=file,
            allowed=f"rows of {len(form.names)} cells separated by {form.delimiter!r}",
        )
    try:
        table = pacsv.read_csv(
            pa.BufferReader(b"\n".join(texts)),
            read_options=pacsv.ReadOptions(column_names=list(form.names), use_threads=False),
            parse_options=pacsv.ParseOptions(delimiter=form.delimiter),
            convert_options=form.options(types),
        )
    except pa.ArrowInvalid as fault:
        raise LogError(f"cannot be read as CSV: {fault}", file=file) from None
    if table.num_rows != len(texts):
        raise LogError("cannot be read as CSV: rows run into each other", file=file)
    return table


def _unreadable(
    texts: pa.Table, types: Mapping[str, pa.DataType], rows: Ints, decimal: str, file: str
) -> list[PipelineError]:
    """Return one fault per cell that is no value of its column's type."""
    faults: list[PipelineError] = []
    for name, kind in types.items():
        if kind == pa.string():
            continue
        values = texts[name] if decimal == "." else pc.replace_substring(texts[name], decimal, ".")
        pattern, what = PATTERNS[kind]
        bad = np.flatnonzero(
            np.asarray(pc.fill_null(pc.invert(pc.match_substring_regex(values, pattern)), False))
        )
        faults += [
            LogError(
                what,
                file=file,
                row=int(rows[index]),
                field=name,
                value=texts[name][int(index)].as_py(),
                remedy=_remedy(str(texts[name][int(index)]), decimal),
            )
            for index in bad
        ]
    return faults


def _remedy(cell: str, decimal: str) -> str:
    """Return what to do about a cell that is no value of its column's type.

    >>> _remedy("1,534", ".") == THOUSANDS, _remedy("1,5", ".") == DECIMAL
    (True, True)
    """
    if decimal == "." and re.fullmatch(r"[-+]?\d{1,3}(,\d{3})+(\.\d+)?", cell):
        return THOUSANDS
    return DECIMAL if decimal == "." and re.fullmatch(r"[-+]?\d*,\d+", cell) else PLACEHOLDER
