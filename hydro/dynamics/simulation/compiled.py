"""The right-hand side of hydro/dynamics as one compiled loop over constant tables, for
long simulations of one vehicle or many.

Nothing is decided here: `plant_tables` reads every constant from the values of the
other modules, and the arithmetic below is theirs, written out by element; a test holds
it to the numpy path at 1e-12. It is written once and compiled twice: for numbers, one
vehicle at a time, and for the registers of hydro/dynamics/lanes.py, eight vehicles at a
time. Strips and surfaces fill a register in both cases: one after the other with a lane
per vehicle, or eight of them at once for a single vehicle. Import this module only
where a simulation runs: numba takes a second.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import SINGULAR_COSINE
from auvid.hydro.dynamics.simulation.lanes import (
    absolute,
    address,
    choose,
    column,
    compiled,
    get,
    larger,
    power,
    put,
    root,
    sine_cosine,
    spread,
    together,
    total,
)
from auvid.hydro.dynamics.simulation.physical_viscous import SPEED_FLOOR
from auvid.hydro.dynamics.simulation.plant_constants import WIDTH, Tables

_config: Any = numba.config
THREADS: int = _config.NUMBA_NUM_THREADS
"""As many as numba would start: the processors this process may use, or
NUMBA_NUM_THREADS of the environment.
"""


@compiled
def room_for(c: Tables) -> int:
    """Numbers of scratch that `rate` needs for each vehicle: terms and factors of a
    viscous model.
    """
    return _whole(c.counts[0]) + 17


@compiled
def _whole(count: int) -> int:
    return (count + WIDTH - 1) // WIDTH * WIDTH


@compiled
def _model_force(nu: Any, eta_minus_1: Any, c: Tables, room: Array, like: Any) -> Any:
    """K xi(nu) McCarter (3.12)."""
    f = _whole(c.counts[0])  # room: the terms, and behind them their factors
    for i in range(6):
        put(room, f + i, nu[i])
        put(room, f + 6 + i, absolute(nu[i]))
    v, w = nu[1], nu[2]
    cross_speed = root(v * v + w * w)
    put(room, f + 12, cross_speed)
    put(room, f + 13, choose(0.0, v, cross_speed, choose(v, 0.0, 0.0 - cross_speed, like)))
    put(room, f + 14, choose(0.0, w, cross_speed, choose(w, 0.0, 0.0 - cross_speed, like)))
    put(room, f + 15, eta_minus_1)
    put(room, f + 16, like + 1.0)
    for k in range(f):
        pair = get(room, f + c.factors[3 * k], like) * get(room, f + c.factors[3 * k + 1], like)
        put(room, k, pair * get(room, f + c.factors[3 * k + 2], like))
    return (
        _axis_force(0, c, room, like),
        _axis_force(1, c, room, like),
        _axis_force(2, c, room, like),
        _axis_force(3, c, room, like),
        _axis_force(4, c, room, like),
        _axis_force(5, c, room, like),
    )


@compiled
def _axis_force(axis: int, c: Tables, terms: Array, like: Any) -> Any:
    columns, first, force = WIDTH // together(like), axis * _whole(c.counts[0]), spread(0.0)
    for k in range(0, c.counts[0], columns):
        force = force + column(c.coefficients, first + k, like) * get(
            terms, k // columns, spread(0.0)
        )
    return total(force, like)


@compiled
def _physical_force(nu: Any, c: Tables, like: Any) -> Any:
    """The force of `PhysicalViscous`."""
    u, v, w, p, q, r = nu
    columns = WIDTH // together(like)
    # A strip at x feels sqrt(side^2 + down^2), a polynomial in x under the root; its
    # force and moment are moments of area times root.
    at_0, at_1, at_2 = v * v + w * w, 2.0 * (v * r - w * q), q * q + r * r
    zero = spread(0.0)
    s0, s1, s2 = zero, zero, zero
    wide = _whole(c.counts[1])
    for i in range(0, c.counts[1], columns):
        x = column(c.strips, i, like)
        drag = column(c.strips, i + wide, like) * root(absolute(at_0 + x * (at_1 + x * at_2)))
        s0 = s0 + drag
        s1 = s1 + x * drag
        s2 = s2 + x * x * drag
    d0, d1, d2 = total(s0, like), total(s1, like), total(s2, like)
    f0, f1, f2, f3, f4, f5 = zero, zero, zero, zero, zero, zero
    wide = _whole(c.counts[2])
    for i in range(0, c.counts[2], columns):
        sx, sy, sz = (
            column(c.surfaces, i, like),
            column(c.surfaces, i + wide, like),
            column(c.surfaces, i + 2 * wide, like),
        )
        nx, ny, nz = (
            column(c.surfaces, i + 3 * wide, like),
            column(c.surfaces, i + 4 * wide, like),
            column(c.surfaces, i + 5 * wide, like),
        )
        ahead = u + q * sz - r * sy
        across = ahead * nx + (v + r * sx - p * sz) * ny + (w + p * sy - q * sx) * nz
        sine2 = across * across / (ahead * ahead + across * across + SPEED_FLOOR)
        share = sine2 * column(c.surfaces, i + 8 * wide, like)
        attached = 1.0 / (1.0 + share * share)
        lift, plate = column(c.surfaces, i + 6 * wide, like), column(c.surfaces, i + 7 * wide, like)
        push = across * (
            lift * attached * absolute(ahead) + plate * (1.0 - attached) * absolute(across)
        )
        drag = (
            (
                column(c.surfaces, i + 9 * wide, like)
                + column(c.surfaces, i + 10 * wide, like) * sine2
            )
            * ahead
            * absolute(ahead)
        )
        fx, fy, fz = push * nx + drag, push * ny, push * nz
        f0, f1, f2 = f0 - fx, f1 - fy, f2 - fz
        f3 = f3 + (sz * fy - sy * fz)
        f4 = f4 + (sx * fz - sz * fx)
        f5 = f5 + (sy * fx - sx * fy)
    along = absolute(u)
    forward = u * along
    x = c.body[1]
    side, down = v + x * r, w - x * q
    lift_y, lift_z = c.body[0] * along * side, c.body[0] * along * down
    induced = (
        c.body[2] * (side * side + down * down) * u / root(u * u + v * v + w * w + SPEED_FLOOR)
    )
    return (
        total(f0, like)
        + c.asymmetry[0] * forward
        - c.axial[0] * u * power(along, 1.0 - c.axial[1])
        - induced,
        total(f1, like) + c.asymmetry[1] * forward - (v * d0 + r * d1) - lift_y,
        total(f2, like) + c.asymmetry[2] * forward - (w * d0 - q * d1) - lift_z,
        total(f3, like) + c.asymmetry[3] * forward,
        total(f4, like) + c.asymmetry[4] * forward + (w * d1 - q * d2) + x * lift_z,
        total(f5, like) + c.asymmetry[5] * forward - (v * d1 + r * d2) - x * lift_y,
    )


@compiled
def _row(a: Any, i: int, x: Any) -> Any:
    near = a[6 * i] * x[0] + a[6 * i + 1] * x[1] + a[6 * i + 2] * x[2]
    return near + (a[6 * i + 3] * x[3] + a[6 * i + 4] * x[4] + a[6 * i + 5] * x[5])


@compiled
def _fin_force(a: Any, i: int, d: Any) -> Any:
    near = (a[8 * i] + a[8 * i + 4] * d[0]) * d[0] + (a[8 * i + 1] + a[8 * i + 5] * d[1]) * d[1]
    return near + (
        (a[8 * i + 2] + a[8 * i + 6] * d[2]) * d[2] + (a[8 * i + 3] + a[8 * i + 7] * d[3]) * d[3]
    )


@compiled
def rate(x: Array, inputs: Array, c: Tables, out: Array, room: Array, like: Any) -> None:
    """d/dt of the state x = [eta, nu] (12,), or with the lagged viscous force after it
    (18,), of one vehicle or a register of them.

    `inputs` (12,): propeller [rev/s], u_c(n) [m/s], four fins [rad], any further force
    (6) [N, N m]. `room` (`room_for(c)`,): scratch. All are flat; for a register every
    item is `WIDTH` numbers.
    """
    u, v, w, p, q, r = (
        get(x, 6, like),
        get(x, 7, like),
        get(x, 8, like),
        get(x, 9, like),
        get(x, 10, like),
        get(x, 11, like),
    )
    nu = (u, v, w, p, q, r)
    sf, cf = sine_cosine(get(x, 3, like))
    st, ct = sine_cosine(get(x, 4, like))
    sp, cp = sine_cosine(get(x, 5, like))
    put(out, 0, cp * ct * u + (cp * st * sf - sp * cf) * v + (sp * sf + cp * cf * st) * w)
    put(out, 1, sp * ct * u + (cp * cf + sf * st * sp) * v + (st * sp * cf - cp * sf) * w)
    put(out, 2, ct * sf * v + ct * cf * w - st * u)
    turn = (sf * q + cf * r) / choose(absolute(ct), SINGULAR_COSINE, np.nan, ct)
    put(out, 3, p + turn * st)
    put(out, 4, cf * q - sf * r + 0.0 * turn)
    put(out, 5, turn)
    visc = (like, like, like, like, like, like)
    if c.physical:
        visc = _physical_force(nu, c, like)
    else:
        speed = root(u * u + v * v + w * w)
        visc = _model_force(
            nu, get(inputs, 1, like) / larger(speed, c.minimum_speed) - 1.0, c, room, like
        )
    if c.lag_s > 0.0:
        for i in range(6):
            put(out, 12 + i, (visc[i] - get(x, 12 + i, like)) / c.lag_s)
        visc = (
            get(x, 12, like),
            get(x, 13, like),
            get(x, 14, like),
            get(x, 15, like),
            get(x, 16, like),
            get(x, 17, like),
        )
    a1, a2, a3, b1, b2, b3 = (
        _row(c.mass, 0, nu),
        _row(c.mass, 1, nu),
        _row(c.mass, 2, nu),
        _row(c.mass, 3, nu),
        _row(c.mass, 4, nu),
        _row(c.mass, 5, nu),
    )
    net, gx, gy, gz = c.restoring[0], c.restoring[1], c.restoring[2], c.restoring[3]
    down_y, down_z = ct * sf, ct * cf
    d = (get(inputs, 2, like), get(inputs, 3, like), get(inputs, 4, like), get(inputs, 5, like))
    n, a, uu = get(inputs, 0, like), u * c.propeller[0], u * u
    spin = absolute(n)
    thrust = c.propeller[1] * a * a + c.propeller[2] * a * spin + c.propeller[3] * n * spin
    torque = c.propeller[4] * a * a + c.propeller[5] * a * spin + c.propeller[6] * n * spin
    tau = (
        get(inputs, 6, like)
        + visc[0]
        - (q * a3 - r * a2)
        - net * st
        + uu * _fin_force(c.fins, 0, d)
        + thrust,
        get(inputs, 7, like)
        + visc[1]
        - (r * a1 - p * a3)
        + net * down_y
        + uu * _fin_force(c.fins, 1, d),
        get(inputs, 8, like)
        + visc[2]
        - (p * a2 - q * a1)
        + net * down_z
        + uu * _fin_force(c.fins, 2, d),
        get(inputs, 9, like)
        + visc[3]
        - (v * a3 - w * a2 + q * b3 - r * b2)
        + (gy * down_z - gz * down_y)
        + uu * _fin_force(c.fins, 3, d)
        + torque,
        get(inputs, 10, like)
        + visc[4]
        - (w * a1 - u * a3 + r * b1 - p * b3)
        - (gz * st + gx * down_z)
        + uu * _fin_force(c.fins, 4, d),
        get(inputs, 11, like)
        + visc[5]
        - (u * a2 - v * a1 + p * b2 - q * b1)
        + (gx * down_y + gy * st)
        + uu * _fin_force(c.fins, 5, d),
    )
    for i in range(6):
        put(out, 6 + i, _row(c.inverse, i, tau))


@compiled
def _read(
    knot: int, b: int, n: Array, fins: Array, extra: Array, level: Array, out: Array, width: int
) -> None:
    """The inputs of `width` vehicles from vehicle `b` on at a knot, item by item; lanes
    beyond the last vehicle repeat it.
    """
    for j in range(width):
        i = min(b + j, n.shape[0] - 1)
        out[j], out[width + j] = n[i, knot], level[i, knot]
        for k in range(4):
            out[(2 + k) * width + j] = fins[i, knot, k]
        for k in range(6):
            out[(6 + k) * width + j] = extra[i, knot, k]


@compiled
def _addresses(c: Tables) -> Any:
    return Tables(
        address(c.mass),
        address(c.inverse),
        address(c.restoring),
        address(c.fins),
        address(c.propeller),
        address(c.factors),
        address(c.coefficients),
        address(c.strips),
        address(c.surfaces),
        c.counts,
        c.physical,
        address(c.body),
        address(c.axial),
        address(c.asymmetry),
        c.lag_s,
        c.minimum_speed,
    )


@compiled
def _integrate(
    b: int,
    x0: Array,
    n: Array,
    fins: Array,
    extra: Array,
    level: Array,
    step: float,
    per_knot: int,
    c: Tables,
    out: Array,
    like: Any,
) -> None:
    """Runge-Kutta 4 of the vehicles from `b` on, as many as `like` holds, with inputs
    linear between knots.
    """
    width, size, rows = together(like), x0.shape[1], out.shape[1]
    used = min(width, x0.shape[0] - b)
    x, stage, slope, slopes = (
        np.empty(size * width),
        np.empty(size * width),
        np.empty(size * width),
        np.empty(size * width),
    )
    low, high, now, room = (
        np.empty(12 * width),
        np.empty(12 * width),
        np.empty(12 * width),
        np.empty(room_for(c) * width),
    )
    shown = np.empty(size * width)
    ended = like  # nan once a state was not finite
    for j in range(width):
        for i in range(size):
            x[i * width + j] = stage[i * width + j] = x0[min(b + j, x0.shape[0] - 1), i]
            slopes[i * width + j] = 0.0
    for j in range(used):
        for i in range(size):
            out[b + j, 0, i] = x[i * width + j]
    last = n.shape[1] - 1
    _read(0, b, n, fins, extra, level, high, width)
    for s in range(rows - 1):
        knot, phase = s // per_knot, s % per_knot
        if phase == 0:
            for i in range(12):
                put(low, i, get(high, i, like))
            _read(min(knot + 1, last), b, n, fins, extra, level, high, width)
        for part in range(4):
            at = (phase + (0.0, 0.5, 0.5, 1.0)[part]) / per_knot
            for i in range(12):
                start = get(low, i, like)
                put(now, i, start + at * (get(high, i, like) - start))
            rate(stage, now, c, slope, room, like)
            weight, share = (1.0, 2.0, 2.0, 1.0)[part], (0.5, 0.5, 1.0, 0.0)[part] * step
            for i in range(size):
                found, start = get(slope, i, like), get(x, i, like)
                put(slopes, i, get(slopes, i, like) + weight * found)
                put(stage, i, start + share * found)
        for i in range(size):
            end = get(x, i, like) + step / 6.0 * get(slopes, i, like)
            put(x, i, end)
            put(stage, i, end)
            put(slopes, i, like)
            put(shown, i, end + ended)
        for i in range(size):
            ended = ended + 0.0 * get(x, i, like)
        for j in range(used):
            for i in range(size):
                out[b + j, s + 1, i] = shown[i * width + j]


@compiled
def integrate(
    x0: Array,
    n: Array,
    fins: Array,
    extra: Array,
    level: Array,
    step: float,
    per_knot: int,
    c: Tables,
    out: Array,
    first: int,
    stop: int,
) -> None:
    """Fill `out` (batch, steps + 1, states) for vehicles `first` (a multiple of
    `WIDTH`) to `stop` of a batch, from `x0` (batch, states).

    Inputs at knots: `n` and `level` (batch, k), `fins` (batch, k, 4), `extra` (batch,
    k, 6). Rows after a state that is not finite are nan.
    """
    if x0.shape[0] == 1:
        _integrate(0, x0, n, fins, extra, level, step, per_knot, _addresses(c), out, 0.0)
    else:
        for b in range(first, stop, WIDTH):
            _integrate(
                b, x0, n, fins, extra, level, step, per_knot, _addresses(c), out, spread(0.0)
            )
