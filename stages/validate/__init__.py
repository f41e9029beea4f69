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

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.models import ModelCard, MotionCheck, RankingRecord
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import TableParts, column, has_columns, labels, make_table, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.simulation.free_run import FreeRuns
from auvid.hydro.dynamics.simulation.growth import Growth, growth
from auvid.hydro.dynamics.steady_motion import TILT_STATES, Floating
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.constrained.equations import (
    added_mass_change,
    added_mass_unknown,
)
from auvid.hydro.identification.regression.error_measures import ErrorSums, MiddleErrors
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.selection.information import inflation
from auvid.hydro.long_series.threads import at_once
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.columns import (
    ACCELERATION,
    ACTUATORS,
    VELOCITY,
    clock,
    force_columns,
    forces,
    named,
)
from auvid.stages.form_evidence import reference_model
from auvid.stages.free_run import free_run_table, measured_motion, run_segment
from auvid.stages.presentation import Block
from auvid.stages.steps import tell
from auvid.stages.validate.flight import (
    FreeFlight,
    ModelDraws,
    calibrated,
    draw_models,
    fly,
    force_errors,
    grown_errors,
)
from auvid.stages.validate.flight_presentation import flight_blocks
from auvid.stages.validate.motion_check import motion_checks
from auvid.stages.validate.presentation import (
    FAILED_RATIO,
    cause_blocks,
    free_run_blocks,
    prediction_plot,
    tables_as_text,
    validate_section,
    validate_views,
)
from auvid.stages.validate.ranking import rank, resting_velocities
from auvid.stages.validate.tables import (
    ALL,
    Group,
    RangeCovered,
    constant_ratios,
    error_metrics,
    error_rows,
)

COLUMNS = (
    "eta_ratio",
    *VELOCITY,
    *(name for part in ("tau_bar", *ACTUATORS) for name in force_columns(part)),
)
"""Of the residual force, beside its clock: not its other components, the most of it."""
LONG_ROWS, MODELS_AT_ONCE = 250_000, 2
"""Of predictions: from how many on they are made while they are written, for how many."""
SEED = 1
"""Of the draws, so that a run gives the same band again."""


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
    free_run_draws: int = param(
        "1",
        1000,
        meaning="draws of the chosen model's coefficients that fly with it, for its band; 0: none",
        low=0,
        high=100_000,
    )
    minimum_speed_m_s: float = param(
        "m/s", 0.05, meaning="lower bound of U in eta = u_c(n)/U in a free run", low=1e-3, high=1.0
    )


@dataclass(frozen=True)
class Outputs:
    predictions: Mapping[str, pa.Table | TableParts] = port("predictions", many=True)
    error_table: pa.Table = port("error_table")
    error_metrics: Document = port("error_metrics")
    free_run: pa.Table = port("free_run")
    ranking: RankingRecord = port("ranking")
    simulated_motion: Mapping[str, pa.Table] = port("simulated_motion", many=True)
    tables_text: bytes = port("tables_text")
    section: Document = port("section")
    views: Document = port("views")


