"""Gains between two records of one motion, axis by axis.

A body velocity is compared with what its integral does (depth, position) and with what
its rate follows (accelerometer, actuator forces), over windows that do not overlap: a
gain of 1 is a right sign, scale and unit; -1 a wrong sign; 57.3 degrees taken for rad.
Nothing here decides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Mask, unwrapped
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.identification.checks.robust_gains import (
    FEWEST_WINDOWS,
    AxisGains,
    fitted_gains,
    robust_fits,
    solved,
    stacked,
)
from auvid.hydro.kept_results import kept, signs_of
from auvid.hydro.long_series.long_arrays import laid_down, let_go

LONGEST_STEP_S = 1.0
"""A window across a longer pause of a sensor is left out."""
WINDOW_S = 1.0
MOST_WINDOWS = 60_000
"""Windows of all lags that are integrated over in one pass: it bounds the memory."""
MOST_WINDOWS_OF_A_LAG = 2400
"""Of a log longer than twenty minutes each second window counts, of hours each third or less."""
BLOCK_ROWS = 16384
"""Samples that are summed at a time."""
LEAST_UPRIGHT = 0.5
"""Cosine of the tilt below which heave hardly moves the depth."""
LAG_GAINS = (0.75, 1.33)
"""Gains at a right lag of the axes that move the depth most."""


def windows(starts: float, ends: float, *clocks: Array, width_s: float = WINDOW_S) -> Array:
    """Return the begins (n,) of windows side by side in which no clock pauses.

    Empty for clocks so slow that hardly any window would hold a sample.
    """
    if (ends - starts) / width_s > 10.0 * min(t.size for t in clocks):
        return np.zeros(0)
    at = _without_pauses(np.arange(starts, ends - width_s, width_s), clocks, width_s)
    return at[: int(np.searchsorted(at, ends - width_s))]


def shared_windows(*clocks: Array, width_s: float = WINDOW_S) -> Array:
    """Return the begins (n,) of the windows that all clocks share."""
    start, end = max(t[0] for t in clocks), min(t[-1] for t in clocks)
    return windows(start, end, *clocks, width_s=width_s)


def windows_until(
    starts: float, ends: Array, *clocks: Array, width_s: float = WINDOW_S
) -> list[Array]:
    """Return the begins of `windows` for ends (k,), in one pass over the clocks."""
    usable = (ends - starts) / width_s <= 10.0 * min(t.size for t in clocks)
    at = np.arange(starts, np.max(ends[usable], initial=starts) - width_s, width_s)
    at = _without_pauses(at, clocks, width_s)
    stops = np.where(usable, ends - width_s, -np.inf)
    return [at[at < stop] for stop in stops]


def _without_pauses(at: Array, clocks: Sequence[Array], width_s: float) -> Array:
    """Return the begins of windows in which no clock pauses."""
    good: Mask = np.ones(at.size, dtype=np.bool_)
    for t in clocks:
        pauses = np.flatnonzero(t[1:] - t[:-1] > LONGEST_STEP_S)
        if not pauses.size:
            continue
        first, last = np.searchsorted(at + width_s, t[pauses]), np.searchsorted(at, t[pauses + 1])
        for low, high in zip(first, last, strict=True):
            good[low:high] = False
    return at[good]


def integrals(t: Array, values: Array, at: Array, width_s: float = WINDOW_S) -> Array:
    """Return the integrals (m, k) of values (n, k) at t (n,) over windows from `at`."""
    sides = np.concatenate([at, at + width_s])
    if t.size <= BLOCK_ROWS:
        both = _integral_in_one(t, values, sides)
        return both[at.size :] - both[: at.size]
    let_go()
    order = np.argsort(sides, kind="stable")
    ordered = np.empty((sides.size, values.shape[1]))
    ordered[order] = _integral_to(t, values, sides[order])
    return ordered[at.size :] - ordered[: at.size]


def _integral_in_one(t: Array, values: Array, times: Array) -> Array:
    """Return `_integral_to` of one block; the times need not ascend."""
    mean = 0.5 * (values[1:] + values[:-1])
    sums = np.zeros(values.shape)
    np.cumsum(mean * (t[1:] - t[:-1])[:, None], axis=0, out=sums[1:])
    there = np.clip(times, t[0], t[-1])
    row = np.minimum(np.searchsorted(t, there, side="right") - 1, t.size - 2)
    return np.asarray(mean[row] * (there - t[row])[:, None] + sums[row])


def _integral_to(t: Array, values: Array, times: Array) -> Array:
    """Return the integral (m, k) of values (n, k) from t[0] to ascending times (m,).

    Straight lines of the sum between samples; summed block by block, so that no array of
    all n sums is needed.
    """
    out = np.zeros((times.size, values.shape[1]))
    after = np.searchsorted(t, times, side="right")
    total = np.zeros(values.shape[1])
    for start in range(0, t.size - 1, BLOCK_ROWS):
        stop = min(start + BLOCK_ROWS, t.size - 1)
        clock, part = t[start : stop + 1], values[start : stop + 1]
        steps = 0.5 * (part[1:] + part[:-1]) * np.diff(clock)[:, None]
        sums = np.cumsum(np.concatenate([total[None, :], steps]), axis=0)
        first, last = np.searchsorted(after, (start + 1, stop + 1))
        row = after[first:last] - start - 1
        slope = (sums[row + 1] - sums[row]) / (clock[row + 1] - clock[row])[:, None]
        out[first:last] = slope * (times[first:last] - clock[row])[:, None] + sums[row]
        total = sums[-1]
    out[np.searchsorted(after, t.size) :] = total
    return out


def angles_at(t: Array, t_attitude: Array, euler: Array) -> Array:
    """Return attitude (n, 3) [rad] at times t (n,), without its wraps."""
    angles = np.empty((t.size, euler.shape[1]))
    for index, column in enumerate(euler.T):
        angles[:, index] = np.interp(t, t_attitude, unwrapped(column))
    return angles


def down_at(t: Array, t_attitude: Array, euler: Array) -> Array:
    """Return down in body axes (n, 3), the last row of the rotation, at times t (n,).

    [-sin(theta), cos(theta) sin(phi), cos(theta) cos(phi)]; yaw does not enter. Roll and
    pitch may wrap, as those from 0 to 360 degrees do at rest.
    """
    phi, theta = (np.interp(t, t_attitude, unwrapped(column)) for column in euler.T[:2])
    down, level = np.empty((t.size, 3)), np.cos(theta)
    down[:, 0] = -np.sin(theta)
    down[:, 1] = level * np.sin(phi)
    down[:, 2] = level * np.cos(phi)
    return down


@kept
def depth_gains(
    t_depth: Array,
    depth: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
    *,
    arm_unknown: bool = False,
) -> AxisGains | None:
    """Return the gains of surge, sway and heave in the depth rate.

    d(z)/dt = -u sin(theta) + v cos(theta) sin(phi) + w cos(theta) cos(phi), each term
    with its own gain, over windows of 1 s. arm_unknown: the depth sensor may be ahead and
    aside; a hull that rolls and pitches lifts it by arms, which are free, times the change
    of down in body axes, so that heave that is the pitch of the hull alone has no gain.
    """
    rates = down_at(t_velocity, t_attitude, euler) * velocity
    shared = _rise_and_parts(t_depth, depth, t_attitude, t_velocity, rates)
    if shared is None:
        return None
    rise, parts = shared
    if not arm_unknown:
        return fitted_gains(rise, parts)
    at = _windows_with_depth(t_depth, t_velocity, t_attitude)
    begin, end = (down_at(t, t_attitude, euler)[:, :2] for t in (at, at + WINDOW_S))
    both = fitted_gains(rise, np.hstack([parts, end - begin]))
    return (
        None
        if both is None
        else replace(both, gain=both.gain[:3], sd=both.sd[:3], own=both.own[:3])
    )


@kept
def heave_of_columns(
    t_depth: Array,
    depth: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    columns: Array,
    sums: Sequence[Sequence[float]],
) -> tuple[list[AxisGains], AxisGains] | None:
    """Return the gains of sums of three columns (n, 3) as heave in the depth rate.

    d(z)/dt = g down_z (sum of columns) + what a tilt makes of each column, with a gain of
    its own; the gains of the sum only. The last is the fit in which the gain of each
    column as heave is free. None for too few windows.
    """
    down = down_at(t_velocity, t_attitude, euler)
    tilted = (down[:, :2, None] * columns[:, None, :]).reshape(len(columns), -1)
    level = down[:, 2:] * columns
    shared = _rise_and_parts(t_depth, depth, t_attitude, t_velocity, np.hstack([tilted, level]))
    if shared is None:
        return None
    rise, parts = shared
    aside, heave = np.split(parts, [tilted.shape[1]], axis=1)
    designs = [np.column_stack([heave @ np.asarray(each), aside]) for each in sums]
    fits = [fitted_gains(rise, design) for design in [*designs, np.hstack([heave, aside])]]
    there = [fit for fit in fits if fit is not None]
    return (there[:-1], there[-1]) if len(there) == len(fits) else None


def _rise_and_parts(
    t_depth: Array, depth: Array, t_attitude: Array, t_velocity: Array, rates: Array
) -> tuple[Array, Array] | None:
    """Return change of depth (m,), and its parts (m, k) by rates (n, k), by window.

    None for too few windows.
    """
    at = _windows_with_depth(t_depth, t_velocity, t_attitude)
    if at.size < FEWEST_WINDOWS:
        return None
    return _rise(t_depth, depth, at), integrals(t_velocity, rates, at)


def _windows_with_depth(t_depth: Array, t_velocity: Array, t_attitude: Array) -> Array:
    """Return the begins (m,) of windows that depth, velocity and attitude share."""
    return shared_windows(t_depth, t_velocity, t_attitude)


def _rise(t_depth: Array, depth: Array, at: Array) -> Array:
    """Return the change of depth (m,) over windows from `at`."""
    rise: Array = np.interp(at + WINDOW_S, t_depth, depth) - np.interp(at, t_depth, depth)
    return rise


@dataclass(frozen=True)
class TiltOffset:
    """Roll and pitch that an attitude lacks against velocity and depth.

    `angle` (2,) and its standard deviation `sd` [rad]; `likelier`: logarithm of the
    likelihood over gains of surge, sway and heave in the depth rate that are off;
    `explained`: share of what the stated angles leave.
    """

    angle: Array
    sd: Array
    likelier: float
    explained: float


@kept
def tilt_offset(
    t_depth: Array,
    depth: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
) -> TiltOffset | None:
    """Return by what constant tilt the depth rate departs from velocity and attitude.

    d(z)/dt = r(phi + a, theta + b) . [u v w], linear in small a and b, r the last row of
    the rotation, over windows of 1 s. None for too few windows.
    """
    rates = _depth_rates(t_attitude, euler, t_velocity, velocity)
    shared = _rise_and_parts(t_depth, depth, t_attitude, t_velocity, rates)
    if shared is None:
        return None
    rise, parts = shared
    rest = rise - parts[:, :3].sum(axis=1)
    tilted, scaled = fitted_gains(rest, parts[:, 3:]), fitted_gains(rest, parts[:, :3])
    if tilted is None or scaled is None:
        return None
    left = [
        max(float(np.median(np.abs(values - np.median(values)))), 1e-12)
        for values in (rest - parts[:, 3:] @ tilted.gain, rest - parts[:, :3] @ scaled.gain)
    ]
    likelier = len(rest) * float(np.log(left[1] / left[0]))
    return TiltOffset(tilted.gain, tilted.sd, likelier, tilted.explained)


def _depth_rates(t_attitude: Array, euler: Array, t_velocity: Array, velocity: Array) -> Array:
    """Return what surge, sway and heave, and small roll and pitch, make of the depth.

    Rates (n, 5), the last two per radian.
    """
    down = down_at(t_velocity, t_attitude, euler)
    phi, theta = (np.interp(t_velocity, t_attitude, euler[:, column]) for column in (0, 1))
    u, v, w = velocity.T
    by_roll = down[:, 2] * v - down[:, 1] * w
    by_pitch = -np.cos(theta) * u - np.sin(theta) * (np.sin(phi) * v + np.cos(phi) * w)
    return np.column_stack([down * velocity, by_roll, by_pitch])


@kept
def heave_zero(
    t_depth: Array,
    depth: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
) -> tuple[float, float] | None:
    """Return what heave reads at rest by the depth, and its standard deviation [m/s].

    Over windows of 1 s, gains of the axes and a constant tilt beside. None for too few.
    """
    down = down_at(t_velocity, t_attitude, euler)
    rates = _depth_rates(t_attitude, euler, t_velocity, velocity)
    shared = _rise_and_parts(
        t_depth, depth, t_attitude, t_velocity, np.column_stack([rates, down[:, 2]])
    )
    if shared is None:
        return None
    rise, parts = shared
    level = np.where(parts[:, 5] > LEAST_UPRIGHT, parts[:, 5], np.nan)[:, None]
    rest = (rise - parts[:, :3].sum(axis=1))[:, None] / level
    fit = robust_fits(rest.T, (parts[:, :5] / level)[None])
    if not fit.count[0]:
        return None
    sd = float(np.sqrt(fit.left[0] * max(float(fit.inverse[0, -1, -1]), 0.0)))
    return -float(fit.gain[0, -1]), sd


AXES_TAKEN = {
    "surge and sway exchanged": (1, 0, 2),
    "surge and heave exchanged": (2, 1, 0),
    "sway and heave exchanged": (0, 2, 1),
    "its three columns exchanged (shifted by one)": (1, 2, 0),
    "its three columns exchanged (shifted by two)": (2, 0, 1),
}


@kept
def depth_by_axes(
    t_depth: Array,
    depth: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
) -> dict[str, float]:
    """Return the share of the depth rate that the velocity explains, by its frame.

    As body axes ("body"), with two of them exchanged, and as a velocity over ground whose
    third component is down or up; gain 1, shares by medians. Empty for too few windows.
    """
    at = shared_windows(t_depth, t_velocity, t_attitude)
    if at.size < FEWEST_WINDOWS:
        return {}
    down = down_at(t_velocity, t_attitude, euler)
    rise = np.interp(at + WINDOW_S, t_depth, depth) - np.interp(at, t_depth, depth)
    rates = {"body": (down * velocity).sum(axis=1)}
    rates |= {
        name: (down * velocity[:, list(order)]).sum(axis=1) for name, order in AXES_TAKEN.items()
    }
    rates |= {"north, east, down": velocity[:, 2], "east, north, up": -velocity[:, 2]}
    spread = float(np.median(np.abs(rise - np.median(rise))))
    shares = {}
    for name, rate in rates.items():
        rest = rise - integrals(t_velocity, rate[:, None], at)[:, 0]
        left = float(np.median(np.abs(rest - np.median(rest))))
        shares[name] = 1.0 - (left / spread) ** 2 if spread > 0.0 else 0.0
    return shares


def track_windows(
    t_position: Array, t_attitude: Array, euler: Array, t_velocity: Array
) -> tuple[Array, Array, float] | None:
    """Return windows of 2 s that track, attitude and velocity share; None for too few.

    Their starts (k,) [s], the rotation from body to NED at each velocity (m, 3, 3), and
    their width [s].
    """
    width = 2.0 * WINDOW_S
    at = shared_windows(t_position, t_velocity, t_attitude, width_s=width)
    if at.size < FEWEST_WINDOWS:
        return None
    return at, rotation_body_to_ned(angles_at(t_velocity, t_attitude, euler)), width


@kept
def position_gains(
    t_position: Array,
    position: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
) -> AxisGains | None:
    """Return the gains of surge and sway in the horizontal displacement.

    d(x, y)/dt = R(psi, theta, phi) [u v w], rows north and east, over windows of 2 s.
    """
    shared = track_windows(t_position, t_attitude, euler, t_velocity)
    if shared is None:
        return None
    at, turn, width = shared
    moved, parts = [], []
    for row in range(2):
        ends = [np.interp(side, t_position, position[:, row]) for side in (at, at + width)]
        parts.append(integrals(t_velocity, turn[:, row, :2] * velocity[:, :2], at, width))
        moved.append(ends[1] - ends[0])
    return fitted_gains(np.concatenate(moved), np.concatenate(parts))


def accelerometer_changes(
    t_imu: Array,
    gyro: Array,
    specific_force: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
    *,
    gravity: float,
    lag_s: float = 0.0,
) -> tuple[Array, Array, Array] | None:
    """Return changes of velocity (n, 3) and their parts: force, transport (n, 3).

    v_dot = f + R^T [0 0 g] - omega x v, integrated over windows of 1 s; the velocity is
    read `lag_s` later than its stamp says it should be.
    """
    start = max(t_imu[0], t_attitude[0], t_velocity[0] - min(lag_s, 0.0))
    end = min(t_imu[-1], t_attitude[-1], t_velocity[-1] - max(lag_s, 0.0))
    at = windows(start, end, t_imu, t_attitude, t_velocity)
    if at.size < FEWEST_WINDOWS:
        return None
    down = down_at(t_imu, t_attitude, euler)
    speed = np.stack([np.interp(t_imu + lag_s, t_velocity, column) for column in velocity.T], 1)
    down *= gravity
    down += specific_force
    force = integrals(t_imu, down, at)
    del down
    moved = np.cross(gyro, speed)
    del speed
    transport = integrals(t_imu, np.negative(moved, out=moved), at)
    del moved
    change = [
        np.stack([np.interp(side + lag_s, t_velocity, column) for column in velocity.T], axis=1)
        for side in (at, at + WINDOW_S)
    ]
    return change[1] - change[0], force, transport


@kept
def tilt_gains(
    t_imu: Array, specific_force: Array, t_attitude: Array, euler: Array, *, gravity: float
) -> list[list[AxisGains | None]] | None:
    """Return the gain of gravity in x and y (columns) in the reading's (rows).

    f = v_dot + omega x v - g R^T [0 0 1], over windows of 1 s with a constant: 1 on the
    diagonal where tilt moves more than acceleration. None for too few windows.
    """
    start, end = max(t_imu[0], t_attitude[0]), min(t_imu[-1], t_attitude[-1])
    at = windows(start, end, t_imu, t_attitude)
    if at.size < FEWEST_WINDOWS:
        return None
    down = down_at(t_imu, t_attitude, euler)[:, :2]
    expected = integrals(t_imu, -gravity * down, at)
    reading = integrals(t_imu, specific_force[:, :2], at)
    return [[fitted_gains(row, expected[:, [column]]) for column in (0, 1)] for row in reading.T]


@kept
def velocity_lag(
    t_depth: Array,
    depth: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
    *,
    lags_s: ArrayLike,
    enough: float = 1.0,
) -> tuple[float, float, float] | None:
    """Return how late the velocity is behind the depth [s]; explained there and at 0.

    The lag of `lags_s` at which the velocity, read so much later, or the depth, read so
    much earlier, explains most of the depth rate: the attitude is on the clock of the
    other one. A lag counts where the axes that move the depth have gains near one
    there: of a periodic motion, free gains make any lag fit. None for too few windows. No
    other lag is tried where 0 explains `enough`.
    """
    lags = np.asarray(lags_s, dtype=np.float64)
    rates = down_at(t_velocity, t_attitude, euler) * velocity
    clocks = t_velocity, t_attitude
    shares: dict[float, float] = {}
    # As many lags at a time as the memory for their windows allows.
    most = max(int(MOST_WINDOWS * WINDOW_S / max(np.ptp(t_depth), WINDOW_S)), 1)
    others = lags[lags != 0.0]
    for tried in (lags[lags == 0.0], *np.split(others, range(most, others.size, most))):
        if not tried.size:
            continue
        if shares.get(0.0, -np.inf) >= enough:
            break
        early = [_windows_with_depth(t_depth + lag, *clocks) for lag in tried]
        edges = np.cumsum([at.size for at in early])[:-1]
        moved = np.split(integrals(t_velocity, rates, np.concatenate(early)), edges)
        parts = []
        for lag, at, part in zip(tried, early, moved, strict=True):
            late = t_velocity - lag
            turned = down_at(late, t_attitude, euler) * velocity
            enough_windows = at.size >= FEWEST_WINDOWS
            parts += [
                (float(lag), _rise_and_parts(t_depth, depth, t_attitude, late, turned)),
                (float(lag), (_rise(t_depth + lag, depth, at), part) if enough_windows else None),
            ]
        shares |= _shares_by_lag([(lag, part) for lag, part in parts if part is not None])
    if 0.0 not in shares:
        return None
    best = max(shares, key=lambda lag: shares[lag])
    return best, shares[best], shares[0.0]


def _shares_by_lag(parts: Sequence[tuple[float, tuple[Array, Array]]]) -> dict[float, float]:
    """Return the share of the rise that its parts explain, for lags that count.

    Of the fits of one lag the better one.
    """
    if not parts:
        return {}
    fit = robust_fits(
        stacked([rise for _, (rise, _) in parts]), stacked([moved for _, (_, moved) in parts])
    )
    shares: dict[float, float] = {}
    for number, (lag, _) in enumerate(parts):
        main = fit.main_gains(number)
        near_one = bool(((main > LAG_GAINS[0]) & (main < LAG_GAINS[1])).all())
        if fit.count[number] and (lag == 0.0 or near_one):
            shares[lag] = max(float(fit.explained[number]), shares.get(lag, -np.inf))
    return shares


def own_and_cross(first: Array, second: Array) -> Array:
    """Return the correlations (k, l) of the columns of (n, k) and (n, l)."""
    one, two = first - first.mean(axis=0), second - second.mean(axis=0)
    size = np.outer(np.linalg.norm(one, axis=0), np.linalg.norm(two, axis=0))
    return np.asarray(np.divide(one.T @ two, size, out=np.zeros_like(size), where=size > 0.0))


def response_gains(
    t_force: Array,
    acceleration: Array,
    t_motion: Array,
    motion: Array,
    *,
    lags_s: ArrayLike = (0.0, 0.1, 0.2, 0.3),
    width_s: float = 0.5,
    coupled: Array | None = None,
) -> AxisGains | None:
    """Return the gain of actuator forces over mass (n, k) in one motion's rate (m,).

    d(nu)/dt = g a + d nu + e nu |nu| + f b + c over windows of 0.5 s, at the lag behind
    the commands that explains most; the gains of a only. b (m, l): terms `coupled`, whose
    part is taken off before the share that is explained. Positive where axis, actuators
    and signs agree, also under feedback, which the drag terms alone would turn around.
    """
    by_lag = gains_by_lag(
        t_force, acceleration, t_motion, motion, lags_s=lags_s, width_s=width_s, coupled=coupled
    )
    return most_explained(by_lag)


def most_explained(by_lag: Sequence[AxisGains | None]) -> AxisGains | None:
    """Return the gains that explain most; None where there are none."""
    return max(
        (gains for gains in by_lag if gains is not None),
        key=lambda gains: gains.explained,
        default=None,
    )


def gains_by_lag(
    t_force: Array,
    acceleration: Array,
    t_motion: Array,
    motion: Array,
    *,
    lags_s: ArrayLike,
    width_s: float = 0.5,
    coupled: Array | None = None,
) -> list[AxisGains | None]:
    """Return the gains of `response_gains` at each lag behind the forces."""
    motions = motion[:, None]
    (by_lag,) = gains_by_motion(
        t_force, acceleration, t_motion, motions, lags_s=lags_s, width_s=width_s, coupled=coupled
    )
    return by_lag


def gains_by_motion(
    t_force: Array,
    acceleration: Array,
    t_motion: Array,
    motions: Array,
    *,
    lags_s: ArrayLike,
    width_s: float = 0.5,
    coupled: Array | None = None,
) -> list[list[AxisGains | None]]:
    """Return the gains of `response_gains` in each motion (m, j), at each lag."""
    taken = np.zeros((len(motions), 0)) if coupled is None else coupled
    lags = np.asarray(lags_s, dtype=np.float64)
    # Signs only turn the gains, and a log is checked again with other signs.
    of_force, of_motion = signs_of(acceleration), signs_of(motions)
    by_motion = _gains_by_motion(
        t_force,
        _turned(acceleration, of_force),
        t_motion,
        _turned(motions, of_motion),
        _turned(taken, signs_of(taken)),
        lags,
        width_s,
    )
    unturned = bool((of_force > 0.0).all())
    return [
        by_lag
        if unturned and turn > 0.0
        else [
            None if gains is None else replace(gains, gain=gains.gain * turn * of_force)
            for gains in by_lag
        ]
        for by_lag, turn in zip(by_motion, of_motion, strict=True)
    ]


def _turned(columns: Array, signs: Array) -> Array:
    """Return columns (n, k) by signs (k,), themselves where none is turned."""
    return columns if (signs > 0.0).all() else laid_down(columns * signs)


@kept
def _gains_by_motion(
    t_force: Array,
    acceleration: Array,
    t_motion: Array,
    motions: Array,
    taken: Array,
    lags: Array,
    width_s: float,
) -> list[list[AxisGains | None]]:
    """Return what `gains_by_motion` does; taken (m, l): the coupled terms."""
    start, end = max(t_force[0], t_motion[0]), np.minimum(t_force[-1], t_motion[-1] - lags)
    starts = windows_until(start, end, t_force, t_motion, width_s=width_s)
    thinned = max(-(-max(at.size for at in starts) // MOST_WINDOWS_OF_A_LAG), 1)
    tried = [
        (lag, at[::thinned])
        for lag, at in zip(lags, starts, strict=True)
        if at.size >= FEWEST_WINDOWS
    ]
    if not tried:
        return [[None] * lags.size for _ in motions.T]
    # One pass over the samples serves many lags, and one batch their fits.
    most = max(MOST_WINDOWS // max(at.size for _, at in tried), 1)
    groups = [tried[first : first + most] for first in range(0, len(tried), most)]
    together = max(MOST_WINDOWS // len(motions), 1)
    out: list[list[AxisGains | None]] = []
    for first in range(0, motions.shape[1], together):
        some = motions[:, first : first + together]
        by_lag: list[dict[float, AxisGains]] = [{} for _ in some.T]
        for group in groups:
            fits = _gains_of(group, t_force, acceleration, t_motion, some, taken, width_s)
            for number, lag, gains in fits:
                by_lag[number][lag] = gains
        out += [[each.get(float(lag)) for lag in lags] for each in by_lag]
    return out


def _gains_of(
    tried: Sequence[tuple[float, Array]],
    t_force: Array,
    acceleration: Array,
    t_motion: Array,
    motions: Array,
    taken: Array,
    width_s: float,
) -> Iterator[tuple[int, float, AxisGains]]:
    """Yield motion, lag and gains at lags with the begins of their windows (one pass).

    taken (m, l): what is known of what acts beside the forces.
    """
    later = np.concatenate([at + lag for lag, at in tried])
    edges = np.cumsum([at.size for _, at in tried])[:-1]
    # The windows of each lag are the first ones of the longest list.
    longest = max((at for _, at in tried), key=len)
    every = integrals(t_force, acceleration, longest, width_s)
    pushed = np.concatenate([every[: at.size] for _, at in tried])
    number, taken_count = motions.shape[1], taken.shape[1]
    coupling = integrals(t_motion, taken, later, width_s)
    moved = np.hstack([motions, motions * np.abs(motions)])
    drag = integrals(t_motion, moved, later, width_s)
    columns = [np.hstack([pushed, coupling, drag[:, [j, number + j]]]) for j in range(number)]
    sides = np.concatenate([later + width_s, later])
    ends = [np.interp(sides, t_motion, motion) for motion in motions.T]
    changes = [both[: later.size] - both[later.size :] for both in ends]
    count = acceleration.shape[1]
    design = stacked([part for each in columns for part in np.split(each, edges)])
    target = stacked([part for each in changes for part in np.split(each, edges)])
    there = np.isfinite(target)
    aside = np.where(there[..., None], design[..., count : count + taken_count], 0.0)
    aside = np.concatenate([aside, np.ones((*there.shape, 1))], axis=2)
    target = target - solved(aside, np.where(there, target, 0.0), there)[1]
    for place, gains in enumerate(robust_fits(target, design).gains()):
        if gains is not None:
            yield (
                place // len(tried),
                float(tried[place % len(tried)][0]),
                AxisGains(
                    gains.gain[:count],
                    gains.sd[:count],
                    gains.explained,
                    gains.count,
                    gains.own[:count],
                ),
            )
