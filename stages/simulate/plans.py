"""Plans of a twin, and the set points of its autopilot at each tick.

Refused where they ask for the impossible.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError, PipelineError, raise_faults
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.simulation.sensor_models import AhrsNoise
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle

ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*")
SHORTEST_LEG_S = 1.0
LONGEST_LEG_S = 7200.0
"""The flight of a leg is held in memory, at the rate of the integration."""


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


def plan_from_document(
    document: Mapping[str, Any], vehicle: Vehicle, *, file: object = None
) -> Plan:
    """The plan of a document that agrees with schema `plan`.

    Raises `CampaignError`, all faults together: legs without length or with equal
    names, propeller speeds that the vehicle's table of level speeds does not reach,
    depths above the surface, steps that are not in order, and a vehicle without
    propeller or fins.
    """
    faults = list(_faults(document, vehicle, file))
    raise_faults(faults, file=file)
    sensors = {
        key: document.get("sensors", {}).get(key, {})
        for key in ("ahrs", "dvl", "depth", "actuators")
    }
    a, dvl = sensors["ahrs"], sensors["dvl"]
    rate = float(document.get("control_hz", 50.0))
    return Plan(
        title=str(document["title"]),
        depth_m=_depth(document),
        settle_s=float(document.get("settle_s", 40.0)),
        margin_s=margin_s(document),
        tick_s=1.0 / rate,
        steps_per_tick=int(np.ceil(1.0 / (rate * float(document.get("step_s", 0.01))) - 1e-9)),
        viscous_lag_s=float(document.get("viscous_lag_s", 0.0)),
        unsteady=_unsteady(document.get("unsteady")),
        fin_limit_rad=float(np.radians(document.get("fins", {}).get("limit_deg", 25.0))),
        fin_rate_rad_s=float(np.radians(document.get("fins", {}).get("rate_deg_s", 60.0))),
        rates_hz={
            "imu": float(a.get("rate_hz", 50.0)),
            "velocity": float(dvl.get("rate_hz", 4.0)),
            "depth": float(sensors["depth"].get("rate_hz", 10.0)),
            "actuators": float(sensors["actuators"].get("rate_hz", 50.0)),
        },
        ahrs=ahrs_noise(a),
        dvl_sd_m_s=float(dvl.get("sd_m_s", 0.0)),
        dvl_arm_error_m=np.array(dvl.get("arm_error_m", (0.0, 0.0, 0.0)), dtype=np.float64),
        dvl_mounting_error_rad=np.radians(
            np.array(dvl.get("mounting_error_deg", (0.0, 0.0, 0.0)), dtype=np.float64)
        ),
        depth_sd_m=float(sensors["depth"].get("sd_m", 0.0)),
        legs=tuple(_leg(entry, document) for entry in document["legs"]),
    )


def ahrs_noise(entry: Mapping[str, Any]) -> AhrsNoise:
    """Noise of an AHRS in SI from its entry in a plan; what is not given is 0."""
    return AhrsNoise(
        attitude_rad=float(np.radians(entry.get("attitude_sd_deg", 0.0))),
        attitude_correlation_s=float(entry.get("attitude_correlation_s", 5.0)),
        gyro_rad_s=float(entry.get("gyro_sd_rad_s", 0.0)),
        gyro_bias_rad_s=float(entry.get("gyro_bias_sd_rad_s", 0.0)),
        accel_m_s2=float(entry.get("accel_sd_m_s2", 0.0)),
        accel_bias_m_s2=float(entry.get("accel_bias_sd_m_s2", 0.0)),
    )


def manifest_entries(
    document: Mapping[str, Any], *, format: str
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The logs and legs of a manifest for the twin's log files: one log per leg."""
    margin = margin_s(document)
    ends = [(entry, margin + float(entry["duration_s"])) for entry in document["legs"]]
    logs = [log_entry(entry["id"], format, CSV_PARTS) for entry, _ in ends]
    legs = [
        {
            "id": entry["id"],
            "log": entry["id"],
            "start_s": margin,
            "end_s": end,
            "use": entry["use"],
        }
        for entry, end in ends
    ]
    return logs, legs


CSV_PARTS = ("ahrs", "dvl", "depth", "actuators")


def log_entry(name: str, format: str, csv_parts: tuple[str, ...]) -> dict[str, Any]:
    """The entry of one log in a manifest; a CSV log is one file per part."""
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


def _depth(document: Mapping[str, Any]) -> float:
    return float(document.get("depth_m", 5.0))


def margin_s(document: Mapping[str, Any]) -> float:
    """What a log holds before and after its leg."""
    return float(document.get("margin_s", 2.0))


def _steps(document: Mapping[str, Any], kind: str) -> tuple[Array, Array]:
    """Times [s] and scaled values [rad or m] of `yaw_steps` or `depth_steps`."""
    entry = document.get(kind) or {}
    key, scale = ("values_deg", "yaw_scale") if kind == "yaw_steps" else ("values_m", "depth_scale")
    values = np.array(entry.get(key, ()), dtype=np.float64) * float(document.get(scale, 1.0))
    return np.array(entry.get("times_s", ()), dtype=np.float64), (
        np.radians(values) if kind == "yaw_steps" else values
    )


