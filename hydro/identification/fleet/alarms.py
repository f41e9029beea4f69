"""Changes of a vehicle between its dives, watched for dive by dive.

After each dive every earlier dive is tried as the first one of a new level. With the
scatter between dives tau uncertain as in `scatter.py`, the odds of a change after dive c
against none are

    B_c = sum_tau weight N(D; 0, V + r^2 (tau^2 + s^2)) / N(D; 0, V),

D the difference of the means after and before c given tau, V its variance, s the typical
error and r the size of a change in scatters of one dive. The alarm is raised where the
largest B_c passes a limit that fleets of so many dives without a change pass as rarely as
stated. Where like figures of the vehicle show what one dive scatters by, tau is expected to
be like theirs: four or five dives before a change hardly tell it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Ints
from auvid.hydro.identification.fleet.pooling import Interval
from auvid.hydro.identification.fleet.scatter import BetweenDives, between_dives, typical_error

FEWEST_BEFORE = 3
"""Dives before a change: two have no scatter to compare it with."""
SIZE = 1.0
"""r: the size of a change that is looked for, in scatters of one dive."""
GRID = 60
"""Values of tau: the odds are sums over them."""
MOST_DIVES, LATER = 60, 5
"""The last dives that are looked at, after each one of them; later after each fifth."""
FALSE_ALARMS = 0.05
"""Probability of an alarm in all dives there are without a change, all figures together."""
LIMITS = {0.1: 1.67, 0.05: 2.04, 0.02: 2.42, 0.01: 2.64, 0.005: 2.91, 0.002: 3.28, 0.001: 3.49}
"""False alarms in ten dives of one figure -> limit of the logarithm of the odds.

