"""One window of a leg as a compiled loop: motion, sensitivities and Kalman filter.

The motion comes from `model_force` and `motion_rates` of the compiled simulation, so
that no equation of motion stands here. State: [phi, theta, psi, z, u, v, w, p, q, r] (10), with the
unsteady force [X .. N] (16) where a filter runs. Runge-Kutta 4 between the times of
samples; the transition is the matrix exponential of Jacobians that are differences
of the compiled derivative. Import
this module only where an estimate is made: numba takes a second.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numba
import numba.extending
import numpy as np
from numba.core.compiler_lock import global_compiler_lock

from auvid.hydro import arrays
from auvid.hydro.arrays import Array, Ints, cross_components
from auvid.hydro.dynamics.mechanics import rigid_body
from auvid.hydro.dynamics.simulation import compiled, sensor_models
from auvid.hydro.dynamics.simulation.compiled import (
    FACTOR_COUNT,
    addresses,
    model_force,
    motion_rates,
)
from auvid.hydro.dynamics.simulation.plant_constants import Tables
from auvid.hydro.dynamics.simulation.sensor_models import (
    point_velocity_components,
    specific_force_components,
)
from auvid.hydro.identification.maximum_likelihood.records import SensorGeometry

MOTION, FORCE, MEASURED, BIASES = 10, 6, 13, 6
STEP, WIDE = 1e-6, 1e-4
"""Width of one-sided differences of the state [rad, m/s, rad/s], whose error is some
1e-6 of a derivative; of central ones along the lag [s]."""
TINY = np.float32(1e-28)
"""Where sums of single precision start, since numbers that fade to nothing are slow."""
VISCOUS, INERTIA, LAG = 0, 1, 2
"""Kinds of parameters: a coefficient of a viscous term or constant (axis, column of the
tables), an entry of the mass matrix (row, column), the lag of the actuators."""


_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz"},
}
SENSOR_EQUATIONS: tuple[Callable[..., Any], ...] = (
    cross_components,
    specific_force_components,
    point_velocity_components,
)
_config: Any = numba.config
_extending: Any = numba.extending
for _equation in SENSOR_EQUATIONS:
    _extending.register_jitable(no_cfunc_wrapper=True, **_OPTIONS)(_equation)

F = TypeVar("F", bound=Callable[..., Any])


def _compiled(function: F, *, cache: bool = False) -> F:
    # Nothing is drawn in, unlike in the simulation: the derivative stands here once, not
    # a hundred times. Only what Python calls (it is kept) needs a wrapper for Python.
    inner: dict[str, Any] = {"no_cpython_wrapper": not cache, "no_cfunc_wrapper": True}
    result: F = numba.njit(nogil=True, cache=cache, **inner, **_OPTIONS)(function)
    return result


def _second_level(compiled_loop: Any) -> Any:
    """Have a loop compiled at the second level of optimisation: a third less time.

    The third level makes it no faster. Numba has this level for a process only.
    """
    compile_for: Callable[[Any], Any] = compiled_loop.compile

    def compile_quickly(types: Any) -> Any:
        with global_compiler_lock:
            level, _config.OPT = _config.OPT, min(_config.OPT, 2)
            try:
                return compile_for(types)
            finally:
                _config.OPT = level

    compiled_loop.compile = compile_quickly
    return compiled_loop


@_compiled
def _line(n: int) -> Any:
    # One function for each number of axes: numba compiles `zeros` anew at each call.
    return np.zeros(n)


@_compiled
def _table(n: int, m: int) -> Any:
    return np.zeros((n, m))


@_compiled
def _stack(n: int, m: int, k: int) -> Any:
    return np.zeros((n, m, k))


@_compiled
def _singles(n: int, m: int, k: int) -> Any:
    return np.zeros((n, m, k), np.float32)


class SensorPlaces(NamedTuple):
    """Sensors for the loop: rotations sensor to body, arms [m], gravity [m/s^2]."""

    imu: Array
    imu_arm: Array
    log: Array
    log_arm: Array
    depth_arm: Array
    gravity: float


class Noise(NamedTuple):
    """Variances (13,) of samples; variance (6,) and rate 1/T (6,) of the force."""

    sensor: Array
    force: Array
    decay: Array


@_compiled
def _rates(x: Any, inputs: Any, c: Any, decay: Any, out: Any, work: Any) -> None:
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


@_compiled
def _outputs(x: Any, rate: Any, g: Any, y: Any) -> None:
    """Write what ideal sensors measure (13,) at a state with its rate."""
    nu = (x[4], x[5], x[6], x[7], x[8], x[9])
    nu_dot = (rate[4], rate[5], rate[6], rate[7], rate[8], rate[9])
    sf, cf, st, ct = np.sin(x[0]), np.cos(x[0]), np.sin(x[1]), np.cos(x[1])
    down = (-st, ct * sf, ct * cf)
    arm = (g.imu_arm[0], g.imu_arm[1], g.imu_arm[2])
    force = specific_force_components(nu, nu_dot, arm, down, g.gravity)
    local = point_velocity_components(nu, (g.log_arm[0], g.log_arm[1], g.log_arm[2]))
    for i in range(3):
        y[i] = x[i]
        y[3 + i] = g.imu[0, i] * nu[3] + g.imu[1, i] * nu[4] + g.imu[2, i] * nu[5]
        y[6 + i] = g.imu[0, i] * force[0] + g.imu[1, i] * force[1] + g.imu[2, i] * force[2]
        y[9 + i] = g.log[0, i] * local[0] + g.log[1, i] * local[1] + g.log[2, i] * local[2]
    depth_arm = g.depth_arm
    y[12] = x[3] + down[0] * depth_arm[0] + down[1] * depth_arm[1] + down[2] * depth_arm[2]


@_compiled
def _jacobians(
    x: Any, rate: Any, y: Any, inputs: Any, c: Any, decay: Any, g: Any, A: Any, H: Any,
    kinds: Any, terms: Any, pull: Any, moved: Any, there: Any, y_there: Any, force: Any, work: Any,
) -> None:  # fmt: skip
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
        _rates(moved, inputs, c, decay, there, work)
        _outputs(moved, there, g, y_there)
        for i in range(MOTION):
            A[i, j] = (there[i] - rate[i]) / h
        for i in range(MEASURED):
            H[i, j] = (y_there[i] - y[i]) / h
        for p in range(len(pull)):
            kind, row, column = kinds[p, 0], kinds[p, 1], kinds[p, 2]
            if kind == VISCOUS:
                pull[p, row, j] = (work[3][FACTOR_COUNT + column] - terms[column]) / h
            elif kind == INERTIA:
                _inertia_force(x, rate, row, column, force)
                for i in range(6):
                    pull[p, i, j] = -force[i] / h
                _inertia_force(moved, there, row, column, force)
                for i in range(6):
                    pull[p, i, j] += force[i] / h
        moved[j] = x[j]
    for k in range(n - MOTION):
        for i in range(6):
            A[4 + i, MOTION + k] = c.inverse[6 * i + k]
        H[6, MOTION + k], H[7, MOTION + k], H[8, MOTION + k] = _accelerometer(
            g, _column(c.inverse, k)
        )
        for p in range(len(pull)):
            kind, row, column = kinds[p, 0], kinds[p, 1], kinds[p, 2]
            if kind == INERTIA:
                pull[p, row, MOTION + k] = -c.inverse[6 * column + k]
                pull[p, column, MOTION + k] = -c.inverse[6 * row + k]


@_compiled
def _inertia_force(x: Any, rate: Any, row: int, column: int, force: Any) -> None:
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


@_compiled
def _accelerometer(g: Any, a: Any) -> Any:
    """Return what an accelerometer (3,) makes of an acceleration (6,) alone."""
    arm = (g.imu_arm[0], g.imu_arm[1], g.imu_arm[2])
    inner = cross_components((a[3], a[4], a[5]), arm)
    x, y, z = a[0] + inner[0], a[1] + inner[1], a[2] + inner[2]
    return (
        g.imu[0, 0] * x + g.imu[1, 0] * y + g.imu[2, 0] * z,
        g.imu[0, 1] * x + g.imu[1, 1] * y + g.imu[2, 1] * z,
        g.imu[0, 2] * x + g.imu[1, 2] * y + g.imu[2, 2] * z,
    )


@_compiled
def _column(inverse: Any, k: int) -> Any:
    """Return column k of M^-1: the acceleration (6,) by a force on axis k."""
    return (
        inverse[k], inverse[6 + k], inverse[12 + k],
        inverse[18 + k], inverse[24 + k], inverse[30 + k],
    )  # fmt: skip


@_compiled
def _parameter_accelerations(
    x: Any, rate: Any, inputs: Any, along: Any, c: Any, decay: Any, kinds: Any, a: Any, force: Any,
    work: Any, pair: Any,
) -> None:  # fmt: skip
    """Write the acceleration (6,) that each parameter adds per unit, a (6, parameters).

    Called after `_rates` at the same state: its factors hold the terms.
    """
    factors = work[3]
    up, down, acting = pair
    for p in range(len(kinds)):
        kind, row, column = kinds[p, 0], kinds[p, 1], kinds[p, 2]
        if kind == VISCOUS:
            for i in range(6):
                a[i, p] = c.inverse[6 * i + row] * factors[FACTOR_COUNT + column]
        elif kind == INERTIA:
            _inertia_force(x, rate, row, column, force)
            for i in range(6):
                a[i, p] = 0.0
                for k in range(6):
                    a[i, p] += c.inverse[6 * i + k] * force[k]
    for p in range(len(kinds)):
        if kinds[p, 0] == LAG:
            # d(acceleration)/d(inputs) . d(inputs)/d(lag); overwrites the factors.
            for i in range(12):
                acting[i] = inputs[i] + WIDE * along[i]
            _rates(x, acting, c, decay, up, work)
            for i in range(12):
                acting[i] = inputs[i] - WIDE * along[i]
            _rates(x, acting, c, decay, down, work)
            for i in range(6):
                a[i, p] = (up[4 + i] - down[4 + i]) / (2.0 * WIDE)


@_compiled
def _move(
    x: Any, h: float, inputs: Any, c: Any, decay: Any, stage: Any, total: Any, slope: Any, work: Any
) -> None:
    """Carry x over a step by Runge-Kutta 4; `slope` is its rate at first."""
    for i in range(len(x)):
        total[i] = slope[i]
    for part in range(1, 4):
        reach = h if part == 3 else 0.5 * h
        for i in range(len(x)):
            stage[i] = x[i] + reach * slope[i]
        _rates(stage, inputs[(part + 1) // 2], c, decay, slope, work)
        weight = 1.0 if part == 3 else 2.0
        for i in range(len(x)):
            total[i] += weight * slope[i]
    for i in range(len(x)):
        x[i] += h / 6.0 * total[i]


@_compiled
def _times(left: Any, right: Any, out: Any) -> None:
    """Write left . right into the first rows of `out`, zeros left out."""
    for i in range(len(left)):
        for j in range(right.shape[1]):
            out[i, j] = 0.0
        for k in range(len(right)):
            a = left[i, k]
            if a != 0.0:
                for j in range(right.shape[1]):
                    out[i, j] += a * right[k, j]


@_compiled
def _transition(
    A0: Any, A1: Any, h: float, decay: Any, Phi: Any, fade: Any, push: Any, mean: Any, power: Any,
    product: Any,
) -> None:  # fmt: skip
    """Write Phi = exp(A h) to fourth order, A the mean over the step, and `push`.

    push (2, 10, 6): what accelerations at both ends of the step, linear between, do to
    the motion: h (phi1 - phi2) and h phi2 of A h, phi1 = sum z^k / (k + 1)!, phi2 = sum
    z^k / (k + 2)! (Higham 2008, 10.7.4). For a linear motion it is the map of
    Runge-Kutta 4 itself. The force fades by `fade` and does not depend on the motion.
    """
    n = Phi.shape[1]
    for i in range(MOTION):
        for j in range(n):
            mean[i, j] = 0.5 * h * (A0[i, j] + A1[i, j])
            power[i, j] = Phi[i, j] = 0.0
        power[i, i] = Phi[i, i] = 1.0
        for k in range(6):
            push[0, i, k] = push[1, i, k] = 0.0
        if i >= 4:
            push[0, i, i - 4] = push[1, i, i - 4] = 0.5 * h
    for k in range(n - MOTION):
        z = decay[k] * h
        fade[MOTION + k] = 1.0 - z * (1.0 - z / 2.0 * (1.0 - z / 3.0 * (1.0 - z / 4.0)))
    factorial = 1.0
    for order in range(1, 5):
        # power = mean^order of the whole matrix, whose lower rows are -decay h.
        _times(mean, power, product)
        factorial *= order
        for k in range(n - MOTION):
            z = 1.0
            for _ in range(1, order):
                z *= -decay[k] * h
            for i in range(MOTION):
                product[i, MOTION + k] += mean[i, MOTION + k] * z
        for i in range(MOTION):
            for j in range(n):
                power[i, j] = product[i, j]
                Phi[i, j] += power[i, j] / factorial
            if order < 4:
                late = h / (factorial * (order + 1.0) * (order + 2.0))
                for k in range(6):
                    push[1, i, k] += late * power[i, 4 + k]
                    push[0, i, k] += late * (order + 1.0) * power[i, 4 + k]


@_compiled
def _carry_covariance(
    P: Any, Phi: Any, fade: Any, h: float, variance: Any, inverse: Any, T: Any
) -> None:
    """Replace P by Phi P Phi' + Q of the force that is new within the step.

    Phi P stays in T.
    """
    n = len(P)
    _times(Phi, P, T)
    for i in range(MOTION, n):
        for j in range(n):
            T[i, j] = fade[i] * P[i, j]
    for i in range(n):
        for j in range(i + 1):
            if j < MOTION:
                total = 0.0
                for k in range(n):
                    total += T[i, k] * Phi[j, k]
            else:
                total = T[i, j] * fade[j]
            P[i, j] = P[j, i] = total
    # The force is linear between the ends of the step: half of what is new acts in it.
    for k in range(n - MOTION):
        q = variance[k] * (1.0 - fade[MOTION + k] * fade[MOTION + k])
        for i in range(6):
            a = 0.5 * h * inverse[6 * i + k]
            P[4 + i, MOTION + k] += a * q
            P[MOTION + k, 4 + i] += a * q
            for j in range(6):
                P[4 + i, 4 + j] += a * q * 0.5 * h * inverse[6 * j + k]
        P[MOTION + k, MOTION + k] += q


@_compiled
def _carry_sensitivities(S: Any, Phi: Any, fade: Any, push: Any, a0: Any, a1: Any, T: Any) -> None:
    """Replace S (n, m) by Phi S and what the parameters' accelerations add."""
    n, m = S.shape
    parameters = a0.shape[1]
    _times(Phi, S, T)
    for i in range(MOTION):
        for k in range(6):
            early, late = push[0, i, k], push[1, i, k]
            for p in range(parameters):
                T[i, p] += early * a0[k, p] + late * a1[k, p]
    for i in range(n):
        for j in range(m):
            S[i, j] = T[i, j] if i < MOTION else fade[i] * S[i, j]


