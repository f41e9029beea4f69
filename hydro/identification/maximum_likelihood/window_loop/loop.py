"""One window of a leg as a compiled loop: motion, sensitivities and Kalman filter.

The motion comes from `model_force` and `motion_rates` of the compiled simulation, so
that no equation of motion stands here. State: [phi, theta, psi, z, u, v, w, p, q, r]
(10), with the unsteady force [X .. N] (16) where a filter runs. Runge-Kutta 4 between
the times of samples; the transition is the matrix exponential of Jacobians that are
differences of the compiled derivative. Import this module only where an estimate is
made: numba takes a second.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from typing import Any

import numpy as np

from auvid.hydro import arrays
from auvid.hydro.arrays import Array, Ints
from auvid.hydro.dynamics.simulation import sensor_models
from auvid.hydro.dynamics.simulation.compiled import FACTOR_COUNT, SOURCES, addresses
from auvid.hydro.dynamics.simulation.plant_constants import Tables
from auvid.hydro.identification.maximum_likelihood.window_loop.compiling import (
    compiled,
    matrix,
    second_level,
    singles,
    stack,
    vector,
)
from auvid.hydro.identification.maximum_likelihood.window_loop.covariance import carry_covariance
from auvid.hydro.identification.maximum_likelihood.window_loop.covariance_slopes import (
    carry_tangents,
    sample_tangents,
)
from auvid.hydro.identification.maximum_likelihood.window_loop.jacobians import jacobians
from auvid.hydro.identification.maximum_likelihood.window_loop.layout import (
    BIASES,
    MEASURED,
    MOTION,
    Noise,
)
from auvid.hydro.identification.maximum_likelihood.window_loop.motion import (
    integrate_step,
    inverse_column,
    parameter_accelerations,
    rates,
)
from auvid.hydro.identification.maximum_likelihood.window_loop.sensitivities import (
    add_turned_slopes,
    carry_sensitivities,
    write_row_product,
)
from auvid.hydro.identification.maximum_likelihood.window_loop.sensors import (
    SensorPlaces,
    accelerometer,
    outputs,
)
from auvid.hydro.identification.maximum_likelihood.window_loop.transition import step_transition


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
        x, P, S = vector(n), matrix(n, n), matrix(n, m)
        for i in range(n):
            x[i] = x0[i]
            for j in range(n):
                P[i, j] = P0[i, j]
        if free_start:
            for i in range(MOTION):
                S[i, m - MOTION + i] = 1.0
        slope, y, H = vector(n), vector(channels), matrix(channels, n)
        H[2, 2] = H[12, 3] = 1.0
        A0, A1, Phi, fade = matrix(motion, n), matrix(motion, n), matrix(motion, n), vector(n)
        for i in range(n):
            fade[i] = 1.0
        a0, a1, direct = (
            matrix(axes, parameters),
            matrix(axes, parameters),
            matrix(axes, parameters),
        )
        push, half = stack(axes, motion, axes), stack(axes, motion, n)
        terms = vector(tables.counts[0])
        work = (
            vector(2 * axes), vector(2 * axes), vector(2 * axes),
            vector(FACTOR_COUNT + tables.counts[0]),
        )  # fmt: skip
        pair = (vector(n), vector(n), vector(2 * axes))
        stage, total, there, y_there, force = (
            vector(n), vector(n), vector(n), vector(channels), vector(axes),
        )  # fmt: skip
        spare, square = matrix(n, m), matrix(n, n)
        before, gain, slope_y = vector(n), vector(n), vector(m)
        # Derivatives D of P by the q directions of parameters and noise; gradients need no
        # more than single precision. The last row of `by_gain` is for a variance.
        q = variance_slopes.shape[1] if tangent else 0
        places = (channel_places, q - 12, q - 6)
        D, upper, by_gain = (
            singles(n, n, q),
            singles(motion, n, q),
            singles(axes, n + 1, q)[0],
        )
        pulls = parameters if tangent else 0
        pull0, pull1 = stack(pulls, axes, n), stack(pulls, axes, n)
        levers, no_lever = matrix(axes, axes), vector(0 * axes)
        if tangent:
            for k in range(6):
                if q > parameters:
                    D[MOTION + k, MOTION + k, places[2] + k] = 2.0 * P0[MOTION + k, MOTION + k]
                levers[0, k], levers[1, k], levers[2, k] = accelerometer(
                    g, inverse_column(c.inverse, k)
                )
        count = 0
        for step in range(len(steps) + 1):
            # Rates, outputs and their derivatives at the predicted state.
            now = inputs[2 * step]
            rates(x, now, c, decay, slope, work)
            outputs(x, slope, g, y)
            if sensitive:
                for i in range(len(terms)):
                    terms[i] = work[3][FACTOR_COUNT + i]
                parameter_accelerations(
                    x, slope, now, along[2 * step], c, decay, kinds, a1, force, work, pair
                )
                for p in range(parameters):
                    direct[0, p], direct[1, p], direct[2, p] = accelerometer(
                        g, (a1[0, p], a1[1, p], a1[2, p], a1[3, p], a1[4, p], a1[5, p])
                    )
            if sensitive or filtering:
                jacobians(
                    x, slope, y, now, c, decay, g, A1, H, kinds, terms, pull1, stage, there,
                    y_there, force, work,
                )  # fmt: skip
                if step > 0:
                    h = steps[step - 1]
                    step_transition(A0, A1, h, decay, Phi, fade, push, half[0], half[1], half[2])
                    if sensitive:
                        carry_sensitivities(S, Phi, fade, push, a0, a1, spare)
                    if filtering:
                        carry_covariance(P, Phi, fade, h, noise.force, inverse, square)
                    if tangent:
                        # The force itself fades more slowly.
                        for k in range(6 if q > parameters else 0):
                            f, j = MOTION + k, places[1] + k + BIASES
                            S[f, j] += decay[k] * h * x[f]
                            for i in range(MOTION):
                                S[i, j] += 0.5 * decay[k] * h * Phi[i, f] * x[f] / fade[f]
                        carry_tangents(
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
                    write_row_product(h_row, S, slope_y)
                    if 6 <= channel < 9:
                        for p in range(parameters):
                            slope_y[p] += direct[channel - 6, p]
                        slope_y[parameters + channel - 6] += 1.0
                        if tangent:
                            for i in range(n):
                                stage[i] = x[i] - before[i]
                            add_turned_slopes(levers[channel - 6], pull0, stage, slope_y)
                    elif 3 <= channel < 6:
                        slope_y[parameters + channel] += 1.0
                    for j in range(m):
                        jacobian[count, j] = slope_y[j]
                if filtering:
                    write_row_product(h_row, P, gain)
                    for i in range(n):
                        variance += h_row[i] * gain[i]
                    if tangent:
                        sample_tangents(
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
                    rates(x, now, c, decay, slope, work)
                    if sensitive:
                        parameter_accelerations(
                            x, slope, now, along[2 * step], c, decay, kinds, a0, force, work, pair
                        )
                integrate_step(
                    x, steps[step], inputs[2 * step : 2 * step + 3], c, decay, stage, total, slope,
                    work,
                )  # fmt: skip
        return count

    return second_level(compiled(run, cache=True))


_MODULES = [
    arrays,
    sensor_models,
    *(module for name, module in sorted(sys.modules.items()) if name.startswith(__package__)),
]
_SOURCE = "".join([*map(inspect.getsource, _MODULES), *SOURCES])
run_window: Any = _loop(int(hashlib.sha256(_SOURCE.encode()).hexdigest()[:15], 16))
