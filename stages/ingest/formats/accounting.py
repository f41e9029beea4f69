"""What the log readers share: records, texts, lost bytes, lost seconds, status."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from statistics import median_high
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.hydro.arrays import Buffer, Ints
from auvid.stages.ingest.decoded_log import Column, LogStatus, Skipped

GATHER_BYTES = 1 << 18
"""Records that are gathered at a time, so that they stay in the processor's cache."""
LATEST_US = 1 << 62  # digits or bytes of a later time stamp are damaged
DAY_US = 86_400_000_000


def overlapping(buffer: Buffer, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return the value of a type at every byte of the buffer, without a copy.

    Indexing copies only the values that are wanted; np.take would copy all of them.
    """
    count = max(buffer.size - np.dtype(dtype).itemsize + 1, 0)
    return np.ndarray((count,), dtype, buffer if count else np.zeros(0, np.uint8), 0, (1,))


def cut_at_nul(text: Column) -> None:
    """Blank, in place, whatever stands behind the first NUL of each string."""
    if text.size:
        letters = text.view(np.uint8).reshape(text.size, text.dtype.itemsize)
        letters *= np.logical_and.accumulate(letters != 0, axis=1)


def split_by(key: npt.NDArray[np.signedinteger[Any]], count: int) -> list[Ints]:
    """Return the indices of each key 0 ... count - 1, ascending; none for negative."""
    narrow = key.astype(np.int16) if count < 1 << 15 else key  # 16 bits are sorted by radix
    order = np.argsort(narrow, kind="stable")
    bounds = np.searchsorted(narrow, np.arange(count + 1), sorter=order)
    return np.split(order, bounds)[1:-1]


@dataclass(frozen=True)
class Losses:
    """Places and sizes of what gave nothing, by reason."""

    places: dict[str, list[tuple[Ints, Ints]]] = field(default_factory=dict)

    def add(self, reason: str, start: npt.ArrayLike, size: npt.ArrayLike) -> None:
        """Add one place, or arrays of places, with their sizes in bytes."""
        starts, sizes = np.atleast_1d(start, size)
        if starts.size:
            self.places.setdefault(reason, []).append((starts, sizes))

    def starts(self, *reasons: str) -> list[int]:
        """Return the places lost for these reasons (none named: all), ascending."""
        parts = (self.places.get(reason, ()) for reason in reasons or self.places)
        return sorted(int(place) for part in parts for starts, _ in part for place in starts)

    def skipped(self) -> tuple[Skipped, ...]:
        """Return the account of each reason, in alphabetical order."""
        out = []
        for reason, parts in sorted(self.places.items()):
            start, size = (np.concatenate(part) for part in zip(*parts, strict=True))
            first, last = int(start.min()), int(start.max())
            out.append(Skipped(reason, int(size.sum()), start.size, first, last))
        return tuple(out)


def status_of(
    skipped: Sequence[Skipped], *, at_end: Collection[str], harmless: tuple[str, ...] = ()
) -> LogStatus:
    """Return what the reasons of lost bytes say of the file.

    Reasons that begin as one of `harmless` do not count; those in `at_end` only show
    that the file is cut off.
    """
    reasons = {item.reason for item in skipped if not item.reason.startswith(harmless)}
    return "complete" if not reasons else "truncated" if reasons <= set(at_end) else "damaged"


def covered_seconds(offset: Ints, times_us: Ints, starts: Sequence[int]) -> float:
    """Return the seconds between the clock before and behind each damaged place.

    Args:
        offset, times_us: places and time stamps of the records that have one, in file
        order. starts: ascending offsets where something is missing.

    Places within the same stretch count once. The stretch is that between the
    neighbours, or, where one of these has a damaged time stamp and it would be longer,
    between medians over five records on either side. A stretch over which the clock
    jumps by more than a day, or goes back, is left out.
    """
    lost, covered = 0, -1
    for place in np.searchsorted(offset, starts).tolist():
        if place == 0 or place == offset.size:
            continue
        # Python's integers, because damaged stamps overflow others.
        near = times_us[max(0, place - 5) : place + 5].tolist()
        side = min(5, place)
        start, stop = median_high(near[:side]), median_high(near[side:])
        before, behind = near[side - 1], near[side]
        if 0 < behind - before < stop - start:
            start, stop = before, behind
        start = max(start, covered)
        if 0 < stop - start < DAY_US:
            lost += stop - start
            covered = stop
    return lost * 1e-6
