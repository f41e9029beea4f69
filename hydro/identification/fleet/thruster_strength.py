"""How strong each thruster of a vehicle is on one dive, against those like it.

With thrusters that give shares g_i of what their pulses say, the force that the motion
needs, tau_bar + B f, is

    tau_bar + B f = Phi theta + sum_i g_i B_i f_i + noise,

Phi the damping and lift of a hull that is alike on port and starboard, with a constant,
f_i the thrust after a common lag, B_i column i of the allocation. Each axis is freed of its
own terms and weighed by the scatter of its residual; g follows from one regression over
six axes. In steady motion drag and thrust are one figure, so the common part of g is
partly taken by the drag: only the ratio to thrusters of the same direction is a result.
Where some of these give clearly less, the ratio is that to the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, VELOCITIES, Array, Ints
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD, allows

LAGS_S = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3)
"""Thrust lags that are tried; the one with the least residuals is taken."""
LIFT = ("u*v", "u*w", "u*q", "u*r")
"""Forces of a hull that moves ahead at an angle, or turns. Left out, they go into the
thrusters fore and aft of it: .89 and 1.10 of six dives of a hovering vehicle whose thrusters
were sound, 1.00 and 1.00 with them.
"""
BLOCK_S = 5.0
"""Pieces of a dive that count as independent for standard errors."""
PASSES = 3
"""Regressions, each weighed by the residuals of the one before."""
WEAK_BELOW, SURELY_BELOW = 0.7, 0.9
"""A thruster is weak below so much of the others, and two standard errors below the
second: on gentle dives of twins healthy ones reach .74, those at half strength .65.
"""
DEAD = 0.2
"""A thruster is dead where two standard errors above its share are below this."""
MOST_ERROR = 0.12
"""Largest standard error at which half the strength is told from all of it: a quarter of
the difference.
"""
LEAST_IN_COMMON = 0.2
"""Of the thrust, what those like a thruster give in the regression: where the drag has taken
more, as on a dive at steady speed, their ratios mean nothing. Dives of sound twins have .5 to
.8, of twins whose level thrusters all are at .6 they have .4, a real dive .03 to .1.
"""
LEAST_PUSH = 0.02
"""Of the largest scatter of a thruster's force: less is a thruster that does not work."""
RIDGE = 1e-9
"""Added to the scaled normal equations, so that inseparable thrusters have huge errors."""

StrengthVerdict = Literal[
    "as the others", "weak", "dead", "reversed", "stronger", "not separable", "not excited"
]
"""`stronger`: those like it are weak, but one alone does not tell that of them."""
UNEVEN: tuple[StrengthVerdict, ...] = ("weak", "dead", "reversed", "stronger")
"""Verdicts on a thruster that does not give what those like it do."""


@dataclass(frozen=True)
class ThrusterLeg:
    """One leg of a dive on a uniform clock.

    t_s (n,); nu (n, 6) [m/s, rad/s]; tau_bar (n, 6) [N, N m] of thrusters at full
    strength; thrust_N (n, m): force of each thruster by its pulses, filtered as nu.
    """

    t_s: Array
    nu: Array
    tau_bar: Array
    thrust_N: Array


@dataclass(frozen=True)
class ThrusterStrength:
    """Strength of one thruster, counted from 1, over that of the others like it.

    `strength` and `standard_error` are nan where the dive does not separate it, or where its
    force does not change; `others` are the thrusters that it is compared with.
    """

    thruster: int
    strength: float
    standard_error: float
    verdict: StrengthVerdict
    others: tuple[int, ...]

    @property
    def is_idle(self) -> bool:
        """Return whether its force does not change, so that nothing tells of it."""
        return self.verdict == "not excited"


def thruster_strengths(
    legs: Sequence[ThrusterLeg], allocation: Array
) -> tuple[ThrusterStrength, ...]:
    """Return the strength of each thruster of `allocation` (6, m) on a dive.

    Thrusters are alike where their forces point along the same body axes. Raises
    `DataError` for no leg or one shorter than four blocks of `BLOCK_S`.
    """
    if not legs:
        raise DataError("no leg to compare thrusters on", value=0, allowed="1 or more")
    length = sum(float(leg.t_s[-1] - leg.t_s[0]) for leg in legs)
    if length < 4.0 * BLOCK_S:
        raise DataError(
            "too short to compare thrusters", value=length, allowed=f"{4.0 * BLOCK_S:g} s or more"
        )
    count = allocation.shape[1]
    thrust = np.concatenate([leg.thrust_N for leg in legs])
    runs = np.flatnonzero(np.any(thrust != 0.0, axis=0))
    push = np.std(thrust, axis=0)
    idle = push <= LEAST_PUSH * push.max()
    gain, covariance = np.full(count, np.nan), np.full((count, count), np.nan)
    fits = [_fit(legs, allocation[:, runs], runs, lag_s) for lag_s in LAGS_S]
    _, gain[runs], covariance[np.ix_(runs, runs)] = min(fits, key=lambda fit: fit[0])
    sure = np.flatnonzero(np.diag(covariance) < MOST_ERROR**2)
    result = []
    for i in range(count):
        alike = thrusters_alike(allocation, i)
        others = np.intersect1d(alike, sure)
        result.append(
            ThrusterStrength(i + 1, np.nan, np.nan, "not excited", tuple((others + 1).tolist()))
            if idle[i]
            else _strength(i, gain, covariance, others, len(alike))
        )
    return tuple(result)


