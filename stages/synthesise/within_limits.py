"""Structures fitted within physical limits: their cards, from those of least squares.

The six axes are one problem, solved from the triangular factor: damping that takes
energy out, priors for what the data leave open, and inertia where it is asked for.
Verdicts stay those of the data alone; what the data leave open is said to rest on its
bound or on the prior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auvid.data_schemas.records.models import (
    AxisCard,
    CovarianceCard,
    InertiaCard,
    LimitCard,
    ModelCard,
    PriorCard,
    TermCard,
)
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import ViscousModel
from auvid.hydro.identification.constrained.active_set import Cuts, InequalityRows
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    ALL_AXES,
    LAG,
    ForceEquations,
    Unknown,
    added_mass_unknown,
    inertia_equations,
    lag_equations,
    viscous_equations,
)
from auvid.hydro.identification.constrained.fit import ConstrainedFit, fit_within
from auvid.hydro.identification.constrained.limits import (
    added_mass_bounds,
    damping,
    dissipation,
    dissipation_cuts,
    envelope,
    linear_dissipation,
    positive_inertia,
)
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.regression.least_squares import TriangularFactor
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, T_LIMIT
from auvid.stages.synthesise.model_card import Prior

DAMPING = ("free", "negative", "dissipative")
ONE_PARAMETER = 0.95
"""Correlation from which on inertia and thrust lag count as one parameter."""


@dataclass(frozen=True)
class Limits:
    """What a structure is fitted within.

    damping: of `DAMPING`; inertia: added masses to fit, as `N_rdot`; prior: means by
    axis and term, with a relative standard deviation.
    """

    damping: str
    inertia: tuple[str, ...]
    prior: Prior


def within_limits(
    card: ModelCard,
    model: ViscousModel,
    factor: TriangularFactor,
    limits: Limits,
    vehicle: Vehicle,
    samples_per_one: Mapping[str, float],
) -> ModelCard:
    """Return the card of a structure with the coefficients within limits.

    card: of least squares on the same data; its verdicts stay. factor: with the columns
    of `extra_rows` where inertia is fitted. samples_per_one: axis -> how many samples
    of its residual count as one.
    """
    equations = viscous_equations(model, trim=card.trim)
    if limits.inertia:
        equations = equations.with_unknowns_of(inertia_equations(limits.inertia))
    noise = _noise(factor, equations, samples_per_one)
    prior = _prior(limits.prior, equations.unknowns)
    rows, cuts = _physics(equations.unknowns, card, limits, vehicle)
    fit = fit_within(
        factor,
        equations,
        limits=rows,
        cuts=cuts,
        priors=[] if prior is None else [prior],
        noise=noise,
    )
    values = fit.by_axis()
    return card.model_copy(
        update={
            "method": "within limits",
            "damping": limits.damping,
            "limits": [
                LimitCard(name=item.name, unknowns=[str(u) for u in item.unknowns])
                for item in fit.active
            ],
            "limits_cost": fit.cost,
            "inertia": [
                _inertia(name, fit, factor, equations, noise, vehicle) for name in limits.inertia
            ],
            "axes": {axis: _axis(axis, part, fit, prior) for axis, part in card.axes.items()},
            "predictor": {
                axis: {term: values[axis][term] for term in row}
                for axis, row in card.predictor.items()
            },
            "prior": None if prior is None else _prior_card(limits.prior, prior),
        }
    )


def _physics(
    unknowns: Sequence[Unknown], card: ModelCard, limits: Limits, vehicle: Vehicle
) -> tuple[list[InequalityRows], list[Cuts]]:
    """Return the limits as rows, and as cuts that are made while solving."""
    rows: list[InequalityRows] = []
    cuts: list[Cuts] = []
    if limits.damping != "free":
        rows.append(damping(unknowns))
    if limits.damping == "dissipative":
        viscous = [u for u in unknowns if u.term not in ACCELERATIONS and u.term != "constant"]
        if all(u.term in VELOCITIES for u in viscous):
            cuts.append(linear_dissipation(unknowns))
        else:
            # Alike in both directions: a hull is not to gain energy astern either.
            flown = [card.conditions[name] for name in VELOCITIES]
            high = np.array([max(abs(item.low), abs(item.high)) for item in flown])
            rows.append(dissipation(unknowns, envelope(-high, high)))
            cuts.append(dissipation_cuts(unknowns, -high, high))
    if limits.inertia:
        rows.append(added_mass_bounds(unknowns, vehicle.added_mass))
        cuts.append(positive_inertia(unknowns, vehicle.mass_matrix))
    return rows, cuts


def _noise(
    factor: TriangularFactor, equations: ForceEquations, samples_per_one: Mapping[str, float]
) -> dict[str, float]:
    """Return the force error (by axis) of one independent sample [N, N m]."""
    rms = fit_within(factor, equations).rms
    return {axis: float(rms[i] * np.sqrt(samples_per_one[axis])) for i, axis in enumerate(AXES)}


def _prior(prior: Prior, unknowns: Sequence[Unknown]) -> NormalPrior | None:
    """Return the prior on those unknowns that the model has; None for none."""
    values = {
        Unknown(axis, term): (mean, prior.relative_sd * abs(mean))
        for axis, row in prior.means.items()
        for term, mean in row.items()
        if mean != 0.0 and Unknown(axis, term) in unknowns
    }
    return NormalPrior.independent(prior.source, values) if values else None


def _prior_card(prior: Prior, used: NormalPrior) -> PriorCard:
    means: dict[str, dict[str, float]] = {}
    for unknown, mean in zip(used.unknowns, used.mean.tolist(), strict=True):
        means.setdefault(unknown.axis, {})[unknown.term] = mean
    return PriorCard.model_validate(
        {"source": prior.source, "relative_sd": prior.relative_sd, "means": means}
    )


def _axis(axis: str, part: AxisCard, fit: ConstrainedFit, prior: NormalPrior | None) -> AxisCard:
    """Return the axis with values, errors and verdicts of the fit within limits."""
    at_bound = {item.unknowns[0] for item in fit.active if len(item.unknowns) == 1}
    index = [fit.unknowns.index(Unknown(axis, item.term)) for item in part.terms]
    terms = [
        _term(item, i, fit, at_bound=fit.unknowns[i] in at_bound, prior=prior)
        for item, i in zip(part.terms, index, strict=True)
    ]
    kept = [i for i in index if fit.covariance[i, i] > 0.0]
    covariance = CovarianceCard(
        terms=[fit.unknowns[i].term for i in kept],
        lower=[[float(fit.covariance[i, j]) for j in kept if j <= i] for i in kept],
    )
    return part.model_copy(
        update={"j": float(fit.rms[AXES.index(axis)]), "terms": terms, "covariance": covariance}
    )


def _term(
    item: TermCard, i: int, fit: ConstrainedFit, *, at_bound: bool, prior: NormalPrior | None
) -> TermCard:
    value, free, error = float(fit.values[i]), float(fit.free[i]), float(fit.standard_errors[i])
    changed = free if abs(value - free) > 1e-6 * max(abs(free), abs(value)) else None
    if at_bound:
        update = {"value": value, "standard_error": None, "verdict": "at its bound"}
    elif item.verdict == IDENTIFIED:
        # The wider one: least squares also counts errors of the velocities.
        update = {"value": value, "standard_error": max(error, item.standard_error or 0.0)}
    elif prior is not None and fit.unknowns[i] in prior.unknowns:
        update = {"value": value, "standard_error": error, "verdict": "from the prior"}
    else:
        update = {} if item.value is None else {"value": value, "standard_error": error}
    return item.model_copy(update={**update, "free_value": changed if update else None})


def _inertia(
    name: str,
    fit: ConstrainedFit,
    factor: TriangularFactor,
    equations: ForceEquations,
    noise: Mapping[str, float],
    vehicle: Vehicle,
) -> InertiaCard:
    """Return a fitted inertia, and how far a thrust lag could take its place."""
    unknown = added_mass_unknown(name)
    i = fit.unknowns.index(unknown)
    row, column = AXES.index(unknown.axis), ACCELERATIONS.index(unknown.term)
    in_file = float(vehicle.mass_matrix[row, column])
    total, error = in_file - float(fit.values[i]), float(fit.standard_errors[i])
    lag, correlation = None, None
    axis_lag = Unknown(ALL_AXES, LAG)
    both = fit_within(factor, equations.with_unknowns_of(lag_equations()), noise=noise)
    if np.isfinite(both.data_variances[both.unknowns.index(axis_lag)]):
        j, k = both.unknowns.index(unknown), both.unknowns.index(axis_lag)
        lag = float(both.values[k])
        correlation = float(
            both.covariance[j, k] / np.sqrt(both.covariance[j, j] * both.covariance[k, k])
        )
    if correlation is not None and abs(correlation) > ONE_PARAMETER:
        verdict: Literal["identified", "weak", "inseparable"] = "inseparable"
    else:
        verdict = "identified" if abs(fit.values[i]) >= T_LIMIT * error else "weak"
    return InertiaCard(
        name=name,
        unit="kg" if row < 3 and column < 3 else "kg*m^2" if row > 2 and column > 2 else "kg*m",
        value=total,
        standard_error=error,
        in_vehicle_file=in_file,
        change=float(fit.values[i]),
        lag_s=lag,
        lag_correlation=correlation,
        verdict=verdict,
    )
