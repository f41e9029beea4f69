"""What the sensors of an ROV record of a dive, each at its own times.

Rates, noise and habits are those of the dive at Pier 59, Seattle: a velocity log with
irregular pings, late reports and gaps; an attitude that drifts slowly; a barometer with
steps; pulses and voltage at 10 Hz. With nothing in the plan but rates all are exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument, VelocityLogEntry
from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Ints
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.rov.dive import Dive, DiveMotion, fly_dive
from auvid.hydro.dynamics.simulation.rov.orders import (
    BATTERY,
    DEPTH,
    IMU,
    VELOCITY,
    random_numbers,
)
from auvid.hydro.dynamics.simulation.rov.truth import RovTruth
from auvid.hydro.dynamics.simulation.sensor_models import (
    AhrsNoise,
    ahrs,
    pressure_depth,
    velocity_log,
)
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor

START_US = 10_000_000
"""The vehicle's clock at the start of every log."""
PHASE_MS = {"imu": 3, "attitude": 5, "velocity": 107, "depth": 41, "actuators": 0, "battery": 20}
"""When each sensor first reports, after the start of the log."""
OUTPUTS = 14
"""Output channels that a log holds; those without a thruster have no pulse."""
SLOW = 1.8
"""A slow ping of the velocity log takes so many times as long."""
Columns = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class DiveRecord:
    """What a log of a dive holds: stream -> column -> values (n,).

    `time_us` is among the columns, which are those of the schemas of the streams;
    `mode` has the numbers of ArduSub's modes. `biases` (3,) of gyro and accelerometer,
    in sensor axes.
    """

    streams: Mapping[str, Columns]
    biases: Mapping[str, Array]


def dive_in_memory(
    truth: RovTruth, plan: DivePlanDocument, leg: str, *, seed: int
) -> tuple[Dive, DiveRecord]:
    """Return a leg as flown, and what its sensors recorded; equal seeds, equal dives.

    True states and forces: `dive.motion(t_s)`, t_s from the start of the log, at which
    the clock of the sensors reads START_US.
    """
    entry = next(item for item in plan.legs if item.id == leg)
    dive = fly_dive(truth, plan, entry, seed=seed)
    return dive, record_dive(dive, plan, seed=seed)


def record_dive(dive: Dive, plan: DivePlanDocument, *, seed: int) -> DiveRecord:
    """Return the streams of a dive over its whole log.

    A sensor with a lag stamps what it saw that much later; clocks tick in whole
    milliseconds. Raises `DataError` for a dive that ended before its leg.
    """
    if not dive.reached:
        raise DataError(f"there is no log of leg '{dive.leg.id}': {dive.stop}")
    vehicle, sensors, name = dive.truth.vehicle, plan.sensors, dive.leg.id
    rates = {
        "imu": sensors.imu.rate_hz,
        "attitude": sensors.attitude.rate_hz,
        "depth": sensors.depth.rate_hz,
        "actuators": sensors.outputs.rate_hz,
        "battery": sensors.battery.rate_hz,
    }
    times = {key: regular_times(dive.log_end_s, key, rate) for key, rate in rates.items()}
    times["velocity"] = _ping_times(dive, sensors.dvl, random_numbers(seed, name, VELOCITY))
    lags = dict.fromkeys(times, 0.0) | {
        "imu": vehicle.imu.lag_s,
        "velocity": vehicle.dvl.lag_s + sensors.dvl.late_s,
        "depth": vehicle.depth_sensor.lag_s + sensors.depth.late_s,
    }
    motion = {
        key: dive.motion(np.clip((at - START_US) / 1e6 - lags[key], -dive.offset_s, dive.log_end_s))
        for key, at in times.items()
        if key not in ("actuators", "battery")
    }
    unit = ahrs(
        motion["imu"].sensed(),
        vehicle.imu,
        AhrsNoise(
            gyro_rad_s=sensors.imu.gyro_sd_rad_s,
            gyro_bias_rad_s=sensors.imu.gyro_bias_sd_rad_s,
            accel_m_s2=sensors.imu.accel_sd_m_s2,
            accel_bias_m_s2=sensors.imu.accel_bias_sd_m_s2,
        ),
        random_numbers(seed, name, IMU),
        rate_hz=rates["imu"],
        gravity=vehicle.gravity,
    )
    depth = pressure_depth(
        motion["depth"].sensed(),
        vehicle.depth_sensor,
        random_numbers(seed, name, DEPTH),
        noise_m=sensors.depth.sd_m,
    )
    if sensors.depth.step_m > 0.0:
        depth = np.rint(depth / sensors.depth.step_m) * sensors.depth.step_m
    streams: dict[str, Columns] = {
        "imu": _columns(times["imu"], ("gyro_{}_rad_s", "accel_{}_m_s2"), unit.gyro, unit.accel),
        "attitude": _attitude(dive, times["attitude"], motion["attitude"]),
        "velocity": _velocity(dive, plan, times["velocity"], motion["velocity"], seed),
        "depth": {"time_us": times["depth"], "depth_m": depth},
        "actuators": _actuators(dive, times["actuators"]),
        "battery": _battery(dive, plan, times["battery"], random_numbers(seed, name, BATTERY)),
        "mode": _modes(dive),
    }
    return DiveRecord(streams, unit.biases)


