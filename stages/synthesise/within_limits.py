"""Structures fitted within physical limits: their cards, from those of least squares.

The six axes are one problem, solved from the triangular factor: damping that takes
energy out, priors for what the data leave open, and inertia where it is asked for.
Verdicts stay those of the data alone; what the data leave open is said to rest on its
bound or on the prior.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from auvid.data_schemas.errors import CampaignError, PipelineError, nearest
from auvid.data_schemas.records.models import (
    AxisCard,
    CovarianceCard,
    InertiaCard,
    InertiaVerdict,
    LimitCard,
    MeasuredPriorCard,
    ModelCard,
    PriorCard,
    TermCard,
)
from auvid.data_schemas.records.priors import PriorSourcesRecord
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import ViscousModel
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.identification.constrained.active_set import Cuts, InequalityRows
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    ForceEquations,
    Unknown,
    added_mass_change,
    added_mass_unknown,
    inertia_equations,
    viscous_equations,
)
from auvid.hydro.identification.constrained.fit import ConstrainedFit, fit_within, force_error
from auvid.hydro.identification.constrained.inertia import inertia_against_lag
from auvid.hydro.identification.constrained.limits import (
    damping_limits,
    flown_box,
    inertia_limits,
)
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.constrained.statuses import (
    AT_BOUND,
    FROM_PRIOR,
    CoefficientStatus,
    moved_far,
    statuses,
)
from auvid.hydro.identification.regression.assumed_figures import inertia_changes, total_error
from auvid.hydro.identification.regression.least_squares import TriangularFactor
from auvid.hydro.identification.regression.normal_changes import NormalChange
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    T_LIMIT,
    WEAK,
    stands_clear,
    strongest,
)
from auvid.hydro.identification.selection.ranking import error_ratios
from auvid.stages.synthesise.model_card import Prior, held_out_card
from auvid.stages.synthesise.training import ForceSolution, others_of

DAMPING = ("free", "negative", "dissipative")
ROUNDING = 1e-9
"""Share of the standard error without limits below which a number is 0."""
CHANGED = 0.1
"""Share of the standard error without limits from which on limits changed a value."""


@dataclass(frozen=True)
class PhysicalLimits:
    """What a structure is fitted within.

    damping: of `DAMPING`; inertia: added masses to fit, as `N_rdot`; prior: means by
    axis and term, with a relative standard deviation; sources: priors of other
    measurements, with the covariance of each.
    """

    damping: str
    inertia: tuple[str, ...]
    prior: Prior
    sources: tuple[NormalPrior, ...] = ()


def within_limits(
    card: ModelCard,
    model: ViscousModel,
    factor: TriangularFactor,
    limits: PhysicalLimits,
    vehicle: Vehicle,
    samples_per_one: Mapping[str, float],
    legs: Mapping[str, TriangularFactor],
    figures: Mapping[str, tuple[NormalChange, ...]],
    without: Mapping[str, ViscousModel],
) -> ModelCard:
    """Return the card of a structure with the coefficients within limits.

    card: of least squares on the same data; its verdicts stay. factor: with the columns
    of `extra_rows` where inertia is fitted. samples_per_one: axis -> how many samples
    of its residual count as one. legs: the factors of the training legs. figures: what
    assumed figures of the vehicle, and an unsteady force, change of the normal equations with
    inertia. without: leg -> the structure that the others choose, where the legs choose the
    terms.
    """
    equations = _equations(model, card, limits)
    noise = _noise(factor, equations, samples_per_one)

    def solver(own: ForceEquations) -> Callable[[TriangularFactor], ConstrainedFit]:
        rows, cuts = _physics(own.unknowns, card, limits, vehicle)
        return partial(
            fit_within,
            equations=own,
            limits=rows,
            cuts=cuts,
            priors=_priors(limits, own.unknowns),
            noise=noise,
        )

    solve = solver(equations)
    fit = solve(factor)
    held_out = {}
    for name, others in others_of(legs).items():
        own = _equations(without[name], card, limits) if name in without else equations
        others_fit = (solve if own is equations else solver(own))(others)
        error = force_error(legs[name], own, others_fit.values)
        held_out[name] = error_ratios(legs[name], error)
    prior = _prior(limits.prior, equations.unknowns)
    values = fit.by_axis()
    moved = {
        name: [fit.shift(equations, change) for change in changes]
        for name, changes in (figures.items() if limits.inertia else ())
    }
    return card.model_copy(
        update={
            "method": "within limits",
            "coverage_on_twins": {},
            "damping": limits.damping,
            "limits": [
                LimitCard(name=item.name, unknowns=[str(u) for u in item.unknowns])
                for item in fit.active
            ],
            "limits_cost": fit.cost,
            "held_out": held_out_card(held_out),
            "inertia": [
                _inertia(name, fit, factor, model, noise, moved, vehicle=vehicle, card=card)
                for name in limits.inertia
            ],
            "axes": {axis: _axis(axis, part, fit) for axis, part in card.axes.items()},
            "predictor": {
                axis: {term: values[axis][term] for term in row}
                for axis, row in card.predictor.items()
            },
            "prior": (
                None
                if prior is None
                else PriorCard.model_validate(
                    {
                        "source": limits.prior.source,
                        "relative_sd": limits.prior.relative_sd,
                        "means": _means(prior),
                    }
                )
            ),
            "measured_priors": [
                _measured_card(item) for item in _measured(limits.sources, equations.unknowns)
            ],
        }
    )


def _equations(model: ViscousModel, card: ModelCard, limits: PhysicalLimits) -> ForceEquations:
    equations = viscous_equations(model, trim=card.trim)
    if limits.inertia:
        equations = equations.with_unknowns_of(inertia_equations(limits.inertia))
    return equations


def _priors(limits: PhysicalLimits, unknowns: Sequence[Unknown]) -> list[NormalPrior]:
    """Return all priors, on those unknowns that a model has."""
    prior = _prior(limits.prior, unknowns)
    return [*([] if prior is None else [prior]), *_measured(limits.sources, unknowns)]


def _measured(sources: Sequence[NormalPrior], unknowns: Sequence[Unknown]) -> list[NormalPrior]:
    """Return priors of other measurements, on those unknowns that a model has."""
    return [used for item in sources if (used := item.of(unknowns)).unknowns]


def with_inertia(
    model: ViscousModel, factor: TriangularFactor, inertia: Sequence[str], *, trim: bool
) -> ForceSolution:
    """Return the force of a structure with added masses fitted, without limits.

    factor: with the columns of `extra_rows`; inertia: as `N_rdot`.
    """
    equations = viscous_equations(model, trim=trim).with_unknowns_of(inertia_equations(inertia))
    fit = fit_within(factor, equations)
    values = dict(zip(fit.unknowns, fit.values.tolist(), strict=True))
    return ForceSolution(fit.by_axis(), added_mass_change(values))


def _physics(
    unknowns: Sequence[Unknown], card: ModelCard, limits: PhysicalLimits, vehicle: Vehicle
) -> tuple[list[InequalityRows], list[Cuts]]:
    """Return the limits as rows, and as cuts that are made while solving."""
    flown = {name: (span.low, span.high) for name, span in card.conditions.items()}
    rows, cuts = damping_limits(unknowns, limits.damping, flown_box(flown))
    inertia = inertia_limits(unknowns, vehicle.added_mass, vehicle.mass_matrix)
    return [*rows, *inertia[0]], [*cuts, *inertia[1]]


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


def normal_priors(
    sources: PriorSourcesRecord | None, models: Mapping[str, ForceEquations]
) -> tuple[NormalPrior, ...]:
    """Return the priors of other measurements; each has a coefficient of a structure.

    models: the structures fitted. Raises `CampaignError` for a prior on none of them.
    """
    priors = []
    fitted = {unknown for equations in models.values() for unknown in equations.unknowns}
    for index, item in enumerate([] if sources is None else sources.sources):
        unknowns = tuple(Unknown(entry.axis, entry.term) for entry in item.terms)
        if not fitted & set(unknowns):
            raise CampaignError(
                "no fitted structure has a coefficient of this prior",
                field=f"priors[{index}]",
                value=", ".join(map(str, unknowns)),
                allowed=sorted(map(str, fitted)),
                remedy=nearest(str(unknowns[0]), map(str, fitted))
                or "Name a structure under stages.synthesise.models; published forms take none.",
            )
        covariance = np.zeros((len(unknowns),) * 2)
        for i, row in enumerate(item.lower):
            covariance[i, : i + 1] = covariance[: i + 1, i] = row
        mean = np.array([entry.value for entry in item.terms])
        priors.append(NormalPrior(f"{item.kind}: {item.file}", unknowns, mean, covariance))
    return tuple(priors)


def refuse_unknown_inertia(names: Sequence[str]) -> None:
    """Raise `CampaignError` for a name of `inertia` that is no added mass."""
    for index, name in enumerate(names):
        try:
            added_mass_unknown(name)
        except PipelineError as fault:
            raise CampaignError(
                fault.message,
                field=f"stages.synthesise.inertia[{index}]",
                value=name,
                allowed="an axis X Y Z K M N and the acceleration of a velocity, as N_rdot",
                remedy=fault.remedy,
            ) from None


def refuse_without_structure(names: Sequence[str], inertia: Sequence[str], source: str) -> None:
    """Raise `CampaignError` for settings of structures where none is fitted.

    names: of the models. source: of the prior; that of strip theory is for all models.
    """
    for field, value in (("inertia", list(inertia)), ("prior", source)):
        if value and value not in ("none", "strip_theory"):
            raise CampaignError(
                "published forms are plain least squares, and no structure is fitted that takes"
                " this",
                field=f"stages.synthesise.{field}",
                value=value,
                remedy=f"Name a structure beside {', '.join(names)} under"
                " stages.synthesise.models, as symmetric, or leave it out.",
            )


def refuse_contradicting_priors(prior: Prior, sources: Sequence[NormalPrior]) -> None:
    """Raise `CampaignError` for two priors of a coefficient that cannot both be true.

    They are apart by more than `T_LIMIT` standard deviations of their difference.
    """
    for (field, one), (other_field, other) in combinations(_all_priors(prior, sources), 2):
        for unknown in one.unknowns:
            if unknown not in other.unknowns:
                continue
            (mean, sd), (other_mean, other_sd) = (
                one.mean_and_sd(unknown),
                other.mean_and_sd(unknown),
            )
            if abs(mean - other_mean) > T_LIMIT * np.hypot(sd, other_sd):
                raise CampaignError(
                    "two priors contradict each other",
                    field=other_field,
                    value=f"{unknown} = {other_mean:.3g} +- {NORMAL_95 * other_sd:.2g} (95 %),"
                    f" {mean:.3g} +- {NORMAL_95 * sd:.2g} by {field}",
                    allowed=f"at most {T_LIMIT:g} standard deviations apart",
                    remedy="Check units and signs of both sources; then leave one out, or widen"
                    " them.",
                )


def prior_conflicts(squares: ModelCard, limited: ModelCard, limits: PhysicalLimits) -> list[str]:
    """Return what priors say otherwise than the training legs, a sentence each.

    squares: the card of least squares, which no prior touches; limited: that of the
    fit with its priors. Only coefficients that the data alone identify count.
    """
    sentences = []
    for _, prior in _all_priors(limits.prior, limits.sources):
        for unknown in prior.unknowns:
            own, weighed = _term_of(squares, unknown), _term_of(limited, unknown)
            if own is None or weighed is None or own.verdict != IDENTIFIED or own.value is None:
                continue
            (mean, sd), error = prior.mean_and_sd(unknown), own.standard_error or 0.0
            deviations = abs(own.value - mean) / np.hypot(sd, error)
            if deviations > T_LIMIT:
                sentences.append(
                    f"{limited.title}: the prior ({prior.source}) of {unknown} is {mean:.3g} +-"
                    f" {NORMAL_95 * sd:.2g} (95 %), the training legs alone say {own.value:.3g} +-"
                    f" {NORMAL_95 * error:.2g}, {deviations:.0f} standard deviations away."
                    f" The model weighs both and has {weighed.value:.3g}. Check unit, sign and"
                    " vehicle of the prior, widen it, or leave it out."
                )
    return sentences


def _term_of(card: ModelCard, unknown: Unknown) -> TermCard | None:
    rows = card.axes[unknown.axis].terms
    return next((item for item in rows if item.term == unknown.term), None)


def refuse_pushing_priors(damping: str, prior: Prior, sources: Sequence[NormalPrior]) -> None:
    """Raise `CampaignError` for a prior of damping that feeds energy in."""
    if damping == "free":
        return
    for field, item in _all_priors(prior, sources):
        for unknown, mean, variance in zip(
            item.unknowns, item.mean.tolist(), np.diag(item.covariance).tolist(), strict=True
        ):
            own = OWN_VELOCITY[unknown.axis]
            if unknown.term in (own, f"{own}*|{own}|") and mean > NORMAL_95 * np.sqrt(variance):
                raise CampaignError(
                    "a prior and the limits on damping contradict each other",
                    field=field,
                    value=f"{unknown} = {mean:.3g} +- {NORMAL_95 * np.sqrt(variance):.2g} (95 %)",
                    allowed=f"0 and less: damping is {damping}",
                    remedy="Damping has a negative sign here: check that of the source, leave the"
                    " prior out, or set stages.synthesise.damping: free.",
                )


def _all_priors(prior: Prior, sources: Sequence[NormalPrior]) -> list[tuple[str, NormalPrior]]:
    """Return field of the campaign and prior, of all that were declared."""
    own = NormalPrior.relative(prior.source, prior.means, relative_sd=prior.relative_sd)
    return [
        ("stages.synthesise.prior", own),
        *((f"priors[{index}]", item) for index, item in enumerate(sources)),
    ]


def _measured_card(used: NormalPrior) -> MeasuredPriorCard:
    source, _, file = used.source.partition(": ")
    means = _means(used)
    order = [used.unknowns.index(Unknown(axis, t)) for axis, row in means.items() for t in row]
    covariance = used.covariance[np.ix_(order, order)].tolist()
    lower = [row[: i + 1] for i, row in enumerate(covariance)]
    return MeasuredPriorCard.model_validate(
        {"source": source, "file": file, "means": means, "lower": lower}
    )


def _means(used: NormalPrior) -> dict[str, dict[str, float]]:
    means: dict[str, dict[str, float]] = {}
    for unknown, mean in zip(used.unknowns, used.mean.tolist(), strict=True):
        means.setdefault(unknown.axis, {})[unknown.term] = mean
    return means


def _axis(axis: str, part: AxisCard, fit: ConstrainedFit) -> AxisCard:
    """Return the axis with values, errors and statuses of the fit within limits."""
    index = [fit.unknowns.index(Unknown(axis, item.term)) for item in part.terms]
    verdicts = {fit.unknowns[i]: item.verdict for i, item in zip(index, part.terms, strict=True)}
    status = statuses(fit, verdicts)
    terms = [
        _term(item, i, fit, status[fit.unknowns[i]])
        for item, i in zip(part.terms, index, strict=True)
    ]
    kept = [i for i in index if fit.covariance[i, i] > 0.0]
    covariance = CovarianceCard(
        terms=[fit.unknowns[i].term for i in kept],
        lower=[[float(fit.covariance[i, j]) for j in kept if j <= i] for i in kept],
        shifts=part.covariance.shifts_of([_free_term(fit.unknowns[i], status) for i in kept]),
    )
    return part.model_copy(
        update={"j": float(fit.rms[AXES.index(axis)]), "terms": terms, "covariance": covariance}
    )


def _free_term(unknown: Unknown, status: Mapping[Unknown, CoefficientStatus]) -> str:
    """Return the term of an unknown, '' for one that a bound or a prior holds."""
    return "" if status[unknown].status in (AT_BOUND, FROM_PRIOR) else unknown.term


def _term(item: TermCard, i: int, fit: ConstrainedFit, status: CoefficientStatus) -> TermCard:
    value, free, error = float(fit.values[i]), float(fit.free[i]), float(fit.standard_errors[i])
    spread = _spread(fit, i)
    value = value if abs(value) > ROUNDING * spread else 0.0
    update: dict[str, object] = {"verdict": strongest(status.status, "within limits")}
    if status.status == AT_BOUND:
        update |= {"value": value, "standard_error": None, "assumed_shifts": {}}
    elif status.status == FROM_PRIOR:
        # Shifts are those of the data alone; the prior holds the value against them.
        update |= {"value": value, "standard_error": error, "assumed_shifts": {}}
    elif item.value is not None:
        # The wider one: least squares also counts errors of the velocities.
        wider = max(error, item.standard_error or 0.0)
        update |= {"value": value, "standard_error": wider}
        shifts = item.assumed_shifts
        stands = stands_clear(value, wider, shifts)
        if status.status == IDENTIFIED and not stands:
            # The data alone were clear, of a value that the limits moved.
            update["verdict"] = WEAK
        if status.status == IDENTIFIED and moved_far(value, free, total_error(wider, shifts)):
            update["verdict"] = WEAK
    if update.get("value") is not None and abs(value - free) > CHANGED * spread:
        update["free_value"] = free
    return item.model_copy(update=update)


def _spread(fit: ConstrainedFit, i: int) -> float:
    """Return the standard error of an unknown without limits."""
    return float(np.sqrt(fit.free_covariance[i, i]))


def _inertia(
    name: str,
    fit: ConstrainedFit,
    factor: TriangularFactor,
    model: ViscousModel,
    noise: Mapping[str, float],
    moved: Mapping[str, Sequence[Array]],
    *,
    vehicle: Vehicle,
    card: ModelCard,
) -> InertiaCard:
    """Return a fitted inertia, and how far a thrust lag could take its place.

    moved: assumed figure -> shifts (p,) of the fit by each of its numbers.
    """
    unknown = added_mass_unknown(name)
    at_bound = statuses(fit, {})[unknown].status == AT_BOUND
    i = fit.unknowns.index(unknown)
    row, column = AXES.index(unknown.axis), ACCELERATIONS.index(unknown.term)
    in_file = float(vehicle.mass_matrix[row, column])
    trade = inertia_against_lag(factor, viscous_equations(model, trim=card.trim), name, noise=noise)
    change, free = float(fit.values[i]), float(fit.free[i])
    error = float(fit.standard_errors[i])
    shifts: dict[str, float] = {}
    for figure, numbers in () if at_bound else moved.items():
        # The file's own entry moves by the figure, too, and the total by the difference.
        spread = vehicle.spreads.get(figure, 0.0)
        own = [item[row, column] for item in inertia_changes(figure, vehicle, spread)]
        own = own or [0.0] * len(numbers)
        shifts[figure] = math.hypot(*(a - b[i] for a, b in zip(own, numbers, strict=True)))
    total = total_error(error, shifts)
    verdict: InertiaVerdict = AT_BOUND if at_bound else trade.verdict
    if verdict == IDENTIFIED and (
        abs(change) <= NORMAL_95 * total or moved_far(change, free, total)
    ):
        verdict = WEAK
    return InertiaCard(
        name=name,
        unit=("kg", "kg*m", "kg*m^2")[(row > 2) + (column > 2)],
        value=in_file - change,
        standard_error=None if at_bound else error,
        free_value=in_file - free if abs(change - free) > CHANGED * _spread(fit, i) else None,
        in_vehicle_file=in_file,
        change=change,
        beside_lag=trade.joint[0],
        beside_lag_error=trade.joint_errors[0],
        lag_s=card.lag_s + trade.joint[1],
        lag_error_s=trade.joint_errors[1],
        correlation=trade.correlation,
        verdict=verdict,
        assumed_shifts=shifts,
    )
