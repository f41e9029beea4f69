"""From record offsets to columns: gather the records of one type, unpack and scale
their fields.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Ints

GATHER_BYTES = (
    1 << 18
)  # records gathered at a time, small enough to stay in the cache while each field is copied out

Column = npt.NDArray[np.generic]


def column_dtype(char: str) -> np.dtype[np.generic]:
    """The dtype of a decoded column: scaled integers are float64, half floats float32,
    all else as stored.
    """
    form = layout.FIELD_FORMATS[char]
    if form.factor is not None:
        return np.dtype(np.float64)
    return np.dtype(np.float32) if form.dtype == "<f2" else layout.field_dtype(form.dtype)


def unpack(
    buffer: npt.NDArray[np.uint8], definition: layout.Definition, offset: Ints
) -> dict[str, Column]:
    """The fields of the records at `offset` (all of this definition, whole inside
    `buffer`) as read-only columns.

    Of two fields with one name the last is kept. Text is cut at its first NUL, except
    the raw contents that FILE records carry.
    """
    formats = definition.formats[: len(definition.columns)]
    out = [_empty(char, offset.size) for char in formats]
    dtype = definition.record
    # Overlapping records, one at every byte: indexing copies only the wanted ones
    # (np.take would copy all of them first).
    records = np.ndarray(
        (max(buffer.size - definition.length + 1, 0),), f"V{definition.length}", buffer, 0, (1,)
    )
    step = max(1, GATHER_BYTES // definition.length)
    for start in range(0, offset.size, step):
        part = slice(start, start + step)
        block = records[offset[part]].view(dtype)
        for i, char in enumerate(formats):
            factor = layout.FIELD_FORMATS[char].factor
            if factor is None:
                out[i][part] = block[f"f{i}"]
            else:
                # Dividing by the rounded inverse gives the nearest double to the
                # decimal number; multiplying would not.
                np.divide(block[f"f{i}"], 1 / factor, out=out[i][part])
    columns: dict[str, Column] = {}
    for name, char, column in zip(definition.columns, formats, out, strict=True):
        if layout.FIELD_FORMATS[char].is_text and not (definition.name == "FILE" and char == "Z"):
            cut_at_nul(column)
        column.flags.writeable = False
        columns[name] = column
    return columns


def _empty(char: str, count: int) -> npt.NDArray[np.generic]:
    dtype = column_dtype(char)
    return np.empty((count, *dtype.shape), dtype.base)


def cut_at_nul(text: Column) -> None:
    """Blank, in place, whatever stands behind the first NUL of each string."""
    if text.size:
        letters = text.view(np.uint8).reshape(text.size, text.dtype.itemsize)
        letters *= np.logical_and.accumulate(letters != 0, axis=1)


def merge(parts: Sequence[tuple[Mapping[str, Column], Ints]]) -> tuple[dict[str, Column], Ints]:
    """Join the records of one name that were declared with several layouts, in file
    order.

    A field that a layout lacks is NaN there (empty for text, 0 for arrays); integer
    fields become float64 for that.
    """
    offset = np.concatenate([part_offset for _, part_offset in parts])
    order = np.argsort(offset, kind="stable")
    names = list(dict.fromkeys(name for columns, _ in parts for name in columns))
    joined: dict[str, Column] = {}
    for name in names:
        pieces = [
            _piece(columns.get(name), name, parts, part_offset.size)
            for columns, part_offset in parts
        ]
        if (
            len({piece.shape[1:] for piece in pieces}) > 1
            or len({piece.dtype.kind == "S" for piece in pieces}) > 1
        ):
            pieces = [_as_text(piece) for piece in pieces]
        column = np.concatenate(pieces)[order]
        column.flags.writeable = False
        joined[name] = column
    return joined, offset[order]


def _piece(
    column: Column | None, name: str, parts: Sequence[tuple[Mapping[str, Column], Ints]], count: int
) -> Column:
    if column is not None:
        return column
    like = next(columns[name] for columns, _ in parts if name in columns)
    if like.dtype.kind == "S" or like.ndim > 1:
        return np.zeros((count, *like.shape[1:]), like.dtype)
    return np.full(count, np.nan, np.float32 if like.dtype == np.float32 else np.float64)


def _as_text(piece: Column) -> Column:
    if piece.ndim > 1:
        return np.array([str(row.tolist()) for row in piece], "S")
    return piece if piece.dtype.kind == "S" else piece.astype("S")
