"""Compiled loops of the bench methods. Equations of Alberti 2015.

First-order filters, the recursive estimator, the simulated single degree of freedom.
`recursive_least_squares` and `output_error` give the meaning of the arguments. Import
this module only where an estimate is made: numba takes a second.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numba
import numpy as np

from auvid.hydro.arrays import Array

F = TypeVar("F", bound=Callable[..., Any])
SMALL = 1e-2
"""Below this a h, the weight of the first-order hold comes from its series (its closed
form loses digits).
"""
STATES, TERMS = 2, 5
DIVERGED = 1e6
"""A simulated rate beyond this [m/s, rad/s] stays there: the fit sees a large, finite
error.
"""


def _compiled(function: F, *, inner: bool = False) -> F:
    # What only loops call is kept with them, and needs no wrapper for Python.
    options: dict[str, Any] = {"no_cpython_wrapper": inner, "no_cfunc_wrapper": True}
    jit: Any = numba.njit(cache=not inner, error_model="numpy", **options)
    result: F = jit(function)
    return result


@_compiled
def filter_first_order(step: Array, rate: float, left: Array, right: Array, start: Array) -> Array:
    """Return f (n, k) of f_dot = -a f + g from f(0) = start (k,), (44), (50).

    `rate` is a [1/s]; g goes linearly from left (n-1, k) to right (n-1, k) over each
    step (n-1,) [s], for which the result is exact. g goes from left (n-1, k) to right
    (n-1, k).
    """
    n, k = left.shape
    out = np.empty((n + 1, k))
    for j in range(k):
        out[0, j] = start[j]
    for i in range(n):
        x = rate * step[i]
        decay = np.exp(-x)
        mean = -np.expm1(-x) / x
        late = x / 2 - x * x / 6 + x**3 / 24 - x**4 / 120 if x < SMALL else 1.0 - mean
        for j in range(k):
            out[i + 1, j] = decay * out[i, j] + step[i] * (
                (mean - late / x) * left[i, j] + late / x * right[i, j]
            )
    return out


@_compiled
def recursive_estimate(
    regressor: Array,
    output: Array,
    step: Array,
    keep: Array,
    theta: Array,
    root: Array,
    lowest: float,
    highest: float,
    history: Array,
    spread: Array,
) -> Array:
    """Run the square-root form of (39), (41); return errors before updates (n,).

    regressor (n, k), output (n,), information weight `step` (n,), forgetting factor
    `keep` (n,). `theta` (k,) and `root` (k, k), Gamma = root root', start the recursion
    and hold its end; `history` (n, k) takes the estimates and `spread` (n, k) the
    diagonal of Gamma. `lowest` and `highest` bound the trace of Gamma. Returns the
    errors before each update (n,).
    """
    n, k = regressor.shape
    bounded = lowest > 0.0 or highest < np.inf
    projected, gain, error = np.empty(k), np.empty(k), np.empty(n)
    for i in range(n):
        if keep[i] < 1.0:
            grown = 1.0 / keep[i]
            if bounded:
                trace = np.sum(root * root)
                grown = max(1.0, min(grown, highest / trace))
            root *= np.sqrt(grown)
        total = 1.0 / step[i]
        innovation = output[i]
        for j in range(k):
            innovation -= regressor[i, j] * theta[j]
            value = 0.0
            for l in range(k):
                value += root[l, j] * regressor[i, l]
            projected[j] = value
            total += value * value
        error[i] = innovation
        shrink = 1.0 / (total * (1.0 + np.sqrt(1.0 / (step[i] * total))))
        for j in range(k):
            value = 0.0
            for l in range(k):
                value += root[j, l] * projected[l]
            gain[j] = value
            theta[j] += value / total * innovation
        for j in range(k):
            variance = 0.0
            for l in range(k):
                root[j, l] -= shrink * gain[j] * projected[l]
                variance += root[j, l] * root[j, l]
            history[i, j] = theta[j]
            spread[i, j] = variance
        if lowest > 0.0:
            trace = np.sum(root * root)
            if trace < lowest:
                root *= np.sqrt(lowest / trace)
    return error


@partial(_compiled, inner=True)
def _slope(y: Array, force: float, c: Array, out: Array) -> None:
    """Write to `out` the derivatives of x, s and their sensitivities to c, x(0), s(0).

    x_dot = c0 x + c1 x|x| + c2 F + c3 sin s + c4, s_dot = x: (61)-(65), (70).
    """
    x, s = y[0], y[1]
    terms = (x, x * abs(x), force, np.sin(s), 1.0)
    out[1] = x
    rate = 0.0
    for j in range(TERMS):
        rate += c[j] * terms[j]
    out[0] = rate
    by_x, by_s = c[0] + 2.0 * c[1] * abs(x), c[3] * np.cos(s)
    for j in range(TERMS + STATES):
        at = STATES * (j + 1)
        out[at] = by_x * y[at] + by_s * y[at + 1]
        if j < TERMS:
            out[at] += terms[j]
        out[at + 1] = y[at]


@_compiled
def simulate_single(
    step: Array, left: Array, right: Array, c: Array, start: Array, longest: float
) -> Array:
    """Return states and sensitivities (n, 16) at n nodes by Runge-Kutta 4.

    Each step (n-1,) is taken in equal parts none longer than `longest` [s]. The force
    is linear from left (n-1,) to right (n-1,) over each step. Columns: x, s, then d(x,
    s) by c0 .. c4, x(0), s(0).
    """
    n = step.size
    width = STATES * (1 + TERMS + STATES)
    out, y, trial = np.empty((n + 1, width)), np.zeros(width), np.empty(width)
    k1, k2, k3, k4 = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    y[0], y[1] = start[0], start[1]
    y[STATES * (TERMS + 1)] = 1.0
    y[STATES * (TERMS + 2) + 1] = 1.0
    for j in range(width):
        out[0, j] = y[j]
    for i in range(n):
        parts = max(1, int(np.ceil(step[i] / longest - 1e-9)))
        h = step[i] / parts
        slope = (right[i] - left[i]) / parts
        for part in range(parts):
            f0 = left[i] + slope * part
            f1 = f0 + 0.5 * slope
            f2 = f0 + slope
            _slope(y, f0, c, k1)
            for j in range(width):
                trial[j] = y[j] + 0.5 * h * k1[j]
            _slope(trial, f1, c, k2)
            for j in range(width):
                trial[j] = y[j] + 0.5 * h * k2[j]
            _slope(trial, f1, c, k3)
            for j in range(width):
                trial[j] = y[j] + h * k3[j]
            _slope(trial, f2, c, k4)
            for j in range(width):
                y[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j])
            if not abs(y[0]) < DIVERGED:
                for j in range(width):
                    y[j] = 0.0
                y[0], y[1] = DIVERGED, DIVERGED
        for j in range(width):
            out[i + 1, j] = y[j]
    return out
