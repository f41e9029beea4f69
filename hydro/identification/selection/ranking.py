"""Which of several models to trust: the simplest that predicts as well as the best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.identification.constrained.equations import ForceEquations
from auvid.hydro.identification.constrained.fit import ConstrainedFit, fit_within, force_error
from auvid.hydro.identification.regression.least_squares import TriangularFactor
from auvid.hydro.identification.selection.folds import without_each
from auvid.hydro.identification.selection.information import bic

CLEAR_DIFFERENCE = 2.0
"""A BIC counts as worse from this difference on (Kass & Raftery 1995: below, it is not
worth more than a bare mention).
"""


@dataclass(frozen=True)
class RankedModel:
    """One model as it stands among others.

    terms: unknowns fitted. held_out (L,): J / J0 on each leg, predicted from the
    others; nan with one leg. information: BIC of the six axes together. fit: of all
    legs.
    """

    name: str
    terms: int
    held_out: Array
    information: float
    fit: ConstrainedFit
    physical: bool


@dataclass(frozen=True)
class Ranking:
    """Models by merit, the choice first by name, and the rule in words."""

    models: tuple[RankedModel, ...]
    choice: str
    rule: str


Fit = Callable[[TriangularFactor, ForceEquations], ConstrainedFit]
"""How a model is fitted: `fit_within` with its limits and priors."""


def rank_models(
    legs: Sequence[TriangularFactor],
    models: Mapping[str, ForceEquations],
    *,
    fit: Fit = fit_within,
    physical: Callable[[ConstrainedFit], bool] = lambda _: True,
    samples_per_one: Mapping[str, float] | None = None,
) -> Ranking:
    """Return the models by held-out error, and the one to take.

    The simplest within one standard error of the best (Breiman et al. 1984) that passes
    `physical`. The standard error is that of the difference to the best, leg by leg.
    With one leg nothing can be held out: the simplest within a clear difference of the
    least BIC, with `samples_per_one` by axis. Raises `DataError` where none passes.
    """
    if not (legs and models):
        raise DataError("ranking needs a leg and a model")
    whole = legs[0]
    for leg in legs[1:]:
        whole = whole.merge(leg)
    folds = without_each(legs) if len(legs) > 1 else []
    per_one = np.array([(samples_per_one or {}).get(axis, 1.0) for axis in AXES])
    ranked = []
    for name, equations in models.items():
        result = fit(whole, equations)
        leg_errors = [
            _total(force_error(leg, equations, fit(fold, equations).values))
            / _total(leg.column_rms[-6:])
            for leg, fold in zip(legs[: len(folds)], folds, strict=True)
        ]
        ranked.append(
            RankedModel(
                name,
                len(equations.unknowns) - len({u for a in result.active for u in a.unknowns}),
                np.array(leg_errors) if leg_errors else np.full(1, np.nan),
                _information(result, equations, per_one),
                result,
                physical(result),
            )
        )
    sound = [model for model in ranked if model.physical]
    if not sound:
        raise DataError("no model passes the physical checks", value=list(models))
    merit = (lambda m: float(np.mean(m.held_out))) if folds else (lambda m: m.information)
    best = min(sound, key=merit)
    near = [model for model in sound if _as_good(model, best, legs=bool(folds))]
    choice = min(near, key=lambda model: (model.terms, merit(model)))
    rule = (
        f"the simplest within one standard error of {best.name} over {len(legs)} held-out legs"
        if folds
        else f"the simplest with a BIC within {CLEAR_DIFFERENCE:g} of that of {best.name}: one leg"
        " leaves nothing to hold out"
    )
    return Ranking(tuple(sorted(ranked, key=merit)), choice.name, rule)


def _as_good(model: RankedModel, best: RankedModel, *, legs: bool) -> bool:
    if not legs:
        return model.information - best.information <= CLEAR_DIFFERENCE
    difference = model.held_out - best.held_out
    return float(np.mean(difference)) <= float(
        np.std(difference, ddof=1) / np.sqrt(len(difference))
    )


def _information(result: ConstrainedFit, equations: ForceEquations, per_one: Array) -> float:
    n = result.n_samples
    total = 0.0
    for i, axis in enumerate(AXES):
        here = sum(
            1 / len({where for where, _, _ in parts})
            for parts in equations.shares.values()
            if any(where == axis for where, _, _ in parts)
        )
        m = n / per_one[i]
        sse = float(result.rms[i] ** 2) * n
        total += bic(sse, 0, n_samples=n, samples_per_one=per_one[i]) + here * float(np.log(m))
    return total


def _total(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
