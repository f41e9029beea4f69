"""Plans of bench experiments (key `bench` of schema `plan`).

Tank runs, free decays, quadrifilar swings; refused where they cannot be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError, PipelineError, nearest, raise_faults
from auvid.hydro.arrays import Array, read_only
from auvid.hydro.dynamics.simplified import (
    DERIVATIVES,
    INERTIAS,
    LINEAR,
    QUADRATIC,
    SimplifiedModel,
    simplified_of,
)
from auvid.hydro.dynamics.simulation.sensor_models import AhrsNoise
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.simulate.plans import CSV_PARTS, ID, ahrs_noise, log_entry, margin_s

CHANNELS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Channels in the order of the axes."""
DRIVEN = {"pitch": frozenset({"surge", "heave"})}
"""Which channels are commanded to excite one; those that are not named here by
themselves.
"""
POLE = ("pole_added_mass", "pole_linear", "pole_quadratic")
BODY = ("mass", *INERTIAS, *DERIVATIVES, *LINEAR, *QUADRATIC)
KINDS = ("tank", "decays", "swings")
TANK_PARTS = (*CSV_PARTS[:3], "outputs")
OUTPUTS = 8
"""Outputs that a twin's log holds."""


@dataclass(frozen=True)
class Experiment:
    """One run: `entry` as in the plan.

    Times of its log count from `margin_s` before its start.
    """

    kind: str
    entry: Mapping[str, Any]
    margin_s: float

    @property
    def id(self) -> str:
        return str(self.entry["id"])

    @property
    def end_s(self) -> float:
        """End of leg and log, from the start of the leg."""
        return float(self.entry["duration_s"])

    @property
    def noise(self) -> float:
        """Factor on the noise of its sensors."""
        return float(self.entry.get("noise", 1.0))


@dataclass(frozen=True)
class BenchPlan:
    """A checked plan: runs, truths by name, and sensors.

    Those of the tank and of the Pixhawk on the pendulums.
    """

    title: str
    experiments: tuple[Experiment, ...]
    truths: Mapping[str, Mapping[str, float]]
    keep_z_G: bool
    depth_m: float
    rates_hz: Mapping[str, float]
    ahrs: AhrsNoise
    velocity_sd_m_s: float
    depth_sd_m: float
    pixhawk: AhrsNoise
    pixhawk_hz: float
    pixhawk_arm_m: float
    pixhawk_mounting_rad: Array

    def with_noise(self, factor: float) -> BenchPlan:
        """The same plan with all noise times a factor."""
        return replace(
            self,
            ahrs=_scaled(self.ahrs, factor),
            pixhawk=_scaled(self.pixhawk, factor),
            velocity_sd_m_s=factor * self.velocity_sd_m_s,
            depth_sd_m=factor * self.depth_sd_m,
        )

    def model(self, truth: str, vehicle: Vehicle) -> SimplifiedModel:
        """Return the simplified model of a truth.

        The vehicle with the numbers that the truth replaces.
        """
        return model_of(self.truths[truth], vehicle, keep_z_G=self.keep_z_G)


def _scaled(noise: AhrsNoise, factor: float) -> AhrsNoise:
    return replace(
        noise,
        attitude_rad=factor * noise.attitude_rad,
        gyro_rad_s=factor * noise.gyro_rad_s,
        gyro_bias_rad_s=factor * noise.gyro_bias_rad_s,
        accel_m_s2=factor * noise.accel_m_s2,
        accel_bias_m_s2=factor * noise.accel_bias_m_s2,
    )


