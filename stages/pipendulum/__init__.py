"""Moments of inertia, added mass and damping from pendulums: Alberti 2015, IV and VI.

Inertia on a quadrifilar pendulum, added mass and damping by free decay in water.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.apparatus import ApparatusDocument
from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.bench.channel_records import DAMPING
from auvid.stages.base import Collection, Document, Stage, port
from auvid.stages.columns import stacked
from auvid.stages.pipendulum.decays import (
    DecayResult,
    decay_figures,
    decays_of,
    measured_rate,
)
from auvid.stages.pipendulum.presentation import bench_section, bench_views
from auvid.stages.pipendulum.recordings import Logs
from auvid.stages.pipendulum.swings import SwingResult, inertia_document, swing_figures, swings_of


@dataclass(frozen=True)
class Inputs:
    """The apparatus, the vehicle, and the gyros and attitudes of all logs."""

    campaign: Document = port("campaign", keys=("legs",))
    vehicle: Vehicle = port("vehicle")
    log_info: Collection[LogInfo] = port("log_info", many=True)
    apparatus: ApparatusDocument | None = port("apparatus", optional=True)
    imu: Collection[pa.Table] | None = port("imu", many=True, optional=True)
    attitude: Collection[pa.Table] | None = port("attitude", many=True, optional=True)


@dataclass(frozen=True)
class Params:
    """No parameters: the settings are in the apparatus document."""


@dataclass(frozen=True)
class Outputs:
    """All None for a campaign without an apparatus."""

    results: dict[str, Any] | None = port("results", optional=True)
    inertia: dict[str, Any] | None = port("inertia", optional=True)
    swings: pa.Table | None = port("swings", optional=True)
    decays: pa.Table | None = port("decays", optional=True)
    decay_history: pa.Table | None = port("decay_history", optional=True)
    section: dict[str, Any] | None = port("section", optional=True)
    views: dict[str, Any] | None = port("views", optional=True)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return the inertias, added masses and damping of all swings and decays.

    Raises `CampaignError` for a faulty apparatus, `DataError` for recordings that cannot
    give them.
    """
    apparatus = inputs.apparatus
    if apparatus is None:
        return Outputs()
    vehicle = inputs.vehicle
    legs = {leg.id: leg for leg in map(LegEntry.model_validate, inputs.campaign["legs"])}
    logs = Logs(legs, inputs.log_info, inputs.imu, inputs.attitude)
    tray, pendulum = apparatus.quadrifilar, apparatus.free_decay
    swings = [] if tray is None else swings_of(tray, logs, vehicle)
    decays = [] if pendulum is None else decays_of(pendulum, logs, vehicle)
    rows = [*swing_figures(swings), *decay_figures(decays)]
    return Outputs(
        results={"title": apparatus.title, "rows": rows},
        inertia=inertia_document(swings, vehicle.name, apparatus.source),
        swings=_swing_table(swings),
        decays=_decay_table(decays),
        decay_history=_history_table(decays),
        section=bench_section(apparatus, swings, decays),
        views=bench_views(swings, decays),
    )


def _swing_table(swings: list[SwingResult]) -> pa.Table | None:
    parts = [
        {
            "recording": [recording.leg] * fit.t_s.size,
            "t_s": fit.t_s,
            "rate_measured_rad_s": recording.rate[np.searchsorted(recording.t_s, fit.t_s)],
            "rate_fitted_rad_s": fit.fitted,
        }
        for item in swings
        for recording, fit in item.recordings
    ]
    return make_table("swings", stacked(parts)) if parts else None


def _decay_table(decays: list[DecayResult]) -> pa.Table | None:
    parts = [
        {
            "recording": [item.recording.leg] * item.decay.run.grid_s.size,
            "t_s": item.decay.run.grid_s,
            "theta_measured_rad": item.estimate.measured,
            "speed_m_s": decay.arm * measured_rate(item.decay.run),
            **{
                f"theta_{name.replace(' ', '_')}_rad": item.estimate.simulated[name]
                for name in DAMPING
            },
            "chosen": [decay.chosen] * item.decay.run.grid_s.size,
        }
        for decay in decays
        for item in decay.recordings
    ]
    return make_table("decays", stacked(parts)) if parts else None


def _history_table(decays: list[DecayResult]) -> pa.Table | None:
    parts = []
    for decay in decays:
        linear, quadratic = DAMPING[decay.chosen]
        for item in decay.recordings:
            history, excited = item.estimate.history[decay.chosen], item.estimate.excitation
            t = history.t_s
            columns = dict(
                zip(
                    ["stiffness", *["linear"] * linear, *["quadratic"] * quadratic],
                    history.theta.T[:-1],
                    strict=True,
                )
            )
            of_pole = {
                "linear": item.decay.pole[0] * columns["stiffness"],
                "quadratic": item.decay.pole[1] * columns["stiffness"],
            }
            block = {
                "recording": [item.recording.leg] * t.size,
                "t_s": t,
                "stiffness": columns["stiffness"],
            }
            block |= {name: of_pole[name] + columns.get(name, np.zeros(t.size)) for name in of_pole}
            parts.append(
                block | {"smallest_eigenvalue": np.interp(t, excited.t_s, excited.smallest)}
            )
    return make_table("decay_history", stacked(parts)) if parts else None


STAGE = Stage(
    "pipendulum",
    "Inertia on a quadrifilar pendulum; added mass and damping by free decay",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
)
