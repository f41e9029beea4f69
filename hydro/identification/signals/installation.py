"""Lever arm and mounting rotation of a velocity sensor, from a leg.

They are estimated together with the accelerometer's bias. The sensor reports v_s = E'
(v + omega x r) with E the small rotation from sensor to body axes, exp(delta x). To
first order in delta, v_s = v + omega x r + v_s x delta, linear in r and delta. The
velocity v comes from the integrated accelerometer (bias b, initial velocity v_0
fitted), so that all twelve unknowns are found by one least-squares fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned, skew
from auvid.hydro.identification.regression.standard_errors import hac_covariance
from auvid.hydro.identification.signals.bias import integrate

ARM_FLOOR_M, ANGLE_FLOOR_RAD = 0.05, 0.01


@dataclass(frozen=True)
class Installation:
    """Arm r (3,) [m] and mounting delta (3,) [rad] with standard errors.

    nan for what was not estimated. `determined_arm`, `determined_mounting`: whether the
    data fix each component at all (a component along the axis that the vehicle turns
    about is not seen).
    """

    arm_m: Array
    arm_sd_m: Array
    mounting_rad: Array
    mounting_sd_rad: Array

    @property
    def determined_arm(self) -> tuple[bool, ...]:
        """Return whether each component's standard error is below `ARM_FLOOR_M`."""
        return tuple(bool(sd < ARM_FLOOR_M) for sd in self.arm_sd_m)

    @property
    def determined_mounting(self) -> tuple[bool, ...]:
        """Return whether each angle's standard error is below `ANGLE_FLOOR_RAD`."""
        return tuple(bool(sd < ANGLE_FLOOR_RAD) for sd in self.mounting_sd_rad)


def estimate_installation(
    t_s: ArrayLike,
    acceleration: ArrayLike,
    euler: ArrayLike,
    omega: ArrayLike,
    t_velocity: ArrayLike,
    velocity: ArrayLike,
    *,
    arm: bool = True,
    mounting: bool = True,
) -> Installation:
    """Estimate arm and mounting of a velocity sensor from its readings.

    `velocity` (m, 3) at t_velocity (m,), in its own axes taken for body axes.
    acceleration (n, 3): inertial acceleration of the body origin with bias
    (`inertial_acceleration`); euler, omega (n, 3), t_s (n,). Raises `DataError` for too
    few samples or when nothing is asked for.
    """
    if not (arm or mounting):
        raise DataError(
            "neither the arm nor the mounting of the velocity sensor is to be estimated"
        )
    t, f = np.asarray(t_s, dtype=np.float64), np.asarray(acceleration, dtype=np.float64)
    times, sensed = np.asarray(t_velocity, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
    inside = (times >= t[0]) & (times <= t[-1])
    times, sensed = times[inside], sensed[inside]
    if len(times) < 12:
        raise DataError(
            "too few velocity samples to estimate how the sensor is mounted",
            value=len(times),
            allowed="12 or more",
        )
    R = rotation_body_to_ned(euler)
    ned = CubicSpline(t, integrate(t, np.einsum("nij,nj->ni", R, f)))(times)
    gain = CubicSpline(t, integrate(t, R.reshape(len(t), 9)))(times).reshape(-1, 3, 3)
    back = np.swapaxes(CubicSpline(t, R.reshape(len(t), 9))(times).reshape(-1, 3, 3), 1, 2)
    parts = [-back @ gain, back @ R[0]]
    if arm:
        parts.append(skew(CubicSpline(t, np.asarray(omega, dtype=np.float64))(times)))
    if mounting:
        parts.append(skew(sensed))
    design = np.concatenate(parts, axis=2)
    target = sensed - np.einsum("mij,mj->mi", back, ned)
    rows = design.reshape(-1, design.shape[2])
    value = np.linalg.lstsq(rows, target.reshape(-1), rcond=None)[0]
    scores = np.einsum("mc,mck->mk", target - design @ value, design)
    spread = np.sqrt(np.diag(hac_covariance(scores, np.linalg.pinv(rows.T @ rows, hermitian=True))))
    unknown = np.full(3, np.nan)
    first = slice(6, 9)
    last = slice(9, 12) if arm else slice(6, 9)
    return Installation(
        arm_m=value[first] if arm else unknown,
        arm_sd_m=spread[first] if arm else unknown,
        mounting_rad=value[last] if mounting else unknown,
        mounting_sd_rad=spread[last] if mounting else unknown,
    )
