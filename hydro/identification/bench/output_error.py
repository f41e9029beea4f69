"""Output error for one degree of freedom. Equations of Alberti 2015.

The coefficients whose simulated run is nearest to the measurements:

    x_dot = c0 x + c1 x|x| + c2 F(t) + c3 sin s + c4,   s_dot = x

covers the single channels of Alberti 2015 (61)-(65) (x a body velocity, s its angle or
depth) and the free decay (70) (x = theta_dot, s = theta). Measured noise never enters a
regressor here, so that the estimate has no errors-in-variables bias; for white noise on
x and s it is the maximum-likelihood estimate. It needs a starting point: the recursive
estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Index
from auvid.hydro.identification.regression.standard_errors import stationary_covariance

LONGEST_STEP_S = 0.02
"""Longest step of the simulation: RK4's error is below 1e-8 of the state for time
constants from 0.3 s on.
"""
TOLERANCE, MOST_STEPS = 1e-12, 120
"""A run that determines its parameters settles within 20 steps; one that does not would
wander on, and its errors say so.
"""
DIVERGED = 1e6
"""Error of a run that diverged, in parts of its sensor's noise."""
Model = Callable[[Array], tuple[Array, Array]]
"""Parameters (p,) -> coefficients c0 .. c4 (5,) and their derivatives (5, p)."""


@dataclass(frozen=True)
class SingleRun:
    """Measurements of one degree of freedom on a common grid.

    `grid_s` (n,); the force over each step, linear from `force_left` (n-1,) to
    `force_right` (n-1,); `rate` (a,) of x at the nodes `rate_at` (a,) and `position`
    (b,) of s at `position_at` (b,); either may be empty.
    """

    grid_s: Array
    force_left: Array
    force_right: Array
    rate_at: Index
    rate: Array
    position_at: Index
    position: Array

    def until(self, end_s: float) -> SingleRun:
        """Return the run up to a time [s]."""
        n = int(np.searchsorted(self.grid_s, end_s, side="right"))
        a, b = self.rate_at < n, self.position_at < n
        return SingleRun(
            self.grid_s[:n],
            self.force_left[: n - 1],
            self.force_right[: n - 1],
            self.rate_at[a],
            self.rate[a],
            self.position_at[b],
            self.position[b],
        )


@dataclass(frozen=True)
class Nuisance:
    """Which constants are fitted besides the parameters and x(0).

    s(0) where s matters; constant and drift of the rate sensor; constant of the
    position sensor.
    """

    rate_bias: bool = False
    rate_drift: bool = False
    position_bias: bool = False
    start_position: bool = False


@dataclass(frozen=True)
class OutputErrorFit:
    """Parameters (p,) with covariance (p, p) for coloured residuals.

    `start` (2,): x(0), s(0); `bias` (3,): constant [unit of x] and drift [unit of x per
    s] of the rate sensor, constant of the position sensor; `rate_error` and
    `position_error`: simulated minus measured at the samples; `correlation` (p, p) of
    the parameters.
    """

    parameters: Array
    covariance: Array
    coefficients: Array
    start: Array
    bias: Array
    rate_error: Array
    position_error: Array

    @property
    def standard_errors(self) -> Array:
        """Return the standard errors (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Return the correlation (p, p) of the parameters."""
        size = self.standard_errors
        return np.asarray(self.covariance / np.outer(size, size))


def fit_output_error(
    run: SingleRun,
    model: Model,
    first: Array,
    *,
    start: Array,
    nuisance: Nuisance | None = None,
    longest_step_s: float = LONGEST_STEP_S,
) -> OutputErrorFit:
    """Fit the parameters of `model` from `first` (p,) and `start` (2,), x(0) and s(0).

    Rates and positions are weighted by the standard deviation of their own errors, from
    a first fit with equal shares. Raises `DataError` when there are fewer samples than
    unknowns, or when the fit does not settle.
    """
    fitted = _Fit(run, model, len(first), nuisance or Nuisance(), longest_step_s)
    unknown = np.concatenate(
        [
            first,
            start[:1],
            start[1:] if fitted.nuisance.start_position else [],
            np.zeros(fitted.biases),
        ]
    )
    if len(run.rate) + len(run.position) <= len(unknown):
        raise DataError(
            "fewer samples than unknowns",
            value=len(run.rate) + len(run.position),
            remedy="Record longer or faster.",
        )
    fixed = np.array([0.0, start[1]])
    sigma = np.array([_size(run.rate), _size(run.position)])
    for _ in range(2 if len(run.rate) and len(run.position) else 1):
        unknown = fitted.solve(unknown, fixed, sigma)
        errors = fitted.errors(unknown, fixed)
        sigma = np.maximum([_rms(part) for part in errors[:2]], 1e-9 * sigma)
    return fitted.result(unknown, fixed, sigma)


def simulate_run(
    run: SingleRun, coefficients: Array, start: Array, *, longest_step_s: float = LONGEST_STEP_S
) -> tuple[Array, Array]:
    """Return x (n,) and s (n,) on the grid of a run for coefficients (5,).

    `start` (2,) is x(0), s(0).
    """
    from auvid.hydro.identification.bench.compiled_loops import simulate_single

    states = simulate_single(
        np.diff(run.grid_s), run.force_left, run.force_right, coefficients, start, longest_step_s
    )
    return states[:, 0], states[:, 1]