@_compiled
def _gathered(row: Any, D: Any, j: int, out: Any) -> None:
    """Write row . D[:, j, :] (q,) of a symmetric D, stored as its lower half."""
    for d in range(len(out)):
        out[d] = TINY
    for k in range(0, len(row), 4):
        e0, e1 = np.float32(row[k]), np.float32(row[k + 1])
        e2, e3 = np.float32(row[k + 2]), np.float32(row[k + 3])
        if e0 == 0.0 and e1 == 0.0 and e2 == 0.0 and e3 == 0.0:
            continue
        d0 = D[k, j] if k > j else D[j, k]
        d1 = D[k + 1, j] if k + 1 > j else D[j, k + 1]
        d2 = D[k + 2, j] if k + 2 > j else D[j, k + 2]
        d3 = D[k + 3, j] if k + 3 > j else D[j, k + 3]
        for d in range(len(out)):
            out[d] += e0 * d0[d] + e1 * d1[d] + e2 * d2[d] + e3 * d3[d]


@_compiled
def _carry_tangents(
    D: Any, Phi: Any, fade: Any, push: Any, product: Any, h: float, noise: Any, inverse: Any,
    kinds: Any, places: Any, pull0: Any, pull1: Any, T: Any, b: Any, w: Any, mean: Any,
) -> None:  # fmt: skip
    """Replace the derivatives D (n, n, q) of P by those after a step; lower half.

    D <- Phi D Phi' + B w' + w B' + dQ with dPhi = B m', w = Phi P m: every parameter adds
    to A a product of a force on one axis and the gradient of a term, every time constant
    one entry. B = int exp(A s) ds b and m = (1 + Phi') gradient / 2 are good to second
    order. `product`: Phi P.
    """
    n, q, size = MOTION + FORCE, D.shape[2], len(kinds)
    times, forces = places[1], places[2]
    # Phi D, its upper rows; below them the force only fades.
    for i in range(MOTION):
        for j in range(n):
            _gathered(Phi[i], D, j, T[i, j])
    for i in range(n):
        for j in range(i + 1):
            if i < MOTION:
                for d in range(q):
                    D[i, j, d] = TINY
                for k in range(0, n, 4):
                    e0, e1 = np.float32(Phi[j, k]), np.float32(Phi[j, k + 1])
                    e2, e3 = np.float32(Phi[j, k + 2]), np.float32(Phi[j, k + 3])
                    for d in range(q):
                        D[i, j, d] += (
                            e0 * T[i, k, d] + e1 * T[i, k + 1, d]
                            + e2 * T[i, k + 2, d] + e3 * T[i, k + 3, d]
                        )  # fmt: skip
            elif j < MOTION:
                single = np.float32(fade[i])
                for d in range(q):
                    D[i, j, d] = single * T[j, i, d]
            else:
                single = np.float32(fade[i] * fade[j])
                for d in range(q):
                    D[i, j, d] = single * D[i, j, d] + TINY
    # What the parameters change of Phi, axis by axis of their force.
    for p in range(size):
        for row in range(6):
            if kinds[p, 0] == LAG or (kinds[p, 0] == VISCOUS and row != kinds[p, 1]):
                continue
            for i in range(MOTION):
                b[i] = 0.0
                for k in range(6):
                    b[i] += (push[0, i, k] + push[1, i, k]) * inverse[6 * k + row]
            for j in range(n):
                mean[j] = 0.5 * pull0[p, row, j]
                if j >= MOTION:
                    mean[j] += 0.5 * fade[j] * pull1[p, row, j]
            for k in range(MOTION):
                a = 0.5 * pull1[p, row, k]
                if a != 0.0:
                    for j in range(n):
                        mean[j] += a * Phi[k, j]
            for i in range(n):
                w[i] = 0.0
                for j in range(n):
                    w[i] += product[i, j] * mean[j]
            for i in range(MOTION, n):
                b[i] = 0.0
            _add_pair(D, p, b, w)
    # What the time constants change of Phi and, with the sizes, of the news of a step.
    for k in range(n - MOTION):
        f = MOTION + k
        z = noise.decay[k] * h
        for i in range(MOTION):
            b[i] = 0.5 * z * Phi[i, f]
        for i in range(MOTION, n):
            b[i] = 0.0
        b[f] = z * fade[f]
        for i in range(n):
            w[i] = product[i, f]
        if q > size:
            _add_pair(D, times + k, b, w)
        new = noise.force[k] * (1.0 - fade[f] * fade[f])
        if q > size:
            _add_news(D, times + k, k, h, -2.0 * noise.force[k] * fade[f] * fade[f] * z, inverse)
            _add_news(D, forces + k, k, h, 2.0 * new, inverse)
        for p in range(size):
            if kinds[p, 0] == INERTIA:
                # The news act through M^-1, whose derivative is -M^-1 E M^-1.
                row, column = kinds[p, 1], kinds[p, 2]
                for i in range(6):
                    b[4 + i] = -inverse[6 * i + row] * inverse[6 * column + k]
                    if row != column:
                        b[4 + i] -= inverse[6 * i + column] * inverse[6 * row + k]
                    b[4 + i] *= 0.5 * h
                    w[4 + i] = 0.5 * h * inverse[6 * i + k] * new
                for i in range(4):
                    b[i] = w[i] = 0.0
                for i in range(MOTION, n):
                    b[i] = w[i] = 0.0
                w[f] = new
                _add_pair(D, p, b, w)


