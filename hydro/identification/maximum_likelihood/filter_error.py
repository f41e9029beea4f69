"""Filter error for six degrees of freedom: innovations of a Kalman filter.

As output error, but an unsteady force, first-order Gauss-Markov on each axis, pushes
the vehicle; an extended Kalman filter follows motion and force through the samples, and
the innovations are weighted by their own variance. Its noise (standard deviations of
samples, size and time constant of the force) is estimated with the coefficients (Maine
and Iliff 1981; Jategaonkar 2015, chapter 5). Steps hold the gains fixed: the score keeps its mean
of zero and a step costs one run. The last step is one of scoring on coefficients,
biases and noise together, whose information gives the standard errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.maximum_likelihood.estimate import (
    LikelihoodEstimate,
    estimate_from,
    score_moment,
)
from auvid.hydro.identification.maximum_likelihood.gauss_newton import (
    bounded_step,
    maximise,
)
from auvid.hydro.identification.maximum_likelihood.likelihood import (
    BIASES,
    Likelihood,
    NoiseModel,
)
from auvid.hydro.identification.maximum_likelihood.noise import (
    DIFFERENCE,
    NoiseUnknowns,
    improve_noise,
    polish,
)
from auvid.hydro.identification.maximum_likelihood.output_error import (
    likelihood_bounds,
    require_samples,
)
from auvid.hydro.identification.maximum_likelihood.parameters import (
    ParameterPrior,
    UnknownParameters,
)
from auvid.hydro.identification.maximum_likelihood.records import LegRecord
from auvid.hydro.identification.maximum_likelihood.starting_values import START_SD, wide_noise
from auvid.hydro.identification.maximum_likelihood.windows import cut_windows

SMALLEST_SHARE = 1e-3
"""Floor of the unsteady force, in parts of its first guess."""
ROUNDS, STEPS, JOINT_ROUNDS = 15, 3, 10
NEAR, SETTLED = 20.0, 0.5
"""Gain of log-likelihood by new noise below which coefficients and noise move together,
and by a joint step below which all is settled: a deviation of one number among dozens."""


def fit_filter_error(
    legs: Sequence[LegRecord],
    parameters: UnknownParameters,
    start: Mapping[str, float] | Array,
    *,
    prior: ParameterPrior | None = None,
    noise: NoiseModel | None = None,
    sensor_sd: Array | None = None,
    biases: Array | None = None,
) -> LikelihoodEstimate:
    """Fit theta from `start`, by name or as vector, and the noise, to whole legs.

    `noise`: where it starts from; `sensor_sd` (13,): known standard deviations of the
    samples, else estimated. `biases` (legs, 6): where they start from. Raises
    `DataError` where samples are fewer than unknowns, or the start diverges.
    """
    windows, dropped = cut_windows(legs, length_s=None)
    likelihood = Likelihood(legs, windows, parameters, True, START_SD, prior)
    theta = parameters.vector(start) if isinstance(start, Mapping) else np.asarray(start)
    first = np.zeros((len(legs), BIASES)) if biases is None else np.asarray(biases)
    common = np.concatenate([theta, first.ravel()])
    starts = likelihood.first_starts(first)
    require_samples(likelihood, likelihood.unknowns)
    lower, upper = likelihood_bounds(likelihood)
    if noise is None:
        noise = wide_noise(legs, parameters.vehicle)
    if sensor_sd is not None:
        noise = replace(noise, sensor_sd=np.asarray(sensor_sd))
    assert noise.force_sd is not None
    floor = SMALLEST_SHARE * np.max(noise.force_sd, axis=0)
    measured = np.any([np.isfinite(window.measured).any(axis=0) for window in windows], axis=0)
    unknown = NoiseUnknowns(
        np.flatnonzero(measured) if sensor_sd is None else np.zeros(0, dtype=np.intp), len(legs)
    )
    history: list[float] = []
    for _ in range(ROUNDS):
        used = noise

        optimum = maximise(
            likelihood.under(used, starts),
            common,
            np.zeros((0, 10)),
            lower=lower,
            upper=upper,
            most_steps=STEPS,
        )
        common = optimum.common
        history += [-value for value in optimum.objectives]
        noise, gain = improve_noise(likelihood, common, starts, used, unknown, smallest_force=floor)
        if gain < NEAR:
            break
    word = "no convergence"
    for _ in range(JOINT_ROUNDS):
        final, _ = likelihood.evaluate(common, starts, noise, sensitive=True)
        assert final.equations is not None
        _, _, spread = bounded_step(final.equations, common, lower, upper, 0.0)
        common, noise, system, fixed, gain = polish(
            likelihood,
            common,
            starts,
            noise,
            unknown,
            theta_steps=DIFFERENCE * np.where(np.isfinite(spread), spread, 1.0)[: len(theta)],
            lower=lower,
            upper=upper,
            smallest_force=floor,
        )
        history.append(history[-1] + gain)
        if gain < SETTLED:
            word = "converged"
            break
    runs = likelihood.run(common, starts, noise, sensitive=False)
    return estimate_from(
        likelihood,
        common,
        runs,
        noise,
        information=system.matrix,
        moment=score_moment(likelihood, system.scores),
        at_bound=fixed,
        word=word,
        log_likelihood=history,
        dropped=dropped,
    )
