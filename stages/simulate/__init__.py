"""Fly a plan with a twin and write real log files, with the truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.apparatus import ApparatusDocument
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.documents.plans.glide_plan import GlidePlanDocument
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import column
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.vehicle.glider_body import glider_body
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.base import Document, Stage, port
from auvid.stages.presentation import panel, plot, remark, section, series, table, text
from auvid.stages.simulate.bench import fly_experiment, record_experiment
from auvid.stages.simulate.bench_plans import bench_plan
from auvid.stages.simulate.bench_report import bench_document, bench_section
from auvid.stages.simulate.csv_writer import write_csv
from auvid.stages.simulate.dataflash_writer import write_dataflash
from auvid.stages.simulate.flights import FlownLeg, fly_leg, truth_force
from auvid.stages.simulate.glides import fly_glides
from auvid.stages.simulate.plans import log_name, plan_from_document
from auvid.stages.simulate.rov.dive_report import dive_section, dive_views, true_views
from auvid.stages.simulate.rov.dives import fly_plan
from auvid.stages.simulate.sensing import Recorded, record, truth_table
from auvid.stages.simulate.tlog_writer import write_tlog


@dataclass(frozen=True)
class Inputs:
    """The vehicle, the twin of the manifest, and the pendulums of a bench campaign.

    The twin is plan, truth, seed and format.
    """

    vehicle: Vehicle = port("vehicle")
    twin: TwinDocument = port("twin")
    apparatus: ApparatusDocument | None = port("apparatus", optional=True)


@dataclass(frozen=True)
class Params:
    """None: what a twin flies stands in its plan."""


@dataclass(frozen=True)
class Outputs:
    """Log files by name, the truth by leg, what was flown, and how it looked."""

    logs: Mapping[str, bytes] = port("simulated_log", many=True)
    truth: Mapping[str, pa.Table] = port("truth", many=True)
    simulation: dict[str, Any] = port("simulation")
    section: dict[str, Any] = port("section")
    views: dict[str, Any] = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return all legs of a plan, or all experiments of a bench plan.

    A truth that becomes unstable ends its leg with time, state and reason; what was
    flown before is kept. Raises `CampaignError` for a plan that asks for the
    impossible, and `DataError` where no leg was reached at all.
    """
    vehicle, twin = inputs.vehicle, inputs.twin
    if isinstance(twin.plan, DivePlanDocument):
        return _dives(vehicle, twin)
    if isinstance(twin.plan, GlidePlanDocument):
        glides = fly_glides(vehicle, twin, glider_body(vehicle))
        return Outputs(glides.logs, {}, glides.document, glides.section, _views(()))
    if twin.plan.bench is not None:
        return _bench(vehicle, twin, inputs.apparatus)
    plan = plan_from_document(twin.plan, vehicle, file="the plan")
    simulated, notes = truth_force(twin.truth, plan, vehicle)
    seed, words = twin.seed, f"auvid twin of {vehicle.name}: {twin.truth.name}, seed {twin.seed}"
    flown = {leg.id: fly_leg(plan, leg, simulated, seed=seed) for leg in plan.legs}
    reached = {name: leg for name, leg in flown.items() if leg.reached}
    if not reached:
        reasons = "; ".join(f"{name}: {leg.flight.stop}" for name, leg in flown.items())
        raise DataError(
            f"the twin reached no leg: {reasons}",
            remedy="Choose another truth, or a plan with less motion.",
        )
    recorded = {name: record(leg, plan, seed=seed, text=words) for name, leg in reached.items()}
    logs = _logs(recorded.values(), vehicle, twin)
    tables = {name: truth_table(leg, plan) for name, leg in reached.items()}
    document = _document(twin, flown, recorded, vehicle)
    if isinstance(simulated.truth, IdentifiedModel):
        document["coefficients"] = {
            axis: dict(terms) for axis, terms in simulated.truth.coefficients.items()
        }
    return Outputs(logs, tables, document, _section(document, flown, tables, notes), _views(tables))


def _dives(vehicle: Vehicle, twin: TwinDocument) -> Outputs:
    result = fly_plan(vehicle, twin)
    logs = _logs(result.recorded.values(), vehicle, twin)
    return Outputs(
        logs, result.truth, result.document, dive_section(result), dive_views(result.truth)
    )


def _bench(vehicle: Vehicle, twin: TwinDocument, apparatus: ApparatusDocument | None) -> Outputs:
    plan, seed = bench_plan(twin.plan, vehicle, file="the plan"), twin.seed
    words = f"auvid bench twin of {vehicle.name}, seed {seed}"
    flown = {item.id: fly_experiment(item, plan, vehicle, apparatus) for item in plan.experiments}
    recorded = {
        name: record_experiment(item, plan, vehicle, seed=seed, text=words)
        for name, item in flown.items()
    }
    logs = _logs(recorded.values(), vehicle, twin)
    document = bench_document(
        plan.title, "numbers of the plan, by run", seed, twin.format, flown, recorded
    )
    return Outputs(logs, {}, document, bench_section(document, flown), _views(()))


