"""Where a vehicle coasts: its thrusters rest, and it still moves through the water."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Mask

IDLE_SHARE = 0.002
"""Thrust of a resting thruster, at most this share of the largest of its curve."""
PUSHES = 1e-3
"""A thruster pushes an axis if its lever there is more than this share of the largest."""


@dataclass(frozen=True)
class CoastRule:
    """What counts as a coast.

    `wait_s` after the stop is left to the lag of the thrust and to its wake, and the
    wait and `least_s` together must be at rest; what comes after `longest_s` is no
    longer taken. `least_speed` [m/s, rad/s] at the start of what is taken.
    """

    least_speed: float
    wait_s: float = 0.2
    least_s: float = 0.8
    longest_s: float = 4.0


@dataclass(frozen=True)
class Coast:
    """One coast: from `start_s` to `end_s`, thrust ended at `stop_s`."""

    stop_s: float
    start_s: float
    end_s: float


@dataclass(frozen=True)
class CoastSearch:
    """The coasts of a log on one axis, and how much rest was none of them.

    `idle_s`: time in which nothing pushes the axis. `short` (k, 2): begin and end [s] of
    rests that begin fast enough and end too soon; `slow`: rests that begin too slow.
    """

    coasts: tuple[Coast, ...] = ()
    idle_s: float = 0.0
    short: tuple[tuple[float, float], ...] = field(default=())
    slow: int = 0


def idle_axes(thrust_N: ArrayLike, allocation: ArrayLike, *, largest_N: float) -> Mask:
    """Return where nothing pushes each axis (n, 6), from thrust (n, k) along the axes.

    allocation (6, k); `largest_N`: the largest thrust of a thruster. An axis that no
    thruster pushes is idle throughout.

    >>> allocation = np.array([[1.0, 0.0]] + 5 * [[0.0, 1.0]])
    >>> idle_axes([[0.0, 20.0], [5.0, 0.0]], allocation, largest_N=50.0)[:, :2].tolist()
    [[True, False], [False, True]]
    """
    lever = np.abs(np.asarray(allocation, dtype=np.float64))
    pushes = lever > PUSHES * lever.max(axis=1, keepdims=True)
    acts = np.abs(np.asarray(thrust_N, dtype=np.float64)) > IDLE_SHARE * largest_N
    return np.asarray(~np.any(acts[:, None, :] & pushes, axis=2))


def find_coasts(
    t_s: Array, idle: Mask, speed: Array, rule: CoastRule, *, released: bool = False
) -> CoastSearch:
    """Return the coasts on one axis; t_s, idle and speed (n,) on a uniform clock.

    A rest that holds already at the first sample is none, since nobody knows when the
    thrust ended; unless the body was `released` then.
    """
    edges = np.diff(np.concatenate([[not released], idle, [False]]).astype(np.int8))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    # The first end is that of what holds before the first sample.
    ends = ends if released else ends[1:]
    step = float(t_s[1] - t_s[0]) if t_s.size > 1 else 0.0
    coasts, short, slow = [], [], 0
    for begin, end in zip(begins, ends, strict=True):
        stop, last = float(t_s[begin]), float(t_s[end - 1])
        first = int(min(np.searchsorted(t_s, stop + rule.wait_s - 1e-9), end - 1))
        if abs(speed[first]) < rule.least_speed:
            slow += 1
        elif last - stop < rule.wait_s + rule.least_s - 1e-9:
            short.append((stop, last))
        else:
            start = float(t_s[first])
            coasts.append(Coast(stop, start, min(last, start + rule.longest_s)))
    return CoastSearch(tuple(coasts), float(np.sum(idle)) * step, tuple(short), slow)
