"""Account of the bytes of a telemetry log: records, unusable frames, and the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.formats import mavlink
from auvid.hydro.arrays import Buffer, Ints, Mask
from auvid.stages.ingest.decoded_log import ByteAccount, LogStatus
from auvid.stages.ingest.formats.accounting import Losses, status_of
from auvid.stages.ingest.formats.tlog.clock import implausible
from auvid.stages.ingest.formats.tlog.frames import (
    Frames,
    defined,
    frames_at,
    inserted,
    joined,
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
NAMED_UNKNOWN_IDS = 20
LOST_ON_THE_LINK = 1e-3
"""Share of frames with a wrong checksum that any link loses: the file is sound, and a
note counts them.
"""
UNSTAMPED_RUN = 100
"""Frames in a row whose stamps are destroyed; a longer run counts as garbage."""

Piece = tuple[str, Ints, Ints]  # reason, starts, stops


@dataclass(frozen=True)
class Explained:
    """Content of a file.

    Proven records, those among them whose zeros were cut after the checksum was made,
    frames with a wrong checksum, and the account of all bytes.
    """

    records: Frames
    recut: Frames
    mismatched: Frames
    account: ByteAccount
    status: LogStatus
    seconds_lost: float


def first_of_overlapping(start: Ints, stop: Ints) -> Mask:
    """Return which intervals to keep so that none overlaps an earlier one.

    `start` is ascending.
    """
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


def explain(buffer: Buffer) -> Explained:
    """Put every byte of the file into proven records, unusable frames and the rest."""
    proven, unproven = scan(buffer)
    uncut = proven_uncut(buffer, unproven)
    recut = unproven.take(uncut)
    if len(recut):
        proven, unproven = inserted(proven, recut), unproven.take(~uncut)
    distinct = first_of_overlapping(proven.start, proven.stop)
    if not distinct.all():
        proven = proven.take(distinct)
    bad_stamp = implausible(proven.stamp)
    records = proven.take(~bad_stamp) if bad_stamp.any() else proven
    size, record_bytes = buffer.size, int(records.size.sum(dtype=np.int64))
    if record_bytes == size:
        account = ByteAccount(size, record_bytes, 0)
        return Explained(records, recut, records.take(slice(0)), account, "complete", 0.0)
    unstamped = _unstamped(buffer, proven)
    odd = _linked(unproven.take(unproven.stop <= size), _both(proven, unstamped), size)
    defined_message = defined(odd) | ~_of_undefined_message(buffer, odd)
    mismatched = odd.take(defined_message)
    pieces: list[Piece] = [
        *((BAD_STAMP, part.start, part.stop) for part in (proven.take(bad_stamp), unstamped)),
        (MISMATCH, mismatched.start, mismatched.stop),
        *_unknown(odd.take(~defined_message)),
    ]
    start, stop = _rest(records, pieces, size)
    torn = _torn_end(buffer, unproven.take(unproven.stop > size), start, stop)
    if torn is not None:
        reason, at = torn
        pieces.append((reason, np.array([at]), np.array([size])))
        stop[-1] = at
        start, stop = start[start < stop], stop[start < stop]
    pieces.append((GARBAGE, start, stop))
    few = len(mismatched) < LOST_ON_THE_LINK * len(records)
    harmless = (UNKNOWN, MISMATCH) if few else (UNKNOWN,)
    losses = Losses()
    for reason, first, end in pieces:
        losses.add(reason, first, end - first)
    skipped = sorted(losses.skipped(), key=lambda item: item.first_offset)
    return Explained(
        records,
        recut,
        mismatched,
        ByteAccount(size, record_bytes, 0, tuple(skipped)),
        status_of(skipped, at_end=(CUT, ZEROS), harmless=harmless),
        _seconds_lost(records, start),
    )


def _both(first: Frames, second: Frames) -> tuple[Ints, Ints]:
    start = np.concatenate([first.start, second.start])
    order = np.argsort(start, kind="stable")
    return start[order], np.concatenate([first.stop, second.stop])[order]


def _unstamped(buffer: Buffer, records: Frames) -> Frames:
    """Return proven frames behind a record whose eight bytes of stamp cannot be one."""
    parts = [records.take(slice(0))]
    at = np.append(records.stop, 0)
    for _ in range(UNSTAMPED_RUN):
        at = np.setdiff1d(at, records.start)
        room = np.append(records.start, buffer.size)[np.searchsorted(records.start, at)]
        frames = frames_at(buffer, at)
        frames = frames.take(frames.stop <= room[np.searchsorted(at, frames.start)])
        frames = frames.take(proven(buffer, frames))
        if not len(frames):
            break
        parts.append(frames)
        at = frames.stop
    every = joined(parts)
    return every.take(np.argsort(every.start, kind="stable"))


def _linked(frames: Frames, taken: tuple[Ints, Ints], size: int) -> Frames:
    """Return the frames between the taken ones that fit in with others.

    Begin and end of each fit another frame, a taken one, or the ends of the file.
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


def _of_undefined_message(buffer: Buffer, frames: Frames) -> Mask:
    """Return which frames are of a message that is not defined, not damaged.

    One crc_extra explains the checksums of all frames with this id.
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
    return np.asarray(~defined(frames) & (extra >= 0) & (counts[which] == most[of]))


def _unknown(frames: Frames) -> list[Piece]:
    ids, counts = np.unique(frames.message_id, return_counts=True)
    named = np.sort(ids[np.argsort(-counts, kind="stable")[:NAMED_UNKNOWN_IDS]])
    pieces = [(f"{UNKNOWN} {number}", frames.message_id == number) for number in named]
    pieces.append((f"{UNKNOWN} (others)", ~np.isin(frames.message_id, named)))
    return [(reason, frames.start[rows], frames.stop[rows]) for reason, rows in pieces]


def _rest(records: Frames, pieces: Sequence[Piece], size: int) -> tuple[Ints, Ints]:
    """Return the intervals that neither records nor pieces cover."""
    start = np.concatenate([records.start, *(start for _, start, _ in pieces), [size]])
    stop = np.concatenate([[0], records.stop, *(stop for _, _, stop in pieces)])
    start.sort()
    stop.sort()
    open_ = stop < start
    return stop[open_], start[open_]


def _torn_end(
    buffer: Buffer, cut: Frames, rest_start: Ints, rest_stop: Ints
) -> tuple[str, int] | None:
    """Return reason and first byte of an unfinished end of the file, if it has one."""
    if not rest_start.size or rest_stop[-1] != buffer.size:
        return None
    first = int(rest_start[-1])
    if buffer.size - first >= mavlink.STAMP_BYTES and not buffer[first:].any():
        return ZEROS, first
    cut_at = cut.start[(cut.start >= first) & defined(cut)]
    if cut_at.size:
        return CUT, int(cut_at[0])
    if buffer.size - first < mavlink.STAMPED_HEADER_V2.itemsize and buffer[first] == 0:
        return CUT, first
    return None


def _seconds_lost(records: Frames, garbage: Ints) -> float:
    """Return the recording time between the records on either side of garbage.

    A frame with a wrong checksum loses itself, not time.
    """
    after = np.unique(np.searchsorted(records.start, garbage))
    after = after[(after > 0) & (after < len(records))]
    step = records.stamp[after] - records.stamp[after - 1]
    return float(step[step > 0].sum()) / 1e6
