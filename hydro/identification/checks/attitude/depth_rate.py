"""The depth rate that attitude and velocity make, against that of the depth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.motion_checks import (
    WINDOW_S,
    down_at,
    integrals,
    shared_windows,
)
from auvid.hydro.kept_results import kept

FEW = 8
"""Results that are kept: they are as long as the log."""
FEWEST = 25
"""Windows of a second that tell anything."""
FEWEST_OF_A_SHIFT, MOST_BY_LIFT = 30, 25.0
LEAST_TILT = 0.03
"""Standard deviation of roll or pitch [rad] from which on they are motion: attitudes wander
by a degree, and where a hull hardly tilts, heave alone is then nearer the depth.
"""
SLOW, MOST_OF_JOINED = 10, 0.8
"""Windows that are longer than a wave, and the part of so many that is most of them."""


@dataclass(frozen=True)
class Joined:
    """Rises of a depth over several windows each, and what a velocity makes of them.

    `rise` and `expected` (n,), and the integrals of surge and sway, `level` (n, 2) [m].
    """

    rise: Array
    expected: Array
    level: Array

    @property
    def correlation(self) -> float:
        """Correlation of rises and what the velocity makes of them."""
        return _correlation(self.rise, self.expected)

    @property
    def unexplained(self) -> float:
        """Part of the expected rises that neither rises nor a tilted mounting make."""
        design = np.column_stack([self.rise, self.level, np.ones(self.rise.size)])
        left = _left(self.expected, design)[0]
        return float((left / max(float(np.std(self.expected)), 1e-12)) ** 2)


@dataclass(frozen=True)
class DepthRates:
    """Rises of a depth over windows of a second, and what a velocity makes of them.

    Begins `at` (n,) [s], `rise` (n,) and `expected` (n,) [m], and the integrals [m] of
    surge, sway and heave, `parts` (n, 3), and of surge and sway as pitch and roll lift
    each, `lifted` (n, 4). `tilt`: what roll or pitch change by [rad].
    """

    at: Array
    rise: Array
    expected: Array
    parts: Array
    lifted: Array
    tilt: float

    @property
    def correlation(self) -> float:
        """Correlation of both, 0 where one of them does not change."""
        return _correlation(self.rise, self.expected)

    @property
    def slow_correlation(self) -> float:
        """Correlation of both over ten windows each: waves move one of them alone."""
        joined = self.joined(SLOW)
        return _correlation(joined.rise, joined.expected) if joined.rise.size > 2 else 0.0

    @property
    def persistence(self) -> float:
        """Correlation of what the velocity makes with that a window later."""
        return _correlation(self.expected[:-1], self.expected[1:])

    def joined(self, count: int) -> Joined:
        """Return the rates over so many windows each, of which most are there."""
        place = np.floor((self.at - self.at[0]) / (count * WINDOW_S))
        first = np.flatnonzero(np.diff(place, prepend=-1.0))
        complete = np.diff(np.append(first, place.size)) >= MOST_OF_JOINED * count
        columns = np.column_stack([self.rise, self.expected, self.parts[:, :2]])
        rise, expected, *level = np.add.reduceat(columns, first)[complete].T
        return Joined(rise, expected, np.column_stack(level))

    def level_odds(self) -> float:
        """Return how much likelier heave alone makes the rise than all by the tilt.

        Logarithm of the likelihood; a constant tilt of the mounting and a constant are
        taken off both. The lower one of that by squares and by medians. Of axes with a
        wrong sign, scale or turn, which what is lifted with any gain tells, and of a hull
        that hardly tilts, 0 at most.
        """
        aside = np.column_stack([self.parts[:, :2], np.ones(self.rise.size)])
        heave = self.parts[:, 2]
        own, level, free = (
            _left(self.rise, np.column_stack([*columns, aside]))
            for columns in ((self.expected,), (heave,), (heave, self.lifted))
        )
        odds = self.rise.size * np.log([own / level, level / free]).min(axis=1)
        is_unsure = odds[1] > MOST_BY_LIFT or self.tilt < LEAST_TILT
        return float(min(odds[0], 0.0) if is_unsure else odds[0])

    def best_shift(self) -> tuple[float, float]:
        """Return how much later the depth fits best, and the correlation there.

        In whole seconds; only shifts that leave half a minute in common.
        """
        place = np.round((self.at - self.at[0]) / WINDOW_S).astype(np.int64)
        grids = np.zeros((3, int(place[-1]) + 1))
        for grid, values in zip(grids, (self.rise, self.expected, None), strict=True):
            grid[place] = 1.0 if values is None else values - values.mean()
        rise, expected, there = grids
        both = np.correlate(there, there, "full")
        power = [
            np.correlate(rise**2, there, "full"),
            np.correlate(there, expected**2, "full"),
        ]
        size = np.sqrt(np.maximum(power[0] * power[1], 1e-18))
        likeness = np.where(
            both > FEWEST_OF_A_SHIFT, np.correlate(rise, expected, "full") / size, 0.0
        )
        best = int(np.argmax(likeness))
        return float((best - (rise.size - 1)) * WINDOW_S), float(likeness[best])


def _correlation(one: Array, other: Array) -> float:
    first, second = one - one.mean(), other - other.mean()
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(first @ second) / size if size > 0.0 else 0.0


def _left(values: Array, design: Array) -> Array:
    """Return the RMS and the median size of what a fit leaves."""
    rest = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    return np.maximum([np.std(rest), np.median(np.abs(rest))], 1e-12)


@partial(kept, most=FEW)
def depth_rates(
    t_depth: Array,
    depth: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
) -> DepthRates | None:
    """Return the rises of a depth and what a velocity (n, 3) makes of them.

    None for too few windows, or where an axis of the velocity is not measured.
    """
    at = shared_windows(t_depth, t_velocity, t_attitude)
    if at.size < FEWEST or not np.isfinite(velocity).all():
        return None
    down = down_at(t_velocity, t_attitude, euler)
    lifted = [down[:, [tilt]] * velocity[:, :2] for tilt in (0, 1)]
    rates = np.column_stack([(down * velocity).sum(axis=1), velocity, *lifted])
    parts = integrals(t_velocity, rates, at)
    rise = np.interp(at + WINDOW_S, t_depth, depth) - np.interp(at, t_depth, depth)
    tilt = float(down[:, :2].std(axis=0).max())
    return DepthRates(at, rise, parts[:, 0], parts[:, 1:4], parts[:, 4:], tilt)
