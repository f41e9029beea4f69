"""Lag, turn, scale and arm of a body velocity against the accelerometer beside it.

Over windows of 1 s, v(t1) - v(t0) + integral of omega x v = integral of f + R^T [0 0 g]:
a velocity log that is late, turned about the vertical or of another scale shows there as
such; so does a sensor at another arm r, which reads v + omega x r. Nothing here decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, median
from auvid.hydro.constants import NORMAL_SPREAD
from auvid.hydro.identification.checks.answers import PlanarTurn, planar_turn
from auvid.hydro.identification.checks.motion_checks import (
    WINDOW_S,
    down_at,
    integrals,
    shared_windows,
    windows,
)
from auvid.hydro.identification.checks.robust_gains import FEWEST_WINDOWS, fitted_gains
from auvid.hydro.kept_results import kept

LARGEST_LACK = 0.6
"""Part of an axis of the velocity that may lack, or be too much."""
LARGE_TURN_RAD, FITS = 0.15, 0.9
"""Turn from which on, or share of the changes up to which, lags are tried with a turn."""
SURE_OF_TURN, LEAST_OF_TURN = 25.0, 0.6
"""By how much a velocity that is turned back must be likelier (logarithm), and the share of
the changes that it explains at least.
"""


@dataclass(frozen=True)
class VelocityAnswer:
    """How a velocity follows the accelerometer.

    `lag_s`: how late it comes; `odds` (k,): logarithm of the likelihood over a velocity at
    rest, by lag, and `halves` (2, k) of either half of the record; `turn` of surge and
    sway at `lag_s`, None for too few windows.
    """

    lags_s: Array
    odds: Array
    halves: Array
    turn: PlanarTurn | None

    @property
    def lag_s(self) -> float:
        """Return the most likely lag [s]."""
        return float(self.lags_s[np.argmax(self.odds)])

    def better_than(self, usual_s: tuple[float, float]) -> float:
        """Return by how much the best lag is more likely than any usual one."""
        inside = (self.lags_s > usual_s[0] - 1e-9) & (self.lags_s < usual_s[1] + 1e-9)
        return float(self.odds.max() - self.odds[inside].max())

    @property
    def drift(self) -> Drift:
        """Return how the lag changes from half to half."""
        return drift_of(self.lags_s, self.halves)


@dataclass(frozen=True)
class Drift:
    """Change of a lag from one half of a record to the other [s].

    `better_than_none`: logarithm of the likelihood over one lag in both halves.
    """

    change_s: float
    better_than_none: float


def drift_of(lags_s: Array, halves: Array) -> Drift:
    """Return how a lag changes, of the odds (2, k) of lags (k,) in either half.

    >>> drift_of(np.array([0.0, 1.0]), np.array([[9.0, 2.0], [1.0, 8.0]]))
    Drift(change_s=1.0, better_than_none=7.0)
    """
    first, last = lags_s[np.argmax(halves, axis=1)]
    gained = float(halves.max(axis=1).sum() - halves.sum(axis=0).max())
    return Drift(float(last - first), gained)


@kept
def velocity_answer(
    imu: tuple[Array, Array, Array],
    attitude: tuple[Array, Array],
    velocity: tuple[Array, Array],
    *,
    gravity: float,
    lags_s: Sequence[float],
) -> VelocityAnswer | None:
    """Return how a velocity follows the accelerometer; None for too few windows.

    imu: times (n,), gyro (n, 3), specific force (n, 3); attitude: times, angles (m, 3);
    velocity: times, body velocity (k, 3).
    """
    (t_imu, gyro, force), (t_attitude, euler), (t_velocity, speed) = imu, attitude, velocity
    lags = np.asarray(lags_s, dtype=np.float64)
    start = max(t_imu[0], t_attitude[0], t_velocity[0] - lags.min())
    end = min(t_imu[-1], t_attitude[-1], t_velocity[-1] - lags.max())
    at = windows(start, end, t_imu, t_attitude, t_velocity)
    if at.size < FEWEST_WINDOWS:
        return None
    pulled = pulled_by(t_imu, force, (t_attitude, euler), gravity, at)
    pulled = pulled - np.median(pulled, axis=0)

    def at_lags(speeds: Array) -> Array:
        moved = np.stack([changes_of(t_imu, gyro, t_velocity - lag, speeds, at) for lag in lags])
        return np.asarray(moved - np.median(moved, axis=1)[:, None])

    changes = fitting = at_lags(speed)
    odds = _mean_odds(changes, pulled)
    turn = planar_turn(pulled[:, :2], changes[int(np.argmax(odds)), :, :2])
    if turn is not None and (turn.explained < FITS or abs(turn.angle) > LARGE_TURN_RAD):
        # Of a velocity that is turned far any lag may fit best as it stands.
        turns = [planar_turn(pulled[:, :2], change[:, :2]) for change in changes]
        best = max((each for each in turns if each), key=lambda each: each.explained)
        if best.explained > LEAST_OF_TURN:
            back = at_lags(turned_back(speed, best.angle))
            odds_back = _mean_odds(back, pulled)
            if odds_back.max() - odds.max() > SURE_OF_TURN:
                fitting, odds, turn = back, odds_back, turns[int(np.argmax(odds_back))]
    half = at < 0.5 * (at[0] + at[-1])
    halves = np.stack([_mean_odds(fitting[:, rows], pulled[rows]) for rows in (half, ~half)])
    return VelocityAnswer(lags, odds, halves, turn)


def turned_back(speed: Array, angle: float) -> Array:
    """Return a velocity (n, 3) whose surge and sway were turned by an angle [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.asarray(speed @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]))


