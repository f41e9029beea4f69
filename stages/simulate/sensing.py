"""Records of a twin's sensors on a flown leg, and the true motion.

One table per stream in SI, each on its own clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.rov.orders import random_numbers
from auvid.hydro.dynamics.simulation.rov.sensors import START_US, regular_times
from auvid.hydro.dynamics.simulation.sensor_models import Ahrs, ahrs, pressure_depth, velocity_log
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor
from auvid.stages.columns import ACCELERATION, GYRO, POSE, VELOCITY, force_columns, named
from auvid.stages.simulate.flights import DEPTH, IMU, FlownLeg
from auvid.stages.simulate.flights import VELOCITY as DVL
from auvid.stages.simulate.plans import Plan

FINS = ("fin_s_rad", "fin_p_rad", "fin_b_rad", "fin_t_rad")
ACCEL = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2")


@dataclass(frozen=True)
class Recorded:
    """The streams of one log: stream -> column -> values (n,).

    `time_us` among them, named as in the schemas of the streams; `parameters` of the
    autopilot that it has.
    """

    leg: str
    streams: Mapping[str, Mapping[str, npt.NDArray[Any]]]
    biases: Mapping[str, Array]
    text: str
    parameters: Mapping[str, float] = field(default_factory=dict)


def record(flown: FlownLeg, plan: Plan, *, seed: int, text: str) -> Recorded:
    """Return sensor streams over the whole log.

    A sensor with a lag stamps its values that much later.

    Clocks tick in whole milliseconds, which every log format can hold.
    """
    vehicle, leg = flown.simulated.vehicle, flown.leg.id
    times = {
        stream: regular_times(flown.log_end_s, stream, rate)
        for stream, rate in plan.rates_hz.items()
    }
    lags = {
        "imu": vehicle.imu.lag_s,
        "velocity": vehicle.dvl.lag_s,
        "depth": vehicle.depth_sensor.lag_s,
        "actuators": 0.0,
    }
    sensed_s = {
        stream: np.maximum((values - START_US) / 1e6 - lags[stream], -flown.offset_s)
        for stream, values in times.items()
    }
    motion = {stream: flown.motion(values) for stream, values in sensed_s.items()}
    unit = ahrs(
        motion["imu"],
        vehicle.imu,
        plan.ahrs,
        random_numbers(seed, leg, IMU),
        rate_hz=plan.rates_hz["imu"],
        gravity=vehicle.gravity,
    )
    turn = rotation_body_to_ned(plan.dvl_mounting_error_rad)
    dvl = MountedSensor(
        vehicle.dvl.arm_m + plan.dvl_arm_error_m, turn @ vehicle.dvl.rotation, vehicle.dvl.lag_s
    )
    velocity = velocity_log(
        motion["velocity"], dvl, random_numbers(seed, leg, DVL), noise_m_s=plan.dvl_sd_m_s
    )
    depth = pressure_depth(
        motion["depth"],
        vehicle.depth_sensor,
        random_numbers(seed, leg, DEPTH),
        noise_m=plan.depth_sd_m,
    )
    control = motion["actuators"].actuation
    streams = {
        "imu": {"time_us": times["imu"], **named(GYRO, unit.gyro), **named(ACCEL, unit.accel)},
        "attitude": {"time_us": times["imu"], **named(POSE[3:], wrapped(unit))},
        "velocity": {"time_us": times["velocity"], **named(VELOCITY[:3], velocity)},
        "depth": {"time_us": times["depth"], "depth_m": depth},
        "actuators": {
            "time_us": times["actuators"],
            "propeller_rev_s": control.propeller_rev_s,
            **named(FINS, control.fins_rad),
        },
    }
    return Recorded(leg, streams, unit.biases, text)


def wrapped(unit: Ahrs) -> Array:
    """Attitude with yaw within +-pi, as an AHRS gives it."""
    attitude = unit.attitude.copy()
    attitude[:, 2] = np.remainder(attitude[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return attitude


def truth_table(flown: FlownLeg, plan: Plan) -> pa.Table:
    """Schema `truth`: the true motion of the log at the ticks of the autopilot."""
    first = round(flown.offset_s / plan.tick_s)
    ticks = np.arange(first, len(flown.flight.actuation.propeller_rev_s))
    t_s = np.asarray(ticks * plan.tick_s - flown.offset_s, dtype=np.float64)
    motion = flown.motion(t_s)
    unsteady = motion.actuation.force
    columns = {
        "time_us": START_US + np.rint(t_s * 1e6).astype(np.int64),
        "t_s": t_s,
        **named(POSE, motion.eta),
        **named(VELOCITY, motion.nu),
        **named(ACCELERATION, motion.nu_dot),
        "propeller_rev_s": motion.actuation.propeller_rev_s,
        **named(FINS, motion.actuation.fins_rad),
    }
    for name, force in (
        ("viscous", motion.viscous),
        ("unsteady", unsteady),
        ("tau_bar", motion.viscous + unsteady),
    ):
        columns |= named(force_columns(name), force)
    return make_table("truth", columns)
