"""The terms of one axis that data can carry: switched off, or chosen one by one.

Everything is solved from the triangular factor, one axis at a time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.viscous.models import ViscousModel
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY, masked
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    RANK_TOLERANCE,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.selection.folds import without_each
from auvid.hydro.identification.selection.information import bic

LEGS, INFORMATION = "legs", "information"
SPARSE = "sparse"
"""Name of the model whose terms the training legs chose of the whole basis."""


@dataclass(frozen=True)
class SwitchedOff:
    """A structure after the data switched terms off.

    model: what remains. reasons: (axis, term) -> why it went. basis: `legs` where each
    leg was held out in turn, `information` where there is one leg and the BIC decided;
    note: what that means, in words.
    """

    model: ViscousModel
    reasons: Mapping[tuple[str, str], str]
    basis: str
    note: str


@dataclass(frozen=True)
class Pursuit:
    """Terms of an axis in the order in which they were chosen.

    sse (k + 1,), information (k + 1,): after 0, 1, ... k of `order`. best: how many of
    them the BIC keeps.
    """

    axis: str
    order: tuple[str, ...]
    sse: Array
    information: Array

    @property
    def best(self) -> int:
        """Return the number of terms of least BIC."""
        return int(np.argmin(self.information))

    @property
    def terms(self) -> tuple[str, ...]:
        """Return the terms that the BIC keeps."""
        return self.order[: self.best]


def switch_off(
    legs: Sequence[TriangularFactor],
    model: ViscousModel,
    *,
    samples_per_one: Mapping[str, float] | None = None,
    trim: bool = False,
) -> SwitchedOff:
    """Return the model without the couplings that the data do not carry.

    Damping along the axis itself always stays: where the data leave it open it needs a
    prior, and a vehicle without it does not exist. From the whole structure, one
    coupling at a time goes: first those whose sign depends on which leg is left out,
    then those without which the held-out legs are predicted as well, within one
    standard error of the difference over legs. With one leg the
    BIC decides, with `samples_per_one` (axis -> `inflation` of the residual). No term
    is ever added. Raises `DataError` without a leg.
    """
    if not legs:
        raise DataError("no leg to judge terms on")
    folds = without_each(legs) if len(legs) > 1 else []
    reasons: dict[tuple[str, str], str] = {}
    kept: dict[str, tuple[str, ...]] = {}
    for axis in AXES:
        terms = tuple(model.terms.get(axis, ()))
        while True:
            off = (
                _worst_over_legs(legs, folds, axis, terms, trim)
                if folds
                else _worst_by_information(
                    legs[0], axis, terms, (samples_per_one or {}).get(axis, 1.0), trim
                )
            )
            if off is None:
                break
            term, reason = off
            reasons[axis, term] = reason
            terms = tuple(other for other in terms if other != term)
        kept[axis] = terms
    note = (
        f"terms were judged by leaving out each of {len(legs)} legs"
        if folds
        else "there is one leg, and its parts are not independent: the BIC over independent samples"
        " judged the terms; fly a second leg to hold one out"
    )
    return SwitchedOff(
        masked(kept, name=f"{model.name}_reduced"), reasons, LEGS if folds else INFORMATION, note
    )


def pursue(
    factor: TriangularFactor,
    axis: str,
    candidates: Sequence[str],
    *,
    always: Sequence[str] = (CONSTANT,),
    most: int | None = None,
    samples_per_one: float = 1.0,
) -> Pursuit:
    """Return terms of an axis by orthogonal matching pursuit: Pati et al. 1993.

    Each time the term whose column of unit length is nearest to the residual is taken in,
    and all coefficients are solved again. `always` are in from the start. It stops after
    `most` terms, or where nothing independent remains. `information` is the BIC and 2 ln of
    the number of sets of k candidates (Chen & Chen 2008, gamma 1): of many some fit noise.
    """
    names = [term for term in candidates if term not in always]
    index = {name: i for i, name in enumerate(factor.columns)}
    target = factor.R[:, index[axis]]
    columns = factor.R[:, [index[name] for name in names]]
    length = np.linalg.norm(columns, axis=0)
    open_ = length > 0.0
    unit = columns / np.where(open_, length, 1.0)
    basis = _orthonormal(factor.R[:, [index[name] for name in always]])
    residual = target - basis @ (basis.T @ target)
    # In data of no noise the last terms would be rounding.
    floor = RANK_TOLERANCE * float(np.linalg.norm(target))
    order: list[str] = []
    sse = [float(residual @ residual)]
    while open_.any() and len(order) < (len(names) if most is None else most):
        if np.sqrt(sse[-1]) <= floor:
            break
        pick = int(np.argmax(np.where(open_, np.abs(unit.T @ residual), -1.0)))
        open_[pick] = False
        rest = unit[:, pick] - basis @ (basis.T @ unit[:, pick])
        rest -= basis @ (basis.T @ rest)
        own = float(np.linalg.norm(rest))
        if own <= RANK_TOLERANCE:
            continue
        basis = np.column_stack([basis, rest / own])
        residual = target - basis @ (basis.T @ target)
        order.append(names[pick])
        sse.append(float(residual @ residual))
    n = factor.n_samples
    information = [
        bic(s, len(always) + k, n_samples=n, samples_per_one=samples_per_one)
        + 2.0 * math.log(math.comb(len(names), k))
        for k, s in enumerate(sse)
    ]
    return Pursuit(axis, tuple(order), np.array(sse), np.array(information))


def _worst_over_legs(
    legs: Sequence[TriangularFactor],
    folds: Sequence[TriangularFactor],
    axis: str,
    terms: tuple[str, ...],
    trim: bool,
) -> tuple[str, str] | None:
    couplings = [term for term in terms if not is_own_damping(axis, term)]
    if not couplings:
        return None
    values = np.array([_solution(fold, axis, terms, trim) for fold in folds])
    signs = np.sign(values[:, : len(terms)])
    for i, term in enumerate(terms):
        if term in couplings and abs(signs[:, i].sum()) < len(folds):
            return term, "its sign depends on which leg is left out"
    all_terms_error = _held_out(legs, folds, axis, terms, trim)
    worse = {
        term: _held_out(legs, folds, axis, tuple(t for t in terms if t != term), trim)
        - all_terms_error
        for term in couplings
    }
    term = min(worse, key=lambda name: float(worse[name].sum()))
    one_error = float(np.std(worse[term], ddof=1) / np.sqrt(len(legs)))
    if float(worse[term].mean()) <= one_error:
        return term, "held-out legs are predicted as well without it, within one standard error"
    return None


def _worst_by_information(
    factor: TriangularFactor, axis: str, terms: tuple[str, ...], per_one: float, trim: bool
) -> tuple[str, str] | None:
    def information(chosen: tuple[str, ...]) -> float:
        fit = solve_axis(factor, axis, chosen, trim=trim)
        return bic(fit.sse, len(fit.terms), n_samples=factor.n_samples, samples_per_one=per_one)

    couplings = [term for term in terms if not is_own_damping(axis, term)]
    if not couplings:
        return None
    without = {term: information(tuple(t for t in terms if t != term)) for term in couplings}
    term = min(without, key=without.__getitem__)
    gain = information(terms) - without[term]
    return (term, f"the BIC is lower by {gain:.2g} without it") if gain >= 0.0 else None


def _held_out(
    legs: Sequence[TriangularFactor],
    folds: Sequence[TriangularFactor],
    axis: str,
    terms: tuple[str, ...],
    trim: bool,
) -> Array:
    """Return the mean square error (L,) of each leg, predicted from the others."""
    names = (*terms, *((CONSTANT,) if trim else ()))
    index = [legs[0].columns.index(name) for name in names]
    squares = []
    for leg, fold in zip(legs, folds, strict=True):
        error = leg.R[:, leg.columns.index(axis)] - leg.R[:, index] @ _solution(
            fold, axis, terms, trim
        )
        squares.append(float(error @ error) / leg.n_samples)
    return np.array(squares)


def _solution(factor: TriangularFactor, axis: str, terms: tuple[str, ...], trim: bool) -> Array:
    return solve_axis(factor, axis, terms, trim=trim).solution


def is_own_damping(axis: str, term: str) -> bool:
    """Return whether a term damps motion along its axis alone: x or x|x|."""
    own = OWN_VELOCITY[axis]
    return term in (own, f"{own}*|{own}|")


def _orthonormal(columns: Array) -> Array:
    length = np.linalg.norm(columns, axis=0)
    return np.asarray(np.linalg.qr(columns[:, length > 0.0] / length[length > 0.0])[0])
