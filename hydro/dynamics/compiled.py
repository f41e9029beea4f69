"""The right-hand side of hydro/dynamics as one compiled loop over constant tables, for long simulations of one vehicle or many.

Nothing is decided here: `plant_tables` reads every constant from the values of the other modules, and the arithmetic below is theirs,
written out by element; a test holds it to the numpy path at 1e-12. Import this module only where a simulation runs: numba takes a second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from hydro.dynamics.arrays import AXES, VELOCITIES, Array
from hydro.dynamics.kinematics import SINGULAR_COSINE
from hydro.dynamics.physical_viscous import SPEED_FLOOR, PhysicalViscous
from hydro.dynamics.vehicle import Vehicle
from hydro.dynamics.viscous_basis import BASIS_TERMS, MODULI, PROPULSION
from hydro.dynamics.viscous_models import IdentifiedModel

FACTORS = (*VELOCITIES, *MODULI, "V", "Vv", "Vw", PROPULSION, "one")
_ONE = FACTORS.index("one")
Integers = NDArray[np.int64]
F = TypeVar("F", bound=Callable[..., Any])


class Tables(NamedTuple):
    """Constants of a plant.

    `restoring`: W - B, and r_G W - r_B B. `fins` (2, 6, 4): dimensional coefficients of delta and delta^2 at u = 1 m/s. `propeller` (7,):
    (1 - w_f) / D, rho D^4 times K_T, rho D^5 times K_Q. `factors` (n, 3), `place` (n, 2) axis and `value` (n,): one row per coefficient of
    a viscous model. The others are those of `PhysicalViscous`, empty for a model. `lag_s`: time constant of the viscous force, or 0.
    """

    mass: Array
    inverse: Array
    restoring: Array
    fins: Array
    propeller: Array
    factors: Integers
    axis: Integers
    value: Array
    strips: Array
    surfaces: Array
    body: Array
    axial: Array
    asymmetry: Array
    lag_s: float
    minimum_speed: float


def plant_tables(vehicle: Vehicle, truth: PhysicalViscous | IdentifiedModel, *, lag_s: float, minimum_speed: float) -> Tables:
    """The tables of a vehicle with this viscous truth; what the vehicle does not have is zero."""
    fins = np.zeros((2, 6, 4))
    if vehicle.fins is not None:
        scale = 0.5 * vehicle.water_density * vehicle.fins.length_m ** np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
        fins[0], fins[1] = scale[:, None] * vehicle.fins.linear, scale[:, None] * vehicle.fins.quadratic
    propeller = np.zeros(7)
    if vehicle.propeller is not None:
        drive, rho = vehicle.propeller, vehicle.water_density
        propeller[0] = (1.0 - drive.wake_fraction) / drive.diameter_m
        propeller[1:4], propeller[4:] = rho * drive.diameter_m**4 * drive.thrust, rho * drive.diameter_m**5 * drive.torque
    rows = [(axis, term, value) for axis, terms in getattr(truth, "coefficients", {}).items() for term, value in terms.items() if value]
    physical = truth if isinstance(truth, PhysicalViscous) else _NO_PHYSICS
    return Tables(
        mass=np.array(vehicle.mass_matrix),
        inverse=np.array(vehicle.mass_matrix_inverse),
        restoring=np.concatenate([[vehicle.weight - vehicle.buoyancy], vehicle.r_G * vehicle.weight - vehicle.r_B * vehicle.buoyancy]),
        fins=fins,
        propeller=propeller,
        factors=np.array([_factor_row(term) for _, term, _ in rows], dtype=np.int64).reshape(-1, 3),
        axis=np.array([AXES.index(axis) for axis, _, _ in rows], dtype=np.int64),
        value=np.array([value for *_, value in rows], dtype=np.float64),
        strips=np.array(physical.strips),
        surfaces=np.array(physical.surfaces),
        body=np.array(physical.body),
        axial=np.array(physical.axial),
        asymmetry=np.array(physical.asymmetry),
        lag_s=float(lag_s),
        minimum_speed=float(minimum_speed),
    )


_NO_PHYSICS = PhysicalViscous(np.zeros((0, 2)), np.zeros((0, 11)), np.zeros(3), np.zeros(2), np.zeros(6))


def _factor_row(term: str) -> list[int]:
    found = [FACTORS.index(factor) for factor in BASIS_TERMS[term].factors]
    return found + [_ONE] * (3 - len(found))


def _compiled(function: F) -> F:
    """Compiled on first use and kept in __pycache__; division by zero gives infinity as in numpy."""
    jit: Any = numba.njit(cache=True, error_model="numpy")
    result: F = jit(function)
    return result


@_compiled
def _model_force(nu: Array, eta_minus_1: float, c: Tables, tau: Array, f: Array) -> None:
    """tau += K xi(nu) (3.12), coefficient by coefficient; `f` (17,) is room for the factors."""
    for i in range(6):
        f[i] = nu[i]
        f[6 + i] = abs(nu[i])
    f[12] = np.sqrt(nu[1] * nu[1] + nu[2] * nu[2])
    f[13] = f[12] * np.sign(nu[1])
    f[14] = f[12] * np.sign(nu[2])
    f[15] = eta_minus_1
    f[16] = 1.0
    for k in range(c.value.shape[0]):
        tau[c.axis[k]] += c.value[k] * f[c.factors[k, 0]] * f[c.factors[k, 1]] * f[c.factors[k, 2]]


@_compiled
def _physical_force(nu: Array, c: Tables, tau: Array) -> None:
    """tau += the force of `PhysicalViscous`."""
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    forward = u * abs(u)
    for i in range(6):
        tau[i] += c.asymmetry[i] * forward
    tau[0] -= c.axial[0] * u * abs(u) ** (1.0 - c.axial[1])
    for i in range(c.strips.shape[0]):
        x = c.strips[i, 0]
        side, down = v + x * r, w - x * q
        drag = -c.strips[i, 1] * np.sqrt(side * side + down * down)
        tau[1] += drag * side
        tau[2] += drag * down
        tau[4] -= x * drag * down
        tau[5] += x * drag * side
    x = c.body[1]
    side, down = v + x * r, w - x * q
    lift_y, lift_z = -c.body[0] * abs(u) * side, -c.body[0] * abs(u) * down
    tau[0] -= c.body[2] * (side * side + down * down) * u / np.sqrt(u * u + v * v + w * w + SPEED_FLOOR)
    tau[1] += lift_y
    tau[2] += lift_z
    tau[4] -= x * lift_z
    tau[5] += x * lift_y
    for i in range(c.surfaces.shape[0]):
        s = c.surfaces[i]
        ahead = u + q * s[2] - r * s[1]
        across = ahead * s[3] + (v + r * s[0] - p * s[2]) * s[4] + (w + p * s[1] - q * s[0]) * s[5]
        sine2 = across * across / (ahead * ahead + across * across + SPEED_FLOOR)
        attached = 1.0 / (1.0 + (sine2 * s[8]) * (sine2 * s[8]))
        push = -across * (s[6] * attached * abs(ahead) + s[7] * (1.0 - attached) * abs(across))
        fx = push * s[3] - (s[9] + s[10] * sine2) * ahead * abs(ahead)
        fy, fz = push * s[4], push * s[5]
        tau[0] += fx
        tau[1] += fy
        tau[2] += fz
        tau[3] += s[1] * fz - s[2] * fy
        tau[4] += s[2] * fx - s[0] * fz
        tau[5] += s[0] * fy - s[1] * fx


@_compiled
def rate(x: Array, n: float, fins: Array, extra: Array, level: float, c: Tables, out: Array, room: Array) -> None:
    """d/dt of the state x = [eta, nu] (12,), or with the lagged viscous force after it (18,); `room` (60,) is scratch.

    `n` [rev/s], `fins` (4,) [rad], `extra` (6,): any further force [N, N m], `level` = u_c(n) [m/s].
    """
    nu, tau, visc, momentum = x[6:12], room[:6], room[6:12], room[12:18]
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    sf, cf, st, ct, sp, cp = np.sin(x[3]), np.cos(x[3]), np.sin(x[4]), np.cos(x[4]), np.sin(x[5]), np.cos(x[5])
    out[0] = cp * ct * u + (-sp * cf + cp * st * sf) * v + (sp * sf + cp * cf * st) * w
    out[1] = sp * ct * u + (cp * cf + sf * st * sp) * v + (-cp * sf + st * sp * cf) * w
    out[2] = -st * u + ct * sf * v + ct * cf * w
    if abs(ct) < SINGULAR_COSINE:
        out[3] = out[4] = out[5] = np.nan
    else:
        out[3] = p + (sf * q + cf * r) * st / ct
        out[4] = cf * q - sf * r
        out[5] = (sf * q + cf * r) / ct
    for i in range(6):
        tau[i] = extra[i]
        visc[i] = 0.0
        momentum[i] = 0.0
        for j in range(6):
            momentum[i] += c.mass[i, j] * nu[j]
    speed = np.sqrt(u * u + v * v + w * w)
    if c.value.shape[0]:
        _model_force(nu, level / max(speed, c.minimum_speed) - 1.0, c, visc, room[20:40])
    if c.surfaces.shape[0]:
        _physical_force(nu, c, visc)
    if c.lag_s > 0.0:
        for i in range(6):
            out[12 + i] = (visc[i] - x[12 + i]) / c.lag_s
            tau[i] += x[12 + i]
    else:
        for i in range(6):
            tau[i] += visc[i]
    a1, a2, a3, b1, b2, b3 = momentum[0], momentum[1], momentum[2], momentum[3], momentum[4], momentum[5]
    tau[0] -= q * a3 - r * a2
    tau[1] -= r * a1 - p * a3
    tau[2] -= p * a2 - q * a1
    tau[3] -= v * a3 - w * a2 + q * b3 - r * b2
    tau[4] -= w * a1 - u * a3 + r * b1 - p * b3
    tau[5] -= u * a2 - v * a1 + p * b2 - q * b1
    net, gx, gy, gz = c.restoring[0], c.restoring[1], c.restoring[2], c.restoring[3]
    tau[0] -= net * st
    tau[1] += net * ct * sf
    tau[2] += net * ct * cf
    tau[3] += gy * ct * cf - gz * ct * sf
    tau[4] += -gz * st - gx * ct * cf
    tau[5] += gx * ct * sf + gy * st
    for i in range(6):
        force = 0.0
        for k in range(4):
            force += (c.fins[0, i, k] + c.fins[1, i, k] * fins[k]) * fins[k]
        tau[i] += u * u * force
    a = u * c.propeller[0]
    tau[0] += c.propeller[1] * a * a + c.propeller[2] * a * abs(n) + c.propeller[3] * n * abs(n)
    tau[3] += c.propeller[4] * a * a + c.propeller[5] * a * abs(n) + c.propeller[6] * n * abs(n)
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += c.inverse[i, j] * tau[j]
        out[6 + i] = total


@_compiled
def integrate(x0: Array, n: Array, fins: Array, extra: Array, level: Array, step: float, per_knot: int, c: Tables, out: Array) -> int:
    """Runge-Kutta 4 from `x0` with inputs linear between knots; fills `out` (steps + 1, states) and returns the rows that are finite."""
    size = x0.shape[0]
    room = np.empty(60)
    k = np.empty((4, size))
    x, stage = x0.copy(), np.empty(size)
    fin, more = np.empty(4), np.empty(6)
    out[0] = x
    last = n.shape[0] - 1
    for s in range(out.shape[0] - 1):
        knot = min(s // per_knot, last)
        after = min(knot + 1, last)
        for part in range(4):
            at = (s % per_knot + (0.0, 0.5, 0.5, 1.0)[part]) / per_knot
            for i in range(4):
                fin[i] = fins[knot, i] + at * (fins[after, i] - fins[knot, i])
            for i in range(6):
                more[i] = extra[knot, i] + at * (extra[after, i] - extra[knot, i])
            rev = n[knot] + at * (n[after] - n[knot])
            speed = level[knot] + at * (level[after] - level[knot])
            if part == 0:
                rate(x, rev, fin, more, speed, c, k[0], room)
            else:
                share = step if part == 3 else 0.5 * step
                for i in range(size):
                    stage[i] = x[i] + share * k[part - 1, i]
                rate(stage, rev, fin, more, speed, c, k[part], room)
        finite = True
        for i in range(size):
            x[i] += step / 6.0 * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i])
            out[s + 1, i] = x[i]
            finite = finite and np.isfinite(x[i])
        if not finite:
            return s + 1
    return int(out.shape[0])


@_compiled
def integrate_many(
    x0: Array, n: Array, fins: Array, extra: Array, level: Array, step: float, per_knot: int, c: Tables, out: Array, kept: Integers
) -> None:
    """`integrate` for every vehicle of a batch, all arguments with the batch in front; `kept` (batch,) takes the rows that are finite."""
    for b in range(x0.shape[0]):
        kept[b] = integrate(x0[b], n[b], fins[b], extra[b], level[b], step, per_knot, c, out[b])
