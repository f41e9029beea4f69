"""Natural cubic smoothing splines with cross-validation, in linear time.

The smoothing is chosen by generalised cross-validation (GCV).

A smoothing spline minimises sum w_i (y_i - f(t_i))^2 + lambda * integral f''(t)^2 dt;
lambda has the convention of `scipy.interpolate.make_smoothing_spline`. In Reinsch's
form the second derivatives g at the inner knots solve the pentadiagonal system (R +
lambda Q' W^-1 Q) g = Q' y, and the fitted values are y - lambda W^-1 Q g. The trace
that cross-validation needs, tr(I - A) = d log det(R + lambda Q' W^-1 Q) / d log lambda,
comes from two banded Cholesky factors.

Sources: Reinsch 1967; Craven & Wahba 1979 (GCV); McCarter 2014 section 2.5 uses splines
for every derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.long_series.threads import at_once

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

MIN_SAMPLES = 5
LONG = 9_000
"""Samples beyond which compiled loops factor and solve, several lambdas at once in threads."""
LOG_STEP = 0.1
"""Step in log lambda of the derivative of log det, which five points give; its truncation
error is below 1e-7 of the trace. Rounding of log det counts as many times as the step is
smaller: at 1e-3 it decided the minimum of a flat score (decision 0118). Half the width,
too, of the parabola of which the vertex is taken.
"""
STEPS = np.exp(LOG_STEP * np.arange(-3, 4))
SCALED_LAMBDA = (1e-4, 1e12)
"""Search range of lambda / h^3 (h: mean step): from interpolation to a half-amplitude
period of about 6000 samples.
"""
XATOL = 1e-2
"""How near to its minimum the score is searched in log lambda; the vertex of the parabola
there does not depend on where the search stopped.
"""
GRID = 13
"""Starting points of the search over that range, so that a second, local minimum of the
GCV score is not taken for the best.
"""


@dataclass(frozen=True)
class SmoothingSpline:
    """A smoothing spline: knots (n,) [s], piecewise cubic, lambda, sigma and edf.

    sigma: standard deviation of the noise; edf: effective degrees of freedom.
    `lambda_`, `sigma` and `edf` are scalars for one signal (y (n,)) and (k,) for k
    signals (y (n, k)). The second derivative is zero at both ends (natural spline):
    there the acceleration is bent over about half a smoothing period.
    """

    t: Array
    piecewise: PPoly
    lambda_: Array
    sigma: Array
    edf: Array

    def evaluate(self, t_s: ArrayLike, derivative: int = 0) -> Array:
        """Return the spline or its derivative (m,) or (m, k) at times t_s (m,).

        Never extrapolates: nan outside the knots.
        """
        return np.asarray(
            self.piecewise(np.asarray(t_s, dtype=np.float64), nu=derivative, extrapolate=False),
            dtype=np.float64,
        )


def smoothing_spline(
    t_s: ArrayLike,
    y: ArrayLike,
    *,
    lam: float | None = None,
    weights: ArrayLike | None = None,
    shared: bool = False,
) -> SmoothingSpline:
    """Fit a smoothing spline to y (n,) or (n, k) at increasing times t_s (n,) [s].

    lam: smoothing parameter >= 0 (`lambda_from_cutoff` gives it for a frequency); None
    chooses it by GCV, for each column by itself or, with `shared`, one for all columns.
    GCV takes the noise as white: coloured noise is smoothed too little. weights (n,): 1
    / variance up to a factor, positive. Raises `DataError` for fewer than 5 samples,
    times that do not increase, or values that are not finite.
    """
    t, values, w = _checked(t_s, y, weights)
    columns = values.reshape(len(t), -1)
    system = _Reinsch.build(t, w)
    if lam is None:
        chosen = system.cross_validate(columns, shared)
    elif np.isfinite(lam) and lam >= 0:
        chosen = np.full(columns.shape[1], float(lam))
    else:
        raise DataError("the smoothing parameter lambda must be finite and not negative", value=lam)
    fitted, curvature = np.empty_like(columns), np.zeros_like(columns)
    edf, sigma = np.empty(len(chosen)), np.empty(len(chosen))
    for value in np.unique(chosen):
        same = np.flatnonzero(chosen == value)
        fitted[:, same], curvature[1:-1, same] = system.fit(columns[:, same], value)
        edf[same] = len(t) - system.trace_of_residual_maker(value)
    rss = np.sum(w[:, None] * (columns - fitted) ** 2, axis=0)
    np.sqrt(rss / np.maximum(len(t) - edf, np.finfo(float).tiny), out=sigma)
    piecewise = _piecewise(t, fitted.reshape(values.shape), curvature.reshape(values.shape))
    shape = values.shape[1:]
    return SmoothingSpline(
        t, piecewise, chosen.reshape(shape), sigma.reshape(shape), edf.reshape(shape)
    )


def derivative(t_s: ArrayLike, y: ArrayLike, *, order: int = 1) -> Array:
    """Return the time derivative of y (n,) or (n, k) at the samples.

    It is that of the interpolating cubic spline (not-a-knot). McCarter (2.77),
    (2.79)-(2.81), (2.89). It amplifies noise (0.12 rad/s^2 from 0.002 rad/s at 50 Hz):
    low-pass first. Raises `DataError` as `smoothing_spline`.
    """
    from scipy.interpolate import CubicSpline

    t, values, _ = _checked(t_s, y, None)
    return np.asarray(CubicSpline(t, values)(t, nu=order), dtype=np.float64)


def lambda_from_cutoff(cutoff_hz: float, step_s: float) -> float:
    """Return the lambda [s^3] whose spline halves the amplitude at `cutoff_hz`.

    For unit weights and a mean sample step `step_s`. Away from the ends a smoothing
    spline on a uniform grid is the zero-phase filter 1 / (1 + lambda h (2 pi f)^4), the
    same as a second-order Butterworth filter run forward and backward; so lambda = (2
    pi f)^-4 / h. Valid well below the Nyquist frequency.

    >>> f"{lambda_from_cutoff(3.0, 0.02):.4e}"
    '3.9606e-04'
    """
    if not (cutoff_hz > 0 and step_s > 0):
        raise DataError("cutoff and sample step must be positive", value=(cutoff_hz, step_s))
    return float((2.0 * np.pi * cutoff_hz) ** -4 / step_s)


def cutoff_from_lambda(lam: float, step_s: float) -> float:
    """Return the half-amplitude frequency [Hz] of a smoothing parameter.

    Inverse of `lambda_from_cutoff`.
    """
    if not (lam > 0 and step_s > 0):
        raise DataError("lambda and sample step must be positive", value=(lam, step_s))
    return float((lam * step_s) ** -0.25 / (2.0 * np.pi))


@dataclass(frozen=True)
class _Reinsch:
    """Bands of R and Q' W^-1 Q, both (n-2) x (n-2), and what Q needs.

    Lower form of LAPACK, Fortran order.
    """

    inverse_step: Array
    inverse_weight: Array
    weight: Array
    stiffness: Array
    roughness: Array
    scale: float

    @classmethod
    def build(cls, t: Array, weight: Array) -> _Reinsch:
        h = np.diff(t)
        a, v = 1.0 / h, 1.0 / weight
        # Column j of Q: a_j at sample j, -(a_j + a_j+1) at j + 1, a_j+1 at j + 2.
        low, mid, high = a[:-1], -(a[:-1] + a[1:]), a[1:]
        stiffness = np.zeros((3, len(t) - 2), order="F")
        stiffness[0] = (h[:-1] + h[1:]) / 3.0
        stiffness[1, :-1] = h[1:-1] / 6.0
        roughness = np.zeros_like(stiffness)
        roughness[0] = low**2 * v[:-2] + mid**2 * v[1:-1] + high**2 * v[2:]
        roughness[1, :-1] = mid[:-1] * low[1:] * v[1:-2] + high[:-1] * mid[1:] * v[2:-1]
        roughness[2, :-2] = high[:-2] * low[2:] * v[2:-2]
        return cls(a, v, weight, stiffness, roughness, float(np.mean(h) ** 3 * np.mean(weight)))

    def cholesky(self, lam: float) -> Array:
        """Return the banded factor of R + lambda Q' W^-1 Q."""
        if self.stiffness.shape[1] > LONG:
            from auvid.hydro.long_series.compiled_bands import factor_sum

            factor = np.empty_like(self.stiffness)
            is_definite = factor_sum(self.stiffness, self.roughness, lam, factor)
        else:
            from scipy.linalg import lapack

            matrix = self.stiffness + lam * self.roughness
            factor, info = lapack.dpbtrf(matrix, lower=1, overwrite_ab=1)
            is_definite = not info
        if not is_definite:
            raise DataError(
                "the smoothing is too strong for the sample spacing",
                value=lam,
                remedy="Smooth less, or thin the samples out.",
            )
        return np.asarray(factor)

    def second_difference(self, y: Array) -> Array:
        """Return Q' y: (n, k) -> (n-2, k)."""
        return np.diff(np.diff(y, axis=0) * self.inverse_step[:, None], axis=0)

    def spread(self, g: Array) -> Array:
        """Return Q g: (n-2, k) -> (n, k)."""
        n, columns = len(self.weight), g.shape[1]
        slope, out = np.empty((n - 1, columns)), np.empty((n, columns))
        slope[0], slope[-1] = g[0], -g[-1]
        np.subtract(g[1:], g[:-1], out=slope[1:-1])
        slope *= self.inverse_step[:, None]
        out[0], out[-1] = slope[0], -slope[-1]
        np.subtract(slope[1:], slope[:-1], out=out[1:-1])
        return out

    def fit(self, y: Array, lam: float, factor: Array | None = None) -> tuple[Array, Array]:
        """Return fitted values (n, k) and second derivatives at knots (n-2, k).

        factor: `cholesky` of lam where it is there.
        """
        g = np.asfortranarray(self.second_difference(y))
        factor = self.cholesky(lam) if factor is None else factor
        if len(g) > LONG:
            from auvid.hydro.long_series.compiled_bands import solve_factored

            for column in g.T:
                solve_factored(factor, column)
        else:
            from scipy.linalg import lapack

            g, _ = lapack.dpbtrs(factor, g, lower=1)
        return y - lam * self.inverse_weight[:, None] * self.spread(g), g

    def trace_of_residual_maker(self, lam: float) -> float:
        """Return tr(I - A), the samples minus the effective degrees of freedom."""
        if lam == 0.0:
            return 0.0
        return _slope([_half_log_det(self.cholesky(lam * step)) for step in STEPS[[1, 2, 4, 5]]])

    def rough_trace(self, lam: float) -> float:
        """Return tr(I - A) to 2e-3 of it, which tells the interval to search."""
        above, below = (_half_log_det(self.cholesky(lam * step)) for step in STEPS[[4, 2]])
        return (above - below) / LOG_STEP

    def cross_validate(self, y: Array, shared: bool) -> Array:
        """Return the lambda that minimises the GCV score, per column or over all.

        `shared`: one lambda for the sum over the columns.
        """
        from scipy.optimize import minimize_scalar

        low, high = np.log(self.scale) + np.log(SCALED_LAMBDA)
        high = min(high, np.log(self.scale) + 4.0 * np.log(len(y)))
        grid = np.linspace(low, high, GRID)
        groups = [y] if shared else [y[:, [index]] for index in range(y.shape[1])]
        if shared:
            # Each signal counts by its own roughness, so that units do not decide.
            noise = np.sqrt(np.mean(self.second_difference(y) ** 2, axis=0))
            groups = [y / np.where(noise > 0, noise, 1.0)]
        lambdas_of_grid = [float(np.exp(point)) for point in grid]

        def criterion(residual: Array, freedom: float) -> float:
            return float(
                np.log(max(np.sum(self.weight[:, None] * residual**2), 1e-300))
                - 2.0 * np.log(freedom)
            )

        def score(log_lam: float, signal: Array) -> float:
            lam = float(np.exp(log_lam))
            return criterion(signal - self.fit(signal, lam)[0], self.trace_of_residual_maker(lam))

        def scores_beside(log_lam: float, signal: Array) -> list[float]:
            """Return the scores a step below, at and above, from seven factors."""
            lams = np.exp(log_lam) * STEPS
            factors = [self.cholesky(float(lam)) for lam in lams]
            halves = [_half_log_det(factor) for factor in factors]
            return [
                criterion(
                    signal - self.fit(signal, float(lams[at]), factors[at])[0],
                    _slope([halves[at + side] for side in (-2, -1, 1, 2)]),
                )
                for at in (2, 3, 4)
            ]

        # One factor of the system serves all signals at a point of the grid.
        columns = np.concatenate(groups, axis=1)
        ends = np.cumsum([signal.shape[1] for signal in groups])[:-1]

        def scores_at(lam: float) -> list[float]:
            trace = self.rough_trace(lam)
            parts = np.split(columns - self.fit(columns, lam)[0], ends, axis=1)
            return [criterion(part, trace) for part in parts]

        points = at_once(scores_at, lambdas_of_grid, long=len(y) > LONG)

        def best_lambda(index: int) -> float:
            best = int(np.argmin([scores[index] for scores in points]))
            bounds = grid[max(best - 1, 0)], grid[min(best + 1, GRID - 1)]
            minimum = minimize_scalar(
                score,
                bounds=bounds,
                args=(groups[index],),
                method="bounded",
                options={"xatol": XATOL},
            )
            below, middle, above = scores_beside(minimum.x, groups[index])
            bend = below - 2.0 * middle + above
            shift = 0.5 * LOG_STEP * (below - above) / bend if bend > 0.0 else 0.0
            near = minimum.x + np.clip(shift, -LOG_STEP, LOG_STEP)
            return float(np.exp(np.clip(near, *bounds)))

        lambdas = at_once(best_lambda, range(len(groups)), long=len(y) > LONG)
        return np.full(y.shape[1], lambdas[0]) if shared else np.array(lambdas)


