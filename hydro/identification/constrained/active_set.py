"""Least squares under linear inequalities, exactly, by the dual active set method.

Goldfarb & Idnani 1983. It starts from the free minimum and takes in the most violated
row, one after the other. So thousands of rows cost no more than their product with the
solution, and rows can be made while it runs (cutting planes).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array

FEASIBLE = 1e-12
"""A row of unit length counts as satisfied up to this share of the solution's size."""
DEPENDENT = 1e-9
"""A row counts as a combination of active ones when less than this share is its own."""


@dataclass(frozen=True)
class InequalityRows:
    """Rows (c, p) with rows @ x <= bounds (c,); `describe(i)` names the i-th."""

    rows: Array
    bounds: Array
    describe: Callable[[int], str]


Cuts = Callable[[Array], InequalityRows]
"""x (p,) -> rows that x violates; none where it violates none."""


@dataclass(frozen=True)
class Minimum:
    """The solution x (p,), the names of its active rows, and their multipliers.

    rows (a, p) are the active ones; multipliers (a,) > 0 say by how much the sum of
    squares falls per unit of a row's bound.
    """

    x: Array
    active: tuple[str, ...]
    rows: Array
    multipliers: Array


class _Pool:
    """All rows so far, of unit length in scaled unknowns counted from `start`."""

    def __init__(self, scale: Array, start: Array) -> None:
        self.scale, self.start = scale, start
        self.rows, self.bounds = np.zeros((0, len(scale))), np.zeros(0)
        self.origin: list[tuple[InequalityRows, int]] = []
        self.length = np.zeros(0)

    def add(self, new: InequalityRows) -> None:
        if not len(new.bounds):
            return
        rows = new.rows / self.scale
        length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
        impossible = np.flatnonzero((length == 0.0) & (new.bounds < 0.0))
        if len(impossible):
            raise DataError("a limit cannot be met", field=new.describe(int(impossible[0])))
        kept = np.flatnonzero(length > 0.0)
        units = rows[kept] / length[kept, None]
        self.rows = np.vstack([self.rows, units])
        self.bounds = np.append(self.bounds, new.bounds[kept] / length[kept] - units @ self.start)
        self.length = np.append(self.length, length[kept])
        self.origin += [(new, int(i)) for i in kept]

    def takes_in(self, cut: Cuts, x: Array, tolerance: float) -> bool:
        """Add the rows of a cut at x - start; return whether x violates one."""
        before = len(self.bounds)
        self.add(cut((x + self.start) / self.scale))
        excess = self.rows[before:] @ x - self.bounds[before:]
        return len(excess) > 0 and bool(excess.max() > tolerance)

    def counted_from(self, start: Array) -> _Pool:
        other = _Pool(self.scale, start)
        other.rows, other.length = self.rows, self.length
        other.bounds = self.bounds + self.rows @ (self.start - start)
        other.origin = list(self.origin)
        return other

    def name(self, index: int) -> str:
        rows, i = self.origin[index]
        return rows.describe(i)


def minimise(
    R: Array, d: Array, limits: Sequence[InequalityRows] = (), *, cuts: Sequence[Cuts] = ()
) -> Minimum:
    """Return the x (p,) that minimises |R x - d|^2 with every row satisfied.

    R (m, p) of full column rank, d (m,). `cuts` are asked for more rows as soon as the
    present ones hold, until they have none. Raises `DataError` that names rows which
    contradict each other.

    >>> rows = InequalityRows(np.array([[1.0, 0.0]]), np.array([0.0]), lambda i: "x <= 0")
    >>> best = minimise(np.eye(2), np.array([2.0, 3.0]), [rows])
    >>> best.x.tolist(), best.active, best.multipliers.tolist()
    ([0.0, 3.0], ('x <= 0',), [4.0])
    """
    return LimitedProblem(R, limits, cuts=cuts).minimum(d)


class LimitedProblem:
    """The problem of `minimise` for many d or points, whose factors are made once."""

    def __init__(
        self,
        R: Array,
        limits: Sequence[InequalityRows] = (),
        *,
        cuts: Sequence[Cuts] = (),
    ) -> None:
        self.cuts = cuts
        self.scale = np.linalg.norm(R, axis=0)
        self.Q, T = np.linalg.qr(R / self.scale)
        self.J = _triangular(T, np.eye(len(T)))
        self.limits = _Pool(self.scale, np.zeros(len(self.scale)))
        for item in limits:
            self.limits.add(item)

    def minimum(self, d: Array) -> Minimum:
        """Return the x (p,) that minimises |R x - d|^2 within the limits."""
        return self._within(self.Q.T @ d, self.limits.start)

    def nearest(self, point: Array) -> Minimum:
        """Return the x (p,) that minimises |R (x - point)|^2 within the limits.

        Counted from the point, so that rounding is that of the step from it.
        """
        return self._within(np.zeros(len(point)), point * self.scale)

    def _within(self, target: Array, start: Array) -> Minimum:
        pool, J, scale = self.limits.counted_from(start), self.J, self.scale
        x = J @ target
        active: list[int] = []
        dual = np.zeros(0)
        span = _Span(len(x))
        while True:
            tolerance = FEASIBLE * max(1.0, math.sqrt(x @ x))
            excess = pool.rows @ x - pool.bounds
            excess[active] = 0.0
            if len(excess) and excess.max() > tolerance:
                entering = int(np.argmax(excess))
                x, active, dual = _take_in(J, x, active, dual, pool, entering, span)
                continue
            if not any(pool.takes_in(cut, x, tolerance) for cut in self.cuts):
                break
        x, dual = _settled(J, target, pool, active)
        lengths = pool.length[active]
        return Minimum(
            (x + start) / scale,
            tuple(pool.name(i) for i in active),
            pool.rows[active] * lengths[:, None] * scale,
            2.0 * dual / lengths,
        )