def _fit(
    legs: Sequence[ThrusterLeg], allocation: Array, runs: Ints, lag_s: float
) -> tuple[float, Array, Array]:
    """Return the log of all residuals, gains (m,) and their covariance (m, m)."""
    thrust, force, blocks, start = [], [], [], 0
    nu = np.concatenate([leg.nu for leg in legs])
    for leg in legs:
        step = float(leg.t_s[1] - leg.t_s[0])
        thrust.append(first_order_lag(leg.thrust_N[:, runs], lag_s=lag_s, step_s=step))
        force.append(leg.tau_bar + leg.thrust_N[:, runs] @ allocation.T)
        blocks.append(start + ((leg.t_s - leg.t_s[0]) / BLOCK_S).astype(np.int64))
        start = int(blocks[-1][-1]) + 1
    late, needed, block = np.concatenate(thrust), np.concatenate(force), np.concatenate(blocks)
    # Columns (6, n, m) and targets (6, n), free of each axis's own terms.
    columns, targets = np.empty((6, *late.shape)), np.empty((6, len(late)))
    for axis, name in enumerate(AXES):
        speeds = [x for x in VELOCITIES if allows(name, x, (PORT_STARBOARD,))]
        lift = [term for term in LIFT if allows(name, term, (PORT_STARBOARD,))]
        terms = [*speeds, *(f"{x}*|{x}|" for x in speeds), *lift]
        rows = np.vstack([np.ones(len(nu)), basis_rows(nu.T, terms=terms)])
        own, _ = np.linalg.qr((rows / np.linalg.norm(rows, axis=1, keepdims=True)).T)
        columns[axis] = late * allocation[axis]
        columns[axis] -= own @ (own.T @ columns[axis])
        targets[axis] = needed[:, axis] - own @ (own.T @ needed[:, axis])
    deviation = np.sqrt(np.mean(targets**2, axis=1))
    for _ in range(PASSES):
        weight = deviation**-2
        gram = np.einsum("a,ani,anj->ij", weight, columns, columns, optimize=True)
        gram += RIDGE * np.diag(np.diag(gram))
        inverse = np.linalg.inv(gram)
        gain = inverse @ np.einsum("a,ani,an->i", weight, columns, targets, optimize=True)
        residual = targets - columns @ gain
        deviation = np.sqrt(np.mean(residual**2, axis=1))
    # Sandwich of blocks; white residuals where that is more, as for an unused thruster.
    scores = np.zeros((start, len(gain)))
    np.add.at(scores, block, np.einsum("a,ani,an->ni", weight, columns, residual, optimize=True))
    moved = scores @ inverse  # squared once more, else rounding makes variances negative
    covariance = moved.T @ moved
    least = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(covariance), 1e-300), 1.0))
    return float(np.log(deviation).sum()), gain, covariance * np.outer(least, least)


def thrusters_alike(allocation: Array, thruster: int) -> Ints:
    """Return the other thrusters whose force has the same body components."""
    direction = np.abs(allocation[:3]) > 0.1 * np.linalg.norm(allocation[:3], axis=0)
    same = np.all(direction == direction[:, [thruster]], axis=0)
    same[thruster] = False
    return np.flatnonzero(same).astype(np.int64)


def _in_full(gain: Array, group: Ints) -> Ints:
    """Return the thrusters of a group of like ones that clearly give all their thrust.

    All where they agree; two at least, which agree, and below which the rest is weak; none
    where gains (m,) show no such step.
    """
    order = group[np.argsort(-gain[group])]
    for count in range(len(order), 1, -1):
        upper, lower = gain[order[:count]], gain[order[count:]]
        if upper[-1] > WEAK_BELOW * upper[0] and np.all(lower < WEAK_BELOW * np.median(upper)):
            return np.sort(order[:count])
    return order[:0]


def _strength(
    thruster: int, gain: Array, covariance: Array, others: Ints, alike: int
) -> ThrusterStrength:
    """Return the gain of a thruster over the median of those like it.

    Of `alike` such thrusters the separable `others` have to agree, two of them at least;
    those that clearly give less than two others do not count.
    """
    full = _in_full(gain, np.union1d(others, [thruster]))
    if np.setdiff1d(full, [thruster]).size:
        others = np.setdiff1d(full, [thruster])
        alike = len(others)
    names = tuple(int(i) + 1 for i in others)
    middle = float(np.median(gain[others])) if len(others) else np.nan
    agree = np.sum((gain[others] > WEAK_BELOW * middle) & (gain[others] < middle / WEAK_BELOW))
    if not (np.isfinite(gain[thruster]) and middle > LEAST_IN_COMMON and agree >= min(2, alike)):
        return ThrusterStrength(thruster + 1, np.nan, np.nan, "not separable", names)
    share = float(gain[thruster]) / middle
    slope = np.zeros(len(gain))
    slope[thruster], slope[others] = 1.0 / middle, -share / middle / len(others)
    part = np.flatnonzero(slope)
    variance = slope[part] @ covariance[np.ix_(part, part)] @ slope[part]
    error = float(np.sqrt(variance))
    if error > MOST_ERROR:
        return ThrusterStrength(thruster + 1, np.nan, np.nan, "not separable", names)
    verdict: StrengthVerdict = "as the others"
    if share + 2.0 * error < -DEAD:
        verdict = "reversed"
    elif abs(share) + 2.0 * error < DEAD:
        verdict = "dead"
    elif share < WEAK_BELOW and share + 2.0 * error < SURELY_BELOW:
        verdict = "weak"
    elif share > 1.0 / WEAK_BELOW and share - 2.0 * error > 1.0 / SURELY_BELOW:
        verdict = "stronger"
    return ThrusterStrength(thruster + 1, share, error, verdict, names)
