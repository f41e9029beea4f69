"""Fit models once more, to the sensors themselves, by maximum likelihood.

Least squares takes its velocities and its force from one smoother. Here the motion is
simulated instead and compared with every sensor at its own times: by innovations of a
Kalman filter with an unsteady force (filter error), or by free motion from fitted
starts (output error). A fit starts from the card of `synthesise` and keeps its terms,
prior, fitted inertia and limits; noise, biases and a lag of the actuators are found
with it. Where it fails the card of `synthesise` stays, and the reason is said.

By itself (`auto`) a run tries output error for one form, and takes the fit only where its
windows agree: then the form misses nothing that the sensors show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError, nearest
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import FusionRecord, InstallationRecord, SegmentRecord
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.constrained.equations import added_mass_change
from auvid.hydro.identification.maximum_likelihood.estimate import LikelihoodEstimate
from auvid.hydro.identification.maximum_likelihood.gauss_newton import DIVERGES
from auvid.hydro.identification.maximum_likelihood.output_error import WINDOW_S
from auvid.hydro.identification.maximum_likelihood.records import LegRecord, rough_sd
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.selection.folds import parts_of
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.columns import ACCELERATION, ACTUATORS, VELOCITY, clock, force_columns, forces
from auvid.stages.refine.fitting import ESTIMATORS, CardUnknowns, SensorFit, fit_card
from auvid.stages.refine.legs import SegmentSamples, leg_record
from auvid.stages.refine.presentation import refine_section
from auvid.stages.refine.refined_card import refined_card
from auvid.stages.refine.tried_form import disagreeing, likely_form, pushed, too_long
from auvid.stages.sensor_motion import VelocityLogPlacement
from auvid.stages.steps import counted

AUTO, LEAST_SQUARES = "auto", "least_squares"
FEWEST_LEGS = 2
"""A current, a trim or a mounting that lasts for a leg is alike in all its windows."""
MISSED = 3.0
"""Errors of free runs in parts of the samples' scatter, the median of the channels, from
which on they are said to be missed: 1 to 2.8 where a fit converges, 8 under the unsteady
force of the twin of the VT 690.
"""

REMEDIES = {
    "output_error": (
        "Set stages.refine.estimator: filter_error, or a shorter stages.refine.window_s; a model"
        " within limits (a structure, stages.synthesise.damping: dissipative) has a start that"
        " loses energy."
    ),
    "filter_error": (
        "Refine a model within limits (a structure, stages.synthesise.damping: dissipative): its"
        " start loses energy."
    ),
}
"""What helps where the motion diverges at the card of synthesise, by estimator."""


@dataclass(frozen=True)
class Inputs:
    model_card: Collection[ModelCard] = port("model_card", many=True)
    segment: Collection[SegmentRecord] = port("segment", many=True)
    fusion: Collection[FusionRecord] = port("fusion", many=True)
    log_info: Collection[LogInfo] = port("log_info", many=True)
    resampled: Collection[pa.Table] = port("resampled", many=True)
    samples_attitude: Collection[pa.Table] = port("samples_attitude", many=True)
    residual: Collection[pa.Table] = port("residual", many=True)
    fused: Collection[pa.Table] = port("fused", many=True)
    vehicle: Vehicle = port("vehicle")
    samples_imu: Collection[pa.Table] | None = port("samples_imu", many=True, optional=True)
    samples_velocity: Collection[pa.Table] | None = port(
        "samples_velocity", many=True, optional=True
    )
    samples_depth: Collection[pa.Table] | None = port("samples_depth", many=True, optional=True)
    installation: InstallationRecord | None = port("installation", optional=True)


@dataclass(frozen=True)
class Params:
    models: tuple[str, ...] = param(
        "1",
        (),
        meaning=(
            "models of synthesise that are fitted again to the sensors themselves; none: auto"
            " tries the simplest of next to the least BIC on training that loses energy"
        ),
    )
    estimator: str = param(
        "1",
        AUTO,
        meaning=(
            "innovations of a Kalman filter with an unsteady force (filter_error), free motion"
            " from fitted starts (output_error), that where it holds (auto), or neither"
            " (least_squares)"
        ),
        allowed=(AUTO, LEAST_SQUARES, *ESTIMATORS),
    )
    window_s: float = param(
        "s",
        WINDOW_S,
        meaning=(
            "output error only: stretches of so long and more run free, each from its own start; a"
            " shorter leg, of 5 s and more, is one"
        ),
        low=1.0,
        high=10_000.0,
    )
    thrust_lag: bool = param(
        "1",
        True,
        meaning=(
            "fit a lag of the actuators, one for all; false: hold that of synthesise, which is"
            " the vehicle file's (actuators.lag) or that which the training legs show"
        ),
    )


@dataclass(frozen=True)
class Outputs:
    model_card: Mapping[str, ModelCard] = port("model_card", many=True)
    section: Document | None = port("section", optional=True)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return a card `MODEL_ESTIMATOR` for each model that could be fitted.

    Raises `CampaignError` for a model that synthesise did not fit.
    """
    names = params.models
    if params.estimator == AUTO and not names:
        likely = likely_form(inputs.model_card)
        names = () if likely is None else (likely,)
    if params.estimator == LEAST_SQUARES or not names:
        return Outputs({}, None)
    estimator = "output_error" if params.estimator == AUTO else params.estimator
    cards = _chosen(inputs.model_card, names, estimator)
    if params.estimator == AUTO:
        return _where_it_holds(inputs, replace(params, estimator=estimator), cards)
    legs, left_out, warnings = _legs(inputs)
    refined: dict[str, ModelCard] = {}
    for name, card in counted("model", cards.items()):
        try:
            fit = _fit(inputs, params, card, legs)
        except DataError as fault:
            if fault.message == DIVERGES:
                fault.remedy = REMEDIES[params.estimator]
            warnings.append(_kept(card, str(fault)))
            continue
        if fit.estimate.word != "converged":
            warnings.append(_kept(card, _unsettled(fit.estimate, params, legs)))
            continue
        refined[name] = _refined(inputs, params, fit, name, legs, left_out)
    return Outputs(refined, refine_section(inputs.model_card, refined, warnings))


