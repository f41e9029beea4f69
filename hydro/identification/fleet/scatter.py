"""The scatter between dives as a distribution, and what follows from it.

A figure of dive i is y_i = mu + tau e_i + s_i f_i: a mean, the scatter between dives and
the error s_i of the fit, e_i and f_i standard normal. Three or four dives hardly
determine tau, so it is not one number here but weights on a grid, by the likelihood of
the contrasts (REML) and a prior 1/(s + tau), s the typical error. Where the figure changed
between dives, each level has a mean of its own, and all of them one tau. Functions take
arrays (..., k) of fleets of k dives; the grid is the last axis but one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array

GRID = 160
"""Values of tau, in equal steps of its logarithm: 9 steps a decade at least."""
LEAST_TAU, MOST_TAU = 1e-3, 3e3
"""Ends of the grid: of the typical error, and of the scatter of the estimates."""
LIKE_OTHERS = 0.7
"""Width, in the logarithm, of what is expected of a scatter from that of like figures."""
MOST_STEPS = 60
"""Towards a quantile."""


@dataclass(frozen=True)
class BetweenDives:
    """Weights (..., g) on values of tau (..., g), and at each of them the mean.

    `log_weight`: logarithms, since a change of level can make weights of 1e-400 count.
    `mean`, `mean_variance` (..., g): of mu given tau, of the last level. `log_likelihood`
    (..., g): of the contrasts (REML), without prior. `squares` (..., g): Q(tau), sum of
    squares of the estimates about the mean of their level over their variances.
    """

    tau: Array
    log_weight: Array
    mean: Array
    mean_variance: Array
    log_likelihood: Array
    squares: Array

    @property
    def weight(self) -> Array:
        """Return the weights (..., g) themselves."""
        return np.exp(self.log_weight)

    def mean_quantile(self, share: float) -> Array:
        """Return the quantile (...) of the mean of the dives of the last level."""
        return _quantile(share, self.weight, self.mean, np.sqrt(self.mean_variance))

    def next_dive_quantile(self, share: float, error: ArrayLike = 0.0) -> Array:
        """Return the quantile (...) of what a further dive shows with `error` (...).

        Error 0: of its true figure.
        """
        return _quantile(share, self.weight, self.mean, self._next_dive_sd(error))

    def next_dive_share(
        self, value: ArrayLike, error: ArrayLike = 0.0, *, more: bool = False
    ) -> Array:
        """Return the probability (...) that a further dive shows less than `value`.

        `more`: that it shows more, to as many digits.
        """
        from scipy.special import ndtr

        away = np.asarray(value, dtype=np.float64)[..., None] - self.mean
        score = (-away if more else away) / self._next_dive_sd(error)
        return np.asarray((self.weight * ndtr(score)).sum(axis=-1))

    def tau_quantile(self, share: float) -> Array:
        """Return the quantile (...) of tau."""
        below = np.cumsum(self.weight, axis=-1) - 0.5 * self.weight
        at = np.clip(np.argmax(below >= share, axis=-1), 1, GRID - 1)[..., None]
        at_low = np.take_along_axis(below, at - 1, axis=-1)
        part = (share - at_low) / (np.take_along_axis(below, at, axis=-1) - at_low)
        tau = np.take_along_axis(self.tau, at - 1, axis=-1) * (1.0 - part)
        return np.asarray(tau + np.take_along_axis(self.tau, at, axis=-1) * part)[..., 0]

    @property
    def tau_reml(self) -> Array:
        """Return the tau (...) of the largest restricted likelihood.

        A parabola through the largest value on the grid and its neighbours.
        """
        at = np.argmax(self.log_likelihood, axis=-1)[..., None]
        middle = np.clip(at, 1, GRID - 2)
        left, top, right = (
            np.take_along_axis(self.log_likelihood, middle + step, axis=-1) for step in (-1, 0, 1)
        )
        tau = np.take_along_axis(self.tau, middle, axis=-1)
        step = np.log(tau / np.take_along_axis(self.tau, middle - 1, axis=-1))
        curvature = np.minimum(left - 2.0 * top + right, -1e-300)
        peak = tau * np.exp(0.5 * step * np.clip((left - right) / curvature, -2.0, 2.0))
        return np.where(at == 0, 0.0, peak)[..., 0]

    def _next_dive_sd(self, error: ArrayLike) -> Array:
        own = np.asarray(error, dtype=np.float64)[..., None]
        return np.asarray(np.sqrt(self.mean_variance + self.tau**2 + own**2))


def between_dives(
    values: ArrayLike,
    errors: ArrayLike,
    *,
    levels: ArrayLike | None = None,
    grid: int = GRID,
    expected: ArrayLike | None = None,
) -> BetweenDives:
    """Return the scatter between dives of values and standard errors (..., k).

    `levels` (..., k): 0, 1 ... up to the last level, the number of changes before each
    dive; None for no change. `grid`: values of tau. `expected` (...): scatter of a dive,
    tau and error together, that like figures show; nan for none.

    With w_i = 1 / (s_i^2 + tau^2), mu_l = sum w y / sum w of the dives of level l,
    Q = sum_l sum w (y - mu_l)^2:
        2 log L = sum log w - sum_l log sum w - Q,   weight ~ L / (s + tau) d tau.
    With an expected scatter e the weight has a factor 1 / (1 + z^2) beside it,
    z = log(sqrt(tau^2 + s^2) / e) / .7: a Cauchy's tails, which data overrule.
    Where tau is far above all errors, the figure of a further dive then has Student's
    distribution with k - 1 degrees of freedom, as it has to.

    >>> sure = between_dives([1.0, 2.0, 3.0, 4.0, 5.0], np.full(5, 1e-6))
    >>> bool(abs(sure.next_dive_quantile(0.975) - (3.0 + 2.776 * np.sqrt(2.5 * 1.2))) < 0.02)
    True
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    level = np.zeros(y.shape, dtype=np.int64) if levels is None else np.asarray(levels)
    of_level = [level == number for number in range(int(level.max()) + 1)]
    typical = typical_error(s)
    away = sum(
        (own * (y - (own * y).sum(axis=-1, keepdims=True) / own.sum(axis=-1, keepdims=True)) ** 2
         for own in of_level), np.zeros(y.shape)
    )  # fmt: skip
    freedom = max(y.shape[-1] - len(of_level), 1)
    one_level = len(of_level) == 1
    spread = np.maximum(typical, np.sqrt(away.sum(axis=-1) / freedom))
    low, high = np.log(LEAST_TAU * typical), np.log(MOST_TAU * spread)
    tau = np.exp(low[..., None] + (high - low)[..., None] * np.linspace(0.0, 1.0, grid))
    every = 1.0 / (s[..., None, :] ** 2 + tau[..., None] ** 2)
    likelihood = 0.5 * np.log(every).sum(axis=-1)
    squares = np.zeros(tau.shape)
    for own in of_level:
        weight = every if one_level else every * own[..., None, :]
        total = weight.sum(axis=-1)
        mean = (weight @ y[..., None])[..., 0] / total
        away = y[..., None, :] - mean[..., None]
        away *= away
        away *= weight
        squares += away.sum(axis=-1)
        likelihood -= 0.5 * np.log(total)
    likelihood -= 0.5 * squares
    # tau: equal steps of the logarithm.
    posterior = likelihood + np.log(tau / (typical[..., None] + tau))
    if expected is not None:
        posterior -= np.nan_to_num(
            _unlike(tau, typical[..., None], np.asarray(expected)[..., None])
        )
    log_weight = posterior - np.logaddexp.reduce(posterior, axis=-1, keepdims=True)
    return BetweenDives(tau, log_weight, mean, 1.0 / total, likelihood, squares)


