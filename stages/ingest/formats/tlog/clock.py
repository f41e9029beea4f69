"""Damaged time stamps of a telemetry log, and jumps of the recorder's clock.

A damaged stamp leaves the line of its neighbours and the next record is back on it; a
clock that was set stays away. One that is off by less than `OFF_US` cannot be told
from a late one and is kept.
"""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Ints, Mask
from auvid.stages.ingest.formats.accounting import DAY_US

OFF_US = 200_000
"""Recorders write records of several links up to some tens of milliseconds out of order."""
LONGEST_EXCURSION = 64  # records; a longer absence is the clock's, not the damage's
YEAR_2000_US = 946_684_800_000_000
LEAP_US = 1_000_000
LEAP_AHEAD_US = 3_600_000_000


def implausible(stamp: Ints) -> Mask:
    """Return which stamps (us) leave the line of the stamps before and after them."""
    damaged = np.zeros(stamp.size, dtype=np.bool_)
    if stamp.size < 3:
        return damaged
    step = np.diff(stamp)
    backwards = np.flatnonzero(step < -OFF_US) + 1
    # Beyond this share there is no line to leave: the order of the file is not the
    # order of time.
    if backwards.size <= max(3, stamp.size // 10):
        low, high = np.quantile(stamp, (0.1, 0.9)) if backwards.size else (0.0, 0.0)
        span = high - low
        for index in backwards:
            if not damaged[index - 1] and not damaged[index]:
                blamed = _excursion(stamp, int(index))
                damaged[blamed] = ~_misplaced(stamp[blamed], low - span, high + span)
    # A first or last record has one neighbour only: it must be absurd to be refused.
    if not damaged[-2:].any() and step[-1] > DAY_US:
        damaged[-1] = True
    if not damaged[:2].any() and step[0] > DAY_US:
        damaged[0] = True
    return damaged


def _misplaced(run: Ints, low: float, high: float) -> Mask:
    """Return which stamps of an excursion are sound, though out of place in the file.

    These lie in the time of the log and agree with a neighbour.
    """
    agree = np.abs(np.diff(run)) <= OFF_US
    agrees: Mask = np.append(agree, False) | np.append(False, agree)
    return agrees & (run >= low) & (run <= high)


def _excursion(stamp: Ints, index: int) -> slice:
    """Return the records to blame for time going back at `index`.

    These are those before it, those from it on, or (a clock that was set) none.
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


def leap_notes(stamp: Ints, offset: Ints) -> list[str]:
    """Return sentences about a recorder clock that was set, or not set at all."""
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
    if stamp[0] < YEAR_2000_US:
        notes.append("time stamps lie before the year 2000: the recorder's clock was not set")
    return notes
