"""Checks of single samples of the velocity against those before and after them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from auvid.hydro.arrays import Array, Mask, runs_of
from auvid.hydro.identification.checks.signal_checks import jumps, slow_speed
from auvid.stages.columns import LINEAR_VELOCITY, OF_FIXES, OF_POSES, SPEEDS
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    counted,
    finding,
    how_often,
    limit,
    listed,
)
from auvid.stages.number_format import significant

LEAP_M_S, LEAP_SPREADS = 1.0, 10.0
"""An outlier is so far from the median of five samples, and so many times what most are."""
FASTEST_M_S2 = 1.5
"""A step of the velocity that is slower may be an acceleration."""
STOPPED = 0.25
"""Speed behind a step, as a part of it, up to which a hull has been stopped."""
UNDER_WAY_M_S = 0.05
LONGEST_ZERO_S = 2.0
"""Zeros that last longer are a rest, or a sensor that is stuck, which has its own check."""
FEWEST_SAMPLES, FEWEST_RUNS, FEWEST_LOST = 50, 3, 2


def outlier_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield samples that leap and come back, and those that are zero in between."""
    if not log.has("velocity") or log.tables["velocity"].num_rows < FEWEST_SAMPLES:
        return
    values = log.values("velocity", LINEAR_VELOCITY)
    leaps = _leaps(values)
    zeros = short_zeros(log.t_s("velocity"), values, UNDER_WAY_M_S)
    share = float(np.mean(leaps | zeros))
    if share <= limit("velocity_outliers"):
        return
    parts = []
    if leaps.any():
        largest = float(np.nanmax(np.abs(values[leaps])))
        parts.append(
            f"{counted(int(leaps.sum()), 'sample')} of {len(values)} leap and come back, to"
            f" {significant(largest)} m/s"
        )
    if zeros.any():
        parts.append(
            f"{counted(int(zeros.sum()), 'sample')} of {len(values)} are 0 in all axes while those"
            " before and after move"
        )
    yield finding(
        "velocity_outliers",
        f"Of the velocity ({log.source('velocity')}) {listed(parts)}.",
        stream="velocity",
        value=share,
        at_s=float(log.t_s("velocity")[np.flatnonzero(leaps | zeros)[0]]),
        fields=LINEAR_VELOCITY,
    )


def step_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield a velocity that steps to another value and goes on from there.

    A step to rest is that of a hull that hits something.
    """
    if not log.has("velocity") or log.source("velocity").startswith((OF_FIXES, OF_POSES)):
        return
    values, t_s = log.values("velocity", LINEAR_VELOCITY), log.t_s("velocity")
    steps = []
    for axis, name in enumerate(SPEEDS[:2]):
        there = np.isfinite(values[:, axis])
        t, speed = t_s[there], values[there, axis]
        at = jumps(t, speed, least=limit("velocity_step"), rate=FASTEST_M_S2)
        at = at[np.abs(speed[at + 1]) > STOPPED * np.abs(speed[at + 1] - speed[at])]
        steps += [(float(speed[row + 1] - speed[row]), float(t[row + 1]), name) for row in at]
    if not steps:
        return
    size, at_s, name = max(steps, key=lambda step: abs(step[0]))
    yield finding(
        "velocity_step",
        f"The velocity ({log.source('velocity')}) steps {how_often(len(steps))} to another"
        f" value and goes on from there, {name} by {size:+.2f} m/s at {at_s:.1f} s from the start,"
        " faster than a vehicle is accelerated.",
        stream="velocity",
        value=abs(size),
        at_s=at_s,
        fields=LINEAR_VELOCITY[:2],
    )


def _leaps(values: Array) -> Mask:
    """Return the samples (n,) that are far from the median of five about them."""
    padded = np.pad(values, ((2, 2), (0, 0)), mode="edge")
    five = np.stack([padded[start : start + len(values)] for start in range(5)])
    off = np.abs(values - np.partition(five, 2, axis=0)[2])
    usual = np.nanpercentile(off, 90.0, axis=0)
    return np.asarray((off > np.maximum(LEAP_M_S, LEAP_SPREADS * usual)).any(axis=1))


def short_zeros(t_s: Array, values: Array, moving: float) -> Mask:
    """Return the samples (n,) of short runs of zeros in all axes, under way.

    Those before and after them move. Zeros that begin and end at a usual change are a
    rest. `moving`: least size of what moves.
    """
    runs = [run for run in _zeros_under_way(t_s, values, moving) if run[2] <= LONGEST_ZERO_S]
    return _rows_of(runs if len(runs) >= FEWEST_RUNS else [], len(values))


def lost_zeros(t_s: Array, values: Array) -> Mask:
    """Return the samples (n,) of a velocity that are 0 in all axes for no value.

    Runs of any length, several of them, from full speed to full speed: no vehicle stops
    from one sample to the next and starts so again.
    """
    runs = _zeros_under_way(t_s, values, UNDER_WAY_M_S)
    several = len(runs) >= FEWEST_LOST and any(run[2] > LONGEST_ZERO_S for run in runs)
    return _rows_of(runs if several else [], len(values))


def _zeros_under_way(t_s: Array, values: Array, moving: float) -> list[tuple[int, int, float]]:
    """Return runs of zeros, between samples that move: first row, end, time [s]."""
    zero = (values == 0.0).all(axis=1)
    speed = np.abs(np.nan_to_num(values)).max(axis=1)
    least = max(moving, slow_speed(values))
    return [
        (first, end, float(t_s[end] - t_s[first - 1]))
        for first, end in runs_of(zero)
        if first > 0 and end < len(zero) and min(speed[first - 1], speed[end]) > least
    ]


def _rows_of(runs: Sequence[tuple[int, int, float]], count: int) -> Mask:
    between = np.zeros(count, dtype=np.bool_)
    for first, end, _ in runs:
        between[first:end] = True
    return between
