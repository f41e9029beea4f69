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
    table = np.array([truth[name] for name in names])
    command = np.array([force[AXES[i]] for i in place]).T
    m = np.ones(6) if inertia is None else inertia

    def slope(y: Array, f: Array) -> Array:
        nu = np.zeros(6)
        nu[place] = y[: len(names)]
        x, late = y[: len(names)], y[len(names) : 2 * len(names)]
        turn = nu[3:]
        turning = np.zeros(6)
        if inertia is not None:
            turning[:3] = -np.cross(turn, m[:3] * nu[:3]) / m[:3]
            momentum = np.cross(nu[:3], m[:3] * nu[:3]) + np.cross(turn, m[3:] * turn)
            turning[3:] = -momentum / m[3:]
        a, b, c, d = table.T
        rate = a * x + b * x * np.abs(x) + c * late + d + turning[place]
        return np.concatenate([rate, (f - late) / lag_s, x])

    y = np.zeros(3 * len(names))
    y[len(names) : 2 * len(names)] = command[0]
    states = [y]
    h = step_s / fine
    for i in range(n - 1):
        for part in range(fine):
            f = [command[i] + s * (command[i + 1] - command[i]) for s in
                 (part / fine, (part + 0.5) / fine, (part + 1) / fine)]  # fmt: skip
            k1 = slope(y, f[0])
            k2 = slope(y + 0.5 * h * k1, f[1])
            k3 = slope(y + 0.5 * h * k2, f[1])
            k4 = slope(y + h * k3, f[2])
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
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
