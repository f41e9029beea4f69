"""Judge every model on every segment: predicted forces and error tables.

The tables are those of McCarter 5.1 and 5.2, (4.22)-(4.27). Two things keep them
honest. The mean force of the training legs is a reference row beside the models,
because J0 contains it; and the report says how far the validation legs leave the range
of motion that the models were fitted in.

Segments are in memory one at a time: a first pass adds up errors, a second finds their
medians and what lies outside the training range; predictions are made when they are
written.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, has_columns, make_table, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.simulation.free_run import FreeRuns
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.regression.error_measures import ErrorSums, MiddleErrors
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.columns import VELOCITY, clock, force_columns, forces, named
from auvid.stages.presentation import Block
from auvid.stages.validate.free_run import free_run_table, run_segment
from auvid.stages.validate.presentation import (
    FAILED_RATIO,
    prediction_plot,
    tables_as_text,
    validate_section,
    validate_views,
)
from auvid.stages.validate.tables import ALL, Group, RangeCovered, error_metrics, error_rows


@dataclass(frozen=True)
class Inputs:
    model_card: Collection[ModelCard] = port("model_card", many=True)
    residual: Collection[pa.Table] = port("residual", many=True)
    segment: Collection[SegmentRecord] = port("segment", many=True)
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


@dataclass(frozen=True)
class Predictor:
    """A model of a card: viscous terms, and the constant force `trim` (6,)."""

    viscous: IdentifiedModel
    trim: Array

    @classmethod
    def of(cls, card: ModelCard) -> Predictor:
        """Return the model of a card."""
        terms = {
            axis: {term: value for term, value in row.items() if term != CONSTANT}
            for axis, row in card.solution.items()
        }
        trim = [card.solution.get(axis, {}).get(CONSTANT, 0.0) for axis in AXES]
        return cls(IdentifiedModel(str(card.name), terms), np.array(trim))

    def force(self, residual: pa.Table) -> Array:
        """Return the force (n, 6) at the velocities of a residual table."""
        if not self.viscous.terms:
            return np.tile(self.trim, (residual.num_rows, 1))
        ratio = column(residual, "eta_ratio") if has_columns(residual, ("eta_ratio",)) else None
        return np.asarray(self.viscous.force(matrix(residual, VELOCITY), ratio) + self.trim)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return predictions, error tables and free runs of every model.

    Raises `DataError` without a model, `CampaignError` for a leg called `all`.
    """
    cards = dict(inputs.model_card.items())
    if not cards:
        raise DataError("there is no model to judge")
    models = {name: Predictor.of(card) for name, card in cards.items()}
    segments = dict(inputs.segment.items())
    for segment in segments.values():
        if segment.leg == ALL:
            raise CampaignError(
                f"a leg may not be called '{ALL}': that is the row of all legs together",
                field="legs",
                value=ALL,
            )

    def judged() -> Iterator[tuple[str, str, pa.Table, Array]]:
        for key, residual in inputs.residual.items():
            yield key, str(segments[key].use), residual, forces(residual, "tau_bar")

    def groups(key: str, model: str) -> tuple[Group, Group]:
        use, leg = str(segments[key].use), str(segments[key].leg)
        return (use, ALL, model), (use, leg, model)

    sums: dict[Group, ErrorSums] = {}
    covered: dict[str, RangeCovered] = {}
    plots: list[Block] = []
    free: dict[str, FreeRuns] = {}
    for key, use, residual, measured in judged():
        predicted = {name: model.force(residual) for name, model in models.items()}
        for name, force in predicted.items():
            errors = ErrorSums.of(measured, force)
            for group in groups(key, name):
                sums[group] = sums[group].merge(errors) if group in sums else errors
        motion = RangeCovered.of(matrix(residual, VELOCITY), measured)
        covered[use] = covered[use].merge(motion) if use in covered else motion
        if use == "validation":
            t = clock(residual) + float(segments[key].leg_start_s)
            plots.append(prediction_plot(segments[key], t, measured, predicted))
            runs = _free_runs(inputs, params, models, key)
            if runs is not None:
                free[key] = runs
    middle = {group: MiddleErrors.between(*total.bracket()) for group, total in sums.items()}
    outside = np.zeros(6)
    for key, use, residual, measured in judged():
        for name, model in models.items():
            force = model.force(residual)
            for group in groups(key, name):
                middle[group] = middle[group].add(measured, force)
        if use == "validation" and "training" in covered:
            outside += covered["training"].left_by(matrix(residual, VELOCITY))
    errors_of = {
        group: sums[group].measures(middle[group].medians(sums[group].n))
        for group in sorted(sums, key=lambda group: group[1] != ALL)
    }
    free_run = free_run_table(free, list(models))
    return Outputs(
        predictions=Collection(
            {key: partial(_predictions, inputs, models, key) for key in segments}
        ),
        error_table=error_rows(errors_of, cards),
        error_metrics=error_metrics(errors_of),
        free_run=free_run,
        tables_text=tables_as_text(errors_of, cards, covered).encode("utf-8"),
        section=validate_section(
            errors_of, cards, covered, outside, free_run, plots, failed_ratio=params.failed_ratio
        ),
        views=validate_views(segments, cards),
    )


def _free_runs(
    inputs: Inputs, params: Params, models: Mapping[str, Predictor], key: str
) -> FreeRuns | None:
    if not (params.free_run and inputs.fused and inputs.controls and inputs.vehicle is not None):
        return None
    return run_segment(
        inputs.vehicle,
        [model.viscous for model in models.values()],
        np.array([model.trim for model in models.values()]),
        inputs.fused[key],
        inputs.controls[key],
        horizons_s=params.free_run_horizons_s,
        every_s=params.free_run_every_s,
        minimum_speed=params.minimum_speed_m_s,
    )


def _predictions(inputs: Inputs, models: Mapping[str, Predictor], key: str) -> pa.Table:
    residual = inputs.residual[key]
    n = residual.num_rows
    columns: dict[str, Any] = {
        "segment": [key] * (n * len(models)),
        "model": [name for name in models for _ in range(n)],
        "t_s": np.tile(clock(residual), len(models)),
    }
    force = np.vstack([model.force(residual) for model in models.values()])
    return make_table("predictions", columns | named(force_columns("tau"), force))


STAGE = Stage(
    "validate",
    "Predicted forces and error tables of every model, training and validation",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
)