def regular_times(log_end_s: float, stream: str, rate_hz: float) -> Ints:
    """Return times (n,) of a regular stream [us] on the vehicle's clock.

    Its phase, then every 1/rate_hz, rounded to milliseconds.
    """
    first, last = PHASE_MS[stream], np.floor(log_end_s * 1000.0 + 1e-6)
    count = int(np.floor((last - first) * rate_hz / 1000.0 + 1e-9)) + 1
    milliseconds = np.rint(first + np.arange(count) * 1000.0 / rate_hz).astype(np.int64)
    return np.asarray(milliseconds * 1000 + START_US)


def _ping_times(dive: Dive, entry: VelocityLogEntry, random: np.random.Generator) -> Ints:
    """Return the times (n,) at which the velocity log reports [us]."""
    count = int(np.ceil(dive.log_end_s * entry.rate_hz)) + 1
    slow = random.random(count) < entry.slow_share
    steps = np.where(slow, SLOW, 1.0) / entry.rate_hz
    at = PHASE_MS["velocity"] / 1000.0 + np.concatenate([[0.0], np.cumsum(steps[:-1])])
    late = np.clip(entry.jitter_s * random.standard_normal(count), -0.45 * steps, 0.45 * steps)
    at = at + late
    at = at[(random.random(count) >= entry.lost_share) & (at <= dive.log_end_s)]
    milliseconds = np.unique(np.maximum(np.rint(at * 1000.0), 1.0).astype(np.int64))
    return np.asarray(milliseconds * 1000 + START_US)


def _columns(time_us: Ints, names: tuple[str, ...], *values: Array) -> Columns:
    """Return vectors (n, 3) as columns x y z, or u v w, of a stream."""
    columns: dict[str, npt.NDArray[Any]] = {"time_us": time_us}
    for name, vectors in zip(names, values, strict=True):
        for index, letter in enumerate("uvw" if name == "{}_m_s" else "xyz"):
            columns[name.format(letter)] = np.ascontiguousarray(vectors[:, index])
    return columns


def _attitude(dive: Dive, time_us: Ints, motion: DiveMotion) -> Columns:
    """Return the attitude of the autopilot's filter, with the error it steered by."""
    ticks = np.arange(len(dive.errors))
    at = (motion.t_s + dive.offset_s) / dive.tick_s
    error = [np.interp(at, ticks, dive.errors[:, column]) for column in (9, 10, 11)]
    angles = motion.eta[:, 3:] + np.column_stack(error)
    return {
        "time_us": time_us,
        "phi_rad": angles[:, 0],
        "theta_rad": angles[:, 1],
        "psi_rad": np.remainder(angles[:, 2] + np.pi, 2.0 * np.pi) - np.pi,
    }


def _velocity(
    dive: Dive, plan: DivePlanDocument, time_us: Ints, motion: DiveMotion, seed: int
) -> Columns:
    entry, filed = plan.sensors.dvl, dive.truth.vehicle.dvl
    turn = rotation_body_to_ned(np.radians(entry.mounting_error_deg))
    sensor = MountedSensor(
        filed.arm_m + np.array(entry.arm_error_m), turn @ filed.rotation, filed.lag_s
    )
    random = random_numbers(seed, f"{dive.leg.id} noise", VELOCITY)
    values = velocity_log(motion.sensed(), sensor, random, noise_m_s=entry.sd_m_s)
    repeats = random.random(len(values)) < entry.held_share
    repeats[0] = False
    latest = np.maximum.accumulate(np.where(repeats, 0, np.arange(len(values))))
    return _columns(time_us, ("{}_m_s",), values[latest])


def _actuators(dive: Dive, time_us: Ints) -> Columns:
    logged = np.zeros((OUTPUTS, len(time_us)))
    pulses = dive.pulses_us[dive.tick_of((time_us - START_US) / 1e6)]
    for index, output in enumerate(dive.truth.thrusters.outputs):
        logged[output - 1] = pulses[:, index]
    return {"time_us": time_us} | {
        f"pwm_{number}_us": values for number, values in enumerate(logged, start=1)
    }


def _battery(
    dive: Dive, plan: DivePlanDocument, time_us: Ints, random: np.random.Generator
) -> Columns:
    supply = dive.supply[dive.tick_of((time_us - START_US) / 1e6)]
    noise = plan.sensors.battery.sd_V * random.standard_normal(len(time_us))
    return {"time_us": time_us, "voltage_v": supply[:, 0] + noise, "current_a": supply[:, 1]}


def _modes(dive: Dive) -> Columns:
    """Return the changes of mode in the log; the first row is that of its start."""
    ticks = np.arange(int(dive.tick_of(0.0)), len(dive.pulses_us))
    codes = dive.orders.modes[ticks]
    change = np.concatenate([[True], codes[1:] != codes[:-1]])
    at = np.maximum(ticks[change] * dive.tick_s - dive.offset_s, 0.0)
    time_us = START_US + np.rint(at * 1000.0).astype(np.int64) * 1000
    return {"time_us": time_us, "mode": codes[change]}
