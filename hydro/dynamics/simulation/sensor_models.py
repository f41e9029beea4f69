"""Sensors of the twin: AHRS, velocity log and pressure sensor.

What they report of a motion, with noise, bias and the place where they sit.

The forward side of hydro/identification/bias.py. Noise comes from a generator that the
caller seeds; with all deviations 0 the sensors are exact. Sensor axes and lever arms
follow `MountedSensor`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from auvid.hydro.arrays import Array, components, cross_components
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.simulation import Motion, gauss_markov
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor


@dataclass(frozen=True)
class AhrsNoise:
    """Standard deviations per sample; one bias per log.

    The attitude error is Gauss-Markov with `attitude_correlation_s`.
    """

    attitude_rad: float = 0.0
    attitude_correlation_s: float = 0.0
    gyro_rad_s: float = 0.0
    gyro_bias_rad_s: float = 0.0
    accel_m_s2: float = 0.0
    accel_bias_m_s2: float = 0.0


@dataclass(frozen=True)
class Ahrs:
    """Readings of the AHRS and its biases (3,).

    Attitude (n, 3) [rad], angular rate and accelerometer (n, 3) in sensor axes.
    """

    attitude: Array
    gyro: Array
    accel: Array
    biases: Mapping[str, Array] = field(default_factory=dict)


def specific_force(motion: Motion, arm_m: Array, *, gravity: float) -> Array:
    """What an ideal accelerometer at `arm_m` measures, in body axes (n, 3) [m/s^2].

    f = v_dot + omega x v + omega_dot x arm + omega x (omega x arm) - R' [0 0 g]: the
    acceleration of its point against inertial space, less gravity (Titterton and Weston
    2004, 3.5). A vehicle at rest reads -g on the axis that points down.
    """
    nu, nu_dot = components(motion.nu), components(motion.nu_dot)
    down = components(rotation_body_to_ned(motion.eta[:, 3:])[:, 2, :])
    force = specific_force_components(nu, nu_dot, components(arm_m), down, gravity)
    return np.stack(force, axis=-1)


def specific_force_components(
    nu: tuple[Array, ...],
    nu_dot: tuple[Array, ...],
    arm: tuple[Array, ...],
    down: tuple[Array, ...],
    gravity: float,
) -> tuple[Array, ...]:
    """Return the components of `specific_force`, `down` the third row of the rotation.

    Arrays of one shape, or numbers in a compiled loop.
    """
    v, omega, omega_dot = nu[:3], nu[3:], nu_dot[3:]
    turning = cross_components(omega, v)
    tangential = cross_components(omega_dot, arm)
    inward = cross_components(omega, cross_components(omega, arm))
    return (
        nu_dot[0] + turning[0] + tangential[0] + inward[0] - gravity * down[0],
        nu_dot[1] + turning[1] + tangential[1] + inward[1] - gravity * down[1],
        nu_dot[2] + turning[2] + tangential[2] + inward[2] - gravity * down[2],
    )


def point_velocity_components(nu: tuple[Array, ...], arm: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return the components of v + omega x arm, the velocity of a point [m/s].

    nu: six components [m/s, rad/s]; arm: three of the point from the origin [m], both in
    body axes. Arrays of one shape, or numbers in the compiled loop.
    """
    swing = cross_components(nu[3:], arm)
    return nu[0] + swing[0], nu[1] + swing[1], nu[2] + swing[2]


def ahrs(
    motion: Motion,
    sensor: MountedSensor,
    noise: AhrsNoise,
    random: np.random.Generator,
    *,
    rate_hz: float,
    gravity: float,
) -> Ahrs:
    """Return readings of an AHRS at the times of the motion, 1/rate_hz apart.

    Its accelerometer reports specific force, gravity inside.
    """
    n = len(motion.t_s)
    gyro_bias, accel_bias = (
        noise.gyro_bias_rad_s * random.standard_normal(3),
        noise.accel_bias_m_s2 * random.standard_normal(3),
    )
    error = gauss_markov(
        random,
        sd=np.full(3, noise.attitude_rad),
        correlation_s=noise.attitude_correlation_s,
        step_s=1.0 / rate_hz,
        samples=n,
    )
    rate = (
        motion.nu[:, 3:] @ sensor.rotation
        + gyro_bias
        + noise.gyro_rad_s * random.standard_normal((n, 3))
    )
    force = specific_force(motion, sensor.arm_m, gravity=gravity) @ sensor.rotation
    force = force + accel_bias + noise.accel_m_s2 * random.standard_normal((n, 3))
    return Ahrs(
        motion.eta[:, 3:] + error, rate, force, {"gyro_rad_s": gyro_bias, "accel_m_s2": accel_bias}
    )


def without_gravity(
    accel: Array, attitude: Array, sensor: MountedSensor, *, gravity: float
) -> Array:
    """Return the accelerometer less gravity by the AHRS's attitude (n, 3).

    Errors of the attitude included: what `inertial` means in a log.
    """
    return np.asarray(accel + gravity * rotation_body_to_ned(attitude)[:, 2, :] @ sensor.rotation)


def velocity_log(
    motion: Motion, sensor: MountedSensor, random: np.random.Generator, *, noise_m_s: float
) -> Array:
    """Return the sensor's velocity over ground in its axes (n, 3) [m/s].

    R' (v + omega x arm) + noise.
    """
    arm = components(sensor.arm_m)
    local = np.stack(point_velocity_components(components(motion.nu), arm), axis=-1)
    return np.asarray(local @ sensor.rotation + noise_m_s * random.standard_normal(local.shape))


def pressure_depth(
    motion: Motion, sensor: MountedSensor, random: np.random.Generator, *, noise_m: float
) -> Array:
    """Depth of the sensor's point below the surface (n,) [m]."""
    below = rotation_body_to_ned(motion.eta[:, 3:])[:, 2, :] @ sensor.arm_m
    return np.asarray(motion.eta[:, 2] + below + noise_m * random.standard_normal(len(motion.t_s)))
