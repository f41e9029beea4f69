"""Write a log of the twin as CSV, with the column maps of its files.

One file per sensor, in double precision.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.hydro.dynamics.simulation.sensor_models import without_gravity
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.columns import GYRO, POSE, VELOCITY
from auvid.stages.simulate.bench_plans import OUTPUTS
from auvid.stages.simulate.plans import csv_name
from auvid.stages.simulate.sensing import ACCEL, FINS, Recorded

TIME = "time_s"
PARTS: Mapping[str, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "ahrs": (("attitude", POSE[3:]), ("imu", (*GYRO, *ACCEL))),
    "dvl": (("velocity", VELOCITY[:3]),),
    "depth": (("depth", ("depth_m",)),),
    "actuators": (("actuators", ("propeller_rev_s", *FINS)),),
    "imu": (("imu", (*GYRO, *ACCEL)),),
    "attitude": (("attitude", POSE[3:]),),
    "battery": (("battery", ("voltage_v", "current_a")),),
    "glider": (
        (
            "glider",
            (
                "pressure_pa",
                "pitch_rad",
                "buoyancy_drive_m3",
                "density_kg_m3",
                "temperature_K",
                "speed_m_s",
            ),
        ),
    ),
    "outputs": (("actuators", tuple(f"pwm_{number}_us" for number in range(1, OUTPUTS + 1))),),
}
"""File -> the streams in it with their fields; columns have the names of the fields."""
UNIT_OF_SUFFIX = (
    ("_us", "us"),
    ("_pa", "Pa"),
    ("_kg_m3", "kg/m^3"),
    ("_m3", "m^3"),
    ("_K", "K"),
    ("_rad_s", "rad/s"),
    ("_m_s2", "m/s^2"),
    ("_rev_s", "1/s"),
    ("_m_s", "m/s"),
    ("_rad", "rad"),
    ("_v", "V"),
    ("_a", "A"),
    ("_m", "m"),
)


def write_csv(recorded: Recorded, vehicle: Vehicle, *, accelerometer: str) -> dict[str, bytes]:
    """Return the files of one log by name, of the parts that were recorded.

    `inertial`: gravity is taken off the accelerometer by the AHRS's own attitude,
    errors included.
    """
    files = {}
    joint = _same_clock(recorded)
    for part in PARTS:
        if any(
            name not in recorded.streams.get(stream, ())
            for stream, fields in PARTS[part]
            for name in fields
        ):
            continue
        if part in AHRS_PARTS[joint]:
            continue
        columns: dict[str, Any] = {TIME: recorded.streams[PARTS[part][0][0]]["time_us"] / 1e6}
        for stream, fields in PARTS[part]:
            columns |= {name: recorded.streams[stream][name] for name in fields}
        if part in ("ahrs", "imu") and accelerometer == "inertial":
            attitude = _attitude_at(recorded, recorded.streams["imu"]["time_us"])
            accel = without_gravity(
                np.column_stack([columns[name] for name in ACCEL]),
                attitude,
                vehicle.imu,
                gravity=vehicle.gravity,
            )
            columns |= dict(zip(ACCEL, accel.T, strict=True))
        files[csv_name(recorded.leg, part)] = csv_text(columns)
    return files


AHRS_PARTS: Mapping[bool, tuple[str, ...]] = {True: ("imu", "attitude"), False: ("ahrs",)}
"""Whether gyro and attitude share a clock -> the parts that are then not written."""


def _same_clock(recorded: Recorded) -> bool:
    """Return whether gyro and attitude of a log stand in one file."""
    times = [recorded.streams[name]["time_us"] for name in ("imu", "attitude")]
    return bool(np.array_equal(times[0], times[1]))


def _attitude_at(recorded: Recorded, time_us: Any) -> Array:
    """Return the AHRS's attitude (n, 3) at times [us], by straight lines."""
    attitude = recorded.streams["attitude"]
    angles = [np.unwrap(attitude[name]) for name in POSE[3:]]
    return np.column_stack([np.interp(time_us, attitude["time_us"], values) for values in angles])


def csv_text(columns: Mapping[str, Array]) -> bytes:
    """Return columns as a CSV file; what is not finite is an empty cell."""
    lines = [",".join(columns)]
    lines += [
        ",".join("" if cell != cell else repr(cell) for cell in row)
        for row in zip(*(values.tolist() for values in columns.values()), strict=True)
    ]
    return ("\n".join(lines) + "\n").encode()


def column_maps(*, accelerometer: str) -> dict[str, dict[str, Any]]:
    """Return the column map of each file (schema `column_map`), by part."""
    maps = {}
    for part, streams in PARTS.items():
        entries = [
            {"column": name, "stream": stream, "field": name, "unit": _unit(name)}
            for stream, fields in streams
            for name in fields
        ]
        maps[part] = {
            "time": {"column": TIME, "unit": "s", "epoch": "boot", "start": START_US / 1e6},
            "columns": entries,
        }
    maps["ahrs"]["accelerometer"] = maps["imu"]["accelerometer"] = accelerometer
    return maps


def _unit(field: str) -> str:
    return next(unit for suffix, unit in UNIT_OF_SUFFIX if field.endswith(suffix))
