"""How well a fit moves where it was not fitted: windows in turn, legs left out.

    fit = 1 - |y - y_hat| / |y - mean(y)|   (in %)

of each velocity; of heave that depth measures, the depth rate low-passed at 1 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.axes.drive import CURVE, DEAD_BAND
from auvid.hydro.identification.axes.pooled_fit import (
    Pool,
    PoolFit,
    PoolWork,
    fit_pool,
    loop_rows,
    motion,
)
from auvid.hydro.identification.axes.structure import ASIDE, HULL
from auvid.hydro.identification.axes.windows import (
    MotionWindow,
    depth_measures,
    depth_rate,
    drives,
    low_passed,
)

BENT_WORTH = 0.9
"""A dead band and a curve are two numbers more, and drag may be taken for one."""
LEAST_ERROR = 1.0
"""Errors below that [%] count as that: both fits are as good as the measurement."""
FEWEST_WINDOWS = 4
"""Windows from which on one half of them may judge the other."""
LASTING_S = 0.5
"""Noise of smoothed poses is over by then; speeds of small vehicles go on for longer."""
FIRST_DEAD_BAND, FIRST_CURVE = 0.03, 1.3
"""Where the search for a dead band [full commands] and a curve begins."""


@dataclass(frozen=True)
class HeldOut:
    """Fit [%] by velocity on windows or a leg (`what`) that the fit did not use.

    `one_run`: of a leg, the same of one free run from its first window to its last.
    `with_moment`: of yaw that the fit gives the moment of a hull by the speeds of its forces,
    the same flown with that moment; no model without both speeds has it.
    """

    what: str
    percent: dict[str, float]
    windows: int
    one_run: dict[str, float] = field(default_factory=dict)
    with_moment: dict[str, float] = field(default_factory=dict)


def percent_of(measured: Array, simulated: Array) -> float:
    """Return 100 (1 - |y - y_hat| / |y - mean(y)|), nan without motion.

    >>> percent_of(np.array([0.0, 2.0]), np.array([0.0, 1.0])).__round__(1)
    29.3
    """
    finite = np.isfinite(measured) & np.isfinite(simulated)
    y, model = measured[finite], simulated[finite]
    spread = float(np.linalg.norm(y - y.mean())) if y.size else 0.0
    return 100.0 * (1.0 - float(np.linalg.norm(y - model)) / spread) if spread > 0 else np.nan


def score(pool: Pool, fit: PoolFit, windows: Sequence[MotionWindow]) -> dict[str, float]:
    """Return the fit [%] on windows by velocity, each from its measured start."""
    return _percents(pool, [_flown(pool, fit, windows)])


def _percents(pool: Pool, parts: Sequence[Sequence[tuple[Array, Array]]]) -> dict[str, float]:
    """Return the fit [%] by velocity on all parts together, each of `_flown`."""
    return {
        velocity: percent_of(*(np.concatenate(side) for side in zip(*pairs, strict=True)))
        for velocity, pairs in zip(pool.structure.velocities, zip(*parts, strict=True), strict=True)
    }


def _flown(
    pool: Pool, fit: PoolFit, windows: Sequence[MotionWindow], *, moment: bool = False
) -> list[tuple[Array, Array]]:
    """Return measured and simulated signal (n,) of each velocity over windows.

    The constant of a window is 0, its expected value, and no moment of the hull acts unless
    `moment`: the model has none without speeds.
    """
    flown = replace(
        pool if moment else pool.without(HULL, ASIDE),
        windows=tuple(windows),
        constant_sd=np.zeros_like(pool.constant_sd),
        drive=fit.drive,
        free=(),
    )
    theta = fit.values[: len(pool.structure.terms)]
    k, rows = len(pool.structure.velocities), loop_rows(flown, fit.drive)
    pairs: list[list[tuple[Array, Array]]] = [[] for _ in range(k)]
    for window in windows:
        start = np.append(pool.prepared[window.leg].start[window.first], np.zeros(k))
        states = motion(flown, rows[window.leg], theta, window, start)[:, :, 0]
        for i, pair in enumerate(signals(flown, window, states)):
            pairs[i].append(pair)
    return [
        (np.concatenate([pair[0] for pair in own]), np.concatenate([pair[1] for pair in own]))
        for own in pairs
    ]


def signals(pool: Pool, window: MotionWindow, states: Array) -> list[tuple[Array, Array]]:
    """Return measured and simulated signal (n,) of each velocity, as scored."""
    record, data, out = pool.records[window.leg], pool.prepared[window.leg], []
    for i, velocity in enumerate(pool.structure.velocities):
        if depth_measures(record, velocity):
            rate = low_passed(states[:, i] * data.turn[window.nodes, i], data.step_s)
            out.append((depth_rate(record)[window.nodes], rate))
        else:
            out.append((data.channels[window.nodes, i], states[:, i]))
    return out


def held_out_blocks(pool: Pool, first: Array) -> tuple[HeldOut, ...]:
    """Return the fit on every other window by the rest, both ways.

    Of fewer than `FEWEST_WINDOWS` each is flown by the others, and all count together: one
    window by itself fits too little, and one that hardly moves judges too little.
    """
    if 1 < len(pool.windows) < FEWEST_WINDOWS:
        parts = []
        for number, window in enumerate(pool.windows):
            rest = (*pool.windows[:number], *pool.windows[number + 1 :])
            fit = fit_pool(replace(pool, windows=rest), first)
            parts.append(_flown(pool, fit, [window]))
        return (HeldOut("windows in turn", _percents(pool, parts), len(pool.windows)),)
    out, turns = [], ASIDE in pool.structure.inputs
    halves = (pool.windows[0::2], pool.windows[1::2])
    for train, test, what in ((*halves, "even windows"), (*halves[::-1], "odd windows")):
        if train and test:
            fit = fit_pool(replace(pool, windows=train), first)
            by_moment = _percents(pool, [_flown(pool, fit, test, moment=True)]) if turns else {}
            out.append(HeldOut(what, score(pool, fit, test), len(test), with_moment=by_moment))
    return tuple(out)


def bent_commands(pool: Pool, fit: PoolFit) -> tuple[Pool, PoolFit, tuple[HeldOut, ...]]:
    """Return a fit with dead band and curve free, and how it flies held out."""
    bent = replace(
        pool,
        free=(*pool.free, DEAD_BAND, CURVE),
        drive=replace(fit.drive, dead_band=FIRST_DEAD_BAND, curve=FIRST_CURVE),
    )
    terms = len(pool.structure.terms)
    other = fit_pool(bent, fit.values[:terms])
    return bent, other, held_out_blocks(bent, other.values[:terms])


def errs_less(tried: Sequence[HeldOut], blocks: Sequence[HeldOut]) -> bool:
    """Return whether a fit errs by `BENT_WORTH` of another at most, in all it flies."""
    return len(tried) > 0 and all(
        100.0 - new.percent[velocity] < BENT_WORTH * (100.0 - old.percent[velocity])
        for new, old in zip(tried, blocks, strict=True)
        for velocity in new.percent
    )


def doubting_curves(pool: Pool, fit: PoolFit, others: Sequence[PoolFit]) -> PoolFit:
    """Return a fit with the errors of its curve of commands, by other curves.

    Each of these is half of an interval: how far it moves the terms of an axis, for so much of
    the error as lasts. An error s of the fit that lasts for a share p (`lasting_shares`) is of
    forces that it lacks; another curve, of error t, moves it for t^2 - s^2 of that kind:

        share of the move = sqrt(p s^2 / (t^2 - s^2)), 1 at most, and where t is no larger.
    """
    covariance, lasting = fit.covariance, lasting_shares(pool, fit)
    for other in others:
        change = np.zeros(len(fit.names))
        values = dict(zip(other.names, other.values.tolist(), strict=True))
        for place, velocity in enumerate(pool.structure.velocities):
            own = float(fit.sigma[place] ** 2)
            more, left = float(other.sigma[place] ** 2) - own, own * lasting[place]
            share = 1.0 if more <= left else float(np.sqrt(left / more))
            start = f"{AXES[VELOCITIES.index(velocity)]} "
            for i, name in enumerate(fit.names):
                if name.startswith(start) and name in values:
                    change[i] = share * (values[name] - fit.values[i]) / NORMAL_95
        covariance = covariance + np.outer(change, change)
    return replace(fit, covariance=covariance)


def lasting_shares(pool: Pool, fit: PoolFit) -> Array:
    """Return what share of the power of errors (k,) lasts for `LASTING_S`.

    Noise, and poses that were smoothed, do not; a force that the form lacks does.
    """
    work = PoolWork(pool, len(pool.structure.terms))
    k = len(pool.structure.velocities)
    power, product, counts = np.zeros(k), np.zeros(k), np.zeros((2, k))
    for number, window in enumerate(pool.windows):
        data = pool.prepared[window.leg]
        later = max(1, round(LASTING_S / data.step_s))
        states = work.run(fit.values, fit.local, number)[:, :k, 0]
        error = states - data.channels[window.nodes, :k]
        both = error[later:] * error[:-later]
        power += np.nansum(error**2, axis=0)
        product += np.nansum(both, axis=0)
        counts += [np.isfinite(error).sum(axis=0), np.isfinite(both).sum(axis=0)]
    ratio = (product / np.maximum(counts[1], 1)) / np.maximum(
        power / np.maximum(counts[0], 1), 1e-30
    )
    return np.asarray(np.clip(ratio, 0.0, 1.0))


def legs_left_out(pool: Pool, first: Array) -> tuple[HeldOut, ...]:
    """Return the fit on each leg by the others, over windows and in one free run.

    Velocities that a leg does not drive are left out, and legs that drive one which the
    others do not. Without a second leg: nothing.
    """
    legs = sorted({window.leg for window in pool.windows})
    out = []
    driven = {
        leg: {v for v in pool.structure.velocities if drives(pool.records, leg, v)} for leg in legs
    }
    for leg in legs if len(legs) > 1 else []:
        own = driven[leg]
        if not own <= set().union(*(driven[i] for i in legs if i != leg)):
            continue
        rest = tuple(w for w in pool.windows if w.leg != leg)
        test = tuple(w for w in pool.windows if w.leg == leg)
        fit = fit_pool(replace(pool, windows=rest), first)
        by_window, one_run = score(pool, fit, test), whole_leg(pool, fit, leg)
        out.append(
            HeldOut(
                f"leg {leg}",
                {v: by_window[v] for v in by_window if v in own},
                len(test),
                {v: one_run[v] for v in one_run if v in own},
            )
        )
    return tuple(out)


def legs_flown_better(before: Sequence[HeldOut], after: Sequence[HeldOut]) -> bool:
    """Return whether another fit errs less, by `BENT_WORTH`, on legs left out.

    A dead band and a curve of one leg's commands may fly its windows, and no other leg: no
    leg may err more by that worth than before. By the geometric mean over legs, since of
    many one always is a hair worse. Where nothing moves (nan) nothing is judged.

    >>> straight, bent = HeldOut("leg 1", {"w": 63.0}, 9), HeldOut("leg 1", {"w": -21.0}, 9)
    >>> legs_flown_better([straight], [bent]), legs_flown_better([], [])
    (False, True)
    """
    pairs = np.array(
        [
            (old.percent[velocity], new.percent[velocity])
            for old, new in zip(before, after, strict=True)
            for velocity in old.percent
        ]
    ).reshape(-1, 2)
    old, new = 100.0 - pairs[np.isfinite(pairs[:, 0])].T
    if not np.isfinite(new).all():
        return False
    ratio = np.log(np.maximum(new, LEAST_ERROR) / np.maximum(old, LEAST_ERROR))
    worth = float(np.log(BENT_WORTH))
    return ratio.size == 0 or bool(ratio.mean() <= worth and ratio.max() <= -worth)


def whole_leg(pool: Pool, fit: PoolFit, leg: int) -> dict[str, float]:
    """Return the fit [%] of one free run over a leg, by velocity; nan if it is lost."""
    span = span_of(pool, leg)
    states = free_run(pool, fit, span)
    if not np.isfinite(states).all():
        return dict.fromkeys(pool.structure.velocities, float("nan"))
    pairs = signals(pool, span, states)
    return {
        velocity: percent_of(*pair)
        for velocity, pair in zip(pool.structure.velocities, pairs, strict=True)
    }


def span_of(pool: Pool, leg: int) -> MotionWindow:
    """Return the leg from the start of its first window to the end of its last."""
    own = [window for window in pool.windows if window.leg == leg]
    return MotionWindow(leg, min(w.first for w in own), max(w.end for w in own))


def free_run(pool: Pool, fit: PoolFit, window: MotionWindow) -> Array:
    """Return states (n, 2k) over a window or a leg, from its measured start."""
    flown = replace(pool.without(HULL, ASIDE), drive=fit.drive, free=())
    rows = loop_rows(flown, fit.drive)[window.leg]
    k = len(pool.structure.velocities)
    start = np.append(pool.prepared[window.leg].start[window.first], np.zeros(k))
    theta = fit.values[: len(pool.structure.terms)]
    return motion(flown, rows, theta, window, start)[:, :, 0]
