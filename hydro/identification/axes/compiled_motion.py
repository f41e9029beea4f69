"""Compiled motion of one or several axes with its sensitivities, by Runge-Kutta 4.

`structure` and `pooled_windows` give the meaning of the arguments. Import this module
only where a fit is made: numba takes a second.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numba
import numpy as np

from auvid.hydro.arrays import Array, Ints

F = TypeVar("F", bound=Callable[..., Any])
LINEAR, QUADRATIC, INPUT, CONSTANT, RESTORING = 0, 1, 2, 3, 4
LINEAR_AHEAD, LINEAR_BACK, QUADRATIC_AHEAD, QUADRATIC_BACK, SHARE = 5, 6, 7, 8, 9
"""Kinds of terms: nu, nu|nu|, an input, 1, sin s; of nu above and below 0 only; none itself,
but a factor of products."""
LEAST_C = 1e-6
"""Coefficient of force below which the inertia 1 / c of a Coriolis force does not grow."""
DIVERGED = 1e4
"""A velocity beyond this [m/s, rad/s] stays there: the fit sees a large, finite error."""


def _compiled(function: F, *, inner: bool = False) -> F:
    # What only loops call is kept with them, and needs no wrapper for Python.
    options: dict[str, Any] = {"no_cpython_wrapper": inner, "no_cfunc_wrapper": True}
    jit: Any = numba.njit(cache=not inner, error_model="numpy", **options)
    result: F = jit(function)
    return result


@partial(_compiled, inner=True)
def _slope(
    y: Array,
    row: Array,
    axes: Ints,
    terms: Ints,
    products: Ints,
    weights: Array,
    theta: Array,
    constant: Array,
    nu: Array,
    by: Array,
    out: Array,
) -> None:
    """Write to `out` (2k, width) the derivatives of states and sensitivities `y`.

    x_i_dot = sum_t theta_t phi_t + sum weights nu_a nu_b + constant_i, s_i_dot = turn_i
    x_i; a weight is times one coefficient and over another where `products` names them.
    `row`: measured velocities (6), turn (k), inputs (m), their derivatives (m e). `nu`
    (6,) and `by` (k, k + 1), slope by x_j and s_i, are work space.
    """
    k, count, width = axes.size, theta.size, y.shape[1]
    extra = width - 1 - count - 3 * k
    inputs = (row.size - 6 - k) // (1 + extra)
    first = 6 + k
    for j in range(6):
        nu[j] = row[j]
    for i in range(k):
        nu[axes[i]] = y[i, 0]
        for j in range(k + 1):
            by[i, j] = 0.0
        for c in range(width):
            out[i, c] = 0.0
        out[i, 0] = constant[i]
        out[i, width - k + i] = 1.0
    # The terms, their slopes by the states, and by their own coefficients.
    for t in range(count):
        i, kind, of = terms[t, 0], terms[t, 1], terms[t, 2]
        value = 1.0
        if kind == INPUT:
            value = row[first + of]
            for e in range(extra):
                out[i, 1 + count + e] += theta[t] * row[first + inputs + of * extra + e]
        elif kind == RESTORING:
            value = np.sin(y[k + i, 0])
            by[i, k] += theta[t] * np.cos(y[k + i, 0])
        elif kind == SHARE:
            value = 0.0
        elif kind != CONSTANT:
            x = nu[of]
            slope = 1.0
            if kind in (LINEAR_AHEAD, QUADRATIC_AHEAD) and x < 0.0:
                slope = 0.0
            if kind in (LINEAR_BACK, QUADRATIC_BACK) and x > 0.0:
                slope = 0.0
            value = slope * x
            if kind == QUADRATIC or kind >= QUADRATIC_AHEAD:
                value *= abs(x)
                slope *= 2.0 * abs(x)
            for j in range(k):
                if axes[j] == of:
                    by[i, j] += theta[t] * slope
        out[i, 0] += theta[t] * value
        out[i, 1 + t] += value
    # Products of two velocities: Coriolis.
    for p in range(weights.size):
        i, a, b, up, down = products[p]
        weight = weights[p]
        if down >= 0:
            weight /= max(theta[down], LEAST_C)
        if up >= 0:
            out[i, 1 + up] += weight * nu[a] * nu[b]
            weight *= theta[up]
        out[i, 0] += weight * nu[a] * nu[b]
        if down >= 0 and theta[down] > LEAST_C:
            out[i, 1 + down] -= weight / theta[down] * nu[a] * nu[b]
        for j in range(k):
            if axes[j] == a:
                by[i, j] += weight * nu[b]
            if axes[j] == b:
                by[i, j] += weight * nu[a]
    # The chain rule, by the states that a slope depends on, and the integrals.
    for i in range(k):
        for j in range(k + 1):
            slope, source = by[i, j], j if j < k else k + i
            if slope != 0.0:
                for c in range(1, width):
                    out[i, c] += slope * y[source, c]
        slope = row[6 + i]
        for c in range(width):
            out[k + i, c] = slope * y[i, c]


@_compiled
def simulate_axes(
    step_s: float,
    parts: int,
    rows: Array,
    axes: Ints,
    terms: Ints,
    products: Ints,
    weights: Array,
    theta: Array,
    start: Array,
    out: Array,
) -> None:
    """Write states and sensitivities (n, 2k, width) at n nodes `step_s` apart to `out`.

    rows (2 parts (n - 1) + 1, r), what `_slope` calls `row`, at every half step;
    `parts` steps from node to node. start (3k,): x(0), s(0), constants. width: state,
    by theta, by the parameters of the inputs, by start.
    """
    states, width = out.shape[1], out.shape[2]
    y, trial, slope = (
        np.zeros((states, width)),
        np.zeros((states, width)),
        np.zeros((states, width)),
    )
    total, nu = np.zeros((states, width)), np.zeros(6)
    by = np.zeros((axes.size, axes.size + 1))
    constant = start[states:]
    for i in range(states):
        y[i, 0] = start[i]
        y[i, width - 3 * axes.size + i] = 1.0
        for c in range(width):
            out[0, i, c] = y[i, c]
    h = step_s / parts
    for step in range((out.shape[0] - 1) * parts):
        for stage in range(4):
            ahead = (stage + 1) // 2
            reach = 0.5 * ahead * h if stage < 3 else h
            weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
            for i in range(states):
                for c in range(width):
                    trial[i, c] = y[i, c] + reach * slope[i, c]
            _slope(
                trial, rows[2 * step + ahead], axes, terms, products, weights, theta, constant,
                nu, by, slope,
            )  # fmt: skip
            for i in range(states):
                for c in range(width):
                    total[i, c] += weight * slope[i, c]
        for i in range(states):
            for c in range(width):
                y[i, c] += total[i, c]
                total[i, c] = 0.0
            if not abs(y[i, 0]) < DIVERGED:
                for c in range(width):
                    y[i, c] = 0.0 if c else DIVERGED
        if (step + 1) % parts == 0:
            node = (step + 1) // parts
            for i in range(states):
                for c in range(width):
                    out[node, i, c] = y[i, c]
