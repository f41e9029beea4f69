"""How a motion answers single thrusters, and whether that changes under way.

By axis, the change of a body velocity over windows is compared with the impulse of each
thruster, both without what drag and a constant explain. Nothing here decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.constants import NORMAL_SPREAD
from auvid.hydro.identification.checks.outputs.joined_outputs import WindowMotion
from auvid.hydro.identification.checks.robust_gains import fitted_gains

LEAST_PART = 0.2
"""Part of the push of the strongest thruster along an axis from which on one acts."""
LEAST_BACKWARD = 0.05
"""Share of an axis that thrusters explain backward, beyond which none is judged by it."""
CUTS, FIRST_CUT = 60, 0.15
"""Places at which a change is tried, and the part of the windows before the first."""
AS_LIKELY = 4.0
"""Log likelihood within which a change may as well come at another time."""
NEARLY_ALL = 1.0 - 1e-9


@dataclass(frozen=True)
class Answered:
    """Motion and impulse of an axis each, without drag, at the lag that fits best.

    changes (k, n), impulse (k, n, m) of each thruster, allocation (k, m).
    """

    changes: Array
    impulse: Array
    allocation: Array

    @property
    def pushed(self) -> Array:
        """Impulse (k, n, m) of each thruster along each axis."""
        return self.impulse * self.allocation[:, None]


def answered(motions: Sequence[WindowMotion], impulse: Array, allocation: Array) -> Answered:
    """Return what is left of motions at several lags, and of the impulse (n, m).

    The one that the thrusters explain best.
    """
    tried = (_without_drag(motion, impulse, allocation) for motion in motions)
    return max(tried, key=lambda each: float(_log_odds(each.pushed.sum(axis=2), each).sum()))


def _without_drag(motion: WindowMotion, impulse: Array, allocation: Array) -> Answered:
    changes, pushes = [], []
    for change, drag in zip(motion.changes.T, motion.drag, strict=True):
        drags = np.column_stack([drag, np.ones(len(drag))])
        basis, _ = np.linalg.qr(drags / np.maximum(np.linalg.norm(drags, axis=0), 1e-12))
        changes.append(change - basis @ (basis.T @ change))
        pushes.append(impulse - basis @ (basis.T @ impulse))
    return Answered(np.array(changes), np.array(pushes), allocation)


def _log_odds(pushed: Array, motion: Answered) -> Array:
    """Return the log likelihood (k,) of pushes (k, n) with a gain each, over none."""
    along = np.maximum(np.einsum("kn,kn->k", pushed, motion.changes), 0.0)
    size = (pushed**2).sum(axis=1) * (motion.changes**2).sum(axis=1)
    share = np.divide(along**2, size, out=np.zeros_like(along), where=size > 0.0)
    odds: Array = -0.5 * pushed.shape[1] * np.log1p(-np.minimum(share, NEARLY_ALL))
    return odds


@dataclass(frozen=True)
class OutputGains:
    """Force of each thruster (m,) in the motion over what the allocation gives it.

    In parts of that of all together; `sd` (m,); `acts` (m,): those that push enough to
    tell. `explained`: share of the axis that they explain best, each with its gain.
    """

    gain: Array
    sd: Array
    acts: Mask
    explained: float


def output_gains(motion: Answered) -> OutputGains | None:
    """Return the gain of each thruster, one for all axes; None where none answers.

    Nor where an axis answers backward: its sign is wrong. Each axis counts in parts of its
    own gain and of what is left of it.
    """
    pushes, changes, shares = [], [], []
    for pushed, change in zip(motion.pushed, motion.changes, strict=True):
        together = pushed.sum(axis=1)
        size = float(together @ together)
        scale = float(together @ change) / size if size > 0.0 else 0.0
        if scale <= 0.0:
            if scale**2 * size > LEAST_BACKWARD * float(change @ change):
                return None
            continue
        rest = change - pushed @ np.linalg.lstsq(pushed, change, rcond=1e-6)[0]
        spread = NORMAL_SPREAD * float(np.median(np.abs(rest - np.median(rest))))
        shares.append(1.0 - float(rest @ rest) / float(change @ change))
        pushes.append(scale * pushed / max(spread, 1e-12))
        changes.append(change / max(spread, 1e-12))
    if not pushes:
        return None
    design = np.concatenate(pushes)
    gains = fitted_gains(np.concatenate(changes), design)
    if gains is None:
        return None
    size = np.std(motion.pushed, axis=1)
    acts = (size > LEAST_PART * np.maximum(size.max(axis=1, keepdims=True), 1e-12)).any(axis=0)
    return OutputGains(gains.gain, gains.sd, acts, max(shares))


@dataclass(frozen=True)
class ChangedOrder:
    """Two thrusters, or twice the same: exchanged, or backward, from some time on.

    `windows`: the first and the last with which that may begin. `better`: log likelihood
    over no change, as the allocation says or otherwise all log long; `rise`: by how much
    more of an axis is explained. `by_part`: log likelihood of the one order over the other
    in the part before and in that after, each with gains of its own; the smaller.
    """

    pair: tuple[int, int]
    windows: tuple[int, int]
    better: float
    rise: float
    by_part: float


def changed_order(motion: Answered, direction: Array) -> ChangedOrder | None:
    """Return the change of outputs under way that explains most."""
    count, number = motion.impulse.shape[1:]
    cuts = np.unique(
        np.linspace(FIRST_CUT * count, (1.0 - FIRST_CUT) * count, CUTS).astype(np.intp)
    )
    as_it_is = motion.pushed.sum(axis=2)
    before, power = _sums(as_it_is, motion.changes)
    energy_sums = np.cumsum(motion.changes**2, axis=1)
    energy = energy_sums[:, -1]
    usual = float(_fit(before[:, -1], power[:, -1], energy, count)[0].sum())
    best: ChangedOrder | None = None
    pairs = [*combinations(range(number), 2), *((place, place) for place in range(number))]
    for first, second in pairs:
        joined = motion.allocation.copy()
        if first == second:
            joined[:, first] *= -1.0
        else:
            turn = direction[first] * direction[second]
            joined[:, [first, second]] = turn * joined[:, [second, first]]
        otherwise = np.einsum("knm,km->kn", motion.impulse, joined)
        after, other_power = _sums(otherwise, motion.changes)
        along = before[:, cuts] + after[:, -1:] - after[:, cuts]
        size = power[:, cuts] + other_power[:, -1:] - other_power[:, cuts]
        odds, share = _fit(along, size, energy[:, None], count)
        all_along, _ = _fit(after[:, -1], other_power[:, -1], energy, count)
        place = int(np.argmax(odds.sum(axis=0)))
        better = float(odds[:, place].sum()) - max(usual, float(all_along.sum()))
        if best is None or better > best.better:
            as_stated = _fit(before[:, -1], power[:, -1], energy, count)[1]
            rise = float((share[:, place] - as_stated).max())
            near = cuts[odds.sum(axis=0) > float(odds[:, place].sum()) - AS_LIKELY]
            own = _of_parts(before, power, energy_sums, int(cuts[place]))
            other = _of_parts(after, other_power, energy_sums, int(cuts[place]))
            by_part = min(own[0] - other[0], other[1] - own[1])
            windows = int(near[0]), int(near[-1])
            best = ChangedOrder((first, second), windows, better, rise, by_part)
    return best


def odds_without(motion: Answered, places: Sequence[int]) -> float:
    """Return the log likelihood of thrusters that give nothing over that of all."""
    rest = np.delete(motion.pushed, places, axis=2).sum(axis=2)
    return float((_log_odds(rest, motion) - _log_odds(motion.pushed.sum(axis=2), motion)).sum())


def _of_parts(along: Array, power: Array, energy: Array, cut: int) -> tuple[float, float]:
    """Return log likelihoods over none before and after a cut, by sums (k, n)."""
    count = along.shape[1]
    before = _fit(along[:, cut], power[:, cut], energy[:, cut], cut)
    rest = [part[:, -1] - part[:, cut] for part in (along, power, energy)]
    after = _fit(rest[0], rest[1], rest[2], count - cut)
    return float(before[0].sum()), float(after[0].sum())


def _sums(pushed: Array, changes: Array) -> tuple[Array, Array]:
    """Return running sums (k, n) of products with the changes, and of squares."""
    return np.cumsum(pushed * changes, axis=1), np.cumsum(pushed**2, axis=1)


def _fit(along: Array, power: Array, energy: Array, count: int) -> tuple[Array, Array]:
    """Return log likelihoods of pushes over none, and the shares that they explain."""
    size = power * energy
    part = np.maximum(along, 0.0) ** 2
    share = np.divide(part, size, out=np.zeros_like(part), where=size > 0.0)
    share = np.minimum(share, NEARLY_ALL)
    return -0.5 * count * np.log1p(-share), share
