"""Measures of the health of recorded signals.

Clocks, repeated and stuck samples, and whether sensors of one motion agree. Nothing
here decides: every function returns measured values, the thresholds stand with the
checks that use them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned

MOST_SAMPLES = 4000
"""Statistics over long records use every n-th sample, so that there are at most about
this many.
"""
RATE_INTERVAL_S, LONGEST_INTERVAL_S = 0.1, 0.5
"""Attitude is differenced over at least the first (shorter intervals amplify its
rounding) and at most the second (turns are lost).
"""
LARGEST_LAG_S, LAG_STEP_S = 0.5, 0.02
SMALLEST_JUMP_RAD, JUMP_SPREADS = 0.1, 5.0
"""A jump of the attitude: more than this, and than so many times what 90 % of the
intervals disagree by.
"""
DRIFT_S, LONGEST_RESPONSE_S = 10.0, 600.0
FEWEST = 20
USUAL_PERCENT, PAUSE_USUAL = 85.0, 3.0
"""A step of more than this many times the step that 85 % of them stay below is a pause
and does not count for the rate.
"""


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
    leap = max((float(np.median(item) / item.min()) for item in moves if item.size), default=1.0)
    return Repeats(float(np.mean(~new[1:])), int(starts[longest]), int(lengths[longest]), leap)


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
        float(np.median(np.diff(t))), float(np.median(np.diff(second)))
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
        angle=float(np.median(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))),
        tilt=float(np.median(np.arccos(np.clip(down, -1.0, 1.0)))),
        heading=float(np.median(np.abs(turn))),
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
class RateAgreement:
    """Gyro against the rate of the attitude.

    `correlation` (3, 3): attitude rate about axis i with gyro about axis j, the gyro
    read `lag_s` later; `scale` (3,): gyro per attitude rate of the same axis; `std`
    (3,) of the attitude's body rates and `bias` (3,), the mean of the gyro less theirs
    [rad/s]; `count` of intervals. A positive lag: the gyro shows a turn after the
    attitude does. `jumps` intervals in which the attitude turned without the gyro, by
    `largest_jump` [rad] at most, are left out of the comparison; `jump_at_s` is the
    time of the largest.
    """

    correlation: Array
    scale: Array
    lag_s: float
    std: Array
    bias: Array
    count: int
    jumps: int
    largest_jump: float
    jump_at_s: float


def attitude_jumps(
    t_s: ArrayLike, euler: ArrayLike, t_gyro: ArrayLike, gyro: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return begin, end [s], size [rad] (k,) of turns that the gyro does not show.

    An interval counts if the difference is more than 0.1 rad, five times what 90 % of
    the intervals disagree by, and what a slow gyro may miss between its samples.
    """
    turns = _turns(t_s, euler, t_gyro, gyro)
    if turns is None:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    t, rows, _, _, unexplained, jumped = turns
    return t[rows[jumped]], t[rows[jumped] + 1], unexplained[jumped]


def rate_agreement(
    t_s: ArrayLike, euler: ArrayLike, t_gyro: ArrayLike, gyro: ArrayLike
) -> RateAgreement | None:
    """Compare the body rate between attitudes (n, 3) with the gyro (m, 3).

    Attitude in rad, gyro in rad/s, over the same intervals. The mean body rate is the
    rotation vector between the two attitudes over their distance in time, exact for a
    steady turn and free of the singularity at a pitch of 90 degrees. The lag is
    searched within 0.5 s. None for fewer than 20 intervals that far from the ends of
    the gyro. Jumps are counted over the whole record, as `attitude_jumps` finds them;
    the rest on every n-th interval of a long one.
    """
    turns = _turns(t_s, euler, t_gyro, gyro)
    if turns is None:
        return None
    t, rows, expected, mean_rate, unexplained, jumped = turns
    worst = int(np.argmax(np.where(jumped, unexplained, 0.0)))
    jump, jump_at = (
        (float(unexplained[worst]), float(t[rows[worst]])) if jumped.any() else (0.0, 0.0)
    )
    at = np.asarray(t_gyro, dtype=np.float64)
    inside = (t[rows] >= at[0] + LARGEST_LAG_S) & (t[rows + 1] <= at[-1] - LARGEST_LAG_S)
    if np.count_nonzero(inside) < FEWEST:
        return None
    kept = thinned(np.flatnonzero(inside))
    kept = kept[~jumped[kept]]
    if kept.size < FEWEST:
        return None
    rows, expected = rows[kept], expected[kept]
    centred = expected - expected.mean(axis=0)
    energy = centred.std(axis=0)
    lags = np.arange(-LARGEST_LAG_S, LARGEST_LAG_S + LAG_STEP_S / 2, LAG_STEP_S)
    # The best of the three axes, so that exchanged axes do not send the search astray.
    best = np.abs(_correlation(centred, mean_rate(rows, lags))).max(axis=-1)
    lag = _peak(lags, np.sum(best * energy**2, axis=-1))
    measured = mean_rate(rows, lag)
    deviation = measured - measured.mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Total least squares in one dimension keeps noise in either record from pulling
        # the ratio down.
        scale = np.sign(np.sum(centred * deviation, axis=0)) * deviation.std(axis=0) / energy
    bias = np.median(measured - expected, axis=0)
    return RateAgreement(
        _correlation(centred, measured),
        scale,
        lag,
        energy,
        bias,
        int(rows.size),
        int(np.count_nonzero(jumped)),
        jump,
        jump_at,
    )


