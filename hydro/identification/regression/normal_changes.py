"""What errors of the data do to the normal equations, and so to the coefficients.

Least squares solves S K = q with S = X'X and q = X'y. An error changes both, by dS and
dq, and to first order it moves K by S^-1 (dq - dS K). More data do not cure it, and the
scatter of the residuals does not show it. Four kinds of errors stand here alike:

- errors of the velocities (Fuller 1987, Measurement Error Models, 1.1 and 2.2). They
  are in the regressors, and through Coriolis and fin forces in the force, too: the
  Coriolis force of u and r takes as much from N_v as noise in v does.
- what smoothing splines took from the motion (`lost_motion.lost_by_spline`), and a low-pass
  (`lost_motion.lost_motion`).
- assumed figures of the vehicle (`assumed_figures`).

The first order says too little where columns hardly differ: errors of the columns and a
known current go through `TrueEquations` (decision 0112).

Limits: first order for all others; errors of the velocities are independent of one another
and of the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.jacobians import basis_jacobian
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    RANK_TOLERANCE,
    AxisFit,
)
from auvid.hydro.identification.regression.standard_errors import mapped
from auvid.hydro.long_series.threads import at_once

STRIDE = 5
"""Every fifth sample is enough for a mean: velocities are smooth over many samples."""
AT_ONCE = 2048
"""Samples whose slopes are in memory at once."""
MOST_ERRORS = 0.9
"""Of a direction of motion: what leans it counts ten times then, and its noise too."""

Result = TypeVar("Result")


@dataclass(frozen=True)
class NormalChange:
    """Change of the normal equations of all axes by one error.

    moment (k, k): dS of `terms`, which end with the constant; target (k, 6): dq.
    """

    terms: tuple[str, ...]
    moment: Array
    target: Array

    def merge(self, other: NormalChange) -> NormalChange:
        """Return the change over the samples of both."""
        return NormalChange(self.terms, self.moment + other.moment, self.target + other.target)

    def shift(self, fit: AxisFit) -> Array:
        """Return how far the error moves `fit.solution` (k,): S^-1 (dq - dS K).

        0 for undetermined terms. Solved from the fit's own triangular factor.
        """
        return np.asarray(shifts([self], fit)[0])

    def scaled_pull(self, fit: AxisFit) -> Array:
        """Return dq - dS K of what a fit determines, for unit columns."""
        kept = list(fit.independent)
        place = [self.terms.index(fit.terms[index]) for index in kept]
        lean = self.moment[np.ix_(place, place)] @ fit.solution[kept]
        pull = self.target[place, AXES.index(fit.axis)] - lean
        return np.asarray(pull / fit.column_norms[kept])

    def scaled_moment(self, fit: AxisFit) -> Array:
        """Return dS of what a fit determines, for unit columns."""
        kept = list(fit.independent)
        place = [self.terms.index(fit.terms[index]) for index in kept]
        scale = fit.column_norms[kept]
        return np.asarray(self.moment[np.ix_(place, place)] / np.outer(scale, scale))


def shifts(changes: Sequence[NormalChange], fit: AxisFit) -> Array:
    """Return the `NormalChange.shift` of each change: (len(changes), k)."""
    from scipy.linalg import lapack

    moved = np.zeros((len(changes), len(fit.terms)))
    kept = list(fit.independent)
    if not kept:
        return moved
    axis, scale, solution = AXES.index(fit.axis), fit.column_norms[kept], fit.solution[kept]
    places: dict[tuple[str, ...], Array] = {}
    for change, row in zip(changes, moved, strict=True):
        if change.terms not in places:
            at = {term: index for index, term in enumerate(change.terms)}
            places[change.terms] = np.array([at[fit.terms[index]] for index in kept])
        place = places[change.terms]
        pull = change.target[place, axis] - change.moment[place[:, None], place] @ solution
        row[kept] = lapack.dpotrs(fit.scaled_triangle, pull / scale)[0] / scale
    return moved


@dataclass(frozen=True)
class StridedLeg:
    """Every `STRIDE`-th sample of a leg, and what a sum over them stands for.

    rows (m, k) of `terms` and the constant, their slopes (m, k, 6) by the velocities,
    forces (m, 6); `weight`: samples of the leg per sample here.
    """

    terms: tuple[str, ...]
    rows: Array
    slopes: Array
    forces: Array
    weight: float

    @classmethod
    def of(
        cls, nu: ArrayLike, forces: ArrayLike, terms: Sequence[str], *, ratio: ArrayLike | None
    ) -> StridedLeg:
        """Return it from velocities and forces (n, 6), propulsion ratio (n,)."""
        velocity = np.asarray(nu, dtype=np.float64)
        chosen = velocity[::STRIDE]
        eta = None if ratio is None else np.asarray(ratio, dtype=np.float64)[::STRIDE]
        slopes = np.zeros((len(chosen), len(terms) + 1, 6))
        slopes[:, :-1] = basis_jacobian(chosen, terms, ratio=eta)
        return cls(
            (*terms, CONSTANT),
            np.column_stack([basis_rows(chosen.T, eta, terms).T, np.ones(len(chosen))]),
            slopes,
            np.asarray(forces, dtype=np.float64)[::STRIDE],
            len(velocity) / len(chosen),
        )

    @classmethod
    def of_parts(
        cls,
        work: Callable[[slice, StridedLeg], Result],
        nu: ArrayLike,
        forces: ArrayLike,
        terms: Sequence[str],
        *,
        ratio: ArrayLike | None,
    ) -> list[Result]:
        """Return what `work` gives of the pieces of a leg, in threads.

        It takes the place of each among the samples, and the piece. Changes of pieces add up
        to those of the leg: slopes of a long one take a gigabyte.
        """
        velocity, force = np.asarray(nu), np.asarray(forces)
        eta = None if ratio is None else np.asarray(ratio)
        weight = len(velocity) / len(velocity[::STRIDE])

        def of_piece(start: int) -> Result:
            place = slice(start, start + STRIDE * AT_ONCE)
            piece = cls.of(
                velocity[place], force[place], terms, ratio=None if eta is None else eta[place]
            )
            return work(place, replace(piece, weight=weight))

        return at_once(of_piece, range(0, len(velocity), STRIDE * AT_ONCE))

    def of_terms(self, terms: Sequence[str]) -> StridedLeg:
        """Return it with the columns of some terms and the constant."""
        names = (*terms, CONSTANT)
        at = [self.terms.index(name) for name in names]
        return replace(self, terms=names, rows=self.rows[:, at], slopes=self.slopes[:, at])

    def with_columns(self, names: Sequence[str], values: Array) -> StridedLeg:
        """Return it with columns (m, c) that no velocity moves, before the constant."""
        return replace(
            self,
            terms=(*self.terms[:-1], *names, self.terms[-1]),
            rows=np.hstack([self.rows[:, :-1], values, self.rows[:, -1:]]),
            slopes=np.insert(self.slopes, [-1] * len(names), 0.0, axis=1),
        )

    def random(self, sd: ArrayLike, force_slopes: Array) -> tuple[NormalChange, ...]:
        """Return the expected change by independent errors of each velocity.

        sd (n, 6): their standard deviations [m/s, rad/s]; force_slopes (m, 6, 6): of
        the force [axis, velocity]. dS = sum sd_i^2 x_i x_i', dq = sum sd_i^2 x_i f_i'
        with x_i and f_i the slopes by velocity i. Raises `DataError` for deviations
        that are none.
        """
        spread = np.asarray(sd, dtype=np.float64)[::STRIDE]
        if spread.shape != (len(self.rows), 6) or not (spread >= 0.0).all():
            raise DataError(
                "one standard deviation per velocity is needed",
                value=spread.shape,
                allowed=f"{(len(self.rows), 6)}, 0 or more",
            )
        changes = []
        for i in range(6):
            slope = self.slopes[:, :, i] * spread[:, i, None]
            force = force_slopes[:, :, i] * spread[:, i, None]
            changes.append(
                NormalChange(
                    self.terms, self.weight * slope.T @ slope, self.weight * slope.T @ force
                )
            )
        return tuple(changes)

    def definite(self, d_force: Array, d_nu: Array | None = None) -> NormalChange:
        """Return the change by errors (m, 6) of the force and of the velocities.

        dS = dX'X + X'dX, dq = dX'y + X'dy.
        """
        target = self.weight * self.rows.T @ d_force
        moment = np.zeros((len(self.terms), len(self.terms)))
        if d_nu is not None:
            d_rows = np.einsum("mki,mi->mk", self.slopes, d_nu)
            half = self.weight * d_rows.T @ self.rows
            moment = half + half.T
            target = target + self.weight * d_rows.T @ self.forces
        return NormalChange(self.terms, moment, target)

    def squared(self, d_force: Array, d_nu: Array) -> NormalChange:
        """Return the second order of `definite`: dS = dX'dX, dq = dX'dy.

        It is what errors of either sign add.
        """
        d_rows = np.einsum("mki,mi->mk", self.slopes, d_nu)
        return NormalChange(
            self.terms, self.weight * d_rows.T @ d_rows, self.weight * d_rows.T @ d_force
        )


@dataclass(frozen=True)
class TrueEquations:
    """The inverse normal matrix of a fit without errors of its columns.

    For columns of unit length. Where a column has hardly more of its own, beside those of the
    others, than its errors, S - dS is nearly singular, and the first order by S says far too
    little: sway and yaw rate of a torpedo go together to .995, and what is left is noise.
    """

    fit: AxisFit
    inverse: Array

    @classmethod
    def of(
        cls, fit: AxisFit, errors: Sequence[NormalChange], leans: Sequence[NormalChange] = ()
    ) -> TrueEquations:
        """Return those of S + dS of `leans` - dS of `errors`.

        leans: what puts right an error that is known; errors: what random ones add to S.
        Directions with more than `MOST_ERRORS` of errors count as having so much.
        """
        moment = fit.scaled_triangle.T @ fit.scaled_triangle
        for lean in leans:
            moment = moment + lean.scaled_moment(fit)
        size, axes = np.linalg.eigh(moment)
        root = axes / np.sqrt(np.maximum(size, RANK_TOLERANCE**2 * size.max(initial=0.0)))
        added = np.zeros_like(moment)
        for error in errors:
            added = added + error.scaled_moment(fit)
        share, directions = np.linalg.eigh(root.T @ added @ root)
        back = root @ directions
        return cls(fit, back / (1.0 - np.clip(share, 0.0, MOST_ERRORS)) @ back.T)

    def shift(self, change: NormalChange) -> Array:
        """Return how far an error moves the fit: (S - dS)^-1 (dq - dS K), (k,)."""
        kept = list(self.fit.independent)
        moved = np.zeros(len(self.fit.terms))
        moved[kept] = self.inverse @ change.scaled_pull(self.fit) / self.fit.column_norms[kept]
        return moved

    def noise(self, covariance: Array) -> Array:
        """Return the covariance (k, k) of the solution of these equations.

        B C B' with B = (S - dS)^-1 S and C that of least squares.
        """
        kept = list(self.fit.independent)
        scale = self.fit.column_norms[kept]
        triangle, cell = self.fit.scaled_triangle, np.ix_(kept, kept)
        by = self.inverse @ (triangle.T @ triangle) * scale / scale[:, None]
        of_truth = covariance.copy()  # nan stays where the data determine no single number
        of_truth[cell] = mapped(covariance[cell], by)
        return of_truth


def widened(covariance: Array, shifts: Sequence[Array]) -> Array:
    """Return the covariance (k, k) about the truth, by shifts (k,) of either sign.

    C + sum s s': a shift of unknown sign counts as a standard deviation.

    >>> widened(np.eye(2), [np.array([2.0, 0.0])]).tolist()
    [[5.0, 0.0], [0.0, 1.0]]
    """
    return np.asarray(covariance + sum(np.outer(shift, shift) for shift in shifts))