Quantiles over fleets without a change, the largest over scatters of 0, .5, .8, .95 and .99
of the variance between dives (decision 0057).
"""
MORE_DIVES = {10: (0.0, 0.0), 20: (1.1, 0.35), 30: (1.8, 0.45), 50: (2.45, 0.6), 100: (3.25, 0.6)}
"""Dives -> what the limit is higher than in ten: at .05, and per factor e below."""


@dataclass(frozen=True)
class ChangeAlarm:
    """A figure that changed between two dives.

    dive: index of the dive after which the alarm is raised. first_dive: index of the most
    probable first dive of the new level. before, after: means of the two levels in the
    figure's unit. change: after less before, with its 95 % interval; share: the same over
    `before`. log_odds: natural logarithm of the odds, above `limit`.
    """

    figure: str
    dive: int
    first_dive: int
    before: float
    after: float
    change: float
    change_interval: Interval
    share: float
    log_odds: float
    limit: float


def change_odds(values: ArrayLike, errors: ArrayLike, *, size: float = SIZE) -> Array:
    """Return the log odds (..., k - 3) of a change that came with dive 3, 4, ... k - 1.

    Natural logarithms of the odds against no change, of values (..., k) with standard
    errors (..., k) in order of time, k 4 or more.
    """
    return change_odds_and_sizes(values, errors, size=size)[0]


def change_odds_and_sizes(
    values: ArrayLike,
    errors: ArrayLike,
    *,
    size: float = SIZE,
    expected: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Return the log odds of `change_odds`, and how large each change would be.

    Both (..., k - 3); the size is the mean after less that before, in the unit of values.
    `expected` (...): scatter of a dive that like figures show, nan for none.
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    scatter = between_dives(y, s, grid=GRID, expected=expected)
    difference, variance = _contrast(scatter, y, s)
    sizes = (scatter.weight[..., None] * difference).sum(axis=-2)
    wide = size**2 * (scatter.tau**2 + typical_error(s)[..., None] ** 2)
    prior = variance + wide[..., None]
    ratio = variance / prior
    difference *= difference
    difference *= (1.0 - ratio) / variance
    odds = np.log(ratio, out=ratio)
    odds += difference
    odds *= 0.5
    odds += scatter.log_weight[..., None]
    return _log_sum(odds), sizes


def _log_sum(values: Array) -> Array:
    """Return the logarithm (..., c) of summed exponentials of values (..., g, c)."""
    largest = values.max(axis=-2, keepdims=True)
    total: Array = np.log(np.exp(values - largest).sum(axis=-2)) + largest[..., 0, :]
    return total


def change_alarms(
    figures: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    false_alarms: float = FALSE_ALARMS,
    shares: Mapping[str, float] = MappingProxyType({}),
    rises: Mapping[str, float] = MappingProxyType({}),
    expected: Mapping[str, float] = MappingProxyType({}),
) -> tuple[ChangeAlarm, ...]:
    """Return the changes of figures over dives in order of time, earliest first.

    `figures`: name -> (values (k,), standard errors (k,)), nan where a dive has none.
    `shares`: name -> its share of the probability of false alarms; the other figures have
    equal ones of the rest. `rises`: name -> the part of its share that rises have, falls
    have what is left; half where it is not named. `expected`: name -> scatter of a dive that
    like figures show. After an alarm the dives before the change
    no longer count, and the limit grows with the number of dives: of any number of them
    without a change an alarm is as rare.
    """
    own = {name: shares[name] for name in figures if name in shares}
    rest = (1.0 - sum(own.values())) / max(len(figures) - len(own), 1)
    watches = [
        _Watch(
            name,
            *map(np.asarray, pair),
            rate=false_alarms * own.get(name, rest),
            rises=rises.get(name, 0.5),
            expected=expected.get(name, np.nan),
        )
        for name, pair in figures.items()
    ]
    alarms: list[ChangeAlarm] = []
    while watches := [watch for watch in watches if watch.end <= len(watch.dives)]:
        # Those that look at as many dives are worked out as one batch.
        alike: dict[int, list[_Watch]] = defaultdict(list)
        for watch in watches:
            alike[len(watch.level)].append(watch)
        for group in alike.values():
            values = np.array([watch.values[watch.level] for watch in group])
            errors = np.array([watch.errors[watch.level] for watch in group])
            like = np.array([watch.expected for watch in group])
            odds = change_odds_and_sizes(values, errors, expected=like)
            for watch, *looks in zip(group, *odds, strict=True):
                alarms += watch.look(*looks)
    return tuple(sorted(alarms, key=lambda alarm: (alarm.dive, alarm.figure)))


class _Watch:
    """A figure that is watched dive by dive: from which dive on, and to which."""

    def __init__(
        self,
        name: str,
        values: Array,
        errors: Array,
        *,
        rate: float,
        rises: float,
        expected: float,
    ) -> None:
        self.name, self.expected = name, expected
        self.values, self.errors = values.astype(np.float64), errors.astype(np.float64)
        self.dives = np.flatnonzero(np.isfinite(self.values) & np.isfinite(self.errors))
        # A limit is passed by as many rises as falls.
        self.rise_limit, self.fall_limit = (
            alarm_limit(2.0 * rate * part, len(self.dives)) for part in (rises, 1.0 - rises)
        )
        self.start, self.end = 0, FEWEST_BEFORE + 1

    @property
    def level(self) -> Ints:
        """Return the dives looked at."""
        return self.dives[max(self.start, self.end - MOST_DIVES) : self.end]

    def look(self, odds: Array, sizes: Array) -> Iterator[ChangeAlarm]:
        """Yield an alarm where odds (c,) pass the limit of their side, and move on."""
        self.start = max(self.start, self.end - MOST_DIVES)
        limits = np.where(sizes > 0.0, self.rise_limit, self.fall_limit)
        passing = np.where(odds > limits, odds, -np.inf)
        at = int(np.argmax(passing))
        if np.isfinite(passing[at]):
            first, largest, limit = FEWEST_BEFORE + at, float(odds[at]), float(limits[at])
            yield _alarm(self.name, self.values, self.errors, self.level, first, largest, limit)
            self.start += first
            self.end = max(self.end, self.start + FEWEST_BEFORE)
        later = self.end >= MOST_DIVES and self.end + LATER <= len(self.dives)
        self.end += LATER if later else 1


def alarm_limit(false_alarms: float, dives: int = 10) -> float:
    """Return the limit that one figure without a change passes as rarely as that.

    In so many dives, ten at least. Linear in the logarithm of the probability and of the
    number of dives, also beyond the tables.

    >>> alarm_limit(0.05, 5) == alarm_limit(0.05, 10) < alarm_limit(0.05, 30)
    True
    """
    at = np.log(false_alarms)
    ten = _line(-np.log(list(LIMITS)), list(LIMITS.values()), -at)
    by_dives = np.array(list(MORE_DIVES.values())).T
    of_dives = np.log(max(dives, 10))
    level, slope = (_line(np.log(list(MORE_DIVES)), list(row), of_dives) for row in by_dives)
    return ten + level + slope * max(float(np.log(FALSE_ALARMS) - at), 0.0)


def _line(x: Array, y: Sequence[float], at: float) -> float:
    """Return the value at a place, on the last piece beyond the end."""
    if at > x[-1]:
        return float(y[-1] + (y[-1] - y[-2]) / (x[-1] - x[-2]) * (at - x[-1]))
    return float(np.interp(at, x, y))


def _contrast(scatter: BetweenDives, y: Array, s: Array) -> tuple[Array, Array]:
    """Return mean after less mean before (..., g, c), and its variance."""
    weight = 1.0 / (s[..., None, :] ** 2 + scatter.tau[..., None] ** 2)
    total = np.cumsum(weight, axis=-1)
    weight *= y[..., None, :]
    moment = np.cumsum(weight, axis=-1)
    before, first = total[..., FEWEST_BEFORE - 1 : -1], moment[..., FEWEST_BEFORE - 1 : -1]
    after, second = total[..., -1:] - before, moment[..., -1:] - first
    return second / after - first / before, 1.0 / before + 1.0 / after


def _alarm(
    name: str, y: Array, s: Array, level: Ints, first: int, odds: float, limit: float
) -> ChangeAlarm:
    """Return the alarm of a change at place `first` of the dives `level`."""
    values, errors = y[level], s[level]
    # The scatter without the change: each level about its own mean.
    own = between_dives(values - np.where(np.arange(len(values)) < first, 0.0, np.nan_to_num(
        np.average(values[first:], weights=1.0 / errors[first:] ** 2)
        - np.average(values[:first], weights=1.0 / errors[:first] ** 2)
    )), errors)  # fmt: skip
    difference, variance = _contrast(own, values, errors)
    at = first - FEWEST_BEFORE
    mean = float(own.weight @ difference[:, at])
    spread = own.weight @ (variance[:, at] + (difference[:, at] - mean) ** 2)
    half = 1.96 * float(np.sqrt(spread))
    weight = 1.0 / (errors**2 + float(own.tau_reml) ** 2)
    before = float(np.average(values[:first], weights=weight[:first]))
    return ChangeAlarm(
        figure=name,
        dive=int(level[-1]),
        first_dive=int(level[first]),
        before=before,
        after=before + mean,
        change=mean,
        change_interval=(mean - half, mean + half),
        share=mean / before,
        log_odds=odds,
        limit=limit,
    )
