"""One verdict per coefficient.

Identified, weak, not excited, or inseparable from other terms.

Rules, in this order:
1. *inseparable*: the term's column depends on those of others within `RANK_TOLERANCE`;
   only combinations are determined.
2. *not excited*: the column is zero, or its RMS lies below the floor that the caller
   gives for it (`excitation.term_floors`).
3. *identified*: the coefficient is clear of zero (`clear_of_zero`: by noise, and with
   the assumed figures of the vehicle), neither terms that the form lacks nor an unsteady
   force lean it far (`withstands`), and no leg turns its sign by being left out
   (`sign_turns`). Give coloured standard errors about the truth; white ones say too much.
4. Otherwise, when the variance inflation exceeds `VIF_LIMIT`: *inseparable* from the
   terms that its column nearly depends on: together they may be well determined, apart
   they are not.
5. Otherwise *weak*.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.regression.assumed_figures import FORM, UNSTEADY
from auvid.hydro.identification.regression.least_squares import AxisFit

S = TypeVar("S", bound=str)
TermStatus = Literal["identified", "weak", "not excited", "inseparable"]
IDENTIFIED: TermStatus = "identified"
WEAK: TermStatus = "weak"
NOT_EXCITED: TermStatus = "not excited"
INSEPARABLE: TermStatus = "inseparable"
T_LIMIT = 4.0
"""The choice among an axis's terms is not to name zeros: 4 keeps the false discoveries of
every axis under 5 % (`discovery_limit`), however many basis terms a model has, by a
normal law; on legs of 20 to 90 s under coloured errors at most .8 % of the zeros pass
(decision 0049). On the VT 690 twin whose truth is Linear, 2 calls terms identified that
are zero but for noise.
"""
MAY_IDENTIFY = frozenset({"least squares", "within limits", "output error"})
"""Methods (of `ModelCard`) whose coefficients may be called identified; of others the
strongest word is weak. What an estimator is short of stands in `SHORT_OF`.
"""
SHORT_OF = {
    "filter error": "under an unsteady force three standard errors held 98 % of them, of 99 % that"
    " are asked"
}
"""Method -> why it calls no coefficient identified (33 twins of the VT 690, plan matched).
"""
LEAN_LIMIT = 3.0
"""A value is at least so many times what an unsteady force and terms that the form lacks may
lean it by: of nine others that were clear of zero on the plan matched eight were off by half
(decision 0093), and of 65 of forms that lack terms 59 (decision 0111).
"""
LEAST_SQUARES_COVERAGE = {"linear": 0.99, "gertler_hagen": 0.95}
"""Share of the 95 % intervals of coefficients called identified that hold the truth, by
the true model: twins of the VT 690, plan default, smoother, 24 and 20 seeds
(benchmarks/coverage_least_squares.py).
"""
UNDER_UNSTEADY_FORCE = {"least squares": (1, 1.0)}
"""Method -> how many of 36 it calls identified in the median seed, and the same share, where an
unsteady force is as large as the manoeuvres' own (truth Linear, plan matched, 12 seeds, 13
coefficients; decision 0093).
"""
VIF_LIMIT = 100.0
"""A column of which less than a tenth is its own: its standard error is ten times what
it would be alone.
"""
PARTNER_SHARE = 0.3
"""A term is a partner from this share of the largest weight on: its part of the
explained variance is then a tenth (0.3^2) of that of the main partner, as `VIF_LIMIT`
takes a tenth of the length for its own.
"""


@dataclass(frozen=True)
class Verdict:
    """The verdict on one coefficient, with the numbers behind it.

    status: identified, weak, not excited or inseparable; partners: the terms it is
    inseparable from. excitation: RMS of the term's column over its floor (inf for no
    floor); share: RMS of the term's force over that of the measured force.
    """

    term: str
    status: TermStatus
    partners: tuple[str, ...]
    t_ratio: float
    vif: float
    excitation: float
    share: float

    def __str__(self) -> str:
        return (
            f"inseparable from {', '.join(self.partners)}"
            if self.status == INSEPARABLE
            else self.status
        )


def judge(
    fit: AxisFit,
    *,
    floors: Mapping[str, float] | None = None,
    standard_errors: ArrayLike | None = None,
    turns: Mapping[str, Sequence[str]] | None = None,
    figures: Mapping[str, Array] | None = None,
) -> dict[str, Verdict]:
    """Return the verdict on every term of a fit, by term.

    floors: RMS from which on a term counts as excited (term -> SI value; missing: 0).
    standard_errors (k,): in the order of `fit.terms`, best from `CoefficientScores`;
    None takes the white ones. turns: of `sign_turns`. figures: assumed figure -> shifts
    (k,) by one standard deviation of it. Raises `DataError` when the number of standard
    errors is wrong.
    """
    errors = (
        fit.standard_errors
        if standard_errors is None
        else np.asarray(standard_errors, dtype=np.float64)
    )
    if errors.shape != (len(fit.terms),):
        raise DataError(
            "one standard error per term is needed",
            value=errors.shape,
            allowed=f"({len(fit.terms)},)",
        )
    groups = {term: group.terms for group in fit.groups for term in group.terms}
    verdicts = {}
    for index, term in enumerate(fit.terms):
        rms, floor = float(fit.column_rms[index]), float((floors or {}).get(term, 0.0))
        value, error = abs(float(fit.solution[index])), float(errors[index])
        t_ratio = (
            value / error if error > 0 else (np.inf if value > 0 and error == 0 else float("nan"))
        )
        shifts = {name: float(shift[index]) for name, shift in (figures or {}).items()}
        clear = stands_clear(value, error, shifts) and term not in (turns or {})
        status, partners = _rule(fit, index, groups, rms < floor or rms == 0, clear)
        verdicts[term] = Verdict(
            term=term,
            status=status,
            partners=partners,
            t_ratio=float(t_ratio),
            vif=float(fit.vif[index]),
            excitation=rms / floor if floor > 0 else float("inf"),
            share=value * rms / fit.j0 if fit.j0 > 0 else float("nan"),
        )
    return verdicts


def clear_of_zero(
    value: float,
    standard_error: float,
    shifts: Iterable[float] = (),
    *,
    quantile: float = NORMAL_95,
) -> bool:
    """Return whether a value may be called identified beside its printed interval.

    |value| >= T_LIMIT s by noise, since terms are chosen among many, and
    |value| > quantile sqrt(s^2 + sum of shifts^2): the 95 % interval by noise and assumed
    figures together keeps the sign. shifts: what one standard deviation of each assumed
    figure moves the value by; quantile: of the interval (Student's where s has few degrees
    of freedom).

    >>> clear_of_zero(-5.0, 1.0), clear_of_zero(-5.0, 1.0, [2.0, 2.0])
    (True, False)
    >>> clear_of_zero(3.0, 1.0), clear_of_zero(5.0, 1.0, quantile=12.7)
    (False, False)
    """
    total = float(np.sqrt(standard_error**2 + sum(shift**2 for shift in shifts)))
    size = abs(value)
    return bool(size > 0.0 and size >= T_LIMIT * standard_error and size > quantile * total)


def stands_clear(value: float, standard_error: float, shifts: Mapping[str, float]) -> bool:
    """Return whether a value is `clear_of_zero` and `withstands` what leans it.

    shifts: assumed figure -> what one standard deviation of it moves the value by.

    >>> stands_clear(-9.0, 1.0, {UNSTEADY: 2.0}), stands_clear(-9.0, 1.0, {UNSTEADY: 4.0})
    (True, False)
    """
    return clear_of_zero(value, standard_error, shifts.values()) and withstands(value, shifts)


def withstands(value: float, shifts: Mapping[str, float]) -> bool:
    """Return whether the form and an unsteady force lean a value by less than a third.

    shifts: assumed figure -> what one standard deviation of it moves the value by.

    >>> withstands(-9.0, {UNSTEADY: 2.0, "thrust": 8.0}), withstands(-9.0, {UNSTEADY: 4.0})
    (True, False)
    >>> withstands(-9.0, {UNSTEADY: 2.0, FORM: 2.5})
    False
    """
    lean = np.hypot(shifts.get(FORM, 0.0), shifts.get(UNSTEADY, 0.0))
    return bool(abs(value) > LEAN_LIMIT * lean)


def strongest(status: S, method: str) -> S | TermStatus:
    """Return a status, or weak for identified where the method may not say it."""
    return WEAK if status == IDENTIFIED and method not in MAY_IDENTIFY else status


def discovery_limit(count: int, *, rate: float = 0.05) -> float:
    """Return the t-ratio from which on any of `count` terms is a discovery.

    Benjamini & Yekutieli 2001, theorem 1.3, for statistics that depend on one another:
    p <= rate / (count * sum_i 1/i), here for a single discovery, which is its strictest
    step; two-sided, normal.

    >>> round(discovery_limit(6), 2)
    2.93
    >>> discovery_limit(133) < T_LIMIT  # the whole basis and a constant
    True
    """
    from scipy.special import ndtri

    harmonic = float(np.sum(1.0 / np.arange(1, count + 1)))
    return float(-ndtri(0.5 * rate / (count * harmonic)))


def sign_turns(fit: AxisFit, others: Mapping[str, AxisFit]) -> dict[str, tuple[str, ...]]:
    """Return the terms whose sign turns when a leg is left out, with those legs.

    others: name of the leg left out -> fit of the same terms to the rest. A leg without
    which the data do not determine a term turns nothing.
    """
    turned = {
        term: tuple(
            leg
            for leg, other in others.items()
            if other.coefficients[index] * fit.coefficients[index] < 0.0
        )
        for index, term in enumerate(fit.terms)
    }
    return {term: legs for term, legs in turned.items() if legs}


def _rule(
    fit: AxisFit, index: int, groups: Mapping[str, tuple[str, ...]], unexcited: bool, clear: bool
) -> tuple[TermStatus, tuple[str, ...]]:
    term = fit.terms[index]
    if term in groups:
        return INSEPARABLE, tuple(other for other in groups[term] if other != term)
    if unexcited:
        return NOT_EXCITED, ()
    if clear:
        return IDENTIFIED, ()
    if fit.vif[index] > VIF_LIMIT:
        return INSEPARABLE, _partners(fit, index)
    return WEAK, ()


def _partners(fit: AxisFit, index: int) -> tuple[str, ...]:
    """Return the terms that explain most of a column (unit-length columns)."""
    from scipy.linalg import solve_triangular

    kept = list(fit.independent)
    place = kept.index(index)
    precision = solve_triangular(fit.scaled_triangle, np.eye(len(kept)))
    precision = precision @ precision.T
    weights = np.abs(precision[place] / precision[place, place])
    weights[place] = 0.0
    return tuple(
        fit.terms[kept[i]] for i in np.flatnonzero(weights >= PARTNER_SHARE * weights.max())
    )
