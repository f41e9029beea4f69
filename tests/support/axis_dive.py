"""A made-up dive without a velocity log: yaw and heave driven by thrusters, as streams."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.thrusters import thruster_force, thruster_forces
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).parents[2]
FIRST_US = 5_000_000
STEP_S = 0.02
MASS, BUOYANCY_N, HEAVE_DRAG = 26.0, -1.0, 90.0
INERTIA, YAW_DRAG = 0.5, 4.0
GYRO_BIAS = 0.02


def vehicle_document(name: str = "bluerov2") -> dict[str, Any]:
    """Return a bundled vehicle file as a mapping."""
    document: dict[str, Any] = read_yaml((ROOT / f"vehicles/{name}.yaml").read_text())
    return document


VEHICLE = vehicle_from_document(vehicle_document())
assert VEHICLE.thrusters is not None
THRUSTERS = VEHICLE.thrusters


def square(t: Array, period_s: float) -> Array:
    """Return -1 and 1 in turns of half a period, with rests of 0 in between."""
    phase = (t / period_s) % 1.0
    return np.where(phase < 0.4, 1.0, np.where((phase >= 0.5) & (phase < 0.9), -1.0, 0.0))


class Dive:
    """Streams of a dive of `length_s`; `hold` (from, to) stops heave as a snag does.

    `pulses` (n, 6) [us] on `t` (n,) drive it; both may be given.
    """

    def __init__(
        self,
        length_s: float = 120.0,
        *,
        hold: tuple[float, float] = (0.0, 0.0),
        yaw: float = 70.0,
        heave: float = 110.0,
        start_m: float = 12.0,
    ) -> None:
        self.t = np.arange(0.0, length_s, STEP_S)
        away = np.zeros((self.t.size, 6))
        away[:, :4] = yaw * square(self.t, 8.0)[:, None] * np.sign(THRUSTERS.allocation[5, :4])
        away[:, 4:] = heave * square(self.t, 14.0)[:, None]
        self.pulses = 1500.0 + THRUSTERS.direction * away
        self.hold = hold
        self.start_m = start_m
        self.streams: dict[str, dict[str, Any]] = {}
        self.parameters: dict[str, float] = {}
        self.fly()

    def fly(self) -> None:
        """Move the vehicle and write its streams."""
        force = thruster_force(THRUSTERS, thruster_forces(THRUSTERS, self.pulses, 16.0))
        w = np.zeros(self.t.size)
        r = np.zeros(self.t.size)
        holding = (self.t >= self.hold[0]) & (self.t < self.hold[1])
        for at in range(self.t.size - 1):
            down = force[at, 2] + BUOYANCY_N - HEAVE_DRAG * w[at] * abs(w[at])
            w[at + 1] = 0.0 if holding[at] else w[at] + STEP_S * down / MASS
            turn = force[at, 5] - YAW_DRAG * r[at] * abs(r[at])
            r[at + 1] = r[at] + STEP_S * turn / INERTIA
        depth = self.start_m + np.cumsum(w) * STEP_S
        noise = np.random.default_rng(1)
        self.r, self.w = r, w
        zero = np.zeros(self.t.size)
        self.log("actuators", 10.0, {f"pwm_{n + 1}_us": self.pulses[:, n] for n in range(6)})
        self.log("depth", 10.0, {"depth_m": depth + noise.normal(0.0, 0.002, depth.size)})
        self.log(
            "imu",
            25.0,
            {
                "gyro_x_rad_s": noise.normal(0.0, 0.002, r.size),
                "gyro_y_rad_s": noise.normal(0.0, 0.002, r.size),
                "gyro_z_rad_s": r + GYRO_BIAS + noise.normal(0.0, 0.002, r.size),
                **{f"accel_{axis}_m_s2": zero for axis in "xyz"},
            },
        )
        psi = np.cumsum(r) * STEP_S
        self.log("attitude", 10.0, {"phi_rad": zero, "theta_rad": zero, "psi_rad": psi})
        self.log("battery", 1.0, {"voltage_v": zero + 16.0})
        self.streams["mode"] = {
            "time_us": np.array([FIRST_US], dtype=np.int64),
            "mode": ["MANUAL"],
            "armed": [True],
        }

    def log(self, stream: str, rate_hz: float, columns: dict[str, Array]) -> None:
        """Write a stream at a rate."""
        every = round(1.0 / rate_hz / STEP_S)
        time_us = FIRST_US + np.rint(self.t[::every] * 1e6).astype(np.int64)
        self.streams[stream] = {"time_us": time_us} | {
            name: np.ascontiguousarray(values[::every]) for name, values in columns.items()
        }

    def tables(self) -> dict[str, pa.Table]:
        """Return the streams as tables."""
        return {name: make_table(name, columns) for name, columns in self.streams.items()}

    def info(self) -> LogInfo:
        """Return what ingest says of the log."""
        streams = {
            name: {
                "source": name.upper(),
                "alternatives": [],
                "columns": [key for key in columns if key != "time_us"],
                "rows": len(columns["time_us"]),
                "rejected": 0,
                "rate_hz": None,
                "start_us": 0,
                "end_us": 0,
                "duration_s": 0.0,
                "longest_gap_s": 0.0,
                "gaps": 0,
            }
            for name, columns in self.streams.items()
        }
        return LogInfo.model_validate(
            {
                "log": "dive",
                "files": [],
                "status": "complete",
                "start_us": FIRST_US,
                "end_us": FIRST_US + round(float(self.t[-1]) * 1e6),
                "vehicle": "ArduSub",
                "parameters": self.parameters,
                "streams": streams,
                "counts": {},
                "notes": [],
            }
        )
