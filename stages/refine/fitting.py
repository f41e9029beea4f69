"""One model fitted to the sensors, from its card: unknowns, start, prior and limits."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auvid.data_schemas.records.models import MeasuredPriorCard, ModelCard
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.identification.constrained.active_set import Cuts, InequalityRows
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    ALL_AXES,
    LAG,
    Unknown,
    added_mass_unknown,
)
from auvid.hydro.identification.constrained.estimates import LimitedEstimate, nearest_within
from auvid.hydro.identification.constrained.limits import (
    damping_limits,
    flown_box,
    inertia_limits,
)
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.maximum_likelihood.estimate import LikelihoodEstimate
from auvid.hydro.identification.maximum_likelihood.filter_error import fit_filter_error
from auvid.hydro.identification.maximum_likelihood.likelihood import NoiseModel
from auvid.hydro.identification.maximum_likelihood.output_error import fit_output_error
from auvid.hydro.identification.maximum_likelihood.parameters import (
    ParameterPrior,
    UnknownParameters,
)
from auvid.hydro.identification.maximum_likelihood.records import LegRecord, rough_sd
from auvid.hydro.identification.regression.verdicts import INSEPARABLE

ESTIMATORS = ("filter_error", "output_error")
FIRST_LAG_S, LONGEST_LAG_S = 0.05, 1.0
FIRST_FORCE_TIME_S = 0.5
MOST_MISSED, MOST_STEPS = 1.05, 60
"""What free runs of a doubtful fit may miss the samples by, in parts of their scatter, after
its first steps: 1.00 where the form has the truth, 1.10 to 1.12 where it nearly has. Steps
allowed to it: a fit that holds converges in 11 to 22.
"""
SMALLEST_FORCE = 1e-3
"""Smallest unsteady force to start from: so much of the axis's inertia times 1 m/s^2."""


@dataclass(frozen=True)
class CardUnknowns:
    """The unknowns of a model card on a vehicle, with start, prior and limits.

    `lag`: whether a lag of the actuators is one of them; else that of the card is held.
    """

    card: ModelCard
    vehicle: Vehicle
    lag: bool

    @cached_property
    def terms(self) -> dict[str, tuple[str, ...]]:
        """Return axis -> terms fitted: all but those at 0 for one of their group."""
        stand_ins = {
            (axis, item.term)
            for axis, part in self.card.axes.items()
            for item in part.terms
            if item.verdict == INSEPARABLE and self.card.predictor[axis][item.term] == 0.0
        }
        return {
            axis: tuple(term for term in row if (axis, term) not in stand_ins)
            for axis, row in self.card.predictor.items()
        }

    @cached_property
    def inertia(self) -> tuple[Unknown, ...]:
        """Return the added masses fitted beside them."""
        return tuple(added_mass_unknown(item.name) for item in self.card.inertia)

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Return the unknowns in the order of the parameters."""
        viscous = [Unknown(axis, term) for axis, row in self.terms.items() for term in row]
        lag = [Unknown(ALL_AXES, LAG)] if self.lag else []
        return (*viscous, *self.inertia, *lag)

    @cached_property
    def parameters(self) -> UnknownParameters:
        """Return what the estimator fits; damping and inertia keep their signs."""
        entries = tuple((AXES.index(u.axis), ACCELERATIONS.index(u.term)) for u in self.inertia)
        upper = {LAG: LONGEST_LAG_S}
        if self.card.damping != "free":
            for axis, own in OWN_VELOCITY.items():
                upper |= {f"{axis} {own}": 0.0, f"{axis} {own}*|{own}|": 0.0}
        rigid = self.vehicle.rigid_body_mass
        return UnknownParameters(
            self.vehicle,
            self.terms,
            inertia=entries,
            lag=self.lag,
            held_lag_s=self.card.lag_s,
            # Added mass can only add to the diagonal of the rigid body's inertia.
            lower={f"M[{i},{j}]": float(rigid[i, j]) for i, j in entries if i == j},
            upper=upper,
        )

    @property
    def start(self) -> dict[str, float]:
        """Return the card's values by the names of the parameters."""
        start = {
            f"{axis} {term}": self.card.predictor[axis][term]
            for axis, row in self.terms.items()
            for term in row
        }
        for (i, j), item in zip(self.parameters.inertia, self.card.inertia, strict=True):
            start[f"M[{i},{j}]"] = item.value
        lags = [self.card.lag_s, *(item.lag_s for item in self.card.inertia)]
        first = next((lag for lag in lags if 0.0 < lag < LONGEST_LAG_S), FIRST_LAG_S)
        return start | {LAG: first}

    @property
    def prior(self) -> ParameterPrior | None:
        """Return the card's priors on its coefficients as one; None for none."""
        own, parts = self.card.prior, [_measured(item) for item in self.card.measured_priors]
        if own is not None:
            spread = own.relative_sd
            parts.append(NormalPrior.relative(own.source, own.means, relative_sd=spread))
        used = [part for item in parts if (part := item.of(self.unknowns)).unknowns]
        if not used:
            return None
        rows = np.vstack([part.rows(self.unknowns) for part in used])
        mean = np.asarray(np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)[0], np.float64)
        return ParameterPrior(mean, rows[:, :-1].T @ rows[:, :-1])

    def noise(self, legs: Sequence[LegRecord]) -> NoiseModel:
        """Return sensors as their samples scatter, and the force that the card left."""
        floor = SMALLEST_FORCE * np.diag(self.vehicle.mass_matrix)
        left = np.maximum([self.card.axes[axis].j or 0.0 for axis in AXES], floor)
        force = np.tile(left, (len(legs), 1))
        return NoiseModel(rough_sd(list(legs)), force, np.full(6, FIRST_FORCE_TIME_S))

    def physical(self, theta: Array) -> Array:
        """Return theta (k,) with added mass beyond the file's in place of inertia."""
        values = theta.copy()
        for number, (i, j) in enumerate(self.parameters.inertia):
            place = len(theta) - len(self.inertia) - self.lag + number
            values[place] = self.vehicle.mass_matrix[i, j] - theta[place]
        return values

    @property
    def signs(self) -> Array:
        """Return d(physical)/d(theta) (k,)."""
        return np.where([unknown in self.inertia for unknown in self.unknowns], -1.0, 1.0)

    def limits(self) -> tuple[list[InequalityRows], list[Cuts]]:
        """Return the limits of the card on physical values, as rows and as cuts."""
        flown = {name: (span.low, span.high) for name, span in self.card.conditions.items()}
        rows, cuts = damping_limits(self.unknowns, self.card.damping, flown_box(flown))
        vehicle = self.vehicle
        inertia = inertia_limits(self.unknowns, vehicle.added_mass, vehicle.mass_matrix)
        return [*rows, *inertia[0]], [*cuts, *inertia[1]]


