"""Drag, lift and trim of a glider from its settled glides: Merckelbach et al. 2010."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard, RankingRecord
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.gliding.steady_glide import net_buoyancy
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.glide.comparison import GlideComparison, compare, trim_step
from auvid.hydro.identification.glide.drive_gap import (
    ALL_FIGURES,
    doubted,
    drive_gap,
)
from auvid.hydro.identification.glide.settled import SettlingRules
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.glide.card import glide_card, glide_ranking
from auvid.stages.glide.figures import glide_results, mean_pitch
from auvid.stages.glide.glider import Glider, glider_of
from auvid.stages.glide.legs import GlideLegs, legs_of
from auvid.stages.glide.presentation import glide_section, glide_views
from auvid.stages.glide.refusals import odd_lift, odd_zero

MOST_FLAT = 0.1
"""Share of stretches too flat to be steady, from which on the pitch or the rest is in doubt."""
LEAST_DENSITY_STEP = 0.02
"""Least span [kg/m^3] of a density that was measured: pressure alone gives as much in 5 m."""
CONSTANT_DENSITY = (
    "The density is the same at every depth: it was not measured, and pressure alone makes water"
    " denser. Layers of the water are in no figure: all are weak. Log the density of a CTD; in"
    " mixed water set stages.glide.constant_density: true."
)


@dataclass(frozen=True)
class Inputs:
    """The legs, the vehicle with its part `glider`, and the streams of all logs."""

    campaign: Document = port("campaign", keys=("legs",))
    vehicle: Vehicle = port("vehicle")
    log_info: Collection[LogInfo] = port("log_info", many=True)
    glider: Collection[pa.Table] | None = port("glider", many=True, optional=True)
    attitude: Collection[pa.Table] | None = port("attitude", many=True, optional=True)


@dataclass(frozen=True)
class Params:
    """When a glide is settled, and the stretches that are fitted."""

    surface_m: float = param(
        "m", 10.0, meaning="depth below which a glide is clear of the surface", low=0.0
    )
    settling_s: float = param(
        "s", 60.0, meaning="time to wait after drive, pitch or direction changed", low=0.0
    )
    shortest_s: float = param("s", 60.0, meaning="shortest settled glide", low=10.0)
    stretch_s: float = param("s", 20.0, meaning="length of the means that are fitted", low=5.0)
    least_pitch_deg: float = param(
        "deg", 8.0, meaning="flatter glides are left out", low=1.0, high=60.0
    )
    drive_rate_1_s: float = param(
        "1/s", 1e-3, meaning="share of its stroke that the drive may move in a second", low=1e-6
    )
    pitch_rate_deg_s: float = param(
        "deg/s", 0.3, meaning="change of pitch that still counts as settled", low=1e-3
    )
    max_gap_s: float = param(
        "s", 5.0, meaning="a pause longer than it and 2.5 periods is not bridged", low=0.01
    )
    constant_density: bool = param(
        "1",
        False,
        meaning="without logged density take that of the vehicle file at every depth",
    )


@dataclass(frozen=True)
class Outputs:
    """Figures, the glides with fit, and what is said of them."""

    results: dict[str, Any] = port("results")
    glides: pa.Table = port("glides")
    model_card: Mapping[str, ModelCard] = port("model_card", many=True)
    ranking: RankingRecord = port("ranking")
    section: dict[str, Any] = port("section")
    views: dict[str, Any] = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return drag, lift and trim of all legs together.

    Raises `CampaignError` for a vehicle without part `glider`, `DataError` for logs
    without the streams of a glider, without settled glides, or with units that no
    glider has.
    """
    if inputs.glider is None:
        raise DataError(
            "no log has the stream 'glider'",
            remedy=(
                "Map the columns of pressure, pitch, buoyancy drive and density to the stream"
                " glider (docs/glide.md); a force model of a vehicle with thrusters is kind"
                " identification."
            ),
        )
    glider = glider_of(inputs.vehicle)
    legs = [LegEntry.model_validate(leg) for leg in inputs.campaign["legs"]]
    if not legs:
        raise CampaignError("a campaign of kind glide needs a leg", field="legs")
    glides = legs_of(
        legs,
        inputs.log_info,
        inputs.glider,
        inputs.attitude,
        glider=glider,
        rules=_rules(params, glider),
        stretch_s=params.stretch_s,
        constant_density=params.constant_density,
    )
    prior = glider.prior(glides.stroke_m3)
    glides, comparison = _compared(glides, glider)
    total = glides.rows.t_s.size
    while not (
        steady := np.isfinite(comparison.estimate.predict(glides.rows).depth_rate_m_s)
    ).all():
        glides = replace(glides, rows=glides.rows.where(steady))
        comparison = compare(glides.rows, body=glider.body, prior=prior)
    flat = total - glides.rows.t_s.size
    if flat:
        words = (
            f"{flat} of {total} stretches are pitched flatter than any"
            " steady glide by the drag and lift that the others show: left out."
        )
        glides = replace(glides, warnings=(*glides.warnings, words))
    gap = drive_gap(
        glides.rows,
        comparison.estimate,
        body=glider.body,
        prior=prior,
        stroke_m3=glides.stroke_m3,
        pitch_rad=mean_pitch(glides),
    )
    odd = [
        words
        for words in (
            odd_lift(comparison.estimate, glider.lift_slope),
            odd_zero(comparison.estimate, glider.zero_lift),
        )
        if words
    ]
    glides = replace(glides, warnings=(*glides.warnings, *odd))
    density = glides.rows.state.density_kg_m3
    logged_constant = not params.constant_density and float(np.ptp(density)) < LEAST_DENSITY_STEP
    if logged_constant:
        glides = replace(glides, warnings=(*glides.warnings, CONSTANT_DENSITY))
    in_doubt = bool(odd or logged_constant or glides.pitch_zero or flat > MOST_FLAT * total)
    steps = trim_step(glides.rows, comparison.estimate, glides.stroke_m3) is not None
    if in_doubt or steps or glides.is_drive_stuck or (gap is not None and gap.named):
        estimate = doubted(comparison.estimate, *ALL_FIGURES)
        bare = comparison.without_speed
        comparison = replace(
            comparison,
            estimate=estimate,
            without_speed=None if bare is None else doubted(bare, *ALL_FIGURES),
        )
    results = glide_results(comparison, glides, glider)
    card = glide_card(comparison, glides, inputs.vehicle)
    return Outputs(
        results,
        _table(comparison, glides),
        {card.name: card},
        glide_ranking(card),
        glide_section(comparison, glides, glider, results, gap),
        glide_views(glides),
    )


