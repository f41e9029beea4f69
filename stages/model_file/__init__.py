"""Write each identified model as one file that stands alone, and say which to take.

Nothing is computed here: card, ranking, free runs, vehicle and provenance are put
together, so that a simulator needs this file and no other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.model_file import ModelFile
from auvid.data_schemas.records.models import MeritRecord, ModelCard, RankingRecord
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.model_file.contents import (
    as_logged,
    differing_directions,
    model_document,
    use_entry,
)
from auvid.stages.presentation import remark, section, table, text


@dataclass(frozen=True)
class Inputs:
    campaign: Document = port("campaign", keys=("title",))
    vehicle: Vehicle = port("vehicle")
    provenance: Document = port("provenance")
    model_card: Collection[ModelCard] = port("model_card", many=True)
    ranking: RankingRecord = port("ranking")
    free_run: pa.Table | None = port("free_run", optional=True)
    log_info: Collection[LogInfo] | None = port("log_info", many=True, optional=True)


@dataclass(frozen=True)
class Params:
    minimum_speed_m_s: float = param(
        "m/s",
        0.05,
        meaning="lower bound of U in eta = u_c(n)/U for simulators",
        low=1e-3,
        high=1.0,
    )


@dataclass(frozen=True)
class Outputs:
    model_file: Mapping[str, ModelFile] = port("model_file", many=True)
    section: Document = port("section")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return the file of each model, and which is the one to take."""
    merits: dict[str, MeritRecord] = {item.name: item for item in inputs.ranking.models}
    rows = [] if inputs.free_run is None else inputs.free_run.to_pylist()
    vehicle = inputs.vehicle
    logs = list((inputs.log_info or {}).values())
    for log in logs:
        vehicle = as_logged(vehicle, log)
    files = {
        name: model_document(
            card,
            vehicle,
            use=use_entry(inputs.ranking, merits.get(name), card),
            merit=merits.get(name),
            free_runs=[row for row in rows if row["model"] == name and not row["as_measured"]],
            title=str(inputs.campaign.get("title") or inputs.vehicle.title),
            provenance=inputs.provenance,
            minimum_speed_m_s=params.minimum_speed_m_s,
        )
        for name, card in inputs.model_card.items()
    }
    return Outputs(files, _section(files, differing_directions(inputs.vehicle, vehicle, logs)))


def _section(files: Mapping[str, ModelFile], warning: str) -> dict[str, Any]:
    heads = ["file", "model", "take it", "what for"]
    rows = [
        [
            f"model_file/{name}.json",
            file.title,
            "yes" if file.use.recommended else "",
            file.use.sentence,
        ]
        for name, file in files.items()
    ]
    words = text("Each file stands alone: vehicle, coefficients with verdicts, uses and figures.")
    warnings = [remark(warning, "warning")] if warning else []
    listed = table("Model files of this run", heads, rows)
    return section("Model files", [words, *warnings, listed], order=58)


STAGE = Stage(
    "model_file",
    "One file for each model that stands alone, with what it may be used for",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
    no_views="a model file is no signal",
)
