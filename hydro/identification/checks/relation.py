"""Whether commands have anything to do with a motion: against themselves, shifted.

Commands of another dive, or of a clock that is off by minutes, explain as much of a
motion as they would at any other time. Shifts in time keep how commands and motion
change, and destroy only what relates them, so what the commands explain after shifts of
the same log, and after a reversal, is what they explain by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, Mask, median
from auvid.hydro.identification.checks.response import LONGEST_RESPONSE_S, without_drift
from auvid.hydro.kept_results import kept

RATE_HZ = 10.0
LAGS_S = (-1.5, 2.5)
"""A motion follows its commands by so much, or the commands of a controller the motion."""
FAR_S = 10.0
"""A shift by less may keep a part of the relation."""
SHORTEST_S = 40.0
LONGEST_PAUSE_S, LONGEST_PAUSE_STEPS = 2.0, 4.0
"""Longest pause between samples of a motion that is bridged, also in steps of them."""
LEAST_MOTION = 0.01
"""Standard deviation [m/s, rad/s] of a motion, drift taken off, that can be compared."""
LEAST_SINGULAR = 1e-3
"""Part of the largest singular value; outputs of a mixer depend on each other."""
LARGEST_SHARE = 1.0 - 1e-6
LARGEST_LIKENESS, LEAST_UNLIKE = 0.5, 0.4
"""Share of the commands that a shift of them may explain: periodic ones come back. So
many of the shifts have to be left.
"""


@dataclass(frozen=True)
class Relation:
    """How much of a motion commands explain, as they are stamped and by chance.

    `compared`: places of the motions that move; `share` (k,) of the variance of each.
    `odds`: sum of -ln(1 - share); `chance` and `chance_95`: median and 95th percentile of
    that over shifts; `p`: part of the shifts that reach it. `shift_s` [s]: by how much the
    motion would have to come later for the largest odds, `odds_there`.
    """

    compared: tuple[int, ...]
    share: Array
    odds: float
    chance: float
    chance_95: float
    p: float
    shift_s: float
    odds_there: float

    @property
    def excess(self) -> float:
        """How far the odds lie above those of chance, in parts of its 95 % range."""
        return self.excess_of(self.odds)

    def excess_of(self, odds: float) -> float:
        """Return how far odds lie above those of chance, in parts of its 95 % range."""
        return (odds - self.chance) / max(self.chance_95 - self.chance, 1e-12)


@kept
def relation(
    t_command: ArrayLike, command: ArrayLike, motions: Sequence[tuple[Array, Array]]
) -> Relation | None:
    """Return how commands (n, k) at t (n,) [s] relate to motions, pairs (t, values).

    All shifts come from one cross-correlation: the Gram matrix of commands does not
    change as they go round. At most ten minutes in the middle are used. None for less
    than 40 s without a pause, without a motion, or for commands that stand still or repeat
    themselves.
    """
    t, inputs = np.asarray(t_command, dtype=np.float64), np.asarray(command, dtype=np.float64)
    moves = np.ptp(inputs, axis=0) > 0.0 if len(inputs) else np.ones(1, np.bool_)
    inputs = inputs if moves.all() else inputs[:, moves]
    if not inputs.size or not motions:
        return None
    start = max(t[0], *(at[0] for at, _ in motions))
    end = min(t[-1], *(at[-1] for at, _ in motions))
    if end - start < SHORTEST_S:
        return None
    half = min(0.5 * (end - start), 0.5 * LONGEST_RESPONSE_S)
    clock = np.arange(0.5 * (start + end) - half, 0.5 * (start + end) + half, 1.0 / RATE_HZ)
    commands = without_drift(
        np.column_stack([np.interp(clock, t, column) for column in inputs.T]), clock
    )
    basis, size, _ = np.linalg.svd(commands, full_matrices=False)
    basis = basis[:, size > LEAST_SINGULAR * size[0]]
    sampled = np.all([_between_samples(clock, at) for at, _ in motions], axis=0)
    if np.count_nonzero(sampled) < SHORTEST_S * RATE_HZ:
        return None
    moved = [sampled * without_drift(np.interp(clock, at, values), clock) for at, values in motions]
    compared = tuple(place for place, values in enumerate(moved) if values.std() > LEAST_MOTION)
    if not compared or not size[0]:
        return None
    motion = np.column_stack([moved[place] for place in compared])
    by_shift = _shares(basis, motion)
    shares = _about(by_shift)
    odds, reversed_odds = _odds(shares), _odds(_about(_shares(basis[::-1], motion)))
    far = round(FAR_S * RATE_HZ)
    unlike = _about(_likeness(basis, basis))[:, 0] < LARGEST_LIKENESS
    unlike[:far] = unlike[-far:] = False
    by_chance = np.concatenate(
        [
            odds[unlike],
            reversed_odds[_about(_likeness(basis[::-1], basis))[:, 0] < LARGEST_LIKENESS],
        ]
    )
    if len(by_chance) < LEAST_UNLIKE * 2 * len(odds):
        return None
    best = int(np.argmax(_odds(by_shift)))
    return Relation(
        compared=compared,
        share=shares[0],
        odds=float(odds[0]),
        chance=float(np.median(by_chance)),
        chance_95=float(np.quantile(by_chance, 0.95)),
        p=float(np.mean(by_chance >= odds[0])),
        shift_s=(best if best < len(odds) / 2 else best - len(odds)) / RATE_HZ,
        odds_there=float(odds[best]),
    )


def _between_samples(clock: Array, at: Array) -> Mask:
    """Return which times (n,) lie in no pause of samples `at` (m,)."""
    steps = np.diff(at)
    place = np.clip(np.searchsorted(at, clock) - 1, 0, len(steps) - 1)
    longest = max(LONGEST_PAUSE_S, LONGEST_PAUSE_STEPS * float(median(steps)))
    return np.asarray(steps[place] <= longest)


def _shares(basis: Array, motion: Array) -> Array:
    """Return the share (n, k) of each motion (n, k) explained at each circular shift.

    basis (n, m) is orthonormal; the motion comes later by the shift.
    """
    turned, count = np.conj(np.fft.rfft(basis.T)), len(basis)
    shares = [
        np.sum(np.fft.irfft(turned * np.fft.rfft(values), count) ** 2, axis=0)
        / float(values @ values)
        for values in motion.T
    ]
    return np.asarray(np.minimum(np.column_stack(shares), LARGEST_SHARE))


def _likeness(basis: Array, other: Array) -> Array:
    """Return the mean share (n, 1) of commands (n, m) that others explain, by shift."""
    return np.asarray(_shares(basis, other).mean(axis=1, keepdims=True))


def _about(shares: Array) -> Array:
    """Return the largest of shares (n, k) over the lags about each shift, by motion."""
    first, last = (round(lag * RATE_HZ) for lag in LAGS_S)
    count, taken = last - first + 1, 1
    largest = np.roll(shares, -first, axis=0)
    while taken < count:  # of twice as many lags each time
        more = min(taken, count - taken)
        largest = np.maximum(largest, np.roll(largest, -more, axis=0))
        taken += more
    return largest


def _odds(shares: Array) -> Array:
    return np.asarray(-np.log1p(-shares).sum(axis=1))