def _half_log_det(factor: Array) -> float:
    """Return half of log det of what a banded Cholesky factor is of."""
    return float(np.sum(np.log(factor[0])))


def _slope(halves: Sequence[float]) -> float:
    """Return d log det / d log lambda of its halves at -2, -1, 1, 2 steps."""
    far_below, below, above, far_above = halves
    return (8.0 * (above - below) - (far_above - far_below)) / (6.0 * LOG_STEP)


def _checked(t_s: ArrayLike, y: ArrayLike, weights: ArrayLike | None) -> tuple[Array, Array, Array]:
    t, values = np.array(t_s, dtype=np.float64), np.asarray(y, dtype=np.float64)
    w = np.ones(len(t)) if weights is None else np.asarray(weights, dtype=np.float64)
    if t.ndim != 1 or values.ndim not in (1, 2) or len(values) != len(t) or w.shape != t.shape:
        raise DataError(
            "times, values and weights of a spline differ in length",
            value=(t.shape, values.shape, w.shape),
        )
    if len(t) < MIN_SAMPLES:
        raise DataError(f"a spline needs at least {MIN_SAMPLES} samples", value=len(t))
    if not np.all(np.diff(t) > 0):
        raise DataError(
            "the times of a spline must increase strictly",
            row=int(np.argmin(np.diff(t))) + 1,
            field="t_s",
        )
    if not np.isfinite(values).all():
        bad = np.flatnonzero(~np.isfinite(values.reshape(len(t), -1)).all(axis=1))
        raise DataError(
            "a value of a spline is not finite",
            row=int(bad[0]),
            remedy="Split the signal at its gaps first.",
        )
    if not (np.isfinite(w) & (w > 0)).all():
        raise DataError("the weights of a spline must be positive and finite")
    return t, values, w


def _piecewise(t: Array, value: Array, curvature: Array) -> PPoly:
    from scipy.interpolate import PPoly

    h = np.diff(t).reshape((-1,) + (1,) * (value.ndim - 1))
    slope = np.diff(value, axis=0) / h - h * (2.0 * curvature[:-1] + curvature[1:]) / 6.0
    return PPoly(
        np.stack([np.diff(curvature, axis=0) / (6.0 * h), curvature[:-1] / 2.0, slope, value[:-1]]),
        t,
        extrapolate=False,
    )
