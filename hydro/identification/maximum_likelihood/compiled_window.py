"""One window of a leg as a compiled loop: motion, sensitivities and Kalman filter.

The motion comes from `derivative` of the compiled simulation, so that no equation of
motion stands here. State: [phi, theta, psi, z, u, v, w, p, q, r] (10), with the
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
import numpy as np

from auvid.hydro.arrays import Array, Ints
from auvid.hydro.dynamics.mechanics import rigid_body
from auvid.hydro.dynamics.simulation import compiled
from auvid.hydro.dynamics.simulation.compiled import FACTOR_COUNT, addresses, derivative
from auvid.hydro.dynamics.simulation.plant_constants import Tables
from auvid.hydro.identification.maximum_likelihood.records import SensorGeometry

MOTION, FORCE, MEASURED = 10, 6, 13
STEP, WIDE = 1e-6, 1e-4
"""Width of one-sided differences of the state [rad, m/s, rad/s], whose error is some
1e-6 of a derivative; of central ones along the lag [s]."""
VISCOUS, INERTIA, LAG = 0, 1, 2
"""Kinds of parameters: a coefficient of a viscous term or constant (axis, column of the
tables), an entry of the mass matrix (row, column), the lag of the actuators."""


F = TypeVar("F", bound=Callable[..., Any])


def _compiled(function: F, *, cache: bool = False) -> F:
    # Nothing is drawn in, unlike in the simulation: the derivative stands here once, not
    # a hundred times.
    options: dict[str, Any] = {
        "error_model": "numpy",
        "fastmath": {"contract", "reassoc", "nsz"},
    }
    result: F = numba.njit(nogil=True, cache=cache, **options)(function)
    return result


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
    derivative(pose, acting, c, slope, factors)
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
    u, v, w, p, q, r = x[4], x[5], x[6], x[7], x[8], x[9]
    sf, cf, st, ct = np.sin(x[0]), np.cos(x[0]), np.sin(x[1]), np.cos(x[1])
    down = (-st, ct * sf, ct * cf)
    omega, omega_dot = (p, q, r), (rate[7], rate[8], rate[9])
    arm = (g.imu_arm[0], g.imu_arm[1], g.imu_arm[2])
    spin = _cross(omega, arm)
    inner, outer = _cross(omega_dot, arm), _cross(omega, spin)
    turn = _cross(omega, (u, v, w))
    place = (g.log_arm[0], g.log_arm[1], g.log_arm[2])
    swing = _cross(omega, place)
    force = (
        rate[4] + turn[0] + inner[0] + outer[0] - g.gravity * down[0],
        rate[5] + turn[1] + inner[1] + outer[1] - g.gravity * down[1],
        rate[6] + turn[2] + inner[2] + outer[2] - g.gravity * down[2],
    )
    local = (u + swing[0], v + swing[1], w + swing[2])
    for i in range(3):
        y[i] = x[i]
        y[3 + i] = g.imu[0, i] * p + g.imu[1, i] * q + g.imu[2, i] * r
        y[6 + i] = g.imu[0, i] * force[0] + g.imu[1, i] * force[1] + g.imu[2, i] * force[2]
        y[9 + i] = g.log[0, i] * local[0] + g.log[1, i] * local[1] + g.log[2, i] * local[2]
    depth_arm = g.depth_arm
    y[12] = x[3] + down[0] * depth_arm[0] + down[1] * depth_arm[1] + down[2] * depth_arm[2]


@_compiled
def _cross(a: Any, b: Any) -> Any:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@_compiled
def _jacobians(
    x: Any, rate: Any, y: Any, inputs: Any, c: Any, decay: Any, g: Any, A: Any, H: Any, moved: Any,
    there: Any, y_there: Any, work: Any,
) -> None:  # fmt: skip
    """Write d(rate)/dx of the motion (10, n) and d(outputs)/dx (13, n).

    `rate` and `y`: rate and outputs at x. The columns of the force are M^-1.
    """
    n = len(x)
    for i in range(n):
        moved[i] = x[i]
    for j in range(MOTION):
        if j == 2 or j == 3:  # heading and depth act on nothing but themselves
            continue
        moved[j] = x[j] + STEP
        _rates(moved, inputs, c, decay, there, work)
        _outputs(moved, there, g, y_there)
        moved[j] = x[j]
        for i in range(MOTION):
            A[i, j] = (there[i] - rate[i]) / STEP
        for i in range(MEASURED):
            H[i, j] = (y_there[i] - y[i]) / STEP
    for k in range(n - MOTION):
        for i in range(6):
            A[4 + i, MOTION + k] = c.inverse[6 * i + k]
        _accelerometer(g, A[4:, MOTION + k], H[6:, MOTION + k])


@_compiled
def _accelerometer(g: Any, a: Any, y: Any) -> None:
    """Write what an accelerometer (3,) makes of an acceleration (6,) alone."""
    arm = (g.imu_arm[0], g.imu_arm[1], g.imu_arm[2])
    inner = _cross((a[3], a[4], a[5]), arm)
    b = (a[0] + inner[0], a[1] + inner[1], a[2] + inner[2])
    for i in range(3):
        y[i] = g.imu[0, i] * b[0] + g.imu[1, i] * b[1] + g.imu[2, i] * b[2]


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
            # -(E nu_dot + C_E(nu) nu), E with 1 at the entry and its mirror.
            for i in range(6):
                force[i] = down[i] = 0.0
            force[row], down[row] = -rate[4 + column], x[4 + column]
            force[column], down[column] = -rate[4 + row], x[4 + row]
            turning = rigid_body.coriolis_components(
                (x[4], x[5], x[6], x[7], x[8], x[9]),
                (down[0], down[1], down[2], down[3], down[4], down[5]),
            )
            for i in range(6):
                force[i] -= turning[i]
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
        fade[MOTION + k] = 1.0 - z + z * z / 2.0 - z**3 / 6.0 + z**4 / 24.0
    factorial = 1.0
    for order in range(1, 5):
        # power = mean^order of the whole matrix, whose lower rows are -decay h.
        for i in range(MOTION):
            for j in range(n):
                product[i, j] = 0.0
            for k in range(MOTION):
                a = mean[i, k]
                if a != 0.0:
                    for j in range(n):
                        product[i, j] += a * power[k, j]
        factorial *= order
        for k in range(n - MOTION):
            z = (-decay[k] * h) ** (order - 1)
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
    """Replace P by Phi P Phi' + Q of the force that is new within the step."""
    n = len(P)
    for i in range(n):
        for j in range(n):
            T[i, j] = 0.0
        if i < MOTION:
            for k in range(n):
                a = Phi[i, k]
                if a != 0.0:
                    for j in range(n):
                        T[i, j] += a * P[k, j]
        else:
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
        q = variance[k] * (1.0 - fade[MOTION + k] ** 2)
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
    for i in range(n):
        for j in range(m):
            T[i, j] = 0.0
    for i in range(MOTION):
        for k in range(n):
            a = Phi[i, k]
            if a != 0.0:
                for j in range(m):
                    T[i, j] += a * S[k, j]
        for k in range(6):
            early, late = push[0, i, k], push[1, i, k]
            for p in range(parameters):
                T[i, p] += early * a0[k, p] + late * a1[k, p]
    for i in range(n):
        for j in range(m):
            S[i, j] = T[i, j] if i < MOTION else fade[i] * S[i, j]


