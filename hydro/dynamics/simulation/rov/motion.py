"""Equations of motion of an ROV in a current, for arrays and the compiled loop.

State x (12 + n): velocity through the water, pose, and the bollard thrust of each
thruster after its lag. A steady current carries the vehicle: the equations hold for the
velocity through the water, the pose moves over ground.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_entries, rotation_entries
from auvid.hydro.dynamics.mechanics.restoring import restoring_components
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_components
from auvid.hydro.dynamics.simulation.rov.open_frame import plate_components
from auvid.hydro.dynamics.simulation.rov.tether import tether_components
from auvid.hydro.dynamics.simulation.rov.thrust import delivered_components
from auvid.hydro.dynamics.viscous.basis import cross_flow_speed, signed_speed

FIRST_PULSE_US, LAST_PULSE_US = 1100, 1900
"""Pulses that an ArduSub vehicle sends; the thrust of each stands in a table."""


class RovTables(NamedTuple):
    """Constants of an ROV for the loop.

    `mass`, `inverse` (6, 6); `restoring` (4,): W - B and r_G W - r_B B; `plates` (10,
    k); `factors` (t, 3) and `coefficients` (6, t) of a viscous model; `tether` (11,);
    `loss` (5,) and `lag_s`; `position` (n, 3); `allocation` (6, n); `mixing`
    (n, 6) and `direction` (n,); `thrust` (pulses,): bollard thrust of each pulse;
    `supply` (7,): voltage of the curve and exponent, then `Battery`; `current` (3,).
    """

    mass: Array
    inverse: Array
    restoring: Array
    plates: Array
    factors: NDArray[np.int64]
    coefficients: Array
    tether: Array
    loss: Array
    lag_s: float
    position: Array
    allocation: Array
    mixing: Array
    direction: Array
    thrust: Array
    supply: Array
    current: Array


def row_times(matrix: Array, row: int, x: tuple[Array, ...]) -> Array:
    """Return a row of a matrix times a vector of components."""
    total: Array = matrix[row, 0] * x[0]
    for column in range(1, len(x)):
        total = total + matrix[row, column] * x[column]
    return total


def six_times(matrix: Array, x: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return a matrix (6, k) times a vector of k components."""
    return (
        row_times(matrix, 0, x), row_times(matrix, 1, x), row_times(matrix, 2, x),
        row_times(matrix, 3, x), row_times(matrix, 4, x), row_times(matrix, 5, x),
    )  # fmt: skip


def plus(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return the sum of two forces of six components."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


def hull_components(c: RovTables, nu: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return the viscous force on the hull: of its plates, and of a model K xi(nu)."""
    u, v, w, p, q, r = nu
    zero, f = 0.0 * u, c.plates
    x, y, z, k, m, n = zero, zero, zero, zero, zero, zero
    # One sum per axis over columns of plates, which the compiler turns into vectors.
    for i in range(f.shape[1]):
        row = (
            f[0, i], f[1, i], f[2, i], f[3, i], f[4, i],
            f[5, i], f[6, i], f[7, i], f[8, i], f[9, i],
        )  # fmt: skip
        dx, dy, dz, dk, dm, dn = plate_components(row, u, v, w, p, q, r)
        x, y, z, k, m, n = x + dx, y + dy, z + dz, k + dk, m + dm, n + dn
    total: tuple[Array, ...] = (x, y, z, k, m, n)
    if len(c.factors) > 0:
        across = cross_flow_speed(v, w)
        values = (
            u, v, w, p, q, r,
            abs(u), abs(v), abs(w), abs(p), abs(q), abs(r),
            across, signed_speed(across, v), signed_speed(across, w), zero, zero + 1.0,
        )  # fmt: skip
        for t in range(len(c.factors)):
            g, b = c.factors, c.coefficients
            term = values[g[t, 0]] * values[g[t, 1]] * values[g[t, 2]]
            of_term = (
                b[0, t] * term, b[1, t] * term, b[2, t] * term,
                b[3, t] * term, b[4, t] * term, b[5, t] * term,
            )  # fmt: skip
            total = plus(total, of_term)
    return total


def thruster_components(c: RovTables, bollard: Array, nu: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return X to N of the thrust delivered; `bollard` (n, ...) [N] after the lag."""
    zero, b, place = 0.0 * nu[0], c.allocation, c.position
    total: tuple[Array, ...] = (zero, zero, zero, zero, zero, zero)
    for i in range(b.shape[1]):
        axis = (b[0, i], b[1, i], b[2, i])
        f = delivered_components(
            c.loss, bollard[i], axis, (place[i, 0], place[i, 1], place[i, 2]), nu
        )
        of_one = (b[0, i] * f, b[1, i] * f, b[2, i] * f, b[3, i] * f, b[4, i] * f, b[5, i] * f)
        total = plus(total, of_one)
    return total


def rov_rate(x: Array, goal: Array, push: tuple[Array, ...], c: RovTables, out: Array) -> None:
    """Write d/dt of the state x (12 + n, ...) to `out`: McCarter (2.60)-(2.66).

    x = [nu, eta, f]: M nu_dot + C(nu) nu = tau_G + hull + tether + thrusters + push, for
    the velocity through the water; d/dt [x y z] = P_v v + current; d/dt f = (goal - f) /
    lag.
    `goal` (n, ...): bollard thrust of the pulses; `push` (6): unsteady force. Without
    lag the state holds the goal.
    """
    nu = (x[0], x[1], x[2], x[3], x[4], x[5])
    sf, cf, st, ct = np.sin(x[9]), np.cos(x[9]), np.sin(x[10]), np.cos(x[10])
    rotation = rotation_entries(sf, cf, st, ct, np.sin(x[11]), np.cos(x[11]))
    turning = euler_rate_entries(sf, cf, st, ct)
    for i in range(3):
        out[6 + i] = (
            rotation[i][0] * nu[0] + rotation[i][1] * nu[1] + rotation[i][2] * nu[2] + c.current[i]
        )
        out[9 + i] = turning[i][0] * nu[3] + turning[i][1] * nu[4] + turning[i][2] * nu[5]
    bollard = x[12:]
    force = restoring_components(
        sf, cf, st, ct, c.restoring[0], c.restoring[1], c.restoring[2], c.restoring[3]
    )
    force = plus(force, hull_components(c, nu))
    current = (c.current[0], c.current[1], c.current[2])
    force = plus(force, tether_components(c.tether, rotation, (x[6], x[7], x[8]), nu, current))
    force = plus(plus(force, thruster_components(c, bollard, nu)), push)
    inertial = coriolis_components(nu, six_times(c.mass, nu))
    net = (
        force[0] - inertial[0], force[1] - inertial[1], force[2] - inertial[2],
        force[3] - inertial[3], force[4] - inertial[4], force[5] - inertial[5],
    )  # fmt: skip
    acceleration = six_times(c.inverse, net)
    for i in range(6):
        out[i] = acceleration[i]
    for i in range(c.allocation.shape[1]):
        out[12 + i] = (goal[i] - x[12 + i]) / c.lag_s if c.lag_s > 0.0 else 0.0 * goal[i]
