"""The likelihood of legs under a model: windows run one by one, their sums gathered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from auvid.hydro.arrays import Array, Index
from auvid.hydro.dynamics.simulation.plant_constants import Tables
from auvid.hydro.identification.maximum_likelihood.gauss_newton import (
    Evaluate,
    Evaluation,
    NormalEquations,
)
from auvid.hydro.identification.maximum_likelihood.parameters import (
    ParameterPrior,
    UnknownParameters,
)
from auvid.hydro.identification.maximum_likelihood.records import CHANNELS, LegRecord
from auvid.hydro.identification.maximum_likelihood.windows import Window, actuator_inputs
from auvid.hydro.long_series.threads import THREADS, at_once

BIASES = 6
"""Biases of a leg: accelerometer x y z [m/s^2], gyro x y z [rad/s], in sensor axes."""
FORCES = 12
"""Numbers of the unsteady force of a leg: six time constants, six sizes."""
FEW, MANY = 32, 64
"""Directions of derivatives in one run where threads share a window, and where each has
its own: few enough for a processor's near memory."""


@dataclass(frozen=True)
class NoiseModel:
    """Standard deviations of samples (13,), and the unsteady force of each leg.

    `force_sd` (legs, 6) [N, N m] and `time_s` (6,): first-order Gauss-Markov force on
    each axis; None without it.
    """

    sensor_sd: Array
    force_sd: Array | None = None
    time_s: Array | None = None


@dataclass(frozen=True)
class WindowRun:
    """What a window gave, sample by sample: error, its variance, channel, moment.

    `jacobian` (samples, parameters + biases [+ start]) of the predictions, without rows
    where it was not asked for; `states` (N + 1, n) after the samples. With the noise
    among the unknowns: `jacobian` (samples, parameters + biases + noise), and
    `variance_slopes` (samples, parameters + noise) of the variances.
    """

    errors: Array
    variances: Array
    channel: Index
    moment: Index
    jacobian: Array
    states: Array
    variance_slopes: Array

    @property
    def objective(self) -> float:
        """Return minus the log-likelihood; infinite where the motion diverged."""
        if not len(self.errors):
            return np.inf
        return 0.5 * float(
            np.sum(self.errors**2 / self.variances + np.log(2.0 * np.pi * self.variances))
        )


@dataclass(frozen=True)
class DirectionPart:
    """Directions of derivatives that run together: parameters, and noise.

    `channels` of unknown deviation, with the force's numbers; None for no noise.
    `gains`: whether gains vary with the parameters.
    """

    parameters: slice
    channels: Index | None
    gains: bool = False


def _joined(parts: Sequence[WindowRun]) -> WindowRun:
    """Return the run of a window from parts of its directions."""
    first, last = parts[0], parts[-1]
    if len(parts) == 1 or not len(first.errors):
        return first
    sizes = [part.variance_slopes.shape[1] for part in parts[:-1]]
    early = [part.jacobian[:, :size] for part, size in zip(parts, sizes, strict=False)]
    return replace(
        last,
        jacobian=np.hstack([*early, last.jacobian]),
        variance_slopes=np.hstack([part.variance_slopes for part in parts]),
    )


