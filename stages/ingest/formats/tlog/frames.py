"""Find every frame of a telemetry log that its checksum proves.

No chain has to hold: each place that looks like [time stamp][magic] is tried and the
checksum decides, so damage costs only the frames it touches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import mavlink
from auvid.hydro.arrays import Buffer, Ints, Mask
from auvid.stages.ingest.formats.accounting import overlapping

_SCAN_BYTES = 1 << 21
_LATEST_YEAR_BYTE = 0x0E
"""Second byte of a stamp before the year 2100; the first byte is zero."""
_UNCUT_BATCH = 4096
_OLDER_DEFINITIONS = 4  # ends of the last fields that are tried as the end of the sender's payload


@dataclass(frozen=True)
class Frames:
    """Frames as compact columns, ascending by `start`, the first byte of the stamp.

    `header` and `size` count the bytes before the payload and in all, the time stamp
    included.
    """

    start: Ints
    stamp: Ints
    message_id: npt.NDArray[np.int32]
    size: npt.NDArray[np.uint16]
    header: Buffer
    length: Buffer
    system: Buffer
    component: Buffer
    sequence: Buffer

    def __len__(self) -> int:
        return int(self.start.size)

    @property
    def stop(self) -> Ints:
        """Return the byte after the last."""
        return self.start + self.size

    @property
    def payload(self) -> Ints:
        """Return the first byte of the payload."""
        return self.start + self.header

    def take(self, rows: npt.NDArray[np.intp] | Mask | slice) -> Frames:
        """Return some of the rows."""
        if isinstance(rows, np.ndarray) and rows.dtype == np.bool_:
            rows = np.flatnonzero(rows)
        return Frames(**{name: getattr(self, name)[rows] for name in _COLUMNS})


_COLUMNS = tuple(part.name for part in fields(Frames))


def joined(parts: Sequence[Frames]) -> Frames:
    """Concatenate frame tables (at least one)."""
    return Frames(
        **{name: np.concatenate([getattr(frames, name) for frames in parts]) for name in _COLUMNS}
    )


def inserted(frames: Frames, few: Frames) -> Frames:
    """Insert a few frames at their places."""
    at = np.searchsorted(frames.start, few.start)
    return Frames(
        **{name: np.insert(getattr(frames, name), at, getattr(few, name)) for name in _COLUMNS}
    )


def gather(buffer: Buffer, start: Ints, width: int) -> Buffer:
    """Return the `width` bytes from each start (n, width); zeros behind the end."""
    if buffer.size < width:
        buffer = np.concatenate([buffer, np.zeros(width - buffer.size, dtype=np.uint8)])
    last = buffer.size - width
    window = overlapping(buffer, f"V{width}")
    rows = window[np.minimum(start, last)].view(np.uint8).reshape(start.size, width)
    for row in np.flatnonzero(start > last).tolist():
        tail = buffer[start[row] :]
        rows[row] = 0
        rows[row, : tail.size] = tail
    return rows


def places(buffer: Buffer, first: int, last: int) -> Ints:
    """Return the offsets in `first:last` where a frame may begin.

    There stands what looks like a time stamp before 2100 and a magic byte.
    """
    part = buffer[first : last + mavlink.STAMP_BYTES]
    magic = part[mavlink.STAMP_BYTES :]
    at: Ints = np.flatnonzero(magic - np.uint8(mavlink.MAGIC_V2) <= 1)
    at = at[part[at] == 0]
    at = at[part[at + 1] <= _LATEST_YEAR_BYTE]
    at += first
    return at


def frames_at(buffer: Buffer, start: Ints) -> Frames:
    """Return the headers at the given offsets; `stop` may lie beyond the end.

    Places with undefined incompatibility flags are left out.
    """
    rows = gather(buffer, start, mavlink.STAMPED_HEADER_V2.itemsize)
    head = rows.view(mavlink.STAMPED_HEADER_V2)[:, 0]
    usable = (head["magic"] == mavlink.MAGIC_V1) | (
        (head["magic"] == mavlink.MAGIC_V2) & (head["incompatible"] <= mavlink.SIGNED_FLAG)
    )
    if not usable.all():
        return frames_at(buffer, start[np.flatnonzero(usable)])
    length = head["length"].copy()
    message_id = head["id_low"].astype(np.int32)
    message_id += head["id_high"].astype(np.int32) << 16
    columns = {name: head[name].copy() for name in ("system", "component", "sequence")}
    header = np.full(start.size, mavlink.STAMPED_HEADER_V2.itemsize, dtype=np.uint8)
    size = length + np.uint16(mavlink.STAMPED_HEADER_V2.itemsize + mavlink.CHECKSUM_BYTES)
    size += np.uint16(mavlink.SIGNATURE_BYTES) * head["incompatible"]
    old = np.flatnonzero(head["magic"] == mavlink.MAGIC_V1)
    if old.size:
        first = np.ndarray(
            (start.size,), mavlink.STAMPED_HEADER_V1, buffer=rows, strides=(rows.shape[1],)
        )
        message_id[old] = first["id"][old]
        for name, values in columns.items():
            values[old] = first[name][old]
        header[old] = mavlink.STAMPED_HEADER_V1.itemsize
        size[old] = length[old] + np.uint16(
            mavlink.STAMPED_HEADER_V1.itemsize + mavlink.CHECKSUM_BYTES
        )
    stamp = head["stamp"].astype(np.int64)
    return Frames(start, stamp, message_id, size, header, length, **columns)


def scan(buffer: Buffer) -> tuple[Frames, Frames]:
    """Return all places that look like frames: with the right checksum, and others."""
    right, wrong = [], []
    for first in range(0, buffer.size, _SCAN_BYTES):
        frames = frames_at(buffer, places(buffer, first, first + _SCAN_BYTES))
        good = proven(buffer, frames)
        if not good.all():
            wrong.append(frames.take(~good))
            frames = frames.take(good)
        right.append(frames)
    return joined(right), joined(wrong) if wrong else right[0].take(slice(0))


def defined(frames: Frames) -> Mask:
    """Return where the dialect defines the message id."""
    extras = mavlink.crc_extras()
    return np.asarray(extras[np.minimum(frames.message_id, extras.size - 1)] >= 0)


def proven(buffer: Buffer, frames: Frames) -> Mask:
    """Return which frames are whole, of a defined message, with the right checksum."""
    right = defined(frames) & (frames.stop <= buffer.size)
    rows = np.flatnonzero(right)
    start = frames.start[rows]
    end = start + frames.header[rows] + frames.length[rows]
    extra = mavlink.crc_extras()[frames.message_id[rows]].astype(np.uint8)
    right[rows] = mavlink.checksums(
        buffer, start + (mavlink.STAMP_BYTES + 1), end, extra
    ) == stored_checksums(buffer, end)
    return right


def proven_uncut(buffer: Buffer, frames: Frames) -> Mask:
    """Return where the checksum is right for the payload with its trailing zeros.

    These were cut after the checksum was made. Some routers do so with what companion
    computers send; it explains every wrong checksum of the BlueROV2 logs at hand. The
    sender's payload ended with a field of its definition, perhaps an older one without
    the last fields, or with the NUL of a string. As several ends are tried, one hit of
    a sender may be chance: two are required.
    """
    right = np.zeros(len(frames), dtype=np.bool_)
    usable = (
        defined(frames)
        & (frames.stop <= buffer.size)
        & (frames.header == mavlink.STAMPED_HEADER_V2.itemsize)
    )
    rows = np.flatnonzero(usable)
    if not rows.size:
        return right
    ids, which = np.unique(frames.message_id[rows], return_inverse=True)
    ends = np.zeros((ids.size, _OLDER_DEFINITIONS), dtype=np.int64)
    for row, number in enumerate(ids.tolist()):
        dtype = mavlink.layout(number).dtype
        offsets = {field[1] for field in (dtype.fields or {}).values()}
        last = sorted({dtype.itemsize, *offsets})[: -_OLDER_DEFINITIONS - 1 : -1]
        ends[row, : len(last)] = last
    length = frames.length[rows].astype(np.int64)
    tries = np.column_stack(
        [ends[which], np.where(length < ends[which].max(axis=1), length + 1, 0)]
    )
    for sizes in (tries[:, :1], tries[:, 1:]):
        trial, column = np.nonzero((sizes > length[:, None]) & ~right[rows, None])
        for first in range(0, trial.size, _UNCUT_BATCH):
            some, of = trial[first : first + _UNCUT_BATCH], column[first : first + _UNCUT_BATCH]
            found = _right_at_size(buffer, frames.take(rows[some]), sizes[some, of])
            right[rows[some[found]]] = True
    sender = frames.system.astype(np.uint16) << np.uint16(8) | frames.component
    hits = np.bincount(sender[right], minlength=1 << 16)
    return np.asarray(right & (hits[sender] > 1))


def _right_at_size(buffer: Buffer, frames: Frames, size: Ints) -> Mask:
    """Return where the checksum is right for payloads filled up to `size` with zeros.

    All frames are MAVLink 2.
    """
    head = mavlink.HEADER_BYTES_V2 - 1
    width = head + mavlink.LARGEST_PAYLOAD
    content = gather(buffer, frames.payload - head, width)
    content[:, head:] *= (
        np.arange(mavlink.LARGEST_PAYLOAD, dtype=np.uint8) < frames.length[:, None]
    ).view(np.uint8)
    content[:, 0] = size
    begin = np.arange(len(frames)) * width
    extra = mavlink.crc_extras()[frames.message_id].astype(np.uint8)
    computed = mavlink.checksums(content.reshape(-1), begin, begin + head + size, extra)
    return np.asarray(computed == stored_checksums(buffer, frames.payload + frames.length))


def stored_checksums(buffer: Buffer, at: Ints) -> npt.NDArray[np.uint16]:
    """Return the two bytes at each offset as a number."""
    stored: npt.NDArray[np.uint16] = overlapping(buffer, "<u2")[at]
    return stored
