"""All linear models of a campaign from one triangular factor of the data.

Equations of McCarter 2014: (4.14)-(4.21).

The synthesis model (4.20) is block diagonal by axis, so a model is six least-squares
problems on columns of one matrix [basis terms, constant, X Y Z K M N]. Only its
triangular factor R is kept: R'R is the Gram matrix of those columns, but R comes from
QR of [R; chunk], so no normal equations are formed. Factors merge, so legs and
processes combine exactly, and every model, axis, term subset and leave-one-leg-out fold
is solved from R alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError, PipelineError, nearest
from auvid.hydro.arrays import AXES, Array

CONSTANT = "constant"
"""The column of ones: a constant force on an axis (trim)."""
RANK_TOLERANCE = 1e-8
"""A column counts as a combination of others when less than this share of its length
stands apart from them.
"""
CHUNK_SAMPLES = 1024
BLOCK_COLUMNS = 16


@dataclass(frozen=True)
class TriangularFactor:
    """Triangular factor R (m, m) of [terms, constant, X Y Z K M N] over all samples.

    Upper triangular with non-negative diagonal; `n_samples` samples.
    """

    columns: tuple[str, ...]
    R: Array
    n_samples: int

    @classmethod
    def empty(cls, terms: Sequence[str]) -> TriangularFactor:
        """Return the factor of no samples, with constant and forces added."""
        columns = (*terms, CONSTANT, *AXES)
        if len(set(columns)) != len(columns):
            raise PipelineError(
                "a basis term occurs twice or has a reserved name", value=sorted(terms)
            )
        return cls(columns, np.zeros((len(columns), len(columns)), order="F"), 0)

    @property
    def terms(self) -> tuple[str, ...]:
        """Return the basis terms, without constant and forces."""
        return self.columns[:-7]

    @cached_property
    def column_norms(self) -> Array:
        """Return the Euclidean length (m,) of every column of the data."""
        return np.asarray(np.linalg.norm(self.R, axis=0))

    @property
    def column_rms(self) -> Array:
        """Return the root mean square (m,) of every column of the data."""
        return np.asarray(self.column_norms / np.sqrt(max(self.n_samples, 1)))

    def update(self, rows: ArrayLike, forces: ArrayLike) -> TriangularFactor:
        """Return the factor with n more samples: basis rows (k, n), forces (n, 6).

        Raises `DataError` when a value is not finite or the shapes do not fit. Nothing
        is written to.
        """
        basis, force = np.asarray(rows, dtype=np.float64), np.asarray(forces, dtype=np.float64)
        n = force.shape[0]
        if basis.shape != (len(self.terms), n) or force.shape != (n, 6):
            raise DataError(
                "basis rows and forces do not fit the factor",
                value=(basis.shape, force.shape),
                allowed=f"({len(self.terms)}, n), (n, 6)",
            )
        R = np.array(self.R, order="F")
        for start in range(0, n, CHUNK_SAMPLES):
            stop = min(start + CHUNK_SAMPLES, n)
            block = np.empty((len(self.columns), stop - start))
            block[:-7], block[-7], block[-6:] = basis[:, start:stop], 1.0, force[start:stop].T
            R = _absorb(R, block.T)
        if not np.isfinite(R).all():
            self._name_bad_column(basis, force)
        return TriangularFactor(self.columns, _positive_diagonal(R), self.n_samples + n)

    def merge(self, other: TriangularFactor) -> TriangularFactor:
        """Return the factor of both sets of samples.

        Exact up to rounding; the same order of merging gives the same bits.
        """
        if self.columns != other.columns:
            raise PipelineError("factors of different columns cannot be merged")
        R = _absorb(np.array(self.R, order="F"), np.array(other.R, order="F"))
        return TriangularFactor(
            self.columns, _positive_diagonal(R), self.n_samples + other.n_samples
        )

    def with_rows(self, rows: ArrayLike) -> TriangularFactor:
        """Return the factor with more equations (r, m) on its columns, as a prior.

        They are no samples: `n_samples` stays.
        """
        R = _absorb(np.array(self.R, order="F"), np.array(rows, dtype=np.float64, order="F"))
        return TriangularFactor(self.columns, _positive_diagonal(R), self.n_samples)

    def _name_bad_column(self, basis: Array, force: Array) -> None:
        values = np.vstack([basis, np.ones(len(force)), force.T])
        bad = np.argwhere(~np.isfinite(values))
        if not len(bad):
            raise DataError("the values are too large to be squared")
        row, sample = (int(i) for i in bad[0])
        raise DataError(
            "a value is not finite",
            row=sample,
            field=self.columns[row],
            value=float(values[row, sample]),
        )


@dataclass(frozen=True)
class Combination:
    """A weighted sum of coefficients that the data determine.

    sum weights[term] * coefficient[term] = value +- standard_error.
    """

    weights: dict[str, float]
    value: float
    standard_error: float

    def __str__(self) -> str:
        parts = [
            f"{'-' if w < 0 else '+'} {'' if abs(abs(w) - 1) < 1e-6 else f'{abs(w):.4g} '}{term}"
            for term, w in self.weights.items()
        ]
        return f"{' '.join(parts).removeprefix('+ ')}: {self.value:.4g}"


@dataclass(frozen=True)
class InseparableGroup:
    """Terms whose columns depend on each other, and their determined combinations."""

    terms: tuple[str, ...]
    combinations: tuple[Combination, ...]


@dataclass(frozen=True)
class AxisFit:
    """Least-squares fit of one axis; arrays (k,) in the order of `terms`.

    coefficients: nan for members of an inseparable group and for terms whose column is
    zero. solution: numbers that predict the fitted force: as `coefficients`, a group's
    combinations at its representatives, 0 elsewhere. independent: indices of the terms
    that carry a number in `solution`; `scaled_triangle` is the factor of their
    unit-length columns. standard_errors: for white residuals; at a group's
    representative, of its combination; nan where `solution` is 0 by default. vif:
    variance inflation, 1 / (share of the column that is its own)^2. rank of k;
    condition of the scaled independent columns. sse [N^2 or (N m)^2], rms of the
    residual and j0, the rms of the measured force [N or N m].
    """

    axis: str
    terms: tuple[str, ...]
    coefficients: Array
    solution: Array
    standard_errors: Array
    vif: Array
    column_norms: Array
    independent: tuple[int, ...]
    scaled_triangle: Array
    groups: tuple[InseparableGroup, ...]
    zero_terms: tuple[str, ...]
    rank: int
    condition: float
    sse: float
    j0: float
    n_samples: int

    @property
    def rms(self) -> float:
        """Return the root mean square of the residual on the training samples."""
        return float(np.sqrt(self.sse / self.n_samples))

    @property
    def column_rms(self) -> Array:
        """Return the root mean square (k,) of each term's column."""
        return np.asarray(self.column_norms / np.sqrt(self.n_samples))

    @cached_property
    def covariance(self) -> Array:
        """Return the covariance (k, k) of `solution` for white residuals.

        Rows of undetermined terms are nan.
        """
        from scipy.linalg import cho_solve

        kept = list(self.independent)
        freedom = self.n_samples - len(kept)
        variance = self.sse / freedom if freedom > 0 else np.nan
        full = np.full((len(self.terms), len(self.terms)), np.nan)
        scale = self.column_norms[kept]
        full[np.ix_(kept, kept)] = (
            variance
            * cho_solve((self.scaled_triangle, False), np.eye(len(kept)))
            / np.outer(scale, scale)
        )
        return full


