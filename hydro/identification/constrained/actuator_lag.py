"""How late the force of the actuators follows their record, from the motion of a dive.

A thruster needs time to come to speed. Where the vehicle file does not say so, damping
and added mass take the delay over: a linear damping comes out too small, a quadratic one
too large. On each axis

    tau_bar + tau_U = Phi theta + dM nu_dot + tau_U,late(T) + noise,

Phi the linear and quadratic terms of a hull that is alike on port and starboard, with a
constant and |tau_U,late| nu, which is what inflow takes of the thrust; dM an inertia that the
vehicle file does not know, and tau_U,late the recorded force after a first-order lag T. T
follows axis by axis from a few linear steps. Axes, halves of the dive and forms with and
without the loss have to agree: what they differ by stands in its standard deviation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, Ints, Mask
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD, allows
from auvid.hydro.long_series.long_arrays import let_go
from auvid.hydro.long_series.threads import at_once

BLOCK_S = 5.0
"""Pieces of a dive that count as independent for standard errors."""
MOST_BLOCKS = 120
"""Pieces at most; those of a long dive are longer."""
FEWEST_BLOCKS = 8
STEPS = 4
"""Linear steps; the last one moves T by less than a hundredth of a second."""
SLOPE_S = 0.02
"""Difference of two lags whose forces give the slope by the lag."""
SHORTEST_S, LONGEST_S = 0.03, 0.3
"""Lags that are taken. A shorter one moves no coefficient; a longer one is no thruster's:
the fit may go on falling as the recorded force is smoothed away.
"""
CLEAR = 3.0
"""Standard deviations from zero of a lag that is taken; what is left of them stands among
the assumed figures.
"""
CLEAR_AXES = 2
"""Axes that must show a lag clearly, so that it is no error of one of them."""
DRIVEN = 1e-6
"""Share of the largest force from which on an axis counts as driven."""
RIDGE = 1e-10
"""Added to the scaled normal equations, for terms that the motion does not tell apart."""


@dataclass(frozen=True)
class DrivenLeg:
    """One leg on a clock of `step_s`: nu, nu_dot, tau_bar, actuator force (n, 6)."""

    nu: Array
    nu_dot: Array
    tau_bar: Array
    actuators: Array
    step_s: float


@dataclass(frozen=True)
class ActuatorLag:
    """A lag of all actuators [s] with its standard deviation, and axis -> its own.

    The deviation holds the noise, what axes differ by, and half of what halves of the dive
    and the loss of thrust to inflow change.
    """

    value_s: float
    sd_s: float
    by_axis: Mapping[str, tuple[float, float]]

    @property
    def clear(self) -> bool:
        """Return whether it is clear of zero, on several axes."""
        return self.value_s > 0.0 and self.departs_from(0.0)

    def departs_from(self, lag_s: float, sd_s: float = 0.0) -> bool:
        """Return whether it is clear of a stated lag, to one side of it."""
        side = np.sign(self.value_s - lag_s)
        axes = sum(
            side * (value - lag_s) > CLEAR * np.hypot(sd, sd_s)
            for value, sd in self.by_axis.values()
        )
        away = side * (self.value_s - lag_s) > CLEAR * np.hypot(self.sd_s, sd_s)
        return bool(axes >= CLEAR_AXES and away)

    @property
    def by_gyro(self) -> bool:
        """Return whether an axis of rotation shows it clearly.

        A velocity log that is late looks like late thrusters on X, Y and Z, on no other.
        """
        return any(self.by_axis[axis][0] > CLEAR * self.by_axis[axis][1] for axis in self._turning)

    @property
    def _turning(self) -> list[str]:
        return [axis for axis in AXES[3:] if axis in self.by_axis]

    @property
    def of_thrusters(self) -> bool:
        """Return whether thrusters can be so late."""
        return SHORTEST_S <= self.value_s <= LONGEST_S


def measured_lag(legs: Iterable[DrivenLeg]) -> ActuatorLag | None:
    """Return the lag of the actuators on legs; None for too short ones.

    They are gone through several times, one leg after the other.
    """
    lengths, low, high = [], np.full(6, np.inf), np.full(6, -np.inf)
    for leg in legs:
        lengths.append((len(leg.nu), leg.step_s))
        low = np.minimum(low, leg.actuators.min(axis=0))
        high = np.maximum(high, leg.actuators.max(axis=0))
    if not lengths:
        return None
    blocks, swing = LegBlocks.of(lengths), high - low
    driven = np.flatnonzero(swing > DRIVEN * swing.max(initial=0.0))
    if len(blocks.early) < FEWEST_BLOCKS or not driven.size:
        return None
    lag, without = _stepped(legs, driven, blocks)
    moved = lag.value_s - without.value_s
    return replace(lag, sd_s=float(np.hypot(lag.sd_s, 0.5 * moved)))


@dataclass(frozen=True)
class LegBlocks:
    """Pieces of legs that count as independent.

    starts (b,): first sample of each among those of all legs; early (b,): those in the
    first half of their leg. Halves are those of each leg, so that no order of legs counts.
    """

    starts: Ints
    early: Mask

    @classmethod
    def of(cls, legs: Sequence[tuple[int, float]]) -> LegBlocks:
        """Return the blocks of legs of so many samples, so many seconds apart."""
        length = sum(samples * step_s for samples, step_s in legs)
        width = max(BLOCK_S, length / MOST_BLOCKS)
        starts, early, first = [], [], 0
        for samples, step_s in legs:
            block = (np.arange(samples) * step_s / width).astype(np.int64)
            own = np.flatnonzero(np.diff(block, prepend=-1))
            starts.append(first + own)
            early.append(np.arange(len(own)) < len(own) // 2)
            first += samples
        return cls(np.concatenate(starts), np.concatenate(early))

    def pieces(self, first: int, samples: int) -> list[slice]:
        """Return the blocks of the leg of so many samples that begins at `first`."""
        own = self.starts[(self.starts >= first) & (self.starts < first + samples)] - first
        return [slice(*edges) for edges in pairwise([*own.tolist(), samples])]


def _stepped(
    legs: Iterable[DrivenLeg], driven: Ints, blocks: LegBlocks
) -> tuple[ActuatorLag, ActuatorLag]:
    """Return the lag with and without a loss of thrust to inflow."""
    lags_s, both = [0.0, 0.0], []
    for _ in range(STEPS):
        sums, first = [], 0
        for leg in legs:
            let_go()
            pieces = blocks.pieces(first, len(leg.nu))
            first += len(leg.nu)
            pushes = [_push(leg, lag_s) for lag_s in lags_s]
            sums.append(at_once(partial(_products, leg, pushes, pieces), driven.tolist()))
        both = [
            _Steps(
                lag_s,
                [
                    _Step.of(np.concatenate([of_leg[axis][which] for of_leg in sums]), blocks.early)
                    for axis in range(len(driven))
                ],
            )
            for which, lag_s in enumerate(lags_s)
        ]
        lags_s = [max(steps.lag_s, 0.0) for steps in both]
    with_loss, without = (steps.result(driven) for steps in both)
    return with_loss, without


def _push(leg: DrivenLeg, lag_s: float) -> tuple[Array, Array]:
    """Return the force (n, 6) that is late by a lag, and its slope by the lag."""
    late, later = (
        first_order_lag(leg.actuators, lag_s=each, step_s=leg.step_s)
        for each in (lag_s, lag_s + SLOPE_S)
    )
    return late, (later - late) / SLOPE_S


def _products(
    leg: DrivenLeg, pushes: Sequence[tuple[Array, Array]], pieces: Sequence[slice], axis: int
) -> list[Array]:
    """Return the products (b, k, k) of columns and force on one axis, block by block.

    With the loss of thrust to inflow, and without. The slope by the lag comes first, the
    force last.
    """
    speeds = [x for x in VELOCITIES if allows(AXES[axis], x, (PORT_STARBOARD,))]
    terms = [*speeds, *(f"{x}*|{x}|" for x in speeds)]
    own = [np.ones(len(leg.nu)), leg.nu_dot[:, axis], basis_rows(leg.nu.T, terms=terms).T]
    products = []
    for (late, slope), loss in zip(pushes, (True, False), strict=True):
        taken = [np.abs(late[:, axis]) * leg.nu[:, axis]] if loss else []
        force = leg.tau_bar[:, axis] - (late[:, axis] - leg.actuators[:, axis])
        columns = np.column_stack([slope[:, axis], *own, *taken, force])
        products.append(np.array([columns[piece].T @ columns[piece] for piece in pieces]))
    return products


@dataclass(frozen=True)
class _Step:
    """Change of the lag on one axis: error, and second halves of legs less first."""

    change: float
    sd: float
    halves: float

    @classmethod
    def of(cls, products: Array, early: Mask) -> _Step:
        """Return it from products (b, k, k) of columns and force, block by block."""
        size = np.sqrt(np.diag(products.sum(axis=0)))[:-1]
        scale = np.append(np.where(size > 0.0, size, 1.0), 1.0)
        scaled = products / np.outer(scale, scale)
        grams, right = scaled[:, :-1, :-1], scaled[:, :-1, -1]
        gram, product = grams.sum(axis=0), right.sum(axis=0)
        count, halves = len(early), (early, ~early)
        systems = [
            (gram, product),
            *((grams[half].sum(axis=0), right[half].sum(axis=0)) for half in halves),
            *zip(gram - grams, product - right, strict=True),
        ]
        left = np.array([each[0] for each in systems]) + RIDGE * np.eye(len(gram))
        lags = np.linalg.solve(left, np.array([each[1] for each in systems])[..., None])
        lags = lags[:, 0, 0] / max(size[0], 1e-300)
        without = lags[3:] - lags[3:].mean()
        sd = np.sqrt((count - 1) / count * np.sum(without**2))
        return cls(float(lags[0]), max(float(sd), 1e-9), float(lags[2] - lags[1]))


@dataclass(frozen=True)
class _Steps:
    """One step of each driven axis from a common lag."""

    from_s: float
    axes: Sequence[_Step]

    @cached_property
    def between(self) -> float:
        """Return the variance between axes beyond their noise (DerSimonian & Laird)."""
        weight = np.array([1.0 / axis.sd**2 for axis in self.axes])
        change = np.array([axis.change for axis in self.axes])
        mean = float(weight @ change / weight.sum())
        beyond = float(weight @ (change - mean) ** 2) - (len(self.axes) - 1)
        share = float(weight.sum() - weight @ weight / weight.sum())
        return max(0.0, beyond / share) if share > 0.0 else 0.0

    @cached_property
    def weights(self) -> Array:
        """Return the weights of the axes."""
        weight = np.array([1.0 / (axis.sd**2 + self.between) for axis in self.axes])
        return np.asarray(weight / weight.sum())

    @property
    def lag_s(self) -> float:
        """Return the lag after the step."""
        return self.from_s + float(self.weights @ [axis.change for axis in self.axes])

    def result(self, driven: Ints) -> ActuatorLag:
        """Return the lag with its deviation."""
        halves = float(self.weights @ [axis.halves for axis in self.axes])
        noise = float(self.weights**2 @ [axis.sd**2 for axis in self.axes])
        return ActuatorLag(
            self.lag_s,
            float(np.sqrt(noise + self.between + (0.5 * halves) ** 2)),
            {
                AXES[i]: (self.from_s + axis.change, axis.sd)
                for i, axis in zip(driven, self.axes, strict=True)
            },
        )
