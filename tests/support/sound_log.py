"""A made-up log of a healthy vehicle that moves in all six axes, as streams, for tests
that then spoil one thing at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.mechanics.kinematics import (
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
)
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.ingest.health.health_check import check_health
from auvid.stages.ingest.streams.mapping import OtherSource

Array = npt.NDArray[np.float64]
LENGTH_S, FIRST_US = 60.0, 5_000_000
GRAVITY = 9.81
DELAY_S = 0.3


def euler(t: Array) -> Array:
    """Attitude (n, 3) in rad."""
    return np.stack(
        [0.10 * np.sin(1.1 * t), 0.10 * np.sin(0.9 * t + 1.0), 2.0 + 0.5 * np.sin(0.5 * t)], axis=1
    )


def velocity(t: Array) -> Array:
    """Body velocity (n, 3) in m/s."""
    return np.stack(
        [0.3 * np.sin(0.7 * t), 0.1 * np.sin(0.8 * t + 1.0), 0.15 * np.sin(1.0 * t + 2.0)], axis=1
    )


def rates(t: Array) -> Array:
    """Body rates (n, 3) in rad/s, exact."""
    step = 1e-5
    dot = (euler(t + step) - euler(t - step)) / (2.0 * step)
    return np.einsum("nij,nj->ni", euler_rate_matrix_inverse(euler(t)), dot)


def acceleration(t: Array) -> Array:
    """Acceleration (n, 3) in body axes in m/s^2: v_dot + omega x v."""
    step = 1e-5
    v_dot = (velocity(t + step) - velocity(t - step)) / (2.0 * step)
    return v_dot + np.cross(rates(t), velocity(t))


def depth(t: Array) -> Array:
    """Depth (n,) in m: the integral of the vertical velocity."""
    fine = np.arange(-1.0, LENGTH_S + 2.0, 0.01)
    down = np.einsum("nij,nj->ni", rotation_body_to_ned(euler(fine)), velocity(fine))[:, 2]
    return 5.0 + np.interp(t, fine, np.cumsum(down) * 0.01)


def clock(rate_hz: float) -> Array:
    """Times (n,) in s of a sensor."""
    return np.arange(int(LENGTH_S * rate_hz)) / rate_hz


@dataclass
class Log:
    """Columns of streams by name, what `log_info` says, rejected samples, other
    sources; all to be spoiled by tests.
    """

    streams: dict[str, dict[str, Any]]
    info: dict[str, Any]
    dropped: list[dict[str, Any]] = field(default_factory=list)
    others: list[OtherSource] = field(default_factory=list)
    vehicle: Vehicle | None = None

    def t_s(self, stream: str) -> Array:
        """Times of a stream in s."""
        return np.asarray((self.streams[stream]["time_us"] - FIRST_US) / 1e6)

    def keep(self, stream: str, rows: npt.NDArray[np.bool_]) -> None:
        """Keep these rows of a stream only."""
        self.streams[stream] = {
            name: np.asarray(values)[rows] for name, values in self.streams[stream].items()
        }

    def health(self) -> dict[str, Any]:
        """Its health document."""
        tables = {name: make_table(name, columns) for name, columns in self.streams.items()}
        for name, table in tables.items():
            described = self.info["streams"].get(name, {})
            alternatives = [
                {"source": item.source, "columns": "", "status": item.refused or "available"}
                for item in self.others
            ]
            self.info["streams"][name] = {
                "source": described.get("source", name.upper()),
                "alternatives": alternatives,
                "columns": [column for column in table.column_names if column != "time_us"],
                "rows": table.num_rows,
                "rate_hz": None,
                "start_us": 0,
                "end_us": 0,
                "duration_s": 0.0,
                "gaps": 0,
                "rejected": sum(row["count"] for row in self.dropped if row["stream"] == name),
                "longest_gap_s": (
                    float(np.diff(self.t_s(name)).max()) if table.num_rows > 1 else 0.0
                ),
            }
        rows = {
            key: [row.get(key, 0) for row in self.dropped]
            for key in ("stream", "reason", "count", "bytes", "first", "last")
        }
        return check_health(
            tables,
            LogInfo.model_validate(self.info),
            make_table("dropped", rows),
            vehicle=self.vehicle,
            others=self.others,
        )

    def every_id(self) -> set[str]:
        """The findings by name, with those that another one explains."""
        document = self.health()
        return {item["id"] for item in (*document["findings"], *document["explained"])}

    def ids(self) -> list[str]:
        """The findings by name."""
        return [item["id"] for item in self.health()["findings"]]

    def finding(self, name: str) -> dict[str, Any]:
        """The one finding of this name."""
        (match,) = (item for item in self.health()["findings"] if item["id"] == name)
        return dict(match)


def micro(t: Array) -> npt.NDArray[np.int64]:
    """Time stamps in us of times in s."""
    return np.rint(t * 1e6).astype(np.int64) + FIRST_US


def sound() -> Log:
    """A log in which nothing is wrong: 60 s, attitude and depth 10 Hz, inertial unit 25
    Hz, velocity 8 Hz, eight thrusters at 10 Hz.
    """
    random = np.random.default_rng(3)
    t_imu, t, t_dvl = clock(25.0), clock(10.0), clock(8.0)

    def noise(shape: tuple[int, ...], size: float) -> Array:
        return size * random.standard_normal(shape)

    gyro = rates(t_imu) + noise((t_imu.size, 3), 0.002)
    up = acceleration(t_imu) - GRAVITY * rotation_body_to_ned(euler(t_imu))[:, 2]
    up += noise((t_imu.size, 3), 0.05)
    attitude = euler(t) + noise((t.size, 3), 1e-4)
    speed = velocity(t_dvl) + noise((t_dvl.size, 3), 0.005)
    # Motion answers the outputs 0.3 s later.
    motion = np.hstack([velocity(t + DELAY_S), rates(t + DELAY_S)])
    mixed = motion / motion.std(axis=0) @ random.uniform(-1.0, 1.0, (6, 8))
    pwm = 1500.0 + 80.0 * mixed
    imu = {f"gyro_{axis}_rad_s": gyro[:, index] for index, axis in enumerate("xyz")}
    imu |= {f"accel_{axis}_m_s2": up[:, index] for index, axis in enumerate("xyz")}
    streams: dict[str, dict[str, Any]] = {
        "imu": {"time_us": micro(t_imu), **imu},
        "attitude": {
            "time_us": micro(t),
            **dict(zip(("phi_rad", "theta_rad", "psi_rad"), attitude.T, strict=True)),
        },
        "depth": {"time_us": micro(t), "depth_m": depth(t) + noise(t.shape, 0.002)},
        "velocity": {
            "time_us": micro(t_dvl),
            **dict(zip(("u_m_s", "v_m_s", "w_m_s"), speed.T, strict=True)),
        },
        "actuators": {
            "time_us": micro(t),
            **{f"pwm_{number + 1}_us": pwm[:, number] for number in range(8)},
        },
        "battery": {
            "time_us": micro(t),
            "voltage_v": 16.0 + noise(t.shape, 0.01),
            "current_a": 5.0 + noise(t.shape, 0.1),
        },
        "mode": {"time_us": micro(t[:1]), "mode": ["MANUAL"], "armed": [True]},
    }
    file = {
        "name": "made.BIN",
        "format": "ArduPilot DataFlash",
        "size_bytes": 1000,
        "record_bytes": 1000,
        "definition_bytes": 0,
    }
    info = {
        "log": "made",
        "files": [{**file, "skipped": [], "status": "complete", "seconds_lost": 0.0}],
        "status": "complete",
        "start_us": FIRST_US,
        "end_us": FIRST_US + int(LENGTH_S * 1e6),
        "utc_offset_us": None,
        "vehicle": "ArduSub V4.5.0 (12345678)",
        "parameters": {
            "FRAME_CONFIG": 2.0,
            **{f"MOT_{number}_DIRECTION": 1.0 for number in range(1, 9)},
        },
        "accelerometer": "specific_force",
        "streams": {},
        "counts": {"IMU": t_imu.size},
        "notes": [],
    }
    return Log(streams, info)
