"""How well a fit moves where it was not fitted: windows in turn, legs left out.

    fit = 1 - |y - y_hat| / |y - mean(y)|   (in %)

of each velocity; of heave that depth measures, the depth rate low-passed at 1 Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.axes.pooled_fit import (
    Pool,
    PoolFit,
    fit_pool,
    loop_rows,
    motion,
)
from auvid.hydro.identification.axes.windows import (
    MotionWindow,
    depth_measures,
    depth_rate,
    low_passed,
)


@dataclass(frozen=True)
class HeldOut:
    """Fit [%] by velocity on windows or a leg (`what`) that the fit did not use."""

    what: str
    percent: dict[str, float]
    windows: int


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
    """Return the fit [%] on windows by velocity, each from its measured start.

    The constant of a window is 0, its expected value.
    """
    flown = replace(
        pool,
        windows=tuple(windows),
        constant_sd=np.zeros_like(pool.constant_sd),
        drive=fit.drive,
        free=(),
    )
    theta = fit.values[: len(pool.structure.terms)]
    k, rows = len(pool.structure.velocities), loop_rows(flown, fit.drive)
    measured: list[list[Array]] = [[] for _ in range(k)]
    simulated: list[list[Array]] = [[] for _ in range(k)]
    for window in windows:
        start = np.append(pool.prepared[window.leg].start[window.first], np.zeros(k))
        states = motion(flown, rows[window.leg], theta, window, start)[:, :, 0]
        for i, pair in enumerate(signals(flown, window, states)):
            measured[i].append(pair[0])
            simulated[i].append(pair[1])
    return {
        velocity: percent_of(np.concatenate(measured[i]), np.concatenate(simulated[i]))
        for i, velocity in enumerate(pool.structure.velocities)
    }


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
    """Return the fit on every other window by the rest, both ways."""
    out = []
    halves = (pool.windows[0::2], pool.windows[1::2])
    for train, test, what in ((*halves, "even windows"), (*halves[::-1], "odd windows")):
        if train and test:
            fit = fit_pool(replace(pool, windows=train), first)
            out.append(HeldOut(what, score(pool, fit, test), len(test)))
    return tuple(out)


def free_run(pool: Pool, fit: PoolFit, window: MotionWindow) -> Array:
    """Return states (n, 2k) over a window or a leg, from its measured start."""
    flown = replace(pool, drive=fit.drive, free=())
    rows = loop_rows(flown, fit.drive)[window.leg]
    k = len(pool.structure.velocities)
    start = np.append(pool.prepared[window.leg].start[window.first], np.zeros(k))
    theta = fit.values[: len(pool.structure.terms)]
    return motion(flown, rows, theta, window, start)[:, :, 0]
