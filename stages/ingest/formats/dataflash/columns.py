"""Columns of a DataFlash record type: gather records, unpack and scale their fields."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer, Ints
from auvid.hydro.long_series.long_arrays import laid_down, let_go
from auvid.stages.ingest.decoded_log import Column
from auvid.stages.ingest.formats.accounting import GATHER_BYTES, cut_at_nul, overlapping

LET_GO_BLOCKS = 64
"""Blocks of records after which pages of a long file go."""
Table = tuple[dict[str, Column], Ints]  # columns, byte offset of each record


def column_dtype(char: str) -> np.dtype[np.generic]:
    """Return the dtype of a decoded column.

    Scaled integers are float64, half floats float32, all else as stored.
    """
    form = layout.FIELD_FORMATS[char]
    if form.factor is not None:
        return np.dtype(np.float64)
    return np.dtype(np.float32) if form.dtype == "<f2" else layout.field_dtype(form.dtype)


def unpack(buffer: Buffer, definition: layout.Definition, offset: Ints) -> dict[str, Column]:
    """Return the fields of the records at `offset` as read-only columns.

    All records are of this definition and whole inside the buffer. Of two fields with
    one name the last is kept. Text is cut at its first NUL, except the raw contents
    that FILE records carry.
    """
    formats = definition.formats[: len(definition.columns)]
    dtypes = [column_dtype(char) for char in formats]
    out: list[Column] = [np.empty((offset.size, *item.shape), item.base) for item in dtypes]
    records = overlapping(buffer, f"V{definition.length}")
    step = max(1, GATHER_BYTES // definition.length)
    for start in range(0, offset.size, step):
        part = slice(start, start + step)
        if start % (LET_GO_BLOCKS * step) == 0:
            let_go()
        block = records[offset[part]].view(definition.record)
        for i, char in enumerate(formats):
            factor = layout.FIELD_FORMATS[char].factor
            if factor is None:
                out[i][part] = block[f"f{i}"]
            else:
                # Dividing by the rounded inverse gives the nearest double to the
                # decimal number; multiplying would not.
                np.divide(block[f"f{i}"], 1 / factor, out=out[i][part])
    let_go()
    for char, column in zip(formats, out, strict=True):
        if layout.FIELD_FORMATS[char].is_text and not (definition.name == "FILE" and char == "Z"):
            cut_at_nul(column)
        column.flags.writeable = False
    return dict(zip(definition.columns, map(laid_down, out), strict=False))


def merge(parts: Sequence[Table]) -> Table:
    """Join the records of one name that were declared with several layouts.

    Records stand in file order. A field that a layout lacks is NaN there (empty for
    text, 0 for arrays); integer fields become float64 for that.
    """
    if len(parts) == 1:
        return parts[0]
    offset = np.concatenate([place for _, place in parts])
    order = np.argsort(offset, kind="stable")
    joined: dict[str, Column] = {}
    for name in dict.fromkeys(name for columns, _ in parts for name in columns):
        example = next(columns[name] for columns, _ in parts if name in columns)
        pieces = [
            columns[name] if name in columns else _absent(example, place.size)
            for columns, place in parts
        ]
        if len({(piece.shape[1:], piece.dtype.kind == "S") for piece in pieces}) > 1:
            pieces = [_as_text(piece) for piece in pieces]
        column = np.concatenate(pieces)[order]
        column.flags.writeable = False
        joined[name] = column
    return joined, offset[order]


def _absent(example: Column, count: int) -> Column:
    if example.dtype.kind == "S" or example.ndim > 1:
        return np.zeros((count, *example.shape[1:]), example.dtype)
    return np.full(count, np.nan, np.float32 if example.dtype == np.float32 else np.float64)


def _as_text(piece: Column) -> Column:
    return (
        np.array([str(row) for row in piece.tolist()], "S") if piece.ndim > 1 else piece.astype("S")
    )
