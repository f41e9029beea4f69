"""One step of vehicles under held inputs, a force field and a current, compiled.

The force field is that of Al Makdah 2016, the equations of motion are those of
`compiled.motion_rates`. Import this module only where vehicles are flown: numba takes a
second.
"""

from __future__ import annotations

import hashlib
import inspect
from typing import Any

import numba.extending
import numpy as np

from auvid.hydro import arrays
from auvid.hydro.arrays import Array, cross_components
from auvid.hydro.dynamics.mechanics.kinematics import rotation_entries
from auvid.hydro.dynamics.simulation import compiled
from auvid.hydro.dynamics.simulation.compiled import (
    FACTOR_COUNT,
    SOURCES,
    addresses,
    model_force,
    motion_rates,
)
from auvid.hydro.dynamics.simulation.plant_constants import Members, Tables

STATES = 12
_address, _compiled = compiled._address, compiled._compiled
_extending: Any = numba.extending
_extending.register_jitable(no_cfunc_wrapper=True, **compiled._OPTIONS)(cross_components)


@_compiled
def _to_body(rows: Any, x: Array) -> Any:
    """Return a vector of the inertial frame in body axes (2.56)."""
    return (
        rows[0][0] * x[0] + rows[1][0] * x[1] + rows[2][0] * x[2],
        rows[0][1] * x[0] + rows[1][1] * x[1] + rows[2][1] * x[2],
        rows[0][2] * x[0] + rows[1][2] * x[1] + rows[2][2] * x[2],
    )


@_compiled
def _rates(
    x: Array, inputs: Array, push: Array, current: Array, r_G: Array, c: Tables, water: Array,
    acting: Array, factors: Array, out: Array,
) -> None:  # fmt: skip
    """Write d/dt of [nu, eta] (12,): nu over ground, forces by that through the water.

    `push` (3,): a force at the centre of gravity `r_G` (3,), `current` (3,), both in
    NED (2.55)-(2.58).
    """
    to_ned = rotation_entries(
        np.sin(x[9]), np.cos(x[9]), np.sin(x[10]), np.cos(x[10]), np.sin(x[11]), np.cos(x[11])
    )
    drift, pushed = _to_body(to_ned, current), _to_body(to_ned, push)
    moment = cross_components((r_G[0], r_G[1], r_G[2]), pushed)
    for i in range(STATES):
        water[i], acting[i] = x[i], inputs[i]
    for i in range(3):
        water[i] -= drift[i]
        acting[6 + i] += pushed[i]
        acting[9 + i] += moment[i]
    motion_rates(water, acting, model_force(water, acting, c, factors), c, out)
    # In a steady current the body components of the water's velocity turn with the
    # vehicle: d/dt = -omega x v_c.
    turned = cross_components((x[3], x[4], x[5]), drift)
    for i in range(3):
        out[i] -= turned[i]
        out[6 + i] += current[i]


@_compiled
def _step(
    chi: Array, inputs: Array, push: Array, current: Array, members: Members, c: Tables, h: float,
    scratch: Array, factors: Array, out: Array,
) -> None:  # fmt: skip
    """Do the work of `step` in scratch of the caller, which keeps it alive."""
    shared, terms = addresses(c), _address(factors)
    x, stage, slope = _address(scratch[0]), _address(scratch[1]), _address(scratch[2])
    total, water, acting = _address(scratch[3]), _address(scratch[4]), _address(scratch[5])
    mass, inverse, restoring = members.mass, members.inverse, members.restoring
    coefficients, r_G = members.coefficients, members.r_G
    for b in range(len(chi)):
        own = Tables(
            _address(mass[b % len(mass)]), _address(inverse[b % len(inverse)]),
            _address(restoring[b % len(restoring)]), shared.fins, shared.propeller,
            shared.inflow_per_u, shared.factors, _address(coefficients[b % len(coefficients)]),
            shared.strips, shared.surfaces, shared.counts, shared.physical, shared.body,
            shared.axial, shared.asymmetry, shared.lag_s, shared.minimum_speed,
        )  # fmt: skip
        constant, pushed = _address(inputs[b]), _address(push[b])
        flow, arm = _address(current[b]), _address(r_G[b % len(r_G)])
        for i in range(STATES):
            x[i] = stage[i] = chi[b, i]
            total[i] = 0.0
        for part in range(4 if h > 0.0 else 1):
            _rates(stage, constant, pushed, flow, arm, own, water, acting, terms, slope)
            weight = 2.0 if part == 1 or part == 2 else 1.0
            ahead = h if part == 2 else 0.5 * h
            for i in range(STATES):
                total[i] += weight * slope[i]
                stage[i] = x[i] + ahead * slope[i]
        for i in range(STATES):
            out[b, i] = x[i] + h / 6.0 * total[i] if h > 0.0 else total[i]


def _loop_over_vehicles(sources: str) -> Any:
    """Return the compiled loop over vehicles; numba keys what it keeps by `sources`."""

    def step(
        chi: Array, inputs: Array, push: Array, current: Array, members: Members, c: Tables,
        h: float, out: Array,
    ) -> None:  # fmt: skip
        """Write chi (b, 12) = [nu, eta] after `h` seconds of RK4; for h = 0 its rate.

        `inputs` (b, 12) as `compiled.derivative` has them, held; `push` and `current`
        (b, 3): a force field at the centre of gravity and a steady current, NED. Rows
        of `members`: one for all, or b.
        """
        assert len(sources) > 0
        scratch, factors = np.empty((6, STATES)), np.empty(FACTOR_COUNT + c.counts[0])
        _step(chi, inputs, push, current, members, c, h, scratch, factors, out)

    return _compiled(step, cache=True)


_ALL_SOURCES = "".join((*SOURCES, inspect.getsource(arrays)))
step: Any = _loop_over_vehicles(hashlib.sha256(_ALL_SOURCES.encode()).hexdigest())
