"""Arrow tables that agree with their schema: made, checked, and read as numpy arrays.

Unit, frame and meaning of each column travel in the Arrow field metadata and so into
the Parquet file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.errors import PipelineError, SchemaError, nearest, raise_faults
from auvid.data_schemas.schemas import Field, schema

ARROW = {
    "bool": pa.bool_(),
    "int16": pa.int16(),
    "int32": pa.int32(),
    "int64": pa.int64(),
    "float32": pa.float32(),
    "float64": pa.float64(),
    "string": pa.string(),
}

PLAIN = {kind: np.dtype(name) for name, kind in ARROW.items() if name != "string"}
"""Numbers that Arrow holds as numpy does, but for the bits of `bool`."""
LISTED: dict[pa.DataType, set[type]] = {
    pa.bool_(): {bool, np.bool_},
    pa.int64(): {int, np.int64},
    pa.float64(): {int, float, np.float64},
}
"""Types of the numbers of a list that fit without a loss."""


def _arrow_field(column: Field) -> pa.Field:
    metadata = {"unit": column.unit, "frame": column.frame, "meaning": column.meaning}
    return pa.field(
        column.name,
        ARROW[column.dtype],
        nullable=column.nullable or column.dtype.startswith("float"),
        metadata=metadata,
    )


@dataclass(frozen=True)
class TableParts:
    """A table without a clock whose rows are made while it is written.

    `make` gives its parts, one after another, of which one is in memory at a time.
    """

    make: Callable[[], Iterator[pa.Table]]


def make_table(name: str, columns: Mapping[str, Any]) -> pa.Table:
    """Return a checked table of schema `name` from its columns.

    The columns are numpy arrays, lists or Arrow arrays of one length.

    Columns come out in the order of the schema. Raises `SchemaError` naming every
    unknown, missing or ill-typed column.
    """
    spec = schema(name)
    unknown = [key for key in columns if key not in spec.columns]
    if unknown:
        raise SchemaError(
            "unknown column",
            file=f"table '{name}'",
            field=unknown[0],
            remedy=nearest(unknown[0], spec.columns),
        )
    fields = [_arrow_field(spec.columns[key]) for key in spec.columns if key in columns]
    arrays = []
    for target in fields:
        try:
            arrays.append(arrow_array(columns[target.name], target.type))
        except (pa.ArrowInvalid, pa.ArrowTypeError, TypeError) as fault:
            raise SchemaError(
                f"cannot hold these values: {fault}", file=f"table '{name}'", field=target.name
            ) from fault
    if len({len(array) for array in arrays}) > 1:
        raise SchemaError(
            "columns differ in length",
            file=f"table '{name}'",
            value={f.name: len(a) for f, a in zip(fields, arrays, strict=True)},
        )
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata={"auvid_schema": name}))
    check_table(table, name)
    return table


def arrow_array(values: Any, kind: pa.DataType) -> pa.Array:
    """Return an Arrow array of a type.

    Numbers of that type go over as they lie in memory, and plain lists and texts by numpy
    and a builder: `pa.array` imports pandas, which takes .4 s and 45 MB.
    """
    if isinstance(values, np.ndarray) and values.ndim == 1:
        if pa.types.is_string(kind) and values.dtype.kind in "OU":
            values = values.tolist()
        elif kind in PLAIN and np.can_cast(values.dtype, PLAIN[kind], "safe"):
            return _from_numbers(values.astype(PLAIN[kind], copy=False), kind)
    if isinstance(values, list):
        types = set(map(type, values)) - {type(None)}
        if pa.types.is_string(kind) and types <= {str}:
            return _texts(values)
        if kind in LISTED and types <= LISTED[kind]:
            there = np.array([value is not None for value in values], dtype=bool)
            plain = [0 if value is None else value for value in values]
            return _from_numbers(np.array(plain, dtype=PLAIN[kind]), kind, there)
    return pa.array(values, type=kind, from_pandas=False)


def _texts(values: Sequence[str | None]) -> pa.Array:
    builder = pa.lib.StringBuilder()
    builder.append_values(values)
    return builder.finish()


def labels(names: Sequence[str], count: int) -> pa.Array:
    """Return a column of texts: each of the names so many times, one after the other.

    >>> labels(["a", "b"], 2).to_pylist()
    ['a', 'a', 'b', 'b']
    """
    codes = np.repeat(np.arange(len(names), dtype=np.int32), count)
    return _texts(names).take(_from_numbers(codes, pa.int32()))


def _from_numbers(
    values: npt.NDArray[Any], kind: pa.DataType, there: npt.NDArray[np.bool_] | None = None
) -> pa.Array:
    """Return the Arrow array of numbers of its own type, null where none is `there`."""
    cells = _bits(values) if kind == pa.bool_() else pa.py_buffer(np.ascontiguousarray(values))
    nulls = None if there is None or there.all() else _bits(there)
    return pa.Array.from_buffers(kind, len(values), [nulls, cells])


def _bits(values: npt.NDArray[Any]) -> pa.Buffer:
    return pa.py_buffer(np.packbits(values, bitorder="little"))


def check_table(table: pa.Table, name: str, *, file: object = None, in_part: bool = False) -> None:
    """Check a table against schema `name` and raise all faults together.

    Columns, types, nulls, NaN, ranges and the clock are checked; a table read `in_part`
    may miss columns.
    """
    spec = schema(name)
    where = file if file is not None else f"table '{name}'"
    faults: list[PipelineError] = []
    places = {key: place for place, key in enumerate(table.column_names)}
    for key in table.column_names:
        if key not in spec.columns:
            faults.append(
                SchemaError(
                    "unknown column", file=where, field=key, remedy=nearest(key, spec.columns)
                )
            )
    for column in spec.columns.values():
        if column.name not in places:
            if not (column.optional or in_part):
                faults.append(SchemaError("missing column", file=where, field=column.name))
            continue
        faults += _column_faults(table.column(places[column.name]), column, where)
    if spec.clock and not faults and table.num_rows > 1:
        steps = np.diff(numbers(table[spec.clock]))
        bad = np.flatnonzero(steps <= 0)
        if bad.size:
            faults.append(
                SchemaError(
                    "time does not increase",
                    file=where,
                    row=int(bad[0]) + 2,
                    field=spec.clock,
                    value=float(steps[bad[0]]),
                )
            )
    raise_faults(faults, file=where)


def _column_faults(values: pa.ChunkedArray, column: Field, where: object) -> list[PipelineError]:
    if values.type != ARROW[column.dtype]:
        return [
            SchemaError(
                "wrong type",
                file=where,
                field=column.name,
                value=str(values.type),
                allowed=column.dtype,
            )
        ]
    if column.dtype == "string":
        if not column.nullable and values.null_count:
            return [SchemaError(f"{values.null_count} empty cells", file=where, field=column.name)]
        return []
    if not column.nullable:
        empty = values.null_count
        if column.dtype.startswith("float"):
            empty += int(np.isnan(numbers(values)).sum()) - values.null_count
        if empty:
            return [
                SchemaError(
                    f"{empty} empty or NaN cells",
                    file=where,
                    field=column.name,
                    allowed="numbers only",
                )
            ]
    if column.range is not None and len(values):
        (low, high), array = column.range, numbers(values)
        if array.min() >= low and array.max() <= high:  # false beside a NaN
            return []
        bad = np.flatnonzero((array < low) | (array > high))
        if bad.size:
            return [
                SchemaError(
                    f"{bad.size} values out of range",
                    file=where,
                    row=int(bad[0]) + 2,
                    field=column.name,
                    value=float(array[bad[0]]),
                    allowed=f"{low:g} to {high:g} {column.unit}",
                )
            ]
    return []


def numbers(values: pa.ChunkedArray) -> npt.NDArray[Any]:
    """Return a column (n,) as a numpy array of its own type; nulls become NaN.

    It is a read-only view where the column lies in one piece.

    `to_numpy` of pyarrow does the same but imports pandas.
    """
    kind = values.type
    if not pa.types.is_primitive(kind) or kind == pa.bool_():
        return np.asarray(values.to_numpy())
    dtype = np.dtype(kind.to_pandas_dtype())
    parts = [_cells(part, dtype) for part in values.chunks if len(part)]
    return parts[0] if len(parts) == 1 else np.concatenate(parts) if parts else np.zeros(0, dtype)


def _cells(part: pa.Array, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """Return the numbers of an Arrow array, nan for null."""
    of = slice(part.offset, part.offset + len(part))
    bits, cells = part.buffers()
    values = np.frombuffer(cells, dtype=dtype)[of]
    if not part.null_count:
        return values
    there = np.unpackbits(np.frombuffer(bits, dtype=np.uint8), bitorder="little")[of]
    return np.where(there, values if dtype.kind == "f" else values.astype(np.float64), np.nan)


def column(table: pa.Table, name: str) -> npt.NDArray[np.float64]:
    """Return a numeric column as a read-only float64 array (n,); nulls become NaN."""
    values = np.asarray(numbers(table[name]), dtype=np.float64)
    values.flags.writeable = False
    return values


def matrix(table: pa.Table, names: Sequence[str]) -> npt.NDArray[np.float64]:
    """Return numeric columns as a read-only float64 array (n, len(names)).

    Nulls become NaN.
    """
    values = np.empty((table.num_rows, len(names)))
    for index, name in enumerate(names):
        values[:, index] = numbers(table[name])
    values.flags.writeable = False
    return values


def split_by(table: pa.Table, name: str) -> dict[Any, pa.Table]:
    """Return the rows of each value of a column, by value, in their order.

    For long tables, whose rows of one value follow one another. (Filters of pyarrow do
    the same but import pandas.)

    >>> parts = split_by(pa.table({"model": ["a", "a", "b"], "n": [1, 2, 3]}), "model")
    >>> {value: part["n"].to_pylist() for value, part in parts.items()}
    {'a': [1, 2], 'b': [3]}
    """
    encoded = table[name].combine_chunks().dictionary_encode()
    codes = numbers(pa.chunked_array([encoded.indices]))
    if encoded.null_count:
        codes = np.nan_to_num(codes, nan=-1.0).astype(np.int64)
    values = [*encoded.dictionary.to_pylist(), None]
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(codes)]
    parts: dict[Any, list[pa.Table]] = {}
    for start, end in pairwise(edges if len(codes) else []):
        parts.setdefault(values[codes[start]], []).append(table.slice(start, end - start))
    return {value: pa.concat_tables(some) for value, some in parts.items()}


def has_columns(table: pa.Table, names: Sequence[str]) -> bool:
    """Return whether the table holds all of these columns."""
    return set(names) <= set(table.column_names)
