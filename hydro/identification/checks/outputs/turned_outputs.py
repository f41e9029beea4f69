"""Outputs that act backward, in any number, or of which two are exchanged.

By axis, the change of a body velocity over windows, less what drag and a constant explain,
is compared with the impulse of thrusters through an allocation, with a gain >= 0 each. Every
set of directions and, of two axes or more, every exchange of two outputs that act is tried; which
of them explains the motion best is taken, where no axis is explained worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.outputs.joined_outputs import (
    AxisProducts,
    WindowMotion,
    joined_allocation,
)

MOST_DIRECTIONS = 8
"""Thrusters of which every set of directions is tried; of more, one backward at a time."""
LEAST_ALLOCATION = 1e-6


@dataclass(frozen=True)
class TurnedOutputs:
    """Places of the outputs that are `backward`, or the pair that is `exchanged`."""

    backward: tuple[int, ...] = ()
    exchanged: tuple[int, ...] = ()


@dataclass(frozen=True)
class OtherWiring:
    """What explains a motion best, and what about as well.

    `log_ratio`: logarithm of its likelihood over that of the outputs as they stand;
    `share` and `own` (k,): shares of the axes that both explain.
    """

    best: TurnedOutputs
    log_ratio: float
    share: Array
    own: Array
    equals: tuple[TurnedOutputs, ...]


def turned_outputs(
    motions: Sequence[WindowMotion],
    impulse: Array,
    allocation: Array,
    direction: Array,
    *,
    equally: float,
    worse: float,
) -> OtherWiring | None:
    """Return what explains a motion better than outputs as they stand, None if nothing.

    motions: the same at several lags behind the outputs; impulse (n, m) of each thruster
    with its direction (m,); allocation (k, m). equally: logarithm of the likelihood below
    the best one within which another explanation is an equal; worse: by how much it may
    be below that of the outputs as they stand in an axis, both at their best lags.
    """
    tried = _tried(np.abs(allocation).max(axis=0) > LEAST_ALLOCATION, exchanges=len(allocation) > 1)
    rows = np.array([_allocation(allocation, direction, item) for item in tried])
    shares = np.array([AxisProducts.of(motion, impulse).shares(rows) for motion in motions])
    by_axis = -0.5 * len(impulse) * np.log1p(-shares)
    place = tried.index(TurnedOutputs())
    lag = int(np.argmax(by_axis[:, place].sum(axis=-1)))
    better = by_axis - by_axis[lag, place]
    odds = np.where(better.min(axis=-1) >= -worse, better.sum(axis=-1), -np.inf)
    at, best = (int(index) for index in np.unravel_index(np.argmax(odds), odds.shape))
    if best == place:
        return None
    return OtherWiring(
        tried[best],
        float(odds[at, best]),
        shares[at, best],
        shares[lag, place],
        tuple(
            item
            for item, its in zip(tried, odds[at], strict=True)
            if odds[at, best] - its < equally and item is not tried[best]
        ),
    )


def _tried(acting: Array, *, exchanges: bool) -> list[TurnedOutputs]:
    """Return what is tried, of thrusters (m,) that act in the axes at all."""
    places = np.flatnonzero(acting).tolist()
    most = len(places) if len(places) <= MOST_DIRECTIONS else 1
    sets = (
        tuple(place for place, turns in zip(places, each, strict=True) if turns)
        for each in product((False, True), repeat=len(places))
        if sum(each) <= most
    )
    pairs = combinations(range(len(acting)), 2) if exchanges else ()
    return [TurnedOutputs(backward=each) for each in sets] + [
        TurnedOutputs(exchanged=pair) for pair in pairs if acting[list(pair)].all()
    ]


def _allocation(allocation: Array, direction: Array, item: TurnedOutputs) -> Array:
    order = list(range(len(direction)))
    if item.exchanged:
        first, last = item.exchanged
        order[first], order[last] = last, first
    rows = joined_allocation(allocation, direction, (tuple(order), None))
    rows[:, list(item.backward)] *= -1.0
    return rows
