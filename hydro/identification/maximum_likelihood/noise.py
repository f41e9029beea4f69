"""Scoring of coefficients, biases, sensor noise and unsteady force at once.

The noise stands as logarithms phi of standard deviations and time constants. With
innovations e of variance s, each a scalar, minus the log-likelihood is sum (e^2 / s +
ln s) / 2:

    gradient    = sum [e e' / s + (1 - e^2 / s) s' / (2 s)]
    information = sum [e' e' / s + s' s' / (2 s^2)]

with ' by an unknown, carried along with the filter (Maine and Iliff 1981). Poles of the
force and damping of the vehicle answer for the same motion, so that intervals of
coefficients need both in one information matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, Index
from auvid.hydro.identification.maximum_likelihood.likelihood import (
    Likelihood,
    NoiseModel,
    WindowRun,
)
from auvid.hydro.identification.maximum_likelihood.records import SMALLEST_SD

TIME_RANGE_S = (0.05, 20.0)


@dataclass(frozen=True)
class NoiseUnknowns:
    """Unknown numbers phi of the noise: `channels`, six times, six forces a leg."""

    channels: Index
    legs: int

    @property
    def size(self) -> int:
        """Return the length of phi."""
        return len(self.channels) + 6 + 6 * self.legs

    def places(self, leg: int) -> Index:
        """Return the places in phi of what acts on a leg."""
        shared = len(self.channels) + 6
        return np.concatenate([np.arange(shared), shared + 6 * leg + np.arange(6)])

    def logarithms(self, noise: NoiseModel) -> Array:
        """Return phi (size,) of a noise."""
        assert noise.force_sd is not None
        assert noise.time_s is not None
        parts = (noise.sensor_sd[self.channels], noise.time_s, noise.force_sd.ravel())
        return np.log(np.concatenate(parts))

    def noise_at(self, phi: Array, sensor_sd: Array) -> NoiseModel:
        """Return the noise of phi; `sensor_sd` (13,) for channels outside it."""
        values, c = np.exp(phi), len(self.channels)
        sensor = sensor_sd.copy()
        sensor[self.channels] = values[:c]
        return NoiseModel(sensor, values[c + 6 :].reshape(-1, 6), values[c : c + 6])

    def bounds(self, smallest_force: Array) -> tuple[Array, Array]:
        """Return bounds of phi; `smallest_force` (6,): floor of its deviations."""
        c = len(self.channels)
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        low[:c] = np.log(SMALLEST_SD[self.channels])
        low[c : c + 6], high[c : c + 6] = np.log(TIME_RANGE_S)
        low[c + 6 :] = np.tile(np.log(smallest_force), self.legs)
        return low, high


def scoring(
    likelihood: Likelihood, unknown: NoiseUnknowns, runs: Sequence[WindowRun]
) -> tuple[Array, Array]:
    """Return information (g, g), minus gradient (g,) by common unknowns and phi."""
    size = likelihood.unknowns + unknown.size
    matrix, vector = np.zeros((size, size)), np.zeros(size)
    for window, run in zip(likelihood.windows, runs, strict=True):
        place, of_variance = _places(likelihood, unknown, window.leg)
        deviation = np.sqrt(run.variances)
        by_error = run.jacobian / deviation[:, None]
        by_variance = run.variance_slopes / run.variances[:, None]
        scaled = run.errors / deviation
        matrix[np.ix_(place, place)] += by_error.T @ by_error
        matrix[np.ix_(of_variance, of_variance)] += 0.5 * by_variance.T @ by_variance
        vector[place] += by_error.T @ scaled
        vector[of_variance] += 0.5 * by_variance.T @ (scaled**2 - 1.0)
    return matrix, vector


def noise_scores(
    likelihood: Likelihood, unknown: NoiseUnknowns, runs: Sequence[WindowRun]
) -> list[Array]:
    """Return minus the gradient moment by moment (N + 1, g), window by window."""
    out = []
    for window, run in zip(likelihood.windows, runs, strict=True):
        place, of_variance = _places(likelihood, unknown, window.leg)
        weight = (run.errors / run.variances)[:, None]
        rows = np.zeros((len(run.errors), likelihood.unknowns + unknown.size))
        rows[:, place] = run.jacobian * weight
        rows[:, of_variance] += (
            0.5 * run.variance_slopes * (weight**2 - 1.0 / run.variances[:, None])
        )
        first = np.flatnonzero(np.diff(run.moment, prepend=-1))
        series = np.zeros((len(window.t_s), rows.shape[1]))
        series[run.moment[first]] = np.add.reduceat(rows, first, axis=0)
        out.append(series)
    return out


def _places(likelihood: Likelihood, unknown: NoiseUnknowns, leg: int) -> tuple[Index, Index]:
    """Return the places of the columns of a run's jacobian and variance slopes."""
    theta = np.arange(len(likelihood.parameters.names))
    noise = likelihood.unknowns + unknown.places(leg)
    return np.concatenate([likelihood.places(leg), noise]), np.concatenate([theta, noise])