def _logs(recorded: Iterable[Recorded], vehicle: Vehicle, twin: TwinDocument) -> dict[str, bytes]:
    """Return the files of all logs by name."""
    logs: dict[str, bytes] = {}
    for item in recorded:
        logs |= log_files(item, vehicle, format=twin.format, accelerometer=twin.accelerometer)
    return logs


def log_files(
    recorded: Recorded, vehicle: Vehicle, *, format: str, accelerometer: str
) -> dict[str, bytes]:
    """Return the files of one log by name, in one of the formats bin, tlog, csv."""
    if format == "csv":
        return write_csv(recorded, vehicle, accelerometer=accelerometer)
    writer = {"bin": write_dataflash, "tlog": write_tlog}[format]
    return {log_name(recorded.leg, format): writer(recorded)}


def _document(
    twin: TwinDocument,
    flown: Mapping[str, FlownLeg],
    recorded: Mapping[str, Recorded],
    vehicle: Vehicle,
) -> dict[str, Any]:
    assert vehicle.propeller is not None
    legs = [
        {
            "id": name,
            "rpm": leg.leg.rpm,
            "level_speed_m_s": float(level_speed(vehicle.propeller, leg.leg.rev_s)),
            "start_s": leg.start_s,
            "end_s": leg.end_s if leg.reached else None,
            "stopped": None if leg.flight.stop is None else str(leg.flight.stop),
            "biases": (
                {key: value.tolist() for key, value in recorded[name].biases.items()}
                if name in recorded
                else {}
            ),
        }
        for name, leg in flown.items()
    ]
    return {
        "plan": twin.plan.title,
        "truth": f"{twin.truth.name} ({twin.truth.source})",
        "seed": twin.seed,
        "format": twin.format,
        "legs": legs,
    }


def _section(
    document: Document,
    flown: Mapping[str, FlownLeg],
    tables: Mapping[str, pa.Table],
    notes: list[str],
) -> dict[str, Any]:
    blocks = [
        text(
            f"Plan: {document['plan']}. Truth: {document['truth']}. Seed {document['seed']}, logs"
            f" as {document['format']}."
        )
    ]
    blocks += [remark(words, "note") for words in notes]
    blocks += [
        remark(f"Leg '{leg['id']}': {leg['stopped']}", "warning")
        for leg in document["legs"]
        if leg["stopped"]
    ]
    rows = []
    for name, truth in tables.items():
        inside = truth.slice(*_rows_of(truth, flown[name]))
        spread = {
            key: float(np.degrees(np.abs(column(inside, f"{key}_rad")).max()))
            for key in ("phi", "theta")
        }
        sway, rate = (
            float(np.abs(column(inside, "v_m_s")).max()),
            float(np.abs(column(inside, "r_rad_s")).max()),
        )
        rows.append(
            [
                name,
                flown[name].leg.rpm,
                float(column(inside, "u_m_s").mean()),
                sway,
                rate,
                spread["phi"],
                spread["theta"],
            ]
        )
    heads: list[str | tuple[str, str]] = [
        "leg",
        ("speed", "rpm"),
        ("mean u", "m/s"),
        ("largest v", "m/s"),
        ("largest r", "rad/s"),
    ]
    heads += [("roll", "deg"), ("pitch", "deg")]
    blocks.append(
        table(
            "What was flown",
            heads,
            rows,
            note="Of the true motion, largest magnitudes within the leg.",
        )
    )
    for name, truth in tables.items():
        t = column(truth, "t_s")
        panels = [
            panel(label, "deg", [series("true", t, np.degrees(column(truth, key)), "true")])
            for label, key in (("heading", "psi_rad"), ("roll", "phi_rad"), ("pitch", "theta_rad"))
        ]
        panels.append(panel("depth", "m", [series("true", t, column(truth, "z_m"), "true")]))
        blocks.append(
            plot(
                f"True motion of {name}",
                panels,
                group=f"truth {name}",
                look_for="Roll and pitch answer to steps in heading.",
            )
        )
    return section("The twin", blocks, order=5)


def _views(tables: Iterable[str]) -> dict[str, Any]:
    """Return the true motion of every leg from its take-off on, and the autopilot's."""
    propeller = ("propeller", ("propeller_rev_s",), "1/s")
    return true_views(
        tables, (propeller, ("fins", tuple(f"fin_{fin}_rad" for fin in "spbt"), "rad"))
    )


def _rows_of(truth: pa.Table, leg: FlownLeg) -> tuple[int, int]:
    first, last = np.searchsorted(column(truth, "t_s"), [leg.start_s - 1e-9, leg.end_s + 1e-9])
    return int(first), int(last - first)


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="simulate",
    summary="Fly a plan with a twin and write the logs of its sensors, with the truth beside them",
    maps_over="campaign",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
)
