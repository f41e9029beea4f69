"""Standard errors for coloured residuals: left-out blocks, and Bartlett's kernel.

Filtered signals at 50 Hz have residuals that stay correlated over seconds; the white
formula then gives standard errors that are several times too small. `LeftOutBlocks`
leaves blocks of time out and holds on legs of a minute (decision 0049); the covariance
with Bartlett's kernel is for long series. Sources: MacKinnon & White 1985 (jackknife),
Newey & West 1987 (kernel), Andrews 1991 (choice of lags).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.regression.least_squares import CONSTANT, AxisFit

DIRECT_LAGS = 48
"""Lags at which sums of products are faster than the whole autocorrelation."""
BLOCKS_OF_A_SEGMENT = (3, 12)
"""Fewest and most blocks of an unbroken segment."""
MEMORIES = 8
"""Blocks are so many times as long as the residual remembers, where the segment allows."""
LEAST_LEFT = 1e-9
"""A block that has all but this share of a direction's information carries it by itself."""
MOST_CORRELATED = 0.9
"""Of values in a row: what a few of them hardly tell from a trend."""


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


def _toeplitz_product(first: Array, rows: Array) -> Array:
    """Return R rows (n, k), R symmetric with `first` (m,) on its diagonals, m <= n.

    By the spectra of a circle that is long enough; row by row of R it takes m products.
    """
    n, most = len(rows), len(first) - 1
    size = 1 << (n + most).bit_length()
    circle = np.zeros(size)
    circle[: most + 1] = first
    circle[size - most :] = first[:0:-1]
    spectra = np.fft.rfft(rows, size, axis=0) * np.fft.rfft(circle).real[:, None]
    return np.asarray(np.fft.irfft(spectra, size, axis=0)[:n])


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
        tapered = [
            float(error[: len(error) - lag] @ error[lag:]) / len(error) * (1.0 - lag / (most + 1))
            for lag in range(most + 1)
        ]
        product = rows.T @ _toeplitz_product(np.array(tapered), rows)
        middle += 0.5 * (product + product.T)
        n += len(error)
    return _sandwich(inverse, middle, n)


@dataclass(frozen=True)
class LeftOutBlocks:
    """What leaving out one block of time after another does to coefficients.

    With A = X'X, and A_g = X_g'X_g and s_g = X_g'e_g of block g, the coefficients without
    the block differ by d_g = -(A - A_g)^-1 s_g, exactly. Their covariance is
    (G - 1) / G sum over g of d_g d_g' (delete-a-group jackknife; MacKinnon & White 1985,
    HC3, for blocks), times (t / 1.96)^2 with t the 97.5 % point of Student's t with G - 1
    degrees of freedom: 1.96 standard errors are then the 95 % interval of so few blocks.
    A manoeuvre that carries nearly all that is known of a coefficient gives it a large
    standard error; where nothing is left without the block, its whole residual is taken
    for an error of that shape. Errors are taken as independent from block to block;
    within a block they may have any colour and strength.

    squares (k, k): the sum so far, for columns of unit length; count: blocks so far.
    """

    fit: AxisFit
    squares: Array
    count: int = 0

    @classmethod
    def empty(cls, fit: AxisFit) -> LeftOutBlocks:
        """Return the sum over no blocks."""
        return cls(fit, np.zeros((len(fit.independent),) * 2))

    def update(self, rows: ArrayLike, force: ArrayLike) -> LeftOutBlocks:
        """Return the sum with one more unbroken segment, cut into `block_count` blocks.

        rows: basis rows (k, n) of the fit's terms without the constant; force: the
        axis's measured force (n,). Raises `DataError` when rows and terms disagree.
        """
        return updated_together([self], rows, np.asarray(force, dtype=np.float64)[:, None])[0]

    def covariance(self) -> Array:
        """Return the covariance (k, k) in the order of `fit.terms`.

        Rows of nan where the data determine no single number.
        """
        fit, kept = self.fit, list(self.fit.independent)
        covariance = np.full((len(fit.terms), len(fit.terms)), np.nan)
        if self.count > 1:
            widened = widened_by(self.count - 1) ** 2
            covariance[np.ix_(kept, kept)] = (
                self.squares
                * (widened * (self.count - 1) / self.count)
                / np.outer(fit.column_norms[kept], fit.column_norms[kept])
            )
        return covariance


