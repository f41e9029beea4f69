"""The trend of a figure over the time of dives, given only where it is clear.

y_i = mu + b t_i + tau e_i + s_i f_i with the scatter between dives uncertain as in
`scatter.py`, and e_i of neighbouring dives correlated by rho per dive, uncertain as well:
what drifts slowly (water, tether, battery) looks like a trend. For each (tau, rho) of a
grid a line by generalised least squares; the slope is a mixture of normals with the
weights of the contrasts of mean and line,

    2 log L = -log |V| - log |X' V^-1 X| - Q,   V = tau^2 rho^|i-j| + diag s^2.

Of all figures looked at, those are clear that the false discovery rate allows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.pooling import Interval, numbers_of
from auvid.hydro.identification.fleet.scatter import BetweenDives, between_dives, typical_error

FEWEST_DIVES = 5
"""Fewer dives say no trend: a line through four leaves two for their scatter."""
MOST_DIVES = 40
"""More are averaged in groups of neighbours."""
LEVEL = 0.95
"""Of the interval of the slope."""
FALSE_TRENDS = 0.05
"""Share of the trends called clear that are none (Benjamini and Hochberg 1995)."""
CORRELATIONS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9)
"""rho, each as probable as the others."""
GRID = 40
"""Values of tau."""


@dataclass(frozen=True)
class Trend:
    """The slope of a figure over time, in its unit per unit of the times.

    interval: 95 %. middle: value at the mean time of the dives. p: probability of so
    large a slope where there is none, two-sided.
    """

    dives: int
    slope: float
    interval: Interval
    middle: float
    p: float


def trend(times: ArrayLike, values: ArrayLike, errors: ArrayLike) -> Trend | None:
    """Return the trend of values (k,) with standard errors (k,) at times (k,).

    nan where a dive has no number; None for fewer than five dives that have one. Raises
    `DataError` where all times are equal.
    """
    t, y = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    present = np.isfinite(t) & np.isfinite(y) & np.isfinite(np.asarray(errors, dtype=np.float64))
    y, s = numbers_of(np.where(present, y, np.nan), errors)
    t = t[present]
    dives = len(y)
    if dives < FEWEST_DIVES:
        return None
    if np.ptp(t) == 0.0:
        raise DataError("all dives have one time", value=float(t[0]), allowed="different times")
    order = np.argsort(t, kind="stable")
    t, y, s = _grouped(t[order], y[order], s[order])
    middle_time, span = float(t.mean()), float(np.ptp(t))
    line = slopes((t - middle_time) / span, y, s)
    low, high = (
        float(line.mean_quantile(share)) / span for share in (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL)
    )
    slope = float(line.weight @ line.mean) / span
    weight = 1.0 / (s**2 + float(line.tau[np.argmax(line.log_likelihood)]) ** 2)
    middle = float(np.average(y - slope * (t - middle_time), weights=weight))
    from scipy.special import ndtr

    below = float(line.weight @ ndtr(-line.mean / np.sqrt(line.mean_variance)))
    return Trend(dives, slope, (low, high), middle, 2.0 * min(below, 1.0 - below))


def clear_trends(trends: Mapping[object, Trend | None]) -> set[object]:
    """Return which of all trends looked at are clear: so few of them are false.

    >>> span = [0.5, 1.5]
    >>> clear_trends({p: Trend(9, 1.0, span, 3.0, p) for p in [0.02, 0.4]})
    {0.02}
    """
    looks = sorted(
        ((item.p, name) for name, item in trends.items() if item is not None),
        key=lambda look: look[0],
    )
    most = 0
    for rank, (p, _) in enumerate(looks, start=1):
        if p <= FALSE_TRENDS * rank / len(looks):
            most = rank
    return {name for _, name in looks[:most]}


def _grouped(times: Array, values: Array, errors: Array) -> tuple[Array, Array, Array]:
    """Return dives in order of time, averaged in groups where there are too many."""
    size = -(-len(times) // MOST_DIVES)
    if size == 1:
        return times, values, errors
    # One figure that is hardly known takes nothing from its neighbours.
    weights = 1.0 / (errors**2 + typical_error(errors) ** 2)
    starts = np.arange(0, len(times), size)
    total = np.add.reduceat(weights, starts)
    return (
        np.add.reduceat(weights * times, starts) / total,
        np.add.reduceat(weights * values, starts) / total,
        np.sqrt(np.add.reduceat((weights * errors) ** 2, starts)) / total,
    )


def slopes(times: Array, values: Array, errors: Array) -> BetweenDives:
    """Return the slope of values (k,) over times (k,), in order, as a `BetweenDives`.

    Its `mean` is the slope given tau and rho, its weights those of what lies about the
    line.
    """
    plain = np.polynomial.polynomial.polyfit(times, values, 1)
    # The grid: of the values about the plain line.
    tau = between_dives(values - plain[0] - plain[1] * times, errors, grid=GRID).tau
    steps = np.abs(np.subtract.outer(np.arange(len(times)), np.arange(len(times))))
    design = np.stack([np.ones_like(times), times, values], axis=-1)
    parts = []
    for rho in CORRELATIONS:
        alike = np.power(rho, steps) if rho else np.eye(len(times))
        variance = tau[:, None, None] ** 2 * alike + np.diag(errors**2)
        factor = np.linalg.cholesky(variance)
        white = np.linalg.solve(factor, np.broadcast_to(design, (len(tau), *design.shape)))
        x, y = white[..., :2], white[..., 2:]
        normal = np.swapaxes(x, -1, -2) @ x
        inverse = np.linalg.inv(normal)
        estimate = inverse @ (np.swapaxes(x, -1, -2) @ y)
        squares = ((y - x @ estimate) ** 2).sum(axis=(-1, -2))
        spread = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
        likelihood = -spread - 0.5 * (np.linalg.slogdet(normal)[1] + squares)
        parts.append((likelihood, estimate[:, 1, 0], inverse[:, 1, 1], squares))
    likelihood, mean, variance, squares = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    every = np.tile(tau, len(CORRELATIONS))
    posterior = likelihood + np.log(every / (typical_error(errors) + every))
    log_weight = posterior - np.logaddexp.reduce(posterior)
    return BetweenDives(every, log_weight, mean, variance, likelihood, squares)