@kept
def odds_of_velocities(
    imu: tuple[Array, Array, Array],
    attitude: tuple[Array, Array],
    t_velocity: Array,
    speeds: Sequence[Array],
    *,
    gravity: float,
) -> Array | None:
    """Return how well velocities (k, 3) follow the accelerometer, by their likelihood.

    Logarithms over a velocity at rest; None for too few windows.
    """
    t_imu, gyro, force = imu
    at = shared_windows(t_imu, attitude[0], t_velocity)
    if at.size < FEWEST_WINDOWS:
        return None
    pulled = pulled_by(t_imu, force, attitude, gravity, at)
    pulled = pulled - np.median(pulled, axis=0)
    changes = [changes_of(t_imu, gyro, t_velocity, speed, at) for speed in speeds]
    return np.array([log_odds(each - np.median(each, axis=0), pulled) for each in changes])


def pulled_by(
    t_imu: Array, force: Array, attitude: tuple[Array, Array], gravity: float, at: Array
) -> Array:
    """Return the integral of f + R^T [0 0 g] (n, 3) over windows from `at`."""
    pulled = down_at(t_imu, *attitude)
    pulled *= gravity
    pulled += force
    return integrals(t_imu, pulled, at)


def changes_of(t_imu: Array, gyro: Array, t: Array, speed: Array, at: Array) -> Array:
    """Return v(t1) - v(t0) + integral of omega x v (n, 3) over windows from `at`."""
    first, last = (
        np.column_stack([np.interp(side, t, part) for part in speed.T])
        for side in (at, at + WINDOW_S)
    )
    rates = np.column_stack([np.interp(t, t_imu, part) for part in gyro.T])
    turned = integrals(t, np.cross(rates, speed), at)
    return np.asarray(last - first + turned)


def log_odds(changes: Array, pulled: Array) -> Array:
    """Return the log likelihood (...) of changes (..., n, 3) over none, by medians."""
    left, own = (
        NORMAL_SPREAD * median(np.abs(np.moveaxis(part, -2, 0)))
        for part in (changes - pulled, changes)
    )
    moving = (own > 0.0) & (left > 0.0)
    ratio = np.divide(own, left, out=np.ones_like(own), where=moving)
    return np.asarray(changes.shape[-2] * np.maximum(np.log(ratio), 0.0).sum(axis=-1))


def _mean_odds(changes: Array, pulled: Array) -> Array:
    """Return the mean of the log likelihood (k,) by medians and by squares.

    Medians pass over the few changes of a vehicle that is steady else, squares follow a
    few wrong samples.
    """
    left, own = (np.std(part, axis=-2) for part in (changes - pulled, changes))
    moving = (own > 0.0) & (left > 0.0)
    ratio = np.divide(own, left, out=np.ones_like(own), where=moving)
    by_squares = changes.shape[-2] * np.maximum(np.log(ratio), 0.0).sum(axis=-1)
    return np.asarray(0.5 * (log_odds(changes, pulled) + by_squares))


@dataclass(frozen=True)
class AxisScales:
    """Scale of surge and sway (2,) by themselves, a turn beside them.

    `sd` (2,) of their inverse, `explained` (2,): share of the changes of each axis.
    """

    scale: Array
    sd: Array
    explained: Array


