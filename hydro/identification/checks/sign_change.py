"""A sign that changes in the course of a log, as after a driver has started again.

Each target is explained by parts with gains of one; some parts have the other sign before,
or after, some time. Nothing here decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import Array, median
from auvid.hydro.constants import NORMAL_SPREAD
from auvid.hydro.kept_results import kept

Choices = Sequence[Sequence[Array]]
STEP_S = 1.0
LARGEST_SQUARE = 16.0
"""Most that one window says against a sign, in variances: of outliers, no more."""


@dataclass(frozen=True)
class SignTarget:
    """Values (m,) over windows from `at` (m,) [s], and their parts (m, k)."""

    at: Array
    values: Array
    parts: Array


@dataclass(frozen=True)
class SignChange:
    """Where parts of targets change their sign.

    `choice`: place of the signs among those tried; they hold after `at_s`, or before it.
    `odds`: logarithm of the likelihood of either part of the log by itself, the smaller;
    `shorter_s`: length of the shorter one; `explained`: share of the changes of each
    target, with signs mended.
    """

    choice: int
    at_s: float
    after: bool
    odds: float
    shorter_s: float
    explained: list[float]


@kept
def sign_change(
    targets: Sequence[SignTarget], choices: Sequence[Sequence[Array]]
) -> SignChange | None:
    """Return where a choice of signs explains most in one part of the log only.

    `choices`: for each the signs (k,) of the parts of each target. The part that has them
    must be likelier with them, and the other one without.
    """
    if not targets or not choices:
        return None
    start = min(float(target.at[0]) for target in targets)
    end = max(float(target.at[-1]) for target in targets) + STEP_S
    clock = np.arange(start, end + STEP_S, STEP_S)
    gained = np.zeros((len(choices), clock.size))
    first = clock.size * np.arange(len(choices))
    for number, target in enumerate(targets):
        place = np.searchsorted(clock, target.at, side="right") - 1
        own = _gained(target, np.array([choice[number] for choice in choices]))
        sums = np.bincount((first[:, None] + place).ravel(), own.ravel(), gained.size)
        gained += sums.reshape(gained.shape)
    before = np.hstack([np.zeros((len(choices), 1)), np.cumsum(gained, axis=1)])
    after = before[:, -1:] - before
    odds = np.minimum(np.stack([before, after], 1), -np.stack([after, before], 1))
    number, later, row = (int(i) for i in np.unravel_index(np.argmax(odds), odds.shape))
    at_s = start + row * STEP_S
    best = SignChange(
        number, at_s, later == 1, float(odds[number, later, row]), min(at_s - start, end - at_s), []
    )
    return replace(best, explained=_explained(best, targets, choices))


def _explained(change: SignChange, targets: Sequence[SignTarget], choices: Choices) -> list[float]:
    """Return the share of the changes of each target that mended signs explain."""
    shares = []
    for target, signs in zip(targets, choices[change.choice], strict=True):
        wrong = (target.at >= change.at_s) == change.after
        mended = np.where(wrong[:, None], target.parts * signs, target.parts).sum(axis=1)
        left, size = (
            float(median(np.abs(np.diff(part)))) for part in (target.values - mended, target.values)
        )
        shares.append(1.0 - (left / max(size, 1e-12)) ** 2)
    return shares


def _gained(target: SignTarget, signs: Array) -> Array:
    """Return the logarithm of the likelihood (c, m) of signs (c, k) over none.

    By what changes from window (m) to window: a constant of either part is no sign.
    """
    own = _steps(target.values - target.parts.sum(axis=1))
    others = _steps(target.values - signs @ target.parts.T)
    nearer = np.minimum(np.abs(own), np.abs(others))
    spread = np.maximum(NORMAL_SPREAD * median(nearer.T), 1e-12)[:, None]
    own, others = (np.minimum((rest / spread) ** 2, LARGEST_SQUARE) for rest in (own, others))
    return np.asarray(0.5 * (own - others))


def _steps(rest: Array) -> Array:
    """Return the changes of rests (..., m) from window to window; 0 at the first."""
    steps = np.zeros(rest.shape)
    np.subtract(rest[..., 1:], rest[..., :-1], out=steps[..., 1:])
    return steps
