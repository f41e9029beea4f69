"""Whether attitude and gyro turn alike: scale, lag, bias and jumps between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, median, unwrapped
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.checks.motion_checks import WINDOW_S, integrals, windows
from auvid.hydro.identification.checks.response import peak_of_parabola
from auvid.hydro.identification.checks.robust_gains import fitted_gains
from auvid.hydro.identification.checks.signal_checks import (
    FEWEST,
    LONGEST_INTERVAL_S,
    RATE_INTERVAL_S,
    thinned,
)
from auvid.hydro.identification.signals.pose.frames import quaternion_of_euler
from auvid.hydro.kept_results import kept

LARGEST_LAG_S, LAG_STEP_S = 0.5, 0.02
ALIKE = 0.1
"""Departure of a scale from 1 that is none."""
MOST_ALIKE = 0.9999
"""Correlation up to which axes are told apart: what rounding leaves decides nothing."""
IN_TIME_S = 0.05
"""Lags that are none: a lag between samples takes noise off, and so looks better than 0."""
LARGEST_AXIS_LAG_S = 1.0
OTHER_ORDERS = ("ZXY", "XYZ", "XZY", "YXZ", "YZX")
"""Orders of turns about the axes of the body, beside the yaw, pitch, roll of ZYX."""
ORDER_WINDOW_S = 1.0
STEEPEST_RAD = 1.2
"""Largest pitch at which a heading is compared by itself."""
SMALLEST_JUMP_RAD, JUMP_SPREADS = 0.1, 5.0
"""A jump of the attitude: more than this, and than so many times what 90 % of the
intervals disagree by.
"""


@dataclass(frozen=True)
class RateAgreement:
    """Gyro against the rate of the attitude.

    `correlation` (3, 3): attitude rate about axis i with gyro about axis j, the gyro
    read `lag_s` later, `largest` (3, 3) its size at any lag, and `lags_s` (3,) the best
    lag of each axis by itself; `scale` (3,): gyro per attitude rate of the same axis,
    near 1 where noise in either record leaves that open; `std` (3,) of the attitude's
    body rates, `usual` (3,), that by what 95 % of them stay below, and `bias` (3,), the
    mean of the gyro less theirs [rad/s]; `count` of intervals. A positive lag: the gyro
    shows a turn after the attitude does; `lag_odds` (3,): logarithm of its likelihood
    over that of any within .05 s, by each axis. `jumps` intervals in which the attitude
    turned without the gyro, by `largest_jump` [rad] at most, are left out of the
    comparison; `jump_at_s` is the time of the largest.
    """

    correlation: Array
    scale: Array
    lag_s: float
    lags_s: Array
    lag_odds: Array
    std: Array
    usual: Array
    bias: Array
    count: int
    jumps: int
    largest_jump: float
    jump_at_s: float
    largest: Array


@kept
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
    t, rows = turns.t, turns.rows[turns.jumped]
    return t[rows], t[rows + 1], turns.unexplained[turns.jumped]


@kept
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
    t, rows, expected = turns.t, turns.rows, turns.expected
    unexplained, jumped = turns.unexplained, turns.jumped
    worst = int(np.argmax(np.where(jumped, unexplained, 0.0)))
    jump, jump_at = (
        (float(unexplained[worst]), float(t[rows[worst]])) if jumped.any() else (0.0, 0.0)
    )
    at = turns.at
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
    by_lag = _correlation(centred, turns.mean_rate(rows, lags))
    best = np.abs(by_lag).max(axis=-1)
    own = np.diagonal(by_lag, axis1=1, axis2=2)
    with np.errstate(divide="ignore", invalid="ignore"):  # noise of a quiet axis has no say
        likely = -np.log1p(-np.square(np.minimum(np.nan_to_num(best), MOST_ALIKE)))
    lag = peak_of_parabola(lags, np.sum(likely, axis=-1))
    measured = turns.mean_rate(rows, lag)
    deviation = measured - measured.mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Noise of the attitude pulls the slope on it down, noise of the gyro pushes the
        # inverse slope on the gyro up: the truth lies between. Where that leaves a scale
        # of 1 open, it is 1.
        covered = np.mean(centred * deviation, axis=0)
        low, high = np.abs(covered) / energy**2, deviation.var(axis=0) / np.abs(covered)
        nearest = np.clip(1.0, low, high)
        open_to_1 = np.abs(nearest - 1.0) < ALIKE
        scale = np.sign(covered) * np.where(open_to_1, nearest, np.sqrt(low * high))
    bias = median(measured - expected)
    correlation = _correlation(centred, measured)
    in_time = np.abs(own[np.abs(lags) <= IN_TIME_S]).max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = (1.0 - in_time**2) / (1.0 - np.diagonal(correlation) ** 2)
        odds = 0.5 * rows.size * np.log(left)
    return RateAgreement(
        correlation,
        scale,
        lag,
        np.array([peak_of_parabola(lags, axis) for axis in own.T]),
        odds,
        energy,
        np.percentile(np.abs(centred), 95.0, axis=0) / NORMAL_95,
        bias,
        int(rows.size),
        int(np.count_nonzero(jumped)),
        jump,
        jump_at,
        np.abs(by_lag).max(axis=0),
    )


@kept
def axis_lag(
    t_s: ArrayLike, euler: ArrayLike, t_gyro: ArrayLike, gyro: ArrayLike, *, axis: int
) -> float | None:
    """Return how late the gyro shows the turns about one axis [s], within a second.

    None for too few intervals.
    """
    turns = _turns(t_s, euler, t_gyro, gyro)
    if turns is None:
        return None
    t, rows, expected = turns.t, turns.rows, turns.expected
    at, most = turns.at, LARGEST_AXIS_LAG_S
    inside = ~turns.jumped & (t[rows] >= at[0] + most) & (t[rows + 1] <= at[-1] - most)
    kept = thinned(np.flatnonzero(inside))
    if kept.size < FEWEST:
        return None
    lags = np.arange(-most, most + LAG_STEP_S / 2, LAG_STEP_S)
    turned = expected[kept] - expected[kept].mean(axis=0)
    own = _correlation(turned[:, [axis]], turns.mean_rate(rows[kept], lags)[..., [axis]])
    return float(peak_of_parabola(lags, own[:, 0, 0]))


def in_order(euler: Array, order: str) -> Array:
    """Return roll, pitch, yaw (n, 3) of ZYX for the same three of turns in an order."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_euler(order, euler[:, ["XYZ".index(axis) for axis in order]])
    return np.asarray(turn.as_euler("ZYX")[:, ::-1])


