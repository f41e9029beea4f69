"""Payloads of one message type to columns; parameters and status texts from their
messages.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import mavlink
from auvid.stages.ingest.decoded_log import Messages
from auvid.stages.ingest.formats.tlog.frames import Bytes, Frames, Integers, gather

TEXT_BYTES = 50  # characters in one STATUSTEXT chunk
LOST_CHUNK = "..."
_BATCH = 8192  # rows whose payloads fit in the second-level cache
_INTEGER_TYPES = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}  # MAV_PARAM_TYPE


def decode(buffer: Bytes, frames: Frames, layout: mavlink.Layout) -> Messages:
    """Columns of the frames, all of the message type of `layout`: its fields, then
    time_unix_us, sysid, compid and seq.

    MAVLink 2 cuts trailing zeros of the payload and MAVLink 1 has no extension fields:
    missing bytes are zero. Bytes beyond the layout (a newer definition) are not read. A
    message with a field `seq` of its own has the frame's as `frame_seq`.
    """
    columns: dict[str, npt.NDArray[np.generic]]
    if len(frames) <= _BATCH:
        table = _payloads(buffer, frames.payload, frames.length, layout.dtype)
        columns = {name: table[name].copy() for name, _, _ in layout.columns}
    else:
        columns = {
            name: np.empty((len(frames), *shape), base) for name, shape, base in layout.columns
        }
        for first in range(0, len(frames), _BATCH):
            part = slice(first, first + _BATCH)
            table = _payloads(
                buffer, frames.start[part] + frames.header[part], frames.length[part], layout.dtype
            )
            for name, column in columns.items():
                column[part] = table[name]
    for name in layout.text:
        columns[name] = cut_at_nul(columns[name])
    columns["time_unix_us"] = frames.stamp
    columns["sysid"] = frames.system
    columns["compid"] = frames.component
    columns["frame_seq" if "seq" in columns else "seq"] = frames.sequence
    return Messages(layout.name, columns, frames.start, {"time_unix_us": "us", **layout.units})


def _payloads(
    buffer: Bytes, start: Integers, length: Bytes, dtype: np.dtype[np.void]
) -> npt.NDArray[np.void]:
    """Payloads as records; what is missing of a shorter one is zero."""
    rows = gather(buffer, start, dtype.itemsize)
    shortest = int(length.min())
    if shortest < dtype.itemsize:
        rows[:, shortest:] *= (
            np.arange(shortest, dtype.itemsize, dtype=np.uint8) < length[:, None]
        ).view(np.uint8)
    return rows.view(dtype)[:, 0]


def cut_at_nul(text: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Fixed-width strings with everything after the first NUL removed; numpy itself
    drops trailing NULs only.
    """
    characters = text.view(np.uint8).reshape(text.size, text.dtype.itemsize)
    ended = np.logical_or.accumulate(characters == 0, axis=1)
    return np.where(ended, np.uint8(0), characters).view(text.dtype)[:, 0]


def words(raw: bytes) -> str:
    """Text of a string field; bytes that are not UTF-8 are replaced."""
    return raw.decode("utf-8", errors="replace")


def parameters(messages: Messages, *, bytewise: bool) -> dict[str, float]:
    """Last value of each parameter. `bytewise`: integers stand in the bytes of the
    float (PX4), not as its value (ArduPilot).
    """
    raw = messages.columns["param_value"]
    values = raw.astype(np.float64)
    if bytewise:
        for kind, dtype in _INTEGER_TYPES.items():
            rows = messages.columns["param_type"] == kind
            values[rows] = (
                raw[rows]
                .view(np.uint8)
                .reshape(-1, 4)[:, : np.dtype(dtype).itemsize]
                .copy()
                .view(dtype)[:, 0]
            )
    last = dict(zip(messages.columns["param_id"].tolist(), values.tolist(), strict=True))
    return {words(name): value for name, value in last.items() if name}


def status_texts(messages: Messages) -> tuple[tuple[int, str], ...]:
    """(time_unix_us, text) of each status text; the chunks of a long one are joined, a
    lost chunk is shown as dots.
    """
    texts: list[tuple[int, list[bytes]]] = []
    open_id, next_chunk = 0, 0
    rows = zip(
        *(messages.columns[name].tolist() for name in ("time_unix_us", "text", "id", "chunk_seq")),
        strict=True,
    )
    for time_us, text, number, chunk in rows:
        if number == 0 or number != open_id or chunk < next_chunk:
            texts.append((time_us, []))
            next_chunk = 0
        if number and chunk > next_chunk:
            texts[-1][1].append(LOST_CHUNK.encode())
        texts[-1][1].append(text)
        next_chunk = chunk + 1
        open_id = number if len(text) == TEXT_BYTES else 0
    return tuple((time_us, words(b"".join(parts))) for time_us, parts in texts)
