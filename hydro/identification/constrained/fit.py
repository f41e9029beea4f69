"""Coefficients within physical limits and with priors, from the triangular factor.

All six axes are one problem, so that limits and unknowns may bind them together:
minimise sum over axes |tau_bar_a - D_a x|^2 / s_a^2 + (x - m)' P^-1 (x - m), subject to
limits; s_a is the deviation of axis a's force error, m and P a prior's mean and
covariance (Gelman et al., Bayesian Data Analysis, 14.8).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError, PipelineError, nearest
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.identification.constrained.active_set import Cuts, InequalityRows, minimise
from auvid.hydro.identification.constrained.equations import ForceEquations, Unknown
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    RANK_TOLERANCE,
    TriangularFactor,
)
from auvid.hydro.identification.regression.normal_changes import NormalChange

SMALLEST_NOISE = 1e-6
"""The force error is taken as at least this share of the measured force (RMS)."""
RIDGE = 1e-6
"""Length of the row that settles an undetermined direction, for columns of length 1."""


@dataclass(frozen=True)
class ActiveLimit:
    """A limit that holds the solution back.

    multiplier: by how much the weighted sum of squares falls per unit of its bound.
    unknowns: those in it; a bound has one.
    """

    name: str
    unknowns: tuple[Unknown, ...]
    multiplier: float


@dataclass(frozen=True)
class ConstrainedFit:
    """Solution of all six axes within limits; arrays (p,) in the order of `unknowns`.

    free: the same problem without limits. covariance (p, p): of the values given the
    active limits, 0 for what they fix; it takes force errors as independent from sample
    to sample unless `noise` says otherwise. free_covariance: without limits.
    data_variances (p,): without limits and prior, inf where the data leave an unknown
    open. rms, rms_free, j0 (6,) [N, N m]:
    residual force with and without limits, and measured force, prior not counted.
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    free: Array
    covariance: Array
    free_covariance: Array
    data_variances: Array
    active: tuple[ActiveLimit, ...]
    rms: Array
    rms_free: Array
    j0: Array
    noise: Array
    n_samples: int

    @property
    def standard_errors(self) -> Array:
        """Return the standard errors (p,); 0 for a value that limits fix."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def normalised(self) -> float:
        """Return J / J0 of the six axes together (N and N m mixed, as McCarter)."""
        return _total(self.rms) / _total(self.j0)

    @property
    def cost(self) -> float:
        """Return what the limits cost: J / J0 with them minus without."""
        return self.normalised - _total(self.rms_free) / _total(self.j0)

    def shift(self, equations: ForceEquations, change: NormalChange) -> Array:
        """Return how far an error of the data moves the values (p,), the limits kept.

        C sum_a W_a' (dq_a - dS W_a x) / s_a^2 with W_a the weights of axis a's columns.
        """
        pull = np.zeros(len(self.values))
        for i, axis in enumerate(AXES):
            weights = equations.weights(axis, change.terms)
            rest = change.target[:, i] - change.moment @ (weights @ self.values)
            pull += weights.T @ rest / self.noise[i] ** 2
        return np.asarray(self.covariance @ pull)

    def value(self, axis: str, term: str) -> float:
        """Return the value of one unknown."""
        return float(self.values[self.unknowns.index(Unknown(axis, term))])

    def by_axis(self) -> dict[str, dict[str, float]]:
        """Return axis -> term -> value of all unknowns, constants included."""
        table: dict[str, dict[str, float]] = {}
        for unknown, value in zip(self.unknowns, self.values.tolist(), strict=True):
            table.setdefault(unknown.axis, {})[unknown.term] = value
        return table


def fit_within(
    factor: TriangularFactor,
    equations: ForceEquations,
    *,
    limits: Sequence[InequalityRows] = (),
    cuts: Sequence[Cuts] = (),
    priors: Sequence[NormalPrior] = (),
    noise: Mapping[str, float] | None = None,
) -> ConstrainedFit:
    """Return the coefficients of all six axes within limits and with priors.

    noise: axis -> deviation of the force error of one independent sample [N, N m]; its
    default is the RMS residual of the axis's own least squares. Where errors are
    coloured give it times the root of n over the number of independent samples
    (`information.inflation`): a prior weighs accordingly. Where neither data nor prior
    determine a direction, the shortest solution in units of the columns is taken.
    Raises `DataError` for fewer samples than terms and for limits that contradict each
    other, `PipelineError` for columns or unknowns that do not exist.
    """
    from scipy.linalg import qr

    unknowns = equations.unknowns
    for axis in AXES:
        if factor.n_samples < len(equations.columns_of(axis)):
            raise DataError(
                "fewer samples than terms",
                field=axis,
                value=factor.n_samples,
                allowed=f"at least {len(equations.columns_of(axis))}",
            )
    blocks = {axis: _block(factor, equations, axis) for axis in AXES}
    s = _noise(factor, blocks, noise)
    weighted = [np.hstack([A, b[:, None]]) / s[i] for i, (A, b) in enumerate(blocks.values())]
    data = qr(np.vstack(weighted), mode="r")[0][: len(unknowns) + 1]
    rows = [prior.rows(unknowns) for prior in priors]
    stacked = np.vstack([data, *rows]) if rows else data
    R, d = stacked[:, :-1], stacked[:, -1]
    ridge = _ridge(R)
    R, d = np.vstack([R, ridge]), np.append(d, np.zeros(len(ridge)))
    free = minimise(R, d).x
    best = minimise(R, d, limits, cuts=cuts) if limits or cuts else None
    values = free if best is None else best.x
    active_rows = np.zeros((0, len(unknowns))) if best is None else best.rows
    names = () if best is None else best.active
    rise = np.zeros(0) if best is None else best.multipliers
    return ConstrainedFit(
        unknowns=unknowns,
        values=values,
        free=free,
        covariance=_covariance(R, active_rows),
        free_covariance=_covariance(R, np.zeros((0, len(unknowns)))),
        data_variances=_data_variances(data[:, :-1]),
        active=tuple(
            ActiveLimit(name, tuple(unknowns[j] for j in np.flatnonzero(row)), float(force))
            for name, row, force in zip(names, active_rows, rise, strict=True)
        ),
        rms=_rms(blocks, values, factor.n_samples),
        rms_free=_rms(blocks, free, factor.n_samples),
        j0=factor.column_rms[-6:],
        noise=s,
        n_samples=factor.n_samples,
    )


def force_error(factor: TriangularFactor, equations: ForceEquations, values: Array) -> Array:
    """Return the RMS force error (6,) [N, N m] of values (p,) on the data of a factor.

    Other data than the values were fitted to: a held-out leg.
    """
    blocks = {axis: _block(factor, equations, axis) for axis in AXES}
    return _rms(blocks, values, factor.n_samples)


def _block(factor: TriangularFactor, equations: ForceEquations, axis: str) -> tuple[Array, Array]:
    """Return A (k + 1, p), b (k + 1,) with |A x - b|^2 an axis's sum of squares."""
    from scipy.linalg import qr

    columns = equations.columns_of(axis)
    available = (*factor.terms, CONSTANT)
    for column in columns:
        if column not in available:
            raise PipelineError(
                "the factor has no column for this term",
                value=column,
                remedy=nearest(column, available),
            )
    index = [factor.columns.index(name) for name in (*columns, axis)]
    triangle = qr(factor.R[:, index], mode="r")[0][: len(index)]
    return triangle[:, :-1] @ equations.weights(axis, columns), triangle[:, -1]


