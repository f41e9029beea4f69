"""What every byte of a telemetry log is: proven records, frames that cannot be used,
and the rest, each with its reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.formats import mavlink
from auvid.hydro.arrays import Mask
from auvid.stages.ingest.decoded_log import ByteAccount, LogStatus, Skipped
from auvid.stages.ingest.formats.tlog.clock import implausible
from auvid.stages.ingest.formats.tlog.frames import (
    Bytes,
    Frames,
    Integers,
    frames_at,
    joined,
    known,
    merged,
    proven,
    proven_uncut,
    scan,
    stored_checksums,
)

GARBAGE = "garbage between frames"
MISMATCH = "CRC mismatch"
BAD_STAMP = "implausible time stamp"
CUT = "cut at end of file"
ZEROS = "zeros at end of file"
UNKNOWN = "unknown message id"
HARMLESS = (UNKNOWN, CUT, ZEROS)
NAMED_UNKNOWN_IDS = 20

_UNSTAMPED_RUN = 100  # frames in a row whose stamps are destroyed; a longer run counts as garbage


@dataclass(frozen=True)
class Explained:
    """What a file holds: proven records, those among them whose zeros were cut after
    the checksum was made, frames with a wrong checksum, and the account of all bytes.
    """

    records: Frames
    recut: Frames
    mismatched: Frames
    account: ByteAccount
    status: LogStatus
    seconds_lost: float


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
    """Every byte of the file: proven records, frames that cannot be used, and the rest,
    each with its reason.
    """
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
        return Explained(
            records,
            recut,
            records.take(slice(0)),
            ByteAccount(buffer.size, record_bytes, 0),
            "complete",
            0.0,
        )
    unstamped = _unstamped(buffer, whole)
    odd = _linked(seen.take(seen.stop <= buffer.size), _both(whole, unstamped), buffer.size)
    defined = known(odd) | ~_of_undefined_message(buffer, odd)
    pieces = [(BAD_STAMP, part.start, part.stop) for part in (whole.take(spoilt), unstamped)]
    pieces += [(MISMATCH, odd.start[defined], odd.stop[defined]), *_unknown(odd.take(~defined))]
    rest_start, rest_stop = _rest(
        records, [(start, stop) for _, start, stop in pieces], buffer.size
    )
    torn = _torn_end(buffer, seen.take(seen.stop > buffer.size), rest_start, rest_stop)
    if torn is not None:
        reason, at = torn
        pieces.append((reason, np.array([at]), np.array([buffer.size])))
        rest_stop[-1] = at
        rest_start, rest_stop = (
            rest_start[rest_start < rest_stop],
            rest_stop[rest_start < rest_stop],
        )
    pieces.append((GARBAGE, rest_start, rest_stop))
    skipped = _summed(pieces)
    account = ByteAccount(buffer.size, record_bytes, 0, skipped)
    damaged = any(not part.reason.startswith(HARMLESS) for part in skipped)
    torn_off = any(part.reason in (CUT, ZEROS) for part in skipped)
    status: LogStatus = "damaged" if damaged else "truncated" if torn_off else "complete"
    return Explained(
        records, recut, odd.take(defined), account, status, _seconds_lost(records, rest_start)
    )


def _both(first: Frames, second: Frames) -> tuple[Integers, Integers]:
    start = np.concatenate([first.start, second.start])
    order = np.argsort(start, kind="stable")
    return start[order], np.concatenate([first.stop, second.stop])[order]


def _unstamped(buffer: Bytes, whole: Frames) -> Frames:
    """Proven frames that begin where a record ends, but whose eight bytes of time stamp
    cannot be one.
    """
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
    """Frames between the taken ones whose begin and end fit another frame, a taken one,
    or the ends of the file.
    """
    start, stop = taken
    before = np.searchsorted(start, frames.start, side="right")
    gap_start = np.concatenate([[0], stop])[before]
    gap_stop = np.append(start, size)[before]
    frames_in = (frames.start >= gap_start) & (frames.stop <= gap_stop)
    begins = (frames.start == gap_start) | np.isin(frames.start, frames.stop)
    ends = (frames.stop == gap_stop) | np.isin(frames.stop, frames.start)
    frames = frames.take(frames_in & begins & ends)
    return frames.take(first_of_overlapping(frames.start, frames.stop))


def _of_undefined_message(buffer: Bytes, frames: Frames) -> Mask:
    """True where the id is not defined and one crc_extra explains the checksums of all
    frames with this id: not damaged, unknown.
    """
    start = frames.start + (mavlink.STAMP_BYTES + 1)
    end = frames.payload + frames.length
    extra = mavlink.implied_crc_extras(buffer, start, end, stored_checksums(buffer, end)).astype(
        np.int64
    )
    pair = frames.message_id.astype(np.int64) << 8 | np.maximum(extra, 0)
    _, which, counts = np.unique(pair, return_inverse=True, return_counts=True)
    ids, of = np.unique(frames.message_id, return_inverse=True)
    most = np.zeros(ids.size, dtype=np.int64)
    np.maximum.at(most, of, counts[which] * (extra >= 0))
    return np.asarray(~known(frames) & (extra >= 0) & (counts[which] == most[of]))


def _unknown(frames: Frames) -> list[tuple[str, Integers, Integers]]:
    ids, counts = np.unique(frames.message_id, return_counts=True)
    named = ids[np.argsort(-counts, kind="stable")[:NAMED_UNKNOWN_IDS]]
    pieces = [(f"{UNKNOWN} {number}", frames.message_id == number) for number in np.sort(named)]
    pieces.append((f"{UNKNOWN} (others)", ~np.isin(frames.message_id, named)))
    return [(reason, frames.start[rows], frames.stop[rows]) for reason, rows in pieces]


def _rest(
    records: Frames, pieces: Sequence[tuple[Integers, Integers]], size: int
) -> tuple[Integers, Integers]:
    """The intervals that neither records nor pieces cover."""
    start = np.concatenate([records.start, *(piece[0] for piece in pieces), [size]])
    stop = np.concatenate([[0], records.stop, *(piece[1] for piece in pieces)])
    start.sort()
    stop.sort()
    open_ = stop < start
    return stop[open_], start[open_]


def _torn_end(
    buffer: Bytes, cut: Frames, rest_start: Integers, rest_stop: Integers
) -> tuple[str, int] | None:
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
        part = Skipped(
            reason, int((stop - start).sum()), int(start.size), int(start.min()), int(start.max())
        )
        if reason in total:
            old = total[reason]
            first, last = (
                min(old.first_offset, part.first_offset),
                max(old.last_offset, part.last_offset),
            )
            part = Skipped(reason, old.bytes + part.bytes, old.count + part.count, first, last)
        total[reason] = part
    return tuple(sorted(total.values(), key=lambda part: part.first_offset))


def _seconds_lost(records: Frames, garbage: Integers) -> float:
    """Recording time between the records on either side of garbage (a frame with a
    wrong checksum loses itself, not time).
    """
    after = np.unique(np.searchsorted(records.start, garbage))
    after = after[(after > 0) & (after < len(records))]
    step = records.stamp[after] - records.stamp[after - 1]
    return float(step[step > 0].sum()) / 1e6