@dataclass(frozen=True)
class SensorFit:
    """What an estimator found, and its values moved within the limits."""

    problem: CardUnknowns
    estimate: LikelihoodEstimate
    limited: LimitedEstimate

    @property
    def predictor(self) -> dict[str, dict[str, float]]:
        """Return axis -> term -> coefficient within limits, those not fitted at 0."""
        values = dict(zip(self.problem.unknowns, self.limited.values.tolist(), strict=True))
        return {
            axis: {term: values.get(Unknown(axis, term), 0.0) for term in row}
            for axis, row in self.problem.card.predictor.items()
        }

    @property
    def lag_s(self) -> float:
        """Return the lag of the actuators [s], the card's where none was fitted."""
        return float(self.limited.values[-1]) if self.problem.lag else self.problem.card.lag_s

    def without(self, legs: Collection[int]) -> SensorFit:
        """Return the fit to all other legs, one step away, within the same limits."""
        theta = self.estimate.without(legs)
        return replace(self, limited=_within_limits(self.problem, self.estimate, theta))

    @property
    def covariance(self) -> Array:
        """Return the covariance (k, k) of physical values, nan where one is fixed."""
        return self.estimate.covariance * np.outer(self.problem.signs, self.problem.signs)


def _measured(item: MeasuredPriorCard) -> NormalPrior:
    """Return the prior of another measurement."""
    values = {Unknown(axis, t): mean for axis, row in item.means.items() for t, mean in row.items()}
    covariance = np.zeros((len(values),) * 2)
    for i, row in enumerate(item.lower):
        covariance[i, : i + 1] = covariance[: i + 1, i] = row
    mean = np.array(list(values.values()))
    return NormalPrior(item.source, tuple(values), mean, covariance)


def fit_card(
    problem: CardUnknowns,
    legs: Sequence[LegRecord],
    gyro_bias: Mapping[str, Sequence[float]],
    *,
    estimator: str,
    window_s: float,
    doubtful: bool = False,
) -> SensorFit:
    """Return the model of a card fitted to the sensors of legs.

    gyro_bias: leg -> bias [rad/s] in body axes to start from. doubtful: whether output error
    ends early where its free runs miss the samples. Raises `DataError` where
    the start diverges, windows are longer than all legs, or samples are too few.
    """
    biases = np.zeros((len(legs), 6))
    biases[:, 3:] = [gyro_bias[leg.name] for leg in legs]
    parameters, start = problem.parameters, problem.start
    if estimator == "filter_error":
        estimate = fit_filter_error(
            legs, parameters, start, prior=problem.prior, biases=biases, noise=problem.noise(legs)
        )
    else:
        estimate = fit_output_error(
            legs,
            parameters,
            start,
            prior=problem.prior,
            biases=biases,
            window_s=window_s,
            most_missed=MOST_MISSED if doubtful else None,
            most_steps=MOST_STEPS if doubtful else None,
        )
    return SensorFit(problem, estimate, _within_limits(problem, estimate, estimate.theta))


def _within_limits(
    problem: CardUnknowns, estimate: LikelihoodEstimate, theta: Array
) -> LimitedEstimate:
    """Return physical values of theta (k,), moved within limits by the information."""
    values, signs = problem.physical(theta), problem.signs
    rows, cuts = problem.limits()
    if not rows and not cuts:
        return LimitedEstimate(values, (), 0.0)
    metric = estimate.information_covariance * np.outer(signs, signs)
    return nearest_within(problem.unknowns, values, metric, rows, cuts)
