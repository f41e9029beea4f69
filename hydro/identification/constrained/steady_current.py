"""A steady current under a velocity over ground, measured in the forces of a dive.

A velocity log on the bottom does not see the water move. Forces go with the velocity
through the water, nu_r = nu - R' c, and R' c turns with the heading while drag does not:
a dive that turns, or that goes at several speeds, shows c. On surge and sway

    tau_bar(nu_r) = Phi(nu_r) theta + dM nu_dot + noise,

Phi the linear and quadratic terms of a hull that is alike on port and starboard, lift, a
constant, and what inflow takes of the thrust. The two components of c follow for both
axes together, dive by dive, from a few linear steps. Halves of each leg have to agree:
half of what they differ by stands in the covariance. What a dive leaves open is that of
a current of which nothing is known but its usual size.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, Ints, Mask
from auvid.hydro.dynamics.equations_of_motion import residual_force
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD, allows
from auvid.hydro.identification.constrained.actuator_lag import (
    FEWEST_BLOCKS,
    RIDGE,
    LegBlocks,
)
from auvid.hydro.identification.regression.assumed_figures import MeasuredLeg, through_water
from auvid.hydro.long_series.long_arrays import let_go
from auvid.hydro.long_series.threads import at_once

STEPS = 4
"""Linear steps; the last one moves a current by less than a millimetre a second."""
SLOPE_M_S = 0.02
"""Difference of two currents whose forces give the slope by the current."""
LONGEST_STEP_M_S, FASTEST_M_S = 0.3, 1.5
"""Of one step, and of a current that is taken."""
LEAST_SD_M_S = 0.005
"""Below which forms of drag and errors of sensors move a current."""
CLEAR, MATTERS_M_S = 4.0, 0.03
"""Standard deviations from zero of a clear current, and the size from which on it counts."""
SURE_SHARE = 0.5
"""Of the usual standard deviation, from which down the legs show a current."""
PIECE_S, MOST_PIECES = 20.0, 60
"""Over which a current counts as constant where its scatter is measured; pieces at most."""
AXES_USED = (0, 1)


@dataclass(frozen=True)
class LegOverGround:
    """One leg of dive `log`: its motion over ground, and its actuators.

    tau_bar, actuators (n, 6): the force to be explained, and that of actuators, late.
    """

    log: str
    measured: MeasuredLeg
    tau_bar: Array
    actuators: Array


@dataclass(frozen=True)
class SteadyCurrent:
    """The current of a dive towards north and east [m/s].

    value (2,), covariance (2, 2); shows: whether the legs say more of it than is usual.
    """

    value: Array
    covariance: Array
    shows: bool = False

    @property
    def bearing_deg(self) -> float:
        """Return where it goes, clockwise from north [deg]."""
        return float(np.degrees(np.arctan2(self.value[1], self.value[0])) % 360.0)

    @property
    def speed(self) -> float:
        """Return its size [m/s]."""
        return float(np.linalg.norm(self.value))

    @property
    def sd(self) -> Array:
        """Return the standard deviations (2,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def clear(self) -> bool:
        """Return whether it is clear of zero, and large enough to count."""
        odds = float(self.value @ np.linalg.solve(self.covariance, self.value))
        return odds > CLEAR**2 and self.speed > MATTERS_M_S

    @property
    def established(self) -> Array:
        """Return the current (3,), NED, that the forces show clearly, else 0."""
        return np.append(self.value, 0.0) if self.clear else np.zeros(3)

    @property
    def errors(self) -> Array:
        """Return two independent currents (2, 3), NED, that `established` errs by.

        One standard deviation each; of one that is not clear its own size counts, too.
        """
        doubt = np.zeros((2, 2)) if self.clear else np.outer(self.value, self.value)
        size, axes = np.linalg.eigh(doubt + self.covariance)
        return np.column_stack([(axes * np.sqrt(np.maximum(size, 0.0))).T, np.zeros(2)])

    @property
    def rms(self) -> float:
        """Return the RMS [m/s] of what still water errs by, of a component."""
        total = float(self.value @ self.value + np.trace(self.covariance))
        return float(np.sqrt(0.5 * total))


def measured_currents(
    legs: Iterable[LegOverGround], vehicle: Vehicle, *, usual_m_s: float
) -> dict[str, SteadyCurrent]:
    """Return the current of every dive; drag is that of all legs together.

    usual_m_s: standard deviation of each component before the legs are looked at. They are
    gone through several times, one leg after the other.
    """
    lengths = [(leg.log, len(leg.measured.nu), leg.measured.step_s) for leg in legs]
    logs = tuple(sorted({log for log, *_ in lengths}))
    if not logs:
        return {}
    blocks = LegBlocks.of([(samples, step_s) for _, samples, step_s in lengths])
    usual = usual_m_s**2 * np.eye(2 * len(logs))
    if len(blocks.early) < FEWEST_BLOCKS:
        return {log: SteadyCurrent(np.zeros(2), usual[:2, :2]) for log in logs}
    at = np.zeros((len(logs), 2))
    for _ in range(STEPS):
        equations = _Equations.of(legs, vehicle, logs, at, blocks)
        at = _limited(at + _limited(equations.step(usual, at), LONGEST_STEP_M_S), FASTEST_M_S)
    equations = _Equations.of(legs, vehicle, logs, at, blocks)
    precision = np.linalg.inv(equations.covariance(blocks.early, usual, at))
    after = np.linalg.inv(precision + np.linalg.inv(usual))
    mean = after @ precision @ (at.ravel() + equations.free_step())
    currents = {}
    for i, log in enumerate(logs):
        own = slice(2 * i, 2 * i + 2)
        shows = bool((np.diag(after)[own] < SURE_SHARE**2 * usual_m_s**2).all())
        currents[log] = SteadyCurrent(mean[own], after[own, own], shows)
    return currents


def current_scatter(
    legs: Sequence[LegOverGround],
    vehicle: Vehicle,
    currents: Mapping[str, SteadyCurrent],
    *,
    usual_m_s: float,
) -> float:
    """Return by how much currents change within dives [m/s], of a component.

    Pieces of `PIECE_S` have a current each, beside one drag. Their noise is independent from
    piece to piece, a current that changes slowly is not: what neighbours depart by together
    is its variance.
    """
    pieces: list[LegOverGround] = []
    dives: list[str] = []
    follows: list[bool] = []
    length_s = sum(len(leg.tau_bar) * leg.measured.step_s for leg in legs)
    piece_s = max(PIECE_S, length_s / MOST_PIECES)
    for index, leg in enumerate(legs):
        count = max(1, round(len(leg.tau_bar) * leg.measured.step_s / piece_s))
        edges = np.linspace(0, len(leg.tau_bar), count + 1).astype(int).tolist()
        for part in map(slice, edges[:-1], edges[1:]):
            motion, force = leg.measured.rows(part), leg.tau_bar[part]
            name = f"{index} {part.start}"
            pieces.append(LegOverGround(name, motion, force, leg.actuators[part]))
            dives.append(leg.log)
            follows.append(part.start > 0)
    blocks = LegBlocks.of([(len(piece.tau_bar), piece.measured.step_s) for piece in pieces])
    if not any(follows) or len(blocks.early) < FEWEST_BLOCKS:
        return 0.0
    at = np.array([currents[dive].value for dive in dives])
    usual = usual_m_s**2 * np.eye(at.size)
    equations = _Equations.of(pieces, vehicle, [piece.log for piece in pieces], at, blocks)
    away = equations.free_step().reshape(-1, 2)
    noise = np.diag(equations.covariance(blocks.early, usual, at)).reshape(-1, 2)
    weight = 1.0 / (noise + SLOPE_M_S**2)
    for dive in set(dives):
        own = np.array(dives) == dive
        away[own] -= (weight[own] * away[own]).sum(axis=0) / weight[own].sum(axis=0)
    second = np.flatnonzero(follows)
    pair = np.sqrt(weight[second] * weight[second - 1])
    together = float((pair * away[second] * away[second - 1]).sum() / pair.sum())
    return float(np.sqrt(max(together, 0.0)))


@dataclass(frozen=True)
class _Equations:
    """Normal equations of the currents (first c columns) and of drag, block by block.

    A block has the one current of its leg: grams (b, 2 + k, 2 + k) and products (b, 2 + k)
    of that and of the drag on all axes, columns of unit length; logs (b,): whose current it
    is, by number; sizes (c,): what the columns of currents were divided by; per_block:
    samples of a block.
    """

    grams: Array
    products: Array
    logs: Ints
    sizes: Array
    per_block: float

    @classmethod
    def of(
        cls,
        legs: Iterable[LegOverGround],
        vehicle: Vehicle,
        logs: Sequence[str],
        at: Array,
        blocks: LegBlocks,
    ) -> _Equations:
        """Return them linear about currents `at` (l, 2)."""
        c, legs_of_axis, first = 2 * len(logs), [list[_OfLeg]() for _ in AXES_USED], 0
        for leg in legs:
            let_go()
            pieces = blocks.pieces(first, len(leg.tau_bar))
            first += len(leg.tau_bar)
            of_axis = _linear(leg, vehicle, at, logs.index(leg.log), pieces)
            for earlier, own in zip(legs_of_axis, of_axis, strict=True):
                earlier.append(own)
        axes = [_Axis.of(of_axis, c, first) for of_axis in legs_of_axis]
        sizes = np.sqrt(sum((axis.lengths[:c] / axis.rms) ** 2 for axis in axes))
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        log = np.concatenate([np.full(len(own.products), own.log) for own in legs_of_axis[0]])
        width, start = 2 + sum(len(axis.lengths) - c for axis in axes), 2
        grams = np.zeros((len(log), width, width))
        products = np.zeros((len(log), width))
        for axis in axes:
            drag = np.where(axis.lengths[c:] > 0.0, axis.lengths[c:], 1.0)
            own = np.r_[0:2, start : start + len(drag)]
            start += len(drag)
            scale = np.column_stack(
                [
                    axis.rms * sizes.reshape(-1, 2)[log],
                    np.tile(np.append(drag, axis.rms), (len(log), 1)),
                ]
            )
            scaled = axis.products / (scale[:, :, None] * scale[:, None, :])
            grams[:, own[:, None], own] += scaled[:, :-1, :-1]
            products[:, own] += scaled[:, :-1, -1]
        return cls(grams, products, log, sizes, first / len(log))

    def step(self, usual: Array, at: Array, kept: Mask | None = None) -> Array:
        """Return the step (l, 2) towards the likeliest currents, with what is usual.

        A block counts as one sample against it.
        """
        gram, product = self._sums(kept)
        pull = self.per_block * np.linalg.inv(usual) / np.outer(self.sizes, self.sizes)
        c = len(pull)
        gram[:c, :c] += pull
        product[:c] -= pull @ (at.ravel() * self.sizes)
        return np.reshape(self._solved(gram, product), at.shape)

    def free_step(self) -> Array:
        """Return the step (c,) without what is usual."""
        return self._solved(*self._sums())

    def covariance(self, early: Mask, usual: Array, at: Array) -> Array:
        """Return the covariance (c, c) of `free_step`.

        Of blocks left out in turn, half of what the halves of the legs differ by, and
        what white noise alone leaves of a current that nothing shows.
        """
        (gram, product), count = self._sums(), len(early)
        steps = np.array([self._without(block, gram, product) for block in range(count)])
        away = steps - steps.mean(axis=0)
        halves = self.step(usual, at, early) - self.step(usual, at, ~early)
        half = 0.5 * halves.ravel()
        c = len(self.sizes)
        white = np.linalg.inv(gram + RIDGE * np.eye(len(gram)))[:c, :c]
        return np.asarray(
            (count - 1) / count * away.T @ away
            + np.outer(half, half)
            + white / np.outer(self.sizes, self.sizes)
            + LEAST_SD_M_S**2 * np.eye(c)
        )

    def _columns(self, block: int) -> Ints:
        """Return where what a block says lies among all currents and drag."""
        own, c = 2 * self.logs[block], len(self.sizes)
        return np.asarray(np.r_[own : own + 2, c : c + self.grams.shape[1] - 2])

    def _sums(self, kept: Mask | None = None) -> tuple[Array, Array]:
        """Return the sums (c + k, c + k), (c + k,) over all blocks, or some."""
        width = len(self.sizes) + self.grams.shape[1] - 2
        gram, product = np.zeros((width, width)), np.zeros(width)
        blocks = np.ones(len(self.logs), bool) if kept is None else kept
        for block in np.flatnonzero(blocks).tolist():
            own = self._columns(block)
            gram[own[:, None], own] += self.grams[block]
            product[own] += self.products[block]
        return gram, product

    def _without(self, block: int, gram: Array, product: Array) -> Array:
        """Return the step (c,) of the sums less one block."""
        own, left, force = self._columns(block), gram.copy(), product.copy()
        left[own[:, None], own] -= self.grams[block]
        force[own] -= self.products[block]
        return self._solved(left, force)

    def _solved(self, gram: Array, product: Array) -> Array:
        """Return the currents (c,) of a system."""
        left = gram + RIDGE * np.eye(len(gram))
        return np.asarray(np.linalg.solve(left, product)[: len(self.sizes)] / self.sizes)


def _limited(vectors: Array, longest: float) -> Array:
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors * np.minimum(1.0, longest / np.maximum(size, 1e-12)))


