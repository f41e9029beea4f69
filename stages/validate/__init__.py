"""Judge every model on every segment: predicted forces and the error tables of McCarter
5.1 and 5.2, (4.22)-(4.27).

Two things keep the tables honest. The mean force of the training legs alone stands
beside the models as a reference row, because J0 contains it; and the report says how
far the validation legs leave the range of motion that the models were fitted in.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.tables import column, has_columns, make_table, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.simulation.free_run import FreeRuns
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import Coefficients, IdentifiedModel
from auvid.hydro.identification.regression.error_measures import ErrorAccumulator
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.columns import AXIS_UNITS, VELOCITY, clock, force_columns, forces, named
from auvid.stages.presentation import panel, plot, remark, section, series
from auvid.stages.validate.free_run import free_run_blocks, free_run_table, run_segment
from auvid.stages.validate.tables import (
    ALL,
    FAILED_RATIO,
    Seen,
    constant_alone,
    error_blocks,
    error_rows,
    metrics,
    range_blocks,
    tables_as_text,
    total_errors_of,
    verdicts,
)


@dataclass(frozen=True)
class Inputs:
    model_card: Collection[Document] = port("model_card", many=True)
    residual: Collection[pa.Table] = port("residual", many=True)
    segment: Collection[Document] = port("segment", many=True)
    fused: Collection[pa.Table] | None = port("fused", many=True, optional=True)
    controls: Collection[pa.Table] | None = port("controls", many=True, optional=True)
    vehicle: Vehicle | None = port("vehicle", optional=True)


@dataclass(frozen=True)
class Params:
    failed_ratio: float = param(
        "1",
        FAILED_RATIO,
        meaning="a model fails on an axis where J/J0 on validation exceeds this",
        low=0.1,
        high=10.0,
    )
    free_run: bool = param(
        "1", True, meaning="simulate every model on the validation legs from measured controls"
    )
    free_run_horizons_s: tuple[float, ...] = param(
        "s", (5.0, 10.0, 30.0), meaning="times after a start at which the state is compared"
    )
    free_run_every_s: float = param(
        "s", 5.0, meaning="time between starting points", low=0.1, high=1000.0
    )
    minimum_speed_m_s: float = param(
        "m/s", 0.05, meaning="lower bound of U in eta = u_c(n)/U in a free run", low=1e-3, high=1.0
    )


@dataclass(frozen=True)
class Outputs:
    predictions: Mapping[str, pa.Table] = port("predictions", many=True)
    error_table: pa.Table = port("error_table")
    error_metrics: Document = port("error_metrics")
    free_run: pa.Table = port("free_run")
    tables_text: bytes = port("tables_text")
    section: Document = port("section")
    views: Document = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    cards = dict(inputs.model_card.items())
    titles = {name: str(card["title"]) for name, card in cards.items()}
    models = [IdentifiedModel(name, card["solution"]) for name, card in cards.items()]
    trims = {
        name: np.array([card["solution"].get(axis, {}).get(CONSTANT, 0.0) for axis in AXES])
        for name, card in cards.items()
    }
    sums: dict[tuple[str, str, str], ErrorAccumulator] = {}
    seen: dict[str, Seen] = {}
    bare = [IdentifiedModel(model.name, without_constant(model.coefficients)) for model in models]
    predictions, plots, free = {}, [], {}
    for key, residual in inputs.residual.items():
        segment = inputs.segment[key]
        use, leg = str(segment["use"]), str(segment["leg"])
        if leg == ALL:
            raise CampaignError(
                f"a leg may not be called '{ALL}': that is the row of all legs together",
                field="legs",
                value=leg,
            )
        measured = forces(residual, "tau_bar")
        predicted = {model.name: predict(model, trims[model.name], residual) for model in models}
        predictions[key] = _prediction_table(key, clock(residual), predicted)
        for name, force in predicted.items():
            sums[(use, leg, name)] = sums.get((use, leg, name), ErrorAccumulator()).add(
                measured, force
            )
        seen[use] = seen.get(use, Seen()).add(matrix(residual, VELOCITY), measured)
        if use == "validation":
            plots.append(_prediction_plot(segment, clock(residual), measured, predicted))
            runs = _free_runs(inputs, params, bare, np.array(list(trims.values())), key)
            if runs is not None:
                free[key] = runs
    errors = total_errors_of(sums)
    if not any(use == "validation" for use, _, _ in errors):
        plots.append(
            remark(
                "No validation leg: nothing says how far these models hold outside the data they"
                " were fitted on.",
                "warning",
            )
        )
    constant = constant_alone(seen)
    flown = free_run_table(free, [model.name for model in models])
    blocks = [
        *verdicts(errors, cards, constant, params.failed_ratio),
        *error_blocks(errors, cards, constant),
        *range_blocks(seen),
        *free_run_blocks(flown, titles),
        *plots,
    ]
    return Outputs(
        predictions=predictions,
        error_table=error_rows(errors, cards),
        error_metrics=metrics(errors),
        free_run=flown,
        tables_text=tables_as_text(errors, cards, constant).encode("utf-8"),
        section=section(
            "Validation",
            blocks,
            order=10,
            look_for=(
                "J/J0 near 0 explains the force; 1 explains nothing; above 1 is worse than no"
                " model."
            ),
        ),
        views=_views(inputs.segment, cards),
    )


def without_constant(coefficients: Coefficients) -> dict[str, dict[str, float]]:
    """The coefficients of the viscous terms alone, axis by axis."""
    return {
        axis: {term: value for term, value in terms.items() if term != CONSTANT}
        for axis, terms in coefficients.items()
    }


def _free_runs(
    inputs: Inputs, params: Params, models: Sequence[IdentifiedModel], trims: Array, key: str
) -> FreeRuns | None:
    if (
        not params.free_run
        or inputs.fused is None
        or inputs.controls is None
        or inputs.vehicle is None
        or not models
    ):
        return None
    return run_segment(
        inputs.vehicle,
        models,
        trims,
        inputs.fused[key],
        inputs.controls[key],
        horizons_s=params.free_run_horizons_s,
        every_s=params.free_run_every_s,
        minimum_speed=params.minimum_speed_m_s,
    )


def predict(model: IdentifiedModel, trim: Array, residual: pa.Table) -> Array:
    """Force of a model at the velocities of a residual table: (n, 6), trim (6,) added."""
    ratio = column(residual, "eta_ratio") if has_columns(residual, ("eta_ratio",)) else None
    bare = IdentifiedModel(model.name, without_constant(model.coefficients))
    if not bare.terms:
        return np.tile(trim, (residual.num_rows, 1))
    return np.asarray(bare.force(matrix(residual, VELOCITY), ratio) + trim)


def _prediction_table(key: str, t_s: Array, predicted: Mapping[str, Array]) -> pa.Table:
    if not predicted:
        raise DataError("there is no model to judge")
    n, stacked = t_s.size, np.vstack(list(predicted.values()))
    names = pa.array(np.repeat(list(predicted), n).tolist(), type=pa.string())
    columns = {
        "segment": pa.array([key] * len(names), type=pa.string()),
        "model": names,
        "t_s": np.tile(t_s, len(predicted)),
    }
    return make_table("predictions", {**columns, **named(force_columns("tau"), stacked)})


def _prediction_plot(
    segment: Document, t_s: Array, measured: Array, predicted: Mapping[str, Array]
) -> dict[str, Any]:
    t = t_s + float(segment["leg_start_s"])
    panels = []
    for index, axis in enumerate(AXES):
        lines = [series("measured", t, measured[:, index], "measured")]
        lines += [series(name, t, force[:, index], name) for name, force in predicted.items()]
        panels.append(panel(axis, AXIS_UNITS[axis], lines))
    title = f"Force on {segment['id']}: every model against measurement (McCarter Figures 5.8-5.15)"
    return plot(
        title,
        panels,
        group="time",
        look_for="A model that follows the measured line here has not seen it before.",
    )


def _views(segments: Iterable[str], models: Iterable[str]) -> dict[str, Any]:
    """The force of every model beside the measured one, and its error: prediction less
    measurement.
    """
    groups = []
    names = list(models)
    for key in segments:
        for (index, axis), model in itertools.product(enumerate(AXES), names):
            group = {
                "entity": f"residual/{axis}/{model}",
                "table": f"predictions/{key}",
                "columns": [force_columns("tau")[index]],
                "names": [f"{axis} {model}"],
                "roles": [model],
                "tab": "Answer",
                "unit": AXIS_UNITS[axis],
                "filter": {"model": model},
            }
            less = {
                "table": f"residual/{key}/residual",
                "columns": [force_columns("tau_bar")[index]],
            }
            groups += [
                group,
                group | {"entity": f"error/{axis}/{model}", "tab": "Error", "less": less},
            ]
    return {"groups": groups}


STAGE = Stage(
    "validate",
    "Predicted forces and error tables of every model, training and validation",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
)