def _where_it_holds(inputs: Inputs, params: Params, cards: Mapping[str, ModelCard]) -> Outputs:
    """Return cards of output error whose windows agree, and why others have none."""
    refined: dict[str, ModelCard] = {}
    notes = []
    for name, card in counted("model", cards.items()):
        fitted = pushed(card) or _doubtful_card(inputs, params, name, card)
        if isinstance(fitted, ModelCard):
            refined[name] = fitted
        else:
            notes.append(
                f"{card.title} keeps the coefficients of least squares, without a fit to the"
                f" sensors themselves (output error): {fitted}."
            )
    return Outputs(refined, refine_section(inputs.model_card, refined, (), notes=notes))


def _doubtful_card(inputs: Inputs, params: Params, name: str, card: ModelCard) -> ModelCard | str:
    """Return the card of a fit that is tried, or why there is none."""
    trained = {item.leg for item in inputs.segment.values() if item.use == "training"}
    if len(trained) < FEWEST_LEGS:
        return "one training leg does not show whether another one agrees"
    legs, left_out, _ = _legs(inputs)
    if left_out:
        return left_out[0]
    words = too_long(CardUnknowns(card, inputs.vehicle, params.thrust_lag), legs)
    if words:
        return words
    try:
        fit = _fit(inputs, params, card, legs, doubtful=True)
        return disagreeing(fit.estimate) or _refined(inputs, params, fit, name, legs, left_out)
    except DataError as fault:
        return fault.message
    except np.linalg.LinAlgError:
        return "the other legs leave a direction of its coefficients open"


def _refined(
    inputs: Inputs,
    params: Params,
    fit: SensorFit,
    name: str,
    legs: Sequence[LegRecord],
    left_out: Sequence[str],
) -> ModelCard:
    return refined_card(
        fit,
        name,
        params.estimator,
        legs,
        dict(zip(AXES, _force_errors(inputs, fit, legs)[0].tolist(), strict=True)),
        _held_out(inputs, fit, legs),
        left_out,
    )


def _chosen(
    cards: Mapping[str, ModelCard], names: Sequence[str], estimator: str
) -> dict[str, ModelCard]:
    """Return the cards to start from, by the names of those to come."""
    field = "stages.refine.models"
    for name in names:
        if name not in cards:
            raise CampaignError(
                "synthesise fits no such model",
                field=field,
                value=name,
                allowed=tuple(cards),
                remedy=nearest(name, cards) or "Name it in stages.synthesise.models too.",
            )
    chosen = {f"{name}_{estimator}": cards[name] for name in names}
    taken = [name for name in chosen if name in cards]
    if taken or len(chosen) < len(names):
        raise CampaignError(
            "a name stands twice among the models", field=field, value=taken or list(names)
        )
    return chosen


def _legs(inputs: Inputs) -> tuple[list[LegRecord], list[str], list[str]]:
    """Return the training legs with all sensors, those without, and what to warn of."""
    legs, left_out, warnings = [], [], []
    for key, segment in inputs.segment.items():
        if segment.use != "training":
            continue
        fusion = inputs.fusion[key]
        samples = SegmentSamples(
            segment,
            fusion,
            inputs.log_info[segment.log],
            inputs.resampled[key],
            inputs.samples_attitude[key],
            *(
                None if tables is None or key not in tables else tables[key]
                for tables in (inputs.samples_imu, inputs.samples_velocity, inputs.samples_depth)
            ),
        )
        estimate = inputs.installation if fusion.installation == "estimate" else None
        record = leg_record(
            samples, inputs.vehicle, VelocityLogPlacement.of(inputs.vehicle, estimate)
        )
        if isinstance(record, str):
            left_out.append(record)
        else:
            legs.append(record)
    warnings += [f"Refine leaves out segment {reason}." for reason in left_out]
    return legs, left_out, warnings


