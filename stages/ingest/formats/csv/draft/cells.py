"""Cells of a CSV file as text and as numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from auvid.data_schemas.errors import LogError
from auvid.hydro.arrays import Array
from auvid.stages.base import RawFile

MOST_BYTES = 1 << 24
"""Values of the first so many bytes decide on units."""


def cells_of(
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
    if not table.num_rows:
        raise LogError(
            f"no row has {len(names)} cells as the first line, which names the columns",
            file=file.name,
            row=2,
            allowed=f"rows of {len(names)} cells separated by {delimiter!r}",
            remedy="Rows with more cells have a decimal comma between commas (export them with"
            " semicolons), or separators at their end (take these off).",
        )
    once = {name for name in names if list(names).count(name) == 1}
    cells = {
        name: [text.strip() for text in table[str(index)].to_pylist()]
        for index, name in enumerate(names)
        if name in once
    }
    sample = [text for column in cells.values() for text in column[:50] if text]
    commas = sum(bool(re.fullmatch(r"-?\d+,\d+(e-?\d+)?", text)) for text in sample)
    # Beside numbers with a point, a comma separates thousands.
    points = any(
        re.fullmatch(r"-?\d*\.\d+(e-?\d+)?", text) and not _is_grouped(text) for text in sample
    )
    are_decimal = delimiter != "," and commas > 0.2 * len(sample) and not points
    return cells, "," if are_decimal else "."


def _is_grouped(text: str) -> bool:
    """Return whether a point in a number may separate thousands."""
    return re.fullmatch(r"-?[1-9]\d{0,2}(\.\d{3})+", text) is not None


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def numbers_of(cells: Sequence[str], decimal: str) -> Array:
    """Return cells as numbers (n,), nan for what is none."""
    array = np.full(len(cells), np.nan)
    for row, text in enumerate(cells):
        if decimal == "," and "." in text:
            continue
        try:
            array[row] = float(text.replace(",", ".") if decimal == "," else text)
        except ValueError:
            continue
    return array
