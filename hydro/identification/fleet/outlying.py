"""Dives that do not belong to the others, and what was different on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Ints
from auvid.hydro.identification.fleet.pooling import FEWEST_DIVES, Interval
from auvid.hydro.identification.fleet.scatter import BetweenDives, between_dives

LEVEL = 0.05
"""Probability that a fleet without an outlying dive has one named, all its dives and all
figures looked at together.
"""
HOPELESS = 100.0
"""A figure is left where its farthest dive is so many times too probable to be named."""
BEYOND = 0.5
"""A condition differs when it lies outside the range of the other dives by more than so
much of that range.
"""


@dataclass(frozen=True)
class ConditionDifference:
    """A condition that one dive does not share with the others, in words."""

    condition: str
    words: str


@dataclass(frozen=True)
class OutlyingDive:
    """A dive whose figure the others do not explain.

    dive: its index. figure: name of the coefficient or force. expected: interval of what
    the other dives expect it to show, with its own standard error, at `LEVEL` for one
    dive. deviation: in standard normal deviations (studentised by the other dives alone).
    p: two-sided, before the correction for many looks. differences: what was different.
    """

    dive: int
    figure: str
    value: float
    standard_error: float
    expected: Interval
    deviation: float
    p: float
    differences: tuple[ConditionDifference, ...]


def outlying_dives(
    figures: Mapping[str, tuple[ArrayLike, ArrayLike]],
    conditions: Mapping[str, Sequence[float | str | None]] | None = None,
    *,
    levels: Mapping[str, Ints] | None = None,
) -> tuple[OutlyingDive, ...]:
    """Return the dives that the others do not explain, most unlikely first.

    `figures`: name -> (values (k,), standard errors (k,)), nan where a dive has none.
    `conditions`: name -> a number or word per dive (k), None where unknown: battery
    voltage, water density, depth, tether, temperature, firmware. A dive is left out, the
    others give the distribution of what it should show; the smallest p of all dives and
    figures is compared with LEVEL / (number of looks), the next with one look less
    (Holm 1979), looks that are hopeless left out. Fewer than four dives with a figure are
    not looked at.

    `levels`: name -> number of changes of the figure before each dive (k,); a dive is held
    against those of its level, with the scatter of all about the means of theirs, and not
    looked at where it has its level to itself.
    """
    series = {}
    for name, (values, errors) in figures.items():
        y, s = np.asarray(values, dtype=np.float64), np.asarray(errors, dtype=np.float64)
        dives = np.flatnonzero(np.isfinite(y) & np.isfinite(s))
        of = np.zeros(len(y), dtype=np.int64) if levels is None else levels[name]
        own, count_of = np.unique(of[dives], return_counts=True)
        if len(dives) - len(own) >= FEWEST_DIVES:
            series[name] = y, s, dives[~np.isin(of[dives], own[count_of == 1])], of
    count = sum(len(dives) for _, _, dives, _ in series.values())
    looks = []
    for name, (y, s, dives, of) in series.items():
        for dive in _farthest_first(y, s, dives, of):
            looks.append(_look(name, y, s, dives, of, dive))
            if looks[-1].p > min(LEVEL, HOPELESS * LEVEL / count):
                break
    outlying = []
    for rank, look in enumerate(sorted(looks, key=lambda item: item.p)):
        if look.p > LEVEL / (count - rank):
            break
        outlying.append(_outlying(look, differences(conditions or {}, look.dive)))
    return tuple(outlying)


@dataclass(frozen=True)
class _Look:
    """A dive against the others: its figure, and how improbable that is, two-sided."""

    figure: str
    dive: int
    value: float
    standard_error: float
    others: BetweenDives
    deviation: float
    p: float


def _outlying(look: _Look, different: tuple[ConditionDifference, ...]) -> OutlyingDive:
    low, high = (
        float(look.others.next_dive_quantile(share, look.standard_error))
        for share in (0.5 * LEVEL, 1.0 - 0.5 * LEVEL)
    )
    return OutlyingDive(
        dive=look.dive,
        figure=look.figure,
        value=look.value,
        standard_error=look.standard_error,
        expected=(low, high),
        deviation=look.deviation,
        p=look.p,
        differences=different,
    )


def _farthest_first(y: Array, s: Array, dives: Ints, of: Ints) -> list[int]:
    """Return dives by distance from the middle of their level, the farthest first."""
    away = np.zeros(len(dives))
    for number in np.unique(of[dives]):
        rows = of[dives] == number
        away[rows] = np.abs(y[dives[rows]] - np.median(y[dives[rows]]))
    order = np.argsort(-away / np.sqrt(s[dives] ** 2 + np.median(away) ** 2), kind="stable")
    return [int(dive) for dive in dives[order]]


def _look(name: str, y: Array, s: Array, dives: Ints, of: Ints, dive: int) -> _Look:
    """Return how a dive departs from the others, whether much or little."""
    from scipy.special import ndtri

    others = dives[dives != dive]
    # The level of the dive last: the mean is that of the last one.
    _, levels = np.unique(np.where(of[others] == of[dive], of.max() + 1, of[others]),
                          return_inverse=True)  # fmt: skip
    scatter = between_dives(y[others], s[others], levels=levels)
    # The tail that it lies in, without loss of digits in the upper one.
    below = float(scatter.next_dive_share(y[dive], s[dive]))
    above = float(scatter.next_dive_share(y[dive], s[dive], more=True))
    tail = min(below, above)
    return _Look(
        figure=name,
        dive=dive,
        value=float(y[dive]),
        standard_error=float(s[dive]),
        others=scatter,
        deviation=float(-ndtri(tail) if above < below else ndtri(tail)),
        p=2.0 * tail,
    )


def differences(
    conditions: Mapping[str, Sequence[float | str | None]], dive: int
) -> tuple[ConditionDifference, ...]:
    """Return the conditions that a dive does not share with the others.

    A word differs when no other dive has it; a number when it lies outside the range of
    the others by more than half of that range. Two other dives with the condition are the
    fewest.

    >>> differences({"battery_V": [15.9, 13.2, 15.7, 16.0]}, 1)[0].words
    '13.2, the others 15.7 to 16'
    >>> differences({"firmware": ["4.1", "4.5", "4.1"]}, 1)[0].words
    '4.5, the others 4.1'
    """
    result = []
    for name, row in conditions.items():
        own = row[dive]
        others = [x for i, x in enumerate(row) if i != dive and x is not None]
        if own is None or len(others) < 2:
            continue
        if isinstance(own, str) or any(isinstance(x, str) for x in others):
            if own not in others:
                words = ", ".join(sorted({str(x) for x in others}))
                result.append(ConditionDifference(name, f"{own}, the others {words}"))
            continue
        low, high = min(map(float, others)), max(map(float, others))
        if max(low - own, own - high) > BEYOND * (high - low):
            span = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
            result.append(ConditionDifference(name, f"{own:.4g}, the others {span}"))
    return tuple(result)
