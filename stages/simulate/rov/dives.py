"""Dive the legs of a plan with the twin of an ROV: logs, truth tables, document."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.simulation.rov.dive import FORCES, Dive, fly_dive
from auvid.hydro.dynamics.simulation.rov.sensors import START_US, record_dive
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.columns import ACCELERATION, POSE, VELOCITY, force_columns, named
from auvid.stages.simulate.rov.dive_plans import dive_plan
from auvid.stages.simulate.rov.truths import truth_of_twin
from auvid.stages.simulate.sensing import Recorded

FORCE_NAMES = {"hull": "viscous"}
"""Parts of tau_bar that the truth table calls otherwise."""


@dataclass(frozen=True)
class DivesResult:
    """What was dived: by leg the dive, and of those reached the recording and truth."""

    plan: DivePlanDocument
    dives: Mapping[str, Dive]
    recorded: Mapping[str, Recorded]
    truth: Mapping[str, pa.Table]
    document: dict[str, Any]
    notes: list[str]


def fly_plan(vehicle: Vehicle, twin: TwinDocument) -> DivesResult:
    """Return all legs of a plan of dives, flown and recorded.

    Raises `CampaignError` for a plan that the vehicle cannot dive, and `DataError`
    where no leg was reached at all.
    """
    plan, seed = dive_plan(twin.plan, vehicle, file="the plan"), twin.seed
    truth, notes = truth_of_twin(twin.truth, plan, vehicle)
    dives = {leg.id: fly_dive(truth, plan, leg, seed=seed) for leg in plan.legs}
    reached = {name: dive for name, dive in dives.items() if dive.reached}
    if not reached:
        reasons = "; ".join(f"{name}: {dive.stop}" for name, dive in dives.items())
        raise DataError(
            f"the twin reached no leg: {reasons}",
            remedy="Choose another truth, or a plan with less motion.",
        )
    words = f"auvid twin of {vehicle.name}: {twin.truth.name}, seed {seed}"
    recorded = {name: recorded_dive(dive, plan, seed, words) for name, dive in reached.items()}
    document: dict[str, Any] = {
        "plan": plan.title,
        "truth": f"{twin.truth.name} ({twin.truth.source})",
        "seed": seed,
        "format": twin.format,
        "legs": [_leg(name, dive, recorded.get(name)) for name, dive in dives.items()],
    }
    if isinstance(truth.hull, IdentifiedModel):
        document["coefficients"] = {
            axis: dict(terms) for axis, terms in truth.hull.coefficients.items()
        }
    tables = {name: dive_truth(dive) for name, dive in reached.items()}
    return DivesResult(plan, dives, recorded, tables, document, notes)


def recorded_dive(dive: Dive, plan: DivePlanDocument, seed: int, text: str) -> Recorded:
    """Return the streams of a dive's log, with the parameters that a log would have."""
    thrusters, record = dive.truth.thrusters, record_dive(dive, plan, seed=seed)
    parameters = {"FRAME_CONFIG": 2.0}  # vectored, six degrees of freedom
    for number, (output, direction) in enumerate(
        zip(thrusters.outputs, thrusters.direction, strict=True), start=1
    ):
        parameters[f"MOT_{number}_DIRECTION"] = float(direction)
        parameters[f"SERVO{output}_FUNCTION"] = 32.0 + number
    return Recorded(dive.leg.id, record.streams, record.biases, text, parameters)


def _leg(name: str, dive: Dive, recorded: Recorded | None) -> dict[str, Any]:
    return {
        "id": name,
        "modes": [item.mode for item in dive.leg.modes],
        "start_s": dive.start_s,
        "end_s": dive.end_s if dive.reached else None,
        "stopped": dive.stop,
        "biases": {}
        if recorded is None
        else {key: value.tolist() for key, value in recorded.biases.items()},
    }


def dive_truth(dive: Dive) -> pa.Table:
    """Return a table of schema `truth`: the true motion at the ticks of the autopilot.

    Velocity is that over ground; where a current flows, the velocity through the water
    stands beside it, which the forces see.
    """
    first = round(dive.offset_s / dive.tick_s)
    ticks = np.arange(first, len(dive.pulses_us))
    t_s = np.asarray(ticks * dive.tick_s - dive.offset_s, dtype=np.float64)
    motion = dive.motion(t_s)
    columns = {
        "time_us": START_US + np.rint(t_s * 1e6).astype(np.int64),
        "t_s": t_s,
        **named(POSE, motion.eta),
        **named(VELOCITY, motion.ground),
        **named(ACCELERATION, motion.ground_dot),
    }
    if np.any(dive.truth.current_m_s):
        columns |= named([f"{axis}_water_m_s" for axis in "uvw"], motion.nu)
    columns["voltage_v"] = dive.supply[ticks, 0]
    for index, output in enumerate(dive.truth.thrusters.outputs):
        columns[f"pwm_{output}_us"] = dive.pulses_us[ticks, index].astype(np.float64)
        columns[f"thruster_{index + 1}_N"] = np.ascontiguousarray(motion.bollard[:, index])
    for name in FORCES:
        columns |= named(force_columns(FORCE_NAMES.get(name, name)), motion.forces[name])
    columns |= named(force_columns("tau_bar"), motion.tau_bar)
    return make_table("truth", columns)
