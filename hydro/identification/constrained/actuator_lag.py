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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, Ints, Mask
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD, allows

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


def measured_lag(legs: Sequence[DrivenLeg]) -> ActuatorLag | None:
    """Return the lag of the actuators on legs; None for too short ones."""
    if not legs:
        return None
    blocks = LegBlocks.of([(len(leg.nu), leg.step_s) for leg in legs])
    acting = np.concatenate([leg.actuators for leg in legs])
    swing = np.ptp(acting, axis=0)
    driven = np.flatnonzero(swing > DRIVEN * swing.max(initial=0.0))
    if len(blocks.early) < FEWEST_BLOCKS or not driven.size:
        return None
    own = _own_terms(legs)
    lag = _stepped(legs, own, driven, blocks, loss=True)
    moved = lag.value_s - _stepped(legs, own, driven, blocks, loss=False).value_s
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


def _stepped(
    legs: Sequence[DrivenLeg], own: Sequence[Array], driven: Ints, blocks: LegBlocks, *, loss: bool
) -> ActuatorLag:
    """Return the lag beside columns (n, k) of each axis, and the loss of thrust."""
    nu = np.concatenate([leg.nu for leg in legs])
    acting = np.concatenate([leg.actuators for leg in legs])
    tau_bar = np.concatenate([leg.tau_bar for leg in legs])
    total = 0.0
    for _ in range(STEPS):
        late, later = (_late(legs, max(total, 0.0) + step) for step in (0.0, SLOPE_S))
        left, slope = tau_bar - (late - acting), (later - late) / SLOPE_S
        taken = np.abs(late) * nu if loss else np.zeros((len(nu), 0))
        axes = [
            _Step.of(
                np.column_stack([slope[:, i], own[i], taken[:, i : i + 1]]), left[:, i], blocks
            )
            for i in driven
        ]
        between = _between(axes)
        weight = np.array([1.0 / (axis.sd**2 + between) for axis in axes])
        weight /= weight.sum()
        at = max(total, 0.0)
        total = at + float(weight @ [axis.change for axis in axes])
    halves = float(weight @ [axis.halves for axis in axes])
    noise = float(weight**2 @ [axis.sd**2 for axis in axes])
    return ActuatorLag(
        float(total),
        float(np.sqrt(noise + between + (0.5 * halves) ** 2)),
        {AXES[i]: (at + axis.change, axis.sd) for i, axis in zip(driven, axes, strict=True)},
    )


@dataclass(frozen=True)
class _Step:
    """Change of the lag on one axis: error, and second halves of legs less first."""

    change: float
    sd: float
    halves: float

    @classmethod
    def of(cls, columns: Array, force: Array, blocks: LegBlocks) -> _Step:
        size = np.linalg.norm(columns, axis=0)
        rows = columns / np.where(size > 0.0, size, 1.0)
        pieces = zip(
            np.split(rows, blocks.starts[1:]), np.split(force, blocks.starts[1:]), strict=True
        )
        parts = [(part.T @ part, part.T @ f) for part, f in pieces]
        grams, products = (np.array(each) for each in zip(*parts, strict=True))
        gram, product = grams.sum(axis=0), products.sum(axis=0)
        count, halves = len(blocks.early), (blocks.early, ~blocks.early)
        systems = [
            (gram, product),
            *((grams[half].sum(axis=0), products[half].sum(axis=0)) for half in halves),
            *zip(gram - grams, product - products, strict=True),
        ]
        left = np.array([each[0] for each in systems]) + RIDGE * np.eye(len(gram))
        right = np.array([each[1] for each in systems])
        lags = np.linalg.solve(left, right[..., None])[:, 0, 0] / max(size[0], 1e-300)
        without = lags[3:] - lags[3:].mean()
        sd = np.sqrt((count - 1) / count * np.sum(without**2))
        return cls(float(lags[0]), max(float(sd), 1e-9), float(lags[2] - lags[1]))


def _between(axes: Sequence[_Step]) -> float:
    """Return the variance between axes beyond their noise (DerSimonian & Laird)."""
    weight = np.array([1.0 / axis.sd**2 for axis in axes])
    change = np.array([axis.change for axis in axes])
    mean = float(weight @ change / weight.sum())
    beyond = float(weight @ (change - mean) ** 2) - (len(axes) - 1)
    share = float(weight.sum() - weight @ weight / weight.sum())
    return max(0.0, beyond / share) if share > 0.0 else 0.0


def _late(legs: Sequence[DrivenLeg], lag_s: float) -> Array:
    return np.concatenate(
        [first_order_lag(leg.actuators, lag_s=lag_s, step_s=leg.step_s) for leg in legs]
    )


def _own_terms(legs: Sequence[DrivenLeg]) -> list[Array]:
    """Return per axis the columns (n, k): constant, own acceleration, damping."""
    nu = np.concatenate([leg.nu for leg in legs])
    nu_dot = np.concatenate([leg.nu_dot for leg in legs])
    columns = []
    for i, axis in enumerate(AXES):
        speeds = [x for x in VELOCITIES if allows(axis, x, (PORT_STARBOARD,))]
        terms = [*speeds, *(f"{x}*|{x}|" for x in speeds)]
        columns.append(
            np.column_stack([np.ones(len(nu)), nu_dot[:, i], basis_rows(nu.T, terms=terms).T])
        )
    return columns
