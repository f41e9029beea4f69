"""Simulation as one compiled loop: the equations of hydro/dynamics, called by number.

No equation stands here (numbers are those of McCarter 2014): numba compiles the same
functions of components that the array functions call (EQUATIONS), so a change in one of
them changes both. Import this module only where a simulation runs: numba takes a
second.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numba.extending
import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.fins import fin_terms
from auvid.hydro.dynamics.actuators.propeller import propeller_terms
from auvid.hydro.dynamics.mechanics.kinematics import (
    SINGULAR_COSINE,
    euler_rate_entries,
    rotation_entries,
)
from auvid.hydro.dynamics.mechanics.restoring import restoring_components
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_components
from auvid.hydro.dynamics.simulation.physical_viscous import (
    body_components,
    strip_components,
    surface_components,
)
from auvid.hydro.dynamics.simulation.plant_constants import FACTORS, Tables
from auvid.hydro.dynamics.viscous.basis import cross_flow_speed, propulsion_ratio, signed_speed

EQUATIONS: tuple[Callable[..., Any], ...] = (
    rotation_entries,
    euler_rate_entries,
    coriolis_components,
    restoring_components,
    fin_terms,
    propeller_terms,
    cross_flow_speed,
    signed_speed,
    propulsion_ratio,
    strip_components,
    surface_components,
    body_components,
)
FACTOR_COUNT = len(FACTORS)
_extending: Any = numba.extending
_types: Any = numba.types

_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",  # division by zero gives infinity
    "fastmath": {
        "contract",
        "reassoc",
        "nsz",
    },  # sums may be reordered, so that strips fill registers
    "forceinline": True,
}
for _equation in EQUATIONS:
    _extending.register_jitable(no_cfunc_wrapper=True, **_OPTIONS)(_equation)

F = TypeVar("F", bound=Callable[..., Any])


def _compiled(function: F, *, cache: bool = False) -> F:
    # Only what Python calls (it is kept) needs a wrapper for Python.
    inner: dict[str, Any] = {"no_cpython_wrapper": not cache, "no_cfunc_wrapper": True}
    result: F = numba.njit(nogil=True, cache=cache, **inner, **_OPTIONS)(function)
    return result


@_compiled
def _row(matrix: Array, row: int, x: tuple[Array, ...]) -> Any:
    total = 0.0
    for column in range(len(x)):
        total += matrix[row * len(x) + column] * x[column]
    return total


@_compiled
def _six(matrix: Array, x: tuple[Array, ...]) -> Any:
    """Return a matrix (6, n) times a vector."""
    # The sums stand here: numba compiles a function anew for each row given as a number.
    a, b, c, d, e, f, n = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, len(x)
    for i in range(n):
        a += matrix[i] * x[i]
        b += matrix[n + i] * x[i]
        c += matrix[2 * n + i] * x[i]
        d += matrix[3 * n + i] * x[i]
        e += matrix[4 * n + i] * x[i]
        f += matrix[5 * n + i] * x[i]
    return a, b, c, d, e, f


@_compiled
def _model_force(nu: Any, eta: Array, c: Tables, factors: Array) -> Any:
    """Return K xi(nu) (3.12)."""
    for i in range(6):
        factors[i], factors[6 + i] = nu[i], abs(nu[i])
    across = cross_flow_speed(nu[1], nu[2])
    factors[12], factors[13], factors[14] = (
        across, signed_speed(across, nu[1]), signed_speed(across, nu[2]),
    )  # fmt: skip
    factors[15], factors[16] = eta - 1.0, 1.0
    for i in range(c.counts[0]):
        factors[FACTOR_COUNT + i] = (
            factors[c.factors[3 * i]]
            * factors[c.factors[3 * i + 1]]
            * factors[c.factors[3 * i + 2]]
        )
    x, y, z, k, m, n, terms, b = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, c.counts[0], c.coefficients
    for i in range(terms):
        term = factors[FACTOR_COUNT + i]
        x += b[i] * term
        y += b[terms + i] * term
        z += b[2 * terms + i] * term
        k += b[3 * terms + i] * term
        m += b[4 * terms + i] * term
        n += b[5 * terms + i] * term
    return x, y, z, k, m, n


@_compiled
def _column(table: Array, i: int, k: int) -> Any:
    return (
        table[i], table[i + k], table[i + 2 * k], table[i + 3 * k], table[i + 4 * k],
        table[i + 5 * k], table[i + 6 * k], table[i + 7 * k], table[i + 8 * k],
        table[i + 9 * k], table[i + 10 * k],
    )  # fmt: skip


@_compiled
def _physical_force(nu: Any, c: Tables) -> Any:
    """Return the force of `PhysicalViscous`."""
    u, v, w, p, q, r = nu
    x, y, z, k, m, n = body_components(c.body, c.axial, c.asymmetry, u, v, w, p, q, r)
    for i in range(c.counts[1]):
        dy, dz, dm, dn = strip_components(c.strips[i], c.strips[i + c.counts[1]], v, w, p, q, r)
        y += dy
        z += dz
        m += dm
        n += dn
    for i in range(c.counts[2]):
        dx, dy, dz, dk, dm, dn = surface_components(
            _column(c.surfaces, i, c.counts[2]), u, v, w, p, q, r
        )
        x += dx
        y += dy
        z += dz
        k += dk
        m += dm
        n += dn
    return x, y, z, k, m, n


@_compiled
def derivative(x: Array, inputs: Array, c: Tables, out: Array, factors: Array) -> None:
    """Write d/dt of the state [nu, eta] (12,), or with the lagged force after it (18,).

    `inputs` (12,): propeller [rev/s], u_c(n) [m/s], four fins [rad], any further force
    (6) [N, N m]. `factors` (FACTOR_COUNT + terms,): scratch.
    """
    # x, inputs, out and factors are arrays, or addresses within the loop.
    if c.physical:
        viscous = _physical_force((x[0], x[1], x[2], x[3], x[4], x[5]), c)
    else:
        viscous = model_force(x, inputs, c, factors)
    if c.lag_s > 0.0:
        for i in range(6):
            out[12 + i] = (viscous[i] - x[12 + i]) / c.lag_s
        viscous = (x[12], x[13], x[14], x[15], x[16], x[17])
    motion_rates(x, inputs, viscous, c, out)


@_compiled
def model_force(x: Array, inputs: Array, c: Tables, factors: Array) -> Any:
    """Return the force of the coefficients at a state and its inputs."""
    nu = (x[0], x[1], x[2], x[3], x[4], x[5])
    eta = propulsion_ratio(inputs[1], nu[0], nu[1], nu[2], c.minimum_speed)
    return _model_force(nu, eta, c, factors)


@_compiled
def motion_rates(x: Array, inputs: Array, viscous: Any, c: Tables, out: Array) -> None:
    """Write d/dt of [nu, eta] (12,) under a viscous force and the inputs."""
    nu = (x[0], x[1], x[2], x[3], x[4], x[5])
    sf, cf = np.sin(x[9]), np.cos(x[9])
    st, ct = np.sin(x[10]), np.cos(x[10])
    # Kinematics.
    rotation = rotation_entries(sf, cf, st, ct, np.sin(x[11]), np.cos(x[11]))
    singular: Any = np.nan if abs(ct) < SINGULAR_COSINE else ct
    turning = euler_rate_entries(sf, cf, st, singular)
    for i in range(3):
        out[6 + i] = rotation[i][0] * nu[0] + rotation[i][1] * nu[1] + rotation[i][2] * nu[2]
        out[9 + i] = turning[i][0] * nu[3] + turning[i][1] * nu[4] + turning[i][2] * nu[5]
    # The other forces, and M^-1 of their sum.
    coriolis = coriolis_components(nu, _six(c.mass, nu))
    restoring = restoring_components(
        sf, cf, st, ct, c.restoring[0], c.restoring[1], c.restoring[2], c.restoring[3]
    )
    fins = _six(c.fins, fin_terms(nu[0], inputs[2], inputs[3], inputs[4], inputs[5]))
    spin = propeller_terms(nu[0], inputs[0], c.inflow_per_u)
    propeller = (_row(c.propeller, 0, spin), 0.0, 0.0, _row(c.propeller, 1, spin), 0.0, 0.0)
    for i in range(6):
        out[i] = viscous[i] + restoring[i] + fins[i] + propeller[i] + inputs[6 + i] - coriolis[i]
    tau = (out[0], out[1], out[2], out[3], out[4], out[5])
    acceleration = _six(c.inverse, tau)
    for i in range(6):
        out[i] = acceleration[i]


@_extending.intrinsic  # type: ignore[untyped-decorator]
def _address(typing: Any, array: Any) -> Any:
    """Where the numbers of an array are: unlike the array, it is not counted."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.make_array(array)(context, builder, args[0]).data

    return _types.CPointer(array.dtype)(array), code


