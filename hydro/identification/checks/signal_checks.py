"""Measures of the health of recorded signals.

Clocks, repeated and stuck samples, and whether sensors of one motion agree. Nothing
here decides: every function returns measured values, the thresholds stand with the
checks that use them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, median
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned

MOST_SAMPLES = 4000
"""Statistics over long records use every n-th sample, so that there are at most about
this many.
"""
RATE_INTERVAL_S, LONGEST_INTERVAL_S = 0.1, 0.5
"""Attitude is differenced over at least the first (shorter intervals amplify its
rounding) and at most the second (turns are lost).
"""
FEWEST = 20
USUAL_PERCENT, PAUSE_USUAL = 85.0, 3.0
"""A step of more than this many times the step that 85 % of them stay below is a pause
and does not count for the rate.
"""


FEWEST_CHANGES, HELD_STEPS = 60, 2.5
"""Fewest changes that tell a period, and how many samples it must be longer than."""
ROUNDING, LATTICE, FEWEST_STEPS = 1e-5, 0.02, 3
"""Part of the range of rounded values within which they are one, part of a step by which they
may lie beside its multiples, and how many steps differ.
"""
SURE_OF_PERIOD, LEAST_ANEW = 0.99, 0.6
"""Share of the changes that keep the period, and of its steps that bring a new value."""


@dataclass(frozen=True)
class ClockStatistics:
    """Steps of a clock: rate [Hz], median step [s], jitter [s], longest step [s].

    The rate is the mean without pauses (messages that arrive in bursts come no faster
    for it); jitter is half the range from the 5th to the 95th percentile;
    `longest_at_s` is where the longest starts.
    """

    rate_hz: float
    step_s: float
    jitter_s: float
    longest_s: float
    longest_at_s: float

    @property
    def relative_jitter(self) -> float:
        """Return the jitter in parts of the median step."""
        return self.jitter_s / self.step_s


def clock_statistics(t_s: ArrayLike) -> ClockStatistics | None:
    """Return statistics of the steps of increasing times t_s (n,) [s].

    None for fewer than three samples.
    """
    t = np.asarray(t_s, dtype=np.float64)
    if t.size < 3:
        return None
    steps = np.diff(t)
    low, median, usual, high = np.percentile(steps, (5.0, 50.0, USUAL_PERCENT, 95.0))
    longest = int(np.argmax(steps))
    rate = 1.0 / float(np.mean(steps[steps <= PAUSE_USUAL * usual]))
    return ClockStatistics(
        rate, float(median), float(high - low) / 2.0, float(steps[longest]), float(t[longest])
    )


@dataclass(frozen=True)
class Repeats:
    """Samples equal to the one before: their share, and their longest run.

    `run_start`: first index; `run_count`: number of samples. `leap` is the median step
    of a column between values that differ, in parts of its smallest step, the largest
    of the columns: near 1 for a signal that hardly moves by more than its own
    resolution and therefore repeats without being held.
    """

    share: float
    run_start: int
    run_count: int
    leap: float


def repeats(values: ArrayLike) -> Repeats:
    """Return the repeated samples of values (n, k).

    A sample repeats where all k columns equal those of the sample before.
    """
    array = np.asarray(values, dtype=np.float64)
    if len(array) < 2:
        return Repeats(0.0, 0, len(array), 1.0)
    steps = np.abs(np.diff(array, axis=0))
    new = np.append(True, (steps != 0.0).any(axis=1))
    starts = np.flatnonzero(new)
    lengths = np.diff(np.append(starts, len(array)))
    longest = int(np.argmax(lengths))
    moves = [column[column > 0.0] for column in steps.T]
    leap = max((float(median(item) / item.min()) for item in moves if item.size), default=1.0)
    return Repeats(float(np.mean(~new[1:])), int(starts[longest]), int(lengths[longest]), leap)


def hold_period_s(t_s: ArrayLike, values: ArrayLike) -> float | None:
    """Return the period [s] at which values (n, k) come anew; None if not held.

    A record that is written several times for each value changes at the steps of one
    period alone, and in most of them. One that a pilot holds for a while does neither.

    >>> t = 0.1 * np.arange(2000)
    >>> hold_period_s(t, np.sin(0.5 * np.floor(t / 0.5 + 1e-9))[:, None])
    0.5
    >>> hold_period_s(t, np.sin(t)[:, None])
    """
    at, array = np.asarray(t_s, dtype=np.float64), np.asarray(values, dtype=np.float64)
    changes = at[1:][(np.diff(array, axis=0) != 0.0).any(axis=1)]
    if changes.size < FEWEST_CHANGES:
        return None
    step, gaps = float(median(np.diff(at))), np.diff(changes)
    period = float(median(gaps))
    anew = changes.size * period / float(np.ptp(changes))
    regular = float(np.mean(gaps > period - 1.5 * step)) > SURE_OF_PERIOD
    slow = period > HELD_STEPS * step and regular and anew > LEAST_ANEW
    return round(period, 2) if slow else None


def slow_speed(velocity: ArrayLike) -> float:
    """Return a speed along an axis at which a vehicle (n, 3) may rest or start.

    Four usual changes from sample to sample, or twice the smallest speed that is written:
    some sensors write zero below a threshold.
    """
    values = np.nan_to_num(np.asarray(velocity, dtype=np.float64))
    speed = np.abs(values).max(axis=1)
    moving = speed > 0.0
    if not moving.any():
        return 0.0
    steps = np.abs(np.diff(values, axis=0)).max(axis=1)[moving[1:] & moving[:-1]]
    usual = float(median(steps)) if steps.size else 0.0
    return max(4.0 * usual, 2.0 * float(np.percentile(speed[moving], 1.0)))


def flat_top(values: ArrayLike) -> int:
    """Return how many samples of values (n,) stand at an end of the signal's range.

    Runs of three or more at the largest or smallest value, as a clipped signal has.
    """
    x = np.asarray(values, dtype=np.float64)
    if x.size < 3:
        return 0
    at = (x == x.max()) | (x == x.min())
    inner = at[:-2] & at[1:-1] & at[2:] & (x[:-2] == x[1:-1]) & (x[1:-1] == x[2:])
    run = np.zeros(x.size, bool)
    for shift in range(3):
        run[shift : shift + inner.size] |= inner
    return int(np.count_nonzero(run))


@dataclass(frozen=True)
class AttitudeDifference:
    """Medians over time of the angles [rad] between two records of one attitude.

    Whole rotation, tilt (roll and pitch together), heading.
    """

    angle: float
    tilt: float
    heading: float


def attitude_difference(
    t_s: ArrayLike, euler: ArrayLike, t_other: ArrayLike, other: ArrayLike
) -> AttitudeDifference | None:
    """Compare attitude (n, 3) with the samples of another (m, 3) nearest in time.

    ZYX angles [rad] at t_s (n,) and t_other (m,) [s]. Samples more than half the usual
    step apart in time are left out; None if fewer than 20 remain.
    """
    t, second = np.asarray(t_s, dtype=np.float64), np.asarray(t_other, dtype=np.float64)
    first, angles = np.asarray(euler, dtype=np.float64), np.asarray(other, dtype=np.float64)
    if t.size < FEWEST or second.size < FEWEST:
        return None
    near = nearest(t, second)
    good = np.abs(second[near] - t) <= 0.5 * max(
        float(median(np.diff(t))), float(median(np.diff(second)))
    )
    good &= np.isfinite(first).all(axis=1) & np.isfinite(angles[near]).all(axis=1)
    if np.count_nonzero(good) < FEWEST:
        return None
    kept = thinned(np.flatnonzero(good))
    one, two = rotation_body_to_ned(first[kept]), rotation_body_to_ned(angles[near[kept]])
    trace = np.einsum("nij,nij->n", one, two)
    down = np.einsum("ni,ni->n", one[:, 2], two[:, 2])
    turn = np.angle(np.exp(1j * (first[kept, 2] - angles[near[kept], 2])))
    return AttitudeDifference(
        angle=float(median(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))),
        tilt=float(median(np.arccos(np.clip(down, -1.0, 1.0)))),
        heading=float(median(np.abs(turn))),
    )


def nearest(times: Array, there: Array) -> npt.NDArray[np.intp]:
    """Return the indexes (n,) of the times `there` (m,) nearest to `times` (n,).

    `there` increases.
    """
    right = np.clip(np.searchsorted(there, times), 1, max(there.size - 1, 1))
    right = np.minimum(right, there.size - 1)
    left = np.maximum(right - 1, 0)
    return np.where(np.abs(there[left] - times) <= np.abs(there[right] - times), left, right)


def thinned(indexes: npt.NDArray[np.intp], most: int = MOST_SAMPLES) -> npt.NDArray[np.intp]:
    """Return every n-th of the indexes, so that at most about `most` remain."""
    return indexes[:: max(1, -(-indexes.size // most))]


@dataclass(frozen=True)
class Gravity:
    """Median length of an accelerometer's reading, and its angle to the vertical.

    `angle` [rad]: median between the reading and the specific force at rest that the
    attitude implies (straight up); None without an attitude.
    """

    magnitude: float
    angle: float | None


def gravity(
    t_s: ArrayLike,
    accel: ArrayLike,
    t_attitude: ArrayLike | None = None,
    euler: ArrayLike | None = None,
) -> Gravity | None:
    """Return gravity as accelerometer samples (n, 3) in body axes show it.

    At t_s (n,) [s]; attitude (m, 3) [rad] at t_attitude (m,) if there is one. A vehicle
    at rest shows the specific force -g in its down direction: P_v^T [0 0 -g]. None for
    fewer than 20 finite samples.
    """
    t, values = np.asarray(t_s, dtype=np.float64), np.asarray(accel, dtype=np.float64)
    rows = thinned(np.flatnonzero(np.isfinite(values).all(axis=1)))
    if rows.size < FEWEST:
        return None
    t, values = t[rows], values[rows]
    size = np.linalg.norm(values, axis=1)
    if t_attitude is None or euler is None or np.asarray(t_attitude).size < FEWEST:
        return Gravity(float(median(size)), None)
    at, angles = np.asarray(t_attitude, dtype=np.float64), np.asarray(euler, dtype=np.float64)
    near = nearest(t, at)
    close = (np.abs(at[near] - t) <= LONGEST_INTERVAL_S) & (size > 0.0)
    if np.count_nonzero(close) < FEWEST:
        return Gravity(float(median(size)), None)
    up = -rotation_body_to_ned(angles[near[close]])[:, 2]
    cosine = np.einsum("ni,ni->n", values[close], up) / size[close]
    return Gravity(float(median(size)), float(np.arccos(np.clip(np.median(cosine), -1.0, 1.0))))


@dataclass(frozen=True)
class Following:
    """Ratio of the sizes of two signals with the sign of their correlation.

    `scale`: variation of the second per that of the first. Noise in either does not
    pull the ratio towards zero as it does a slope.
    """

    scale: float
    correlation: float


def following(t_s: ArrayLike, x: ArrayLike, t_other: ArrayLike, y: ArrayLike) -> Following | None:
    """Compare y (m,) at t_other (m,) with x (n,) at t_s (n,), or None for too few.

    x is interpolated to the times of y within its span.
    """
    t, values = np.asarray(t_s, dtype=np.float64), np.asarray(x, dtype=np.float64)
    at, other = np.asarray(t_other, dtype=np.float64), np.asarray(y, dtype=np.float64)
    rows = (
        thinned(np.flatnonzero((at >= t[0]) & (at <= t[-1]) & np.isfinite(other)))
        if t.size
        else np.zeros(0, np.intp)
    )
    if rows.size < FEWEST:
        return None
    first = np.interp(at[rows], t, values)
    first, second = first - first.mean(), other[rows] - other[rows].mean()
    energy = float(first @ first)
    if energy == 0.0:
        return None
    other_energy = float(second @ second)
    size = float(np.sqrt(energy * other_energy))
    correlation = float(first @ second) / size if size else 0.0
    return Following(
        float(np.sqrt(other_energy / energy)) * (-1.0 if correlation < 0.0 else 1.0), correlation
    )


AROUND, BEYOND_OTHERS, OF_STEP, LONGEST_OF_USUAL = 5, 3.0, 0.7, 1.5
"""Samples on either side of a jump, how many times their steps it is, the part of it by
which the medians of both sides differ, and the longest time that it may take, in usual steps.
"""


def jumps(t_s: ArrayLike, values: ArrayLike, *, least: float, rate: float) -> npt.NDArray[np.intp]:
    """Return the samples (k,) before steps to another level, which the record keeps.

    A step is larger than `least`, faster than `rate` per second, and larger than those
    around it; a value that is held counts once, and a pause tells nothing.
    """
    t, x = np.asarray(t_s, dtype=np.float64), np.asarray(values, dtype=np.float64)
    fresh = np.flatnonzero(np.diff(x, prepend=np.inf) != 0.0)
    t, x = t[fresh], x[fresh]
    step, took = np.diff(x), np.diff(t)
    soon = took < LONGEST_OF_USUAL * (np.median(took) if took.size else 0.0)
    large = np.flatnonzero(soon & (np.abs(step) > np.maximum(least, rate * took)))
    large = large[(large >= AROUND - 1) & (large < x.size - AROUND)]
    if not large.size:
        return large
    near = large[:, None] + np.arange(1 - AROUND, AROUND + 1)
    sides = np.split(x[near], 2, axis=1)
    rise = np.median(sides[1], axis=1) - np.median(sides[0], axis=1)
    others = np.max([np.abs(np.diff(side, axis=1)).max(axis=1) for side in sides], axis=0)
    own = step[large]
    stays = (np.abs(own) > BEYOND_OTHERS * others) & (rise * np.sign(own) > OF_STEP * np.abs(own))
    return np.asarray(fresh[large[stays] + 1] - 1, dtype=np.intp)


def rounding_step(values: Array) -> float | None:
    """Return the step of which all values (n,) are multiples, None without one."""
    sizes = np.unique(values[np.isfinite(values)])
    gaps = np.diff(sizes)
    gaps = gaps[gaps > ROUNDING * np.ptp(sizes)] if sizes.size else gaps
    if gaps.size < FEWEST_STEPS:
        return None
    step = float(gaps.min())
    places = (sizes - sizes[0]) / step
    return step if float(np.abs(places - np.round(places)).max()) < LATTICE else None