def _compared(glides: GlideLegs, glider: Glider) -> tuple[GlideLegs, GlideComparison]:
    """Return legs and comparison, without a speed that ends the search."""
    prior = glider.prior(glides.stroke_m3)
    try:
        return glides, compare(glides.rows, body=glider.body, prior=prior)
    except DataError:
        if not glides.pitch_zero or not np.isfinite(glides.rows.speed_m_s).any():
            raise
    glides = glides.by_pitch_alone()
    return glides, compare(glides.rows, body=glider.body, prior=prior)


def _rules(params: Params, glider: Glider) -> SettlingRules:
    return SettlingRules(
        surface_m=params.surface_m,
        drive_rate_1_s=params.drive_rate_1_s,
        pitch_rate_rad_s=float(np.radians(params.pitch_rate_deg_s)),
        least_pitch_rad=float(np.radians(params.least_pitch_deg)),
        settling_s=params.settling_s,
        shortest_s=params.shortest_s,
        max_gap_s=params.max_gap_s,
        stops_m3=glider.stops_m3,
    )


def _table(comparison: GlideComparison, glides: GlideLegs) -> pa.Table:
    """Return stretches of settled glides with the fit beside the measurement."""
    estimate, rows = comparison.estimate, glides.rows
    fitted = estimate.predict(rows)
    force = net_buoyancy(rows.state, estimate.body, estimate.value("trim"))
    columns = {
        "recording": [glides.leg_of_glide[number] for number in rows.glide],
        "t_s": rows.t_s,
        "glide": rows.glide,
        "pitch_rad": rows.state.pitch_rad,
        "buoyancy_drive_m3": rows.state.drive_m3,
        "density_kg_m3": rows.state.density_kg_m3,
        "pressure_pa": rows.state.pressure_pa,
        "net_buoyancy_N": force,
        "depth_rate_measured_m_s": rows.depth_rate_m_s,
        "depth_rate_fitted_m_s": fitted.depth_rate_m_s,
        "depth_rate_held_out_m_s": comparison.held_out_rate_m_s,
        "speed_measured_m_s": rows.speed_m_s,
        "speed_fitted_m_s": fitted.speed_m_s,
        "alpha_rad": fitted.alpha_rad,
    }
    return make_table("glides", columns)


STAGE = Stage(
    "glide",
    "Drag, lift, incidence and trim of a glider from settled glides",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
)
