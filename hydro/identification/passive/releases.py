"""Where something lets go of a body: tow stretches and the coasts after them."""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array, runs_of

TOWED, FREE, SPIKES = 0.03, 0.01, 99.0
"""Shares of the largest tow force (that percentile of it) above which a body is towed,
and below which it is free: drag goes with the square of the speed.
"""
LEAST_TOW_S, LEAST_COAST_S = 8.0, 1.0
FADES_TO = 0.7
"""A coast without a logged force falls to this share of its peak and lower."""
RISES_BY = 1.05
"""Speed that grows again by this factor is pushed."""
BENDS = 1.05
"""Mean speed over that of the line from peak to end: drag makes .45 to .99, waves and what
swings 1.15 to 1.3, as they slow a body down ever faster."""

CALM_S, LEAPS_TO = 1.5, 0.4

Stretch = tuple[int, int]


def towed(force_N: Array, step_s: float) -> list[Stretch]:
    """Return where a body is towed; nan is a pause."""
    size = np.abs(np.nan_to_num(force_N))
    mask = size > TOWED * _largest(size)
    return [(a, b) for a, b in runs_of(mask) if (b - a) * step_s >= LEAST_TOW_S]


def released(force_N: Array, step_s: float, longest_s: float) -> list[Stretch]:
    """Return the stretches after a tow in which nothing pulls, each at most so long."""
    size = np.abs(np.nan_to_num(force_N, nan=np.inf))
    limit = FREE * _largest(size[np.isfinite(size)])
    most = int(longest_s / step_s)
    return [
        (a, min(b, a + most))
        for a, b in runs_of(size <= limit)
        if a > 0 and (b - a) * step_s >= LEAST_COAST_S
    ]


def _largest(size: Array) -> float:
    """Return the size of a force without its spikes, 0 of nothing."""
    return float(np.percentile(size, SPIKES)) if size.size else 0.0


def fading(speed: Array, step_s: float, *, least: float, longest_s: float) -> list[Stretch]:
    """Return stretches in which a speed falls as by drag, each from a peak of it.

    `least`: speed at the peak. speed (n,) smooth on a uniform clock, nan where unknown.
    """
    x, n = np.abs(speed), speed.size
    most, coasts, at = int(longest_s / step_s), list[Stretch](), 1
    while at < n - 1:
        is_peak = np.isfinite(x[at - 1 : at + 2]).all() and x[at - 1] <= x[at] > x[at + 1]
        if not is_peak or x[at] < least:
            at += 1
            continue
        end, low = at + 1, x[at]
        while end < min(n, at + most) and np.isfinite(x[end]) and x[end] <= RISES_BY * low:
            if np.sign(speed[end]) != np.sign(speed[at]):
                break
            low = min(low, x[end])
            end += 1
        if (end - at) * step_s >= LEAST_COAST_S and low <= FADES_TO * x[at]:
            if 2.0 * x[at:end].mean() <= BENDS * (x[at] + x[end - 1]):
                coasts.append((at, end))
            at = end
        else:
            at += 1
    return coasts


def onsets(deflection: Array, step_s: float) -> list[Stretch]:
    """Return a stretch for each time a deflection leaps up, to the next one or the end.

    deflection (n,) about its rest. A leap doubles the largest deflection of the
    `CALM_S` before and reaches `LEAPS_TO` of the largest of all.
    """
    size, before = np.abs(deflection), max(int(CALM_S / step_s), 1)
    largest = float(np.nanmax(size, initial=0.0))
    begins: list[int] = []
    for at in np.flatnonzero(size >= LEAPS_TO * largest).tolist():
        calm = float(np.nanmax(size[max(at - before, 0) : at], initial=0.0))
        if 2.0 * calm <= size[at] and (not begins or at - begins[-1] >= before):
            begins.append(at)
    if not begins:
        return []
    ends = [*(begin - 1 for begin in begins[1:]), size.size]
    return list(zip(begins, ends, strict=True))
