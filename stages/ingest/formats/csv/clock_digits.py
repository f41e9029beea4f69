"""Times that are written as the digits of a clock: 101530.25 is 10:15:30.25."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Mask

CLOCK_DIGITS = "hhmmss"
DAY_S = 86_400.0
LONGEST_PAUSE_S = 5.0
"""Largest step of time over a full minute that tells a clock from seconds."""
LEAST_LATE = 10_000.0
"""Digits of one o'clock in the morning."""


def clock_seconds(values: ArrayLike) -> Array:
    """Return clock digits HHMMSS.ss (n,) as seconds from the midnight before the first.

    3600 HH + 60 MM + SS; a step back by more than half a day is midnight; NaN stays, and
    is returned for what is no time of a day.

    >>> clock_seconds([235959.5, 0.5])
    array([86399.5, 86400.5])
    """
    x = np.asarray(values, dtype=np.float64)
    seconds = np.where(
        _of_clock(x), 3600.0 * (x // 1e4) + 60.0 * (x // 100 % 100) + x % 100, np.nan
    )
    good = np.isfinite(seconds)
    days = np.cumsum(np.diff(seconds[good], prepend=seconds[good][:1]) < -0.5 * DAY_S)
    seconds[good] += DAY_S * days
    return seconds


def counts_like_a_clock(values: ArrayLike) -> bool:
    """Return whether numbers (n,) that are taken for seconds are the digits of a clock.

    They are if no seconds or minutes of any are 60 to 99, and at each full minute the
    number leaps while the clock goes on: 101559.9, 101600.1. One such leap may be a pause
    of a log in seconds: two tell, or one where all numbers have five digits.

    >>> counts_like_a_clock([101559.8, 101559.9, 101600.0]), counts_like_a_clock([58, 59, 60])
    (True, False)
    """
    x = np.asarray(values, dtype=np.float64)
    x = x[np.isfinite(x)]
    if x.size < 3 or not _of_clock(x).all():
        return False
    clock, numbers = np.diff(clock_seconds(x)), np.diff(x)
    full = numbers != 0.0
    full &= np.abs(numbers - clock) > 1.0
    enough = 1 if x.min() >= LEAST_LATE else 2
    return bool(full.sum() >= enough and (np.abs(clock[full]) < LONGEST_PAUSE_S).all())


def _of_clock(x: Array) -> Mask:
    with np.errstate(invalid="ignore"):
        return np.asarray((x >= 0.0) & (x < 240_000.0) & (x // 100 % 100 < 60) & (x % 100 < 60))
