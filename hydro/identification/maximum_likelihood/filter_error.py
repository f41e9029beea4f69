"""Filter error for six degrees of freedom: innovations of a Kalman filter.

As output error, but an unsteady force, first-order Gauss-Markov on each axis, pushes
the vehicle; an extended Kalman filter follows motion and force through the samples, and
the innovations are weighted by their own variance. Its noise (standard deviations of
samples, size and time constant of the force) is estimated with the coefficients (Maine
and Iliff 1981; Jategaonkar 2015, chapter 5), in one step of scoring after the other, whose
information gives the standard errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.maximum_likelihood.estimate import (
    LegEquations,
    LikelihoodEstimate,
    estimate_from,
    score_moment,
)
from auvid.hydro.identification.maximum_likelihood.gauss_newton import (
    GAIN,
    Evaluation,
    NormalEquations,
    Optimum,
    maximise,
    with_secants,
)
from auvid.hydro.identification.maximum_likelihood.likelihood import (
    BIASES,
    Likelihood,
    NoiseModel,
    WindowRun,
)
from auvid.hydro.identification.maximum_likelihood.noise import (
    NoiseUnknowns,
    noise_scores,
    scoring,
)
from auvid.hydro.identification.maximum_likelihood.output_error import (
    likelihood_bounds,
    require_samples,
)
from auvid.hydro.identification.maximum_likelihood.parameters import (
    FixedParameters,
    ParameterPrior,
    UnknownParameters,
)
from auvid.hydro.identification.maximum_likelihood.records import LegRecord
from auvid.hydro.identification.maximum_likelihood.starting_values import START_SD, wide_noise
from auvid.hydro.identification.maximum_likelihood.windows import cut_windows

SMALLEST_SHARE = 1e-3
"""Floor of the unsteady force, in parts of its first guess."""
STEPS, TOLERANCE = 40, 0.1
"""Most steps, and the last one in parts of a standard error."""
SECANTS, NEAR = 5, 400.0
"""How many past steps correct the expected information, and the gain of log-likelihood
from which on a step is too far for it."""
LONGEST_STEP = 1.5
"""Longest step of the logarithms of the noise."""
NOISE_STEPS, NOISE_GAIN, LONGEST_STEP_ALONE = 10, 5.0, 1.0
"""The same of the noise alone, which need not be found to the end."""
FAR = 2.0
"""Innovations at the start, in their deviations, from which on the noise is found first."""
RIDGE = 1.0
"""Information of a weak prior of those at their present values: a factor of e is one
deviation. It keeps a force that is not there from running to zero in one step."""


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
    samples, else estimated. `biases` (legs, 6): where they start from. After `STEPS`
    steps without convergence the best point so far is kept, and `word` says so. Raises
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
    size, k, phi = len(common), len(theta), unknown.logarithms(noise)
    low, high = unknown.bounds(floor)

    scoring_fit = _Scoring(likelihood, unknown, starts, noise.sensor_sd)
    values, before = np.concatenate([theta, first.ravel(), phi]), np.zeros(0)
    if scoring_fit.normalised_error(np.clip(values[:size], lower, upper), phi) > FAR:
        # The noise first, at the model of the start: it leads coefficients astray.
        at_start = FixedParameters(parameters, np.clip(theta, lower[:k], upper[:k]))
        noise_problem = replace(likelihood, parameters=at_start, prior=None)
        quiet = _Scoring(noise_problem, unknown, starts, noise.sensor_sd).maximise(
            values[k:],
            np.concatenate([lower[k:], low]),
            np.concatenate([upper[k:], high]),
            most_steps=NOISE_STEPS,
            least_gain=NOISE_GAIN,
            longest_step=LONGEST_STEP_ALONE,
        )
        values = np.concatenate([theta, quiet.common])
        before = np.array(quiet.objectives[:-1]) + likelihood.prior_objective(at_start.theta)
    optimum = scoring_fit.maximise(
        values,
        np.concatenate([lower, low]),
        np.concatenate([upper, high]),
        most_steps=STEPS,
        least_gain=GAIN,
        longest_step=LONGEST_STEP,
    )
    common, noise = optimum.common[:size], unknown.noise_at(optimum.common[size:], noise.sensor_sd)
    runs, information = scoring_fit.latest  # of the point that was taken last
    return estimate_from(
        likelihood,
        common,
        runs,
        noise,
        information=information,
        moment=score_moment(likelihood, noise_scores(likelihood, unknown, runs)),
        at_bound=optimum.at_bound,
        word=optimum.word,
        log_likelihood=[-value for value in (*before.tolist(), *optimum.objectives)],
        dropped=dropped,
        leg_equations=[
            LegEquations(*scoring(part, unknown, own)) for part, own in likelihood.by_leg(runs)
        ],
    )


@dataclass
class _Scoring:
    """Steps of scoring on common unknowns and the noise, corrected by past ones.

    `latest`: runs and information of the point that was taken last. `tried`: runs of the
    point that was tried last, with slopes: most steps are taken, and one without slopes
    would run once more.
    """

    likelihood: Likelihood
    unknown: NoiseUnknowns
    starts: Array
    sensor_sd: Array
    points: list[tuple[Array, Array]] = field(default_factory=list)
    last: float = np.inf
    latest: tuple[list[WindowRun], Array] = field(default_factory=lambda: ([], np.zeros((0, 0))))
    tried: tuple[Array, list[WindowRun]] = field(default_factory=lambda: (np.zeros(0), []))

    def normalised_error(self, common: Array, phi: Array) -> float:
        """Return the RMS of innovations in their deviations; 0 where they diverge."""
        noise = self.unknown.noise_at(phi, self.sensor_sd)
        runs = self.likelihood.run(common, self.starts, noise, sensitive=False)
        squares = np.concatenate([run.errors**2 / run.variances for run in runs])
        return float(np.sqrt(np.mean(squares))) if len(squares) else 0.0

    def evaluate(self, values: Array, _: Array, sensitive: bool) -> Evaluation:
        """Return minus the log-likelihood, and the equations of a step of scoring."""
        likelihood, unknown, size = self.likelihood, self.unknown, self.likelihood.unknowns
        if not np.array_equal(values, self.tried[0]):
            moved = unknown.noise_at(values[size:], self.sensor_sd)
            channels = unknown.channels
            self.tried = (
                values,
                likelihood.run(
                    values[:size], self.starts, moved, sensitive=True, channels=channels
                ),
            )
        runs = self.tried[1]
        objective = sum(run.objective for run in runs) + likelihood.prior_objective(values[:size])
        if not sensitive or not np.isfinite(objective):
            return Evaluation(objective, None)
        information, vector = scoring(likelihood, unknown, runs)
        prior, k = likelihood.prior, len(likelihood.parameters.names)
        if prior is not None:
            information[:k, :k] += prior.precision
            vector[:k] += prior.precision @ (prior.mean - values[:k])
        self.latest = (runs, information)
        matrix = information.copy()
        matrix[np.arange(size, len(matrix)), np.arange(size, len(matrix))] += RIDGE
        if objective > self.last - NEAR:
            self.points.append((values, vector))
        self.last = objective
        secants = [(b[0] - a[0], a[1] - b[1]) for a, b in pairwise(self.points[-SECANTS - 1 :])]
        return Evaluation(objective, NormalEquations(with_secants(matrix, secants), vector))

    def move(self, values: Array, step: Array) -> Array:
        """Return unknowns after a step; one of the noise is one of its variance.

        That is exact for a channel of white noise.
        """
        size = self.likelihood.unknowns
        phi = values[size:] + 0.5 * np.log1p(2.0 * step[size:])
        return np.concatenate([values[:size] + step[:size], phi])

    def maximise(
        self,
        values: Array,
        lower: Array,
        upper: Array,
        *,
        most_steps: int,
        least_gain: float,
        longest_step: float,
    ) -> Optimum:
        """Return the optimum; `longest_step`: of the logarithms of the noise."""
        free = np.full(self.likelihood.unknowns, np.inf)
        shares = np.full(self.unknown.size, 2.0 * longest_step)
        return maximise(
            self.evaluate,
            values,
            np.zeros((0, 10)),
            lower=lower,
            upper=upper,
            most_steps=most_steps,
            tolerance=TOLERANCE,
            least_gain=least_gain,
            reach=(
                np.concatenate([-free, 0.5 * np.expm1(-shares)]),
                np.concatenate([free, 0.5 * np.expm1(shares)]),
            ),
            move=self.move,
        )
