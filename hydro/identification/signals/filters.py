"""One zero-phase low-pass for all channels, so that none lags another."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, recursion

EDGE_SHARE = 0.01
"""A disturbance at an end has decayed to this share after the edge zone."""
SPLINE_REACH = 9.0
"""Periods of the cutoff after which a smoothing spline has lost a sample."""
LEAST_REACH = 4096
"""Samples by which a signal is continued at least, or by its length."""
CLOCK_TOLERANCE = 0.01
"""Largest deviation of one step from the mean step, as a share of it."""


def zero_phase_lowpass(
    t_s: ArrayLike, values: ArrayLike, *, cutoff_hz: float, order: int = 4
) -> Array:
    """Return values (n,) or (n, k) low-passed by Butterworth, forward and backward.

    On the uniform clock t_s (n,) [s], of order `order`. The amplitude is one half at
    `cutoff_hz` and falls with twice the order beyond; there is no phase. The ends are
    continued by odd reflection: results within `edge_zone_s` of either end are not to
    be trusted. Values are not written to. Raises `DataError` (a user's mistake: cutoff
    at or above half the sample rate, too few samples) and `ValueError` for values that
    are not finite or a clock that is not uniform.
    """
    t, signal = np.asarray(t_s, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if signal.shape[:1] != t.shape or len(t) < 2:
        raise ValueError(f"clock {t.shape} and values {signal.shape} do not belong together")
    if not np.isfinite(signal).all():
        raise ValueError(
            "the low-pass refuses values that are not finite: split the signal at its gaps first"
        )
    step = float(t[-1] - t[0]) / (len(t) - 1)
    if not (step > 0 and np.abs(np.diff(t) - step).max() <= CLOCK_TOLERANCE * step):
        raise ValueError("the low-pass needs a uniform clock: resample first")
    if order < 2 or order % 2:
        raise DataError(
            "the order of the low-pass must be even", value=order, allowed="2, 4, 6 ..."
        )
    if not 0 < cutoff_hz < 0.5 / step:
        raise DataError(
            "the cutoff of the low-pass must lie below half the sample rate",
            field="cutoff_hz",
            value=cutoff_hz,
            allowed=f"0 to {0.5 / step:.3g} Hz",
        )
    if len(t) < 4:
        raise DataError("too few samples for the low-pass", value=len(t))
    padding = min(int(np.ceil(2.0 * edge_zone_s(cutoff_hz, order=order) / step)), len(t) - 1)
    ends = 2.0 * signal[0] - signal[padding:0:-1], 2.0 * signal[-1] - signal[-2 : -padding - 2 : -1]
    longer = np.concatenate([ends[0], signal, ends[1]])
    passed = longer.reshape(len(longer), -1)
    sections = butterworth(cutoff_hz * step, order)
    for _ in range(2):  # forward, and backward
        for section in sections:
            passed = _filtered(section, passed)
        passed = passed[::-1]
    return passed[padding : padding + len(t)].reshape(signal.shape)


def butterworth(cutoff: float, order: int) -> Array:
    """Return a low-pass as sections (order / 2, 6) b0 b1 b2 a0 a1 a2, of even order.

    cutoff: in cycles per sample, at which the power is one half. The poles -exp(i pi m /
    2N), m = 1 - N, 3 - N ... N - 1, times 2 tan(pi cutoff), by the bilinear transform z =
    (2 + s) / (2 - s); each section has a pair of them and passes a constant unchanged.
    """
    if order < 2 or order % 2:
        raise ValueError(f"the order of the low-pass must be even, and is {order}")
    # `scipy.signal.butter` does the same, and takes half a second to import.
    s = -np.exp(0.5j * np.pi * np.arange(1 - order, 0, 2) / order) * 2.0 * np.tan(np.pi * cutoff)
    z = (2.0 + s) / (2.0 - s)
    a1, a2 = -2.0 * z.real, np.abs(z) ** 2
    gain = np.abs(s) ** 2 / np.abs(2.0 - s) ** 2
    one = np.ones_like(gain)
    return np.column_stack([gain, 2.0 * gain, gain, one, a1, a2])


def _filtered(section: Array, x: Array) -> Array:
    """Return columns (n, k) through a section that rested at the first sample."""
    b0, b1, b2, _, a1, a2 = section
    driven = b0 * x
    driven[1:] += b1 * x[:-1]
    driven[2:] += b2 * x[:-2]
    # As if x[0] had stood there, and come out, for ever.
    driven[0] += (b1 + b2 - a1 - a2) * x[0]
    driven[1] += (b2 - a2) * x[0]
    return recursion(driven, (a1, a2))


def edge_zone_s(cutoff_hz: float, *, order: int = 4) -> float:
    """Return the width [s] of the zone at either end that follows the continuation.

    The slowest pole pair of the Butterworth filter has the real part -2 pi f sin(pi /
    2N) (N even); a disturbance decays to 1 % within ln(100) / (2 pi f sin(pi / 2N)):
    0.64 s for 3 Hz and order 4.
    """
    return float(-np.log(EDGE_SHARE) / (2.0 * np.pi * cutoff_hz * np.sin(np.pi / (2.0 * order))))


def spline_lowpass(values: ArrayLike, cutoff_hz: float, *, step_s: float) -> Array:
    """Return values (n,) as a cubic smoothing spline leaves them.

    The spline's response far from the ends, 1 / (1 + (f / cutoff)^4), with the ends
    continued by even reflection; the amplitude is one half at `cutoff_hz`.

    >>> wave = np.sin(2.0 * np.pi * np.arange(2000) * 0.01)  # 1 Hz
    >>> round(float(spline_lowpass(wave, 1.0, step_s=0.01)[1025]), 3)
    0.5
    """
    signal = np.asarray(values, dtype=np.float64)
    # Beyond, the spline's response to a sample is gone: exp(-sqrt(2) pi f t) of it is below
    # 1e-9 of its level, and the tail of the end of the spectrum falls with the square of time.
    reach = max(LEAST_REACH, int(np.ceil(SPLINE_REACH / (cutoff_hz * step_s))))
    edge = min(reach, len(signal))
    longer = np.concatenate([signal[:edge][::-1], signal, signal[::-1][:edge]])
    count = len(longer) if edge < reach else fast_length(len(longer))
    frequency = np.fft.rfftfreq(count, step_s)
    passed = np.fft.rfft(longer, count) / (1.0 + (frequency / cutoff_hz) ** 4)
    return np.asarray(np.fft.irfft(passed, count)[edge : edge + len(signal)])


def fast_length(least: int) -> int:
    """Return the smallest length from `least` on that is a product of 2, 3 and 5.

    >>> fast_length(721)
    729
    """
    best = 1 << max(least - 1, 1).bit_length()
    five = 1
    while five < best:
        three = five
        while three < best:
            twos = max(-(-least // three) - 1, 0).bit_length()
            best = min(best, three << twos)
            three *= 3
        five *= 5
    return best
