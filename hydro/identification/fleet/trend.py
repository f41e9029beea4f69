"""The trend of a figure over the time of dives, given only where it is clear.

y_i = mu + b t_i + tau e_i + s_i f_i with the scatter between dives uncertain as in
`scatter.py`: for each tau on its grid a weighted line, and the slope b is a mixture of
normals with the weights of the contrasts of mean and line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.pooling import Interval, numbers_of
from auvid.hydro.identification.fleet.scatter import (
    BetweenDives,
    between_dives,
    typical_error,
)

FEWEST_DIVES = 5
"""Fewer dives say no trend: a line through four leaves two for their scatter."""
LEVEL = 0.95
"""Of the interval of the slope."""
CLEAR = 0.98
"""A trend is clear where the interval at this level leaves out 0."""


@dataclass(frozen=True)
class Trend:
    """The slope of a figure over time, in its unit per unit of the times.

    interval: 95 %. middle: value at the mean time of the dives. clear: whether it differs
    from 0 beyond what dives scatter; nothing else of a trend should be printed.
    """

    dives: int
    slope: float
    interval: Interval
    middle: float
    clear: bool


def trend(times: ArrayLike, values: ArrayLike, errors: ArrayLike) -> Trend | None:
    """Return the trend of values (k,) with standard errors (k,) at times (k,).

    nan where a dive has no number; None for fewer than five dives that have one. Raises
    `DataError` where all times are equal.
    """
    t, y = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    present = np.isfinite(t) & np.isfinite(y) & np.isfinite(np.asarray(errors, dtype=np.float64))
    y, s = numbers_of(np.where(present, y, np.nan), errors)
    t = t[present]
    if len(y) < FEWEST_DIVES:
        return None
    if np.ptp(t) == 0.0:
        raise DataError("all dives have one time", value=float(t[0]), allowed="different times")
    middle_time, span = float(t.mean()), float(np.ptp(t))
    line = slopes((t - middle_time) / span, y, s)
    low, high = (
        float(line.mean_quantile(share)) / span for share in (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL)
    )
    ends = [float(line.mean_quantile(share)) for share in (0.5 - 0.5 * CLEAR, 0.5 + 0.5 * CLEAR)]
    slope = float(line.weight @ line.mean) / span
    weight = 1.0 / (s**2 + float(line.tau_reml) ** 2)
    middle = float(np.average(y - slope * (t - middle_time), weights=weight))
    return Trend(len(y), slope, (low, high), middle, ends[0] * ends[1] > 0.0)


def slopes(times: Array, values: Array, errors: Array) -> BetweenDives:
    """Return the slope of values (..., k) over times (k,) as a `BetweenDives`.

    Its `mean` is the slope given tau, its weights those of what lies about the line:
        b = S_ty / S_tt,   2 log L = sum log w - log sum w - log S_tt - Q.
    """
    # The grid: of the values about the plain line.
    line = np.polynomial.polynomial.polyfit(times, values.reshape(-1, values.shape[-1]).T, 1)
    flat = values - (line[0][:, None] + line[1][:, None] * times).reshape(values.shape)
    tau = between_dives(flat, errors).tau
    w = 1.0 / (errors[..., None, :] ** 2 + tau[..., None] ** 2)
    total = w.sum(axis=-1)
    t_mean = (w * times).sum(axis=-1) / total
    y_mean = (w * values[..., None, :]).sum(axis=-1) / total
    dt, dy = times - t_mean[..., None], values[..., None, :] - y_mean[..., None]
    s_tt = (w * dt**2).sum(axis=-1)
    slope = (w * dt * dy).sum(axis=-1) / s_tt
    squares = (w * (dy - slope[..., None] * dt) ** 2).sum(axis=-1)
    likelihood = 0.5 * (np.log(w).sum(axis=-1) - np.log(total * s_tt) - squares)
    posterior = likelihood + np.log(tau / (typical_error(errors)[..., None] + tau))
    log_weight = posterior - np.logaddexp.reduce(posterior, axis=-1, keepdims=True)
    return BetweenDives(tau, log_weight, slope, 1.0 / s_tt, likelihood, squares)