@_compiled
def _add_pair(D: Any, d: int, b: Any, w: Any) -> None:
    """Add b w' + w b' to one derivative, lower half."""
    for i in range(len(b)):
        for j in range(i + 1):
            D[i, j, d] += b[i] * w[j] + w[i] * b[j]


@_compiled
def _add_news(D: Any, d: int, k: int, h: float, variance: float, inverse: Any) -> None:
    """Add what news of the k-th force of a variance add to P, lower half."""
    f = MOTION + k
    for i in range(6):
        a = 0.5 * h * inverse[6 * i + k] * variance
        D[f, 4 + i, d] += a
        for j in range(i + 1):
            D[4 + i, 4 + j, d] += a * 0.5 * h * inverse[6 * j + k]
    D[f, f, d] += variance


@_compiled
def _sample_tangents(
    D: Any, P: Any, h_row: Any, gain: Any, variance: float, own: float, place: int, kinds: Any,
    lever: Any, pull: Any, dg: Any,
) -> None:  # fmt: skip
    """Update D by one scalar sample; write `dg` (n + 1, q), the last row d(variance).

    dg = variance d(gain / variance). `own`, `place`: variance of the sample and its place
    among directions, -1 for none.
    `lever` (parameters, 6), where it has rows: what a unit of force on an axis adds to the
    sample, so that parameters turn h by lever . pull.
    """
    n, q = MOTION + FORCE, dg.shape[1]
    ds = dg[n]
    for i in range(n):
        _gathered(h_row, D, i, dg[i])
    for d in range(q):
        ds[d] = 0.0
    for p in range(len(kinds) if len(lever) > 0 else 0):
        for row in range(6):
            if kinds[p, 0] == LAG or (kinds[p, 0] == VISCOUS and row != kinds[p, 1]):
                continue
            for j in range(n):
                a = lever[row] * pull[p, row, j]
                if a != 0.0:
                    ds[p] += a * gain[j]
                    for i in range(n):
                        dg[i, p] += a * P[i, j]
    for i in range(n):
        if h_row[i] != 0.0:
            single = np.float32(h_row[i])
            for d in range(q):
                ds[d] += single * dg[i, d]
    if place >= 0:
        ds[place] += 2.0 * own
    # P - g g' / s and its derivative, with dg - K ds / 2 in the place of dg.
    for i in range(n):
        single = np.float32(0.5 * gain[i] / variance)
        for d in range(q):
            dg[i, d] -= single * ds[d]
    for i in range(n):
        first = np.float32(gain[i] / variance)
        for j in range(i + 1):
            second = np.float32(gain[j] / variance)
            for d in range(q):
                D[i, j, d] -= second * dg[i, d] + first * dg[j, d]
    for i in range(n):
        single = np.float32(0.5 * gain[i] / variance)
        for d in range(q):
            dg[i, d] -= single * ds[d]


