"""Kalman filter and smoother of independent columns with one gate, as compiled loops.

Import this module only where a filter runs: numba takes a second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from auvid.hydro.arrays import Array, Mask

LEAD = 2
"""Samples that may pass the gate while a sharp turn has begun."""
F = TypeVar("F", bound=Callable[..., Any])


def _compiled(function: F) -> F:
    options: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
    compiled: Any = numba.njit(cache=True, **options)(function)
    return cast(F, compiled)


def _inner(function: F) -> F:
    """Have numba compile what only loops call: kept with them, not for Python."""
    wrappers: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled: Any = numba.njit(error_model="numpy", **wrappers)(function)
    return cast(F, compiled)


@_inner
def _predict(x: Array, P: Array, dt: float, q: float, x_out: Array, P_out: Array) -> None:
    """Carry place, rate and acceleration over dt: P_out = F P F' + q Q(dt).

    Q of white noise on the derivative of the acceleration: dt^5/20 ... dt.
    """
    h = 0.5 * dt * dt
    x_out[0] = x[0] + dt * x[1] + h * x[2]
    x_out[1] = x[1] + dt * x[2]
    x_out[2] = x[2]
    a0 = P[0, 0] + dt * P[1, 0] + h * P[2, 0]
    a1 = P[0, 1] + dt * P[1, 1] + h * P[2, 1]
    a2 = P[0, 2] + dt * P[1, 2] + h * P[2, 2]
    b1 = P[1, 1] + dt * P[2, 1]
    b2 = P[1, 2] + dt * P[2, 2]
    c2 = P[2, 2]
    P_out[0, 0] = a0 + dt * a1 + h * a2 + q * dt**5 / 20.0
    P_out[0, 1] = a1 + dt * a2 + q * dt**4 / 8.0
    P_out[0, 2] = a2 + q * dt**3 / 6.0
    P_out[1, 1] = b1 + dt * b2 + q * dt**3 / 3.0
    P_out[1, 2] = b2 + q * dt**2 / 2.0
    P_out[2, 2] = c2 + q * dt
    P_out[1, 0], P_out[2, 0], P_out[2, 1] = P_out[0, 1], P_out[0, 2], P_out[1, 2]


@_inner
def _update(x: Array, P: Array, innovation: float, s: float) -> None:
    """Correct x and P by a measurement of the place with innovation variance s."""
    k0, k1, k2 = P[0, 0] / s, P[1, 0] / s, P[2, 0] / s
    x[0] += k0 * innovation
    x[1] += k1 * innovation
    x[2] += k2 * innovation
    p0, p1, p2 = P[0, 0], P[0, 1], P[0, 2]
    P[0, 0] -= k0 * p0
    P[0, 1] -= k0 * p1
    P[0, 2] -= k0 * p2
    P[1, 1] -= k1 * p1
    P[1, 2] -= k1 * p2
    P[2, 2] -= k2 * p2
    P[1, 0], P[2, 0], P[2, 1] = P[0, 1], P[0, 2], P[1, 2]


@_inner
def _restart(y: float, variance: float, rate: float, x: Array, P: Array) -> None:
    """Set the state to a place about y, at rest within `rate` (and its square root)."""
    x[0], x[1], x[2] = y, 0.0, 0.0
    for i in range(3):
        for j in range(3):
            P[i, j] = 0.0
    P[0, 0], P[1, 1], P[2, 2] = 100.0 * variance, rate * rate, rate * rate


@_inner
def _copy(x: Array, P: Array, x_out: Array, P_out: Array) -> None:
    """Copy a state and its covariance."""
    for i in range(3):
        x_out[i] = x[i]
        for j in range(3):
            P_out[i, j] = P[i, j]


@_compiled
def misfit(
    t: Array, y: Array, used: Mask, begins: Mask, variance: float, q: float, rate: float, dof: float
) -> float:
    """Return -2 log likelihood of the innovations of one column (n,).

    `dof` > 0: of Student's t, whose weights also soften the update; 0: of the normal
    distribution. `begins` marks where the filter starts anew.
    """
    x, P, x_next, P_next = np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    cost, count, last = 0.0, 0, 0
    for i in range(len(t)):
        if begins[i]:
            _restart(y[i], variance, rate, x, P)
            count = 0
        else:
            _predict(x, P, t[i] - t[last], q, x_next, P_next)
            _copy(x_next, P_next, x, P)
        last = i
        if not used[i]:
            continue
        innovation, s = y[i] - x[0], P[0, 0] + variance
        square = innovation * innovation / s
        count += 1
        if dof > 0.0:
            if count > 3:
                cost += np.log(s) + (dof + 1.0) * np.log(1.0 + square / dof)
            s += variance * (max(square / 9.0, 1.0) - 1.0)
        elif count > 3:
            cost += np.log(s) + square
        _update(x, P, innovation, s)
    return cost


@_compiled
def filter_track(
    t: Array,
    y: Array,
    max_gap: float,
    variance: Array,
    q: Array,
    rate: Array,
    allowed: Array,
    gate: float,
    patience: int,
    sharp: Array,
    x: Array,
    P: Array,
    accepted: Mask,
    begins: Mask,
    turns: Mask,
) -> None:
    """Run the filter over columns y (n, k): one gate for all, anew after jumps.

    A sample whose summed squared innovations over their variances, each with allowed^2
    (k,) more, exceed `gate` is left out. `patience` of them in a row are a sharp turn where
    all but one pass with an acceleration that changes by `sharp` (k,) before each, and before
    `LEAD` samples ahead of them; otherwise the filter starts anew, as after a pause longer
    than `max_gap`. Written: predictions x (n, k, 3), P (n, k, 3, 3) before each sample,
    `accepted`, `begins` and `turns` (n,).
    """
    n, k = y.shape
    state, cov = np.zeros((k, 3)), np.zeros((k, 3, 3))
    lost, i, begun, fresh = 0, 0, 0, True
    turns[:] = False
    while i < n:
        if i > 0 and t[i] - t[i - 1] > max_gap:
            fresh = True
        if fresh:
            for c in range(k):
                _restart(y[i, c], variance[c], rate[c], state[c], cov[c])
                _copy(state[c], cov[c], x[i, c], P[i, c])
            lost, begun = 0, i
        else:
            for c in range(k):
                if turns[i]:
                    cov[c, 2, 2] += sharp[c] ** 2
                _predict(state[c], cov[c], t[i] - t[i - 1], q[c], x[i, c], P[i, c])
                _copy(x[i, c], P[i, c], state[c], cov[c])
        begins[i] = fresh
        total = 0.0
        for c in range(k):
            total += (y[i, c] - state[c, 0]) ** 2 / (cov[c, 0, 0] + variance[c] + allowed[c] ** 2)
        fresh, accepted[i] = False, total <= gate
        if accepted[i]:
            for c in range(k):
                _update(state[c], cov[c], y[i, c] - state[c, 0], cov[c, 0, 0] + variance[c])
            lost = 0
        else:
            lost += 1
            if lost == patience:
                end, fresh = i + 1, True
                i = end - patience
                first = max(i - LEAD, begun + 1)
                if not turns[i]:
                    _after(first - 1, y, variance, accepted, x, P, state, cov)
                    passed = _passing(
                        t, y, variance, q, allowed, gate, sharp, first, end, state, cov
                    )
                    if passed >= np.sum(accepted[first:i]) + patience - 1:
                        fresh, i, lost = False, first, 0
                        turns[first:end] = True
                        _after(first - 1, y, variance, accepted, x, P, state, cov)
                continue
        i += 1


@_inner
def _after(
    i: int, y: Array, variance: Array, accepted: Mask, x: Array, P: Array, state: Array, cov: Array
) -> None:
    """Write the state after sample i, from the prediction before it."""
    for c in range(y.shape[1]):
        _copy(x[i, c], P[i, c], state[c], cov[c])
        if accepted[i]:
            _update(state[c], cov[c], y[i, c] - state[c, 0], cov[c, 0, 0] + variance[c])


@_inner
def _passing(
    t: Array,
    y: Array,
    variance: Array,
    q: Array,
    allowed: Array,
    gate: float,
    sharp: Array,
    first: int,
    end: int,
    state: Array,
    cov: Array,
) -> int:
    """Return how many samples of first .. end - 1 pass in a sharp turn.

    state (k, 3), cov (k, 3, 3): at the sample before, carried along.
    """
    k = y.shape[1]
    x, P = np.zeros(3), np.zeros((3, 3))
    passed = 0
    for i in range(first, end):
        total = 0.0
        for c in range(k):
            cov[c, 2, 2] += sharp[c] ** 2
            _predict(state[c], cov[c], t[i] - t[i - 1], q[c], x, P)
            _copy(x, P, state[c], cov[c])
            total += (y[i, c] - state[c, 0]) ** 2 / (cov[c, 0, 0] + variance[c] + allowed[c] ** 2)
        if total <= gate:
            passed += 1
            for c in range(k):
                _update(state[c], cov[c], y[i, c] - state[c, 0], cov[c, 0, 0] + variance[c])
    return passed


@_compiled
def smooth_track(
    t: Array,
    y: Array,
    variance: Array,
    accepted: Mask,
    begins: Mask,
    x: Array,
    P: Array,
) -> None:
    """Smooth the predictions of `filter_track` in place, by Bryson and Frazier.

    With innovation e, S and gain K of an accepted sample, C = I - K H, backwards

        l = C' l - H' e / S,   L = C' L C + H' H / S,   l = F' l,   L = F' L F,
        x = x - P l,   P = P - P L P,

    which equals the smoother of Rauch, Tung and Striebel and inverts nothing.
    """
    n, k = y.shape
    C, F = np.eye(3), np.eye(3)
    for c in range(k):
        adjoint, weight = np.zeros(3), np.zeros((3, 3))
        for i in range(n - 1, -1, -1):
            if i == n - 1 or begins[i + 1]:
                adjoint, weight = np.zeros(3), np.zeros((3, 3))
            else:
                dt = t[i + 1] - t[i]
                F[0, 1], F[1, 2], F[0, 2] = dt, dt, 0.5 * dt * dt
                adjoint, weight = _turned(F, adjoint), _squeezed(F, weight)
            if accepted[i]:
                s = P[i, c, 0, 0] + variance[c]
                C[0, 0] = 1.0 - P[i, c, 0, 0] / s
                C[1, 0], C[2, 0] = -P[i, c, 1, 0] / s, -P[i, c, 2, 0] / s
                adjoint, weight = _turned(C, adjoint), _squeezed(C, weight)
                adjoint[0] -= (y[i, c] - x[i, c, 0]) / s
                weight[0, 0] += 1.0 / s
            step, less = _turned(P[i, c], adjoint), _squeezed(P[i, c], weight)
            for a in range(3):
                x[i, c, a] -= step[a]
                for b in range(3):
                    P[i, c, a, b] -= less[a, b]


@_inner
def _turned(A: Array, b: Array) -> Array:
    """Return A' b of (3, 3) and (3,)."""
    out = np.zeros(3)
    for i in range(3):
        out[i] = A[0, i] * b[0] + A[1, i] * b[1] + A[2, i] * b[2]
    return out


@_inner
def _squeezed(A: Array, B: Array) -> Array:
    """Return A' B A of (3, 3)."""
    half, out = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            half[i, j] = B[i, 0] * A[0, j] + B[i, 1] * A[1, j] + B[i, 2] * A[2, j]
    for i in range(3):
        for j in range(3):
            out[i, j] = A[0, i] * half[0, j] + A[1, i] * half[1, j] + A[2, i] * half[2, j]
    return out
