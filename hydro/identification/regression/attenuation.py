"""Bias of least squares from errors of the measured velocities.

How far they pull coefficients from their truth, and how much wider that makes
intervals. Regressors made of measured velocities carry their errors, which least
squares takes for motion without force: coefficients shrink, and where velocities go
together (sway follows yaw rate in closed loop) the share of one moves to the other.
More data do not cure it, and the scatter of the residuals does not show it. Source:
Fuller 1987, Measurement Error Models, 1.1 and 2.2.

Limits: errors of the velocities are small, and independent of one another, of the
motion and of the errors of the measured force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.jacobians import basis_jacobian
from auvid.hydro.identification.regression.least_squares import AxisFit

STRIDE = 5
"""Every fifth sample is enough for a mean: velocities are smooth over many samples."""
MOST_SHARE = 0.5
"""Share of errors in the measured motion from which on they are not divided out.

Half is a reliability of 0.5 (Fuller 1987, 1.1), where the correction doubles the value;
beyond it the gain share / (1 - share) grows without bound.
"""
AT_ONCE = 1024  # samples whose Jacobians are held at a time


@dataclass(frozen=True)
class RegressorErrors:
    """Sum over the samples of the covariance (k, k) of the basis terms.

    It is the covariance that errors of the velocities give them.
    """

    terms: tuple[str, ...]
    moment: Array

    @classmethod
    def empty(cls, terms: Sequence[str]) -> RegressorErrors:
        """Return the sum over no samples."""
        return cls(tuple(terms), np.zeros((len(terms), len(terms))))

    def update(self, nu: ArrayLike, sd: ArrayLike, *, ratio: ArrayLike | None) -> RegressorErrors:
        """Return the sum with n more samples.

        Velocities and their standard deviations (n, 6) [m/s, rad/s], propulsion ratio
        (n,). sum_t sum_i sd_i^2 (d xi / d nu_i) (d xi / d nu_i)'. Raises `DataError`
        for shapes that differ or deviations that are none.
        """
        velocity, spread = np.asarray(nu, dtype=np.float64), np.asarray(sd, dtype=np.float64)
        if velocity.shape != spread.shape or not (spread >= 0.0).all():
            raise DataError(
                "one standard deviation per velocity is needed",
                value=spread.shape,
                allowed=f"{velocity.shape}, 0 or more",
            )
        eta = None if ratio is None else np.asarray(ratio, dtype=np.float64)
        moment = self.moment.copy()
        for start in range(0, len(velocity), STRIDE * AT_ONCE):
            chosen = slice(start, start + STRIDE * AT_ONCE, STRIDE)
            count = min(STRIDE * AT_ONCE, len(velocity) - start)
            slope = basis_jacobian(
                velocity[chosen], self.terms, ratio=None if eta is None else eta[chosen]
            )
            rows = (slope * spread[chosen, None, :]).transpose(0, 2, 1).reshape(-1, len(self.terms))
            moment += count / len(velocity[chosen]) * (rows.T @ rows)
        return RegressorErrors(self.terms, moment)

    def merge(self, other: RegressorErrors) -> RegressorErrors:
        """Return the sum over the samples of both; the terms must agree."""
        return RegressorErrors(self.terms, self.moment + other.moment)


def attenuation(fit: AxisFit, errors: RegressorErrors) -> Array:
    """Return the expected error (k,) of `fit.solution`, 0 for undetermined terms.

    With S = X'X of the measured regressors and D the `moment`, the expected S K is (S -
    D) times the truth: the error is -(S - D)^-1 D K. In directions in which errors make
    up more than half of the motion (`MOST_SHARE`) the inverse is held at its value
    there, as S - D becomes singular: the error counts as at least as large as what was
    found. A constant force has no error of its own, but takes its part.
    """
    kept = list(fit.independent)
    bias = np.zeros(len(fit.terms))
    if not kept:
        return bias
    scale = fit.column_norms[kept]
    place = {term: i for i, term in enumerate(errors.terms)}
    own = [i for i, index in enumerate(kept) if fit.terms[index] in place]
    at = [place[fit.terms[kept[i]]] for i in own]
    moment = np.zeros((len(kept), len(kept)))
    moment[np.ix_(own, own)] = errors.moment[np.ix_(at, at)] / np.outer(scale[own], scale[own])
    half = solve_triangular(fit.scaled_triangle, moment, trans="T")
    share, direction = np.linalg.eigh(solve_triangular(fit.scaled_triangle, half.T, trans="T"))
    share = np.maximum(share, 0.0)
    gain = share / (1.0 - np.minimum(share, MOST_SHARE))
    pull = direction @ (gain * (direction.T @ (fit.scaled_triangle @ (fit.solution[kept] * scale))))
    bias[kept] = -solve_triangular(fit.scaled_triangle, pull) / scale
    return bias


def widened(covariance: Array, shift: Array) -> Array:
    """Return the covariance (k, k) about the truth: bias (k,) included."""
    return np.asarray(covariance + np.outer(shift, shift))