@dataclass(frozen=True)
class _OfLeg:
    """What a leg says on an axis: drag (k columns), force, and changes by currents.

    Changes by the one component of the current come before those by the other.
    triangle (m, m): R of all samples, m = 3 (k + 1); products (b, m, m): block by block;
    log: whose current it has, by number.
    """

    triangle: Array
    products: Array
    log: int

    def onto(self, drag: Array) -> Array:
        """Return what makes current, columns and force (m, 2 + k + 1) of its own."""
        size = len(drag) + 1
        matrix = np.zeros((3 * size, 2 + size))
        matrix[:size, 2:] = np.eye(size)
        for i in range(2):
            matrix[(i + 1) * size : (i + 2) * size, i] = np.append(drag, -1.0) / (2.0 * SLOPE_M_S)
        return matrix


@dataclass(frozen=True)
class _Axis:
    """Currents (c), drag (k) and force of an axis over all legs.

    lengths (c + k,): of the columns; rms: what they leave of the force; products
    (b, 2 + k + 1, 2 + k + 1): block by block, of the one current of the block.
    """

    lengths: Array
    rms: float
    products: Array

    @classmethod
    def of(cls, legs: Sequence[_OfLeg], c: int, samples: int) -> _Axis:
        """Return it of legs with c currents, and so many samples."""
        size = legs[0].triangle.shape[1] // 3
        drag, _ = _least_squares(np.vstack([leg.triangle[:, :size] for leg in legs]))
        rows, products = [], []
        for leg in legs:
            onto = leg.onto(drag)
            own = np.zeros((len(leg.triangle), c + size))
            own[:, np.r_[2 * leg.log : 2 * leg.log + 2, c : c + size]] = leg.triangle @ onto
            rows.append(own)
            products.append(onto.T @ leg.products @ onto)
        stacked = np.vstack(rows)
        return cls(
            np.linalg.norm(stacked[:, :-1], axis=0),
            _least_squares(stacked)[1] / float(np.sqrt(samples)),
            np.concatenate(products),
        )