def _turns(
    t_s: ArrayLike, euler: ArrayLike, t_gyro: ArrayLike, gyro: ArrayLike
) -> (
    tuple[
        Array,
        npt.NDArray[np.intp],
        Array,
        Callable[[npt.NDArray[np.intp], ArrayLike], Array],
        Array,
        npt.NDArray[np.bool_],
    ]
    | None
):
    """Return the intervals between attitudes, or None for too few.

    Times, rows, mean body rates, that of the gyro at a lag, what differs [rad], which
    are jumps.
    """
    from scipy.spatial.transform import Rotation

    t, angles = np.asarray(t_s, dtype=np.float64), np.asarray(euler, dtype=np.float64)
    at, rates = np.asarray(t_gyro, dtype=np.float64), np.asarray(gyro, dtype=np.float64)
    if t.size < FEWEST or at.size < FEWEST:
        return None
    stride = max(1, int(np.ceil(RATE_INTERVAL_S / np.median(np.diff(t)) - 0.01)))
    t, angles = t[::stride], angles[::stride]
    width = np.diff(t)
    inside = (
        (t[:-1] >= at[0])
        & (t[1:] <= at[-1])
        & (width <= LONGEST_INTERVAL_S * max(1.0, stride / 10))
    )
    # A gyro interval is only as good as the samples in it: none across a pause of the
    # gyro.
    pauses = np.append(0, np.cumsum(np.diff(at) > LONGEST_INTERVAL_S))
    before, after = np.searchsorted(at, t[:-1]) - 1, np.searchsorted(at, t[1:])
    inside &= pauses[np.clip(before, 0, at.size - 1)] == pauses[np.clip(after, 0, at.size - 1)]
    rows = np.flatnonzero(inside)
    if rows.size < FEWEST:
        return None
    turn = Rotation.from_euler("ZYX", angles[:, ::-1])
    expected = (turn[rows].inv() * turn[rows + 1]).as_rotvec() / width[rows, None]
    angle = np.concatenate(
        [np.zeros((1, 3)), np.cumsum(0.5 * (rates[1:] + rates[:-1]) * np.diff(at)[:, None], axis=0)]
    )

    def mean_rate(of: npt.NDArray[np.intp], lags: ArrayLike) -> Array:
        """Return the mean (..., n, 3) over intervals (n,), read lags (...) later."""
        late = np.asarray(lags, dtype=np.float64)[..., None]
        ends = [
            np.stack([np.interp(t[side] + late, at, angle[:, axis]) for axis in range(3)], axis=-1)
            for side in (of, of + 1)
        ]
        return np.asarray((ends[1] - ends[0]) / width[of, None])

    unexplained = np.linalg.norm((expected - mean_rate(rows, 0.0)) * width[rows, None], axis=1)
    # A slow gyro may miss what it turned between its samples: by no more than its
    # change over the interval.
    missed = np.linalg.norm(
        rates[np.clip(after[rows], 0, at.size - 1)] - rates[np.clip(before[rows], 0, at.size - 1)],
        axis=1,
    )
    missed *= np.maximum(width[rows], float(np.median(np.diff(at))))
    jumped = unexplained > np.maximum(
        max(SMALLEST_JUMP_RAD, JUMP_SPREADS * float(np.percentile(unexplained, 90.0))), missed
    )
    return t, rows, expected, mean_rate, unexplained, jumped


def _correlation(first: Array, second: Array) -> Array:
    """Return the correlation (..., k, l) between columns of (n, k) and (..., n, l).

    0 for a constant column.
    """
    one, two = first - first.mean(axis=0), second - second.mean(axis=-2, keepdims=True)
    lengths = np.linalg.norm(one, axis=0)[:, None], np.linalg.norm(two, axis=-2)[..., None, :]
    size = lengths[0] * lengths[1]
    return np.asarray(np.divide(one.T @ two, size, out=np.zeros_like(size), where=size > 0.0))


