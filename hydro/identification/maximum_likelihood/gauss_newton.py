"""Damped Gauss-Newton on unknowns common to all windows and local ones.

The damping is that of Levenberg and Marquardt.

Source: Nocedal and Wright, Numerical Optimization, 10.3 (method) and 16.7 (bounds).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Mask

FIRST_DAMPING, SMALLEST_DAMPING, LARGEST_DAMPING = 1e-4, 1e-12, 1e8
FELT_DAMPING = 0.1
"""Least damping after a step that failed: less would hardly shorten it."""
DIVERGES = "the motion diverges at the starting values"
LEAST_CURVATURE = 0.2
"""A secant counts with at least this share of the expected curvature."""
LEAST_PIVOT = 1e-4
"""Of scaled systems: with less, two ways to solve them differ by more than 1e-8."""
GAIN = 0.05
"""A step that changes the log-likelihood by less changes no conclusion: half of it is a
fortieth of what one coefficient takes away by being fitted."""


@dataclass(frozen=True)
class NormalEquations:
    """N delta = b with local unknowns of each window taken out when they are solved.

    common: `matrix` (g, g) and `vector` (g,); window by window: `local` (l, l),
    `coupling` (l, g), `right` (l,). Without local unknowns the lists are empty.
    """

    matrix: Array
    vector: Array
    local: tuple[Array, ...] = ()
    coupling: tuple[Array, ...] = ()
    right: tuple[Array, ...] = ()

    def reduced(self, damping: float = 0.0) -> tuple[Array, Array]:
        """Return the Schur complement (g, g) and its right-hand side (g,)."""
        matrix, vector = self.matrix.copy(), self.vector.copy()
        matrix.flat[:: len(matrix) + 1] *= 1.0 + damping
        if self.local:
            across, right = np.array(self.coupling), np.array(self.right)[..., None]
            solved = solve_each(
                _damped(np.array(self.local), damping), np.concatenate([across, right], axis=2)
            )
            taken = (across.swapaxes(1, 2) @ solved).sum(axis=0)
            matrix -= taken[:, :-1]
            vector -= taken[:, -1]
        return 0.5 * (matrix + matrix.T), vector

    def local_steps(self, step: Array, damping: float = 0.0) -> Array:
        """Return the steps (w, l) of local unknowns that go with a common one."""
        if not self.local:
            return np.zeros((0, 0))
        rights = np.array(self.right) - np.array(self.coupling) @ step
        return solve_each(_damped(np.array(self.local), damping), rights[..., None])[..., 0]


@dataclass(frozen=True)
class Evaluation:
    """Minus the log-likelihood with the prior, and its normal equations."""

    objective: float
    equations: NormalEquations | None


@dataclass(frozen=True)
class Optimum:
    """Where the iteration ended: common (g,) and local unknowns (w, l).

    `objectives`: minus the log-likelihood at the start and after each step taken;
    `word`: `converged`, `no convergence`; `at_bound` (g,).
    """

    common: Array
    local: Array
    objectives: tuple[float, ...]
    word: str
    at_bound: Mask


Evaluate = Callable[[Array, Array, bool], Evaluation]
"""(common, local, with normal equations) -> evaluation."""


def maximise(
    evaluate: Evaluate,
    common: Array,
    local: Array,
    *,
    lower: Array,
    upper: Array,
    most_steps: int,
    tolerance: float = 0.02,
    least_gain: float = 0.0,
    reach: tuple[Array, Array] | None = None,
    move: Callable[[Array, Array], Array] = np.add,
) -> Optimum:
    """Return the optimum within bounds from a start.

    Steps stay within `reach`, two of (g,), and take unknowns to `move(common, step)`.

    A step is taken when the objective falls, or changes by less than `GAIN`. It has
    converged when no common unknown moves by more than `tolerance` of its standard
    error, or when the full step promises less than `least_gain` (then it is not taken).
    Raises `DataError` where the start itself diverges.
    """
    common = np.clip(common, lower, upper)
    here = evaluate(common, local, True)
    if not np.isfinite(here.objective):
        raise DataError(
            DIVERGES,
            remedy="Choose shorter windows, filter error, or damped starting coefficients.",
        )
    objectives, damping, word = [here.objective], FIRST_DAMPING, "no convergence"
    fixed = np.zeros(len(common), dtype=bool)
    for _ in range(most_steps):
        assert here.equations is not None
        taken = False
        while damping < LARGEST_DAMPING:
            low, high = lower, upper
            if reach is not None:
                low, high = (
                    np.maximum(lower, common + reach[0]),
                    np.minimum(upper, common + reach[1]),
                )
            step, fixed, spread = bounded_step(here.equations, common, low, high, damping)
            moves = here.equations.local_steps(step, damping)
            rights = here.equations.right
            promise = 0.5 * float(step @ here.equations.vector)
            promise += 0.5 * sum(float(a @ b) for a, b in zip(moves, rights, strict=True))
            # A step that bounds bend may promise a loss: it is shortened, not the end.
            if 0.0 <= promise < least_gain and damping < FELT_DAMPING:
                small = True
                break
            moved = np.clip(move(common, step), lower, upper)
            shifted = local + moves if len(moves) else local
            small = bool(np.all(np.abs(moved - common) <= tolerance * spread))
            there = evaluate(moved, shifted, False)
            if there.objective < here.objective + (GAIN if small else 0.0):
                taken = True
                break
            if small:
                break
            damping = max(10.0 * damping, FELT_DAMPING)
        if not taken:
            word = "converged" if small else "no convergence"
            break
        common, local, here = moved, shifted, evaluate(moved, shifted, True)
        objectives.append(here.objective)
        damping = max(damping / 10.0, SMALLEST_DAMPING)
        if small:
            word = "converged"
            break
    fixed &= (common <= lower) | (common >= upper)
    return Optimum(common, local, tuple(objectives), word, fixed)


def bounded_step(
    equations: NormalEquations, common: Array, lower: Array, upper: Array, damping: float
) -> tuple[Array, Mask, Array]:
    """Return a step (g,), which unknowns a bound holds, and standard errors (g,).

    Active set: unknowns that the step would carry past a bound are put on it, one
    round after the other, and the others are solved again. The standard error of what
    ends on a bound is that with all others known: a way to it may be long.
    """
    matrix, vector = equations.reduced(damping)
    fixed = np.zeros(len(common), dtype=bool)
    step = np.zeros(len(common))
    for _ in range(len(common) + 1):
        free = ~fixed
        right = vector[free] - matrix[np.ix_(free, fixed)] @ step[fixed]
        step[free] = solve_scaled(matrix[np.ix_(free, free)], right)
        past = free & ((common + step < lower) | (common + step > upper))
        if not past.any():
            break
        step[past] = np.clip(common[past] + step[past], lower[past], upper[past]) - common[past]
        fixed |= past
    free = ~fixed
    diagonal = np.diag(matrix)
    spread = np.where(diagonal > 0.0, diagonal, np.inf) ** -0.5
    if free.any():
        inverse = solve_scaled(matrix[np.ix_(free, free)], np.eye(int(free.sum())))
        spread[free] = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    return step, fixed, spread


def with_secants(matrix: Array, pairs: Sequence[tuple[Array, Array]]) -> Array:
    """Return a matrix (g, g) that maps past steps onto past changes of the gradient.

    Of each pair (step s, change y), oldest first: B - B s s' B / (s' B s) + y y' / (y' s)
    (BFGS), y drawn towards B s where the curvature is not positive (Nocedal and Wright,
    6.19 and procedure 18.2). Expected information has the curvature of data that the
    model explains; real data have another.
    """
    out = matrix
    for step, change in pairs:
        product = out @ step
        expected, own = float(step @ product), float(step @ change)
        if expected <= 0.0:
            continue
        if own < LEAST_CURVATURE * expected:
            share = (1.0 - LEAST_CURVATURE) * expected / (expected - own)
            change = share * change + (1.0 - share) * product
        out = (
            out
            - np.outer(product, product) / expected
            + np.outer(change, change) / float(step @ change)
        )
    return out


def solve_scaled(matrix: Array, right: Array) -> Array:
    """Solve a symmetric system after scaling its diagonal to 1.

    An unknown without information keeps its right-hand side; directions with less than
    1e-13 of the others get next to no step.
    """
    from scipy.linalg.lapack import dposv

    if not matrix.size:
        return right.copy()
    diagonal = matrix.diagonal()
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrix / (scale[:, None] * scale)
    scaled.flat[:: len(scaled) + 1] = 1.0 + 1e-13
    shaped = (right.T / scale).T
    if not (np.isfinite(scaled).all() and np.isfinite(shaped).all()):
        raise np.linalg.LinAlgError("normal equations must not contain infs or NaNs")
    _, solved, failed = dposv(scaled, shaped)
    if failed:
        values, vectors = np.linalg.eigh(scaled)
        kept = values > 1e-13 * values[-1]
        solved = (vectors[:, kept] / values[kept]) @ (vectors[:, kept].T @ shaped)
    return np.asarray((solved.T / scale).T)


def solve_each(matrices: Array, rights: Array) -> Array:
    """Solve symmetric systems (w, l, l) for (w, l, r) as `solve_scaled` does one."""
    size = matrices.shape[1]
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrices / (scale[:, :, None] * scale[:, None, :])
    scaled[:, range(size), range(size)] = 1.0 + 1e-13
    shaped = rights / scale[:, :, None]
    if not (np.isfinite(scaled).all() and np.isfinite(shaped).all()):
        raise np.linalg.LinAlgError("normal equations must not contain infs or NaNs")
    try:
        root = np.linalg.cholesky(scaled)
        informed = np.diagonal(root, axis1=1, axis2=2).min(initial=1.0) > LEAST_PIVOT
    except np.linalg.LinAlgError:
        informed = False
    if not informed:  # in one direction at least
        return np.array([solve_scaled(*each) for each in zip(matrices, rights, strict=True)])
    return np.asarray(np.linalg.solve(scaled, shaped) / scale[:, :, None])


def _damped(blocks: Array, damping: float) -> Array:
    out = blocks.copy()
    diagonal = np.arange(out.shape[-1])
    out[..., diagonal, diagonal] *= 1.0 + damping
    return out
