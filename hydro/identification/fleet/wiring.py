"""Whether two thruster outputs are exchanged, or one thruster acts backward.

The force that the motion needs, F = tau_bar + B f, is compared with B' f for the
allocation B as it stands and for each that an exchange of two of its columns, or one
column of the other sign, makes. On each axis

    F = Phi theta + g (B' f) + noise,   g >= 0,

Phi the damping terms of a hull that is alike on port and starboard, with a constant, and
f the thrust after a common lag. The fault that leaves least of F is named if the logarithm
of its likelihood over that of B as it stands,

    sum over axes of n / (2 tau) ln(S / S'),

S and S' the squares that they leave, exceeds `CERTAIN`, also without the block of the dive
that speaks most for it. tau counts the samples that belong together, by the
autocorrelation of what the fault leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, Ints, Mask
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD, allows
from auvid.hydro.identification.fleet.thruster_strength import ThrusterLeg

LAGS_S = (0.0, 0.1, 0.2, 0.3)
"""Thrust lags that are tried; the one with the least residuals is taken."""
BLOCK_S = 5.0
"""Pieces of a dive, one of which may not decide: the tether may have pulled in it."""
FEWEST_BLOCKS = 12
CERTAIN = float(np.log(36 * 1000))
"""Least logarithm of the ratio of likelihoods. Where the wiring is right, a ratio exceeds c
with a probability of at most 1 / c (Markov), so that of 36 faults in one of 1000 dives.
"""
LEAST_GAIN = 0.05
"""Least part of what is left as it stands that a fault must explain, mean of the axes."""
LEAST_CORRELATION = 0.05
"""Samples whose residuals correlate by less count as independent."""


@dataclass(frozen=True)
class WiringFault:
    """Outputs, counted from 1: two that are exchanged, or one that acts backward.

    `gain`: part of the squared residual that goes with the fault, mean of the axes it
    concerns; `log_ratio`: logarithm of its likelihood over that of the wiring as it stands,
    the smaller of that on all of the dive and that without the block that speaks most for it.
    """

    outputs: tuple[int, ...]
    gain: float
    log_ratio: float


@dataclass(frozen=True)
class _Axis:
    """Force needed (n,) and thrusts (n, m) less the axis's own terms; products."""

    needed: Array
    thrust: Array
    gram: Array
    product: Array

    @classmethod
    def of(cls, needed: Array, thrust: Array) -> _Axis:
        return cls(needed, thrust, thrust.T @ thrust, thrust.T @ needed)

    def left(self, row: Array) -> float:
        """Return the squared residual with a row (m,) of an allocation."""
        along, size = float(row @ self.product), float(row @ self.gram @ row)
        unmodelled = float(self.needed @ self.needed)
        return unmodelled - along**2 / size if along > 0.0 and size > 0.0 else unmodelled

    def residual(self, row: Array) -> Array:
        """Return the residual (n,) with a row (m,) of an allocation."""
        along, size = float(row @ self.product), float(row @ self.gram @ row)
        gain = along / size if along > 0.0 and size > 0.0 else 0.0
        return self.needed - gain * (self.thrust @ row)


def wiring_fault(legs: Sequence[ThrusterLeg], allocation: Array) -> WiringFault | None:
    """Return the fault of wiring or allocation (6, m) that the legs show, or None."""
    allocations = _faulty(allocation)

    def least(lagged: tuple[list[_Axis], Ints]) -> float:
        return min(_cost(lagged[0], each) for each in (allocation, *allocations.values()))

    axes, block = min((_axes(legs, allocation, lag_s) for lag_s in LAGS_S), key=least)
    costs = {outputs: _cost(axes, each) for outputs, each in allocations.items()}
    outputs = min(costs, key=lambda key: costs[key])
    if int(block[-1]) + 1 < FEWEST_BLOCKS or costs[outputs] >= _cost(axes, allocation):
        return None
    pairs = [
        (axes[axis].residual(own), axes[axis].residual(other))
        for axis, (own, other) in enumerate(zip(allocation, allocations[outputs], strict=True))
        if not np.array_equal(own, other)
    ]
    better = sum(
        np.bincount(block, (as_is**2 - changed**2) / np.mean(as_is**2)) for as_is, changed in pairs
    )
    rest = block != np.argmax(better)
    ratio = min(_log_ratio(pairs, kept) for kept in (np.ones_like(rest), rest))
    gain = float(np.mean([1.0 - np.sum(other**2) / np.sum(own**2) for own, other in pairs]))
    fault = WiringFault(outputs, gain, ratio)
    return fault if fault.gain > LEAST_GAIN and fault.log_ratio > CERTAIN else None


