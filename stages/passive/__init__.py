"""Drag and restoring of bodies without actuators: tows, coasts, free decays, drifts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard, RankingRecord
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.passive.card import passive_card, passive_ranking
from auvid.stages.passive.figures import passive_results
from auvid.stages.passive.motions import ROLES, MotionRules, PassiveLeg, motions_of, read_leg
from auvid.stages.passive.presentation import passive_section, passive_table

STREAMS = ("imu", "attitude", "depth", "velocity", "position", "tow")


@dataclass(frozen=True)
class Inputs:
    """The legs, the vehicle for its masses, and the streams of all logs."""

    campaign: Document = port("campaign", keys=("legs",))
    vehicle: Vehicle = port("vehicle")
    log_info: Collection[LogInfo] = port("log_info", many=True)
    imu: Collection[pa.Table] | None = port("imu", many=True, optional=True)
    attitude: Collection[pa.Table] | None = port("attitude", many=True, optional=True)
    depth: Collection[pa.Table] | None = port("depth", many=True, optional=True)
    velocity: Collection[pa.Table] | None = port("velocity", many=True, optional=True)
    position: Collection[pa.Table] | None = port("position", many=True, optional=True)
    tow: Collection[pa.Table] | None = port("tow", many=True, optional=True)


@dataclass(frozen=True)
class Params:
    """What counts as a coast, and the clock."""

    rate_hz: float = param(
        "Hz", 20.0, meaning="rate of the uniform clock; that of the log where it is lower", low=0.5
    )
    max_gap_s: float = param("s", 1.0, meaning="a longer pause of a stream is a gap", low=0.01)
    speed_m_s: float = param(
        "m/s", 0.1, meaning="least speed at the start of a coast", low=0.001, high=5.0
    )
    rate_rad_s: float = param(
        "rad/s", 0.2, meaning="least yaw rate at the start of a coast", low=0.001, high=5.0
    )
    longest_s: float = param("s", 8.0, meaning="what is taken of a longer coast", low=1.0)


@dataclass(frozen=True)
class Outputs:
    """Figures, the stretches with their fits, and what is said of them."""

    results: dict[str, Any] = port("results")
    passive_motions: pa.Table = port("passive_motions")
    model_card: Mapping[str, ModelCard] = port("model_card", many=True)
    ranking: RankingRecord = port("ranking")
    section: dict[str, Any] = port("section")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return drag, restoring and damping of all legs, in newtons where a tow tells.

    Raises `CampaignError` for a role that there is not and `DataError` for logs in which
    the body neither is towed nor coasts nor swings.
    """
    legs = [LegEntry.model_validate(leg) for leg in inputs.campaign["legs"]]
    for leg in legs:
        if leg.role is not None and leg.role not in ROLES:
            raise CampaignError(
                f"leg '{leg.id}' has no such role", field="role", value=leg.role, allowed=ROLES
            )
    rules = MotionRules(params.speed_m_s, params.rate_rad_s, params.longest_s)
    read = [_read(inputs, params, leg) for leg in legs]
    motions = motions_of(read, rules, inputs.vehicle)
    if motions.empty:
        raise DataError(
            "no leg is a tow, a coast or a decay",
            value="; ".join(motions.left_out) or "nothing moves",
            remedy=(
                "Give a leg its role (tow, coast, decay, drift) and its channel, from where the"
                " body is let go (docs/coasting.md)."
            ),
        )
    results = passive_results(motions, inputs.vehicle)
    card = passive_card(motions, inputs.vehicle)
    return Outputs(
        results,
        make_table("passive_motions", passive_table(motions)),
        {} if card is None else {card.name: card},
        passive_ranking(card, motions),
        passive_section(motions, results),
    )


def _read(inputs: Inputs, params: Params, leg: LegEntry) -> PassiveLeg:
    tables = {
        name: None if (item := getattr(inputs, name)) is None else item.get(leg.log)
        for name in STREAMS
    }
    return read_leg(
        leg,
        tables,
        inputs.log_info[leg.log],
        inputs.vehicle,
        rate_hz=params.rate_hz,
        max_gap_s=params.max_gap_s,
    )


STAGE = Stage(
    "passive",
    "Drag and restoring of a body without actuators: tows, coasts, decays, drifts",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
    no_views="its report section draws every stretch",
)
