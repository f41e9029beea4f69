"""Rates of the state, a step of Runge-Kutta 4, and what parameters add to rates."""

from __future__ import annotations

from auvid.hydro.arrays import Array, Ints
from auvid.hydro.dynamics.mechanics import rigid_body
from auvid.hydro.dynamics.simulation.compiled import FACTOR_COUNT, model_force, motion_rates
from auvid.hydro.dynamics.simulation.plant_constants import Tables
from auvid.hydro.identification.maximum_likelihood.window_loop.compiling import compiled
from auvid.hydro.identification.maximum_likelihood.window_loop.layout import (
    INERTIA,
    LAG,
    MOTION,
    VISCOUS,
    Workspace,
)

WIDE = 1e-4
"""Width of central differences along the lag [s]."""


@compiled
def rates(x: Array, inputs: Array, c: Tables, decay: Array, out: Array, work: Workspace) -> None:
    """Write d/dt of the state.

    work: state (12,), its rate (12,), inputs (12,), factors.
    """
    pose, slope, acting, factors = work
    for i in range(3):
        pose[9 + i] = x[i]
    pose[8] = x[3]
    for i in range(6):
        pose[i] = x[4 + i]
    for i in range(12):
        acting[i] = inputs[i]
    for i in range(len(x) - MOTION):
        acting[6 + i] += x[MOTION + i]
    motion_rates(pose, acting, model_force(pose, acting, c, factors), c, slope)
    for i in range(3):
        out[i] = slope[9 + i]
    out[3] = slope[8]
    for i in range(6):
        out[4 + i] = slope[i]
    for i in range(len(x) - MOTION):
        out[MOTION + i] = -decay[i] * x[MOTION + i]


@compiled
def integrate_step(
    x: Array,
    h: float,
    inputs: Array,
    c: Tables,
    decay: Array,
    stage: Array,
    total: Array,
    slope: Array,
    work: Workspace,
) -> None:
    """Carry x over a step by Runge-Kutta 4; `slope` is its rate at first."""
    for i in range(len(x)):
        total[i] = slope[i]
    for part in range(1, 4):
        reach = h if part == 3 else 0.5 * h
        for i in range(len(x)):
            stage[i] = x[i] + reach * slope[i]
        rates(stage, inputs[(part + 1) // 2], c, decay, slope, work)
        weight = 1.0 if part == 3 else 2.0
        for i in range(len(x)):
            total[i] += weight * slope[i]
    for i in range(len(x)):
        x[i] += h / 6.0 * total[i]


@compiled
def inertia_force(x: Array, rate: Array, row: int, column: int, force: Array) -> None:
    """Write -(E nu_dot + C_E(nu) nu) (6,), E with 1 at the entry and its mirror."""
    for i in range(6):
        force[i] = 0.0
    force[row], force[column] = x[4 + column], x[4 + row]
    turning = rigid_body.coriolis_components(
        (x[4], x[5], x[6], x[7], x[8], x[9]),
        (force[0], force[1], force[2], force[3], force[4], force[5]),
    )
    for i in range(6):
        force[i] = -turning[i]
    force[row] -= rate[4 + column]
    if row != column:
        force[column] -= rate[4 + row]


@compiled
def inverse_column(inverse: Array, k: int) -> Workspace:
    """Return column k of M^-1: the acceleration (6,) by a force on axis k."""
    return (
        inverse[k], inverse[6 + k], inverse[12 + k],
        inverse[18 + k], inverse[24 + k], inverse[30 + k],
    )  # fmt: skip


@compiled
def parameter_accelerations(
    x: Array,
    rate: Array,
    inputs: Array,
    along: Array,
    c: Tables,
    decay: Array,
    kinds: Ints,
    a: Array,
    force: Array,
    work: Workspace,
    pair: Workspace,
) -> None:
    """Write the acceleration (6,) that each parameter adds per unit, a (6, parameters).

    Called after `rates` at the same state: its factors hold the terms.
    """
    factors = work[3]
    up, down, acting = pair
    for p in range(len(kinds)):
        kind, row, column = kinds[p, 0], kinds[p, 1], kinds[p, 2]
        if kind == VISCOUS:
            for i in range(6):
                a[i, p] = c.inverse[6 * i + row] * factors[FACTOR_COUNT + column]
        elif kind == INERTIA:
            inertia_force(x, rate, row, column, force)
            for i in range(6):
                a[i, p] = 0.0
                for k in range(6):
                    a[i, p] += c.inverse[6 * i + k] * force[k]
    for p in range(len(kinds)):
        if kinds[p, 0] == LAG:
            # d(acceleration)/d(inputs) . d(inputs)/d(lag); overwrites the factors.
            for i in range(12):
                acting[i] = inputs[i] + WIDE * along[i]
            rates(x, acting, c, decay, up, work)
            for i in range(12):
                acting[i] = inputs[i] - WIDE * along[i]
            rates(x, acting, c, decay, down, work)
            for i in range(6):
                a[i, p] = (up[4 + i] - down[4 + i]) / (2.0 * WIDE)
