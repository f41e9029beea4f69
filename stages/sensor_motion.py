"""Sensor signals of a segment at the body origin, without lever arms and gyro bias.

Shared by the stages that fuse them and that check how the sensors are installed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.motion import InstallationRecord
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.bias import (
    gyro_bias,
    inertial_acceleration,
    lever_arm_velocity,
)
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.hydro.identification.signals.splines import derivative
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, VELOCITY, clock


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

    def at(self, values: Array, times: Array) -> Array:
        """Return values (n, ...) of this clock at other times, the ends held."""
        from scipy.interpolate import CubicSpline

        inside = np.clip(times, self.t_s[0], self.t_s[-1])
        return np.asarray(CubicSpline(self.t_s, values)(inside))


@dataclass(frozen=True)
class AccelerometerMotion:
    """The accelerometer at its own times (n,) within a segment, body axes (n, 3).

    `acceleration`: of the body origin, without gravity; `reading`: as it came.
    """

    t_s: Array
    reading: Array
    acceleration: Array
    euler: Array
    omega: Array


@dataclass(frozen=True)
class VelocityLogPlacement:
    """Where the velocity log sits: arm (3,) [m], further turn (3, 3) and lag [s].

    Turn and lag come on top of those of the vehicle file, which `resample` took out.
    """

    arm_m: Array
    turn: Array
    lag_s: float

    @classmethod
    def of(cls, vehicle: Vehicle, installation: InstallationRecord | None) -> VelocityLogPlacement:
        """Return that of the vehicle file, or the estimate where there is one."""
        from scipy.spatial.transform import Rotation

        if installation is None or installation.estimate is None:
            return cls(vehicle.dvl.arm_m, np.eye(3), 0.0)
        estimate = installation.estimate
        turn = Rotation.from_rotvec(estimate.angles_rad).as_matrix()
        return cls(np.array(estimate.arm_m), np.asarray(turn), estimate.lag_s)

    def at_origin(self, sensed: Array, omega: Array) -> Array:
        """Return the velocity (n, 3) of the body origin from what the log read."""
        return lever_arm_velocity(sensed @ self.turn.T, omega, self.arm_m)


def low_pass(t_s: Array, values: Array, cutoff_hz: float | None) -> Array:
    """Return values (n,) or (n, k) after the zero-phase low-pass; None: as they are."""
    return values if cutoff_hz is None else zero_phase_lowpass(t_s, values, cutoff_hz=cutoff_hz)


def sensor_motion(
    resampled: pa.Table,
    vehicle: Vehicle,
    *,
    cutoff_hz: float | None,
    fit_gyro_bias: bool,
    placement: VelocityLogPlacement | None,
) -> SensorMotion:
    """Return the signals at the body origin, all filtered alike.

    Lever arms are taken out (that of the velocity log only with a `placement`), and the
    gyro bias. Raises `DataError` without angular rates.
    """
    from scipy.interpolate import CubicSpline

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
        if placement is not None:
            if placement.lag_s != 0.0:
                late = np.clip(t_s + placement.lag_s, t_s[0], t_s[-1])
                velocity = np.asarray(CubicSpline(t_s, velocity)(late))
            velocity = placement.at_origin(velocity, omega)
    depth = low_pass(t_s, column(resampled, "z_m"), cutoff_hz)
    depth = depth - depth_below_origin(euler, vehicle.depth_sensor.arm_m)
    return SensorMotion(t_s, depth, euler, omega, derivative(t_s, omega), velocity, bias)


def accelerometer_motion(
    motion: SensorMotion, imu: pa.Table | None, vehicle: Vehicle, *, convention: str
) -> AccelerometerMotion | None:
    """Return the accelerometer within the segment; None without one, or a velocity."""
    if imu is None or motion.velocity is None or not np.isfinite(matrix(imu, ACCELEROMETER)).all():
        return None
    t = column(imu, "t_s")
    inside = (t >= motion.t_s[0]) & (t <= motion.t_s[-1])
    t, reading = t[inside], matrix(imu, ACCELEROMETER)[inside]
    euler, omega = motion.at(motion.euler, t), motion.at(motion.omega, t)
    acceleration = inertial_acceleration(
        reading,
        convention=convention,
        euler=euler,
        omega=omega,
        omega_dot=motion.at(motion.omega_dot, t),
        velocity=motion.at(motion.velocity, t),
        arm=vehicle.imu.arm_m,
        gravity=vehicle.gravity,
    )
    return AccelerometerMotion(t, reading, acceleration, euler, omega)


def depth_below_origin(euler: Array, arm_m: Array) -> Array:
    """Return how much deeper (n,) [m] than the origin a point at `arm_m` (3,) is."""
    return np.asarray(rotation_body_to_ned(euler)[:, 2, :] @ arm_m)


def missing(stream: str, need: str) -> DataError:
    """Return the error for a stream that the method needs and the segment lacks."""
    return DataError(
        f"stage fuse needs {need}: the stream '{stream}' is missing",
        remedy=f"It can come from: {supply_text(stream)}.",
    )
