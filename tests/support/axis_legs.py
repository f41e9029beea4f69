"""Legs whose motion is known, moved by a Runge-Kutta loop of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numba
import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, Ints
from auvid.hydro.identification.axes.record import AxisRecord

Truth = Mapping[str, tuple[float, float, float, float]]
"""Velocity -> a, b, c, d of x' = a x + b x|x| + c F + d."""


def axis_leg(
    seed: int,
    truth: Truth,
    *,
    seconds: float = 120.0,
    step_s: float = 0.05,
    noise: float = 0.005,
    lag_s: float = 0.08,
    inertia: Array | None = None,
    by_depth: bool = False,
    normalised: bool = False,
    hold_s: float = 1.0,
    idle: tuple[str, ...] = (),
) -> AxisRecord:
    """Return a leg driven by steps of force; velocities of `idle` are not driven."""
    rng = np.random.default_rng(seed)
    n, fine = round(seconds / step_s), 4
    t = np.arange(n) * step_s
    force = {axis: np.zeros(n) for axis in AXES}
    hold = round(hold_s / step_s)
    for velocity in truth:
        if velocity not in idle:
            steps = rng.uniform(-0.5, 0.5, n // hold + 1)
            force[AXES[VELOCITIES.index(velocity)]] = np.repeat(steps, hold)[:n]
    names = list(truth)
    place = [VELOCITIES.index(name) for name in names]
    command = np.array([force[AXES[i]] for i in place]).T
    table = np.array([truth[name] for name in names])
    m = np.zeros(6) if inertia is None else inertia.astype(float)
    command = np.ascontiguousarray(command)  # numba compiles once more for another layout
    motion = _moved(np.array(place), table, m, command, step_s / fine, fine, lag_s)
    nothing, still = np.full(n, np.nan), np.zeros(n)
    rate = dict.fromkeys(VELOCITIES, nothing if inertia is None else still)
    depth = None
    for i, name in enumerate(names):
        if by_depth:
            depth = 5.0 + motion[:, 2 * len(names) + i] + noise * rng.normal(size=n)
        else:
            rate[name] = motion[:, i] + noise * rng.normal(size=n)
    windows = dict.fromkeys(AXES, ((0, n),))
    return AxisRecord(t, rate, depth, np.zeros((n, 3)), force, normalised, windows, (), {})


def scaled_force(record: AxisRecord, factor: float) -> AxisRecord:
    """Return the leg as if its force were in units `factor` times smaller."""
    force = {axis: factor * values for axis, values in record.force.items()}
    return replace(record, force=force)


@numba.njit(cache=True)
def _moved(
    place: Ints, table: Array, m: Array, command: Array, h: float, fine: int, lag_s: float
) -> Array:
    """Return velocities, forces after their lag and integrals (n, 3k) at the times of command.

    `m`: inertias of a Coriolis force, zeros without one.
    """
    n, k = command.shape
    out = np.zeros((n, 3 * k))
    out[0, k : 2 * k] = command[0]
    at, rate, total, nu = np.zeros(3 * k), np.zeros(3 * k), np.zeros(3 * k), np.zeros(6)
    for step in range(n - 1):
        out[step + 1] = out[step]
        y = out[step + 1]
        for part in range(4 * fine):
            share, weight = (0.0, 0.5, 0.5, 1.0)[part % 4], (1.0, 2.0, 2.0, 1.0)[part % 4]
            time = (part // 4 + share) / fine
            for i in range(3 * k):
                at[i] = y[i] + h * share * rate[i]
            for i in range(k):
                nu[place[i]] = at[i]
            u, v, w, p, q, r = nu
            X, Y, Z, K, M, N = m[0] * u, m[1] * v, m[2] * w, m[3] * p, m[4] * q, m[5] * r
            turning = (
                q * Z - r * Y, r * X - p * Z, p * Y - q * X, v * Z - w * Y + q * N - r * M,
                w * X - u * Z + r * K - p * N, u * Y - v * X + p * M - q * K,
            )  # fmt: skip
            for i in range(k):
                x, late = at[i], at[k + i]
                force = command[step, i] + (command[step + 1, i] - command[step, i]) * time
                rate[i] = table[i, 0] * x + table[i, 1] * x * abs(x) + table[i, 2] * late
                rate[i] += table[i, 3]
                if m[place[i]] > 0.0:
                    rate[i] -= turning[place[i]] / m[place[i]]
                rate[k + i], rate[2 * k + i] = (force - late) / lag_s, x
            for i in range(3 * k):
                total[i] += weight * rate[i]
                if part % 4 == 3:
                    y[i] += h / 6.0 * total[i]
                    total[i] = 0.0
    return out
