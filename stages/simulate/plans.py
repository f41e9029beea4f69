"""Plans of a twin, and the set points of its autopilot at each tick.

Refused where they ask for the impossible.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.plans.plan import (
    AhrsEntry,
    FlownLegEntry,
    PlanDocument,
    PlanSensorsEntry,
)
from auvid.data_schemas.errors import CampaignError, PipelineError, raise_faults
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.simulation.sensor_models import AhrsNoise
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle


@dataclass(frozen=True)
class Leg:
    """One leg: steady propeller speed, and steps of the set points.

    Times [s] from the start of the leg, values.
    """

    id: str
    rpm: float
    manoeuvre: str
    duration_s: float
    use: str
    yaw_steps: tuple[Array, Array]
    depth_steps: tuple[Array, Array]

    @property
    def rev_s(self) -> float:
        return self.rpm / 60.0

    def yaw_rad(self, t_s: Array) -> Array:
        """Return the desired heading at times from the start of the leg.

        0 before the first step.
        """
        return _value_at(self.yaw_steps, t_s)

    def depth_m(self, t_s: Array) -> Array:
        """Change of depth asked for at times from the start of the leg."""
        return _value_at(self.depth_steps, t_s)


def _value_at(steps: tuple[Array, Array], t_s: Array) -> Array:
    times, values = steps
    index = np.searchsorted(times, np.asarray(t_s) + 1e-9, side="right")
    return np.concatenate([[0.0], values])[index]


@dataclass(frozen=True)
class Unsteady:
    """First-order Gauss-Markov force.

    Standard deviations (6,) [N, N m] at a level speed of 2 m/s, and the correlation
    time.
    """

    sd: Array
    correlation_s: float


@dataclass(frozen=True)
class Plan:
    """A checked plan in SI.

    `rates_hz` by stream: imu (with attitude), velocity, depth, actuators.
    """

    title: str
    depth_m: float
    settle_s: float
    margin_s: float
    tick_s: float
    steps_per_tick: int
    viscous_lag_s: float
    unsteady: Unsteady | None
    fin_limit_rad: float
    fin_rate_rad_s: float
    rates_hz: Mapping[str, float]
    ahrs: AhrsNoise
    dvl_sd_m_s: float
    dvl_arm_error_m: Array
    dvl_mounting_error_rad: Array
    depth_sd_m: float
    legs: tuple[Leg, ...]


def plan_from_document(document: object, vehicle: Vehicle, *, file: object = None) -> Plan:
    """Return the plan of a document of schema `plan` in SI.

    Raises `CampaignError`, all faults together, for propeller speeds that the vehicle's
    table of level speeds does not reach, and a vehicle without propeller or fins.
    """
    entry = parse(PlanDocument, document, file=file)
    legs = entry.legs or []
    raise_faults(list(_faults(legs, vehicle, file)), file=file)
    sensors = entry.sensors
    unsteady = entry.unsteady
    return Plan(
        title=entry.title,
        depth_m=entry.depth_m,
        settle_s=entry.settle_s,
        margin_s=entry.margin_s,
        tick_s=1.0 / entry.control_hz,
        steps_per_tick=int(np.ceil(1.0 / (entry.control_hz * entry.step_s) - 1e-9)),
        viscous_lag_s=entry.viscous_lag_s,
        unsteady=None
        if unsteady is None
        else Unsteady(
            np.array([*unsteady.force_sd_N, *unsteady.moment_sd_N_m]), unsteady.correlation_s
        ),
        fin_limit_rad=float(np.radians(entry.fins.limit_deg)),
        fin_rate_rad_s=float(np.radians(entry.fins.rate_deg_s)),
        rates_hz=stream_rates(sensors),
        ahrs=ahrs_noise(sensors.ahrs),
        dvl_sd_m_s=sensors.dvl.sd_m_s,
        dvl_arm_error_m=np.array(sensors.dvl.arm_error_m),
        dvl_mounting_error_rad=np.radians(np.array(sensors.dvl.mounting_error_deg)),
        depth_sd_m=sensors.depth.sd_m,
        legs=tuple(_leg(leg, entry) for leg in legs),
    )


def stream_rates(sensors: PlanSensorsEntry) -> dict[str, float]:
    """Return the rate of each stream [Hz]."""
    return {
        "imu": sensors.ahrs.rate_hz,
        "velocity": sensors.dvl.rate_hz,
        "depth": sensors.depth.rate_hz,
        "actuators": sensors.actuators.rate_hz,
    }


def ahrs_noise(entry: AhrsEntry) -> AhrsNoise:
    """Return the noise of an AHRS in SI from its entry in a plan."""
    return AhrsNoise(
        attitude_rad=float(np.radians(entry.attitude_sd_deg)),
        attitude_correlation_s=entry.attitude_correlation_s,
        gyro_rad_s=entry.gyro_sd_rad_s,
        gyro_bias_rad_s=entry.gyro_bias_sd_rad_s,
        accel_m_s2=entry.accel_sd_m_s2,
        accel_bias_m_s2=entry.accel_bias_sd_m_s2,
    )


Entries = tuple[list[dict[str, Any]], list[dict[str, Any]]]
"""The logs and the legs of a manifest."""


def manifest_entries(document: object, *, format: str) -> Entries:
    """Return the logs and legs of a manifest for a twin: one log per leg."""
    plan = parse(PlanDocument, document)
    legs = plan.legs or []
    return (
        [log_entry(leg.id, format, CSV_PARTS) for leg in legs],
        [leg_entry(leg.id, plan.margin_s, leg.duration_s, leg.use) for leg in legs],
    )


def leg_entry(name: str, margin_s: float, duration_s: float, use: str) -> dict[str, Any]:
    """Return the entry of a leg in a manifest, which has a log of its own."""
    end_s = margin_s + duration_s
    return {"id": name, "log": name, "start_s": margin_s, "end_s": end_s, "use": use}


CSV_PARTS = ("ahrs", "dvl", "depth", "actuators")


def log_entry(name: str, format: str, csv_parts: tuple[str, ...]) -> dict[str, Any]:
    """Return the entry of one log in a manifest; a CSV log is one file per part."""
    if format != "csv":
        return {"id": name, "file": log_name(name, format)}
    return {
        "id": name,
        "files": [
            {"file": csv_name(name, part), "columns": f"columns/{part}.yaml"} for part in csv_parts
        ],
    }


def log_name(leg: str, format: str) -> str:
    """File name of a log: the format's usual suffix."""
    return f"{leg}.{'BIN' if format == 'bin' else format}"