@dataclass(frozen=True)
class Likelihood:
    """Windows of legs under a model, as a function of theta, biases and starts.

    `filtering`: the motion follows the samples through a Kalman filter (filter error);
    else it runs free from a start of its own (output error). `bias_sd` (6,): prior of
    the biases; nan for a bias that is not fitted.
    """

    legs: Sequence[LegRecord]
    windows: Sequence[Window]
    parameters: UnknownParameters
    filtering: bool
    start_sd: Array
    prior: ParameterPrior | None = None

    @property
    def unknowns(self) -> int:
        """Return the number of common unknowns: theta and the biases of all legs."""
        return len(self.parameters.names) + BIASES * len(self.legs)

    def split(self, common: Array) -> tuple[Array, Array]:
        """Return theta (k,) and biases (legs, 6)."""
        k = len(self.parameters.names)
        return common[:k], common[k:].reshape(len(self.legs), BIASES)

    def run(
        self,
        common: Array,
        starts: Array,
        noise: NoiseModel,
        *,
        sensitive: bool,
        channels: Index | None = None,
    ) -> list[WindowRun]:
        """Run all windows, shared among threads, the longest first.

        `channels`: those whose deviation is unknown, as are size and time constant of
        the force; None where the noise is no unknown.
        """
        theta, biases = self.split(common)
        tables, lag_s = self.parameters.tables(theta), self.parameters.lag_s(theta)

        # Long windows first; derivatives in parts, so that threads share one window.
        together = FEW if len(self.windows) < THREADS else MANY
        parts = [
            (number, part) for number in self._longest for part in self._parts(channels, together)
        ]

        def one(job: tuple[int, DirectionPart]) -> WindowRun:
            number, part = job
            bias, start = biases[self.windows[number].leg], starts[number]
            inputs = self._inputs(number, lag_s)
            return self._window(number, tables, inputs, bias, start, noise, sensitive, part)

        runs: dict[int, list[WindowRun]] = {}
        for (number, _), run in zip(parts, at_once(one, parts), strict=True):
            runs.setdefault(number, []).append(run)
        return [_joined(runs[number]) for number in range(len(self.windows))]

    @cached_property
    def _longest(self) -> list[int]:
        return sorted(range(len(self.windows)), key=lambda i: -len(self.windows[i].t_s))

    def _parts(self, channels: Index | None, together: int) -> list[DirectionPart]:
        """Return the directions of derivatives in parts of at most about `together`."""
        k = len(self.parameters.names)
        if channels is None:
            return [DirectionPart(slice(0, k), None)]
        room = max(together - len(channels) - FORCES, 0)
        ends = [*range(0, k - min(room, k), together), k - min(room, k)]
        firsts = [DirectionPart(slice(a, b), None, gains=True) for a, b in pairwise(ends)]
        return [*firsts, DirectionPart(slice(ends[-1], k), channels, gains=True)]

    def _window(
        self,
        number: int,
        tables: Tables,
        inputs_along: tuple[Array, Array],
        bias: Array,
        start: Array,
        noise: NoiseModel,
        sensitive: bool,
        part: DirectionPart,
    ) -> WindowRun:
        # Imported here, since numba takes a second.
        from auvid.hydro.identification.maximum_likelihood.window_loop.layout import Noise
        from auvid.hydro.identification.maximum_likelihood.window_loop.loop import run_window
        from auvid.hydro.identification.maximum_likelihood.window_loop.sensors import sensor_places

        window = self.windows[number]
        inputs, along = inputs_along
        unsteady = self.filtering and noise.force_sd is not None
        n = 16 if unsteady else 10
        x0, P0 = np.zeros(n), np.zeros((n, n))
        x0[:10] = start
        force, decay = np.zeros(6), np.zeros(6)
        if unsteady:
            assert noise.force_sd is not None
            assert noise.time_s is not None
            force, decay = noise.force_sd[window.leg] ** 2, 1.0 / noise.time_s
            P0[10:, 10:] = np.diag(force)
        if self.filtering:
            P0[:10, :10] = np.diag(self.start_sd**2)
        k, channels = part.parameters.stop - part.parameters.start, part.channels
        extra = 0 if channels is None else len(channels) + FORCES
        samples, size = window.samples, k + BIASES + (extra if self.filtering else 10)
        states = np.full((len(window.t_s), n), np.nan)
        errors, variances = np.empty(samples), np.empty(samples)
        jacobian = np.empty((samples if sensitive else 0, size))
        variance_slopes = np.empty((samples if part.gains else 0, k + extra))
        channel_places = np.full(len(CHANNELS), -1)
        if channels is not None:
            channel_places[channels] = k + np.arange(len(channels))
        variance = np.nan_to_num(noise.sensor_sd, nan=1.0) ** 2
        count = run_window(
            x0,
            P0,
            window.steps,
            inputs,
            along,
            window.measured,
            bias,
            self.parameters.kinds[part.parameters],
            not self.filtering,
            self.filtering,
            channel_places,
            tables,
            sensor_places(self.legs[window.leg].geometry),
            Noise(variance, force, decay),
            states,
            errors,
            variances,
            jacobian,
            variance_slopes,
        )
        moment, channel = np.nonzero(np.isfinite(window.measured))
        ok = count == samples and np.isfinite(errors).all() and bool(np.all(variances > 0.0))
        keep = slice(None) if ok else slice(0, 0)
        return WindowRun(
            errors[keep], variances[keep], channel[keep], moment[keep], jacobian[keep], states,
            variance_slopes[keep],
        )  # fmt: skip

    def _inputs(self, number: int, lag_s: float) -> tuple[Array, Array]:
        key = (number, lag_s)
        if key not in self._input_cache:
            window = self.windows[number]
            for old in [item for item in self._input_cache if item[0] == number]:
                self._input_cache.pop(old, None)
            self._input_cache[key] = actuator_inputs(
                self.legs[window.leg], window, self.parameters.vehicle, lag_s
            )
        return self._input_cache[key]

    @cached_property
    def _input_cache(self) -> dict[tuple[int, float], tuple[Array, Array]]:
        return {}

    def under(self, noise: NoiseModel, starts: Array | None = None) -> Evaluate:
        """Return the function to maximise; with `starts`, those are not unknown."""

        def evaluate(common: Array, local: Array, sensitive: bool) -> Evaluation:
            first = local if starts is None else starts
            return self.evaluate(common, first, noise, sensitive=sensitive)[0]

        return evaluate

    def prior_objective(self, common: Array) -> float:
        """Return what the prior adds to minus the log-likelihood."""
        if self.prior is None:
            return 0.0
        away = common[: len(self.prior.mean)] - self.prior.mean
        return 0.5 * float(away @ self.prior.precision @ away)

    def evaluate(
        self, common: Array, starts: Array, noise: NoiseModel, *, sensitive: bool
    ) -> tuple[Evaluation, list[WindowRun]]:
        """Return the objective with its normal equations, and the windows' runs."""
        runs = self.run(common, starts, noise, sensitive=sensitive)
        objective = sum(item.objective for item in runs) + self.prior_objective(common)
        theta = common[: len(self.parameters.names)]
        if not sensitive or not np.isfinite(objective):
            return Evaluation(objective, None), runs
        return Evaluation(objective, self.normal_equations(runs, theta)), runs

    def normal_equations(self, runs: Sequence[WindowRun], theta: Array) -> NormalEquations:
        """Return the sums J' W J and J' W e over all windows, and the prior's part."""
        size = self.unknowns
        matrix, vector = np.zeros((size, size)), np.zeros(size)
        local, coupling, right = [], [], []
        for window, run in zip(self.windows, runs, strict=True):
            weighted = run.jacobian / run.variances[:, None]
            block, answer = weighted.T @ run.jacobian, weighted.T @ run.errors
            place = self.places(window.leg)
            g = len(place)
            matrix[np.ix_(place, place)] += block[:g, :g]
            vector[place] += answer[:g]
            if not self.filtering:
                across = np.zeros((block.shape[0] - g, size))
                across[:, place] = block[g:, :g]
                local.append(block[g:, g:])
                coupling.append(across)
                right.append(answer[g:])
        k = len(theta)
        if self.prior is not None:
            matrix[:k, :k] += self.prior.precision
            vector[:k] += self.prior.precision @ (self.prior.mean - theta)
        return NormalEquations(matrix, vector, tuple(local), tuple(coupling), tuple(right))

    def by_leg(self, runs: Sequence[WindowRun]) -> list[tuple[Likelihood, list[WindowRun]]]:
        """Return the likelihood of each leg alone, without the prior, and its runs."""
        return [
            (
                replace(self, windows=[w for w in self.windows if w.leg == leg], prior=None),
                [run for w, run in zip(self.windows, runs, strict=True) if w.leg == leg],
            )
            for leg in range(len(self.legs))
        ]

    def places(self, leg: int) -> Index:
        """Return the places of theta and of a leg's biases in the common unknowns."""
        k = len(self.parameters.names)
        return np.concatenate([np.arange(k), k + BIASES * leg + np.arange(BIASES)])

    def first_starts(self, biases: Array) -> Array:
        """Return a start (windows, 10) of each window from the samples around it."""
        return np.array(
            [
                self.legs[window.leg].motion(window.t_s[:1], gyro_bias=biases[window.leg, 3:])[0]
                for window in self.windows
            ]
        )