def _leg(entry: Mapping[str, Any], document: Mapping[str, Any]) -> Leg:
    none = (np.zeros(0), np.zeros(0))
    steps = {
        kind: _steps(document, kind) if entry["manoeuvre"] == kind else none
        for kind in ("yaw_steps", "depth_steps")
    }
    return Leg(
        str(entry["id"]),
        float(entry["rpm"]),
        entry["manoeuvre"],
        float(entry["duration_s"]),
        entry["use"],
        **steps,
    )


def _unsteady(entry: Mapping[str, Any] | None) -> Unsteady | None:
    if entry is None:
        return None
    return Unsteady(
        np.array([*entry["force_sd_N"], *entry["moment_sd_N_m"]], dtype=np.float64),
        float(entry["correlation_s"]),
    )


def _faults(document: Mapping[str, Any], vehicle: Vehicle, file: object) -> Iterator[PipelineError]:
    def fault(message: str, field: str, value: object, **more: Any) -> CampaignError:
        return CampaignError(message, file=file, field=field, value=value, **more)

    if vehicle.propeller is None or vehicle.fins is None:
        yield fault("the twin needs a vehicle with a propeller and fins", "vehicle", vehicle.name)
        return
    if not document.get("legs"):
        yield fault(
            "the plan has no legs",
            "legs",
            [],
            remedy="List the legs; a plan with bench is flown by a campaign of kind bench_twin.",
        )
        return
    endless = list(_not_finite(document, ""))
    yield from (fault("not a finite number", at, value) for at, value in endless)
    if endless:
        return
    if margin_s(document) > float(document.get("settle_s", 40.0)):
        yield fault(
            "the log would begin before the vehicle does",
            "margin_s",
            margin_s(document),
            allowed="at most settle_s",
        )
    yield from _list_faults(document, fault)
    fastest = 60.0 * float(vehicle.propeller.level_speed_rev_s[-1])
    ids: set[str] = set()
    for index, leg in enumerate(document["legs"]):
        at = f"legs[{index}]"
        if not ID.fullmatch(str(leg["id"])) or str(leg["id"]).lower() in ids:
            yield fault(
                "not a name of its own",
                f"{at}.id",
                leg["id"],
                allowed="letters, digits, _ and -, each name once",
            )
        ids.add(str(leg["id"]).lower())
        if leg["duration_s"] > LONGEST_LEG_S:
            longest = f"at most {LONGEST_LEG_S:g} s"
            yield fault(
                "the leg is too long to be flown in one",
                f"{at}.duration_s",
                leg["duration_s"],
                allowed=longest,
            )
        if not leg["duration_s"] >= SHORTEST_LEG_S:
            yield fault(
                "the leg has no length",
                f"{at}.duration_s",
                leg["duration_s"],
                allowed=f"at least {SHORTEST_LEG_S:g} s",
            )
        if not 0.0 < leg["rpm"] <= fastest:
            speed = f"more than 0, at most {fastest:g} rpm, where the table of level speeds ends"
            yield fault(
                "the vehicle cannot run at this speed", f"{at}.rpm", leg["rpm"], allowed=speed
            )
        if leg["manoeuvre"] != "straight" and not document.get(leg["manoeuvre"]):
            yield fault(
                "the plan does not say what these steps are",
                f"{at}.manoeuvre",
                leg["manoeuvre"],
                remedy=f"Add {leg['manoeuvre']}.",
            )
    shallowest = _depth(document) + min([0.0, *_steps(document, "depth_steps")[1]])
    if any(leg["manoeuvre"] == "depth_steps" for leg in document["legs"]) and shallowest <= 0.0:
        yield fault(
            "a depth step goes above the surface",
            "depth_steps.values_m",
            f"{shallowest:g} m",
            allowed="depths below 0 m",
        )
    if _depth(document) <= 0.0:
        yield fault(
            "the vehicle would run at the surface",
            "depth_m",
            _depth(document),
            allowed="more than 0 m",
        )


def _not_finite(value: object, at: str) -> Iterator[tuple[str, float]]:
    """Every number of a document that is infinite or none, with its place."""
    if isinstance(value, float) and not np.isfinite(value):
        yield at, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _not_finite(item, f"{at}.{key}".lstrip("."))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _not_finite(item, f"{at}[{index}]")


def _list_faults(document: Mapping[str, Any], fault: Any) -> Iterator[PipelineError]:
    for kind, key in (("yaw_steps", "values_deg"), ("depth_steps", "values_m")):
        entry = document.get(kind)
        if not entry:
            continue
        if len(entry["times_s"]) != len(entry[key]):
            yield fault(
                "as many times as values are needed",
                f"{kind}.times_s",
                len(entry["times_s"]),
                allowed=len(entry[key]),
            )
        elif np.any(np.diff(entry["times_s"]) <= 0.0):
            yield fault("the times do not increase", f"{kind}.times_s", entry["times_s"])
    three = [("unsteady", "force_sd_N"), ("unsteady", "moment_sd_N_m")]
    dvl = (document.get("sensors") or {}).get("dvl") or {}
    numbers = [(f"{part}.{key}", (document.get(part) or {}).get(key)) for part, key in three]
    numbers += [
        (f"sensors.dvl.{key}", dvl.get(key)) for key in ("arm_error_m", "mounting_error_deg")
    ]
    for field, value in numbers:
        if value is not None and len(value) != 3:
            yield fault("three numbers are needed", field, value)
