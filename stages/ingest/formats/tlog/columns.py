"""Columns from the payloads of one message type; parameters; status texts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import mavlink
from auvid.hydro.arrays import Buffer, Ints
from auvid.stages.ingest.decoded_log import Column, Messages
from auvid.stages.ingest.formats.accounting import cut_at_nul
from auvid.stages.ingest.formats.tlog.frames import Frames, gather

TEXT_BYTES = 50  # characters in one STATUSTEXT chunk
LOST_CHUNK = b"..."
_BATCH = 8192  # rows whose payloads fit in the second-level cache
_INTEGER_TYPES = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}  # MAV_PARAM_TYPE


def decode(buffer: Buffer, frames: Frames, layout: mavlink.Layout) -> Messages:
    """Return the columns of frames that are all of one message type.

    They are its fields, then time_unix_us, sysid, compid and seq (frame_seq if the
    message has a field `seq` of its own). MAVLink 2 cuts trailing zeros of the payload
    and MAVLink 1 has no extension fields: missing bytes are zero. Buffer beyond the
    layout (a newer definition) are not read.
    """
    columns: dict[str, Column] = {
        name: np.empty((len(frames), *shape), base) for name, shape, base in layout.columns
    }
    for first in range(0, len(frames), _BATCH):
        part = slice(first, first + _BATCH)
        start = frames.start[part] + frames.header[part]
        table = _payloads(buffer, start, frames.length[part], layout.dtype)
        for name, column in columns.items():
            column[part] = table[name]
    for name in layout.text:
        cut_at_nul(columns[name])
    columns["time_unix_us"] = frames.stamp
    columns["sysid"] = frames.system
    columns["compid"] = frames.component
    columns["frame_seq" if "seq" in columns else "seq"] = frames.sequence
    return Messages(layout.name, columns, frames.start, {"time_unix_us": "us", **layout.units})


def _payloads(
    buffer: Buffer, start: Ints, length: Buffer, dtype: np.dtype[np.void]
) -> npt.NDArray[np.void]:
    """Return payloads as records; what is missing of a shorter one is zero."""
    rows = gather(buffer, start, dtype.itemsize)
    shortest = int(length.min())
    if shortest < dtype.itemsize:
        place = np.arange(shortest, dtype.itemsize, dtype=np.uint8)
        rows[:, shortest:] *= (place < length[:, None]).view(np.uint8)
    return rows.view(dtype)[:, 0]


def parameters(messages: Messages, *, bytewise: bool) -> dict[str, float]:
    """Return the last value of each parameter.

    `bytewise`: integers stand in the bytes of the float (PX4), not as its value
    (ArduPilot).
    """
    raw = messages.columns["param_value"]
    values = raw.astype(np.float64)
    if bytewise:
        for kind, dtype in _INTEGER_TYPES.items():
            rows = messages.columns["param_type"] == kind
            low_bytes = raw[rows].view(np.uint8).reshape(-1, 4)[:, : np.dtype(dtype).itemsize]
            values[rows] = low_bytes.copy().view(dtype)[:, 0]
    last = dict(zip(messages.columns["param_id"].tolist(), values.tolist(), strict=True))
    return {name.decode("utf-8", "replace"): value for name, value in last.items() if name}


def status_texts(messages: Messages) -> tuple[tuple[int, str], ...]:
    """Return (time_unix_us, text) of each status text.

    The chunks of a long one are joined; a lost chunk becomes dots.
    """
    texts: list[tuple[int, bytes]] = []
    open_id, next_chunk = 0, 0
    names = ("time_unix_us", "text", "id", "chunk_seq")
    columns = (messages.columns[name].tolist() for name in names)
    for time_us, text, number, chunk in zip(*columns, strict=True):
        start = number == 0 or number != open_id or chunk < next_chunk
        lost = LOST_CHUNK if number and chunk > (0 if start else next_chunk) else b""
        if start:
            texts.append((time_us, lost + text))
        else:
            texts[-1] = (texts[-1][0], texts[-1][1] + lost + text)
        next_chunk = chunk + 1
        open_id = number if len(text) == TEXT_BYTES else 0
    return tuple((time_us, text.decode("utf-8", "replace")) for time_us, text in texts)
