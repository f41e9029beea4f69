"""Drag of an axis at one speed, from its linear and quadratic terms.

A linear and a quadratic term of one axis trade: a dive at nearly one speed determines
their sum there and hardly each. The force at a speed that dives fly is what they agree
on and what alarms watch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.scatter import between_dives, typical_error

FEWEST_DIVES = 3
"""Of an axis that counts in the drag of all: two have no scatter."""
MOST_SCATTER = 0.5
"""Of one dive, over the mean: an axis that scatters more does not count."""
FEWEST_AXES = 2
"""That tell what a further axis scatters by."""


@dataclass(frozen=True)
class DragAtSpeed:
    """Drag of one axis at `speed` [m/s or rad/s], ahead and astern averaged [N or N m].

    force: positive where it brakes. trade: correlation of the linear and the quadratic
    term, nan where only one is fitted.
    """

    speed: float
    force: float
    standard_error: float
    trade: float


def drag_terms(axis: str) -> tuple[str, str]:
    """Return the linear and the quadratic damping term of an axis X, Y, Z, K, M or N.

    >>> drag_terms("N")
    ('r', 'r*|r|')
    """
    velocity = dict(zip("XYZKMN", "uvwpqr", strict=True))[axis]
    return velocity, f"{velocity}*|{velocity}|"


def drag_at_speed(
    terms: Sequence[str], values: ArrayLike, covariance: ArrayLike, *, axis: str, speed: float
) -> DragAtSpeed | None:
    """Return the drag of an axis at a speed from its terms (k,) and covariance (k, k).

    F(U) = -(a U + b U |U|), s^2 = g' C g, g = (U, U |U|). None where neither term is
    fitted or a number is missing.

    >>> terms, sds = ("u", "u*|u|"), np.diag([1.0, 4.0])
    >>> drag = drag_at_speed(terms, [-4.0, -18.0], sds, axis="X", speed=0.5)
    >>> print(drag.force, round(drag.standard_error, 4))
    6.5 0.7071
    """
    damping = drag_terms(axis)
    at = [i for i, term in enumerate(terms) if term in damping]
    if not at:
        return None
    # Of two numbers and four; a fleet has thousands of them.
    numbers, rows = np.asarray(values).tolist(), np.asarray(covariance).tolist()
    own = [float(numbers[i]) for i in at]
    part = [[float(rows[i][j]) for j in at] for i in at]
    if not all(map(math.isfinite, (*own, *chain(*part)))):
        return None
    g = [speed * (1.0 if terms[i] == damping[0] else abs(speed)) for i in at]
    sd = [math.sqrt(row[i]) for i, row in enumerate(part)]
    trade = part[0][1] / (sd[0] * sd[1]) if len(at) == 2 and all(sd) else math.nan
    variance = sum(a * b * cell for a, row in zip(g, part, strict=True)
                   for b, cell in zip(g, row, strict=True))  # fmt: skip
    force = -sum(a * value for a, value in zip(g, own, strict=True))
    return DragAtSpeed(speed, force, math.sqrt(variance), trade)


def common_drag(drags: Sequence[tuple[Array, Array]]) -> tuple[Array, Array] | None:
    """Return the drag of all axes over its mean (k,), and its standard errors (k,).

    drags: values and standard errors (k,) of each axis, nan where a dive has none. With
    m_a the mean of an axis and v_a = (tau_a^2 + s_a^2) / m_a^2,

        y_i = sum_a (y_ai / m_a) / v_a / sum_a 1 / v_a

    over the axes that dive i has. What changes the drag of the hull changes all of them
    by like shares, and their scatter averages out. None for fewer than two axes.
    """
    k = max((len(values) for values, _ in drags), default=0)
    total, moment, variance = np.zeros((3, k))
    count = 0
    for values, errors in drags:
        there = np.isfinite(values) & np.isfinite(errors)
        if there.sum() < FEWEST_DIVES:
            continue
        y, s = values[there], errors[there]
        tau = float(between_dives(y, s).tau_reml)
        own = 1.0 / (s**2 + tau**2)
        mean = float(own @ y / own.sum())
        scatter = math.hypot(tau, float(typical_error(s)))
        if scatter > MOST_SCATTER * mean:
            continue
        weight = (mean / scatter) ** 2
        count += 1
        total[there] += weight
        moment[there] += weight * y / mean
        variance[there] += (weight * s / mean) ** 2
    if count < 2:
        return None
    with np.errstate(invalid="ignore"):  # dives without any
        return moment / total, np.sqrt(variance) / total


def expected_scatters(drags: Sequence[Array]) -> list[float]:
    """Return the scatter of a dive that each axis has, if it is like the other axes.

    drags: values (k,) of each axis in order of time, nan where a dive has none. The scatter
    over the mean is told by the differences of neighbouring dives, which a change between two
    of them hardly moves: sum d^2 / (2 n). Expected is the median of the other axes, nan where
    there are fewer than two.
    """
    shares = []
    for values in drags:
        y = values[np.isfinite(values)]
        steps = np.diff(y)
        enough = len(y) >= FEWEST_DIVES and y.mean() != 0.0
        shares.append(math.sqrt(np.mean(steps**2) / 2.0) / abs(y.mean()) if enough else math.nan)
    expected = []
    for axis, values in enumerate(drags):
        others = [share for at, share in enumerate(shares) if at != axis and share > 0.0]
        enough = len(others) >= FEWEST_AXES and np.isfinite(values).any()
        mean = abs(float(np.nanmean(values))) if enough else math.nan
        expected.append(mean * float(np.median(others)) if enough else math.nan)
    return expected