def _loop(sources: str) -> Any:
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
        tables: Tables,
        g: SensorPlaces,
        noise: Noise,
        states: Array,
        errors: Array,
        variances: Array,
        jacobian: Array,
    ) -> int:
        """Run a window; return the number of its scalar samples, or -1 if it diverges.

        `steps` (N,) [s] lie between the N + 1 rows of `measured` (13 channels, nan where
        a channel has no sample). `inputs` and `along`, their derivative by the lag (2N +
        1, 12), at both ends and the middle of each step. `bias` (6,): accelerometer,
        gyro. Written: `states` (N + 1, n) after the samples, and sample by sample
        `errors` (measured minus predicted), their `variances` and `jacobian`
        (d(predicted) by parameters, biases, start); a jacobian without rows is not made.
        """
        assert len(sources) > 0
        c = addresses(tables)
        decay, inverse = noise.decay, tables.inverse
        n, m, parameters = len(x0), jacobian.shape[1], len(kinds)
        sensitive = jacobian.shape[0] > 0
        x, P, S = x0.copy(), P0.copy(), np.zeros((n, m))
        if free_start:
            for i in range(MOTION):
                S[i, m - MOTION + i] = 1.0
        slope, y, H = np.zeros(n), np.zeros(13), np.zeros((MEASURED, n))
        H[2, 2] = H[12, 3] = 1.0
        A0, A1, Phi, fade = (
            np.zeros((MOTION, n)), np.zeros((MOTION, n)), np.zeros((MOTION, n)), np.ones(n),
        )  # fmt: skip
        a0, a1 = np.zeros((6, parameters)), np.zeros((6, parameters))
        push, direct = np.zeros((2, MOTION, 6)), np.zeros((parameters, 3))
        work = (np.zeros(12), np.zeros(12), np.zeros(12), np.zeros(FACTOR_COUNT + tables.counts[0]))
        pair = (np.empty(n), np.empty(n), np.empty(12))
        stage, total, there, y_there, force = (
            np.empty(n), np.empty(n), np.empty(n), np.empty(13), np.empty(6),
        )  # fmt: skip
        spare, square, half = np.empty((n, m)), np.empty((n, n)), np.empty((3, MOTION, n))
        before, gain, slope_y = np.empty(n), np.empty(n), np.empty(m)
        count = 0
        for step in range(len(steps) + 1):
            # Rates, outputs and their derivatives at the predicted state.
            now = inputs[2 * step]
            _rates(x, now, c, decay, slope, work)
            _outputs(x, slope, g, y)
            if sensitive:
                _parameter_accelerations(
                    x, slope, now, along[2 * step], c, decay, kinds, a1, force, work, pair
                )
                for p in range(parameters):
                    _accelerometer(g, a1[:, p], direct[p])
            if sensitive or filtering:
                _jacobians(x, slope, y, now, c, decay, g, A1, H, stage, there, y_there, work)
                if step > 0:
                    h = steps[step - 1]
                    _transition(A0, A1, h, decay, Phi, fade, push, half[0], half[1], half[2])
                    if sensitive:
                        _carry_sensitivities(S, Phi, fade, push, a0, a1, spare)
                    if filtering:
                        _carry_covariance(P, Phi, fade, h, noise.force, inverse, square)
                A0, A1, a0, a1 = A1, A0, a1, a0
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
                    error -= 2.0 * np.pi * np.round(error / (2.0 * np.pi))
                variance = noise.sensor[channel]
                if sensitive:
                    for j in range(m):
                        slope_y[j] = 0.0
                    for i in range(n):
                        part = H[channel, i]
                        if part != 0.0:
                            for j in range(m):
                                slope_y[j] += part * S[i, j]
                    if 6 <= channel < 9:
                        for p in range(parameters):
                            slope_y[p] += direct[p, channel - 6]
                        slope_y[parameters + channel - 6] += 1.0
                    elif 3 <= channel < 6:
                        slope_y[parameters + channel] += 1.0
                    for j in range(m):
                        jacobian[count, j] = slope_y[j]
                if filtering:
                    for i in range(n):
                        gain[i] = 0.0
                    for k in range(n):
                        part = H[channel, k]
                        if part != 0.0:
                            for i in range(n):
                                gain[i] += part * P[k, i]
                    for i in range(n):
                        variance += H[channel, i] * gain[i]
                    for i in range(n):
                        part = gain[i] / variance
                        x[i] += part * error
                        for k in range(n):
                            P[i, k] -= part * gain[k]
                        if sensitive:
                            for j in range(m):
                                S[i, j] -= part * slope_y[j]
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
                _move(
                    x, steps[step], inputs[2 * step : 2 * step + 3], c, decay, stage, total, slope,
                    work,
                )  # fmt: skip
        return count

    return _compiled(run, cache=True)


_SOURCE = "".join([inspect.getsource(sys.modules[__name__]), *compiled.SOURCES])
run_window: Any = _loop(hashlib.sha256(_SOURCE.encode()).hexdigest())


def sensor_places(places: SensorGeometry) -> SensorPlaces:
    """Return the installation of sensors for the loop."""
    return SensorPlaces(
        np.ascontiguousarray(places.imu.rotation, dtype=np.float64),
        np.array(places.imu.arm_m, dtype=np.float64),
        np.ascontiguousarray(places.velocity.rotation, dtype=np.float64),
        np.array(places.velocity.arm_m, dtype=np.float64),
        np.array(places.depth.arm_m, dtype=np.float64),
        float(places.gravity),
    )