def updated_together(
    sums: Sequence[LeftOutBlocks], rows: ArrayLike, forces: Array
) -> list[LeftOutBlocks]:
    """Return what `LeftOutBlocks.update` does of fits that share their columns.

    forces (n, len(sums)): the measured force of each. What blocks hold of the information
    depends on the columns alone, and takes nearly all of the time.
    """
    from scipy.linalg import solve_triangular

    fit, kept = sums[0].fit, list(sums[0].fit.independent)
    design = np.asarray(rows, dtype=np.float64)
    if fit.terms and fit.terms[-1] == CONSTANT:
        design = np.vstack([design, np.ones(len(forces))])
    del rows  # no array of a long leg stays that is not needed any more
    if design.shape != (len(fit.terms), len(forces)):
        raise DataError(
            "basis rows and terms of the fit do not agree", value=(design.shape, len(fit.terms))
        )
    if kept != list(range(len(design))):
        design = design[kept]
    residuals = [
        force - design.T @ each.fit.solution[kept]
        for each, force in zip(sums, forces.T, strict=True)
    ]
    # Columns that are orthonormal over all data: A becomes the unit matrix.
    design = design / fit.column_norms[kept][:, None]
    columns = solve_triangular(fit.scaled_triangle, design, trans="T", overwrite_b=True)
    del design
    information: dict[int, tuple[Array, Array]] = {}
    updated = []
    for each, residual in zip(sums, residuals, strict=True):
        count = block_count(residual)
        edges = list(pairwise(np.linspace(0, len(residual), count + 1).astype(int)))
        if count not in information:
            blocks = [columns[:, a:b] for a, b in edges]
            information[count] = np.linalg.eigh(np.array([block @ block.T for block in blocks]))
        share, axes = information[count]
        score = np.array(
            [
                own.T @ (columns[:, a:b] @ residual[a:b])
                for own, (a, b) in zip(axes, edges, strict=True)
            ]
        )
        size = np.array([np.linalg.norm(residual[a:b]) for a, b in edges])
        left, most = 1.0 - share, np.sqrt(np.maximum(share, 0.0)) * size[:, None]
        # What nothing outside the block determines has no fit without it.
        change = np.where(left > LEAST_LEFT, score / np.maximum(left, LEAST_LEFT), most)
        d = solve_triangular(fit.scaled_triangle, (axes @ change[..., None])[..., 0].T)
        updated.append(LeftOutBlocks(each.fit, each.squares + d @ d.T, each.count + count))
    return updated


def widened_by(degrees: float) -> float:
    """Return the 97.5 % point of Student's t over the normal's, at least one degree.

    1.96 standard errors that are multiplied by it are half of the 95 % interval.

    >>> round(widened_by(2), 3)
    2.195
    """
    from scipy.special import stdtrit

    return float(stdtrit(max(degrees, 1), 0.975)) / NORMAL_95


def mean_error(values: Array) -> float:
    """Return the standard error of the mean of a few values (n,) in a row.

    n > 3. They count as autoregressive of first order, never as alternating; their
    correlation r is that of the sample without its bias, about -(1 + 3 r) / n.

    >>> round(mean_error(np.array([1.0, -1.0, 1.0, -1.0])), 3)  # scatter over root n
    0.577
    >>> round(mean_error(np.array([-2.0, -2.0, -1.0, 1.0, 2.0, 2.0])), 3)
    3.746
    """
    count = values.size
    away = values - values.mean()
    square = float(away @ away)
    if square == 0.0:
        return 0.0
    sampled = float(away[1:] @ away[:-1]) / square
    r = min(max((sampled + 1.0 / count) / (1.0 - 3.0 / count), 0.0), MOST_CORRELATED)
    lags = np.arange(1, count)
    factor = 1.0 + 2.0 * float(np.sum((1.0 - lags / count) * r**lags))
    return float(np.sqrt(square / count / (1.0 - factor / count) * factor / count))


def block_count(residual: Array) -> int:
    """Return the number of blocks of an unbroken residual (n,): 3 to 12.

    As many as are `MEMORIES` times as long as the residual's memory, the lag at which
    its autocorrelation falls below one half.
    """
    fewest, most = BLOCKS_OF_A_SEGMENT
    longest = len(residual) // (MEMORIES * (fewest + 1))
    memory = _memory(residual, longest)
    return fewest if memory is None else min(len(residual) // (MEMORIES * memory), most)


def _memory(residual: Array, longest: int) -> int | None:
    """Return the first lag from 1 to `longest` of an autocorrelation below one half."""
    centred = residual - residual.mean()
    half = 0.5 * (centred @ centred)
    for lag in range(1, min(DIRECT_LAGS, longest + 1)):
        if centred[lag:] @ centred[:-lag] < half:
            return lag
    if longest < DIRECT_LAGS:
        return None
    below = np.flatnonzero(_moments(centred, longest) < half)
    return int(below[0]) if len(below) else None


def _moments(values: Array, longest: int) -> Array:
    """Return sums of the products of values (n,) so many places apart, 0 to `longest`.

    Over pieces that stay in the processor's cache, each with what follows it.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    size = 3 * longest
    length, count = next_fast_len(size + longest, real=True), -(-len(values) // size)
    padded = np.zeros(count * size + longest)
    padded[: len(values)] = values
    longer = np.lib.stride_tricks.sliding_window_view(padded, size + longest)[::size]
    of_pieces = rfft(longer[:, :size], length).conj() * rfft(longer, length)
    return np.asarray(irfft(of_pieces.sum(axis=0), length)[: longest + 1])


def _sandwich(inverse: Array, middle: Array, n: int) -> Array:
    k = len(inverse)
    if n <= k:
        raise DataError("fewer samples than coefficients: there is no standard error", value=n)
    return inverse @ middle @ inverse * (n / (n - k))