@kept
def other_order(
    t_s: ArrayLike, euler: ArrayLike, t_gyro: ArrayLike, gyro: ArrayLike
) -> tuple[str, float, float] | None:
    """Return the order of turns that leaves least between attitude and gyro.

    With the part of what ZYX leaves over windows of 1 s, and the logarithm of its
    likelihood over ZYX. None for too few intervals.
    """
    turns = _turns(t_s, euler, t_gyro, gyro)
    if turns is None:
        return None
    t, rows = turns.t, turns.rows
    step = t[rows + 1] - t[rows]
    window = np.floor((t[rows] - t[0]) / ORDER_WINDOW_S)
    first = np.flatnonzero(np.diff(window, prepend=-1.0))
    complete = np.add.reduceat(step, first) > 0.8 * ORDER_WINDOW_S
    count = int(np.count_nonzero(complete))
    if count < FEWEST:
        return None
    by_gyro = turns.mean_rate(rows, 0.0) * step[:, None]
    turned = {"ZYX": turns.expected * step[:, None]}
    for order in OTHER_ORDERS:
        turned[order] = _turned_by(quaternion_of_euler(in_order(turns.angles, order)), rows)
    left: dict[str, float] = {}
    for order, own in turned.items():
        sums = np.add.reduceat(own - by_gyro, first, axis=0)[complete]
        left[order] = max(float(median(_length(sums - median(sums)))), 1e-9)
    best = min(OTHER_ORDERS, key=lambda order: left[order])
    return best, left[best] / left["ZYX"], count * float(np.log(left["ZYX"] / left[best]))


