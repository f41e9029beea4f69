"""Legs whose motion is known, moved by a Runge-Kutta loop of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array
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
    table = [truth[name] for name in names]
    command = np.array([force[AXES[i]] for i in place]).T
    m = [1.0] * 6 if inertia is None else inertia.tolist()

    # Numbers in place of arrays: of so few, numpy takes ten times as long.
    def slope(y: list[float], f: list[float]) -> list[float]:
        nu, count = [0.0] * 6, len(names)
        for i, value in zip(place, y, strict=False):
            nu[i] = value
        turning = [0.0] * 6
        if inertia is not None:
            u, v, w, p, q, r = nu
            X, Y, Z, K, M, N = (mass * speed for mass, speed in zip(m, nu, strict=True))
            force_moment = (
                q * Z - r * Y, r * X - p * Z, p * Y - q * X,
                v * Z - w * Y + q * N - r * M,
                w * X - u * Z + r * K - p * N,
                u * Y - v * X + p * M - q * K,
            )  # fmt: skip
            turning = [-part / mass for part, mass in zip(force_moment, m, strict=True)]
        x, late = y[:count], y[count : 2 * count]
        rate = [
            a * x[i] + b * x[i] * abs(x[i]) + c * late[i] + d + turning[place[i]]
            for i, (a, b, c, d) in enumerate(table)
        ]
        return [*rate, *((f[i] - late[i]) / lag_s for i in range(count)), *x]

    def moved(y: list[float], step: float, k: list[float]) -> list[float]:
        return [value + step * change for value, change in zip(y, k, strict=True)]

    y = [0.0] * (3 * len(names))
    y[len(names) : 2 * len(names)] = command[0].tolist()
    states = [y]
    h = step_s / fine
    for first, change in zip(command[:-1], np.diff(command, axis=0), strict=True):
        ends = [(first + change * part / (2 * fine)).tolist() for part in range(2 * fine + 1)]
        for part in range(0, 2 * fine, 2):
            k1 = slope(y, ends[part])
            k2 = slope(moved(y, 0.5 * h, k1), ends[part + 1])
            k3 = slope(moved(y, 0.5 * h, k2), ends[part + 1])
            k4 = slope(moved(y, h, k3), ends[part + 2])
            total = [a + 2.0 * b + 2.0 * c + d for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
            y = moved(y, h / 6.0, total)
        states.append(y)
    motion = np.array(states)
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
