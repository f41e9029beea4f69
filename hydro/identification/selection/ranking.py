"""Which of several models to trust: the simplest that predicts as well as the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.regression.least_squares import AxisFit, TriangularFactor

CLEAR_DIFFERENCE = 2.0
"""A BIC counts as worse from this difference on (Kass & Raftery 1995: below, it is not
worth more than a bare mention).
"""


@dataclass(frozen=True)
class RankedModel:
    """What is known of one model among others.

    terms: unknowns fitted. left_out (L,): J / J0 on each leg, predicted from the others;
    empty where that is not known. information: BIC of the six axes together, nan where
    it is not known. is_sound: whether it passes physics.
    """

    name: str
    terms: int
    left_out: Array
    information: float
    is_sound: bool


@dataclass(frozen=True)
class Choice:
    """The model to take, the best by merit, and the rule in words."""

    name: str
    best: str
    rule: str


def error_ratios(leg: TriangularFactor, error: Array) -> Array:
    """Return J / J0 (7,) on a leg, all axes together and each: RMS error (6,) [N, N m].

    nan for an axis without a force.
    """
    force = leg.column_rms[-6:]
    top, bottom = (
        np.append(np.sqrt(np.mean(error**2)), error),
        np.append(np.sqrt(np.mean(force**2)), force),
    )
    return np.asarray(np.divide(top, bottom, out=np.full(7, np.nan), where=bottom > 0.0))


def least_squares_error(fits: Sequence[AxisFit], leg: TriangularFactor) -> Array:
    """Return the RMS force error (6,) [N, N m] of six axes' fits on another leg."""
    place = {name: i for i, name in enumerate(leg.columns)}
    errors = [
        leg.R[:, place[fit.axis]] - leg.R[:, [place[term] for term in fit.terms]] @ fit.solution
        for fit in fits
    ]
    return np.asarray(np.linalg.norm(errors, axis=1) / np.sqrt(leg.n_samples))


def choose(candidates: Sequence[RankedModel]) -> Choice | None:
    """Return the simplest model within one standard error of the best that is sound.

    The standard error is that of the difference to the best over the left-out legs
    (Breiman et al. 1984). Where no leg is left out: the simplest within a clear
    difference of the least BIC. Where no model is sound, the rest compete. None without
    a model that either tells something of.
    """
    sound = [item for item in candidates if item.is_sound] or list(candidates)
    legs = max((len(item.left_out) for item in sound), default=0)
    if legs >= 2:
        judged = [item for item in sound if len(item.left_out) == legs]
        best = min(judged, key=_mean)
        near = [item for item in judged if _within_one_error(item, best)]
        chosen = min(near, key=lambda item: (item.terms, _mean(item)))
        words = f"the best over {legs} legs, each left out in turn"
        if chosen is best:
            words += " (no simpler model is within one standard error of it)"
        else:
            words = f"the simplest within one standard error of {words}"
        return Choice(chosen.name, best.name, words)
    judged = [item for item in sound if np.isfinite(item.information)]
    if not judged:
        return None
    best = min(judged, key=lambda item: item.information)
    near = [item for item in judged if item.information - best.information <= CLEAR_DIFFERENCE]
    chosen = min(near, key=lambda item: (item.terms, item.information))
    words = (
        f"the one of least BIC (no simpler model is within {CLEAR_DIFFERENCE:g} of it)"
        if chosen is best
        else f"the simplest with a BIC within {CLEAR_DIFFERENCE:g} of the least"
    )
    words += ": one training leg leaves none to leave out"
    return Choice(chosen.name, best.name, words)


def _mean(item: RankedModel) -> float:
    return float(np.mean(item.left_out))


def _within_one_error(item: RankedModel, best: RankedModel) -> bool:
    difference = item.left_out - best.left_out
    error = float(np.std(difference, ddof=1) / np.sqrt(len(difference)))
    return float(np.mean(difference)) <= error
