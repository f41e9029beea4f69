"""Standard errors for coloured residuals: HAC covariance with Bartlett kernel.

It is consistent under heteroscedasticity and autocorrelation. Filtered signals at 50 Hz
have residuals that stay correlated over seconds; the white formula then gives standard
errors that are several times too small. Sources: Newey & West 1987 (estimator), Andrews
1991 (choice of lags).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.regression.least_squares import CONSTANT, AxisFit


def long_run_moment(scores: ArrayLike, *, lags: int) -> Array:
    """Return the long-run moment S (k, k) of an unbroken series of scores (n, k).

    S = sum over |j| <= L of (1 - |j| / (L + 1)) sum_t s_t s_t-j'. With B the sums of
    the zero-padded scores over windows of L + 1 samples, S = B'B / (L + 1): one
    cumulative sum, whatever L. Moments of separate segments add. Positive semidefinite.
    Raises `DataError` for negative lags.
    """
    s = np.asarray(scores, dtype=np.float64)
    if lags < 0:
        raise DataError("the number of lags must not be negative", value=lags)
    lags = min(int(lags), max(len(s) - 1, 0))
    total = np.zeros((len(s) + 2 * lags + 2, s.shape[1]))
    np.cumsum(s, axis=0, out=total[lags + 1 : lags + 1 + len(s)])
    total[lags + 1 + len(s) :] = total[lags + len(s)]
    windows = total[lags + 1 :] - total[: -lags - 1]
    return windows.T @ windows / (lags + 1)


def mapped(covariance: Array, by: Array) -> Array:
    """Return by C by' (m, m), no variance of which rounding makes negative.

    Where two figures are hardly told apart, by C by' is the small difference of large
    numbers. C (k, k) goes in as its root, and comes out positive semidefinite.
    """
    if not np.isfinite(covariance).all():
        return by @ covariance @ by.T
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale[scale == 0.0] = 1.0
    sizes, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = (by * scale) @ vectors * np.sqrt(np.maximum(sizes, 0.0))
    return np.asarray(root @ root.T)


def automatic_lags(scores: ArrayLike) -> int:
    """Return the lags of the Bartlett kernel for scores (n, k), by Andrews's rule.

    It takes each score for a first-order autoregression. L = 1.1447 (alpha n)^(1/3),
    alpha = sum 4 rho^2 s^4 / ((1-rho)^6 (1+rho)^2) / sum s^4 / (1-rho)^4, every score
    scaled to equal variance; at most a quarter of the series.
    """
    s = np.asarray(scores, dtype=np.float64)
    s = s - s.mean(axis=0)
    power = np.einsum("ij,ij->j", s, s)
    s, power = s[:, power > 0], power[power > 0]
    n = len(s)
    if n < 8 or not len(power):
        return 0
    rho = np.clip(np.einsum("ij,ij->j", s[1:], s[:-1]) / power, -0.97, 0.9999)
    innovation = (1.0 - rho**2) ** 2
    alpha = np.sum(innovation * 4 * rho**2 / ((1 - rho) ** 6 * (1 + rho) ** 2)) / np.sum(
        innovation / (1 - rho) ** 4
    )
    return int(min(np.floor(1.1447 * (alpha * n) ** (1.0 / 3.0)), n // 4))


def hac_covariance(
    scores: ArrayLike | Sequence[Array], bread: ArrayLike, *, lags: int | None = None
) -> Array:
    """Return the covariance (k, k) of least-squares coefficients: bread S bread.

    bread = (X'X)^-1 (k, k); times n / (n - k). scores: x_t e_t, design row times
    residual, (n, k), or a list of such arrays, one per unbroken segment; correlation
    across segments counts as none. lags None: `automatic_lags` of each segment.
    """
    segments = (
        [np.asarray(part, dtype=np.float64) for part in scores]
        if isinstance(scores, (list, tuple))
        else [np.asarray(scores)]
    )
    inverse = np.asarray(bread, dtype=np.float64)
    n = sum(len(part) for part in segments)
    middle = np.zeros_like(inverse)
    for part in segments:
        middle += long_run_moment(part, lags=automatic_lags(part) if lags is None else lags)
    return _sandwich(inverse, middle, n)


def stationary_covariance(
    jacobians: Sequence[Array],
    residuals: Sequence[Array],
    bread: ArrayLike,
    *,
    lags: int | None = None,
) -> Array:
    """Return the covariance (k, k) of a fit with residuals of one colour throughout.

    bread J' R J bread times n / (n - k). jacobians (n, k) and residuals (n,), one per
    unbroken series, scaled to equal weight; bread = (J'J)^-1 of them all. R is the
    Toeplitz matrix of the residual's autocovariance under Bartlett's taper. Other than
    `hac_covariance` it stays true where a few samples carry most of the information
    (the transient of a single step), but not where the noise changes along the run.
    lags None: `automatic_lags` of each residual.
    """
    inverse = np.asarray(bread, dtype=np.float64)
    middle, n = np.zeros_like(inverse), 0
    for rows, error in zip(jacobians, residuals, strict=True):
        most = min(automatic_lags(error[:, None]) if lags is None else lags, max(len(error) - 1, 0))
        for lag in range(most + 1):
            moment = (
                float(error[: len(error) - lag] @ error[lag:])
                / len(error)
                * (1.0 - lag / (most + 1))
            )
            product = rows[: len(rows) - lag].T @ rows[lag:]
            middle += moment * (product if lag == 0 else product + product.T)
        n += len(error)
    return _sandwich(inverse, middle, n)


@dataclass(frozen=True)
class CoefficientScores:
    """Long-run moment S (k, k) of the scores x_t e_t of a fit, over `n` samples so far.

    Segments are added one at a time; correlation across segments counts as none.
    lags None: `automatic_lags` of each segment.
    """

    fit: AxisFit
    lags: int | None
    middle: Array
    n: int = 0

    @classmethod
    def empty(cls, fit: AxisFit, *, lags: int | None = None) -> CoefficientScores:
        """Return the moment over no samples."""
        return cls(fit, lags, np.zeros((len(fit.independent),) * 2))

    def update(self, rows: ArrayLike, force: ArrayLike) -> CoefficientScores:
        """Return the moment with one more unbroken segment.

        rows: basis rows (k, n) of the fit's terms without the constant; force: the
        axis's measured force (n,). Raises `DataError` when rows and terms disagree.
        """
        fit, kept = self.fit, list(self.fit.independent)
        design = np.asarray(rows, dtype=np.float64)
        target = np.asarray(force, dtype=np.float64)
        if fit.terms and fit.terms[-1] == CONSTANT:
            design = np.vstack([design, np.ones(len(target))])
        if design.shape != (len(fit.terms), len(target)):
            raise DataError(
                "basis rows and terms of the fit do not agree", value=(design.shape, len(fit.terms))
            )
        residual = target - design[kept].T @ fit.solution[kept]
        scores = (design[kept] / fit.column_norms[kept][:, None] * residual).T
        lags = automatic_lags(scores) if self.lags is None else self.lags
        middle = self.middle + long_run_moment(scores, lags=lags)
        return CoefficientScores(fit, self.lags, middle, self.n + len(target))

    def covariance(self) -> Array:
        """Return the covariance (k, k) in the order of `fit.terms`.

        Rows of nan where the data determine no single number.
        """
        from scipy.linalg import cho_solve

        fit, kept = self.fit, list(self.fit.independent)
        scale = fit.column_norms[kept]
        inverse = cho_solve((fit.scaled_triangle, False), np.eye(len(kept)))
        covariance = np.full((len(fit.terms), len(fit.terms)), np.nan)
        covariance[np.ix_(kept, kept)] = _sandwich(inverse, self.middle, self.n) / np.outer(
            scale, scale
        )
        return covariance


def _sandwich(inverse: Array, middle: Array, n: int) -> Array:
    k = len(inverse)
    if n <= k:
        raise DataError("fewer samples than coefficients: there is no standard error", value=n)
    return inverse @ middle @ inverse * (n / (n - k))