def _least_squares(rows: Array) -> tuple[Array, float]:
    """Return the factors of the other columns that make the last, and what is left."""
    columns, force = rows[:, :-1], rows[:, -1]
    sizes = np.linalg.norm(columns, axis=0)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    factors = np.linalg.lstsq(columns / sizes, force, rcond=RIDGE)[0] / sizes
    return factors, float(np.linalg.norm(force - columns @ factors))


def _linear(
    leg: LegOverGround, vehicle: Vehicle, at: Array, log: int, pieces: Sequence[slice]
) -> list[_OfLeg]:
    """Return what a leg says on surge and sway, linear about currents `at` (l, 2)."""
    still = replace(leg, tau_bar=leg.tau_bar - _force(leg.measured, vehicle))
    points = SLOPE_M_S * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
    moved = at_once(partial(_over_moving_water, still, vehicle), list(at[log] + points))

    def of_axis(index: int) -> _OfLeg:
        here, *others = (axes[index] for axes in moved)
        changes = [others[i] - others[i + 1] for i in (0, 2)]
        rows = np.hstack([here, *changes])
        products = np.array([rows[piece].T @ rows[piece] for piece in pieces])
        return _OfLeg(np.asarray(np.linalg.qr(rows, mode="r")), products, log)

    return at_once(of_axis, range(len(AXES_USED)))


def _over_moving_water(leg: LegOverGround, vehicle: Vehicle, current: Array) -> list[Array]:
    """Return for surge and sway the columns of drag and the force (n, k + 1).

    The force of `leg` is without what the vehicle's motion over ground says of it.
    """
    moving = through_water(leg.measured, np.array([*current, 0.0]))
    force, axes = leg.tau_bar + _force(moving, vehicle), []
    for index in AXES_USED:
        speeds = [x for x in VELOCITIES if allows(AXES[index], x, (PORT_STARBOARD,))]
        terms = [*speeds, *(f"{x}*|{x}|" for x in speeds), *(f"u*{x}" for x in speeds if x != "u")]
        own = moving.nu[:, index]
        columns = [
            np.ones(len(own)),
            moving.nu_dot[:, index],
            basis_rows(moving.nu.T, terms=terms).T,
            np.abs(leg.actuators[:, index]) * own,
            force[:, index],
        ]
        axes.append(np.column_stack(columns))
    return axes


def _force(leg: MeasuredLeg, vehicle: Vehicle) -> Array:
    """Return the force (n, 6) that damping is to explain."""
    return residual_force(vehicle, leg.eta, leg.nu, leg.nu_dot, leg.control).tau_bar