def bench_plan(document: Mapping[str, Any], vehicle: Vehicle, *, file: object = None) -> BenchPlan:
    """Return the plan of a document of schema `plan` with key `bench`.

    Raises `CampaignError`, all faults together.
    """
    raise_faults(list(_faults(document, vehicle, file)), file=file)
    bench, margin = document["bench"], margin_s(document)
    sensors = document.get("sensors") or {}
    a, dvl, depth = (sensors.get(key) or {} for key in ("ahrs", "dvl", "depth"))
    pixhawk = bench.get("pixhawk") or {}
    rates = {
        "imu": (a, 50.0),
        "velocity": (dvl, 4.0),
        "depth": (depth, 10.0),
        "actuators": (sensors.get("actuators") or {}, 50.0),
    }
    return BenchPlan(
        title=str(document["title"]),
        experiments=tuple(
            Experiment(kind, entry, margin) for kind in KINDS for entry in bench.get(kind) or ()
        ),
        truths=bench["truths"],
        keep_z_G=bool(bench.get("keep_z_G", False)),
        depth_m=float(document.get("depth_m", 5.0)),
        rates_hz={
            stream: float(entry.get("rate_hz", default))
            for stream, (entry, default) in rates.items()
        },
        ahrs=ahrs_noise(a),
        velocity_sd_m_s=float(dvl.get("sd_m_s", 0.0)),
        depth_sd_m=float(depth.get("sd_m", 0.0)),
        pixhawk=ahrs_noise(pixhawk),
        pixhawk_hz=float(pixhawk.get("rate_hz", 50.0)),
        pixhawk_arm_m=float(pixhawk.get("arm_m", 1.0)),
        pixhawk_mounting_rad=np.radians(
            np.array(pixhawk.get("mounting_deg", (0.0, 0.0, 0.0)), dtype=np.float64)
        ),
    )


