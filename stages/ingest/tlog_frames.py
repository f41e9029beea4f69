"""Find every frame of a telemetry log that its checksum proves, and say what all other bytes are.

No chain has to hold: each place that looks like [time stamp][magic] is tried and the checksum decides, so damage costs only the
frames it touches. What the proven frames leave over is explained afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from data_schemas.formats import mavlink
from stages.ingest.decoded import ByteAccount, LogStatus, Skipped
from stages.ingest.tlog_clock import implausible

Bytes = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

GARBAGE = "garbage between frames"
MISMATCH = "CRC mismatch"
BAD_STAMP = "implausible time stamp"
CUT = "cut at end of file"
ZEROS = "zeros at end of file"
UNKNOWN = "unknown message id"
HARMLESS = (UNKNOWN, CUT, ZEROS)
NAMED_UNKNOWN_IDS = 20

_SCAN_BYTES = 1 << 20
_LATEST_YEAR_BYTE = 0x0E  # second byte of a stamp: 2^56 us; 0x0E is the year 2100, and the first byte is zero
_UNCUT_BATCH = 4096
_OLDER_DEFINITIONS = 4  # ends of the last fields that are tried as the end of the sender's payload
_UNSTAMPED_RUN = 100  # frames in a row whose stamps are destroyed; a longer run counts as garbage


@dataclass(frozen=True)
class Frames:
    """Frames as columns, ascending by `start`, the first byte of the time stamp; compact, because a file has many.

    `header` and `size` count the bytes before the payload and in all, the time stamp included.
    """

    start: Integers
    stamp: Integers
    message_id: npt.NDArray[np.int32]
    size: npt.NDArray[np.uint16]
    header: Bytes
    length: Bytes
    system: Bytes
    component: Bytes
    sequence: Bytes

    def __len__(self) -> int:
        return int(self.start.size)

    @property
    def stop(self) -> Integers:
        """The byte after the last."""
        return self.start + self.size

    @property
    def payload(self) -> Integers:
        """The first byte of the payload."""
        return self.start + self.header

    def take(self, rows: npt.NDArray[np.intp] | Mask | slice) -> Frames:
        """Some of the rows."""
        if isinstance(rows, np.ndarray) and rows.dtype == np.bool_:
            rows = np.flatnonzero(rows)
        return Frames(**{name: getattr(self, name)[rows] for name in _COLUMNS})


_COLUMNS = tuple(part.name for part in fields(Frames))


def joined(parts: Sequence[Frames]) -> Frames:
    """Several lots of frames, one after the other (at least one)."""
    return Frames(**{name: np.concatenate([getattr(frames, name) for frames in parts]) for name in _COLUMNS})


def merged(frames: Frames, few: Frames) -> Frames:
    """Frames with a few more at their places."""
    at = np.searchsorted(frames.start, few.start)
    return Frames(**{name: np.insert(getattr(frames, name), at, getattr(few, name)) for name in _COLUMNS})


@dataclass(frozen=True)
class Explained:
    """What a file holds: proven records, those among them whose zeros were cut after the checksum was made, frames with a
    wrong checksum, and the account of all bytes."""

    records: Frames
    recut: Frames
    mismatched: Frames
    account: ByteAccount
    status: LogStatus
    seconds_lost: float


def gather(buffer: Bytes, start: Integers, width: int) -> Bytes:
    """Rows of `width` bytes from each start, shape (n, width); bytes beyond the end of the buffer are zero."""
    if buffer.size < width:
        buffer = np.concatenate([buffer, np.zeros(width - buffer.size, dtype=np.uint8)])
    last = buffer.size - width
    window = np.ndarray((last + 1,), np.dtype(f"V{width}"), buffer=buffer, strides=(1,))
    beyond = np.flatnonzero(start > last)
    rows = window[np.minimum(start, last) if beyond.size else start].view(np.uint8).reshape(start.size, width)
    for row in beyond:
        tail = buffer[start[row] :]
        rows[row] = 0
        rows[row, : tail.size] = tail
    return rows


def places(buffer: Bytes, first: int, last: int) -> Integers:
    """Offsets from first to last - 1 of everything that looks like a time stamp before 2100 followed by a magic byte."""
    part = buffer[first : last + mavlink.STAMP_BYTES]
    number = max(part.size - mavlink.STAMP_BYTES, 0)
    hit = (part[mavlink.STAMP_BYTES :] - np.uint8(mavlink.MAGIC_V2)) <= 1
    hit &= part[:number] == 0
    hit &= part[1 : number + 1] <= _LATEST_YEAR_BYTE
    return np.flatnonzero(hit) + first


def frames_at(buffer: Bytes, start: Integers) -> Frames:
    """Headers at the given offsets; places with undefined incompatibility flags are left out. `stop` may lie beyond the end."""
    rows = gather(buffer, start, mavlink.STAMPED_HEADER_V2.itemsize)
    head = rows.view(mavlink.STAMPED_HEADER_V2)[:, 0]
    usable = (head["magic"] == mavlink.MAGIC_V1) | ((head["magic"] == mavlink.MAGIC_V2) & (head["incompatible"] <= mavlink.SIGNED_FLAG))
    if not usable.all():
        return frames_at(buffer, start[np.flatnonzero(usable)])
    length = head["length"].copy()
    message_id = head["id_low"].astype(np.int32)
    message_id += head["id_high"].astype(np.int32) << 16
    system, component, sequence = (head[name].copy() for name in ("system", "component", "sequence"))
    header = np.full(start.size, mavlink.STAMPED_HEADER_V2.itemsize, dtype=np.uint8)
    size = length + np.uint16(mavlink.STAMPED_HEADER_V2.itemsize + mavlink.CHECKSUM_BYTES)
    size += np.uint16(mavlink.SIGNATURE_BYTES) * head["incompatible"]
    old = np.flatnonzero(head["magic"] == mavlink.MAGIC_V1)
    if old.size:
        first = np.ascontiguousarray(rows[old, : mavlink.STAMPED_HEADER_V1.itemsize]).view(mavlink.STAMPED_HEADER_V1)[:, 0]
        message_id[old] = first["id"]
        system[old], component[old], sequence[old] = first["system"], first["component"], first["sequence"]
        header[old] = mavlink.STAMPED_HEADER_V1.itemsize
        size[old] = length[old] + np.uint16(mavlink.STAMPED_HEADER_V1.itemsize + mavlink.CHECKSUM_BYTES)
    return Frames(start, head["stamp"].astype(np.int64), message_id, size, header, length, system, component, sequence)


def scan(buffer: Bytes) -> tuple[Frames, Frames]:
    """All places that look like frames: those whose checksum is right, and the others."""
    right, wrong = [], []
    for first in range(0, max(buffer.size, 1), _SCAN_BYTES):
        seen = frames_at(buffer, places(buffer, first, first + _SCAN_BYTES))
        good = proven(buffer, seen)
        if not good.all():
            wrong.append(seen.take(~good))
            seen = seen.take(good)
        right.append(seen)
    return joined(right), joined(wrong) if wrong else right[0].take(slice(0))


def known(frames: Frames) -> Mask:
    """True where the dialect defines the message id."""
    extras = mavlink.crc_extras()
    return np.asarray(extras[np.minimum(frames.message_id, extras.size - 1)] >= 0)


def proven(buffer: Bytes, frames: Frames) -> Mask:
    """True where the frame is whole, its message defined and its checksum right."""
    right = known(frames) & (frames.stop <= buffer.size)
    rows = np.flatnonzero(right)
    start = frames.start[rows]
    end = start + frames.header[rows] + frames.length[rows]
    extra = mavlink.crc_extras()[frames.message_id[rows]].astype(np.uint8)
    right[rows] = mavlink.checksums(buffer, start + (mavlink.STAMP_BYTES + 1), end, extra) == _stored(buffer, end)
    return right


def proven_uncut(buffer: Bytes, frames: Frames) -> Mask:
    """True where the checksum is right for the payload with its trailing zeros, which were cut after the checksum was made.

    Some routers do so with what companion computers send; it explains every wrong checksum of the BlueROV2 logs at hand. The sender's
    payload ended with a field of its definition, perhaps an older one without the last fields, or with the NUL of a string.
    As several ends are tried, one hit of a sender may be chance: two are asked for.
    """
    right = np.zeros(len(frames), dtype=np.bool_)
    usable = known(frames) & (frames.stop <= buffer.size) & (frames.header == mavlink.STAMPED_HEADER_V2.itemsize)
    rows = np.flatnonzero(usable)
    if not rows.size:
        return right
    ids, which = np.unique(frames.message_id[rows], return_inverse=True)
    ends = np.zeros((ids.size, _OLDER_DEFINITIONS), dtype=np.int64)
    for row, number in enumerate(ids.tolist()):
        layout = mavlink.layout(number)
        last = sorted({layout.dtype.itemsize, *(field[1] for field in (layout.dtype.fields or {}).values())})[
            : -_OLDER_DEFINITIONS - 1 : -1
        ]
        ends[row, : len(last)] = last
    length = frames.length[rows].astype(np.int64)
    tries = np.column_stack([ends[which], np.where(length < ends[which].max(axis=1), length + 1, 0)])
    for sizes in (tries[:, :1], tries[:, 1:]):
        trial, column = np.nonzero((sizes > length[:, None]) & ~right[rows, None])
        for first in range(0, trial.size, _UNCUT_BATCH):
            some, of = trial[first : first + _UNCUT_BATCH], column[first : first + _UNCUT_BATCH]
            found = _right_at_size(buffer, frames.take(rows[some]), sizes[some, of])
            right[rows[some[found]]] = True
    sender = frames.system.astype(np.uint16) << np.uint16(8) | frames.component
    hits = np.bincount(sender[right], minlength=1 << 16)
    return np.asarray(right & (hits[sender] > 1))


def _right_at_size(buffer: Bytes, frames: Frames, size: Integers) -> Mask:
    """True where the checksum is right for MAVLink 2 payloads filled up with zeros to `size` bytes."""
    head = mavlink.HEADER_BYTES_V2 - 1
    width = head + mavlink.LARGEST_PAYLOAD
    content = gather(buffer, frames.payload - head, width)
    content *= np.arange(width) < head + frames.length[:, None].astype(np.int64)
    content[:, 0] = size
    begin = np.arange(len(frames)) * width
    extra = mavlink.crc_extras()[frames.message_id].astype(np.uint8)
    computed = mavlink.checksums(content.reshape(-1), begin, begin + head + size, extra)
    return np.asarray(computed == _stored(buffer, frames.payload + frames.length))


def _stored(buffer: Bytes, at: Integers) -> npt.NDArray[np.uint16]:
    low: npt.NDArray[np.uint16] = buffer[at].astype(np.uint16)
    low |= buffer[at + 1].astype(np.uint16) << np.uint16(8)
    return low


def first_of_overlapping(start: Integers, stop: Integers) -> Mask:
    """Of intervals that overlap, keep the one that begins first (`start` ascending)."""
    keep = np.ones(start.size, dtype=np.bool_)
    if not np.any(start[1:] < stop[:-1]):
        return keep
    reach = np.maximum.accumulate(stop)
    last = previous = -1
    for row in (np.flatnonzero(start[1:] < reach[:-1]) + 1).tolist():
        if row - 1 != previous:
            last = row - 1
        if start[row] < stop[last]:
            keep[row] = False
        else:
            last = row
        previous = row
    return keep


def explain(buffer: Bytes) -> Explained:
    """Every byte of the file: proven records, frames that cannot be used, and the rest, each with its reason."""
    whole, seen = scan(buffer)
    uncut = proven_uncut(buffer, seen)
    recut = seen.take(uncut)
    if len(recut):
        whole, seen = merged(whole, recut), seen.take(~uncut)
    distinct = first_of_overlapping(whole.start, whole.stop)
    if not distinct.all():
        whole = whole.take(distinct)
    spoilt = implausible(whole.stamp)
    records = whole.take(~spoilt) if spoilt.any() else whole
    record_bytes = int(records.size.sum(dtype=np.int64))
    if record_bytes == buffer.size:
        return Explained(records, recut, records.take(slice(0)), ByteAccount(buffer.size, record_bytes, 0), "complete", 0.0)
    unstamped = _unstamped(buffer, whole)
    odd = _linked(seen.take(seen.stop <= buffer.size), _both(whole, unstamped), buffer.size)
    defined = known(odd)
    pieces = [(BAD_STAMP, part.start, part.stop) for part in (whole.take(spoilt), unstamped)]
    pieces += [(MISMATCH, odd.start[defined], odd.stop[defined]), *_unknown(odd.take(~defined))]
    rest_start, rest_stop = _rest(records, [(start, stop) for _, start, stop in pieces], buffer.size)
    torn = _torn_end(buffer, seen.take(seen.stop > buffer.size), rest_start, rest_stop)
    if torn is not None:
        reason, at = torn
        pieces.append((reason, np.array([at]), np.array([buffer.size])))
        rest_stop[-1] = at
        rest_start, rest_stop = rest_start[rest_start < rest_stop], rest_stop[rest_start < rest_stop]
    pieces.append((GARBAGE, rest_start, rest_stop))
    skipped = _summed(pieces)
    account = ByteAccount(buffer.size, record_bytes, 0, skipped)
    damaged = any(not part.reason.startswith(HARMLESS) for part in skipped)
    torn_off = any(part.reason in (CUT, ZEROS) for part in skipped)
    status: LogStatus = "damaged" if damaged else "truncated" if torn_off else "complete"
    return Explained(records, recut, odd.take(defined), account, status, _seconds_lost(records, rest_start))


def _both(first: Frames, second: Frames) -> tuple[Integers, Integers]:
    start = np.concatenate([first.start, second.start])
    order = np.argsort(start, kind="stable")
    return start[order], np.concatenate([first.stop, second.stop])[order]


def _unstamped(buffer: Bytes, whole: Frames) -> Frames:
    """Proven frames that begin where a record ends, but whose eight bytes of time stamp cannot be one."""
    found = [whole.take(slice(0))]
    at = np.append(whole.stop, 0)
    for _ in range(_UNSTAMPED_RUN):
        at = np.setdiff1d(at, whole.start)
        follow = np.searchsorted(whole.start, at)
        room = np.append(whole.start, buffer.size)[follow]
        frames = frames_at(buffer, at)
        inside = frames.stop <= room[np.searchsorted(at, frames.start)]
        frames = frames.take(inside)
        frames = frames.take(proven(buffer, frames))
        if not len(frames):
            break
        found.append(frames)
        at = frames.stop
    every = joined(found)
    return every.take(np.argsort(every.start, kind="stable"))


def _linked(frames: Frames, taken: tuple[Integers, Integers], size: int) -> Frames:
    """Frames between the taken ones whose begin and end fit another frame, a taken one, or the ends of the file."""
    start, stop = taken
    before = np.searchsorted(start, frames.start, side="right")
    gap_start = np.concatenate([[0], stop])[before]
    gap_stop = np.append(start, size)[before]
    frames_in = (frames.start >= gap_start) & (frames.stop <= gap_stop)
    begins = (frames.start == gap_start) | np.isin(frames.start, frames.stop)
    ends = (frames.stop == gap_stop) | np.isin(frames.stop, frames.start)
    frames = frames.take(frames_in & begins & ends)
    return frames.take(first_of_overlapping(frames.start, frames.stop))


def _unknown(frames: Frames) -> list[tuple[str, Integers, Integers]]:
    ids, counts = np.unique(frames.message_id, return_counts=True)
    named = ids[np.argsort(-counts, kind="stable")[:NAMED_UNKNOWN_IDS]]
    pieces = [(f"{UNKNOWN} {number}", frames.message_id == number) for number in np.sort(named)]
    pieces.append((f"{UNKNOWN} (others)", ~np.isin(frames.message_id, named)))
    return [(reason, frames.start[rows], frames.stop[rows]) for reason, rows in pieces]


def _rest(records: Frames, pieces: Sequence[tuple[Integers, Integers]], size: int) -> tuple[Integers, Integers]:
    """The intervals that neither records nor pieces cover."""
    start = np.concatenate([records.start, *(piece[0] for piece in pieces), [size]])
    stop = np.concatenate([[0], records.stop, *(piece[1] for piece in pieces)])
    start.sort()
    stop.sort()
    open_ = stop < start
    return stop[open_], start[open_]


def _torn_end(buffer: Bytes, cut: Frames, rest_start: Integers, rest_stop: Integers) -> tuple[str, int] | None:
    """Reason and first byte of an unfinished end of the file, if it has one."""
    if not rest_start.size or rest_stop[-1] != buffer.size:
        return None
    first = int(rest_start[-1])
    if buffer.size - first >= mavlink.STAMP_BYTES and not buffer[first:].any():
        return ZEROS, first
    cut_at = cut.start[(cut.start >= first) & known(cut)]
    if cut_at.size:
        return CUT, int(cut_at[0])
    if buffer.size - first < mavlink.STAMPED_HEADER_V2.itemsize and buffer[first] == 0:
        return CUT, first
    return None


def _summed(pieces: Sequence[tuple[str, Integers, Integers]]) -> tuple[Skipped, ...]:
    total: dict[str, Skipped] = {}
    for reason, start, stop in pieces:
        if not start.size:
            continue
        part = Skipped(reason, int((stop - start).sum()), int(start.size), int(start.min()), int(start.max()))
        if reason in total:
            old = total[reason]
            first, last = min(old.first_offset, part.first_offset), max(old.last_offset, part.last_offset)
            part = Skipped(reason, old.bytes + part.bytes, old.count + part.count, first, last)
        total[reason] = part
    return tuple(sorted(total.values(), key=lambda part: part.first_offset))


def _seconds_lost(records: Frames, garbage: Integers) -> float:
    """Recording time between the records on either side of garbage (a frame with a wrong checksum loses itself, not time)."""
    after = np.unique(np.searchsorted(records.start, garbage))
    after = after[(after > 0) & (after < len(records))]
    step = records.stamp[after] - records.stamp[after - 1]
    return float(step[step > 0].sum()) / 1e6
