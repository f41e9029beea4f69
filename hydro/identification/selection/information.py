"""The Bayesian information criterion for coloured residuals.

Schwarz 1978, with the number of independent samples in place of the number of samples:
residuals of filtered signals at 50 Hz stay correlated over seconds, and each sample
counted as one would admit nearly every term.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.regression.standard_errors import (
    automatic_lags,
    long_run_moment,
)


def inflation(residuals: Sequence[ArrayLike], *, lags: int | None = None) -> float:
    """Return how many samples count as one: long-run over sample variance, at least 1.

    residuals: one series (n,) per unbroken segment; lags None: `automatic_lags` of
    each. A first-order autoregression with coefficient rho has (1 + rho) / (1 - rho).
    Raises `DataError` for no sample.
    """
    moment, square = 0.0, 0.0
    for part in residuals:
        e = np.asarray(part, dtype=np.float64)[:, None]
        moment += float(long_run_moment(e, lags=automatic_lags(e) if lags is None else lags)[0, 0])
        square += float(np.sum(e**2))
    if not sum(len(np.asarray(part)) for part in residuals):
        raise DataError("no residual to count independent samples in")
    return max(1.0, moment / square) if square > 0.0 else 1.0


def bic(sse: float, terms: int, *, n_samples: int, samples_per_one: float = 1.0) -> float:
    """Return m ln(SSE / n) + k ln m with m = n / `samples_per_one` independent samples.

    Lower is better; differences below 2 say little. -inf for a perfect fit.

    >>> round(bic(50.0, 2, n_samples=100) - bic(52.0, 1, n_samples=100), 3)
    0.683
    """
    m = n_samples / samples_per_one
    return m * math.log(sse / n_samples) + terms * math.log(m) if sse > 0.0 else -math.inf
