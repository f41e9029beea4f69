"""Scale of roll, pitch and yaw by what the gyro turns, and by gravity.

Over windows of 1 s a change of angle is what the gyro adds up to, whatever an angle hardly
moves by from sample to sample. Nothing here decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.motion_checks import (
    angles_at,
    down_at,
    integrals,
    shared_windows,
    windows,
)
from auvid.hydro.identification.checks.robust_gains import (
    FEWEST_WINDOWS,
    AxisGains,
    fitted_gains,
)
from auvid.hydro.identification.checks.velocity_answer import changes_of
from auvid.hydro.kept_results import kept

WINDOW_S = 1.0
STEEPEST_RAD = 1.2
"""Largest pitch at which roll, pitch and yaw are compared one by one."""


@dataclass(frozen=True)
class AngleTurns:
    """Changes of roll, pitch and yaw (m, 3) over windows from `at` (m,).

    `by_gyro` (m, 3, 3): what each axis of the gyro (last) turns each angle by.
    """

    at: Array
    by_angle: Array
    by_gyro: Array

    def gain(self, axis: int) -> AxisGains | None:
        """Return how much an angle turns by what the gyro does."""
        return fitted_gains(self.by_angle[:, axis], self.by_gyro[:, axis].sum(axis=1)[:, None])


@kept
def angle_turns(t_s: Array, euler: Array, t_gyro: Array, gyro: Array) -> AngleTurns | None:
    """Return what angles (n, 3) [rad] and the gyro (m, 3) [rad/s] turn by.

    None for too few windows, and for a vehicle that stands on end.
    """
    if np.abs(euler[:, 1]).max() > STEEPEST_RAD:
        return None
    at = windows(max(t_s[0], t_gyro[0]), min(t_s[-1], t_gyro[-1]), t_s, t_gyro)
    if at.size < FEWEST_WINDOWS:
        return None
    phi, theta, _ = angles_at(t_gyro, t_s, euler).T
    p, q, r = gyro.T
    sine, cosine, slope = np.sin(phi), np.cos(phi), np.tan(theta)
    by_gyro = np.empty((at.size, 3, 3))
    # One angle at a time: the rates of all would be nine columns of all samples.
    of_angle: tuple[Callable[[], tuple[Array, ...]], ...] = (
        lambda: (p, q * slope * sine, r * slope * cosine),
        lambda: (0.0 * p, q * cosine, -r * sine),
        lambda: (0.0 * p, q * sine / np.cos(theta), r * cosine / np.cos(theta)),
    )
    for angle, rates in enumerate(of_angle):
        by_gyro[:, angle] = integrals(t_gyro, np.column_stack(rates()), at)
    turned = angles_at(at + WINDOW_S, t_s, euler) - angles_at(at, t_s, euler)
    return AngleTurns(at, turned, by_gyro)


@kept
def gravity_gain(
    imu: tuple[Array, Array, Array],
    attitude: tuple[Array, Array],
    velocity: tuple[Array, Array] | None,
    *,
    gravity: float,
    axis: int,
) -> AxisGains | None:
    """Return the gain of gravity in the accelerometer by roll (axis 0) or pitch.

    imu: times (n,), gyro (n, 3), specific force (n, 3); velocity: times, that of the inertial
    unit (k, 3), whose changes are taken off. None for too few windows.
    """
    (t_imu, gyro, force), (t_attitude, euler) = imu, attitude
    clocks = [t_imu, t_attitude, *(() if velocity is None else (velocity[0],))]
    at = shared_windows(*clocks)
    if at.size < FEWEST_WINDOWS:
        return None
    across = 1 - axis  # roll turns gravity into y, pitch into x
    moved = np.zeros(at.size)
    if velocity is not None:
        moved = changes_of(t_imu, gyro, *velocity, at)[:, across]
    pulled = gravity * integrals(t_imu, down_at(t_imu, t_attitude, euler), at)[:, [across]]
    return fitted_gains(moved - integrals(t_imu, force, at)[:, across], pulled)


def depth_odds(
    depth: tuple[Array, Array],
    t_attitude: Array,
    attitudes: Sequence[Array],
    velocity: tuple[Array, Array],
) -> list[float] | None:
    """Return how well a velocity (k, 3) makes a depth by each of some attitudes (n, 3).

    Logarithms of their likelihoods over a depth that stands still, by medians over windows
    of 1 s. None for too few windows.
    """
    (t_depth, values), (t, speed) = depth, velocity
    clocks = t_depth, t_attitude, t
    at = shared_windows(*clocks)
    if at.size < FEWEST_WINDOWS:
        return None
    rise = np.interp(at + WINDOW_S, t_depth, values) - np.interp(at, t_depth, values)
    rests = [rise]
    for euler in attitudes:
        rate = (down_at(t, t_attitude, euler) * speed).sum(axis=1)
        rests.append(rise - integrals(t, rate[:, None], at)[:, 0])
    own, *left = (max(float(np.median(np.abs(rest - np.median(rest)))), 1e-9) for rest in rests)
    return [at.size * float(np.log(own / each)) for each in left]
