"""What a ULog file lost and how its clock behaves: the account of bytes, the status,
lost seconds and notes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from auvid.hydro.arrays import Ints
from auvid.stages.ingest.decoded_log import ByteAccount, LogStatus, Skipped
from auvid.stages.ingest.formats.dataflash.byte_account import covered_seconds
from auvid.stages.ingest.formats.ulog.contents import (
    BLANK_END,
    CUT_BY_APPENDED,
    CUT_OFF,
    NO_SUBSCRIPTION,
    UNDEFINED_STREAM,
    UNKNOWN_TYPE,
    WRONG_SIZE,
    WRONG_SIZE_STREAM,
    Contents,
    Stream,
)

NEIGHBOURS = 64
STRAY_US = 60_000_000
BACK_US = 1_000_000
HEADER_DAMAGED = "damaged file header"
HARMLESS = frozenset({CUT_BY_APPENDED, UNKNOWN_TYPE})


def byte_account(
    size: int,
    definition_bytes: int,
    contents: Contents,
    offset: Ints,
    length: Ints,
    stream: npt.NDArray[np.int32],
) -> ByteAccount:
    """Put every byte into records, definitions or skipped.

    Args:
        size: of the file. definition_bytes: header and definition messages. contents:
        gaps and bytes of the other messages. offset, length, stream: of all data
        messages; a negative stream is one that cannot be read.
    """
    skipped = {}
    for code, reason in ((UNDEFINED_STREAM, NO_SUBSCRIPTION), (WRONG_SIZE_STREAM, WRONG_SIZE)):
        where = np.flatnonzero(stream == code)
        if where.size:
            skipped[reason] = Skipped(
                reason,
                int(length[where].sum()),
                where.size,
                int(offset[where[0]]),
                int(offset[where[-1]]),
            )
    places: dict[str, list[tuple[int, int]]] = {}
    for gap in contents.gaps:
        places.setdefault(gap.reason, []).append((gap.start, gap.stop - gap.start))
    for reason, parts in places.items():
        starts = [start for start, _ in parts]
        skipped[reason] = Skipped(
            reason, sum(count for _, count in parts), len(parts), min(starts), max(starts)
        )
    records = int(length[stream >= 0].sum()) + contents.other_bytes
    return ByteAccount(
        size, records, definition_bytes, tuple(skipped[reason] for reason in sorted(skipped))
    )


def status_of(account: ByteAccount) -> LogStatus:
    """`truncated` if only the end is missing, `damaged` if anything else is; what the
    format provides for is no damage.
    """
    reasons = {part.reason for part in account.skipped} - HARMLESS
    if not reasons and account.size:
        return "complete"
    return "truncated" if reasons <= {CUT_OFF, BLANK_END} else "damaged"


def lost_seconds(contents: Contents, size: int, offset: Ints, times_us: Ints) -> float:
    """Seconds that damaged places cover; data without subscription and the end of the
    file cost none that the clock could show.
    """
    starts = sorted(
        gap.start for gap in contents.gaps if gap.reason not in HARMLESS and gap.stop < size
    )
    return covered_seconds(offset, times_us, starts) if starts else 0.0


def clock_notes(
    streams: Sequence[Stream], offset: Ints, times_us: Ints, stream: npt.NDArray[np.int32]
) -> list[str]:
    """Sentences about stray time stamps and a clock that goes back.

    A time stamp strays if it is more than a minute ahead of the median of the records
    around it. Old ones are usual: a topic that is published rarely is written once with
    the time of its last publication.
    """
    count = times_us.size // NEIGHBOURS
    if count == 0:
        return []
    whole = times_us[: count * NEIGHBOURS].reshape(count, NEIGHBOURS)
    median = np.partition(whole, NEIGHBOURS // 2, axis=1)[:, NEIGHBOURS // 2]
    around = np.maximum(median, np.append(median[1:], 0))
    notes = []
    stray = np.concatenate(
        [
            np.flatnonzero(whole > around[:, None] + STRAY_US),
            count * NEIGHBOURS + np.flatnonzero(times_us[whole.size :] > median[-1] + STRAY_US),
        ]
    )
    for number in np.unique(stream[stray]).tolist():
        these = stray[stream[stray] == number]
        worst = these[np.argmax(times_us[these])]
        notes.append(
            f"{these.size} time stamp(s) of {streams[number].name} stray ahead of the clock, up to"
            f" {times_us[worst] * 1e-6:.6g} s at byte {offset[worst]} where the clock shows"
            f" {median[min(worst // NEIGHBOURS, count - 1)] * 1e-6:.6g} s."
        )
    back = np.flatnonzero(np.diff(median) < -BACK_US)
    if back.size:
        at = int(back[0])
        place = int(offset[(at + 1) * NEIGHBOURS])
        notes.append(
            f"The clock goes back by {(median[at] - median[at + 1]) * 1e-6:.6g} s near byte"
            f" {place}; it does so {back.size} time(s) in all."
        )
    return notes