@_compiled
def addresses(c: Tables) -> Tables:
    return Tables(
        _address(c.mass), _address(c.inverse), _address(c.restoring), _address(c.fins),
        _address(c.propeller), c.inflow_per_u, _address(c.factors), _address(c.coefficients),
        _address(c.strips), _address(c.surfaces), c.counts, c.physical, _address(c.body),
        _address(c.axial), _address(c.asymmetry), c.lag_s, c.minimum_speed,
    )  # fmt: skip


@_compiled
def _integrate(
    x0: Array,
    n: Array,
    level: Array,
    fins: Array,
    force: Array,
    step: float,
    per_knot: int,
    c: Tables,
    out: Array,
    first: int,
    stop: int,
    state: Array,
    now: Array,
    factors: Array,
) -> None:
    """Do the work of `integrate` in scratch of the caller, which keeps it alive."""
    c = addresses(c)
    size, last = x0.shape[1], n.shape[1] - 1
    x, stage, slope = _address(state[0]), _address(state[1]), _address(state[2])
    total, low, high = _address(state[3]), now[0], now[1]
    acting, scratch = _address(now[2]), _address(factors)
    for b in range(first, stop):
        for i in range(size):
            x[i] = stage[i] = out[b, 0, i] = x0[b, i]
            total[i] = 0.0
        finite = 0.0  # nan once a state was not finite
        for s in range(out.shape[1] - 1):
            phase = s % per_knot
            if phase == 0:
                for values, knot in (
                    (low, s // per_knot),
                    (high, min(s // per_knot + 1, last)),
                ):
                    values[0], values[1] = n[b, knot], level[b, knot]
                    for i in range(4):
                        values[2 + i] = fins[b, knot, i]
                    for i in range(6):
                        values[6 + i] = force[b, knot, i]
            for part in range(4):
                share = (phase + 0.5 * ((part + 1) // 2)) / per_knot
                for i in range(12):
                    acting[i] = low[i] + share * (high[i] - low[i])
                derivative(stage, acting, c, slope, scratch)
                weight = 2.0 if part == 1 or part == 2 else 1.0
                ahead = step if part == 2 else 0.5 * step
                for i in range(size):
                    total[i] += weight * slope[i]
                    stage[i] = x[i] + ahead * slope[i]
            for i in range(size):
                x[i] += step / 6.0 * total[i]
                stage[i], total[i] = x[i], 0.0
                out[b, s + 1, i] = x[i] + finite
            for i in range(size):
                finite += 0.0 * x[i]


def _integrator(sources: str) -> Any:
    """Return the compiled loop over vehicles; numba keys what it keeps by `sources`."""

    def integrate(
        x0: Array,
        n: Array,
        level: Array,
        fins: Array,
        force: Array,
        step: float,
        per_knot: int,
        c: Tables,
        out: Array,
        first: int,
        stop: int,
    ) -> None:
        """Fill `out` (batch, steps + 1, s) for vehicles `first` to `stop` by RK4.

        `x0` (batch, s). Inputs at knots, linear between them: `n` and `level` (batch,
        k), `fins` (batch, k, 4), `force` (batch, k, 6). Rows after a state that is not
        finite are nan.
        """
        assert len(sources) > 0
        state, now = np.empty((4, x0.shape[1])), np.empty((3, 12))
        factors = np.empty(FACTOR_COUNT + c.counts[0])
        _integrate(
            x0, n, level, fins, force, step, per_knot, c, out, first, stop, state, now, factors
        )

    return _compiled(integrate, cache=True)


_MODULES = {inspect.getmodule(item) for item in (*EQUATIONS, derivative)}
SOURCES = sorted(inspect.getsource(module) for module in _MODULES if module is not None)
integrate: Any = _integrator(hashlib.sha256("".join(SOURCES).encode()).hexdigest())
