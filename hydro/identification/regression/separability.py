"""Limits that the range of motion sets to telling terms apart.

They come on top of rank and variance inflation. A term that contains a velocity which
hardly moves rests on noise and on a few spikes, whatever its t-ratio. Where a velocity
keeps one direction, x and |x|, x*x and x*|x| differ only in motion below the sensors'
noise: their sum is determined, they themselves are not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD, allows
from auvid.hydro.identification.regression.excitation import VelocityExcitation, term_floors
from auvid.hydro.identification.regression.least_squares import AxisFit, Combination
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    INSEPARABLE,
    NOT_EXCITED,
    WEAK,
    Verdict,
    judge,
)

ROUNDING_SHARE = 1e-6
"""A term with less than this share of the measured force is rounding, however small its
standard error (data without noise).
"""

VelocityExcitations = Mapping[str, VelocityExcitation]


def motion_floors(terms: Sequence[str], motion: VelocityExcitations) -> dict[str, float]:
    """Return `term_floors`, infinite for terms with a factor that is not excited.

    The RMS of r*r lies above its floor when r is a few short spikes; that does not make
    r excited.
    """
    floors = term_floors(terms, motion)
    return {term: floor if _moves(term, motion) else math.inf for term, floor in floors.items()}


def one_sided_groups(
    terms: Sequence[str], motion: VelocityExcitations
) -> tuple[dict[str, float], ...]:
    """Return sets of terms that are one on the side to which a velocity keeps.

    Each maps term -> sign against the others. A velocity keeps to one side when it is
    excited, but not beyond its threshold in both directions; |x| is then x or -x, Vv V
    or -V.
    """
    groups: dict[tuple[str, ...], dict[str, float]] = {}
    for term in terms:
        if term in BASIS_TERMS and _moves(term, motion):
            sign, form = _on_its_side(term, motion)
            groups.setdefault(form, {})[term] = sign
    return tuple(group for group in groups.values() if len(group) > 1)


def judge_with_motion(
    fit: AxisFit,
    motion: VelocityExcitations,
    *,
    covariance: Array,
    turns: Mapping[str, Sequence[str]] | None = None,
    figures: Mapping[str, Array] | None = None,
) -> tuple[dict[str, Verdict], tuple[Combination, ...]]:
    """Return the verdict on every term, and the combinations that are determined.

    Combinations stand for coefficients that are not, those of the rank included.
    covariance (k, k): of the solution, in the order of `fit.terms`, best from
    `CoefficientScores`. turns, figures: of `verdicts.judge`. Inseparability is mutual: a
    term is inseparable only from terms that are themselves not told from zero or not
    from it; otherwise it is weak.
    Dependent columns that rest on nothing but unexcited motion are not excited, and so
    are their combinations.
    """
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    verdicts = _mutual(
        judge(
            fit,
            floors=motion_floors(fit.terms, motion),
            standard_errors=errors,
            turns=turns,
            figures=figures,
        ),
        fit,
    )
    pushing = pushing_damping(fit)
    for term, verdict in verdicts.items():
        if verdict.status == IDENTIFIED and (verdict.share < ROUNDING_SHARE or term in pushing):
            verdicts[term] = replace(verdict, status=WEAK)
    still = {
        term
        for group in fit.groups
        if not any(_moves(term, motion) for term in group.terms)
        for term in group.terms
    }
    verdicts |= {term: replace(verdicts[term], status=NOT_EXCITED, partners=()) for term in still}
    combinations = [
        replace(item, standard_error=float(errors[fit.terms.index(next(iter(item.weights)))]))
        for group in fit.groups
        for item in group.combinations
        if not still & item.weights.keys()
    ]
    exact = {term for group in fit.groups for term in group.terms}
    for group in one_sided_groups(fit.terms, motion):
        members = {
            term: sign
            for term, sign in group.items()
            if verdicts[term].status != NOT_EXCITED and term not in exact
        }
        if len(members) < 2:
            continue
        for term in members:
            others = tuple(other for other in members if other != term)
            verdicts[term] = replace(verdicts[term], status=INSEPARABLE, partners=others)
        index = [fit.terms.index(term) for term in members]
        first = next(iter(members.values()))
        weights = np.array([sign * first for sign in members.values()])
        variance = float(weights @ covariance[np.ix_(index, index)] @ weights)
        value = float(weights @ fit.solution[index])
        combinations.append(
            Combination(
                dict(zip(members, weights.tolist(), strict=True)),
                value,
                math.sqrt(max(variance, 0.0)),
            )
        )
    return verdicts, tuple(combinations)


def pushing_damping(fit: AxisFit) -> tuple[str, ...]:
    """Return own damping that gives energy: x > 0 on the axis of x, or x|x| without x.

    No hull has it. A fit that has it, however clearly, explains something else: a
    controller that answers the motion, or a lag.
    """
    own = OWN_VELOCITY[fit.axis]
    own_terms = [term for term in (own, f"{own}*|{own}|") if term in fit.terms]
    return tuple(term for term in own_terms[:1] if float(fit.solution[fit.terms.index(term)]) > 0.0)


def breaks_symmetry(axis: str, term: str) -> bool:
    """Return whether a hull symmetric about its xz plane cannot have this term.

    Mirrored, v, p, r and Vv turn their sign, and so do Y, K and N; moduli and V do not.
    A constant force counts as unsigned.
    """
    return not allows(axis, term, (PORT_STARBOARD,))


def _moves(term: str, motion: VelocityExcitations) -> bool:
    if term in motion:
        return motion[term].excited
    return term not in BASIS_TERMS or all(
        _moves_products(factor, motion) for factor in BASIS_TERMS[term].factors
    )


def _moves_products(factor: str, motion: VelocityExcitations) -> bool:
    name = factor.strip("|")
    if name[0] == "V":
        return motion["v"].excited_in_products or motion["w"].excited_in_products
    return name not in motion or motion[name].excited_in_products


def _on_its_side(term: str, motion: VelocityExcitations) -> tuple[float, tuple[str, ...]]:
    sign, form = 1.0, []
    for factor in BASIS_TERMS[term].factors:
        name = factor[1] if factor in ("Vv", "Vw") else factor.strip("|")
        if (
            factor == name
            or name not in VELOCITIES
            or motion[name].changes_sign
            or not motion[name].excited_in_products
        ):
            form.append(factor)
            continue
        sign *= 1.0 if motion[name].high >= motion[name].product_threshold else -1.0
        form.append("V" if factor[0] == "V" else name)
    return sign, tuple(sorted(form))


def _mutual(verdicts: Mapping[str, Verdict], fit: AxisFit) -> dict[str, Verdict]:
    """Return the verdicts with near inseparability made mutual."""
    exact = {term for group in fit.groups for term in group.terms}
    near = [
        term
        for term, verdict in verdicts.items()
        if verdict.status == INSEPARABLE and term not in exact
    ]
    partners: dict[str, set[str]] = {term: set() for term in near}
    for term in near:
        for other in verdicts[term].partners:
            if verdicts[other].status in (INSEPARABLE, WEAK) and other not in exact:
                partners[term].add(other)
                partners.setdefault(other, set()).add(term)
    settled = dict(verdicts)
    for term, others in partners.items():
        in_order = tuple(other for other in fit.terms if other in others)
        settled[term] = replace(
            verdicts[term], status=INSEPARABLE if others else WEAK, partners=in_order
        )
    return settled
