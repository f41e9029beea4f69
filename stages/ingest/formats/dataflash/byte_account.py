"""Account of the bytes of a DataFlash log, seconds lost, and notes on its clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer
from auvid.stages.columns import UNIX_TIME_US
from auvid.stages.ingest.decoded_log import ByteAccount, LogStatus
from auvid.stages.ingest.formats.accounting import DAY_US, Losses, covered_seconds, status_of
from auvid.stages.ingest.formats.dataflash.scan import Chain, ChainGap, Clock, read_times

DAMAGED = "damaged bytes"
BLANK = "blank bytes (all zeros or all ones)"
BLANK_END = "blank bytes at the end of the file"
CUT_OFF = "record cut off by the end of the file"
UNDEFINED = "message type {} without a definition"
PADDING_BYTES = 528  # block-based logs end in up to two pages of padding
BACK_US = 1_000_000
CLOCK_SAMPLES = 20_000
PAGES_AT_ONCE = 500
"""Samples between which pages of a long file go: the system reads 64 kB about each."""


def byte_account(
    buffer: Buffer,
    chain: Chain,
    length: npt.NDArray[np.int32],
    defining: Sequence[int],
    refused: Mapping[int, str],
) -> tuple[ByteAccount, LogStatus]:
    """Put every byte into records, definitions or skipped; return the status too.

    Args:
        buffer: the whole file. chain: records and gaps, which together cover the file.
        length: bytes per record by definition entry. defining: entries of FMT, FMTU,
        UNIT and MULT. refused: offsets of FMT records in the chain that are not in
        force, with the reason.

    Up to a page or two of padding at the end is no loss that the status shows.
    """
    losses = Losses()
    for offset, reason in refused.items():
        losses.add(reason, offset, layout.FMT_BYTES)
    undefined = np.flatnonzero(chain.entry < 0)
    for id in np.unique(chain.type[undefined]).tolist():
        these = undefined[chain.type[undefined] == id]
        losses.add(UNDEFINED.format(id), chain.offset[these], chain.length[these])
    for gap in chain.gaps:
        losses.add(_reason(buffer, gap), gap.start, gap.stop - gap.start)
    skipped = losses.skipped()
    used = np.bincount(chain.entry + 1, minlength=length.size + 1)[1:] * length
    definitions = int(used[list(defining)].sum())
    account = ByteAccount(
        buffer.size,
        int(used.sum()) - definitions,
        definitions - layout.FMT_BYTES * len(refused),
        skipped,
    )
    padding = sum(item.bytes for item in skipped if item.reason == BLANK_END)
    harmless = (BLANK_END,) if padding <= PADDING_BYTES else ()
    return account, status_of(skipped, at_end=(CUT_OFF, BLANK_END), harmless=harmless)


def _reason(buffer: Buffer, gap: ChainGap) -> str:
    if gap.id >= 0:
        return UNDEFINED.format(gap.id)
    part = buffer[gap.start : gap.stop]
    at_end = gap.stop == buffer.size
    if part[0] in (0x00, 0xFF) and (part == part[0]).all():
        return BLANK_END if at_end else BLANK
    head = part[:2].tobytes()
    if at_end and part.size < layout.MAX_RECORD_BYTES and head == layout.MAGIC[: len(head)]:
        return CUT_OFF
    return DAMAGED


def lost_seconds(buffer: Buffer, chain: Chain, clock: Clock) -> float:
    """Return the seconds that the damaged parts cover.

    Undefined types and the end of the file cost none that the clock could show.
    """
    starts = sorted(gap.start for gap in chain.gaps if gap.id < 0 and gap.stop < buffer.size)
    if not starts:
        return 0.0
    timed = np.flatnonzero(clock[chain.entry] > 0)
    offset = chain.offset[timed]
    return covered_seconds(offset, read_times(buffer, offset, clock[chain.entry[timed]]), starts)


def clock_notes(buffer: Buffer, chain: Chain, clock: Clock) -> list[str]:
    """Return sentences about a clock that jumps, goes back, or counts from 1970."""
    kind = clock[chain.entry]
    timed = np.flatnonzero(kind > 0)
    if timed.size < 2:
        return []
    notes = []
    sample = timed[:: max(1, timed.size // CLOCK_SAMPLES)]
    parts = np.split(sample, range(PAGES_AT_ONCE, sample.size, PAGES_AT_ONCE))
    times = np.concatenate([read_times(buffer, chain.offset[it], kind[it]) for it in parts])
    if times.size > 2:  # the median of three removes single damaged stamps and keeps steps
        times[1:-1] = np.sort([times[:-2], times[1:-1], times[2:]], axis=0)[1]
    steps = np.diff(times)
    jumps = np.flatnonzero((steps > DAY_US) | (steps < -BACK_US)).tolist()
    if jumps:
        at = jumps[0]
        how = "leaps forward" if steps[at] > 0 else "goes back"
        place = f"near byte {chain.offset[sample[at + 1]]}, from {times[at]} to {times[at + 1]} us"
        more = f" It leaps {len(jumps)} times in all." if len(jumps) > 1 else ""
        notes.append(f"The clock {how} by {abs(int(steps[at])) * 1e-6:.6g} s {place}.{more}")
    if np.median(times) > UNIX_TIME_US:
        notes.append("The clock counts from 1970 (Unix time), not from boot.")
    return notes
