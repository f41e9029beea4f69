"""What one leg hands to the estimators: sensors and actuators at their own times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_SPREAD
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor

CHANNELS = (
    "phi", "theta", "psi",
    "gyro_x", "gyro_y", "gyro_z",
    "accel_x", "accel_y", "accel_z",
    "velocity_x", "velocity_y", "velocity_z",
    "depth",
)  # fmt: skip
"""Measured quantities, in the order of every array over channels: rad, rad/s, m/s^2,
m/s, m; gyro, accelerometer and velocity log in their sensor's axes."""
SENSORS = {
    "attitude": slice(0, 3),
    "gyro": slice(3, 6),
    "accel": slice(6, 9),
    "velocity": slice(9, 12),
    "depth": slice(12, 13),
}
"""Channels of each sensor."""


@dataclass(frozen=True)
class SensorRecord:
    """Samples (n, k) of one sensor at times (n,) [s], when the motion was measured.

    The sensor's lag is taken off the times. `sd` (k,): standard deviations per sample,
    or None where they are to be estimated from the start.
    """

    t_s: Array
    values: Array
    sd: Array | None = None


@dataclass(frozen=True)
class ActuatorRecord:
    """What the actuators do at times (n,) [s], linear between them.

    `propeller_rev_s` (n,), `fins_rad` (n, 4), `force` (n, 6): force and moment of
    thrusters in body axes [N, N m]. What the vehicle does not have is None.
    """

    t_s: Array
    propeller_rev_s: Array | None = None
    fins_rad: Array | None = None
    force: Array | None = None

    def columns(self) -> Array:
        """Return propeller speed, fins and force side by side (n, 11)."""
        n = len(self.t_s)
        parts = (
            np.zeros((n, 1)) if self.propeller_rev_s is None else self.propeller_rev_s[:, None],
            np.zeros((n, 4)) if self.fins_rad is None else self.fins_rad,
            np.zeros((n, 6)) if self.force is None else self.force,
        )
        return np.hstack(parts)


@dataclass(frozen=True)
class SensorGeometry:
    """Where the sensors sit: one installation for all legs of a vehicle."""

    imu: MountedSensor
    velocity: MountedSensor
    depth: MountedSensor
    gravity: float


@dataclass(frozen=True)
class LegRecord:
    """One unbroken leg: sensors by name (`SENSORS`), those that exist, and actuators.

    attitude (n, 3) [rad] Euler angles, the heading without jumps by 2 pi or with them;
    gyro (n, 3) [rad/s] and accel (n, 3) [m/s^2], specific force, in axes of the IMU;
    velocity (n, 3) [m/s] over ground in axes of the log; depth (n, 1) [m].
    """

    name: str
    sensors: dict[str, SensorRecord]
    actuators: ActuatorRecord
    geometry: SensorGeometry

    def span_s(self) -> tuple[float, float]:
        """Return the span that actuators and all sensors share [s]."""
        series = [self.actuators.t_s, *(item.t_s for item in self.sensors.values())]
        return max(t[0] for t in series), min(t[-1] for t in series)

    def motion(self, t_s: Array, *, gyro_bias: Array | float = 0.0) -> Array:
        """Return [phi, theta, psi, z, nu] (n, 10) at times (n,), from samples alone.

        Linear between samples; depth or a velocity without a sensor is 0. A guess to
        start from, with the noise of the sensors.
        """
        state = np.zeros((len(t_s), 10))
        if "attitude" in self.sensors:
            attitude = self.sensors["attitude"]
            state[:, :3] = _linear(t_s, attitude.t_s, np.unwrap(attitude.values, axis=0))
        if "gyro" in self.sensors:
            gyro = self.sensors["gyro"]
            rate = _linear(t_s, gyro.t_s, gyro.values) - gyro_bias
            state[:, 7:] = rate @ self.geometry.imu.rotation.T
        if "velocity" in self.sensors:
            log, place = self.sensors["velocity"], self.geometry.velocity
            body = _linear(t_s, log.t_s, log.values) @ place.rotation.T
            state[:, 4:7] = body - np.cross(state[:, 7:], place.arm_m)
        if "depth" in self.sensors:
            depth, place = self.sensors["depth"], self.geometry.depth
            below = rotation_body_to_ned(state[:, :3])[:, 2, :] @ place.arm_m
            state[:, 3] = _linear(t_s, depth.t_s, depth.values)[:, 0] - below
        return state


def rough_sd(legs: list[LegRecord]) -> Array:
    """Return the standard deviation per sample of each channel (13,), to start from.

    As stated by the record, else from third differences, whose deviation is sqrt(20)
    times that of white noise and to which slow motion adds little; nan where no leg has
    the sensor.
    """
    out = np.full(len(CHANNELS), np.nan)
    for name, channels in SENSORS.items():
        records = [leg.sensors[name] for leg in legs if name in leg.sensors]
        if not records:
            continue
        if records[0].sd is not None:
            out[channels] = records[0].sd
            continue
        for channel, columns in zip(
            range(channels.start, channels.stop),
            zip(*(r.values.T for r in records), strict=True),
            strict=True,
        ):
            finite = [column[np.isfinite(column)] for column in columns]
            steps = np.concatenate([np.diff(np.unwrap(column), 3) for column in finite])
            if len(steps):
                out[channel] = NORMAL_SPREAD * np.median(np.abs(steps)) / np.sqrt(20.0)
    return np.asarray(np.maximum(out, SMALLEST_SD))


SMALLEST_SD = np.repeat([5e-5, 1e-5, 1e-4, 1e-4, 1e-4], [3, 3, 3, 3, 1])
"""Smallest noise that is believed [rad, rad/s, m/s^2, m/s, m]: about the resolution of
logs; noise-free channels would make gains singular."""


def _linear(t_s: Array, times: Array, values: Array) -> Array:
    """Return values linear between samples, 0 in a column without any."""
    out = np.zeros((len(t_s), values.shape[1]))
    for column, series in enumerate(values.T):
        finite = np.isfinite(series)
        if finite.any():
            out[:, column] = np.interp(t_s, times[finite], series[finite])
    return out
