"""Data messages of one topic to columns: gathered in bulk from the bytes, then taken
apart field by field.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import ulog as layout
from auvid.hydro.arrays import Buffer, Ints

GATHER_BYTES = 1 << 18  # rows are gathered in parts that stay in the processor's cache


def unpack(
    buffer: Buffer, offset: Ints, *, topic: str, formats: layout.Formats
) -> dict[str, npt.NDArray[np.generic]]:
    """Columns of the data messages at `offset`, one per basic field, in the order of
    declaration.

    Args:
        buffer: the whole file. offset: where the messages begin, shape (n,); each must
        lie in the file with its whole payload. topic: name of their format. formats:
        the formats of the file.
    """
    fields = list(formats.columns(topic))
    columns: dict[str, npt.NDArray[np.generic]] = {
        name: np.empty(offset.size, dtype) for name, dtype, _ in fields
    }
    sizes = formats.layout(topic)
    if sizes is None or not fields or not offset.size:
        return columns
    row = np.dtype(
        {
            "names": list(columns),
            "formats": [f[1] for f in fields],
            "offsets": [f[2] for f in fields],
            "itemsize": sizes.written,
        }
    )
    every = np.ndarray((buffer.size - sizes.written + 1,), f"V{sizes.written}", buffer, 0, (1,))
    step = max(1, GATHER_BYTES // sizes.written)
    for start in range(0, offset.size, step):
        part = every[offset[start : start + step] + layout.DATA_HEADER_BYTES].view(row)
        for name, column in columns.items():
            column[start : start + step] = part[name]
    for column in columns.values():
        if column.dtype.kind == "S":
            _cut_at_nul(column)
    return columns


def _cut_at_nul(column: npt.NDArray[np.generic]) -> None:
    characters = column.view(np.uint8).reshape(column.size, column.dtype.itemsize)
    characters *= np.logical_and.accumulate(characters != 0, axis=1)


def read_times(buffer: Buffer, offset: Ints, time: Ints) -> Ints:
    """Time stamps in us of data messages at `offset` whose field `timestamp` lies at
    payload offset `time`; -1 beyond 2^63.
    """
    if not offset.size:
        return np.empty(0, np.int64)
    stamps = np.ndarray((buffer.size - 7,), "<u8", buffer, 0, (1,))
    times: Ints = stamps[offset + time + layout.DATA_HEADER_BYTES].astype(np.int64)
    return times
