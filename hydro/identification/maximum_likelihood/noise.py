"""Scoring of sensor noise, unsteady force and coefficients at once.

The noise stands as logarithms phi of standard deviations and time constants. With
innovations e of variance s, each a scalar, minus the log-likelihood is sum (e^2 / s +
ln s) / 2:

    gradient    = sum [e e' / s + (1 - e^2 / s) s' / (2 s)]
    information = sum [e' e' / s + s' s' / (2 s^2)]

with ' by an unknown, differences of whole runs (Maine and Iliff 1981). Poles of the
force and damping of the vehicle answer for the same motion, so that intervals of
coefficients need both in one information matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, Index, Mask
from auvid.hydro.identification.maximum_likelihood.gauss_newton import (
    NormalEquations,
    bounded_step,
    solve_scaled,
)
from auvid.hydro.identification.maximum_likelihood.likelihood import (
    Likelihood,
    NoiseModel,
    WindowRun,
)

DIFFERENCE, LONGEST_STEP = 1e-3, 1.0
RIDGE = 1.0
"""Information of a weak prior at the present value: a factor of e is one deviation. It
keeps a force that is not there from running to zero in one step."""
TIME_RANGE_S = (0.05, 20.0)
HALVINGS = 5


@dataclass(frozen=True)
class Scoring:
    """Information `matrix` (n, n), minus the gradient (n,) and `scores` of each window.

    `scores` (N + 1, n): the gradient moment by moment.
    """

    matrix: Array
    vector: Array
    scores: tuple[Array, ...]


@dataclass(frozen=True)
class Slope:
    """Derivatives (samples,) of a window's innovations and variances by one unknown."""

    place: int
    error: Array
    variance: Array


@dataclass(frozen=True)
class NoiseUnknowns:
    """Unknown numbers of the noise: `channels`, six times, six forces a leg."""

    channels: Index
    legs: int

    @property
    def size(self) -> int:
        """Return the length of phi."""
        return len(self.channels) + 6 + 6 * self.legs

    @property
    def directions(self) -> tuple[Index, ...]:
        """Return groups of places that one set of runs serves.

        Legs have their own force, so that their places go together.
        """
        shared = len(self.channels) + 6
        own = [shared + i + 6 * np.arange(self.legs) for i in range(6)]
        return (*(np.array([i]) for i in range(shared)), *own)

    def shifted(self, noise: NoiseModel, step: Array) -> NoiseModel:
        """Return the noise after a step in phi (size,)."""
        assert noise.force_sd is not None
        assert noise.time_s is not None
        factor, c = np.exp(step), len(self.channels)
        sensor = noise.sensor_sd.copy()
        sensor[self.channels] *= factor[:c]
        force = noise.force_sd * factor[c + 6 :].reshape(-1, 6)
        time_s = np.clip(noise.time_s * factor[c : c + 6], *TIME_RANGE_S)
        return NoiseModel(sensor, force, time_s)


def improve_noise(
    likelihood: Likelihood,
    common: Array,
    starts: Array,
    noise: NoiseModel,
    unknown: NoiseUnknowns,
    *,
    smallest_force: Array,
) -> tuple[NoiseModel, float]:
    """Return the noise after one step of scoring, and what the log-likelihood gained.

    `smallest_force` (6,): floor of the standard deviations of the force. The step is
    halved until the likelihood does not fall.
    """
    base = likelihood.run(common, starts, noise, sensitive=False)
    slopes = _noise_slopes(likelihood, common, starts, noise, unknown, base, first=0)
    system = _scoring(likelihood, base, slopes, unknown.size)
    matrix = system.matrix + RIDGE * np.eye(unknown.size)
    step = np.clip(solve_scaled(matrix, system.vector), -LONGEST_STEP, LONGEST_STEP)
    before = total_objective(base)
    for _ in range(HALVINGS):
        moved = _floored(unknown.shifted(noise, step), smallest_force)
        there = likelihood.run(common, starts, moved, sensitive=False)
        if total_objective(there) <= before:
            return moved, before - total_objective(there)
        step = 0.5 * step
    return noise, 0.0