@dataclass(frozen=True)
class Deviation:
    """By how much a heading swings with itself, as of a compass beside iron.

    `angle` [rad] of the sine of the heading, its standard deviation `sd`; `explained`:
    share of what heading and gyro differ by; `turned` [rad], the range of the heading.
    """

    angle: float
    sd: float
    explained: float
    turned: float


@kept
def deviation(t_s: Array, euler: Array, t_gyro: Array, gyro: Array) -> Deviation | None:
    """Return how a heading deviates with itself against the gyro.

    Change of heading less the gyro's = A (sin psi)' + B (cos psi)' + C gyro + D, beside the
    same of 2 psi as of soft iron, over windows of 2 s. None for too few, and for a vehicle
    that stands on end.
    """
    if np.abs(euler[:, 1]).max() > STEEPEST_RAD:
        return None
    width = 2.0 * WINDOW_S
    phi, theta = (np.interp(t_gyro, t_s, euler[:, column]) for column in (0, 1))
    rate = (gyro[:, 1] * np.sin(phi) + gyro[:, 2] * np.cos(phi)) / np.cos(theta)
    at = windows(max(t_s[0], t_gyro[0]), min(t_s[-1], t_gyro[-1]), t_s, t_gyro, width_s=width)
    if at.size < FEWEST:
        return None
    heading = unwrapped(euler[:, 2])
    first, last = (np.interp(side, t_s, heading) for side in (at, at + width))
    turned = integrals(t_gyro, rate[:, None], at, width)[:, 0]
    swings = [
        wave(order * last) - wave(order * first) for order in (1, 2) for wave in (np.sin, np.cos)
    ]
    gains = fitted_gains(last - first - turned, np.column_stack([*swings, turned]))
    if gains is None:
        return None
    angle, sd = float(np.hypot(*gains.gain[:2])), float(gains.sd[:2].max())
    return Deviation(angle, sd, gains.explained, float(np.ptp(heading)))


@dataclass(frozen=True)
class _Turns:
    """Intervals between attitudes (n, 3) at t (n,), by their first rows (m,).

    `expected` (m, 3): mean body rates; `angle` (k, 3) that the gyro turned since its
    first sample, at times `at` (k,); what differs over an interval, `unexplained` (m,)
    [rad], and which of them are jumps (m,).
    """

    t: Array
    angles: Array
    rows: npt.NDArray[np.intp]
    expected: Array
    at: Array
    angle: Array
    unexplained: Array
    jumped: npt.NDArray[np.bool_]

    def mean_rate(self, of: npt.NDArray[np.intp], lags: ArrayLike) -> Array:
        """Return the mean gyro (..., n, 3) over intervals, read lags (...) later."""
        return _mean_rates(self.t, of, self.at, self.angle, np.asarray(lags, dtype=np.float64))


FEW = 8
"""Results with a row for each sample that are kept: candidates come one after another."""
MOST_KEPT_ROWS = 50_000
"""Those of a longer record are not: they would stay in memory to the end of a run."""


