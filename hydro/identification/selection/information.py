"""The Bayesian information criterion for coloured residuals.

Schwarz 1978, with the number of independent samples in place of the number of samples:
residuals of filtered signals at 50 Hz stay correlated over seconds, and each sample
counted as one would admit nearly every term.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.regression.standard_errors import (
    automatic_lags,
    long_run_moment,
)


def inflation(residuals: Iterable[ArrayLike], *, lags: int | None = None) -> Array:
    """Return how many samples count as one: long-run over sample variance, at least 1.

    residuals: one series (n,) or (n, k) per unbroken segment, gone through once; lags
    None: `automatic_lags` of each. Returned are (k,), () for (n,). A first-order
    autoregression with coefficient rho has (1 + rho) / (1 - rho). Raises `DataError` for
    no sample.
    """
    sums: list[Array] = []
    for part in residuals:
        e = np.asarray(part, dtype=np.float64)
        columns = e.reshape(len(e), -1).T[..., None]
        moment = [
            long_run_moment(c, lags=automatic_lags(c) if lags is None else lags)[0, 0]
            for c in columns
        ]
        if len(e):
            sums.append(np.array([np.reshape(moment, e.shape[1:]), np.sum(e**2, axis=0)]))
    if not sums:
        raise DataError("no residual to count independent samples in")
    long_run, square = np.sum(sums, axis=0)
    ratio = np.divide(long_run, square, out=np.ones_like(square), where=square > 0.0)
    return np.asarray(np.maximum(1.0, ratio))


def bic(sse: float, terms: int, *, n_samples: int, samples_per_one: float = 1.0) -> float:
    """Return m ln(SSE / n) + k ln m with m = n / `samples_per_one` independent samples.

    Lower is better; differences below 2 say little. -inf for a perfect fit.

    >>> round(bic(50.0, 2, n_samples=100) - bic(52.0, 1, n_samples=100), 3)
    0.683
    """
    m = n_samples / samples_per_one
    return m * math.log(sse / n_samples) + terms * math.log(m) if sse > 0.0 else -math.inf
