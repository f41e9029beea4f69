"""Offset between the clocks of two records of one motion, with uncertainty.

A signal that both hold is correlated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array

FEWEST = 50
FASTEST_HZ = 100.0
MOST_SAMPLES = 1 << 20
LONGEST_HOLE_STEPS = 3.0


@dataclass(frozen=True)
class ClockOffset:
    """Offset to add to the second clock [s], with its standard deviation [s].

    `overlap_s`: the time in common over which the signals were compared.
    """

    offset_s: float
    std_s: float
    correlation: float
    overlap_s: float


def clock_offset(
    t1_s: ArrayLike, x1: ArrayLike, t2_s: ArrayLike, x2: ArrayLike, *, min_overlap_s: float = 10.0
) -> ClockOffset:
    """Return the offset with which x2 at (t2 + offset) looks like x1 at t1.

    x1 (n,) or (n, k) at increasing times t1_s (n,), x2 (m,) or (m, k) at t2_s (m,), the
    same k signals in the same unit and sign; rates may differ, samples may be missing
    (a pause is no signal). Both are interpolated to one uniform clock at the rate of
    the slower record, doubled, and compared at every offset with at least
    `min_overlap_s` in common by the correlation coefficient rho over the overlap of n
    samples. The offset with the largest likelihood of a common signal, -n log(1 -
    rho^2), is refined by a parabola through rho.

    The standard deviation follows from the curvature of the peak: with correlation rho,
    curvature kappa = -C''/C [1/s^2] and n_e independent samples of the difference of
    the signals, var = (1 - rho^2) / (rho^2 kappa n_e) (the Cramer-Rao bound of a delay
    between two noisy copies, Carter 1987, in the time domain). n_e allows for the
    autocorrelation of the difference. It does not hold what acts on both signals alike,
    such as the delay of a filter in one of them. Raises `DataError` for records that
    are too short, constant, or never overlap enough.
    """
    first, second = _series(t1_s, x1), _series(t2_s, x2)
    if first[1].shape[1] != second[1].shape[1]:
        raise DataError(
            "the signals differ in number", value=(first[1].shape[1], second[1].shape[1])
        )
    slower = max(float(np.median(np.diff(times))) for times, _ in (first, second))
    span = max(times[-1] - times[0] for times, _ in (first, second))
    step = max(0.5 * slower, 1.0 / FASTEST_HZ, 2.0 * span / MOST_SAMPLES)
    one, mask_one = _uniform(*first, step)
    two, mask_two = _uniform(*second, step)
    score, count = _correlation(one, mask_one, two, mask_two)
    score = np.where(count * step >= min_overlap_s, score, -np.inf)
    # The likelihood of a common signal: a high correlation over a short overlap is
    # worth less than a lower one over a long overlap.
    likelihood = -count * np.log1p(-np.square(np.clip(score, 0.0, 1.0 - 1e-12)))
    top = int(np.argmax(np.where(np.isfinite(score), likelihood + score, -np.inf)))
    if not np.isfinite(score[top]):
        allowed = f"at least {min_overlap_s:g} s in common"
        raise DataError(
            "the records do not overlap enough",
            value=f"{float(count.max()) * step:.1f} s",
            allowed=allowed,
        )
    shift = top - (len(two) - 1)
    neighbours = score[max(top - 1, 0) : top + 2]
    fine, bend = 0.0, -np.inf
    if neighbours.size == 3 and np.isfinite(neighbours).all():
        low, middle, high = neighbours
        bend = float(low - 2.0 * middle + high)
        fine = 0.5 * float(low - high) / bend if bend < 0.0 else 0.0
    rho = float(score[top])
    std = np.inf
    if np.isfinite(bend) and bend < 0.0 and rho > 0.0:
        independent = _independent(one, mask_one, two, mask_two, shift)
        std = float(
            np.sqrt(max(1.0 - rho**2, 1e-12) / (rho**2 * (-bend / rho / step**2) * independent))
        )
    offset = first[0][0] - second[0][0] + (shift + fine) * step
    return ClockOffset(float(offset), std, rho, float(count[top] * step))


def _series(t_s: ArrayLike, x: ArrayLike) -> tuple[Array, Array]:
    t, values = np.asarray(t_s, dtype=np.float64), np.asarray(x, dtype=np.float64)
    values = values[:, None] if values.ndim == 1 else values
    if t.size != len(values):
        raise DataError("times and values differ in length", value=(t.size, len(values)))
    good = np.isfinite(t) & np.isfinite(values).all(axis=1)
    t, values = t[good], values[good]
    if t.size < FEWEST:
        raise DataError(
            "the record is too short to be aligned",
            value=f"{t.size} samples",
            allowed=f"at least {FEWEST}",
        )
    if (np.diff(t) <= 0.0).any():
        raise DataError("times must increase strictly", remedy="Clean the clock first.")
    if (np.ptp(values, axis=0) == 0.0).all():
        raise DataError("a constant signal cannot be aligned")
    return t, values


def _uniform(t: Array, values: Array, step: float) -> tuple[Array, Array]:
    """Return values (m, k) on a uniform clock, and a mask (m,) that is 0 in gaps."""
    clock = t[0] + np.arange(int((t[-1] - t[0]) / step) + 1) * step
    right = np.clip(np.searchsorted(t, clock, side="left"), 1, t.size - 1)
    hole = LONGEST_HOLE_STEPS * max(float(np.median(np.diff(t))), step)
    mask = (t[right] - t[right - 1] <= hole).astype(np.float64)
    return (
        np.stack([np.interp(clock, t, column) for column in values.T], axis=1) * mask[:, None],
        mask,
    )


def _correlation(one: Array, mask_one: Array, two: Array, mask_two: Array) -> tuple[Array, Array]:
    """Return correlation and overlap in samples (n + m - 1,) at every shift.

    Of two (m, k) against one (n, k). Entry i stands for two moved by i - (m - 1)
    samples. Means and variances are those of the overlap (Padfield 2012, masked
    normalised cross-correlation), so that the shape of a record's ends does not decide.
    With several signals their covariances and variances are added up.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    size = len(one) + len(two) - 1
    length = next_fast_len(size, real=True)

    def spectrum(x: Array) -> Array:
        return np.asarray(rfft(x, length))

    def against(left: Array, right: Array) -> Array:
        # Correlation is convolution with the second signal turned round.
        return np.asarray(irfft(left * right, length)[:size])

    there, mask_there = spectrum(mask_one), spectrum(mask_two[::-1])
    count = np.maximum(np.rint(against(there, mask_there)), 0.0)
    safe = np.maximum(count, 1.0)
    covariance, left_energy, right_energy = np.zeros(size), np.zeros(size), np.zeros(size)
    for a, b in zip(one.T, two[::-1].T, strict=True):
        # Means are taken off first: sums of squares of large numbers would lose the
        # small differences.
        a = (a - a.sum() / max(mask_one.sum(), 1.0)) * mask_one
        b = (b - b.sum() / max(mask_two.sum(), 1.0)) * mask_two[::-1]
        left, right = spectrum(a), spectrum(b)
        sum_left, sum_right = against(left, mask_there), against(there, right)
        covariance += against(left, right) - sum_left * sum_right / safe
        left_energy += against(spectrum(a * a), mask_there) - sum_left**2 / safe
        right_energy += against(there, spectrum(b * b)) - sum_right**2 / safe
    energy = np.maximum(left_energy, 0.0) * np.maximum(right_energy, 0.0)
    floor = 1e-12 * float(energy.max(initial=0.0))
    score = np.divide(covariance, np.sqrt(energy), out=np.full(size, -1.0), where=energy > floor)
    return score, count


def _independent(one: Array, mask_one: Array, two: Array, mask_two: Array, shift: int) -> float:
    """Return the number of independent samples of the difference at a shift.

    n / (1 + 2 sum r_k), r_k its autocorrelation up to where it first falls below zero.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    start, end = max(0, shift), min(len(one), shift + len(two))
    a, b = one[start:end], two[start - shift : end - shift]
    good = (mask_one[start:end] * mask_two[start - shift : end - shift]) > 0.0
    a, b = a[good] - a[good].mean(axis=0), b[good] - b[good].mean(axis=0)
    slope = np.sum(a * b, axis=0) / np.maximum(np.sum(b * b, axis=0), 1e-300)
    rest = a - slope * b
    length = next_fast_len(2 * len(rest), real=True)
    spectra = np.abs(rfft(rest, length, axis=0)) ** 2
    lagged = irfft(spectra.sum(axis=1), length)[: len(rest)]
    if lagged[0] <= 0.0:
        return float(len(rest))
    r = lagged / lagged[0]
    negative = np.flatnonzero(r <= 0.0)
    tail = r[1 : int(negative[0]) if negative.size else len(r)]
    return max(len(rest) / (1.0 + 2.0 * float(tail.sum())), 1.0)
