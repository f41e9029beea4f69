"""The model card: coefficients, verdicts and errors of one model, axis by axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auvid.data_schemas.records.models import (
    AxisCard,
    CovarianceCard,
    ModelCard,
    PriorCard,
    TermCard,
    TermCombination,
    VelocityRange,
)
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.dynamics.viscous.models import Coefficients, ViscousModel
from auvid.hydro.identification.regression.assumed_figures import FORM, UNSTEADY
from auvid.hydro.identification.regression.excitation import VelocityExcitation
from auvid.hydro.identification.regression.lacking_terms import moved_by_terms
from auvid.hydro.identification.regression.least_squares import CONSTANT, AxisFit
from auvid.hydro.identification.regression.normal_changes import (
    NormalChange,
    TrueEquations,
    shifts,
    widened,
)
from auvid.hydro.identification.regression.prior import posterior
from auvid.hydro.identification.regression.separability import judge_with_motion
from auvid.hydro.identification.regression.verdicts import (
    INSEPARABLE,
    LEAST_SQUARES_COVERAGE,
    NOT_EXCITED,
    strongest,
)
from auvid.stages.columns import AXIS_UNITS
from auvid.stages.synthesise.training import Coloured, DataErrors, TrainingData

HeldOut = Mapping[str, Array]
"""Training leg left out -> its J/J0 (7,), of `error_ratios`."""
VELOCITY_OF_AXIS = dict(zip(AXES, "uvwpqr", strict=True))


@dataclass(frozen=True)
class Prior:
    """Prior means of some coefficients, with a standard deviation relative to each."""

    source: str
    relative_sd: float
    means: Coefficients


def model_card(
    model: ViscousModel,
    *,
    declared: ViscousModel,
    data: TrainingData,
    fits: Mapping[str, tuple[AxisFit, Coloured]],
    lacking: Mapping[str, tuple[str, ...]],
    unsteady: Sequence[NormalChange],
    turns: Mapping[str, Mapping[str, tuple[str, ...]]],
    left_out: Sequence[str],
    vehicle: Vehicle,
    prior: Prior,
    trim: bool,
    held_out: HeldOut,
) -> ModelCard:
    """Return the card of a model from its fits and their errors, by axis.

    lacking: terms that the form lacks, by axis. unsteady: what the force error does by the
    motion that it causes.
    `declared`: the model before its propeller terms were left out. turns: by axis, of
    `sign_turns` over the training legs `left_out` in turn. held_out: J/J0 on each of
    them, as `error_ratios`.
    """
    axes, predictor, used, rank = {}, {}, {}, 0
    for axis, (fit, coloured) in fits.items():
        equations = data.errors.equations(fit)
        covariance = about_the_truth(equations, coloured, data.errors)
        figures = data.errors.shifts(fit, equations)
        if axis in lacking:
            figures[FORM] = moved_by_terms(data.factor, fit, lacking[axis])[None]
        if unsteady:
            figures[UNSTEADY] = _beyond_errors(fit, unsteady, data.errors)
        means = {
            term: value for term, value in prior.means.get(axis, {}).items() if term in fit.terms
        }
        after, wide = posterior(
            data.factor, fit, covariance, means, relative_sd=prior.relative_sd, trim=trim
        )
        axes[axis] = _axis_entry(
            fit, covariance, after, wide, data.motion, turns[axis], figures
        ).model_copy(
            update={
                "samples_per_one": coloured.samples_per_one,
                "lacking": list(lacking.get(axis, ())),
            }
        )
        predictor[axis] = dict(zip(after.terms, after.solution.tolist(), strict=True))
        if means:
            used[axis] = means
        rank += fit.rank - (CONSTANT in fit.terms and CONSTANT not in fit.zero_terms)
    return ModelCard(
        name=model.name,
        title=model.title,
        vehicle=vehicle.name,
        source=model.source,
        n_bar=model.n_bar,
        n_bar_declared=declared.n_bar,
        rank=rank,
        samples=data.factor.n_samples,
        trim=trim,
        velocity_errors=data.errors.velocities is not None,
        left_out=list(left_out),
        coverage_on_twins=dict(LEAST_SQUARES_COVERAGE),
        assumed=list(vehicle.assumed),
        spreads=dict(vehicle.spreads),
        axes=axes,
        not_applicable=[
            f"{axis} {term}"
            for axis, terms in declared.terms.items()
            for term in terms
            if term not in model.terms.get(axis, ())
        ],
        conditions={
            name: VelocityRange(
                rms=item.rms, low=item.low, high=item.high, threshold=item.threshold
            )
            for name, item in data.motion.items()
        },
        predictor=predictor,
        held_out=held_out_card(held_out),
        prior=(
            PriorCard(source="strip_theory", relative_sd=prior.relative_sd, means=used)
            if used
            else None
        ),
    )


def about_the_truth(equations: TrueEquations, coloured: Coloured, errors: DataErrors) -> Array:
    """Return the covariance (k, k) by noise and errors of velocities and filters.

    Errors of velocities and splines, which both lean least squares to one side, count as one
    shift (decision 0107).
    """
    one_sided = (*(errors.velocities or ()), *errors.smoothing)
    lean = np.zeros(len(equations.fit.terms))
    for change in one_sided:
        lean += equations.shift(change)
    low_pass = shifts(errors.low_pass, equations.fit)
    return widened(equations.noise(coloured.covariance), [lean, *low_pass])


def _beyond_errors(fit: AxisFit, unsteady: Sequence[NormalChange], errors: DataErrors) -> Array:
    """Return how far an unsteady force moves a fit (6, k), by each velocity.

    Less what an error of that velocity does: the past of that error's force is the error.
    """
    moved = shifts(unsteady, fit)
    return moved if errors.velocities is None else moved - shifts(errors.velocities, fit)


def held_out_card(ratios: HeldOut) -> dict[str, dict[str, float | None]]:
    """Return leg -> axis or all -> J/J0 of `error_ratios`; null for no force."""
    return {
        leg: dict(zip(("all", *AXES), map(_finite, row.tolist()), strict=True))
        for leg, row in ratios.items()
    }


def _axis_entry(
    fit: AxisFit,
    covariance: Array,
    after: AxisFit,
    wide: Array,
    motion: Mapping[str, VelocityExcitation],
    turns: Mapping[str, tuple[str, ...]],
    figures: Mapping[str, Array],
) -> AxisCard:
    """Return what the data say of every term of one axis.

    Verdicts are of `fit` with `covariance`; numbers and errors are those with the
    prior, `after` with `wide`. figures: assumed figure -> shifts (c, k) by one standard
    deviation of each of its c numbers.
    """
    sizes = {name: np.linalg.norm(shifts, axis=0) for name, shifts in figures.items()}
    verdicts, determined = judge_with_motion(
        fit, motion, covariance=covariance, turns=turns, figures=sizes
    )
    errors = np.sqrt(np.maximum(np.diag(wide), 0.0))
    summed = {term for item in determined for term in item.weights}
    terms = []
    for index, term in enumerate(fit.terms):
        verdict = verdicts[term]
        has_number = (
            verdict.status != NOT_EXCITED
            and term not in summed
            and bool(np.isfinite(fit.coefficients[index]))
        )
        terms.append(
            TermCard(
                term=term,
                unit=coefficient_unit(fit.axis, term),
                value=float(after.solution[index]) if has_number else None,
                standard_error=_finite(errors[index]) if has_number else None,
                verdict=strongest(verdict.status, "least squares"),
                inseparable_from=(
                    list(verdict.partners) if verdict.status == INSEPARABLE else None
                ),
                assumed_shifts=(
                    {name: float(size[index]) for name, size in sizes.items()} if has_number else {}
                ),
                turns_without=list(turns[term]) if has_number and term in turns else None,
            )
        )
    return AxisCard(
        unit=AXIS_UNITS[fit.axis],
        samples=fit.n_samples,
        rank=fit.rank,
        condition=_finite(fit.condition),
        j0=fit.j0,
        j=after.rms,
        excitation=excitation_word(motion[VELOCITY_OF_AXIS[fit.axis]]),
        terms=terms,
        combinations=[
            TermCombination(
                weights=dict(item.weights),
                value=item.value,
                standard_error=_finite(item.standard_error),
                reading=str(item),
                assumed_shifts=_shifts_of_sum(fit, item.weights, figures),
            )
            for item in determined
        ],
        covariance=_covariance_entry(
            fit.terms,
            wide,
            {name: rows for name, rows in figures.items() if name not in (FORM, UNSTEADY)},
        ),
    )


def _shifts_of_sum(
    fit: AxisFit, weights: Mapping[str, float], figures: Mapping[str, Array]
) -> dict[str, float]:
    """Return what assumed figures move a weighted sum of coefficients by."""
    own = np.array([weights.get(term, 0.0) for term in fit.terms])
    return {name: float(np.linalg.norm(shifts @ own)) for name, shifts in figures.items()}


def _covariance_entry(
    terms: Sequence[str], covariance: Array, shifts: Mapping[str, Array]
) -> CovarianceCard:
    """Return the lower triangles over the terms that carry a number in `solution`.

    shifts: of each assumed figure (c, k). What the form lacks, and what an unsteady force
    leans, are none of them: the force of the form itself is known over the flown motion,
    whatever its coefficients stand for.
    """
    kept = np.flatnonzero(np.isfinite(np.diag(covariance))).tolist()
    return CovarianceCard(
        terms=[terms[i] for i in kept],
        lower=[[float(covariance[i, j]) for j in kept if j <= i] for i in kept],
        shifts={figure: rows[:, kept].tolist() for figure, rows in shifts.items()},
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def excitation_word(motion: VelocityExcitation) -> Literal["not excited", "weak", "excited"]:
    """Return how much a velocity is excited: not excited, weak, excited."""
    if not motion.excited:
        return "not excited"
    return "excited" if motion.std >= motion.threshold else "weak"
