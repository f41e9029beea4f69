"""What a DataFlash log lost and how its clock behaves: the account of bytes, the
status, lost seconds and notes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer, Ints
from auvid.stages.columns import UNIX_TIME_US
from auvid.stages.ingest.decoded_log import ByteAccount, LogStatus, Skipped
from auvid.stages.ingest.formats.dataflash.scan import Chain, Gap, read_times

DAMAGED = "damaged bytes"
BLANK = "blank bytes (all zeros or all ones)"
BLANK_END = "blank bytes at the end of the file"
CUT_OFF = "record cut off by the end of the file"
UNDEFINED = "message type {} without a definition"
PADDING_BYTES = 528  # block-based logs end in up to two pages of padding
LEAP_US = 86_400_000_000
BACK_US = 1_000_000
CLOCK_SAMPLES = 20_000

Clock = npt.NDArray[np.int8]


def byte_account(
    buffer: Buffer,
    chain: Chain,
    length: npt.NDArray[np.int32],
    defining: Sequence[int],
    refused: Mapping[int, str],
) -> ByteAccount:
    """Put every byte into records, definitions or skipped.

    Args:
        buffer: the whole file. chain: records and gaps, which together cover the file.
        length: bytes per record by definition entry. defining: entries of FMT, FMTU,
        UNIT and MULT. refused: offsets of FMT records in the chain that are not in
        force, with the reason.
    """
    lost: dict[str, list[tuple[int, int]]] = {}
    for offset, reason in refused.items():
        lost.setdefault(reason, []).append((offset, layout.FMT_BYTES))
    count = np.bincount(chain.entry + 1, minlength=length.size + 1)
    if count[0]:
        undefined = np.flatnonzero(chain.entry < 0)
        for id in np.unique(chain.type[undefined]).tolist():
            these = undefined[chain.type[undefined] == id]
            pairs = zip(chain.offset[these].tolist(), chain.length[these].tolist(), strict=True)
            lost.setdefault(UNDEFINED.format(id), []).extend(pairs)
    for gap in chain.gaps:
        lost.setdefault(_reason(buffer, gap), []).append((gap.start, gap.stop - gap.start))
    taken = count[1:] * length
    definitions = int(taken[list(defining)].sum()) - layout.FMT_BYTES * len(refused)
    records = int(taken.sum()) - int(taken[list(defining)].sum())
    return ByteAccount(
        buffer.size,
        records,
        definitions,
        tuple(_skipped(reason, lost[reason]) for reason in sorted(lost)),
    )


def _skipped(reason: str, places: list[tuple[int, int]]) -> Skipped:
    offsets = [offset for offset, _ in places]
    return Skipped(reason, sum(size for _, size in places), len(places), min(offsets), max(offsets))


def _reason(buffer: Buffer, gap: Gap) -> str:
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


def status_of(account: ByteAccount) -> LogStatus:
    """`complete` up to a page or two of padding, `truncated` if only the end is
    missing, else `damaged`.
    """
    reasons = {part.reason: part.bytes for part in account.skipped}
    if not reasons or (set(reasons) == {BLANK_END} and reasons[BLANK_END] <= PADDING_BYTES):
        return "complete"
    return "truncated" if set(reasons) <= {CUT_OFF, BLANK_END} else "damaged"


def lost_seconds(buffer: Buffer, chain: Chain, clock: Clock) -> float:
    """Seconds that the damaged parts cover. Undefined types and the end of the file
    cost none that the clock could show.
    """
    starts = sorted(gap.start for gap in chain.gaps if gap.id < 0 and gap.stop < buffer.size)
    if not starts:
        return 0.0
    timed = np.flatnonzero(clock[chain.entry] > 0)
    offset = chain.offset[timed]
    return covered_seconds(offset, read_times(buffer, offset, clock[chain.entry[timed]]), starts)


def middle(times: list[int]) -> int:
    return sorted(times)[len(times) // 2]


def covered_seconds(offset: Ints, times_us: Ints, starts: Sequence[int]) -> float:
    """Seconds between the clock before and behind each place in `starts`; places within
    the same stretch count once.

    Args:
        offset, times_us: places and time stamps of the records that have one, in file
        order. starts: ascending offsets where something is missing.

    The stretch is that between the neighbours, or, where one of these has a damaged
    time stamp and it would be longer, between medians over five records on either side;
    a stretch over which the clock leaps by more than a day, or goes back, is left out.
    """
    lost, covered = 0, -1
    for place in np.searchsorted(offset, starts).tolist():
        if place == 0 or place == offset.size:
            continue
        start, stop = (
            middle(times_us[max(0, place - 5) : place].tolist()),
            middle(times_us[place : place + 5].tolist()),
        )
        before, behind = times_us[
            place - 1 : place + 1
        ].tolist()  # as Python's integers: damaged stamps overflow others
        if 0 < behind - before < stop - start:
            start, stop = before, behind
        start = max(start, covered)
        if 0 < stop - start < LEAP_US:
            lost += stop - start
            covered = stop
    return lost * 1e-6


def clock_notes(buffer: Buffer, chain: Chain, clock: Clock) -> list[str]:
    """Sentences about a clock that leaps or goes back, or that counts milliseconds."""
    kind = clock[chain.entry]
    timed = np.flatnonzero(kind > 0)
    if timed.size < 2:
        return []
    notes = []
    if (kind[timed] == 2).any():
        notes.append(
            "Times are milliseconds since boot (TimeMS), as firmware before 2015 writes them."
        )
    sample = timed[:: max(1, timed.size // CLOCK_SAMPLES)]
    times = read_times(buffer, chain.offset[sample], kind[sample])
    if times.size > 2:  # the median of three removes single damaged stamps and keeps steps
        times[1:-1] = np.sort(np.stack([times[:-2], times[1:-1], times[2:]]), axis=0)[1]
    steps = np.diff(times)
    leaps = np.flatnonzero((steps > LEAP_US) | (steps < -BACK_US)).tolist()
    if leaps:
        at = leaps[0]
        how = "leaps forward" if steps[at] > 0 else "goes back"
        place = f"near byte {chain.offset[sample[at + 1]]}, from {times[at]} to {times[at + 1]} us"
        more = f" It leaps {len(leaps)} times in all." if len(leaps) > 1 else ""
        notes.append(f"The clock {how} by {abs(int(steps[at])) * 1e-6:.6g} s {place}.{more}")
    if np.median(times) > UNIX_TIME_US:
        notes.append("The clock counts from 1970 (Unix time), not from boot.")
    return notes
