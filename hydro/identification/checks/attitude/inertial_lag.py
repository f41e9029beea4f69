"""Whether attitude and gyro are late together, or the accelerometer is.

Both come from one unit whose filter may delay them alike, so that they agree with each
other. Gravity that the attitude takes off the accelerometer, and the depth that the
attitude makes of a velocity, show it. Nothing here decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.motion_checks import (
    WINDOW_S,
    down_at,
    integrals,
    windows,
)
from auvid.hydro.identification.checks.robust_gains import FEWEST_WINDOWS
from auvid.hydro.identification.checks.velocity_answer import changes_of, log_odds
from auvid.hydro.kept_results import kept

LAGS_S = np.round(np.arange(-12, 13) * 0.05, 2)
"""Lags of attitude and gyro that are tried [s]."""
VELOCITY_LAGS_S = np.round(np.arange(-6, 13) * 0.05, 2)
"""Lags of the velocity alone that are tried beside them [s]."""
FIRST_S = (-0.1, 0.0, 0.1)
"""Lags that are tried first; the others only where 0 is not the best of these."""


@dataclass(frozen=True)
class InertialLag:
    """How late attitude and gyro come together.

    `lag_s` by accelerometer and velocity, `better_than_none` the logarithm of its
    likelihood over that of none, and `better_than_velocity` over that of any lag of the
    velocity alone, or of the other arm; `by_depth` over none in the depth rate, None without depth.
    """

    lag_s: float
    better_than_none: float
    better_than_velocity: float
    by_depth: float | None


@kept
def inertial_lag(
    imu: tuple[Array, Array, Array],
    attitude: tuple[Array, Array],
    velocity: tuple[Array, Array],
    depth: tuple[Array, Array] | None,
    *,
    gravity: float,
    arm_m: Array,
    other_arm_m: Array | None = None,
) -> InertialLag | None:
    """Return how late attitude and gyro come; None for too few windows.

    imu: times (n,), gyro (n, 3), specific force (n, 3); attitude: times, angles (m, 3);
    velocity: times, velocity (k, 3) of a sensor at an arm [m]; depth: times, values.
    `other_arm_m`: where the sensor may sit instead, if that explains as much.
    """
    (t_imu, gyro, force), (t_attitude, euler), (t_velocity, speed) = imu, attitude, velocity
    clocks = [t_imu, t_attitude, t_velocity, *(() if depth is None else (depth[0],))]
    most = LAGS_S[-1]
    start = max(clock[0] for clock in clocks) + most
    end = min(clock[-1] for clock in clocks) - most
    at = windows(start, end, *clocks)
    if at.size < FEWEST_WINDOWS:
        return None
    felt = integrals(t_imu, force, at)

    def of_origin(lag: float, late_s: float = 0.0, arm: Array = arm_m) -> Array:
        turning = [np.interp(t_velocity - late_s, t_imu - lag, rate) for rate in gyro.T]
        return np.asarray(speed - np.cross(np.column_stack(turning), arm))

    def odds(lag: float, late_s: float = 0.0, arm: Array = arm_m) -> float:
        moved = of_origin(lag, late_s, arm)
        change = changes_of(t_imu - lag, gyro, t_velocity - late_s, moved, at)
        pulled = felt + gravity * integrals(t_imu, down_at(t_imu, t_attitude - lag, euler), at)
        return float(log_odds(*(side - np.median(side, axis=0) for side in (change, pulled))))

    tried = {lag: odds(lag) for lag in FIRST_S}
    if max(tried, key=lambda lag: tried[lag]) != 0.0:
        tried |= {lag: odds(lag) for lag in LAGS_S.tolist() if lag not in tried}
    best = max(tried, key=lambda lag: tried[lag])
    better = tried[best] - tried[0.0]
    over_velocity = better
    if better > 0.0:  # what a late velocity or its arm explains as well is no lag of attitude
        others = [odds(0.0, late_s) for late_s in VELOCITY_LAGS_S.tolist()]
        if other_arm_m is not None:
            others.append(odds(0.0, arm=other_arm_m))
        over_velocity = tried[best] - max(others)
    by_depth = None
    if best and depth is not None:
        left = []
        rise = np.interp(at + WINDOW_S, *depth) - np.interp(at, *depth)
        for lag in (best, 0.0):
            rates = down_at(t_velocity, t_attitude - lag, euler) * of_origin(lag)
            rest = rise - integrals(t_velocity, rates, at).sum(axis=1)
            left.append(max(float(np.median(np.abs(rest))), 1e-9))
        by_depth = at.size * float(np.log(left[1] / left[0]))
    return InertialLag(best, better, over_velocity, by_depth)
