"""Prescribed rich motions with exact derivatives, and what ideal sensors and the stages
before a stage under test would make of them.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from scipy.interpolate import CubicSpline

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import ChannelSmoothing, FusionRecord, SegmentRecord
from auvid.data_schemas.tables import make_table
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.equations_of_motion import Control, forward_dynamics
from auvid.hydro.dynamics.mechanics.kinematics import (
    eta_dot,
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import eta_ratio
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.columns import (
    ACCELERATION,
    ACCELEROMETER,
    ATTITUDE,
    POSE,
    POSE_RATE,
    VELOCITY,
    force_columns,
    named,
)

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).parents[2]
RATE_HZ = 50.0
MINIMUM_SPEED = 0.05
FINS = ("fin_s_rad", "fin_p_rad", "fin_b_rad", "fin_t_rad")


@cache
def vehicle_document(name: str) -> dict[str, Any]:
    """A vehicle file of the project; do not write to it."""
    document: dict[str, Any] = read_yaml(
        (ROOT / f"vehicles/{name}.yaml").read_text(encoding="utf-8")
    )
    return document


@cache
def shipped_vehicle(name: str) -> Vehicle:
    """Return a vehicle of the project."""
    return vehicle_from_document(vehicle_document(name))


VT690 = shipped_vehicle("vt690")


def published(name: str) -> IdentifiedModel:
    """The published coefficients of a model for the VT 690 (Appendix E)."""
    coefficients: dict[str, dict[str, float]] = {}
    with (ROOT / f"vehicles/vt690/coefficients/{name}.csv").open(
        newline="", encoding="utf-8"
    ) as file:
        for row in csv.DictReader(file):
            coefficients.setdefault(row["axis"], {})[row["term"]] = float(row["value"])
    return IdentifiedModel(name, coefficients)


@dataclass(frozen=True)
class Motion:
    """True pose, velocity and acceleration (n, 6) of the body origin, and the commands:
    rev/s (n,), fin angles (n, 4).
    """

    t_s: Array
    eta: Array
    nu: Array
    nu_dot: Array
    rev_s: Array
    fins: Array


def waves(
    rng: np.random.Generator,
    t: Array,
    amplitude: float,
    *,
    low: float = 0.05,
    high: float = 0.6,
    number: int = 5,
) -> Array:
    """A sum of sines and its first two derivatives, (3, n); it stays within
    +-amplitude.
    """
    omega = 2.0 * np.pi * rng.uniform(low, high, number)
    share = rng.uniform(0.5, 1.0, number)
    size, phase = amplitude * share / share.sum(), rng.uniform(0.0, 2.0 * np.pi, number)
    angle = np.outer(t, omega) + phase
    return np.array(
        [np.sin(angle) @ size, np.cos(angle) @ (size * omega), -np.sin(angle) @ (size * omega**2)]
    )


def rich_motion(seconds: float = 120.0, *, seed: int = 1, ahead: bool = True) -> Motion:
    """Every velocity excited in both directions, u > 0 if `ahead`; velocities and
    attitude are sums of sines, their rates are exact.
    """
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, 1.0 / RATE_HZ)
    linear = np.array([waves(rng, t, amplitude) for amplitude in (0.7, 0.5, 0.4)])
    if ahead:
        linear[0, 0] += 1.5
    angle = np.array([waves(rng, t, amplitude) for amplitude in (0.5, 0.4, 1.0)])
    euler, rate, second = angle[:, 0].T, angle[:, 1].T, angle[:, 2].T
    to_body = euler_rate_matrix_inverse(euler)
    omega = np.einsum("nij,nj->ni", to_body, rate)
    omega_dot = np.einsum("nij,nj->ni", to_body, second) + np.einsum(
        "nij,nj->ni", _rate_of_inverse(euler, rate), rate
    )
    ned = np.einsum("nij,nj->ni", rotation_body_to_ned(euler), linear[:, 0].T)
    position = CubicSpline(t, ned).antiderivative()(t) + np.array([0.0, 0.0, 8.0])
    steps = 5 * np.floor(t / 7.0).astype(int) % 4
    return Motion(
        t,
        np.hstack([position, euler]),
        np.hstack([linear[:, 0].T, omega]),
        np.hstack([linear[:, 1].T, omega_dot]),
        np.array([30.0, 35.55, 39.2, 43.3])[steps],
        np.column_stack([waves(rng, t, 0.2)[0] for _ in FINS]),
    )


def _rate_of_inverse(euler: Array, rate: Array) -> Array:
    """Time derivative of P_omega^-1."""
    (cf, ct), (sf, st) = np.cos(euler[:, :2]).T, np.sin(euler[:, :2]).T
    f, th = rate[:, 0], rate[:, 1]
    zero = np.zeros_like(cf)
    rows = [
        [zero, zero, -ct * th],
        [zero, -sf * f, -st * th * sf + ct * cf * f],
        [zero, -cf * f, -st * th * cf - ct * sf * f],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def ratio_of(motion: Motion, vehicle: Vehicle = VT690) -> Array:
    """eta = u_c(n) / U along a motion."""
    assert vehicle.propeller is not None
    return eta_ratio(level_speed(vehicle.propeller, motion.rev_s), motion.nu, MINIMUM_SPEED)


def driven_by(motion: Motion, force: Array, vehicle: Vehicle = VT690) -> Motion:
    """The motion with the accelerations that this viscous force (n, 6) and the commands
    give at its states.
    """
    control = Control(propeller_rev_s=motion.rev_s, fins_rad=motion.fins)
    return replace(motion, nu_dot=forward_dynamics(vehicle, motion.eta, motion.nu, control, force))


@dataclass(frozen=True)
class Sensors:
    """How the sensors of `resampled_table` are mounted and what is wrong with them."""

    dvl_arm: Array
    dvl_mounting: Array
    imu_arm: Array
    imu_mounting: Array
    depth_arm: Array
    gyro_bias: Array
    accel_bias: Array
    convention: str = "specific_force"


IDEAL = Sensors(*(np.zeros(3) for _ in range(7)))
ODD = Sensors(
    dvl_arm=np.array([0.3, -0.1, 0.2]),
    dvl_mounting=np.array([0.1, -0.2, 0.785]),
    imu_arm=np.array([-0.2, 0.1, 0.05]),
    imu_mounting=np.array([-0.3, 0.2, 1.2]),
    depth_arm=np.array([0.4, 0.1, -0.2]),
    gyro_bias=np.array([0.004, -0.006, 0.003]),
    accel_bias=np.array([0.1, -0.05, 0.08]),
)


def mounted_vehicle(sensors: Sensors, name: str = "vt690", *, dvl_lag_s: float = 0.0) -> Vehicle:
    """Return the vehicle with the sensors at these places."""

    def quantity(value: Array, unit: str) -> dict[str, Any]:
        return {"value": [float(x) for x in value], "unit": unit, "source": "test"}

    imu = {
        "arm": quantity(sensors.imu_arm, "m"),
        "mounting": quantity(sensors.imu_mounting, "rad"),
        "accelerometer": sensors.convention,
    }
    dvl = {
        "arm": quantity(sensors.dvl_arm, "m"),
        "mounting": quantity(sensors.dvl_mounting, "rad"),
        "lag": {"value": dvl_lag_s, "unit": "s", "source": "test"},
    }
    mounted = {"dvl": dvl, "imu": imu, "depth": {"arm": quantity(sensors.depth_arm, "m")}}
    return vehicle_from_document({**vehicle_document(name), "sensors": mounted})


def resampled_table(
    motion: Motion,
    sensors: Sensors = IDEAL,
    *,
    gravity: float = 9.80665,
    without: tuple[str, ...] = (),
    sensor_axes: bool = False,
) -> pa.Table:
    """Return what ideal sensors at these places read on the motion's clock.

    In body axes, as `resample` gives it; `sensor_axes`: as the sensors themselves
    report it. Biases act in body axes; `without` names columns to leave out.
    """
    euler, omega, omega_dot = motion.eta[:, 3:], motion.nu[:, 3:], motion.nu_dot[:, 3:]
    to_ned = rotation_body_to_ned(euler)
    rate = eta_dot(motion.eta, motion.nu)
    dvl = motion.nu[:, :3] + np.cross(omega, sensors.dvl_arm)
    point = motion.nu_dot[:, :3] + np.cross(omega, motion.nu[:, :3])
    point = (
        point
        + np.cross(omega_dot, sensors.imu_arm)
        + np.cross(omega, np.cross(omega, sensors.imu_arm))
    )
    accel = {
        "specific_force": point - gravity * to_ned[:, 2, :],
        "inertial": point,
        "derivative": motion.nu_dot[:, :3],
    }[sensors.convention]
    imu, log = (
        rotation_body_to_ned(mounting) if sensor_axes else np.eye(3)
        for mounting in (sensors.imu_mounting, sensors.dvl_mounting)
    )
    columns = {
        "t_s": motion.t_s,
        "z_m": motion.eta[:, 2] + to_ned[:, 2, :] @ sensors.depth_arm,
        "z_dot_m_s": rate[:, 2],
        **named(ATTITUDE, euler),
        **named(("phi_dot_rad_s", "theta_dot_rad_s", "psi_dot_rad_s"), rate[:, 3:]),
        **named(VELOCITY[:3], dvl @ log),
        **named(VELOCITY[3:], (omega + sensors.gyro_bias) @ imu),
        **named(ACCELEROMETER, (accel + sensors.accel_bias) @ imu),
        "propeller_rev_s": motion.rev_s,
        **named(FINS, motion.fins),
    }
    return make_table(
        "resampled", {name: values for name, values in columns.items() if name not in without}
    )


def fused_table(motion: Motion) -> pa.Table:
    """The true state as the stage fuse would give it."""
    rate = eta_dot(motion.eta, motion.nu)
    columns = {
        "t_s": motion.t_s,
        **named(POSE, motion.eta),
        **named(VELOCITY, motion.nu),
        **named(POSE_RATE, rate),
    }
    return make_table("fused", {**columns, **named(ACCELERATION, motion.nu_dot)})


def residual_table(nu: Array, force: Array, ratio: Array | None = None) -> pa.Table:
    """A residual of this force (n, 6) at these velocities (n, 6)."""
    columns = {
        "t_s": np.arange(len(nu)) / RATE_HZ,
        **named(VELOCITY, nu),
        **named(force_columns("tau_bar"), force),
    }
    return make_table("residual", columns if ratio is None else {**columns, "eta_ratio": ratio})


UNSMOOTHED = ChannelSmoothing(
    method="none", lam=0.0, cutoff_hz=None, noise_sd=None, sample_hz=RATE_HZ
)


def segment_document(
    name: str = "one", use: str = "training", *, leg: str | None = None, gyro: bool = True
) -> SegmentRecord:
    """The document of a segment."""
    return SegmentRecord.model_validate(
        {
            "id": name,
            "leg": leg or name,
            "log": "log",
            "use": use,
            "start_us": 0,
            "leg_start_s": 0.0,
            "duration_s": 120.0,
            "margins_s": [0.0, 0.0],
            "samples": 6000,
            "rate_hz": RATE_HZ,
            "lags_s": {},
            "smoothing": {"p_rad_s": UNSMOOTHED} if gyro else {},
            "gaps": [],
            "notes": [],
        }
    )


def log_document(**fields: Any) -> LogInfo:
    """The document of a log without parameters; `fields` go on top."""
    empty: Mapping[str, Any] = {
        "streams": {},
        "counts": {},
        "notes": [],
        "parameters": {},
        "files": [],
    }
    return LogInfo.model_validate(
        {
            "log": "log",
            "status": "complete",
            "start_us": 0,
            "end_us": 1,
            "accelerometer": None,
            "vehicle": None,
            **empty,
            **fields,
        }
    )


def fusion_document(**fields: Any) -> FusionRecord:
    """The document of a fusion without a filter; `fields` go on top."""
    base = {
        "segment": "one",
        "method": "kinematic",
        "as_published": False,
        "cutoff_hz": None,
        "edge_s": 0.0,
        "rms": {},
        "warnings": [],
    }
    return FusionRecord.model_validate({**base, **fields})
