"""Sensors of the twin: what an AHRS, a velocity log and a pressure sensor report of a
known motion, with noise, bias and where they sit.

The forward side of hydro/identification/bias.py. Noise comes from a generator that the
caller seeds; with all deviations 0 the sensors are exact. Sensor axes and lever arms
follow `MountedSensor`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from auvid.hydro.arrays import Array, cross
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.simulation import Motion, gauss_markov
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor


@dataclass(frozen=True)
class AhrsNoise:
    """Standard deviations per sample, except: attitude error is Gauss-Markov with
    `attitude_correlation_s`; one bias per log.
    """

    attitude_rad: float = 0.0
    attitude_correlation_s: float = 0.0
    gyro_rad_s: float = 0.0
    gyro_bias_rad_s: float = 0.0
    accel_m_s2: float = 0.0
    accel_bias_m_s2: float = 0.0


@dataclass(frozen=True)
class Ahrs:
    """What the AHRS reports: attitude (n, 3) [rad], angular rate and accelerometer (n,
    3) in sensor axes, and the biases drawn (3,).
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
    v, omega = motion.nu[:, :3], motion.nu[:, 3:]
    acceleration = (
        motion.nu_dot[:, :3]
        + cross(omega, v)
        + cross(motion.nu_dot[:, 3:], arm_m)
        + cross(omega, cross(omega, arm_m))
    )
    return np.asarray(acceleration - gravity * rotation_body_to_ned(motion.eta[:, 3:])[:, 2, :])


def ahrs(
    motion: Motion,
    sensor: MountedSensor,
    noise: AhrsNoise,
    random: np.random.Generator,
    *,
    rate_hz: float,
    gravity: float,
) -> Ahrs:
    """An AHRS at the times of the motion, which are 1/rate_hz apart. Its accelerometer
    reports specific force, gravity inside.
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
    """The accelerometer with gravity taken off by the AHRS's own attitude (n, 3),
    errors included: what `inertial` means in a log.
    """
    return np.asarray(accel + gravity * rotation_body_to_ned(attitude)[:, 2, :] @ sensor.rotation)


def velocity_log(
    motion: Motion, sensor: MountedSensor, random: np.random.Generator, *, noise_m_s: float
) -> Array:
    """Velocity over ground of the sensor's point in sensor axes (n, 3) [m/s]: R' (v +
    omega x arm) + noise.
    """
    local = motion.nu[:, :3] + cross(motion.nu[:, 3:], sensor.arm_m)
    return np.asarray(local @ sensor.rotation + noise_m_s * random.standard_normal(local.shape))


def pressure_depth(
    motion: Motion, sensor: MountedSensor, random: np.random.Generator, *, noise_m: float
) -> Array:
    """Depth of the sensor's point below the surface (n,) [m]."""
    below = rotation_body_to_ned(motion.eta[:, 3:])[:, 2, :] @ sensor.arm_m
    return np.asarray(motion.eta[:, 2] + below + noise_m * random.standard_normal(len(motion.t_s)))