def polish(
    likelihood: Likelihood,
    common: Array,
    starts: Array,
    noise: NoiseModel,
    unknown: NoiseUnknowns,
    *,
    theta_steps: Array,
    lower: Array,
    upper: Array,
    smallest_force: Array,
) -> tuple[Array, NoiseModel, Scoring, Mask, float]:
    """Return common unknowns and noise after one joint step of scoring.

    Also the system, what a bound holds, and what the log-likelihood gained.

    `theta_steps` (k,): widths of the differences by theta. Here the gains vary with
    theta too, so that the step ends at the maximum of the likelihood itself. It is
    halved until the likelihood does not fall.
    """
    size, k = likelihood.unknowns, len(theta_steps)
    base = likelihood.run(common, starts, noise, sensitive=True)
    slopes = _noise_slopes(likelihood, common, starts, noise, unknown, base, first=size)
    shifts = [common + width * (np.arange(size) == i) for i, width in enumerate(theta_steps)]
    several = likelihood.run_many([(moved, noise) for moved in shifts], starts, sensitive=False)
    for i, runs in enumerate(several):
        for number, (run, there) in enumerate(zip(base, runs, strict=True)):
            slopes[number].append(_slope(i, run, there, theta_steps[i]))
    for number, (window, run) in enumerate(zip(likelihood.windows, base, strict=True)):
        for column, place in enumerate(likelihood.places(window.leg)[k:], start=k):
            none = np.zeros(len(run.errors))
            slopes[number].append(Slope(int(place), -run.jacobian[:, column], none))
    system = _scoring(likelihood, base, slopes, size + unknown.size)
    matrix, vector = system.matrix, system.vector
    matrix[size:, size:] += RIDGE * np.eye(unknown.size)
    if likelihood.prior is not None:
        matrix[:k, :k] += likelihood.prior.precision
        vector[:k] += likelihood.prior.precision @ (likelihood.prior.mean - common[:k])
    reach = np.full(unknown.size, LONGEST_STEP)
    step, fixed, _ = bounded_step(
        NormalEquations(matrix, vector),
        np.concatenate([common, np.zeros(unknown.size)]),
        np.concatenate([lower, -reach]),
        np.concatenate([upper, reach]),
        0.0,
    )
    fixed[size:] = False
    before = total_objective(base) + likelihood.prior_objective(common)
    for _ in range(HALVINGS):
        there_noise = _floored(unknown.shifted(noise, step[size:]), smallest_force)
        there_common = common + step[:size]
        runs = likelihood.run(there_common, starts, there_noise, sensitive=False)
        gain = before - total_objective(runs) - likelihood.prior_objective(there_common)
        if gain >= 0.0:
            return there_common, there_noise, system, fixed, gain
        step = 0.5 * step
    return common, noise, system, fixed, 0.0


def total_objective(runs: Sequence[WindowRun]) -> float:
    """Return minus the log-likelihood of all windows."""
    return sum(run.objective for run in runs)


def _noise_slopes(
    likelihood: Likelihood,
    common: Array,
    starts: Array,
    noise: NoiseModel,
    unknown: NoiseUnknowns,
    base: Sequence[WindowRun],
    *,
    first: int,
) -> list[list[Slope]]:
    slopes: list[list[Slope]] = [[] for _ in base]
    steps = []
    for places in unknown.directions:
        step = np.zeros(unknown.size)
        step[places] = DIFFERENCE
        steps.append(unknown.shifted(noise, step))
    several = likelihood.run_many([(common, moved) for moved in steps], starts, sensitive=False)
    for places, runs in zip(unknown.directions, several, strict=True):
        for number, (run, there) in enumerate(zip(base, runs, strict=True)):
            own = places[likelihood.windows[number].leg] if len(places) > 1 else places[0]
            slopes[number].append(_slope(first + int(own), run, there, DIFFERENCE))
    return slopes


def _slope(place: int, run: WindowRun, there: WindowRun, width: float) -> Slope:
    if not len(there.errors):  # the moved run diverged: nothing is known of this direction
        return Slope(place, np.zeros(len(run.errors)), np.zeros(len(run.errors)))
    return Slope(
        place, (there.errors - run.errors) / width, (there.variances - run.variances) / width
    )


def _scoring(
    likelihood: Likelihood, base: Sequence[WindowRun], slopes: Sequence[Sequence[Slope]], size: int
) -> Scoring:
    matrix, vector, scores = np.zeros((size, size)), np.zeros(size), []
    for window, run, parts in zip(likelihood.windows, base, slopes, strict=True):
        at = np.array([part.place for part in parts])
        deviation = np.sqrt(run.variances)
        by_error = np.array([part.error for part in parts]) / deviation
        by_variance = np.array([part.variance for part in parts]) / run.variances
        scaled = run.errors / deviation
        matrix[np.ix_(at, at)] += by_error @ by_error.T + 0.5 * by_variance @ by_variance.T
        rows = -(by_error * scaled + 0.5 * by_variance * (1.0 - scaled**2)).T
        series = np.zeros((len(window.t_s), size))
        gathered = np.zeros((len(window.t_s), len(at)))
        np.add.at(gathered, run.moment, rows)
        series[:, at] = gathered
        vector[at] += gathered.sum(axis=0)
        scores.append(series)
    return Scoring(matrix, vector, tuple(scores))


def _floored(noise: NoiseModel, smallest_force: Array) -> NoiseModel:
    assert noise.force_sd is not None
    return NoiseModel(noise.sensor_sd, np.maximum(noise.force_sd, smallest_force), noise.time_s)
