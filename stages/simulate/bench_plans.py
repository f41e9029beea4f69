"""Plans of bench experiments (key `bench` of schema `plan`).

Tank runs, free decays, quadrifilar swings; refused where they cannot be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.plans.plan import (
    BenchEntry,
    DecayFlightEntry,
    PlanDocument,
    SwingFlightEntry,
    TankRunEntry,
)
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
from auvid.stages.simulate.plans import (
    CSV_PARTS,
    Entries,
    ahrs_noise,
    leg_entry,
    log_entry,
    stream_rates,
)

CHANNELS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Channels in the order of the axes."""
POLE = ("pole_added_mass", "pole_linear", "pole_quadratic")
BODY = ("mass", *INERTIAS, *DERIVATIVES, *LINEAR, *QUADRATIC)
TANK_PARTS = (*CSV_PARTS[:3], "outputs")
OUTPUTS = 8
"""Outputs that a twin's log holds."""


@dataclass(frozen=True)
class Experiment:
    """One run: `entry` as in the plan.

    Times of its log count from `margin_s` before its start.
    """

    entry: TankRunEntry | DecayFlightEntry | SwingFlightEntry
    margin_s: float

    @property
    def kind(self) -> str:
        """Key of the plan that it stands under."""
        if isinstance(self.entry, TankRunEntry):
            return "tank"
        return "decays" if isinstance(self.entry, DecayFlightEntry) else "swings"

    @property
    def id(self) -> str:
        return self.entry.id

    @property
    def end_s(self) -> float:
        """End of leg and log, from the start of the leg."""
        return self.entry.duration_s


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
        """Return the same plan with all noise times a factor."""
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


def bench_plan(document: object, vehicle: Vehicle, *, file: object = None) -> BenchPlan:
    """Return the plan of a document of schema `plan` with key `bench`.

    Raises `CampaignError`, all faults together.
    """
    plan = parse(PlanDocument, document, file=file)
    bench, sensors = bench_of(plan), plan.sensors
    raise_faults(list(_faults(bench, vehicle, file)), file=file)
    return BenchPlan(
        title=plan.title,
        experiments=tuple(Experiment(entry, plan.margin_s) for entry in bench.experiments),
        truths=bench.truths,
        keep_z_G=bench.keep_z_G,
        depth_m=plan.depth_m,
        rates_hz=stream_rates(sensors),
        ahrs=ahrs_noise(sensors.ahrs),
        velocity_sd_m_s=sensors.dvl.sd_m_s,
        depth_sd_m=sensors.depth.sd_m,
        pixhawk=ahrs_noise(bench.pixhawk),
        pixhawk_hz=bench.pixhawk.rate_hz,
        pixhawk_arm_m=bench.pixhawk.arm_m,
        pixhawk_mounting_rad=np.radians(np.array(bench.pixhawk.mounting_deg)),
    )


def bench_of(plan: PlanDocument) -> BenchEntry:
    """Return the experiments of a bench plan."""
    assert plan.bench is not None
    return plan.bench


def bench_entries(document: object, *, format: str) -> Entries:
    """Return the logs and legs of a manifest for a bench plan.

    One log per run, whose leg names its role or channel.
    """
    plan = parse(PlanDocument, document)
    bench = bench_of(plan)
    logs, legs = [], []
    for entry in bench.experiments:
        tank = isinstance(entry, TankRunEntry)
        logs.append(log_entry(entry.id, format, TANK_PARTS if tank else CSV_PARTS[:1]))
        leg = leg_entry(entry.id, plan.margin_s, entry.duration_s, entry.use)
        legs.append({**leg, **_role(entry, bench.truths)})
    return logs, legs


def _role(
    entry: TankRunEntry | DecayFlightEntry | SwingFlightEntry,
    truths: Mapping[str, Mapping[str, float]],
) -> dict[str, Any]:
    """Return the keys of a leg by its run.

    Of a tank run its channel, and the mass or moment of inertia of its truth where that
    has one of its own.
    """
    if isinstance(entry, DecayFlightEntry):
        return {"role": "free_decay"}
    if isinstance(entry, SwingFlightEntry):
        return {"role": "quadrifilar"}
    truth, axis = truths[entry.truth], CHANNELS.index(entry.channel)
    key, name = ("mass_kg", "mass") if axis < 3 else ("inertia_kg_m2", INERTIAS[axis - 3])
    return {"channel": entry.channel, **({key: truth[name]} if name in truth else {})}


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


def _faults(bench: BenchEntry, vehicle: Vehicle, file: object) -> Iterator[PipelineError]:
    def fault(message: str, field: str, value: object, **more: Any) -> CampaignError:
        return CampaignError(message, file=file, field=field, value=value, **more)

    for index, run in enumerate(bench.tank):
        for channel in run.commands:
            at, output = f"bench.tank[{index}].commands.{channel}", output_of(channel, vehicle)
            if output is None or vehicle.thrusters is None:
                words = "the vehicle has no thruster that drives this channel alone"
                yield fault(words, at, vehicle.name)
            elif vehicle.thrusters.outputs[output] > OUTPUTS:
                words = f"the twin logs {OUTPUTS} outputs"
                yield fault(words, at, vehicle.thrusters.outputs[output])
    for name, truth in bench.truths.items():
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