def _peak(x: Array, y: Array) -> float:
    """Return the place of the largest y (n,) at evenly spaced x (n,), by a parabola.

    At an end, the sample itself.
    """
    top = int(np.argmax(y))
    if top in (0, x.size - 1):
        return float(x[top])
    low, middle, high = y[top - 1 : top + 2]
    bend = low - 2.0 * middle + high
    return float(x[top] + (0.5 * (low - high) / bend if bend < 0.0 else 0.0) * (x[1] - x[0]))


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
        return Gravity(float(np.median(size)), None)
    at, angles = np.asarray(t_attitude, dtype=np.float64), np.asarray(euler, dtype=np.float64)
    near = nearest(t, at)
    close = (np.abs(at[near] - t) <= LONGEST_INTERVAL_S) & (size > 0.0)
    if np.count_nonzero(close) < FEWEST:
        return Gravity(float(np.median(size)), None)
    up = -rotation_body_to_ned(angles[near[close]])[:, 2]
    cosine = np.einsum("ni,ni->n", values[close], up) / size[close]
    return Gravity(float(np.median(size)), float(np.arccos(np.clip(np.median(cosine), -1.0, 1.0))))


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


@dataclass(frozen=True)
class Response:
    """Lag [s] of a motion behind commands, and the share of variance they explain.

    The share is adjusted for the number of commands.
    """

    lag_s: float
    explained: float


def response_lag(
    t_command: ArrayLike,
    command: ArrayLike,
    t_motion: ArrayLike,
    motion: ArrayLike,
    *,
    lags_s: tuple[float, float],
    rate_hz: float,
) -> Response | None:
    """Return the lag of motion (m,) behind commands (n, k).

    It is the lag whose least-squares fit of the motion by all commands is best. Both
    are interpolated to a uniform clock of `rate_hz` (commands too: held ones would seem
    half a step of the log early), and a moving mean over 10 s is taken off both,
    because slow drifts always look alike. Lags between the two of `lags_s` are tried in
    steps of the clock. The lag holds the delay and the inertia of the vehicle together.
    At most ten minutes in the middle of the common span are used. None for fewer than
    100 samples, less than 20 s, or commands that stand still.
    """
    at, inputs = np.asarray(t_command, dtype=np.float64), np.asarray(command, dtype=np.float64)
    t, output = np.asarray(t_motion, dtype=np.float64), np.asarray(motion, dtype=np.float64)
    inputs = inputs[:, np.ptp(inputs, axis=0) > 0.0] if len(inputs) else inputs
    if not inputs.size or not t.size:
        return None
    early, late = round(lags_s[0] * rate_hz), round(lags_s[1] * rate_hz)
    start, end = max(at[0] + late / rate_hz, t[0]), min(at[-1] + early / rate_hz, t[-1])
    middle, half = 0.5 * (start + end), min(0.5 * (end - start), LONGEST_RESPONSE_S / 2.0)
    count, width = int(2.0 * half * rate_hz), round(DRIFT_S * rate_hz)
    if end - start < 2.0 * DRIFT_S or count < 100:
        return None
    clock = middle - half + np.arange(-late, count - early) / rate_hz
    commands = _without_drift(
        np.stack([np.interp(clock, at, column) for column in inputs.T], axis=1), width
    )
    response = _without_drift(np.interp(clock[late : late + count], t, output), width)
    total = float(response @ response)
    if total == 0.0:
        return None
    lags = np.arange(early, late + 1)
    shares = _explained(
        [commands[late - lag : late - lag + count] for lag in lags], response, total
    )
    return Response(_peak(lags / rate_hz, shares), float(shares.max()))


def without_drift(motion: ArrayLike, t_s: ArrayLike) -> Array:
    """Return a signal (n,) at t_s (n,) [s] less its moving mean over 10 s."""
    step = float(np.median(np.diff(np.asarray(t_s, dtype=np.float64))))
    width = max(1, round(DRIFT_S / step)) if step > 0.0 else 1
    return _without_drift(np.asarray(motion, dtype=np.float64), width)


def _without_drift(values: Array, width: int) -> Array:
    """Return values (n,) or (n, k) less their moving mean over `width` samples."""
    from scipy.ndimage import uniform_filter1d

    drift: Array = uniform_filter1d(values, width, axis=0, mode="nearest")
    return np.asarray(values - drift)


def _explained(designs: list[Array], response: Array, total: float) -> Array:
    """Return the adjusted share of variance of (n,) explained by each design (n, k)."""
    moment = np.stack([design.T @ design for design in designs])
    cross = np.stack([design.T @ response for design in designs])
    count, width = designs[0].shape
    # A little ridge: outputs of a mixer are often linear combinations of each other.
    ridge = 1e-9 * np.maximum(np.trace(moment, axis1=1, axis2=2), 1e-30)
    moment += np.eye(width) * ridge[:, None, None]
    share = np.sum(cross * np.linalg.solve(moment, cross[..., None])[..., 0], axis=1) / total
    return np.asarray(1.0 - (1.0 - share) * (count - 1) / (count - width - 1))