@partial(kept, most=FEW, longest=MOST_KEPT_ROWS)
def _turns(t_s: ArrayLike, euler: ArrayLike, t_gyro: ArrayLike, gyro: ArrayLike) -> _Turns | None:
    """Return the intervals between attitudes, or None for too few."""
    t, angles = np.asarray(t_s, dtype=np.float64), np.asarray(euler, dtype=np.float64)
    at, rates = np.asarray(t_gyro, dtype=np.float64), np.asarray(gyro, dtype=np.float64)
    if t.size < FEWEST or at.size < FEWEST:
        return None
    stride = max(1, int(np.ceil(RATE_INTERVAL_S / median(np.diff(t)) - 0.01)))
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
    expected = _turned_by(quaternion_of_euler(angles), rows) / width[rows, None]
    angle = np.zeros(rates.shape)
    np.cumsum(0.5 * (rates[1:] + rates[:-1]) * np.diff(at)[:, None], axis=0, out=angle[1:])
    differs = expected - _mean_rates(t, rows, at, angle, np.zeros(()))
    unexplained = _length(differs * width[rows, None])
    # A slow gyro may miss what it turned between its samples: by no more than its
    # change over the interval.
    missed = _length(
        rates[np.clip(after[rows], 0, at.size - 1)] - rates[np.clip(before[rows], 0, at.size - 1)]
    )
    missed *= np.maximum(width[rows], float(median(np.diff(at))))
    jumped = unexplained > np.maximum(
        max(SMALLEST_JUMP_RAD, JUMP_SPREADS * float(np.percentile(unexplained, 90.0))), missed
    )
    return _Turns(t, angles, rows, expected, at, angle, unexplained, jumped)


def _length(vectors: Array) -> Array:
    """Return the lengths (n,) of vectors (n, 3)."""
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def _turned_by(quaternions: Array, rows: npt.NDArray[np.intp]) -> Array:
    """Return the rotation vectors (m, 3) from each row to the next.

    Of unit quaternions (n, 4), w first.
    """
    (w1, x1, y1, z1), (w2, x2, y2, z2) = quaternions[rows].T, quaternions[rows + 1].T
    w = w1 * w2 + x1 * x2 + y1 * y2 + z1 * z2
    part = np.stack(
        [
            w1 * x2 - x1 * w2 - y1 * z2 + z1 * y2,
            w1 * y2 - y1 * w2 - z1 * x2 + x1 * z2,
            w1 * z2 - z1 * w2 - x1 * y2 + y1 * x2,
        ],
        axis=1,
    )
    sine = _length(part)
    angle = 2.0 * np.arctan2(sine, np.abs(w)) * np.where(w < 0.0, -1.0, 1.0)
    scale = np.divide(angle, sine, out=np.full(w.shape, 2.0), where=sine > 1e-12)
    return np.asarray(scale[:, None] * part)


@partial(kept, most=FEW, longest=MOST_KEPT_ROWS)
def _mean_rates(t: Array, of: npt.NDArray[np.intp], at: Array, angle: Array, lags: Array) -> Array:
    """Return what `_Turns.mean_rate` does."""
    late = lags[..., None]
    begin, end = t[of], t[of + 1]
    later = end + late
    # Most intervals begin where the one before ends.
    first = np.flatnonzero(np.concatenate([[True], of[1:] != of[:-1] + 1]))
    out = np.empty((3, *later.shape))
    for mean, part in zip(out, angle.T, strict=True):
        there = np.interp(later, at, part)
        np.subtract(there[..., 1:], there[..., :-1], out=mean[..., 1:])
        mean[..., first] = there[..., first] - np.interp(begin[first] + late, at, part)
    out /= end - begin
    return np.moveaxis(out, 0, -1)


def _correlation(first: Array, second: Array) -> Array:
    """Return the correlation (..., k, l) between columns of (n, k) and (..., n, l).

    0 for a constant column.
    """
    one, two = (first - first.mean(axis=0)).T, np.moveaxis(second, -1, 0)
    two = two - two.mean(axis=-1, keepdims=True)
    shared = (one @ two.reshape(-1, two.shape[-1]).T).reshape(len(one), *two.shape[:-1])
    lengths = np.linalg.norm(one, axis=1), np.linalg.norm(two, axis=-1)
    size = np.multiply.outer(*lengths)
    ratio = np.divide(shared, size, out=np.zeros_like(size), where=size > 0.0)
    return np.asarray(np.moveaxis(ratio, (0, 1), (-2, -1)))
