"""Sensor signals of one segment at the body origin: mountings, lever arms, gyro bias
and the common low-pass taken care of.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.bias import gyro_bias, lever_arm_velocity
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.hydro.identification.signals.splines import derivative
from auvid.stages.columns import ATTITUDE, VELOCITY, Array, clock, named

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Found:
    """What a method found on the way. `drift` (n, 3): the water's velocity in body
    axes, None where it is not known.
    """

    convention: str | None = None
    accel_bias: Array | None = None
    velocity_sd: Array | None = None
    installation: Mapping[str, Any] | None = None
    current: Mapping[str, Any] | None = None
    drift: Array | None = None
    sway_rms: float | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Motion:
    """Filtered sensor signals at the body origin (n, 3) on the segment's clock (n,)."""

    t_s: Array
    depth: Array
    euler: Array
    omega: Array
    omega_dot: Array
    velocity: Array | None
    gyro_bias: Array


def low_pass(t_s: Array, values: Array, cutoff_hz: float | None) -> Array:
    """The zero-phase low-pass of all channels (n,) or (n, k), or the values themselves
    where there is no cutoff.
    """
    return values if cutoff_hz is None else zero_phase_lowpass(t_s, values, cutoff_hz=cutoff_hz)


def sensed_motion(resampled: pa.Table, vehicle: Vehicle, *, has_gyro: bool) -> dict[str, Array]:
    """What the sensors say of u v w p q r, turned into body axes, by column name: (n,)
    each, velocities only where there is a sensor.

    Without a gyro the rates come from the attitude and are in body axes already.
    """
    if not has_columns(resampled, VELOCITY[3:]):
        raise missing("imu", "angular rates")
    rates = matrix(resampled, VELOCITY[3:])
    sensed = named(VELOCITY[3:], rates @ vehicle.imu.rotation.T if has_gyro else rates)
    if has_columns(resampled, VELOCITY[:3]):
        sensed |= named(VELOCITY[:3], matrix(resampled, VELOCITY[:3]) @ vehicle.dvl.rotation.T)
    return sensed


def sensor_motion(
    resampled: pa.Table,
    sensed: Mapping[str, Array],
    vehicle: Vehicle,
    *,
    cutoff_hz: float | None,
    fit_gyro_bias: bool,
    arm: bool = True,
) -> Motion:
    """Signals at the body origin: lever arms taken out (the velocity sensor's only with
    `arm`), gyro bias off, all filtered alike.
    """
    t_s = clock(resampled)

    euler = low_pass(t_s, matrix(resampled, ATTITUDE), cutoff_hz)
    omega = low_pass(t_s, np.column_stack([sensed[name] for name in VELOCITY[3:]]), cutoff_hz)
    bias = gyro_bias(t_s, euler, omega).bias if fit_gyro_bias else np.zeros(3)
    omega = omega - bias
    velocity = None
    if VELOCITY[0] in sensed:
        velocity = low_pass(
            t_s, np.column_stack([sensed[name] for name in VELOCITY[:3]]), cutoff_hz
        )
        if arm:
            velocity = lever_arm_velocity(velocity, omega, vehicle.dvl.arm_m)
    depth = low_pass(t_s, column(resampled, "z_m"), cutoff_hz) - vertical_arm(
        euler, vehicle.depth_sensor.arm_m
    )
    return Motion(t_s, depth, euler, omega, derivative(t_s, omega), velocity, bias)


def vertical_arm(euler: Array, arm_m: Array) -> Array:
    """How much deeper than the body origin a point at `arm_m` (3,) is, for attitudes
    (n, 3): (n,) m.
    """
    return np.asarray(rotation_body_to_ned(euler)[:, 2, :] @ arm_m)


def missing(stream: str, what: str) -> DataError:
    return DataError(
        f"stage fuse needs {what}: the stream '{stream}' is missing",
        remedy=f"It can come from: {supply_text(stream)}.",
    )
