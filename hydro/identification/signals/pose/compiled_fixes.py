"""Likelihood, filter and smoother of one coordinate of fixes, as compiled loops.

Import this module only where a filter runs: numba takes a second.
"""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.identification.signals.pose.compiled_track import _compiled, _inner

FAR = 1e4
"""Variance of the position where a track begins [m^2]."""


@_inner
def _carried(step: float, speed: float, lag: float, P: Array, out: Array, phi: Array) -> None:
    """Write Phi P Phi' + Q to out (2, 2) and Phi to phi (2, 2).

    p' = v, v' = -v / lag + w, with v of RMS `speed`; Q of the exact solution, w white of
    density 2 speed^2 / lag.
    """
    e = np.exp(-step / lag)
    s2, b = speed * speed, lag * (1.0 - e)
    phi[0, 0], phi[0, 1], phi[1, 0], phi[1, 1] = 1.0, b, 0.0, e
    p0, p1, p2 = P[0, 0], P[0, 1], P[1, 1]
    out[0, 0] = p0 + 2.0 * b * p1 + b * b * p2
    out[0, 0] += s2 * lag * (2.0 * step - lag * (3.0 - 4.0 * e + e * e))
    out[0, 1] = e * (p1 + b * p2) + s2 * lag * (1.0 - e) ** 2
    out[1, 0] = out[0, 1]
    out[1, 1] = e * e * p2 + s2 * (1.0 - e * e)


@_inner
def _corrected(x: Array, P: Array, error: float, variance: float) -> None:
    """Correct x (2,) and P (2, 2) by a fix with an error of that variance."""
    k0, k1, p0, p1 = P[0, 0] / variance, P[1, 0] / variance, P[0, 0], P[0, 1]
    x[0] += k0 * error
    x[1] += k1 * error
    P[0, 0] -= k0 * p0
    P[0, 1] -= k0 * p1
    P[1, 0] = P[0, 1]
    P[1, 1] -= k1 * p1


@_inner
def _copied(P: Array, out: Array) -> None:
    """Write P (2, 2) to out; numba compiles `out[:] = P` for a second and more."""
    for i in range(2):
        for j in range(2):
            out[i, j] = P[i, j]


@_compiled
def misfit(
    t: Array,
    y: Array,
    used: Mask,
    begins: Mask,
    noise: float,
    speed: float,
    lag: float,
    dof: float,
) -> float:
    """Return minus the log likelihood of y (n,): normal for dof 0, else Student's t."""
    x, P, out, phi = np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2))
    total = 0.0
    for i in range(t.size):
        if begins[i]:
            x[0], x[1] = y[i], 0.0
            P[0, 0], P[1, 1] = noise * noise if used[i] else FAR, speed * speed
            P[0, 1] = P[1, 0] = 0.0
            continue
        _carried(t[i] - t[i - 1], speed, lag, P, out, phi)
        x[0] += phi[0, 1] * x[1]
        x[1] *= phi[1, 1]
        _copied(out, P)
        if not used[i]:
            continue
        error, variance = y[i] - x[0], P[0, 0] + noise * noise
        ratio, weight = error * error / variance, 1.0
        total += 0.5 * np.log(variance)
        if dof > 0.0:
            total += 0.5 * (dof + 1.0) * np.log(1.0 + ratio / dof)
            weight = min(1.0, (dof + 1.0) / (dof + ratio))
        else:
            total += 0.5 * ratio
        _corrected(x, P, error, P[0, 0] + noise * noise / weight)
    return total


@_compiled
def filter_and_smooth(
    t: Array, y: Array, used: Mask, begins: Mask, variance: Array, speed: float, lag: float
) -> tuple[Array, Array]:
    """Return x (n, 2) and P (n, 2, 2) of fixes y (n,) with variances (n,)."""
    n = t.size
    x, P = np.zeros((n, 2)), np.zeros((n, 2, 2))
    before, spread, phi = np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros((n, 2, 2))
    for i in range(n):
        if begins[i]:
            before[i, 0] = y[i]
            spread[i, 0, 0], spread[i, 1, 1] = FAR, speed * speed
        else:
            _carried(t[i] - t[i - 1], speed, lag, P[i - 1], spread[i], phi[i])
            before[i, 0] = x[i - 1, 0] + phi[i, 0, 1] * x[i - 1, 1]
            before[i, 1] = phi[i, 1, 1] * x[i - 1, 1]
        x[i, 0], x[i, 1] = before[i, 0], before[i, 1]
        _copied(spread[i], P[i])
        if used[i]:
            _corrected(x[i], P[i], y[i] - before[i, 0], spread[i, 0, 0] + variance[i])
    gain, change = np.zeros((2, 2)), np.zeros((2, 2))
    for i in range(n - 2, -1, -1):
        if begins[i + 1]:
            continue
        # gain = P Phi' spread^-1
        a, b, d = spread[i + 1, 0, 0], spread[i + 1, 0, 1], spread[i + 1, 1, 1]
        det = a * d - b * b
        for row in range(2):
            left = P[i, row, 0] + P[i, row, 1] * phi[i + 1, 0, 1]
            right = P[i, row, 1] * phi[i + 1, 1, 1]
            gain[row, 0] = (left * d - right * b) / det
            gain[row, 1] = (right * a - left * b) / det
        first, second = x[i + 1, 0] - before[i + 1, 0], x[i + 1, 1] - before[i + 1, 1]
        for row in range(2):
            x[i, row] += gain[row, 0] * first + gain[row, 1] * second
            for col in range(2):
                change[row, col] = P[i + 1, row, col] - spread[i + 1, row, col]
        for row in range(2):
            for col in range(2):
                for j in range(2):
                    for k in range(2):
                        P[i, row, col] += gain[row, j] * change[j, k] * gain[col, k]
    return x, P
