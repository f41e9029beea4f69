"""Error functions other than the sum of squares, on samples (McCarter 2014, 4.2).

A sum of squares comes from the triangular factor; a sum of moduli, a median or a
function that flattens for outliers needs the samples themselves. rows (k, n) are basis
rows, force (n,) the force of one axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.viscous.basis import basis_rows

HUBER_THRESHOLD = 1.345
"""In robust standard deviations: 95 % of the efficiency of least squares for normal
errors (Huber 1981).
"""
NORMAL_MAD = 0.6744897501960817
"""Median of |e| of a standard normal error."""
SEED = 0
ROUNDS = 500
"""Of reweighting, at most."""
SQUARES, ABSOLUTE, MEDIAN, HUBER = "squares", "absolute", "median", "huber"
ERROR_FUNCTIONS = (SQUARES, ABSOLUTE, MEDIAN, HUBER)
OWN, NELDER_MEAD = "own", "nelder_mead"
MINIMISERS = (OWN, NELDER_MEAD)
SIMPLEX_TERMS = 12
"""Coefficients beyond which the simplex of Nelder & Mead is not to be tried."""


def sum_of_squares(error: Array) -> float:
    """Return sum e^2 (4.22)."""
    return float(error @ error)


def sum_of_moduli(error: Array) -> float:
    """Return sum |e| (n times 4.23)."""
    return float(np.sum(np.abs(error)))


def median_of_moduli(error: Array) -> float:
    """Return the median of |e| (4.27)."""
    return float(np.median(np.abs(error)))


@dataclass(frozen=True)
class RobustFit:
    """Coefficients (k,), the robust deviation of the error, and weights (n,)."""

    coefficients: Array
    scale: float
    weights: Array


def minimise_error(
    rows: ArrayLike,
    force: ArrayLike,
    error_function: str,
    *,
    weights: ArrayLike | None = None,
    minimiser: str = OWN,
) -> Array:
    """Return the coefficients (k,) that minimise one of `ERROR_FUNCTIONS` of root(w) e.

    Weights (n,) are inverse variances: each error counts in its own deviations. Own
    minimisers: solution of the normal equations, linear programme, best of random
    subsets, reweighting. Raises `DataError` for Huber's function with the simplex, whose
    scale moves with the coefficients, and for too many coefficients.

    >>> minimise_error([[1.0, 1.0, 1.0]], [1.0, 2.0, 30.0], "absolute").round(6).tolist()
    [2.0]
    """
    A, b = _checked(rows, force)
    root = np.sqrt(_weights(weights, b))
    A, b = A * root[:, None], b * root
    if minimiser == NELDER_MEAD:
        if error_function == HUBER:
            raise DataError("the scale of Huber's function moves with the coefficients")
        if A.shape[1] > SIMPLEX_TERMS:
            raise DataError(
                "too many coefficients for a simplex", value=A.shape[1], allowed=SIMPLEX_TERMS
            )
        functions = {SQUARES: sum_of_squares, ABSOLUTE: sum_of_moduli, MEDIAN: median_of_moduli}
        start = least_squares(A.T, b)
        return nelder_mead(A.T, b, functions[error_function], start=start)
    if error_function == ABSOLUTE:
        return least_moduli(A.T, b)
    if error_function == MEDIAN:
        return least_median(A.T, b)
    return huber(A.T, b).coefficients if error_function == HUBER else least_squares(A.T, b)


def least_squares(rows: ArrayLike, force: ArrayLike, *, weights: ArrayLike | None = None) -> Array:
    """Return the coefficients (k,) that minimise sum w e^2; weights (n,)."""
    A, b = _checked(rows, force)
    root = np.sqrt(_weights(weights, b))
    scale = np.linalg.norm(A, axis=0)
    return np.asarray(np.linalg.lstsq(A / scale * root[:, None], b * root, rcond=None)[0] / scale)


def least_moduli(rows: ArrayLike, force: ArrayLike, *, weights: ArrayLike | None = None) -> Array:
    """Return the coefficients (k,) that minimise sum w |e|, exactly.

    As a linear programme, min w'(p + m) with A x + p - m = b and p, m >= 0, by its dual:
    max b'z with A'z = 0 and |z| <= w, of which x are the multipliers (HiGHS).

    >>> least_moduli([[1.0, 1.0, 1.0]], [1.0, 2.0, 30.0]).round(9).tolist()
    [2.0]
    """
    from scipy.optimize import linprog

    A, b = _checked(rows, force)
    w, scale = _weights(weights, b), np.linalg.norm(A, axis=0)
    size = max(float(np.abs(b).max()), np.finfo(float).tiny)
    answer = linprog(
        -b / size,
        A_eq=(A / scale).T,
        b_eq=np.zeros(A.shape[1]),
        bounds=np.column_stack([-w, w]),
        method="highs-ds",
    )
    if answer.status != 0:
        raise DataError("the linear programme has no solution", value=answer.message)
    return np.asarray(-answer.eqlin.marginals * size / scale)


def huber(rows: ArrayLike, force: ArrayLike) -> RobustFit:
    """Return Huber's estimate by reweighting: sum rho(e / s), s = median|e| / 0.6745.

    rho is e^2 / 2 up to `HUBER_THRESHOLD` deviations and linear beyond. Iterates until no
    coefficient moves by more than 1e-10 of the largest; raises `DataError` where it does
    not settle.
    """
    A, b = _checked(rows, force)
    unit = np.linalg.norm(A, axis=0)
    A = A / unit
    x = np.linalg.lstsq(A, b, rcond=None)[0]
    for _ in range(ROUNDS):
        error = b - A @ x
        scale = median_of_moduli(error) / NORMAL_MAD
        if scale == 0.0:
            return RobustFit(x / unit, 0.0, np.ones(len(b)))
        ratio = np.abs(error) / scale
        weights = HUBER_THRESHOLD / np.maximum(ratio, HUBER_THRESHOLD)
        root = np.sqrt(weights)
        new = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)[0]
        moved = float(np.abs(new - x).max())
        x = new
        if moved <= 1e-10 * float(np.abs(x).max()):
            return RobustFit(x / unit, scale, weights)
    raise DataError("Huber's estimate does not settle", value=ROUNDS, allowed="iterations")


def least_median(rows: ArrayLike, force: ArrayLike) -> Array:
    """Return coefficients (k,) of a small median of |e|: Rousseeuw 1984.

    The exact minimum takes all subsets of k samples. Here: the best exact fit through
    2000 random ones (and of the least moduli), then Nelder-Mead from it. Not a
    minimum that is proven, but half of the samples may be outliers.
    """
    A, b = _checked(rows, force)
    n, k = A.shape
    random = np.random.default_rng(SEED)
    best = least_moduli(A.T, b)
    least = median_of_moduli(b - A @ best)
    picks = np.array([random.choice(n, k, replace=False) for _ in range(2000)])
    good = np.abs(np.linalg.det(A[picks] / np.linalg.norm(A, axis=0))) > 1e-12 * n ** (-0.5 * k)
    for x in np.linalg.solve(A[picks[good]], b[picks[good]][..., None])[..., 0]:
        median = median_of_moduli(b - A @ x)
        if median < least:
            best, least = x, median
    return nelder_mead(A.T, b, median_of_moduli, start=best)


def nelder_mead(
    rows: ArrayLike, force: ArrayLike, error_function: Callable[[Array], float], *, start: ArrayLike
) -> Array:
    """Return coefficients (k,) of a local minimum of any error function of e (n,).

    For small models: the simplex of Nelder & Mead 1965 crawls beyond a handful of
    coefficients. It runs on columns of unit length made orthogonal, so that no
    direction is flat.
    """
    from scipy.optimize import minimize

    A, b = _checked(rows, force)
    Q, R = np.linalg.qr(A)
    x0 = R @ np.asarray(start, dtype=np.float64)
    step = 0.05 * max(float(np.linalg.norm(x0)), float(np.linalg.norm(b)) / len(b) ** 0.5)
    simplex = np.vstack([x0, x0 + step * np.eye(len(x0))])
    answer = minimize(
        lambda x: error_function(b - Q @ x),
        x0,
        method="Nelder-Mead",
        options={
            "initial_simplex": simplex,
            "xatol": 1e-9 * max(step, 1e-300),
            "fatol": 1e-12 * max(error_function(b), 1e-300),
            "maxiter": 4000 * len(x0),
            "maxfev": 8000 * len(x0),
            "adaptive": len(x0) > 4,
        },
    )
    if not answer.success:
        raise DataError("the simplex does not settle", value=int(answer.nit), allowed="iterations")
    return np.asarray(np.linalg.solve(R, answer.x))


def total_error(
    errors: ArrayLike, error_function: Callable[[Array], float], *, axis_weights: ArrayLike
) -> float:
    """Return sum over axes w_a J(e_a) of force errors (n, 6), with weights (6,).

    Weights 1 / J_a of a reference make the axes, N and N m, count alike.
    """
    e, w = np.asarray(errors, dtype=np.float64), np.asarray(axis_weights, dtype=np.float64)
    return float(sum(w[a] * error_function(e[:, a]) for a in range(e.shape[1])))


def deviation_weights(
    terms: tuple[str, ...],
    coefficients: ArrayLike,
    nu: ArrayLike,
    sd: ArrayLike,
    *,
    noise: float,
    ratio: ArrayLike | None = None,
) -> Array:
    """Return weights (n,) = noise^2 / variance of each sample's force error, <= 1.

    The variance is noise^2 [N or N m] plus what the deviations of the velocities sd (n,
    6) [m/s, rad/s] give the modelled force: sum over velocities of (d(xi K) / dnu_j
    sd_j)^2. ratio (n,): propulsion ratio, for terms that have it.
    """
    k = np.asarray(coefficients, dtype=np.float64)
    velocity, deviation = np.asarray(nu, dtype=np.float64), np.asarray(sd, dtype=np.float64)
    variance = np.full(len(velocity), noise**2)
    for j in range(6):
        shift = np.zeros_like(velocity)
        shift[:, j] = deviation[:, j]
        change = basis_rows((velocity + shift).T, ratio, terms) - basis_rows(
            (velocity - shift).T, ratio, terms
        )
        variance += (0.5 * change.T @ k) ** 2
    return np.asarray(noise**2 / variance)


def _checked(rows: ArrayLike, force: ArrayLike) -> tuple[Array, Array]:
    A, b = np.asarray(rows, dtype=np.float64).T, np.asarray(force, dtype=np.float64)
    if A.ndim != 2 or b.shape != A.shape[:1]:
        raise DataError("basis rows (k, n) and force (n,) disagree", value=(A.T.shape, b.shape))
    if len(b) < A.shape[1]:
        raise DataError("fewer samples than terms", value=len(b), allowed=f"at least {A.shape[1]}")
    if not (np.isfinite(A).all() and np.isfinite(b).all()):
        raise DataError("a value is not finite")
    if np.linalg.matrix_rank(A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)) < A.shape[1]:
        raise DataError("terms depend on each other on these samples, or one is 0")
    return A, b


def _weights(weights: ArrayLike | None, b: Array) -> Array:
    if weights is None:
        return np.ones(len(b))
    w = np.asarray(weights, dtype=np.float64)
    if w.shape != b.shape or not np.isfinite(w).all() or (w < 0.0).any():
        raise DataError("weights must be finite, not negative, and one per sample", value=w.shape)
    return w
