"""The band of frequencies in which a vehicle moves, from what its sensors measured."""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.resampling import gaps

SHARE = 0.95
"""Share of the power above the noise that lies within the band."""
WINDOW_S = 20.0
LARGEST_HZ = 5.0
"""Beyond it thrusters shake a vehicle, which no model of its motion follows."""
NOISE_FROM = 0.6
"""Above this share of the largest frequency the quieter half is noise."""


def motion_band_hz(t_s: Array, values: Array) -> float:
    """Return the frequency [Hz] below which a signal (n,) moves; 0 for one too short.

    95 % of its power above the noise lies below, of the power up to 5 Hz; windows of 20 s
    with their mean taken off, Hann's taper, half overlapped.
    """
    finite = np.isfinite(values)
    t, x = t_s[finite], values[finite]
    if t.size < 8:
        return 0.0
    step = float(np.median(np.diff(t)))
    count = int(WINDOW_S / step)
    if not count > 8:
        return 0.0
    power, windows = np.zeros(count // 2 + 1), 0
    for first, last in gaps(t, 1.0):
        uniform = np.arange(t[first], t[last - 1], step)
        signal = np.interp(uniform, t[first:last], x[first:last])
        for start in range(0, uniform.size - count + 1, count // 2):
            window = signal[start : start + count]
            power += np.abs(np.fft.rfft((window - window.mean()) * np.hanning(count))) ** 2
            windows += 1
    hz = np.fft.rfftfreq(count, step)
    power, hz = power[hz <= LARGEST_HZ], hz[hz <= LARGEST_HZ]
    if not windows or not power.any():
        return 0.0
    noise = float(np.median(power[hz >= NOISE_FROM * hz[-1]]))
    above = np.cumsum(np.maximum(power - noise, 0.0))
    return float(hz[np.searchsorted(above, SHARE * above[-1])])