def _noise(
    factor: TriangularFactor,
    blocks: Mapping[str, tuple[Array, Array]],
    noise: Mapping[str, float] | None,
) -> Array:
    """Return s_a (6,): as given, or of least squares on each axis alone."""
    j0 = factor.column_rms[-6:]
    least = np.maximum(SMALLEST_NOISE * j0, np.finfo(float).tiny ** 0.25)
    if noise is not None:
        return np.maximum([noise[axis] for axis in AXES], least)
    s = np.zeros(6)
    for i, (A, b) in enumerate(blocks.values()):
        used = A[:, np.any(A != 0.0, axis=0)]
        rest = b - used @ np.linalg.lstsq(used, b, rcond=RANK_TOLERANCE)[0]
        freedom = max(factor.n_samples - used.shape[1], 1)
        s[i] = np.sqrt(rest @ rest / freedom)
    return np.maximum(s, least)


def _ridge(R: Array) -> Array:
    """Return rows that settle what nothing determines; none where all is determined."""
    length = np.linalg.norm(R, axis=0)
    scale = np.where(length > 0.0, length, 1.0)
    singular = np.linalg.svd(R / scale, compute_uv=False)
    if len(singular) == R.shape[1] and singular[-1] > RANK_TOLERANCE * singular[0]:
        return np.zeros((0, R.shape[1]))
    return np.asarray(RIDGE * np.diag(scale))


def _covariance(R: Array, active_rows: Array) -> Array:
    """Return Z (Z' R'R Z)^-1 Z' with Z the directions that active rows leave open."""
    from scipy.linalg import null_space, qr, solve_triangular

    scale = np.linalg.norm(R, axis=0)
    Z = null_space(active_rows / scale) if len(active_rows) else np.eye(R.shape[1])
    T = qr(R / scale @ Z, mode="r")[0][: Z.shape[1]]
    half = Z @ solve_triangular(T, np.eye(len(T))) if Z.shape[1] else np.zeros((len(scale), 0))
    return np.asarray(half @ half.T / np.outer(scale, scale))


def _data_variances(R: Array) -> Array:
    """Return the variance (p,) of each unknown from the data alone, inf for none."""
    length = np.linalg.norm(R, axis=0)
    scale = np.where(length > 0.0, length, 1.0)
    _, singular, V = np.linalg.svd(R / scale, full_matrices=False)
    determined = singular > RANK_TOLERANCE * singular[0]
    missing = np.linalg.norm(V[~determined], axis=0) > np.sqrt(RANK_TOLERANCE)
    variances = np.sum((V[determined] / singular[determined, None]) ** 2, axis=0) / scale**2
    return np.asarray(np.where(missing | (length == 0.0), np.inf, variances))


def _rms(blocks: Mapping[str, tuple[Array, Array]], x: Array, n: int) -> Array:
    lengths = np.array([np.linalg.norm(A @ x - b) for A, b in blocks.values()])
    return np.asarray(lengths / np.sqrt(n))


def _total(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