def solve_axis(
    factor: TriangularFactor, axis: str, terms: Sequence[str], *, trim: bool = False
) -> AxisFit:
    """Fit the force on one axis with `terms` from the factor alone: (4.20)-(4.21).

    min over kappa of |Xi kappa - sigma|^2, one axis at a time. `trim` adds a constant.
    Columns are scaled to unit length; the rank is the number of pivots above
    `RANK_TOLERANCE` of QR with column pivoting. Where columns depend on each other, the
    earliest terms are taken as representatives, and each group of dependent terms is
    reported with the combinations that the data determine. Raises `PipelineError` for
    an unknown axis or term, `DataError` for an empty factor.
    """
    from scipy.linalg import solve_triangular

    columns = (*terms, CONSTANT) if trim else tuple(terms)
    index = [_column(factor, term) for term in columns]
    if axis not in AXES:
        raise PipelineError("unknown axis", value=axis, allowed=AXES)
    if not factor.n_samples:
        raise DataError("no training data: the factor is empty")
    target = factor.R[:, factor.columns.index(axis)]
    norms = factor.column_norms[index]
    alive = [i for i, norm in enumerate(norms) if norm > 0]
    scaled = factor.R[:, [index[i] for i in alive]] / norms[alive]
    kept, dependent, weights = _split_by_rank(scaled)
    Q, triangle = np.linalg.qr(scaled[:, kept])
    values = solve_triangular(triangle, Q.T @ target) if kept else np.zeros(0)
    residual = target - scaled[:, kept] @ values
    sse = float(residual @ residual)

    kept_terms, dependent_terms = [alive[i] for i in kept], [alive[i] for i in dependent]
    solution = np.zeros(len(columns))
    solution[kept_terms] = values / norms[kept_terms]
    inverse = solve_triangular(triangle, np.eye(len(kept))) if kept else np.zeros((0, 0))
    spread = np.sqrt(np.sum(inverse**2, axis=1))
    freedom = factor.n_samples - len(kept)
    standard_errors, vif = np.full(len(columns), np.nan), np.full(len(columns), np.nan)
    standard_errors[kept_terms] = (
        spread * (np.sqrt(sse / freedom) if freedom > 0 else np.nan) / norms[kept_terms]
    )
    vif[kept_terms] = spread**2
    vif[dependent_terms] = np.inf

    unscaled = (
        weights * norms[dependent_terms] / norms[kept_terms][:, None]
        if dependent
        else np.zeros((len(kept), 0))
    )
    groups = _groups(
        columns, kept_terms, dependent_terms, unscaled, weights, solution, standard_errors
    )
    coefficients = solution.copy()
    zero = tuple(term for term, norm in zip(columns, norms, strict=True) if norm == 0)
    undetermined = {*zero, *(term for group in groups for term in group.terms)}
    coefficients[[i for i, term in enumerate(columns) if term in undetermined]] = np.nan
    singular = np.linalg.svd(triangle, compute_uv=False) if kept else np.ones(1)
    return AxisFit(
        axis=axis,
        terms=columns,
        coefficients=coefficients,
        solution=solution,
        standard_errors=standard_errors,
        vif=vif,
        column_norms=norms,
        independent=tuple(kept_terms),
        scaled_triangle=triangle,
        groups=groups,
        zero_terms=zero,
        rank=len(kept),
        condition=float(singular[0] / singular[-1]),
        sse=sse,
        j0=float(np.sqrt(target @ target / factor.n_samples)),
        n_samples=factor.n_samples,
    )


