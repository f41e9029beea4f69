"""What an estimator returns, and the covariance of it.

Standard errors: the inverse of the information matrix where errors are white, as they
are for a true model; the sandwich with long-run moments of the scores where they are
not (White 1982; Newey and West 1987); windows left out where these do not agree.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.maximum_likelihood.agreement import Agreement, PartEquations
from auvid.hydro.identification.maximum_likelihood.gauss_newton import solve_scaled
from auvid.hydro.identification.maximum_likelihood.likelihood import (
    Likelihood,
    NoiseModel,
    WindowRun,
)
from auvid.hydro.identification.maximum_likelihood.records import CHANNELS
from auvid.hydro.identification.maximum_likelihood.windows import DroppedWindow
from auvid.hydro.identification.regression.standard_errors import automatic_lags, long_run_moment


@dataclass(frozen=True)
class LegEquations:
    """Information (g, g) and minus gradient (g,) of a leg by all unknowns."""

    information: Array
    vector: Array


@dataclass(frozen=True)
class LikelihoodEstimate:
    """Parameters theta (k,) in the order of `names`, with what belongs to them.

    `covariance` (k, k): the one to use; `information_covariance` (k, k): for white
    errors. `biases` (legs, 6): accelerometer, gyro, in sensor axes; `bias_sd` likewise.
    `noise`: standard deviations of samples, and the unsteady force where it was
    estimated. `log_likelihood`: after each step taken. `weighted_residual`: root mean
    square of errors in parts of their standard deviations, 1 for a model that explains
    its data; `channel_residuals` (13,) the same by channel, nan without samples.
    `word`: `converged`, or `no convergence` for the best point of the steps allowed;
    `at_bound` (k,). `leg_equations`: what each leg tells of all unknowns, theta first,
    and `prior_equations` the prior; `unknowns_at_bound`: which
    of them are at a bound. `agreement`: whether the windows agree; None where that was
    not asked (filter error).
    """

    names: tuple[str, ...]
    theta: Array
    covariance: Array
    information_covariance: Array
    coefficients: dict[str, dict[str, float]]
    biases: Array
    bias_sd: Array
    noise: NoiseModel
    log_likelihood: tuple[float, ...]
    weighted_residual: float
    channel_residuals: Array
    word: str
    at_bound: Mask
    windows: int
    dropped: tuple[DroppedWindow, ...]
    leg_equations: tuple[LegEquations, ...]
    prior_equations: LegEquations
    unknowns_at_bound: Mask
    agreement: Agreement | None = None

    @property
    def windows_agree(self) -> bool:
        """Return whether no window speaks against the others."""
        return self.agreement is None or self.agreement.holds

    @property
    def standard_errors(self) -> Array:
        """Return standard errors (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def intervals(self) -> Array:
        """Return normal 95 % intervals (k, 2)."""
        half = NORMAL_95 * self.standard_errors
        return np.stack([self.theta - half, self.theta + half], axis=-1)

    def without(self, legs: Collection[int]) -> Array:
        """Return theta (k,) that all legs but these give, by one step from the optimum.

        theta + sum(N)^-1 sum(b) over the other legs: N, b information and minus gradient
        of a leg. Exact where the log-likelihood is a parabola; no leg is run again.
        """
        others = [item for i, item in enumerate(self.leg_equations) if i not in legs]
        parts = [*others, self.prior_equations]
        information = np.sum([part.information for part in parts], axis=0)
        vector = np.sum([part.vector for part in parts], axis=0)
        informed = ~self.unknowns_at_bound & (np.diag(information) > 0.0)
        step = np.zeros(len(vector))
        step[informed] = solve_scaled(information[np.ix_(informed, informed)], vector[informed])
        return np.asarray(self.theta + step[: len(self.theta)])


def estimate_from(
    likelihood: Likelihood,
    common: Array,
    runs: Sequence[WindowRun],
    noise: NoiseModel,
    *,
    information: Array,
    moment: Array,
    at_bound: Mask,
    word: str,
    log_likelihood: Sequence[float],
    dropped: Sequence[DroppedWindow],
    leg_equations: Sequence[LegEquations],
    parts: PartEquations | None = None,
) -> LikelihoodEstimate:
    """Return the estimate at `common` unknowns.

    `information` (n, n) and long-run `moment` (n, n) of the scores of all unknowns,
    those of `common` first; `at_bound` (n,); `leg_equations` without the prior; `parts`:
    what windows tell, to see whether they agree.
    """
    theta, biases = likelihood.split(common)
    k, g = len(theta), len(common)
    informed = ~at_bound & (np.diag(information) > 0.0)
    inverse, robust = np.full((2, *information.shape), np.nan)
    cell = np.ix_(informed, informed)
    inverse[cell] = solve_scaled(information[cell], np.eye(int(informed.sum())))
    robust[cell] = inverse[cell] @ moment[cell] @ inverse[cell]
    prior = _prior_equations(likelihood, theta, len(information))
    agreement = None if parts is None else parts.agreement(informed)
    if parts is not None and agreement is not None and not agreement.holds:
        robust = parts.left_out_covariance(informed, prior.information)
    covariance = _larger(inverse, robust)
    errors = np.concatenate([run.errors / np.sqrt(run.variances) for run in runs])
    channel = np.concatenate([run.channel for run in runs])
    squares = np.bincount(channel, weights=errors**2, minlength=len(CHANNELS))
    samples = np.bincount(channel, minlength=len(CHANNELS))
    return LikelihoodEstimate(
        names=likelihood.parameters.names,
        theta=theta,
        covariance=covariance[:k, :k],
        information_covariance=inverse[:k, :k],
        coefficients=likelihood.parameters.coefficients(theta),
        biases=biases,
        bias_sd=np.sqrt(np.diag(inverse)[k:g]).reshape(biases.shape),
        noise=noise,
        log_likelihood=tuple(log_likelihood),
        weighted_residual=float(np.sqrt(np.mean(errors**2))),
        channel_residuals=np.sqrt(squares / np.where(samples > 0, samples, np.nan)),
        word=word,
        at_bound=at_bound[:k],
        windows=len(likelihood.windows),
        dropped=tuple(dropped),
        leg_equations=tuple(leg_equations),
        prior_equations=prior,
        unknowns_at_bound=at_bound,
        agreement=agreement,
    )


def _prior_equations(likelihood: Likelihood, theta: Array, size: int) -> LegEquations:
    matrix, vector, k = np.zeros((size, size)), np.zeros(size), len(theta)
    if likelihood.prior is not None:
        matrix[:k, :k] = likelihood.prior.precision
        vector[:k] = likelihood.prior.precision @ (likelihood.prior.mean - theta)
    return LegEquations(matrix, vector)


def _larger(white: Array, robust: Array) -> Array:
    """Return `robust` with variances no smaller than `white`."""
    robust = robust + np.diag(np.where(np.diag(robust) == 0.0, np.diag(white), 0.0))
    ratio = np.sqrt(np.maximum(np.diag(white) / np.diag(robust), 1.0))
    return np.asarray(robust * np.outer(ratio, ratio))


def score_moment(likelihood: Likelihood, scores: Sequence[Array]) -> Array:
    """Return the long-run moment (n, n) of scores (moments, n), a series per window.

    Windows of one leg follow each other, legs are independent. A prior counts with its
    precision.
    """
    n = scores[0].shape[1]
    total = np.zeros((n, n))
    for leg in range(len(likelihood.legs)):
        parts = [
            part
            for window, part in zip(likelihood.windows, scores, strict=True)
            if window.leg == leg
        ]
        if parts:
            series = np.vstack(parts)
            used = np.any(series != 0.0, axis=0)
            lags = automatic_lags(series[:, used])
            total[np.ix_(used, used)] += long_run_moment(series[:, used], lags=lags)
    if likelihood.prior is not None:
        k = len(likelihood.parameters.names)
        total[:k, :k] += likelihood.prior.precision
    return total


def projected_scores(
    likelihood: Likelihood, runs: Sequence[WindowRun], rows: Sequence[Array]
) -> list[Array]:
    """Return the scores J' W e (moments, n) of each window.

    rows: of `projected_rows`.
    """
    out = []
    for window, run, own in zip(likelihood.windows, runs, rows, strict=True):
        scores = np.zeros((len(window.t_s), likelihood.unknowns))
        sums = np.zeros((len(window.t_s), own.shape[1]))
        np.add.at(sums, run.moment, own * (run.errors / run.variances)[:, None])
        scores[:, likelihood.places(window.leg)] = sums
        out.append(scores)
    return out