@_compiled
def _turn(lever: Any, pull: Any, shift: Any, out: Any) -> None:
    """Add the parameters' change of an accelerometer's slopes times a state shift."""
    for p in range(len(pull)):
        for row in range(6):
            for j in range(len(shift)):
                out[p] += lever[row] * pull[p, row, j] * shift[j]


@_compiled
def _times_rows(row: Any, matrix: Any, out: Any) -> None:
    """Write row . matrix, zeros of the row left out."""
    for j in range(len(out)):
        out[j] = 0.0
    for i in range(len(row)):
        part = row[i]
        if part != 0.0:
            for j in range(len(out)):
                out[j] += part * matrix[i, j]


def _loop(sources: int) -> Any:
    """Return the compiled window; numba keys what it keeps by `sources`."""

    def run(
        x0: Array,
        P0: Array,
        steps: Array,
        inputs: Array,
        along: Array,
        measured: Array,
        bias: Array,
        kinds: Ints,
        free_start: bool,
        filtering: bool,
        channel_places: Ints,
        tables: Tables,
        g: SensorPlaces,
        noise: Noise,
        states: Array,
        errors: Array,
        variances: Array,
        jacobian: Array,
        variance_slopes: Array,
    ) -> int:
        """Run a window; return the number of its scalar samples, or -1 if it diverges.

        `steps` (N,) [s] lie between the N + 1 rows of `measured` (13 channels, nan where
        a channel has no sample). `inputs` and `along`, their derivative by the lag (2N +
        1, 12), at both ends and the middle of each step. `bias` (6,): accelerometer,
        gyro. Written: `states` (N + 1, n) after the samples, and sample by sample
        `errors` (measured minus predicted), their `variances` and `jacobian`
        (d(predicted) by parameters, biases, start or noise); a jacobian without rows is
        not made. `variance_slopes` (samples, q): d(variances) by parameters and noise;
        where it has no rows, gains count as constants in the jacobian. The noise, where
        q is more than the parameters: channels at their `channel_places`, -1 for those
        without, six time constants, six sizes of the force.
        """
        assert sources >= 0
        c = addresses(tables)
        decay, inverse = noise.decay, tables.inverse
        n, m, parameters = len(x0), jacobian.shape[1], len(kinds)
        sensitive, tangent = jacobian.shape[0] > 0, variance_slopes.shape[0] > 0
        # Not as literals, for each of which numba compiles a function anew.
        axes: Any = np.int64(6)
        motion: Any = np.int64(MOTION)
        channels: Any = np.int64(MEASURED)
        x, P, S = _line(n), _table(n, n), _table(n, m)
        for i in range(n):
            x[i] = x0[i]
            for j in range(n):
                P[i, j] = P0[i, j]
        if free_start:
            for i in range(MOTION):
                S[i, m - MOTION + i] = 1.0
        slope, y, H = _line(n), _line(channels), _table(channels, n)
        H[2, 2] = H[12, 3] = 1.0
        A0, A1, Phi, fade = _table(motion, n), _table(motion, n), _table(motion, n), _line(n)
        for i in range(n):
            fade[i] = 1.0
        a0, a1, direct = (
            _table(axes, parameters),
            _table(axes, parameters),
            _table(axes, parameters),
        )
        push, half = _stack(axes, motion, axes), _stack(axes, motion, n)
        terms = _line(tables.counts[0])
        work = (
            _line(2 * axes), _line(2 * axes), _line(2 * axes),
            _line(FACTOR_COUNT + tables.counts[0]),
        )  # fmt: skip
        pair = (_line(n), _line(n), _line(2 * axes))
        stage, total, there, y_there, force = (
            _line(n), _line(n), _line(n), _line(channels), _line(axes),
        )  # fmt: skip
        spare, square = _table(n, m), _table(n, n)
        before, gain, slope_y = _line(n), _line(n), _line(m)
        # Derivatives D of P by the q directions of parameters and noise; gradients need no
        # more than single precision. The last row of `by_gain` is for a variance.
        q = variance_slopes.shape[1] if tangent else 0
        places = (channel_places, q - 12, q - 6)
        D, upper, by_gain = _singles(n, n, q), _singles(motion, n, q), _singles(axes, n + 1, q)[0]
        pulls = parameters if tangent else 0
        pull0, pull1 = _stack(pulls, axes, n), _stack(pulls, axes, n)
        levers, no_lever = _table(axes, axes), _line(0 * axes)
        if tangent:
            for k in range(6):
                if q > parameters:
                    D[MOTION + k, MOTION + k, places[2] + k] = 2.0 * P0[MOTION + k, MOTION + k]
                levers[0, k], levers[1, k], levers[2, k] = _accelerometer(g, _column(c.inverse, k))
        count = 0
        for step in range(len(steps) + 1):
            # Rates, outputs and their derivatives at the predicted state.
            now = inputs[2 * step]
            _rates(x, now, c, decay, slope, work)
            _outputs(x, slope, g, y)
            if sensitive:
                for i in range(len(terms)):
                    terms[i] = work[3][FACTOR_COUNT + i]
                _parameter_accelerations(
                    x, slope, now, along[2 * step], c, decay, kinds, a1, force, work, pair
                )
                for p in range(parameters):
                    direct[0, p], direct[1, p], direct[2, p] = _accelerometer(
                        g, (a1[0, p], a1[1, p], a1[2, p], a1[3, p], a1[4, p], a1[5, p])
                    )
            if sensitive or filtering:
                _jacobians(
                    x, slope, y, now, c, decay, g, A1, H, kinds, terms, pull1, stage, there,
                    y_there, force, work,
                )  # fmt: skip
                if step > 0:
                    h = steps[step - 1]
                    _transition(A0, A1, h, decay, Phi, fade, push, half[0], half[1], half[2])
                    if sensitive:
                        _carry_sensitivities(S, Phi, fade, push, a0, a1, spare)
                    if filtering:
                        _carry_covariance(P, Phi, fade, h, noise.force, inverse, square)
                    if tangent:
                        # The force itself fades more slowly.
                        for k in range(6 if q > parameters else 0):
                            f, j = MOTION + k, places[1] + k + BIASES
                            S[f, j] += decay[k] * h * x[f]
                            for i in range(MOTION):
                                S[i, j] += 0.5 * decay[k] * h * Phi[i, f] * x[f] / fade[f]
                        _carry_tangents(
                            D, Phi, fade, push, square, h, noise, inverse, kinds, places, pull0,
                            pull1, upper, before, gain, total,
                        )  # fmt: skip
                A0, A1, a0, a1, pull0, pull1 = A1, A0, a1, a0, pull1, pull0
            # Samples of this moment, one after the other.
            for i in range(n):
                before[i] = x[i]
            moved = False
            for channel in range(MEASURED):
                value = measured[step, channel]
                if np.isnan(value):
                    continue
                predicted = y[channel]
                for i in range(n):
                    predicted += H[channel, i] * (x[i] - before[i])
                if 6 <= channel < 9:
                    predicted += bias[channel - 6]
                elif 3 <= channel < 6:
                    predicted += bias[channel]
                error = value - predicted
                if channel < 3:
                    error -= 2.0 * np.pi * np.floor(error / (2.0 * np.pi) + 0.5)
                variance, h_row = noise.sensor[channel], H[channel]
                if sensitive:
                    _times_rows(h_row, S, slope_y)
                    if 6 <= channel < 9:
                        for p in range(parameters):
                            slope_y[p] += direct[channel - 6, p]
                        slope_y[parameters + channel - 6] += 1.0
                        if tangent:
                            for i in range(n):
                                stage[i] = x[i] - before[i]
                            _turn(levers[channel - 6], pull0, stage, slope_y)
                    elif 3 <= channel < 6:
                        slope_y[parameters + channel] += 1.0
                    for j in range(m):
                        jacobian[count, j] = slope_y[j]
                if filtering:
                    _times_rows(h_row, P, gain)
                    for i in range(n):
                        variance += h_row[i] * gain[i]
                    if tangent:
                        _sample_tangents(
                            D, P, h_row, gain, variance, noise.sensor[channel],
                            channel_places[channel], kinds,
                            levers[channel - 6] if 6 <= channel < 9 else no_lever, pull0, by_gain,
                        )  # fmt: skip
                        for d in range(q):
                            variance_slopes[count, d] = by_gain[n, d]
                    for i in range(n):
                        part = gain[i] / variance
                        x[i] += part * error
                        for k in range(n):
                            P[i, k] -= part * gain[k]
                        if sensitive:
                            for j in range(m):
                                S[i, j] -= part * slope_y[j]
                        # A direction changes the gain, too.
                        for d in range(q):
                            j = d if d < parameters else d + BIASES
                            S[i, j] += by_gain[i, d] / variance * error
                    moved = True
                errors[count], variances[count] = error, variance
                count += 1
            finite = 0.0
            for i in range(n):
                states[step, i] = x[i]
                finite += x[i]
            if not np.isfinite(finite):
                return -1
            if step < len(steps):
                if moved:
                    _rates(x, now, c, decay, slope, work)
                    if sensitive:
                        _parameter_accelerations(
                            x, slope, now, along[2 * step], c, decay, kinds, a0, force, work, pair
                        )
                _move(
                    x, steps[step], inputs[2 * step : 2 * step + 3], c, decay, stage, total, slope,
                    work,
                )  # fmt: skip
        return count

    return _second_level(_compiled(run, cache=True))


_SOURCE = "".join(
    [
        *map(inspect.getsource, (sys.modules[__name__], arrays, sensor_models)),
        *compiled.SOURCES,
    ]
)
run_window: Any = _loop(int(hashlib.sha256(_SOURCE.encode()).hexdigest()[:15], 16))


def sensor_places(places: SensorGeometry) -> SensorPlaces:
    """Return the installation of sensors for the loop.

    As copies: numba would compile once more for arrays that are read-only.
    """
    return SensorPlaces(
        np.array(places.imu.rotation, dtype=np.float64, order="C"),
        np.array(places.imu.arm_m, dtype=np.float64),
        np.array(places.velocity.rotation, dtype=np.float64, order="C"),
        np.array(places.velocity.arm_m, dtype=np.float64),
        np.array(places.depth.arm_m, dtype=np.float64),
        float(places.gravity),
    )
