"""Whether a motion answers the thrusters in another order, or one of them backward.

By axis, the change of a body velocity over windows side by side, less what drag and a
constant explain, is compared with the impulse of the thrusters through an allocation
B' (k, m): d(nu) = g B' j, g >= 0. Hypotheses: the allocation as it stands; with one
thruster of another strength; with the motion turned, exchanged or of another sign; and
with outputs joined otherwise: one backward, two exchanged, all shifted or reversed, or
thrusters in other places. The last are taken only where they are better than all the
others by far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.kept_results import kept

STRENGTHS = (0.0, 0.5, 1.5)
TURNS = np.radians([-135.0, -90.0, -60.0, -45.0, -30.0, 30.0, 45.0, 60.0, 90.0, 135.0])
"""Turns about the vertical of a velocity log, other explanations of a wrong answer."""
LEAST_PUSH = 1e-9
"""Of the push of single outputs: what is left of less has cancelled to rounding."""
BETTER = 25.0
"""Least logarithm of the likelihood over the best other explanation, samples of half a
second taken as independent. Right wiring has at most 1 in the logs that were tried.
"""
EQUALLY = 10.0
"""Logarithm of the likelihood within which another cause is named beside the best one."""
LEAST_RISE = 0.1
"""By how much more of an axis the outputs must explain where they are joined otherwise."""


Order = tuple[tuple[int, ...], int | None]
"""Output of each thruster, and the thruster that acts backward; places from 0."""


@dataclass(frozen=True)
class WindowMotion:
    """Changes (n, k) of body velocities over windows, and drag terms (n, p)."""

    changes: Array
    drag: Sequence[Array]


@dataclass(frozen=True)
class OtherOrder:
    """Outputs joined otherwise: `source` (m,) of each thruster, `backward` thruster.

    Places count from 0; `geometry`: place of another allocation that was tried instead.
    `share` and `own` (k,): share of each axis that it explains, and that the order as it
    stands does. `log_ratio` over the best other explanation. `equals`: orders and
    geometries that explain the motion about as well.
    """

    source: tuple[int, ...]
    backward: int | None
    share: Array
    own: Array
    log_ratio: float
    geometry: int | None = None
    equals: tuple[tuple[Order, int | None], ...] = ()


@dataclass(frozen=True)
class JoinedOutputs:
    """How outputs are joined: in another way, or None; thrusters whose way is not seen.

    `unseen`: places of the thrusters of which nothing tells whether they act backward;
    `alike`: pairs that may as well be exchanged; `places`: geometries that fit as well.
    """

    other: OtherOrder | None
    unseen: tuple[int, ...]
    alike: tuple[tuple[int, int], ...] = ()
    places: tuple[int, ...] = ()


@kept
def joined_outputs(
    motions: Sequence[WindowMotion],
    impulse: Array,
    allocation: Array,
    direction: Array,
    *,
    linear: int,
    horizontal: bool,
    geometries: Sequence[Array] = (),
) -> JoinedOutputs:
    """Return how the outputs are joined, if not as the allocation (k, m) says.

    motions: the same at several lags behind the outputs, the one that any explanation
    fits best counts; impulse (n, m) of each thruster, with its direction (m,). The first
    `linear` rows are speeds, which a mounting may exchange; `horizontal`: whether the
    first two are surge and sway. `geometries`: allocations of other places of thrusters.
    """
    as_it_is = _same_wiring(allocation, linear=linear, horizontal=horizontal)
    orders = _orders(allocation.shape[1])
    rows = np.array(
        [joined_allocation(allocation, direction, order) for order in orders] + [*geometries]
    )
    pairs = list(combinations(range(len(direction)), 2))
    best: tuple[float, OtherOrder, JoinedOutputs] | None = None
    for motion in motions:
        axes = AxisProducts.of(motion, impulse)
        plain = float(axes.likelihood(as_it_is).max())
        otherwise = axes.likelihood(rows).tolist()
        place = int(np.argmax(otherwise))
        fit = max(plain, otherwise[place])
        if best is None or fit > best[0]:
            causes: list[tuple[Order, int | None]] = [(order, None) for order in orders]
            causes += [((orders[0][0], None), number) for number in range(len(geometries))]
            (source, backward), geometry = causes[place]
            shares = axes.shares(rows[place]), axes.shares(allocation)
            equals = tuple(
                cause
                for cause, fits in zip(causes, otherwise, strict=True)
                if otherwise[place] - fits < EQUALLY and cause is not causes[place]
            )
            ratio = otherwise[place] - plain
            other = OtherOrder(source, backward, *shares, ratio, geometry, equals)
            own = float(axes.likelihood(allocation))
            near = [own - fits < BETTER for fits in otherwise]
            backward_near, pairs_near = np.split(
                near[: len(direction) + len(pairs)], [len(direction)]
            )
            not_told = JoinedOutputs(
                None,
                tuple(np.flatnonzero(backward_near).tolist()),
                tuple(pairs[n] for n in np.flatnonzero(pairs_near)),
                tuple(np.flatnonzero(near[len(orders) :]).tolist()),
            )
            best = fit, other, not_told
    if best is None:
        return JoinedOutputs(None, ())
    _, other, not_told = best
    better = other.log_ratio > BETTER and float(np.max(other.share - other.own)) > LEAST_RISE
    return JoinedOutputs(other, ()) if better else not_told


@dataclass(frozen=True)
class AxisProducts:
    """Products of impulse and change of each axis less its drag terms.

    gram (k, m, m), along (k, m), spread (k,); n samples.
    """

    gram: Array
    along: Array
    spread: Array
    count: int

    @classmethod
    def of(cls, motion: WindowMotion, impulse: Array) -> AxisProducts:
        gram, along, spread = [], [], []
        for change, drag in zip(motion.changes.T, motion.drag, strict=True):
            terms = np.column_stack([np.ones(len(change)), drag])
            size = np.linalg.norm(terms, axis=0)
            basis, _ = np.linalg.qr(terms / np.where(size > 0.0, size, 1.0))
            left, own = (part - basis @ (basis.T @ part) for part in (change, impulse))
            gram.append(own.T @ own)
            along.append(own.T @ left)
            spread.append(max(float(left @ left), 1e-300))
        return cls(np.array(gram), np.array(along), np.array(spread), len(impulse))

    def shares(self, rows: Array) -> Array:
        """Return shares (..., k) of axes that allocations (..., k, m) explain."""
        size = ((rows[..., None, :] @ self.gram)[..., 0, :] * rows).sum(axis=-1)
        # Pushes that cancel leave rounding, which explains nothing.
        single = (rows**2 * np.diagonal(self.gram, axis1=1, axis2=2)).sum(axis=-1)
        size = np.where(size > LEAST_PUSH * single, size, np.inf)
        reach = np.maximum((rows * self.along).sum(axis=-1), 0.0)
        explained = reach**2 / np.maximum(size, 1e-300) / self.spread
        return np.asarray(np.minimum(explained, 1.0 - 1e-12))

    def likelihood(self, rows: Array) -> Array:
        """Return the logarithm of the likelihood (...) over that of no thruster."""
        return np.asarray(-0.5 * self.count * np.log1p(-self.shares(rows)).sum(axis=-1))


def joined_allocation(allocation: Array, direction: Array, order: Order) -> Array:
    """Return the allocation (k, m) of outputs in an order.

    Thruster i has the pulses of output source[i], whose force was made with the
    direction of another one.
    """
    source, backward = order
    place = np.array(source)
    rows = np.zeros_like(allocation)
    rows[:, place] = allocation * (direction * direction[place])
    if backward is not None:
        rows[:, backward] *= -1.0
    return rows


def _same_wiring(allocation: Array, *, linear: int, horizontal: bool) -> Array:
    """Return allocations (h, k, m) of weak thrusters and wrong motions, as it is."""
    count = allocation.shape[1]
    signs = [np.array(each) for each in product((1.0, -1.0), repeat=len(allocation))]
    wrong = [allocation * each[:, None] for each in signs]
    for i in range(count):
        for strength in STRENGTHS:
            wrong.append(allocation * np.where(np.arange(count) == i, strength, 1.0))
    for first, second in combinations(range(linear), 2):
        order = np.arange(len(allocation))
        order[[first, second]] = second, first
        wrong.append(allocation[order])
    for angle in TURNS if horizontal else ():
        turned = allocation.copy()
        turned[:2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]] @ turned[:2]
        wrong.append(turned)
    return np.array(wrong)


def _orders(count: int) -> list[Order]:
    """Return the orders of outputs that are tried, each with its backward thruster."""
    plain = tuple(range(count))
    orders: list[Order] = [(plain, i) for i in range(count)]
    for i, j in combinations(range(count), 2):
        orders.append((tuple({i: j, j: i}.get(k, k) for k in plain), None))
    orders += [((*plain[shift:], *plain[:shift]), None) for shift in range(1, count)]
    return [*orders, (plain[::-1], None)]