def _fit(
    inputs: Inputs,
    params: Params,
    card: ModelCard,
    legs: Sequence[LegRecord],
    *,
    doubtful: bool = False,
) -> SensorFit:
    if not legs:
        raise DataError("no training leg has all the sensors that are needed")
    gyro_bias = {
        leg.name: inputs.fusion[leg.name].gyro_bias_rad_s or [0.0, 0.0, 0.0] for leg in legs
    }
    problem = CardUnknowns(card, inputs.vehicle, params.thrust_lag)
    try:
        return fit_card(
            problem,
            legs,
            gyro_bias,
            estimator=params.estimator,
            window_s=params.window_s,
            doubtful=doubtful,
        )
    except np.linalg.LinAlgError:
        raise DataError("the data leave a direction of the coefficients open") from None


def _unsettled(estimate: LikelihoodEstimate, params: Params, legs: Sequence[LegRecord]) -> str:
    """Return why a fit ended without convergence, as far as its errors tell."""
    words = f"the iteration did not converge in {len(estimate.log_likelihood) - 1} steps."
    if params.estimator != "output_error":
        return words
    away = estimate.channel_residuals * estimate.noise.sensor_sd / rough_sd(list(legs))
    middle = float(np.nanmedian(away))  # drift of one sensor is no scatter
    if middle <= MISSED:
        return words
    return (
        f"{words} Its free runs miss the samples by {middle:.0f} times their"
        " scatter (median of the channels): they do not explain an unsteady force. Use"
        " stages.refine.estimator: filter_error."
    )


def _kept(card: ModelCard, reason: str) -> str:
    return (
        f"{card.title}: not fitted to the sensors, the card of synthesise stays."
        f" {reason[0].upper()}{reason[1:]}"
    )


def _held_out(
    inputs: Inputs, fit: SensorFit, legs: Sequence[LegRecord]
) -> dict[str, dict[str, float | None]]:
    """Return part of the legs -> axis or all -> J/J0 on it from the others' fit.

    By the parts that synthesise leaves out in turn, so that models compare.
    """
    parts: dict[str, list[int]] = {}
    for number, part in enumerate(parts_of([inputs.segment[leg.name].leg for leg in legs])):
        parts.setdefault(part, []).append(number)
    if len(parts) < 2:
        return {}
    ratios = {}
    for part, numbers in parts.items():
        error, force = _force_errors(inputs, fit.without(numbers), [legs[i] for i in numbers])
        top = np.append(np.sqrt(np.mean(error**2)), error)
        bottom = np.append(np.sqrt(np.mean(force**2)), force)
        ratios[part] = {
            axis: float(a / b) if b > 0.0 else None
            for axis, a, b in zip(("all", *AXES), top, bottom, strict=True)
        }
    return ratios


def _force_errors(inputs: Inputs, fit: SensorFit, legs: Sequence[LegRecord]) -> tuple[Array, Array]:
    """Return RMS error (6,) of the residual force on the legs, and its RMS [N, N m].

    tau_bar is formed with the inertia of the vehicle file and actuators without a lag,
    so a model with other ones also predicts dM_A nu_dot + C(dM_A, nu) nu, and tau_U with
    its lag less tau_U without.
    """
    terms = {
        axis: {term: value for term, value in row.items() if term != CONSTANT}
        for axis, row in fit.predictor.items()
    }
    constant = np.array([fit.predictor.get(axis, {}).get(CONSTANT, 0.0) for axis in AXES])
    problem = fit.problem
    change = added_mass_change(
        {u: float(fit.limited.values[problem.unknowns.index(u)]) for u in problem.inertia}
    )
    lag_s = fit.lag_s
    squares, forces_squared, n = np.zeros(6), np.zeros(6), 0
    for leg in legs:
        residual = inputs.residual[leg.name]
        nu, nu_dot = matrix(residual, VELOCITY), matrix(inputs.fused[leg.name], ACCELERATION)
        ratio: Array | None = None
        if has_columns(residual, ("eta_ratio",)):
            ratio = column(residual, "eta_ratio")
        force = constant + IdentifiedModel("refined", terms).force(nu, ratio)
        force = force + nu_dot @ change.T + coriolis_force(change, nu)
        names = [name for name in ACTUATORS if has_columns(residual, force_columns(name))]
        acting = np.sum([forces(residual, name) for name in names], axis=0)
        step_s = float(np.mean(np.diff(clock(residual))))
        force = force + first_order_lag(acting, lag_s=lag_s, step_s=step_s) - acting
        tau_bar = forces(residual, "tau_bar")
        squares += np.sum((tau_bar - force) ** 2, axis=0)
        forces_squared += np.sum(tau_bar**2, axis=0)
        n += len(nu)
    return np.sqrt(squares / n), np.sqrt(forces_squared / n)


STAGE = Stage(
    "refine",
    "Fit models once more, to the sensors themselves, by maximum likelihood",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
    no_views="coefficients are no signals: they stand in its tables",
)