class _Span:
    """Basis (p, a) and triangle (a, a) with basis @ triangle = active rows, in columns.

    A row that enters adds one column to both; only one that leaves factors all again.
    """

    def __init__(self, size: int) -> None:
        self._basis, self._triangle = np.zeros((size, size), order="F"), np.zeros((size, size))
        self._count = 0

    @property
    def basis(self) -> Array:
        return self._basis[:, : self._count]

    @property
    def triangle(self) -> Array:
        return self._triangle[: self._count, : self._count]

    def split(self, direction: Array) -> tuple[Array, Array]:
        """Return the part (a,) of a direction (p,) in the basis, and the rest (p,)."""
        basis = self.basis
        along = basis.T @ direction
        rest = direction - basis @ along
        again = basis.T @ rest  # rounding of the first pass
        return along + again, rest - basis @ again

    def add(self, along: Array, rest: Array) -> None:
        length = math.sqrt(rest @ rest)
        self._basis[:, self._count] = rest / length
        self._triangle[: self._count, self._count] = along
        self._triangle[self._count, self._count] = length
        self._count += 1

    def set_to(self, columns: Array) -> None:
        basis, triangle = np.linalg.qr(columns)
        self._count = columns.shape[1]
        self._basis[:, : self._count] = basis
        self._triangle[: self._count, : self._count] = triangle


def _take_in(
    J: Array,
    x: Array,
    active: list[int],
    dual: Array,
    pool: _Pool,
    entering: int,
    span: _Span,
) -> tuple[Array, list[int], Array]:
    """Return x, active rows and their dual values once the entering row holds.

    span: of the active rows; the entering one is added.
    """
    row, bound, own = pool.rows[entering], pool.bounds[entering], 0.0
    direction = J.T @ row
    while True:
        # Split the row into what the active rows span and what is its own.
        along, rest = span.split(direction)
        change = _triangular(span.triangle, along) if active else np.zeros(0)
        # Dual step: until an active row's dual value reaches zero.
        falling = np.flatnonzero(change > 0.0)
        ratios = dual[falling] / change[falling]
        blocking = int(falling[np.argmin(ratios)]) if len(falling) else -1
        dual_step = float(ratios.min()) if len(falling) else np.inf
        # Primal step: until the entering row holds.
        square = float(rest @ rest)
        independent = square > DEPENDENT**2 * float(direction @ direction)
        step = (float(row @ x) - bound) / square if independent else np.inf
        if not np.isfinite(min(step, dual_step)):
            others = [pool.name(i) for i in active]
            raise DataError(
                "limits contradict each other",
                field=pool.name(entering),
                value=f"together with {', '.join(others)}",
                remedy="Widen or remove one of them.",
            )
        taken = min(step, dual_step)
        if independent:
            x = x - taken * (J @ rest)
        dual, own = dual - taken * change, own + taken
        if step <= dual_step:
            span.add(along, rest)
            return x, [*active, entering], np.append(dual, own)
        active, dual = active[:blocking] + active[blocking + 1 :], np.delete(dual, blocking)
        span.set_to((pool.rows[active] @ J).T)


def _settled(J: Array, target: Array, pool: _Pool, active: list[int]) -> tuple[Array, Array]:
    """Return x and dual values for the final active rows, free of summed rounding."""
    if not active:
        return J @ target, np.zeros(0)
    basis, triangle = np.linalg.qr((pool.rows[active] @ J).T)
    # With y = T x: the minimum of |y - target| on rows J y = bounds.
    particular = _triangular(triangle, pool.bounds[active], transposed=True)
    y = target - basis @ (basis.T @ target - particular)
    return J @ y, _triangular(triangle, basis.T @ target - particular)


def _triangular(T: Array, b: Array, *, transposed: bool = False) -> Array:
    """Return T^-1 b or T'^-1 b of an upper triangle, unchecked."""
    from scipy.linalg.lapack import dtrtrs

    return np.asarray(dtrtrs(T, b, trans=int(transposed))[0])
