"""Derivatives of rates and outputs by the state, as differences."""

from __future__ import annotations

from auvid.hydro.arrays import Array, Ints
from auvid.hydro.dynamics.simulation.compiled import FACTOR_COUNT
from auvid.hydro.dynamics.simulation.plant_constants import Tables
from auvid.hydro.identification.maximum_likelihood.window_loop.compiling import compiled
from auvid.hydro.identification.maximum_likelihood.window_loop.layout import (
    INERTIA,
    MEASURED,
    MOTION,
    VISCOUS,
    Workspace,
)
from auvid.hydro.identification.maximum_likelihood.window_loop.motion import (
    inertia_force,
    inverse_column,
    rates,
)
from auvid.hydro.identification.maximum_likelihood.window_loop.sensors import (
    SensorPlaces,
    accelerometer,
    outputs,
)

STEP = 1e-6
"""Width of one-sided differences of the state [rad, m/s, rad/s], whose error is some
1e-6 of a derivative."""


@compiled
def jacobians(
    x: Array,
    rate: Array,
    y: Array,
    inputs: Array,
    c: Tables,
    decay: Array,
    g: SensorPlaces,
    A: Array,
    H: Array,
    kinds: Ints,
    terms: Array,
    pull: Array,
    moved: Array,
    there: Array,
    y_there: Array,
    force: Array,
    work: Workspace,
) -> None:
    """Write d(rate)/dx of the motion (10, n) and d(outputs)/dx (13, n).

    `rate` and `y`: rate and outputs at x. The columns of the force are M^-1. `pull`
    (parameters, 6, n), where it has rows: derivative by x of the force that a parameter
    adds per unit; `terms`: the terms at x. A lag's own is left out.
    """
    n = len(x)
    for i in range(n):
        moved[i] = x[i]
    for j in range(MOTION):
        if j == 2 or j == 3:  # heading and depth act on nothing but themselves
            continue
        # Away from 0, where moduli have a kink and V sign(w) (C.11) a jump.
        h = STEP if x[j] >= 0.0 else -STEP
        moved[j] = x[j] + h
        rates(moved, inputs, c, decay, there, work)
        outputs(moved, there, g, y_there)
        for i in range(MOTION):
            A[i, j] = (there[i] - rate[i]) / h
        for i in range(MEASURED):
            H[i, j] = (y_there[i] - y[i]) / h
        for p in range(len(pull)):
            kind, row, column = kinds[p, 0], kinds[p, 1], kinds[p, 2]
            if kind == VISCOUS:
                pull[p, row, j] = (work[3][FACTOR_COUNT + column] - terms[column]) / h
            elif kind == INERTIA:
                inertia_force(x, rate, row, column, force)
                for i in range(6):
                    pull[p, i, j] = -force[i] / h
                inertia_force(moved, there, row, column, force)
                for i in range(6):
                    pull[p, i, j] += force[i] / h
        moved[j] = x[j]
    for k in range(n - MOTION):
        for i in range(6):
            A[4 + i, MOTION + k] = c.inverse[6 * i + k]
        H[6, MOTION + k], H[7, MOTION + k], H[8, MOTION + k] = accelerometer(
            g, inverse_column(c.inverse, k)
        )
        for p in range(len(pull)):
            kind, row, column = kinds[p, 0], kinds[p, 1], kinds[p, 2]
            if kind == INERTIA:
                pull[p, row, MOTION + k] = -c.inverse[6 * column + k]
                pull[p, column, MOTION + k] = -c.inverse[6 * row + k]
