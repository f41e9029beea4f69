"""A sign that changes in the course of a log, as after a driver has started again.

Each target is explained by parts with gains of one; some parts have the other sign before,
or after, some time. Nothing here decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import Array

Choices = Sequence[Sequence[Array]]
STEP_S = 1.0
LARGEST_SQUARE = 16.0
"""Most that one window says against a sign, in variances: of outliers, no more."""
NORMAL_SPREAD = 1.4826


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
    best: SignChange | None = None
    for number, choice in enumerate(choices):
        gained = np.zeros(clock.size)
        for target, signs in zip(targets, choice, strict=True):
            place = np.searchsorted(clock, target.at, side="right") - 1
            np.add.at(gained, place, _gained(target, signs))
        before = np.concatenate([[0.0], np.cumsum(gained)])
        after = before[-1] - before
        for later, own, other in ((False, before, after), (True, after, before)):
            odds = np.minimum(own, -other)
            row = int(np.argmax(odds))
            if best is None or odds[row] > best.odds:
                at_s = start + row * STEP_S
                shorter = min(at_s - start, end - at_s)
                best = SignChange(number, at_s, later, float(odds[row]), shorter, [])
    return None if best is None else replace(best, explained=_explained(best, targets, choices))


def _explained(change: SignChange, targets: Sequence[SignTarget], choices: Choices) -> list[float]:
    """Return the share of the changes of each target that mended signs explain."""
    shares = []
    for target, signs in zip(targets, choices[change.choice], strict=True):
        wrong = (target.at >= change.at_s) == change.after
        mended = np.where(wrong[:, None], target.parts * signs, target.parts).sum(axis=1)
        left, size = (
            float(np.median(np.abs(np.diff(part))))
            for part in (target.values - mended, target.values)
        )
        shares.append(1.0 - (left / max(size, 1e-12)) ** 2)
    return shares


def _gained(target: SignTarget, signs: Array) -> Array:
    """Return the logarithm of the likelihood (m,) of signs over none, by windows.

    By what changes from window to window: a constant of either part is no sign.
    """
    left = [target.values - target.parts.sum(axis=1), target.values - target.parts @ signs]
    left = [np.diff(rest, prepend=rest[0]) for rest in left]
    spread = NORMAL_SPREAD * float(np.median(np.minimum(*np.abs(left))))
    own, other = (np.minimum((rest / max(spread, 1e-12)) ** 2, LARGEST_SQUARE) for rest in left)
    return np.asarray(0.5 * (own - other))