@dataclass(frozen=True)
class _Fit:
    run: SingleRun
    model: Model
    count: int
    nuisance: Nuisance
    longest_step_s: float

    @property
    def biases(self) -> int:
        return sum(self._kept)

    @property
    def _kept(self) -> tuple[bool, bool, bool]:
        return self.nuisance.rate_bias, self.nuisance.rate_drift, self.nuisance.position_bias

    def _parts(self, unknown: Array, fixed: Array) -> tuple[Array, Array, Array]:
        start = fixed.copy()
        start[0] = unknown[self.count]
        at = self.count + 1
        if self.nuisance.start_position:
            start[1] = unknown[at]
            at += 1
        bias = np.zeros(3)
        bias[list(self._kept)] = unknown[at:]
        return unknown[: self.count], start, bias

    def errors(self, unknown: Array, fixed: Array) -> tuple[Array, Array, Array, Array]:
        """Return errors of rate (a,), position (b,) and Jacobians (a, u), (b, u)."""
        from auvid.hydro.identification.bench.compiled_loops import simulate_single

        run = self.run
        parameters, start, bias = self._parts(unknown, fixed)
        coefficients, by_parameter = self.model(parameters)
        states = simulate_single(
            np.diff(run.grid_s),
            run.force_left,
            run.force_right,
            coefficients,
            start,
            self.longest_step_s,
        )
        starts = 2 if self.nuisance.start_position else 1
        time = run.grid_s[run.rate_at] - run.grid_s[0]
        by_bias = np.column_stack([np.ones_like(time), time, np.zeros_like(time)])[
            :, list(self._kept)
        ]
        rate_by = np.hstack(
            [
                states[run.rate_at, 2:12:2] @ by_parameter,
                states[run.rate_at][:, [12, 14][:starts]],
                by_bias,
            ]
        )
        position_by = np.hstack(
            [
                states[run.position_at, 3:13:2] @ by_parameter,
                states[run.position_at][:, [13, 15][:starts]],
                np.tile([0.0, 0.0, 1.0], (run.position.size, 1))[:, list(self._kept)],
            ]
        )
        rate_error = states[run.rate_at, 0] + bias[0] + bias[1] * time - run.rate
        return rate_error, states[run.position_at, 1] + bias[2] - run.position, rate_by, position_by

    def solve(self, unknown: Array, fixed: Array, sigma: Array) -> Array:
        from scipy.optimize import least_squares

        last: dict[bytes, tuple[Array, Array]] = {}

        def both(values: Array) -> tuple[Array, Array]:
            """Return error and Jacobian of one simulation; the solver needs both."""
            where = values.tobytes()
            if where not in last:
                with np.errstate(
                    invalid="ignore", over="ignore"
                ):  # a step of the search too far: the run diverges, and is turned down
                    rate, position, rate_by, position_by = self.errors(values, fixed)
                    pair = (
                        np.concatenate([rate / sigma[0], position / sigma[1]]),
                        np.vstack([rate_by / sigma[0], position_by / sigma[1]]),
                    )
                last.clear()
                last[where] = (np.nan_to_num(pair[0], nan=DIVERGED), np.nan_to_num(pair[1]))
            return last[where]

        def error(values: Array) -> Array:
            return both(values)[0]

        def jacobian(values: Array) -> Array:
            return both(values)[1]

        solution = least_squares(
            error,
            unknown,
            jac=jacobian,
            method="lm",
            x_scale="jac",
            ftol=TOLERANCE,
            xtol=TOLERANCE,
            gtol=TOLERANCE,
            max_nfev=MOST_STEPS,
        )
        if not (np.isfinite(solution.x).all() and np.isfinite(solution.cost)):
            raise DataError(
                "the output-error fit does not settle",
                remedy="Shorten the run to where one channel moves; see the recursive estimate.",
            )
        return np.asarray(solution.x, dtype=np.float64)

    def result(self, unknown: Array, fixed: Array, sigma: Array) -> OutputErrorFit:
        rate, position, rate_by, position_by = self.errors(unknown, fixed)
        parts = [
            (by / s, e / s)
            for by, e, s in ((rate_by, rate, sigma[0]), (position_by, position, sigma[1]))
            if e.size
        ]
        stacked = np.vstack([by for by, _ in parts])
        scale = np.linalg.norm(stacked, axis=0)
        scale[scale == 0.0] = 1.0
        bread = np.linalg.pinv(stacked / scale, rcond=1e-12)
        inverse = bread @ bread.T / np.outer(scale, scale)
        covariance = stationary_covariance([by for by, _ in parts], [e for _, e in parts], inverse)
        parameters, start, bias = self._parts(unknown, fixed)
        return OutputErrorFit(
            parameters=parameters,
            covariance=covariance[: self.count, : self.count],
            coefficients=self.model(parameters)[0],
            start=start,
            bias=bias,
            rate_error=rate,
            position_error=position,
        )


def _size(values: Array) -> float:
    return float(np.std(values)) or 1.0 if values.size else 1.0


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 1.0
