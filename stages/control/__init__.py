"""Controllers on a model of the vehicle: Al Makdah 2016, chapters 3 to 5.

Flown along trajectories with and without disturbance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.documents.control_cases import ControlCasesDocument, MonteCarloEntry
from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.control.plants import HybridPlant
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Document, Stage, param, port
from auvid.stages.control.cases import limits_of, trajectories_of, weights_of
from auvid.stages.control.flying import (
    DesignModels,
    Flown,
    fly_case,
    models_of,
    monte_carlo,
    require_stable,
)
from auvid.stages.control.linear import linear_comparisons, linear_part
from auvid.stages.control.open_loop import coefficients_part, open_loop_part
from auvid.stages.control.presentation import (
    design_blocks,
    figures,
    flight_table,
    gains_table,
    model_words,
    monte_carlo_part,
    tracking_blocks,
    tracking_table,
    views_of,
)
from auvid.stages.presentation import Block, remark, section, text


@dataclass(frozen=True)
class Inputs:
    """The cases; a model card for every vehicle without a buoyancy engine."""

    vehicle: Vehicle = port("vehicle")
    cases: ControlCasesDocument | None = port("control_cases", optional=True)
    model_card: ModelCard | None = port("model_card", optional=True)


@dataclass(frozen=True)
class Params:
    members: int = param("1", 1000, meaning="vehicles of the Monte Carlo", low=0, high=100000)
    seed: int = param("1", 1, meaning="seed of the drawn coefficients", low=0)
    allow_unstable: bool = param(
        "1", False, meaning="design a controller on an identified model that is unstable by itself"
    )


@dataclass(frozen=True)
class Outputs:
    """Flights, gains, tracking errors and results of a control campaign.

    `flights` by `trajectory-flight`, those of the vehicle's own design; `gains` by
    trajectory; `tracking` of all designs.
    """

    flights: Mapping[str, pa.Table] = port("closed_loop", many=True)
    gains: Mapping[str, pa.Table] = port("gains", many=True)
    tracking: pa.Table = port("tracking_errors")
    results: Document = port("results")
    section: Document = port("section")
    views: Document = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Design the controllers of the cases and fly them.

    Raises `CampaignError` for cases that are missing or beyond the vehicle,
    `PipelineError` for a model that cannot be controlled.
    """
    cases = inputs.cases
    if cases is None:
        raise CampaignError(
            "a control campaign needs its cases",
            field="cases",
            remedy="Name the file in the manifest: cases: cases.yaml.",
        )
    limits, weights, trajectories = limits_of(cases), weights_of(cases), trajectories_of(cases)
    models = models_of(inputs.vehicle, inputs.model_card, cases, limits)
    flown = [
        item
        for case in trajectories
        for item in fly_case(models, case, weights, limits, allow_unstable=params.allow_unstable)
    ]
    rows, blocks = (
        figures(flown, models.plant.inputs),
        [
            text(_words(inputs.vehicle, models)),
            *_unstable(models, flown),
        ],
    )
    blocks += tracking_blocks(flown, models.plant.inputs) + design_blocks(flown)
    parts = [_hybrid(inputs, models, cases)]
    if cases.monte_carlo is not None and params.members:
        parts.insert(0, _spread(cases.monte_carlo, inputs.model_card, params, models, flown))
    for part_blocks, part_rows in parts:
        blocks += part_blocks
        rows += part_rows
    own = [item for item in flown if item.designed_on == flown[0].designed_on]
    tables = {item.name: flight_table(models.plant, item) for item in own}
    report_section = section(
        "Control",
        blocks,
        order=20,
        look_for=(
            "Whether the vehicle keeps to its path and the inputs to their limits, with and without"
            " observer."
        ),
    )
    return Outputs(
        flights=tables,
        gains={item.case.name: gains_table(item, models.plant.inputs) for item in own},
        tracking=tracking_table(flown, models.plant.inputs),
        results={"title": f"Control of {models.plant.title}", "rows": rows},
        section=report_section,
        views=views_of(tables, models.plant.inputs),
    )


def _words(vehicle: Vehicle, models: DesignModels) -> str:
    names = ", ".join(model_words(name) for name in models.designs)
    flown = model_words(next(iter(models.designs)))
    return (
        f"{vehicle.title} flies with coefficients: {flown}. Controllers are designed on: {names}."
    )


def _unstable(models: DesignModels, flown: list[Flown]) -> list[Block]:
    if not models.plant.is_identified:
        return []
    return [
        remark(words, "warning")
        for words in require_stable(models.plant, flown[0].schedule, allow=True)
    ]


def _spread(
    entry: MonteCarloEntry,
    card: ModelCard | None,
    params: Params,
    models: DesignModels,
    flown: list[Flown],
) -> tuple[list[Block], list[dict[str, Any]]]:
    """Return the Monte Carlo of the cases."""
    item = next(
        item
        for item in flown
        if (item.case.name, item.flight.name) == (entry.trajectory, entry.flight)
    )
    if item.case.powered is not None:
        raise CampaignError(
            "the Monte Carlo flies trajectories with one controller",
            field="monte_carlo.trajectory",
            value=entry.trajectory,
        )
    duration, relative, longest = entry.duration.si, entry.relative_sd.si, float(item.flown.t_s[-1])
    if duration > longest + 1e-9:
        allowed = f"at most {longest:g} s, the length of the flight"
        raise CampaignError(
            "longer than what is flown",
            field="monte_carlo.duration",
            value=duration,
            allowed=allowed,
        )
    errors, track = monte_carlo(
        models,
        card,
        item,
        duration_s=duration,
        relative_sd=relative,
        members=params.members,
        seed=params.seed,
    )
    source = (
        "the covariance of the model card"
        if models.plant.is_identified
        else f"a relative standard deviation of {relative:g}"
    )
    return monte_carlo_part(item, errors, track, source, duration)


def _hybrid(
    inputs: Inputs, models: DesignModels, cases: ControlCasesDocument
) -> tuple[list[Block], list[dict[str, Any]]]:
    """Return the parts that only a hybrid vehicle with such cases has.

    Open-loop manoeuvres, linear against nonlinear, and strip theory.
    """
    if not isinstance(models.plant, HybridPlant) or not cases.open_loop:
        return [], []
    part, strips = (
        open_loop_part(cases.open_loop, inputs.vehicle),
        coefficients_part(inputs.vehicle),
    )
    own = [run for run in part.runs if run.parameter_set == models.plant.hybrid.parameter_set]
    blocks, rows = linear_part(linear_comparisons(models.plant, own, cases.linear))
    return [*part.blocks, *blocks, *strips.blocks], [*part.rows, *rows, *strips.rows]


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="control",
    summary="Controllers designed on a model and flown along trajectories",
    maps_over="campaign",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
)