@dataclass(frozen=True)
class Predictor:
    """A model of a card: viscous terms, constant force `trim` (6,), fitted inertia.

    added_mass (6, 6) is what the card's inertia adds to M_A of the vehicle file; lag_s
    a lag of the actuators that was fitted with it.
    """

    viscous: IdentifiedModel
    trim: Array
    added_mass: Array
    lag_s: float = 0.0

    @classmethod
    def of(cls, card: ModelCard) -> Predictor:
        """Return the model of a card."""
        terms = {
            axis: {term: value for term, value in row.items() if term != CONSTANT}
            for axis, row in card.predictor.items()
        }
        change = added_mass_change(
            {added_mass_unknown(item.name): item.change for item in card.inertia}
        )
        trim = [card.predictor.get(axis, {}).get(CONSTANT, 0.0) for axis in AXES]
        return cls(IdentifiedModel(card.name, terms), np.array(trim), change, card.lag_s)

    def force(
        self,
        residual: pa.Table,
        fused: pa.Table | None,
        late: Mapping[float, Array] = MappingProxyType({}),
    ) -> Array:
        """Return the residual force (n, 6) that the model predicts on a segment.

        tau_bar is formed with the inertia of the vehicle file and actuators without a
        lag, so a model with other ones also predicts dM_A nu_dot + C(dM_A, nu) nu, and
        tau_U with its lag less tau_U without: `late`, by lag, where it is known.
        """
        nu, force = matrix(residual, VELOCITY), np.tile(self.trim, (residual.num_rows, 1))
        if self.viscous.terms:
            ratio = column(residual, "eta_ratio") if has_columns(residual, ("eta_ratio",)) else None
            force += self.viscous.force(nu, ratio)
        if self.added_mass.any():
            assert fused is not None  # the inertia was fitted with it
            force += matrix(fused, ACCELERATION) @ self.added_mass.T
            force += coriolis_force(self.added_mass, nu)
        if self.lag_s > 0.0:
            change = late.get(self.lag_s)
            force += _late_change(residual, self.lag_s) if change is None else change
        return force

    def vehicle(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle with the model's inertia."""
        if not self.added_mass.any():
            return vehicle
        return replace(vehicle, added_mass=vehicle.added_mass + self.added_mass)


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

    def judged() -> Iterator[tuple[str, str, pa.Table, Array, Mapping[str, Array]]]:
        for key in inputs.residual:
            residual = inputs.residual.part(key, COLUMNS)
            predicted = _forces(inputs, models, key, residual)
            if segments[key].use == "validation":  # its plots show all models
                predicted = dict(predicted)
            yield key, str(segments[key].use), residual, forces(residual, "tau_bar"), predicted

    def groups(key: str, model: str) -> tuple[Group, Group]:
        use, leg = str(segments[key].use), str(segments[key].leg)
        return (use, ALL, model), (use, leg, model)

    sums: dict[Group, ErrorSums] = {}
    covered: dict[str, RangeCovered] = {}
    plots: list[Block] = []
    free: dict[tuple[str, str], FreeRuns] = {}
    resting = resting_velocities(cards)
    causes: dict[str, Growth] = {}
    steps = 2 * len(segments) + len(models)
    for done, (key, use, residual, measured, predicted) in enumerate(judged()):
        tell(f"leg {done + 1} of {len(segments)}", done, steps)
        errors_of_models = at_once(partial(_error_sums, measured, predicted), predicted)
        for name, errors in zip(predicted, errors_of_models, strict=True):
            for group in groups(key, name):
                sums[group] = sums[group].merge(errors) if group in sums else errors
        motion = RangeCovered.of(matrix(residual, VELOCITY), measured)
        covered[use] = covered[use].merge(motion) if use in covered else motion
        if use == "validation":
            t = clock(residual) + float(segments[key].leg_start_s)
            plots += prediction_plot(segments[key], t, measured, predicted)
            for put_in in dict.fromkeys(("", resting)):
                runs = _free_runs(inputs, params, models, key, put_in)
                if runs is None or inputs.vehicle is None:
                    continue
                free[key, put_in] = runs
                if not put_in:
                    causes = loss_causes(runs, list(models.values()), inputs.vehicle) | causes
    middle = {group: MiddleErrors.between(*total.bracket()) for group, total in sums.items()}
    outside = np.zeros(6)
    for key, use, residual, measured, predicted in judged():
        grown = [{group: middle[group] for group in groups(key, name)} for name in predicted]
        work = partial(_with_errors, measured, predicted)
        for own in at_once(work, list(zip(predicted, grown, strict=True))):
            middle |= own
        if use == "validation" and "training" in covered:
            outside += covered["training"].left_by(matrix(residual, VELOCITY))
    errors_of = {
        group: sums[group].measures(middle[group].medians(sums[group].n))
        for group in sorted(sums, key=lambda group: group[1] != ALL)
    }
    error_table = error_rows(errors_of, cards)
    free_run = free_run_table(free, list(models))
    per_one = _samples_per_one(inputs, models[reference_model(cards)], segments)
    tell("each model by itself", len(segments), steps)
    ranking = rank(
        cards,
        error_table.to_pylist(),
        free_run.to_pylist(),
        per_one,
        check=partial(_motion_checks, inputs, params, models, cards),
        constant=constant_ratios(covered),
    )
    tell("draws of the chosen model", steps - len(segments), steps)
    flights, flight_parts = _flights(inputs, params, models, cards, ranking.choice, per_one)
    titles = {name: card.title for name, card in cards.items()}
    return Outputs(
        predictions=Collection(
            {key: partial(_predictions, inputs, models, key) for key in segments}
        ),
        error_table=error_table,
        error_metrics=error_metrics(errors_of),
        free_run=free_run,
        ranking=ranking,
        tables_text=tables_as_text(errors_of, cards, covered).encode("utf-8"),
        section=validate_section(
            errors_of,
            cards,
            covered,
            outside,
            [
                *free_run_blocks(free_run, titles, causes),
                *cause_blocks(causes, free_run, titles),
                *plots,
            ],
            first=flight_parts,
            models=ranking.models,
            failed_ratio=params.failed_ratio,
        ),
        simulated_motion={key: flight.table() for key, flight in flights.items()},
        views=validate_views(segments, cards, ranking.choice, list(flights)),
    )


def _motion_checks(
    inputs: Inputs,
    params: Params,
    models: Mapping[str, Predictor],
    cards: Mapping[str, ModelCard],
    names: Sequence[str],
) -> dict[str, MotionCheck]:
    """Return what these models do by themselves, by name; empty where nothing flies."""
    if inputs.vehicle is None or not params.free_run:
        return {}
    floatings = [
        Floating(models[name].vehicle(inputs.vehicle), models[name].viscous, models[name].trim)
        for name in names
    ]
    checks = motion_checks(
        list(zip(floatings, (cards[name] for name in names), strict=True)),
        minimum_speed=params.minimum_speed_m_s,
    )
    return dict(zip(names, checks, strict=True))


def loss_causes(runs: FreeRuns, models: Sequence[Predictor], vehicle: Vehicle) -> dict[str, Growth]:
    """Return the fastest growth over the run that each model loses soonest, by name."""
    return {
        models[i].viscous.name: growth(
            models[i].vehicle(vehicle), models[i].viscous, measured[:, :6], measured[:, TILT_STATES]
        )
        for i, measured in runs.lost_motion.items()
    }


def _error_sums(measured: Array, predicted: Mapping[str, Array], name: str) -> ErrorSums:
    return ErrorSums.of(measured, predicted[name])


def _with_errors(
    measured: Array,
    predicted: Mapping[str, Array],
    model: tuple[str, Mapping[Group, MiddleErrors]],
) -> dict[Group, MiddleErrors]:
    """Return the errors in the middle, by group, with those of one more segment."""
    name, groups = model
    force = predicted[name]
    return {group: errors.add(measured, force) for group, errors in groups.items()}


def _forces(
    inputs: Inputs, models: Mapping[str, Predictor], key: str, residual: pa.Table
) -> Mapping[str, Array]:
    """Return the force (n, 6) of each model on a segment, when it is asked for."""
    fused = _fused(inputs, models, key)
    lags_s = {model.lag_s for model in models.values() if model.lag_s > 0.0}
    late = {lag_s: _late_change(residual, lag_s) for lag_s in lags_s}
    return Collection(
        {name: partial(model.force, residual, fused, late) for name, model in models.items()}
    )


def _late_change(residual: pa.Table, lag_s: float) -> Array:
    """Return tau_U (n, 6) with a lag of the actuators less tau_U without."""
    names = [name for name in ACTUATORS if has_columns(residual, force_columns(name))]
    acting: Array = np.sum([forces(residual, name) for name in names], axis=0)
    step_s = float(np.mean(np.diff(clock(residual))))
    return first_order_lag(acting, lag_s=lag_s, step_s=step_s) - acting


def _fused(inputs: Inputs, models: Mapping[str, Predictor], key: str) -> pa.Table | None:
    """Return the state of a segment where a model's inertia needs it."""
    if inputs.fused is not None and any(model.added_mass.any() for model in models.values()):
        return inputs.fused.part(key, ACCELERATION)
    return None


def _flights(
    inputs: Inputs,
    params: Params,
    models: Mapping[str, Predictor],
    cards: Mapping[str, ModelCard],
    choice: str | None,
    samples_per_one: Mapping[str, float],
) -> tuple[dict[str, FreeFlight], list[Block]]:
    """Return the chosen model's flight over each validation segment, and its blocks."""
    if choice is None or not params.free_run_draws or not _can_fly(inputs, params):
        return {}, []
    assert inputs.fused is not None  # _can_fly
    assert inputs.controls is not None
    assert inputs.vehicle is not None
    segments = {
        key: segment for key, segment in inputs.segment.items() if segment.use == "validation"
    }
    chosen, card = models[choice], cards[choice]
    model = ModelDraws((chosen.viscous,), chosen.trim[None], chosen.added_mass[None])
    draws = draw_models(card, inputs.vehicle, count=params.free_run_draws, seed=SEED)
    window_s = params.free_run_horizons_s[-1]
    windows = sum(math.ceil(segment.duration_s / window_s) for segment in segments.values())
    flights: dict[str, FreeFlight] = {}
    trained = [key for key, segment in inputs.segment.items() if segment.use == "training"]
    usual = _acting_rms(inputs, trained)
    for key, segment in segments.items():
        size, memory = force_errors(card, samples_per_one, 1.0 / segment.rate_hz)
        flight = fly(
            inputs.vehicle,
            model,
            draws,
            measured_motion(inputs.fused[key], inputs.controls[key]),
            window_s=window_s,
            errors=(grown_errors(size, usual, _acting_rms(inputs, [key])), memory),
            windows=windows,
            minimum_speed=params.minimum_speed_m_s,
            lag_s=chosen.lag_s,
        )
        if flight is not None:
            flights[key] = flight
    flights = dict(zip(flights, calibrated(list(flights.values())), strict=True))
    blocks = flight_blocks(choice, card, flights, segments, draws, window_s=window_s)
    return flights, blocks


def _acting_rms(inputs: Inputs, keys: Sequence[str]) -> Array:
    """Return the RMS force (6,) of the actuators over segments [N, N m]."""
    parts = []
    for residual in (inputs.residual.part(key, COLUMNS) for key in keys):
        names = [name for name in ACTUATORS if has_columns(residual, force_columns(name))]
        zero = np.zeros((residual.num_rows, 6))
        parts.append(sum((forces(residual, name) for name in names), zero))
    return np.asarray(np.sqrt(np.mean(np.vstack(parts) ** 2, axis=0)))


def _can_fly(inputs: Inputs, params: Params) -> bool:
    return bool(params.free_run and inputs.fused and inputs.controls and inputs.vehicle)


def _samples_per_one(
    inputs: Inputs, model: Predictor, segments: Mapping[str, SegmentRecord]
) -> dict[str, float]:
    """Return, by axis, how many training samples of a model's residual count as one."""

    def errors(residual: pa.Table, key: str) -> Array:
        force = _forces(inputs, {"model": model}, key, residual)["model"]
        return forces(residual, "tau_bar") - force

    residuals = (
        errors(inputs.residual.part(key, COLUMNS), key)
        for key, segment in segments.items()
        if segment.use == "training"
    )
    if not any(segment.use == "training" for segment in segments.values()):
        return {}
    return dict(zip(AXES, inflation(residuals).tolist(), strict=True))


def _free_runs(
    inputs: Inputs, params: Params, models: Mapping[str, Predictor], key: str, as_measured: str
) -> FreeRuns | None:
    if not _can_fly(inputs, params):
        return None
    assert inputs.fused is not None  # _can_fly
    assert inputs.controls is not None
    assert inputs.vehicle is not None
    return run_segment(
        inputs.vehicle,
        [model.viscous for model in models.values()],
        np.array([model.trim for model in models.values()]),
        np.array([model.added_mass for model in models.values()]),
        measured_motion(inputs.fused[key], inputs.controls[key]),
        horizons_s=params.free_run_horizons_s,
        every_s=params.free_run_every_s,
        minimum_speed=params.minimum_speed_m_s,
        as_measured=as_measured.split(),
        lags_s=np.array([model.lag_s for model in models.values()]),
    )


def _predictions(
    inputs: Inputs, models: Mapping[str, Predictor], key: str
) -> pa.Table | TableParts:
    """Return the forces of all models on a segment; of a long one as it is written."""
    residual = inputs.residual.part(key, COLUMNS)
    predicted, t_s = _forces(inputs, models, key, residual), clock(residual)
    parts = TableParts(partial(_of_models, predicted, key, t_s))
    if len(t_s) * len(models) > LONG_ROWS:
        return parts
    return pa.concat_tables(parts.make()).combine_chunks()


def _of_models(predicted: Mapping[str, Array], segment: str, t_s: Array) -> Iterator[pa.Table]:
    """Yield the forces of one model after another, worked out for a few at once."""
    names = list(predicted)
    for start in range(0, len(names), MODELS_AT_ONCE):
        some = names[start : start + MODELS_AT_ONCE]
        for name, force in zip(some, at_once(predicted.__getitem__, some), strict=True):
            columns: dict[str, Any] = {
                "segment": labels([segment], len(t_s)),
                "model": labels([name], len(t_s)),
                "t_s": t_s,
            }
            yield make_table("predictions", columns | named(force_columns("tau"), force))


STAGE = Stage(
    "validate",
    "Predicted forces and error tables of every model, training and validation",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
)