def csv_name(leg: str, part: str) -> str:
    """File name of one sensor of a CSV log."""
    return f"{leg}_{part}.csv"


def _leg(entry: FlownLegEntry, plan: PlanDocument) -> Leg:
    yaw = depth = (np.zeros(0), np.zeros(0))
    if entry.manoeuvre == "yaw_steps" and plan.yaw_steps is not None:
        angles = np.array(plan.yaw_steps.values_deg) * plan.yaw_scale
        yaw = np.array(plan.yaw_steps.times_s), np.radians(angles)
    if entry.manoeuvre == "depth_steps" and plan.depth_steps is not None:
        depths = np.array(plan.depth_steps.values_m) * plan.depth_scale
        depth = np.array(plan.depth_steps.times_s), depths
    return Leg(entry.id, entry.rpm, entry.manoeuvre, entry.duration_s, entry.use, yaw, depth)


def _faults(legs: list[FlownLegEntry], vehicle: Vehicle, file: object) -> Iterator[PipelineError]:
    if vehicle.propeller is None or vehicle.fins is None:
        words = "the twin needs a vehicle with a propeller and fins"
        yield CampaignError(words, file=file, field="vehicle", value=vehicle.name)
        return
    fastest = 60.0 * float(vehicle.propeller.level_speed_rev_s[-1])
    for index, leg in enumerate(legs):
        if leg.rpm > fastest:
            yield CampaignError(
                "the vehicle cannot run at this speed",
                file=file,
                field=f"legs[{index}].rpm",
                value=leg.rpm,
                allowed=f"at most {fastest:g} rpm, where the table of level speeds ends",
            )