def _absorb(R: Array, block: Array) -> Array:
    """Return the triangular factor of [R; block], by LAPACK's dtpqrt.

    Both arguments are Fortran-ordered and overwritten.
    """
    from scipy.linalg import lapack

    R, _, _, info = lapack.dtpqrt(
        0, min(BLOCK_COLUMNS, len(R)), R, block, overwrite_a=1, overwrite_b=1
    )
    if info:
        raise RuntimeError(f"dtpqrt refused argument {-info}")
    return R


def _positive_diagonal(R: Array) -> Array:
    """Return R with non-negative diagonal: equal data give equal factors."""
    signs = np.where(np.diag(R) < 0, -1.0, 1.0)
    R = np.asfortranarray(np.triu(R) * signs[:, None])
    R.flags.writeable = False
    return R


def _column(factor: TriangularFactor, term: str) -> int:
    columns = (*factor.terms, CONSTANT)
    if term not in columns:
        raise PipelineError(
            "the factor has no column for this term", value=term, remedy=nearest(term, columns)
        )
    return columns.index(term)


def _split_by_rank(scaled: Array) -> tuple[list[int], list[int], Array]:
    """Return independent columns, dependent columns and the weights between them.

    scaled[:, dependent] = scaled[:, independent] @ weights.
    """
    from scipy.linalg import qr

    k = scaled.shape[1]
    if not k:
        return [], [], np.zeros((0, 0))
    pivoted, order = qr(scaled, mode="r", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(pivoted)[:k]) > RANK_TOLERANCE))
    if rank == k:
        return list(range(k)), [], np.zeros((k, 0))
    kept = _earliest(scaled, rank) or sorted(int(i) for i in order[:rank])
    dependent = [i for i in range(k) if i not in kept]
    weights = np.linalg.lstsq(scaled[:, kept], scaled[:, dependent], rcond=None)[0]
    return kept, dependent, np.where(np.abs(weights) > np.sqrt(RANK_TOLERANCE), weights, 0.0)


def _earliest(scaled: Array, rank: int) -> list[int] | None:
    """Return the first columns that are independent of those before them.

    None if they are fewer than the rank.
    """
    base = np.zeros((scaled.shape[0], 0))
    kept: list[int] = []
    for i, column in enumerate(scaled.T):
        rest = column - base @ (base.T @ column)
        rest -= base @ (base.T @ rest)
        length = float(np.linalg.norm(rest))
        if length > RANK_TOLERANCE:
            kept.append(i)
            base = np.column_stack([base, rest / length])
    return kept if len(kept) == rank else None


def _groups(
    terms: Sequence[str],
    kept: list[int],
    dependent: list[int],
    weights: Array,
    scaled_weights: Array,
    solution: Array,
    errors: Array,
) -> tuple[InseparableGroup, ...]:
    """Return the connected sets of dependent terms.

    Which sets they are does not depend on the choice of representatives.
    """
    group_of: dict[int, set[int]] = {}
    for column, term in enumerate(dependent):
        members = {term, *(kept[row] for row in np.flatnonzero(scaled_weights[:, column]))}
        for other in list(members):
            members |= group_of.get(other, set())
        for member in members:
            group_of[member] = members
    groups = []
    for members in {id(group): group for group in group_of.values()}.values():
        combinations = []
        for row, term in enumerate(kept):
            if term in members:
                shares = {
                    terms[other]: float(weights[row, col])
                    for col, other in enumerate(dependent)
                    if scaled_weights[row, col]
                }
                combinations.append(
                    Combination(
                        {terms[term]: 1.0, **shares}, float(solution[term]), float(errors[term])
                    )
                )
        groups.append(
            InseparableGroup(tuple(terms[i] for i in sorted(members)), tuple(combinations))
        )
    return tuple(sorted(groups, key=lambda group: terms.index(group.terms[0])))
