"""What share of its force each thruster gives, over that of the others like it.

    F_i = sum_j B_ij g_j f_j

in the fits of axes (`pooled_fit`), with the gains g_j of all thrusters that act on these
axes free under a prior of 1. Drag, inertia and the gains together have one scale that no
motion tells, so only ratios of gains count. Where the motion does not tell thrusters
apart, the prior holds their ratio at 1 and is in its interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array, Ints
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.axes.drive import GAIN_SD, gain_name, prior_of
from auvid.hydro.identification.axes.pooled_fit import Pool, PoolFit, fit_pool
from auvid.hydro.identification.axes.record import ThrusterForces
from auvid.hydro.identification.constrained.statuses import FROM_PRIOR, PRIOR_SHARE
from auvid.hydro.identification.fleet.thruster_strength import (
    MOST_ERROR,
    SURELY_BELOW,
    WEAK_BELOW,
    thrusters_alike,
)
from auvid.hydro.identification.regression.standard_errors import widened_by
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, NOT_EXCITED, WEAK

LEAST_EFFECT = 0.1
"""Of the largest on its axis: a thruster that does less there does not act on it."""
LEAST_PUSH = 0.02
"""Of the largest scatter of a force: a thruster whose force changes less does not work."""


@dataclass(frozen=True)
class ThrusterRatio:
    """Gain of the thruster on an output over the median of the `others` like it.

    `low`, `high`: 95 % interval, that of the prior where the motion does not separate it.
    `departure`: scatter of what it does beside the mean of all of them, over that of the mean.
    """

    output: int
    value: float
    low: float
    high: float
    verdict: str
    others: tuple[int, ...]
    departure: float = float("nan")

    @property
    def is_weak(self) -> bool:
        """Return whether it gives clearly less than two or more others."""
        clear = self.verdict == IDENTIFIED and len(self.others) > 1
        return clear and self.value < WEAK_BELOW and self.high < SURELY_BELOW


def acting_on(thrusters: ThrusterForces, axes: Sequence[str]) -> Ints:
    """Return the thrusters that act on some axes, counted from 0."""
    effect = np.abs(thrusters.effect[[AXES.index(axis) for axis in axes]])
    largest = np.maximum(effect.max(axis=1, keepdims=True), 1e-12)
    return np.flatnonzero((effect > LEAST_EFFECT * largest).any(axis=0)).astype(np.int64)


def thruster_ratios(pool: Pool, fit: PoolFit) -> tuple[ThrusterRatio, ...]:
    """Return how strong thrusters are that act on the axes of a fit, by its windows."""
    thrusters = pool.records[0].thrusters
    if thrusters is None or any(record.thrusters is None for record in pool.records):
        return ()
    axes = [AXES[VELOCITIES.index(velocity)] for velocity in pool.structure.velocities]
    force = np.concatenate(
        [pool.records[w.leg].thrusters.force[w.nodes] for w in pool.windows]  # type: ignore[union-attr]
    )
    push = np.std(np.nan_to_num(force), axis=0)
    acting = acting_on(thrusters, axes)
    idle = push <= LEAST_PUSH * push[acting].max()
    free = [int(i) for i in acting if not idle[i]]
    if len(free) < 2:
        return ()
    names = tuple(gain_name(number) for number in free)
    own = replace(
        pool,
        drive=replace(fit.drive, gains=(1.0,) * len(thrusters.outputs)),
        free=(*pool.free, *names),
    )
    result = fit_pool(own, fit.values[: len(pool.structure.terms)])
    gain, covariance = _gains(own, result, free, len(push))
    width = NORMAL_95 * widened_by(result.windows - 1)
    out = []
    for number in acting.tolist():
        alike = np.intersect1d(thrusters_alike(thrusters.effect, number), acting)
        others = np.array([i for i in alike if not idle[i]], dtype=np.int64)
        if len(others):
            item = _ratio(thrusters, number, others, gain, covariance, width, idle[number])
            out.append(
                replace(
                    item, departure=_departure_from_mean(thrusters, force, number, others, axes)
                )
            )
    return tuple(out)


def _departure_from_mean(
    thrusters: ThrusterForces, force: Array, number: int, others: Ints, axes: Sequence[str]
) -> float:
    """Return how far a thruster acts apart from those like it, over all windows.

    force (n, m): of the windows. By the axis of the fit that it acts on most.
    """
    effect = thrusters.effect[[AXES.index(axis) for axis in axes]]
    row = effect[int(np.argmax(np.abs(effect[:, number]) / np.abs(effect).max(axis=1)))]
    acts = np.nan_to_num(force) * row
    mean = acts[:, [number, *others]].mean(axis=1)
    return float(np.std(acts[:, number] - mean) / max(float(np.std(mean)), 1e-12))


def _gains(pool: Pool, fit: PoolFit, free: Sequence[int], count: int) -> tuple[Array, Array]:
    """Return gains (m,) and their covariance (m, m): by windows, and by the priors.

    Windows left out in turn do not tell what a prior holds: H^-1 P H^-1 is added, H the
    information of data and priors, P that of the priors.
    """
    precision = np.zeros(len(fit.names))
    for i, name in enumerate(fit.names):
        prior = prior_of(name)
        precision[i] = 0.0 if prior is None else prior[1] ** -2
    by_prior = fit.information @ (precision[:, None] * fit.information)
    places = [fit.names.index(gain_name(number)) for number in free]
    gain, covariance = np.ones(count), np.zeros((count, count))
    gain[free] = fit.values[places]
    total = fit.covariance + by_prior
    covariance[np.ix_(free, free)] = total[np.ix_(places, places)]
    return gain, covariance


def _ratio(
    thrusters: ThrusterForces,
    number: int,
    others: Ints,
    gain: Array,
    covariance: Array,
    width: float,
    idle: bool,
) -> ThrusterRatio:
    outputs = tuple(thrusters.outputs[i] for i in others)
    middle = float(np.median(gain[others]))
    if idle or middle <= 0.0:
        nothing = float("nan")
        return ThrusterRatio(
            thrusters.outputs[number], nothing, nothing, nothing, NOT_EXCITED, outputs
        )
    value = float(gain[number]) / middle
    slope = np.zeros(len(gain))
    slope[number], slope[others] = 1.0 / middle, -value / middle / len(others)
    error = float(np.sqrt(slope @ covariance @ slope))
    before = GAIN_SD * float(np.linalg.norm(slope))
    verdict: str = IDENTIFIED if error * width <= MOST_ERROR * NORMAL_95 else WEAK
    if error**2 >= PRIOR_SHARE * before**2:
        verdict = FROM_PRIOR
    return ThrusterRatio(
        thrusters.outputs[number],
        value,
        value - width * error,
        value + width * error,
        verdict,
        outputs,
    )
