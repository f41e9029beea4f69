"""Which stretches of a leg an axis is fitted on; force that does not move the body."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from auvid.hydro.arrays import Array, Mask, runs_of
from auvid.hydro.identification.axes.record import LeftOut

Windows = tuple[tuple[int, int], ...]

WINDOW_S = 10.0
"""Windows are about so long: several times what a small vehicle needs to answer."""
SHORTEST_WINDOW_S = 5.0
BEFORE_S, AFTER_S = 1.0, 4.0
"""Stretches around the force of an axis that belong to it: coasting tells drag."""
STUCK_S, HELD_S = 2.0, 4.0
"""Force and motion are compared as means over the first; a body that is held for the
second or longer does not only turn back.
"""
STUCK_SHARE = 0.2
"""A body that is held moves by less than this part of what its force usually gives."""
STRONG_SHARE = 0.6
"""Only forces beyond this part of the leg's large ones are judged."""
SLOW_SHARE, WEAK_SHARE = 0.5, 0.3
"""The same of what comes right before and after such a stretch."""
LARGE_PERCENT = 90.0
TAUT_S = 10.0
"""So long before and after a hold a tether may be taut: a hold shows only once the force
against it is large, and a body is freed slowly.
"""


def windows_of_axis(
    axis: str,
    t_s: Array,
    left_out: Sequence[tuple[str, Mask]],
    *,
    window_s: float = WINDOW_S,
) -> tuple[Windows, tuple[LeftOut, ...]]:
    """Return the windows of an axis, and the stretches without, each with its reason.

    t_s (n,): uniform times [s]. left_out: reason and mask (n,), the first that applies
    counts. What remains is cut into equal windows of about `window_s`; a stretch shorter
    than SHORTEST_WINDOW_S is left out, and its reason names what cuts it off.
    """
    why = np.full(t_s.size, -1)
    for number, (_, mask) in reversed(list(enumerate(left_out))):
        why[mask] = number
    reasons = [reason for reason, _ in left_out]
    step = float(t_s[1] - t_s[0])
    windows: list[tuple[int, int]] = []
    stretches: list[LeftOut] = []
    edges = [0, *(np.flatnonzero(np.diff(why)) + 1).tolist(), t_s.size]
    for first, last in pairwise(edges):
        span = float(t_s[first]), float(t_s[last - 1]) + step
        if why[first] >= 0:
            stretches.append(LeftOut(axis, *span, reasons[why[first]]))
        elif (last - first) * step < SHORTEST_WINDOW_S:
            neighbours = [why[at] for at in (first - 1, last) if 0 <= at < t_s.size]
            cut = "" if not neighbours else f" beside: {reasons[min(neighbours)]}"
            stretches.append(LeftOut(axis, *span, f"shorter than {SHORTEST_WINDOW_S:g} s{cut}"))
        else:
            parts = max(1, round((last - first) * step / window_s))
            marks = np.linspace(first, last, parts + 1).round().astype(int).tolist()
            windows += pairwise(marks)
    return tuple(windows), tuple(stretches)


def near(mask: Mask, before: int, after: int) -> Mask:
    """Return a mask (n,) with so many samples more before and after each run.

    >>> near(np.array([False, False, True, False, False]), 1, 0).tolist()
    [False, True, True, False, False]
    """
    total = np.concatenate([[0], np.cumsum(mask)])
    at = np.arange(mask.size)
    first, last = np.maximum(at - after, 0), np.minimum(at + before + 1, mask.size)
    return np.asarray(total[last] > total[first])


def driven(force: Array, step_s: float, least: float) -> Mask:
    """Return where a force (n,) acts, or acted shortly before; nan is none."""
    acting = np.abs(np.nan_to_num(force)) > least
    return near(acting, round(BEFORE_S / step_s), round(AFTER_S / step_s))


def force_without_motion(
    t_s: Array, force: Array, rate: Array, usable: Mask, *, least: float = 0.0
) -> Mask:
    """Return where a force (n,) does not move what it usually moves (n,).

    On means over STUCK_S of force F and velocity x: the constant F0 is the median, and
    a large force F90 = p90 |F - F0| usually gives x90 = p90 |x|. Quadratic drag then
    gives x = x90 sqrt(|F - F0| / F90); a body that is held moves by less than
    STUCK_SHARE of it for HELD_S and longer. Uniform t_s (n,) [s]; usable (n,): what F0,
    F90 and x90 are taken from. A force up to `least` may be that of the tether.
    """
    step = float(t_s[1] - t_s[0])
    width = max(1, round(STUCK_S / step))
    level, speed = _mean(force, width), _mean(rate, width)
    there = np.isfinite(level) & np.isfinite(speed)
    valid = usable & there
    if np.count_nonzero(valid) < 10 * width:
        return np.zeros(t_s.size, dtype=bool)
    # Zero force is no push, whatever the constant.
    push = np.minimum(np.abs(level - np.median(level[valid])), np.abs(level))
    large = float(np.percentile(push[valid], LARGE_PERCENT))
    usual = float(np.percentile(np.abs(speed[valid]), LARGE_PERCENT))
    if large <= 0.0 or usual <= 0.0:
        return np.zeros(t_s.size, dtype=bool)
    expected = usual * np.sqrt(push / large)
    # A hold that begins where the body is usable may end where it is not, as at the surface.
    resting = (
        there & (push > max(least, STRONG_SHARE * large)) & (np.abs(speed) < STUCK_SHARE * expected)
    )
    slow = there & (push > WEAK_SHARE * large) & (np.abs(speed) < SLOW_SHARE * expected)
    stuck = np.zeros(t_s.size, dtype=bool)
    for first, last in runs_of(resting):
        stuck[first:last] = (last - first) * step >= HELD_S
    # What comes before and after, while it is slow for its force, belongs to it.
    for first, last in runs_of(slow | stuck):
        stuck[first:last] = stuck[first:last].any() and usable[first:last].any()
    return stuck


def _mean(values: Array, width: int) -> Array:
    """Return the centred mean (n,) over `width` samples; nan where one is nan."""
    kernel = np.full(width, 1.0 / width)
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.asarray(np.convolve(padded, kernel, mode="valid"))