@kept
def axis_scales(
    imu: tuple[Array, Array, Array],
    attitude: tuple[Array, Array],
    velocity: tuple[Array, Array],
    *,
    gravity: float,
) -> AxisScales | None:
    """Return the scales of surge and sway by the accelerometer.

    None for too few windows. Each axis of the velocity turns into the others as the
    vehicle does, so that all follow from all changes.
    """
    (t_imu, gyro, force), (t_attitude, euler), (t, speed) = imu, attitude, velocity
    clocks = t_imu, t_attitude, t
    at = shared_windows(*clocks)
    if at.size < FEWEST_WINDOWS:
        return None
    pulled = pulled_by(t_imu, force, (t_attitude, euler), gravity, at)
    parts = [changes_of(t_imu, gyro, t, speed * axis, at) for axis in np.eye(3)]
    change = np.sum(parts, axis=0)
    turned = np.column_stack([-change[:, 1], change[:, 0]])
    design = np.stack([parts[0][:, :2], parts[1][:, :2], turned], axis=2)
    rest, change = (change - pulled)[:, :2], change[:, :2]
    rest, change, design = (part - np.median(part, axis=0) for part in (rest, change, design))
    spread = np.maximum(NORMAL_SPREAD * np.median(np.abs(rest), axis=0), 1e-9)
    gains = fitted_gains(
        (rest / spread).ravel(), (design / spread[None, :, None]).reshape(-1, design.shape[2])
    )
    if gains is None or np.abs(gains.gain[:2]).max() > LARGEST_LACK:
        return None
    left = rest - design @ gains.gain
    size = np.maximum(np.median(np.abs(change), axis=0), 1e-9)
    explained = 1.0 - (np.median(np.abs(left), axis=0) / size) ** 2
    return AxisScales(1.0 / (1.0 - gains.gain[:2]), gains.sd[:2], explained)


@dataclass(frozen=True)
class ArmOffset:
    """True arm less the stated one (3,) and its standard deviation (3,) [m].

    `explained`: share of what the stated arm leaves that the other arm explains.
    """

    offset: Array
    sd: Array
    explained: float


@kept
def arm_offset(
    imu: tuple[Array, Array, Array],
    attitude: tuple[Array, Array],
    velocity: tuple[Array, Array],
    depth: tuple[Array, Array] | None,
    *,
    gravity: float,
) -> ArmOffset | None:
    """Return by how much an arm is off, a turn and a scale of the velocity beside it.

    imu: times (n,), gyro (n, 3), specific force (n, 3); attitude: times, angles (m, 3);
    velocity: times, that of the body at the stated arm (k, 3); depth: times, values. None
    for too few windows.
    """
    (t_imu, gyro, force), (t_attitude, euler), (t, speed) = imu, attitude, velocity
    clocks = [t_imu, t_attitude, t, *(() if depth is None else (depth[0],))]
    at = shared_windows(*clocks)
    if at.size < FEWEST_WINDOWS:
        return None
    rates = np.column_stack([np.interp(t, t_imu, rate) for rate in gyro.T])
    by_arm = [np.cross(rates, axis) for axis in np.eye(3)]
    pulled = pulled_by(t_imu, force, (t_attitude, euler), gravity, at)
    change = changes_of(t_imu, gyro, t, speed, at)
    moved = [changes_of(t_imu, gyro, t, part, at) for part in by_arm]
    still = np.zeros(len(at))
    turned = np.column_stack([-change[:, 1], change[:, 0], still])
    level = np.column_stack([change[:, :2], still])
    parts = [(change - pulled, np.stack([*moved, turned, level], axis=2))]
    if depth is not None:
        down = down_at(t, t_attitude, euler)
        depth_rates = [integrals(t, down * each, at).sum(axis=1) for each in (speed, *by_arm)]
        rise = np.interp(at + WINDOW_S, *depth) - np.interp(at, *depth)
        design = np.column_stack([*depth_rates[1:], still, still])
        parts.append(((depth_rates[0] - rise)[:, None], design[:, None]))
    rest, columns = [], []
    for left, design in parts:
        left, design = left - np.median(left, axis=0), design - np.median(design, axis=0)
        spread = np.maximum(NORMAL_SPREAD * np.median(np.abs(left), axis=0), 1e-9)
        rest.append((left / spread).ravel())
        columns.append((design / spread[None, :, None]).reshape(-1, design.shape[2]))
    gains = fitted_gains(np.concatenate(rest), np.concatenate(columns))
    if gains is None:
        return None
    return ArmOffset(gains.gain[:3], gains.sd[:3], gains.explained)
