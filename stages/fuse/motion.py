"""Sensor signals of a segment at the body origin, without lever arms and gyro bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.motion import CurrentRecord, InstallationRecord
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.bias import gyro_bias, lever_arm_velocity
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.hydro.identification.signals.splines import derivative
from auvid.stages.columns import ATTITUDE, VELOCITY, clock


@dataclass(frozen=True)
class FusionResult:
    """Velocity over ground and its derivative (n, 3) by a method, and its estimates.

    `drift` (n, 3): the water's velocity in body axes, None where it is not known.
    """

    velocity: Array
    v_dot: Array
    convention: str | None = None
    accel_bias: Array | None = None
    velocity_sd: Array | None = None
    installation: InstallationRecord | None = None
    current: CurrentRecord | None = None
    drift: Array | None = None
    sway_rms: float | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class SensorMotion:
    """Filtered sensor signals at the body origin (n, 3) on the segment's clock (n,)."""

    t_s: Array
    depth: Array
    euler: Array
    omega: Array
    omega_dot: Array
    velocity: Array | None
    gyro_bias: Array


def low_pass(t_s: Array, values: Array, cutoff_hz: float | None) -> Array:
    """Return values (n,) or (n, k) after the zero-phase low-pass; None: as they are."""
    return values if cutoff_hz is None else zero_phase_lowpass(t_s, values, cutoff_hz=cutoff_hz)


def sensor_motion(
    resampled: pa.Table,
    vehicle: Vehicle,
    *,
    cutoff_hz: float | None,
    fit_gyro_bias: bool,
    arm: bool = True,
) -> SensorMotion:
    """Return the signals at the body origin, all filtered alike.

    Lever arms are taken out (that of the velocity sensor only with `arm`), and the gyro
    bias. Raises `DataError` without angular rates.
    """
    if not has_columns(resampled, VELOCITY[3:]):
        raise missing("imu", "angular rates")
    t_s = clock(resampled)
    euler = low_pass(t_s, matrix(resampled, ATTITUDE), cutoff_hz)
    omega = low_pass(t_s, matrix(resampled, VELOCITY[3:]), cutoff_hz)
    bias = gyro_bias(t_s, euler, omega).bias if fit_gyro_bias else np.zeros(3)
    omega = omega - bias
    velocity = None
    if has_columns(resampled, VELOCITY[:3]):
        velocity = low_pass(t_s, matrix(resampled, VELOCITY[:3]), cutoff_hz)
        if arm:
            velocity = lever_arm_velocity(velocity, omega, vehicle.dvl.arm_m)
    depth = low_pass(t_s, column(resampled, "z_m"), cutoff_hz)
    depth = depth - depth_below_origin(euler, vehicle.depth_sensor.arm_m)
    return SensorMotion(t_s, depth, euler, omega, derivative(t_s, omega), velocity, bias)


def depth_below_origin(euler: Array, arm_m: Array) -> Array:
    """Return how much deeper (n,) [m] than the origin a point at `arm_m` (3,) is."""
    return np.asarray(rotation_body_to_ned(euler)[:, 2, :] @ arm_m)


def missing(stream: str, need: str) -> DataError:
    """Return the error for a stream that the method needs and the segment lacks."""
    return DataError(
        f"stage fuse needs {need}: the stream '{stream}' is missing",
        remedy=f"It can come from: {supply_text(stream)}.",
    )