def _log_ratio(pairs: Sequence[tuple[Array, Array]], kept: Mask) -> float:
    """Return sum n / (2 tau) ln(S / S') of residuals as is and with the fault."""
    return sum(
        0.5
        * float(kept.sum())
        / _samples_together(other)
        * float(np.log(np.sum(own[kept] ** 2) / np.sum(other[kept] ** 2)))
        for own, other in pairs
    )


def _samples_together(residual: Array) -> float:
    """Return tau = 1 + 2 sum of the autocorrelation until it is below its least."""
    x = residual - residual.mean()
    power = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
    correlation = np.fft.irfft(power)[: len(x)] / float(x @ x)
    end = int(np.argmax(np.append(correlation < LEAST_CORRELATION, True)))
    return 1.0 + 2.0 * float(correlation[1:end].sum())


def _faulty(allocation: Array) -> dict[tuple[int, ...], Array]:
    """Return the allocation with each single fault, by the outputs it concerns."""
    count = allocation.shape[1]
    faulty: dict[tuple[int, ...], Array] = {}
    for i, j in combinations(range(count), 2):
        exchanged = allocation.copy()
        exchanged[:, [i, j]] = exchanged[:, [j, i]]
        faulty[i + 1, j + 1] = exchanged
    for i in range(count):
        turned = allocation.copy()
        turned[:, i] *= -1.0
        faulty[(i + 1,)] = turned
    return faulty


def _cost(axes: Sequence[_Axis], allocation: Array) -> float:
    """Return the sum of the logs of the residuals of all axes that thrusters drive."""
    return sum(
        len(axis.needed) * float(np.log(max(axis.left(row), 1e-300)))
        for axis, row in zip(axes, allocation, strict=True)
    )


def _axes(legs: Sequence[ThrusterLeg], allocation: Array, lag_s: float) -> tuple[list[_Axis], Ints]:
    """Return the six axes of all legs, and the block of each sample (n,)."""
    thrust, needed, blocks, start = [], [], [], 0
    nu = np.concatenate([leg.nu for leg in legs])
    for leg in legs:
        step = float(leg.t_s[1] - leg.t_s[0])
        thrust.append(first_order_lag(leg.thrust_N, lag_s=lag_s, step_s=step))
        needed.append(leg.tau_bar + leg.thrust_N @ allocation.T)
        blocks.append(start + ((leg.t_s - leg.t_s[0]) / BLOCK_S).astype(np.int64))
        start = int(blocks[-1][-1]) + 1
    late, force = np.concatenate(thrust), np.concatenate(needed)
    axes = []
    for axis, name in enumerate(AXES):
        speeds = [x for x in VELOCITIES if allows(name, x, (PORT_STARBOARD,))]
        terms = [*speeds, *(f"{x}*|{x}|" for x in speeds)]
        rows = np.vstack([np.ones(len(nu)), basis_rows(nu.T, terms=terms)])
        size = np.linalg.norm(rows, axis=1, keepdims=True)
        own, _ = np.linalg.qr((rows / np.where(size > 0.0, size, 1.0)).T)
        free = late - own @ (own.T @ late)
        axes.append(_Axis.of(force[:, axis] - own @ (own.T @ force[:, axis]), free))
    return axes, np.concatenate(blocks)
