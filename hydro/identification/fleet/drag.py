"""Drag of an axis at one speed, from its linear and quadratic terms.

A linear and a quadratic term of one axis trade: a dive at nearly one speed determines
their sum there and hardly each. The force at a speed that dives fly is what they agree
on and what alarms watch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

TRADING = 0.95
"""Correlation from which on two terms are one figure: each has 3.2 times the error that
it would have, were the other one sure. Normal velocities about rest have -.92.
"""


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

    @property
    def terms_trade(self) -> bool:
        """Return whether linear and quadratic term are one figure."""
        return abs(self.trade) >= TRADING


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


def common_speed(conditions: Sequence[Mapping[str, float]], axis: str) -> float:
    """Return the speed at which dives are compared: the median of their rms velocities.

    `conditions`: velocity u, v, w, p, q or r -> its rms on the training legs of a dive.
    """
    return float(np.median([dive[drag_terms(axis)[0]] for dive in conditions]))
