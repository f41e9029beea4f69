"""Time stamps of a telemetry log: which ones damage has spoilt, and where the
recorder's clock was set.

A spoilt stamp leaves the line of its neighbours and the next record is back on it; a
clock that was set stays away. A damaged stamp that is off by less than `OFF_US` cannot
be told from a late one and is kept.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Stamps = npt.NDArray[np.int64]

OFF_US = (
    200_000  # recorders write records of several links up to some tens of milliseconds out of order
)
LONGEST_EXCURSION = 64  # records; a longer absence is the clock's, not the damage's
DAY_US = (
    86_400_000_000  # a first or last record has one neighbour only: it must be absurd to be refused
)
LEAP_US = 1_000_000
LEAP_AHEAD_US = 3_600_000_000


def implausible(stamp: Stamps) -> npt.NDArray[np.bool_]:
    """True where a stamp (microseconds) leaves the line on which the stamps before and
    after it lie.
    """
    spoilt = np.zeros(stamp.size, dtype=np.bool_)
    if stamp.size < 3:
        return spoilt
    step = np.diff(stamp)
    backwards = np.flatnonzero(step < -OFF_US) + 1
    # Beyond this share there is no line to leave: the order of the file is not the
    # order of time.
    if backwards.size <= max(3, stamp.size // 10):
        low, high = np.quantile(stamp, (0.1, 0.9)) if backwards.size else (0.0, 0.0)
        span = high - low
        for index in backwards:
            if not spoilt[index - 1] and not spoilt[index]:
                blamed = _excursion(stamp, int(index))
                spoilt[blamed] = ~_misplaced(stamp[blamed], low - span, high + span)
    if not spoilt[-2:].any() and step[-1] > DAY_US:
        spoilt[-1] = True
    if not spoilt[:2].any() and step[0] > DAY_US:
        spoilt[0] = True
    return spoilt


def _misplaced(run: Stamps, low: float, high: float) -> npt.NDArray[np.bool_]:
    """Which stamps of an excursion are sound although their records stand at the wrong
    place of the file: those of the time of the log that agree with a neighbour.
    """
    agree = np.abs(np.diff(run)) <= OFF_US
    beside: npt.NDArray[np.bool_] = np.append(agree, False) | np.append(False, agree)
    return beside & (run >= low) & (run <= high)


def _excursion(stamp: Stamps, index: int) -> slice:
    """The records to blame for time going back at `index`: those before it, those from
    it on, or (a clock that was set) none.
    """
    low = max(0, index - LONGEST_EXCURSION - 1)
    before = np.flatnonzero(stamp[low:index] <= stamp[index])
    after = np.flatnonzero(stamp[index + 1 : index + LONGEST_EXCURSION + 1] >= stamp[index - 1])
    blamed: list[slice] = []
    if before.size:
        first = low + int(before[-1]) + 1
        if stamp[first] - stamp[first - 1] > OFF_US:
            blamed.append(slice(first, index))
    if after.size:
        end = index + 1 + int(after[0])
        if stamp[end] - stamp[end - 1] > OFF_US:
            blamed.append(slice(index, end))
    if not blamed and index == 1:
        return slice(0, 1)
    if not blamed and index == stamp.size - 1:
        return slice(index, index + 1)
    return min(blamed, key=lambda run: run.stop - run.start, default=slice(0, 0))


def leap_notes(stamp: Stamps, offset: npt.NDArray[np.int64]) -> list[str]:
    """Sentences about a recorder clock that was set, or not set at all, while it
    recorded.
    """
    if not stamp.size:
        return []
    notes = []
    step = np.diff(stamp)
    for index in np.flatnonzero((step < -LEAP_US) | (step > LEAP_AHEAD_US))[:5]:
        way = "back" if step[index] < 0 else "ahead"
        notes.append(
            f"the recorder's clock goes {way} by {abs(int(step[index])) / 1e6:.3f} s at byte"
            f" {int(offset[index + 1])}"
        )
    times = int(np.count_nonzero(step < -LEAP_US))
    if times > 5:
        notes.append(
            f"the recorder's clock goes back {times} times: the order of the file is not the order"
            " of time"
        )
    if stamp[0] < 946_684_800_000_000:
        notes.append("time stamps lie before the year 2000: the recorder's clock was not set")
    return notes