def bench_entries(
    document: Mapping[str, Any], *, format: str
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the logs and legs of a manifest for a bench plan.

    One log per run, whose leg names its role or channel.
    """
    logs, legs = [], []
    margin = margin_s(document)
    for kind in KINDS:
        for entry in document["bench"].get(kind) or ():
            logs.append(
                log_entry(entry["id"], format, TANK_PARTS if kind == "tank" else CSV_PARTS[:1])
            )
            keys = (
                _driven(entry, document)
                if kind == "tank"
                else {"role": {"decays": "free_decay", "swings": "quadrifilar"}[kind]}
            )
            end = margin + float(entry["duration_s"])
            legs.append(
                {
                    "id": entry["id"],
                    "log": entry["id"],
                    "start_s": margin,
                    "end_s": end,
                    "use": entry.get("use", "training"),
                    **keys,
                }
            )
    return logs, legs


def _driven(entry: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of the leg of a tank run.

    Its channel, and the mass or moment of inertia of its truth where that has one of
    its own.
    """
    truth = document["bench"]["truths"][entry["truth"]]
    axis = CHANNELS.index(entry["channel"])
    key, name = ("mass_kg", "mass") if axis < 3 else ("inertia_kg_m2", INERTIAS[axis - 3])
    return {"channel": entry["channel"], **({key: float(truth[name])} if name in truth else {})}


def model_of(
    truth: Mapping[str, float], vehicle: Vehicle, *, keep_z_G: bool = False
) -> SimplifiedModel:
    """Return the simplified model of a vehicle with numbers of a truth.

    They replace its own; the weight follows the mass.
    """
    model = simplified_of(
        vehicle,
        linear=[truth.get(name, 0.0) for name in LINEAR],
        quadratic=_of(truth, QUADRATIC, np.zeros(6)),
    )
    mass = float(truth.get("mass", model.mass))
    return replace(
        model,
        mass=mass,
        inertia=_of(truth, INERTIAS, model.inertia),
        added_mass=_of(truth, DERIVATIVES, model.added_mass),
        buoyancy=mass * vehicle.gravity,
        keep_z_G=keep_z_G,
    )


def _of(truth: Mapping[str, float], names: tuple[str, ...], default: Array) -> Array:
    return read_only([truth.get(name, value) for name, value in zip(names, default, strict=True)])


def output_of(channel: str, vehicle: Vehicle) -> int | None:
    """Return the index of the thruster that drives one channel and nothing else.

    None without one.
    """
    if vehicle.thrusters is None:
        return None
    axis = CHANNELS.index(channel)
    for index, effect in enumerate(vehicle.thrusters.allocation.T):
        if effect[axis] > 0.0 and np.count_nonzero(effect) == 1:
            return index
    return None


def _faults(document: Mapping[str, Any], vehicle: Vehicle, file: object) -> Iterator[PipelineError]:
    def fault(message: str, field: str, value: object, **more: Any) -> CampaignError:
        return CampaignError(message, file=file, field=field, value=value, **more)

    bench = document["bench"]
    entries = [
        (f"bench.{kind}[{index}]", kind, entry)
        for kind in KINDS
        for index, entry in enumerate(bench.get(kind) or ())
    ]
    if "legs" in document:
        yield fault("a plan has either legs or bench", "legs", len(document["legs"]))
    if not entries:
        yield fault("the plan has no experiment", "bench", list(bench), allowed=KINDS)
    mounting = (bench.get("pixhawk") or {}).get("mounting_deg")
    if mounting is not None and len(mounting) != 3:
        yield fault("three numbers are needed", "bench.pixhawk.mounting_deg", mounting)
    ids: set[str] = set()
    for at, kind, entry in entries:
        if not ID.fullmatch(entry["id"]) or entry["id"].lower() in ids:
            yield fault(
                "not a name of its own",
                f"{at}.id",
                entry["id"],
                allowed="letters, digits, _ and -, each name once",
            )
        ids.add(entry["id"].lower())
        if kind != "swings" and entry["truth"] not in bench["truths"]:
            names = list(bench["truths"])
            yield fault(
                "no such truth",
                f"{at}.truth",
                entry["truth"],
                allowed=names,
                remedy=nearest(entry["truth"], names),
            )
        if kind == "tank":
            yield from _command_faults(at, entry, vehicle, fault)
    for name, truth in bench["truths"].items():
        yield from _truth_faults(f"bench.truths.{name}", truth, vehicle, fault)


def _truth_faults(
    at: str, truth: Mapping[str, float], vehicle: Vehicle, fault: Callable[..., CampaignError]
) -> Iterator[PipelineError]:
    names = (*BODY, *POLE)
    unknown = [key for key in truth if key not in names]
    for key in unknown:
        yield fault(
            "no number of the simplified model",
            f"{at}.{key}",
            truth[key],
            remedy=nearest(key, names),
        )
    positive = [
        key
        for key, value in truth.items()
        if key in (*DERIVATIVES, *LINEAR, *QUADRATIC, *POLE) and value > 0.0
    ]
    for key in positive:
        yield fault(
            "a derivative of added mass or damping is positive",
            f"{at}.{key}",
            truth[key],
            allowed="at most 0",
        )
    if unknown or positive:
        return
    try:
        model = model_of(truth, vehicle)
    except CampaignError as refused:
        yield refused
        return
    if np.linalg.eigvalsh(model.mass_matrix)[0] <= 0.0:
        yield fault("the mass matrix is not positive definite", at, dict(truth))


def _command_faults(
    at: str, entry: Mapping[str, Any], vehicle: Vehicle, fault: Callable[..., CampaignError]
) -> Iterator[PipelineError]:
    driven = DRIVEN.get(entry["channel"], frozenset({entry["channel"]}))
    if set(entry["commands"]) != driven:
        yield fault(
            "the channel is not driven by these commands",
            f"{at}.commands",
            sorted(entry["commands"]),
            allowed=sorted(driven),
        )
        return
    for channel, steps in entry["commands"].items():
        times, values, where = steps["times_s"], steps["values_percent"], f"{at}.commands.{channel}"
        output = output_of(channel, vehicle)
        if output is None:
            yield fault(
                "the vehicle has no thruster that drives this channel alone", where, vehicle.name
            )
        elif vehicle.thrusters is not None and vehicle.thrusters.outputs[output] > OUTPUTS:
            yield fault(
                f"the twin logs {OUTPUTS} outputs", where, vehicle.thrusters.outputs[output]
            )
        if len(times) != len(values) or not times:
            yield fault(
                "as many times as values are needed",
                f"{where}.times_s",
                len(times),
                allowed=len(values),
            )
        elif np.any(np.diff(times) <= 0.0) or times[-1] >= entry["duration_s"]:
            yield fault("the times do not increase within the leg", f"{where}.times_s", times)
