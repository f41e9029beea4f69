"""Artefacts on disk, checked against their schema on write and on read.

Tables are Parquet, documents JSON, anything else bytes.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from itertools import chain
from json.encoder import encode_basestring
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from auvid.data_schemas.documents import check_document, delivered, written
from auvid.data_schemas.errors import SchemaError
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import TableParts, arrow_array, check_table, numbers
from auvid.hydro.long_series.long_arrays import LONG_BYTES, laid_down
from auvid.pipeline.store.atomic_files import REMEDIES, readable, refusal
from auvid.pipeline.store.file_hashes import hash_bytes, hash_settled_file
from auvid.pipeline.store.pipes import saved_pieces

LINE = 120
GROUP_ROWS = 65_536
"""Rows of a table that are read at a time where only some are needed."""
LONG_TABLE_BYTES = 16_000_000
"""In memory; the file of a longer table is written while it is encoded."""
LONG_ROWS = LONG_BYTES // 8
"""Of a table of which a task reads one column after another, and lays them down."""
PLAIN_NUMBERS = {pa.int64(), pa.float64(), pa.int32(), pa.float32()}
SCALARS = {float, int, bool, type(None)}
CONTAINERS = (dict, list)
PLAIN = {str, int, bool, type(None)}


def encode(artefact: object, name: str, *, file: object) -> bytes:
    """Return the bytes of an artefact, the same for the same content.

    Raises `SchemaError` where it does not fit schema `name`.
    """
    kind = schema(name).kind
    if kind == "table":
        if not isinstance(artefact, pa.Table):
            raise SchemaError("not a table", file=file, value=type(artefact).__name__)
        check_table(artefact, name, file=file)
        sink = io.BytesIO()
        _write_parquet(artefact, sink)
        return sink.getvalue()
    if kind == "document":
        plain = to_plain(written(artefact), file=file)
        check_document(plain, name, file=file)
        return (to_json(plain) + "\n").encode()
    if not isinstance(artefact, bytes):
        raise SchemaError("not bytes", file=file, value=type(artefact).__name__)
    return artefact


def _write_parquet(table: pa.Table, sink: BinaryIO) -> None:
    with _writer(table.schema, sink) as writer:
        writer.write_table(table.combine_chunks(), row_group_size=GROUP_ROWS)


def _write_parts(parts: Iterator[pa.Table], sink: BinaryIO) -> None:
    """Write the parts of a table; the bytes are those of the table as one."""
    left = next(parts)
    with _writer(left.schema, sink) as writer:
        for part in chain(parts, [left[:0]]):
            left = pa.concat_tables([left, part])
            full = left.num_rows - (left.num_rows % GROUP_ROWS if part.num_rows else 0)
            for start in range(0, full, GROUP_ROWS):
                group = left[start : min(start + GROUP_ROWS, full)]
                writer.write_table(group.combine_chunks(), row_group_size=GROUP_ROWS)
            left = left[full:]


def _writer(columns: pa.Schema, sink: BinaryIO) -> pq.ParquetWriter:
    # A dictionary of measured numbers is work for nothing; their bytes sorted by place
    # are written in a quarter of the time, and a fifth smaller.
    numbers = [item.name for item in columns if pa.types.is_floating(item.type)]
    return pq.ParquetWriter(
        sink,
        columns,
        compression="zstd",
        use_dictionary=[item.name for item in columns if pa.types.is_string(item.type)],
        column_encoding=dict.fromkeys(numbers, "BYTE_STREAM_SPLIT"),
    )


def in_pieces(artefact: object, name: str, *, file: object) -> Generator[bytes]:
    """Give the bytes of an artefact; of a writer or a long table as they are saved."""
    kind = schema(name).kind
    if kind == "bytes" and callable(artefact):
        yield from saved_pieces(artefact)
    elif kind == "table" and isinstance(artefact, TableParts):

        def save_parts(path: str) -> None:
            with open(path, "wb") as sink:
                _write_parts(_checked(artefact.make(), name, file), sink)

        yield from saved_pieces(save_parts)
    elif kind == "table" and isinstance(artefact, pa.Table) and artefact.nbytes > LONG_TABLE_BYTES:
        check_table(artefact, name, file=file)

        def save(path: str) -> None:
            with open(path, "wb") as sink:
                _write_parquet(artefact, sink)

        yield from saved_pieces(save)
    else:
        yield encode(artefact, name, file=file)


def _checked(parts: Iterator[pa.Table], name: str, file: object) -> Iterator[pa.Table]:
    for part in parts:
        check_table(part, name, file=file)
        yield part


def load(
    path: Path,
    name: str,
    expected: str | None = None,
    columns: Sequence[str] = (),
    times: tuple[float, float] | None = None,
) -> Any:
    """Read an artefact back, checked; with `columns` those of a table, and its clock.

    With `times` the groups of rows whose clock lies between the two, at least.

    Raises `SchemaError` where its hash is not `expected` or it does not fit its schema.
    """
    kind = schema(name).kind
    with readable(path, file=path, what="artefact"):
        content = b"" if kind == "table" else path.read_bytes()
        digest = expected and (hash_settled_file(path) if kind == "table" else hash_bytes(content))
    if digest != expected:
        raise SchemaError(
            "the artefact is not what its manifest says",
            file=path,
            remedy="Run the campaign: it is made again.",
        )
    if kind == "bytes":
        return content
    try:
        chosen = {*columns, schema(name).clock} if columns else set()
        value = (
            _read_parquet(path, chosen, schema(name).clock, times)
            if kind == "table"
            else json.loads(content)
        )
    except (pa.ArrowInvalid, OSError, ValueError) as fault:
        if isinstance(fault, OSError) and fault.errno in REMEDIES:
            raise refusal(fault, "artefact cannot be read", path) from fault
        raise SchemaError(
            f"cannot be read: {fault}", file=path, remedy="Remove the file and run again."
        ) from fault
    if kind == "document":
        return delivered(value, name, file=path)
    check_table(value, name, file=path, in_part=bool(columns))
    return value


def _read_parquet(
    path: Path,
    chosen: Collection[str | None],
    clock: str | None,
    times: tuple[float, float] | None,
) -> pa.Table:
    """Return the table of a file, or the `chosen` columns and the groups of `times`.

    It is read column by column: the bytes of the file are never all in memory.
    """
    with pa.OSFile(str(path)) as file:
        parquet = pq.ParquetFile(file)
        names = [item for item in parquet.schema_arrow.names if not chosen or item in chosen]
        if times is None or clock not in parquet.schema_arrow.names:
            if parquet.metadata.num_rows < LONG_ROWS:
                return parquet.read(names, use_threads=False)
            columns = [_outside(parquet.read([name], use_threads=False)) for name in names]
            fields = [part.schema.field(0) for part in columns]
            return pa.Table.from_arrays(
                [part.column(0) for part in columns],
                schema=pa.schema(fields, metadata=parquet.schema_arrow.metadata),
            )
        column = parquet.schema_arrow.names.index(clock)
        groups = [
            group
            for group in range(parquet.num_row_groups)
            if _overlaps(parquet.metadata.row_group(group).column(column).statistics, times)
        ]
        return parquet.read_row_groups(groups, names, use_threads=False)


def _outside(column: pa.Table) -> pa.Table:
    """Return a table of one column, numbers as they are laid down outside of memory."""
    (field,), values = column.schema, column.column(0)
    if values.null_count or field.type not in PLAIN_NUMBERS:
        return column
    return pa.Table.from_arrays(
        [arrow_array(laid_down(numbers(values)), field.type)], schema=column.schema
    )


def _overlaps(bounds: pq.Statistics | None, times: tuple[float, float]) -> bool:
    """Return whether a group of rows may have some of these times."""
    if bounds is None or not bounds.has_min_max:
        return True
    return bool(bounds.max >= times[0] and bounds.min <= times[1])


def to_plain(value: object, *, file: object = None, at: str = "") -> Any:
    """Return a document of plain Python values; NaN and infinity are refused."""
    if type(value) in PLAIN:
        return value
    if isinstance(value, dict | Mapping):
        return {
            str(key): to_plain(item, file=file, at=f"{at}.{key}" if at else str(key))
            for key, item in value.items()
        }
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        # long series are of numbers (and null): those of a few kinds are checked in one go
        if set(map(type, value)) <= SCALARS and all(map(math.isfinite, filter(None, value))):
            return list(value)
        return [to_plain(item, file=file, at=f"{at}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise SchemaError(
            "no number", file=file, field=at, value=value, allowed="finite numbers, or null"
        )
    if isinstance(value, str | int | float):
        return value
    raise SchemaError(
        "a document cannot hold this", file=file, field=at, value=type(value).__name__
    )


def to_json(value: Any, indent: int = 0) -> str:
    """Return JSON that a person can read in a diff.

    One key a line; short containers and lists of scalars on one line.
    """
    if type(value) is str:
        return encode_basestring(value)
    if type(value) not in CONTAINERS or not value:
        return _line(value)
    items = value.values() if isinstance(value, dict) else value
    if set(map(type, items)).isdisjoint(CONTAINERS):
        line = _line(value)
        if isinstance(value, list) or len(line) + indent <= LINE:
            return line
    elif not any(item for item in items if type(item) in CONTAINERS):
        line = _line(value)
        if len(line) + indent <= LINE:
            return line
    pad = " " * (indent + 1)
    if isinstance(value, dict):
        inner = [
            f"{pad}{encode_basestring(key)}: {to_json(item, indent + 1)}"
            for key, item in value.items()
        ]
        return "{\n" + ",\n".join(inner) + "\n" + pad[1:] + "}"
    return (
        "[\n" + ",\n".join(pad + to_json(item, indent + 1) for item in value) + "\n" + pad[1:] + "]"
    )


_line = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
"""Text of a value on one line."""
