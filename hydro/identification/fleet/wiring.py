"""Whether outputs are exchanged, and which thruster acts backward, or not at all.

The force that the motion needs, F = tau_bar + B f, is compared with B' f for the
allocation B as it stands and for each that an exchange of two of its columns, or one
column of the other sign, makes. On each axis

    F = Phi theta + g (B' f) + noise,   g >= 0,

Phi the damping terms of a hull that is alike on port and starboard, with a constant, and
f the thrust after a common lag. With S the covariance over the axes of what an allocation
leaves, the fault of least ln det S is named if

    n / (2 tau) (ln det S' - ln det S) - ln(faults tried)

exceeds `CERTAIN`, also without the block of the dive that speaks most for it. S' is the
least of the wiring as it stands and of the same with any one thruster of another strength,
none included: a dead thruster is no reversed one. The determinant counts a force that acts
on several axes at once, as a tether does, once. tau counts the samples that belong
together, by the autocorrelation of what is left: the largest of all axes, of both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
CERTAIN = float(np.log(10.0))
"""Least logarithm of the ratio of likelihoods, less that of the faults tried. Measured, not
derived, on synthetic dives of 60 to 300 s of a Heavy frame, 60 of each kind, wiring right:
none is named with a thruster dead or at .3, with uneven thrusters, or with a tether force
off the origin, which position feedback answers, of 5 N / 2 s to 20 N / 10 s; 1 of 60 is at
10 N / 0.5 s and at 40 N / 4 s. Of 36 single faults of the bundled dive 16 are named.
"""
STRENGTHS = (0.0, 0.25, 0.5, 0.75, 1.5)
"""Strengths of one thruster that compete with a fault of the wiring."""
MISSING_GAIN = 0.4
"""As `LEAST_GAIN`, for a thruster without which the motion is explained: uneven and weak
ones explain less.
"""
LEAST_GAIN = 0.05
"""Least part of what is left as it stands that a fault must explain, mean of the axes."""
LEAST_CORRELATION = 0.05
"""Samples whose residuals correlate by less count as independent."""
LEAST_OF_AXIS = 1e-3
"""Part of the square of an axis that no other axis can explain, by its noise."""


@dataclass(frozen=True)
class WiringFault:
    """Outputs, counted from 1: two exchanged, or one that acts backward or not at all.

    `gain`: part of the squared residual that goes with the fault, mean of the axes it
    concerns; `log_ratio`: logarithm of its likelihood over that of the best explanation
    without a fault, less that of the number of faults tried; the smaller of that on all of
    the dive and that without the block that speaks most for it.
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
    sound = [allocation, *_uneven(allocation)]
    fault = _likeliest(legs, allocation, _faulty(allocation), sound)
    return fault if fault is not None and fault.gain > LEAST_GAIN else None


def missing_thruster(legs: Sequence[ThrusterLeg], allocation: Array) -> WiringFault | None:
    """Return the one thruster without which the motion is explained, or None.

    Where it always pushes as another does, a dead and a reversed one are the same: the
    other seems twice as strong.
    """
    without: dict[tuple[int, ...], Array] = {
        (i + 1,): allocation * (np.arange(allocation.shape[1]) != i)
        for i in range(allocation.shape[1])
    }
    fault = _likeliest(legs, allocation, without, [allocation])
    return fault if fault is not None and fault.gain > MISSING_GAIN else None


def _likeliest(
    legs: Sequence[ThrusterLeg],
    allocation: Array,
    faulty: Mapping[tuple[int, ...], Array],
    sound: Sequence[Array],
) -> WiringFault | None:
    """Return the likeliest fault where it is certain beside the best of the sound."""

    def least(lagged: tuple[list[_Axis], Ints]) -> float:
        return min(_cost(lagged[0], each) for each in (*sound, *faulty.values()))

    axes, block = min((_axes(legs, allocation, lag_s) for lag_s in LAGS_S), key=least)
    if int(block[-1]) + 1 < FEWEST_BLOCKS:
        return None
    left = {outputs: _residuals(axes, each) for outputs, each in faulty.items()}
    outputs = min(left, key=lambda key: _log_det(left[key]))
    as_is, changed = _residuals(axes, allocation), left[outputs]
    best = min((_residuals(axes, each) for each in sound), key=_log_det)
    better = np.bincount(block, _log_density(changed) - _log_density(best))
    rest = block != np.argmax(better)
    ratio = min(_log_ratio(best, changed, kept) for kept in (np.ones_like(rest), rest))
    concerned = np.any(allocation != faulty[outputs], axis=1)
    squares, others = (np.sum(each[concerned] ** 2, axis=1) for each in (as_is, changed))
    gain = float(np.mean(1.0 - others / np.maximum(squares, 1e-300)))
    fault = WiringFault(outputs, gain, ratio - float(np.log(len(faulty))))
    return fault if fault.log_ratio > CERTAIN else None


def _residuals(axes: Sequence[_Axis], allocation: Array) -> Array:
    """Return what an allocation leaves on the six axes (6, n)."""
    return np.stack([axis.residual(row) for axis, row in zip(axes, allocation, strict=True)])


def _covariance(residuals: Array) -> Array:
    """Return the covariance (6, 6) of residuals, each axis with noise of its own."""
    covariance = residuals @ residuals.T / residuals.shape[1]
    own = np.maximum(np.diag(covariance), 1e-300)
    return np.asarray((1.0 - LEAST_OF_AXIS) * covariance + LEAST_OF_AXIS * np.diag(own))


def _log_det(residuals: Array) -> float:
    """Return the logarithm of the determinant of the covariance of residuals (6, n)."""
    return float(np.linalg.slogdet(_covariance(residuals))[1])


def _log_density(residuals: Array) -> Array:
    """Return minus half the whitened square (n,) of residuals (6, n)."""
    whitened = np.linalg.solve(_covariance(residuals), residuals)
    return np.asarray(-0.5 * np.sum(residuals * whitened, axis=0))


def _log_ratio(best: Array, changed: Array, kept: Mask) -> float:
    """Return n / (2 tau) (ln det S' - ln det S) without and with the fault."""
    together = max(_samples_together(row) for row in (*best, *changed))
    less = _log_det(best[:, kept]) - _log_det(changed[:, kept])
    return 0.5 * float(kept.sum()) / together * less


def _samples_together(residual: Array) -> float:
    """Return tau = 1 + 2 sum of the autocorrelation until it is below its least."""
    x = residual - residual.mean()
    power = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
    correlation = np.fft.irfft(power)[: len(x)] / max(float(x @ x), 1e-300)
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


def _uneven(allocation: Array) -> list[Array]:
    """Return the allocation with each of its thrusters at each of `STRENGTHS`."""
    count = allocation.shape[1]
    return [
        allocation * np.where(np.arange(count) == i, strength, 1.0)
        for i in range(count)
        for strength in STRENGTHS
    ]


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