def _unlike(tau: Array, typical: Array, expected: Array) -> Array:
    """Return log(1 + z^2) of how far scatters (..., g) are from what is expected."""
    z = np.log(np.hypot(tau, typical) / expected) / LIKE_OTHERS
    return np.asarray(np.log1p(z**2))


def typical_error(errors: ArrayLike) -> Array:
    """Return the typical standard error (...) of dives with errors (..., k).

    s^2 = (k - 1) sum w / ((sum w)^2 - sum w^2), w = 1 / s_i^2: Higgins and Thompson
    2002, equation (9).

    >>> float(typical_error([2.0, 2.0, 2.0]))
    2.0
    """
    w = 1.0 / np.asarray(errors, dtype=np.float64) ** 2
    total = w.sum(axis=-1)
    return np.asarray(np.sqrt((w.shape[-1] - 1) * total / (total**2 - (w**2).sum(axis=-1))))


def _quantile(share: float, weight: Array, mean: Array, sd: Array) -> Array:
    """Return the quantile (...) of normals with weights (..., g).

    Newton's steps; where one leaves the interval in which the quantile lies, that is halved.
    """
    from scipy.special import ndtr

    low, high = (mean - 40.0 * sd).min(axis=-1), (mean + 40.0 * sd).max(axis=-1)
    exact = 1e-14 * (high - low)
    density = weight / (sd * np.sqrt(2.0 * np.pi))
    at = np.asarray((weight * mean).sum(axis=-1))
    for _ in range(MOST_STEPS):
        score = (at[..., None] - mean) / sd
        excess = (weight * ndtr(score)).sum(axis=-1) - share
        low, high = np.where(excess < 0.0, at, low), np.where(excess < 0.0, high, at)
        slope = (density * np.exp(-0.5 * score**2)).sum(axis=-1)
        near = at - excess / np.maximum(slope, 1e-300)
        after = np.where((low < near) & (near < high), near, 0.5 * (low + high))
        moved, at = np.abs(after - at), after
        if np.all(moved <= exact):
            break
    return at
