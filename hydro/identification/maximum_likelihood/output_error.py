"""Output error for six degrees of freedom: free runs in windows against all sensors.

The coefficients, biases and starts of windows whose simulated motion is nearest to the
samples, each weighted by its channel's standard deviation, which is estimated with
them: maximum likelihood for white sensor noise and a vehicle that nothing unknown
pushes (Maine and Iliff 1985; Jategaonkar 2015, chapter 4). Nothing measured enters a
regressor, so that the noise of velocities gives no bias. With an unsteady force take
`filter_error`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.maximum_likelihood.agreement import (
    part_equations,
    projected_rows,
)
from auvid.hydro.identification.maximum_likelihood.estimate import (
    LegEquations,
    LikelihoodEstimate,
    estimate_from,
    projected_scores,
    score_moment,
)
from auvid.hydro.identification.maximum_likelihood.gauss_newton import Optimum, maximise
from auvid.hydro.identification.maximum_likelihood.likelihood import (
    BIASES,
    Likelihood,
    NoiseModel,
    WindowRun,
)
from auvid.hydro.identification.maximum_likelihood.parameters import (
    ParameterPrior,
    UnknownParameters,
)
from auvid.hydro.identification.maximum_likelihood.records import (
    CHANNELS,
    SMALLEST_SD,
    LegRecord,
    rough_sd,
)
from auvid.hydro.identification.maximum_likelihood.windows import cut_windows

WINDOW_S = 20.0
"""Length of a free run where the leg allows it [s] (decision 0022)."""
ROUNDS, STEPS, TOLERANCE = 6, 30, 1e-3
IDLE_STEPS, IDLE_GAIN = 10, 1.0
"""A round that gained less in its last steps is at its end though unknowns that the data
hardly tell still move: .01 in fits that then converge, 100 and more under an unsteady
force.
"""
SETTLED = 0.02
"""Relative change of a standard deviation of samples that ends the rounds."""
PROBE_STEPS = 3
"""Steps after which a doubtful fit is asked how far its free runs miss the samples."""


class RunsMissError(DataError):
    """Free runs that miss the samples by more than these scatter."""


def fit_output_error(
    legs: Sequence[LegRecord],
    parameters: UnknownParameters,
    start: Mapping[str, float] | Array,
    *,
    prior: ParameterPrior | None = None,
    window_s: float = WINDOW_S,
    sensor_sd: Array | None = None,
    biases: Array | None = None,
    tolerance: float = TOLERANCE,
    most_missed: float | None = None,
    most_steps: int | None = None,
) -> LikelihoodEstimate:
    """Fit theta from `start`, by name or as vector, to windows of the legs.

    `sensor_sd` (13,): known standard deviations of the samples, else estimated.
    `biases` (legs, 6): where the biases start from. `tolerance`: the last step in parts
    of a standard error. A round that still gains at the end of its steps is the last.
    `most_missed`: what free runs may miss the samples by after `PROBE_STEPS`, root mean square
    in parts of the samples' scatter; None: anything. `most_steps`: of all rounds
    together, None: those of each.
    Raises `DataError` where legs are
    shorter than a window, samples fewer than unknowns, or the start diverges, and
    `RunsMissError` where free runs miss more.
    """
    windows, dropped = cut_windows(legs, length_s=window_s)
    likelihood = Likelihood(legs, windows, parameters, False, np.ones(10), prior)
    theta = parameters.vector(start) if isinstance(start, Mapping) else np.asarray(start)
    first = np.zeros((len(legs), BIASES)) if biases is None else np.asarray(biases)
    common = np.concatenate([theta, first.ravel()])
    starts = likelihood.first_starts(first)
    require_samples(likelihood, likelihood.unknowns + starts.size)
    lower, upper = likelihood_bounds(likelihood)
    noise = NoiseModel(rough_sd(list(legs)) if sensor_sd is None else sensor_sd)
    history: list[float] = []

    def ascend(noise: NoiseModel, steps: int) -> Optimum:
        return maximise(
            likelihood.under(noise),
            common,
            starts,
            lower=lower,
            upper=upper,
            most_steps=steps,
            tolerance=tolerance,
        )

    if most_missed is not None:
        optimum = ascend(noise, PROBE_STEPS)
        common, starts = optimum.common, optimum.local
        history += [-value for value in optimum.objectives]
        missed = _missed(likelihood.run(common, starts, noise, sensitive=False))
        if missed > most_missed:
            raise RunsMissError(
                f"its free runs miss the samples by {missed:.3g} times their scatter",
                allowed=f"at most {most_missed:g}",
            )
    for _ in range(ROUNDS):
        used = noise
        left = STEPS if most_steps is None else max(most_steps - len(history), 0)
        optimum = ascend(used, min(STEPS, left))
        common, starts = optimum.common, optimum.local
        history += [-value for value in optimum.objectives]
        final, runs = likelihood.evaluate(common, starts, noise, sensitive=True)
        # What free runs explain is found in some ten steps; no noise mends the rest.
        if sensor_sd is not None or not (optimum.word == "converged" or _idle(optimum)):
            break
        noise = NoiseModel(residual_sd(runs, likelihood.unknowns + starts.size))
        change = np.abs(noise.sensor_sd / used.sensor_sd - 1.0)
        if np.nanmax(change) < SETTLED:
            break
    assert final.equations is not None
    information, _ = final.equations.reduced()
    rows = projected_rows(likelihood, final.equations, runs)
    return estimate_from(
        likelihood,
        common,
        runs,
        used,
        information=information,
        moment=score_moment(likelihood, projected_scores(likelihood, runs, rows)),
        at_bound=optimum.at_bound,
        word=optimum.word,
        log_likelihood=history,
        dropped=dropped,
        leg_equations=[
            LegEquations(*part.normal_equations(own, part.split(common)[0]).reduced())
            for part, own in likelihood.by_leg(runs)
        ],
        parts=part_equations(likelihood, runs, rows),
    )


def _missed(runs: Sequence[WindowRun]) -> float:
    """Return the root mean square of errors in parts of their standard deviations."""
    return float(np.sqrt(np.mean(np.concatenate([r.errors**2 / r.variances for r in runs]))))


def _idle(optimum: Optimum) -> bool:
    """Return whether the last steps gained next to nothing."""
    late = optimum.objectives[-IDLE_STEPS - 1 :]
    return len(late) > IDLE_STEPS and late[0] - late[-1] < IDLE_GAIN


def likelihood_bounds(likelihood: Likelihood) -> tuple[Array, Array]:
    """Return bounds of theta and, infinite, of biases."""
    low, high = likelihood.parameters.bounds
    none = np.full(likelihood.unknowns - len(low), np.inf)
    return np.concatenate([low, -none]), np.concatenate([high, none])


def require_samples(likelihood: Likelihood, unknowns: int) -> None:
    """Raise `DataError` where there are no more samples than unknowns."""
    samples = sum(window.samples for window in likelihood.windows)
    if samples <= unknowns:
        raise DataError(
            "fewer samples than unknowns",
            value=samples,
            allowed=f"more than {unknowns}",
            remedy="Take longer legs, or fewer terms.",
        )


def residual_sd(runs: Sequence[WindowRun], unknowns: int) -> Array:
    """Return standard deviations of errors by channel (13,), nan without samples.

    Each channel pays for the unknowns in proportion to its samples.
    """
    errors = np.concatenate([run.errors for run in runs])
    channel = np.concatenate([run.channel for run in runs])
    count = np.bincount(channel, minlength=len(CHANNELS)).astype(float)
    sums = np.bincount(channel, weights=errors**2, minlength=len(CHANNELS))
    count[count == 0.0] = np.nan
    variance = sums / (count * (1.0 - unknowns / len(errors)))
    return np.asarray(np.maximum(np.sqrt(variance), SMALLEST_SD))
