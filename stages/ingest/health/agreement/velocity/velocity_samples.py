"""Checks of single samples of the velocity against those before and after them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, Mask, runs_of
from auvid.hydro.constants import NORMAL_SPREAD, STANDARD_GRAVITY
from auvid.hydro.identification.checks.motion_checks import WINDOW_S
from auvid.hydro.identification.checks.signal_checks import jumps, repeats, slow_speed
from auvid.hydro.identification.checks.velocity_answer import pulled_by
from auvid.stages.columns import LINEAR_VELOCITY, OF_FIXES, OF_POSES, SPEEDS
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import inertial_motion
from auvid.stages.ingest.health.agreement.velocity.velocity_depth import log_depth_rates
from auvid.stages.ingest.health.finding import (
    CheckedLog,
    Finding,
    counted,
    finding,
    how_often,
    limit,
    listed,
)
from auvid.stages.number_format import percent, significant

LEAP_M_S, LEAP_M, LEAP_SPREADS = 1.0, 0.5, 10.0
"""An outlier is so far from the median of five samples, and so many times what most are."""
TURN_STEPS = 2.0
"""Usual steps from sample to sample that an outlier is off at least."""
LEAST_TOP_M_S, ONE_RUN = 0.1, 0.8
"""Largest value from which on an axis may be cut off, and the part of such samples that one
run has at most: a longer one is that of a sensor that is stuck.
"""
COARSE_STEPS = 1.5
"""Smallest steps of a sensor by which a speed comes to the end of its range if it is cut off."""
FASTEST_M_S2 = 1.5
"""A step of the velocity that is slower may be an acceleration."""
STOPPED = 0.25
"""Speed behind a step, as a part of it, up to which a hull has been stopped."""
FELT, CLEARLY_FELT = 0.3, 3.0
"""Part of a step to rest below which the accelerometer does not show it, and how many
times its usual change in a second a step must be for that.
"""
GOES_ON, LEAST_RATE_M_S, FEWEST_OF_DEPTH = 3.0, 0.03, 10
"""How many times as much of the depth rate must be without a cause behind a step as before
it, how much that is at least, and in how many windows.
"""
UNDER_WAY_M_S = 0.05
LONGEST_ZERO_S = 2.0
"""Zeros that last longer are a rest, or a sensor that is stuck, which has its own check."""
FEWEST_SAMPLES, FEWEST_RUNS, FEWEST_LOST = 50, 3, 2


def outlier_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield samples that leap and come back, and those that are zero in between."""
    yield from _depth_outliers(log)
    yield from _saturated(log)
    if not log.has("velocity") or log.tables["velocity"].num_rows < FEWEST_SAMPLES:
        return
    values = log.values("velocity", LINEAR_VELOCITY)
    leaps = _leaps(values, LEAP_M_S)
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


@dataclass(frozen=True)
class _Step:
    """A step of an axis of the velocity: its size [m/s], when it is over [s]."""

    axis: int
    size: float
    at_s: float


def step_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield a velocity that steps to another value and goes on from there.

    A step to rest is that of a hull that hits something, or of a velocity log that sees
    nothing any more: accelerometer and depth tell which.
    """
    if not log.has("velocity") or log.source("velocity").startswith((OF_FIXES, OF_POSES)):
        return
    values, t_s = log.values("velocity", LINEAR_VELOCITY), log.t_s("velocity")
    steps: list[_Step] = []
    stops: list[_Step] = []
    for axis in range(2):
        there = np.isfinite(values[:, axis])
        t, speed = t_s[there], values[there, axis]
        for row in jumps(t, speed, least=limit("velocity_step"), rate=FASTEST_M_S2).tolist():
            step = _Step(axis, float(speed[row + 1] - speed[row]), float(t[row + 1]))
            rests = abs(float(speed[row + 1])) <= STOPPED * abs(step.size)
            (stops if rests else steps).append(step)
    lost = [step for step in stops if _is_lost(log, step)]
    source = log.source("velocity")
    if steps:
        step = max(steps, key=lambda each: abs(each.size))
        yield _stepped(
            step,
            f"The velocity ({source}) steps {how_often(len(steps))} to another value and goes on"
            f" from there, {SPEEDS[step.axis]} by {step.size:+.2f} m/s at {step.at_s:.1f} s from"
            " the start, faster than a vehicle is accelerated.",
        )
    elif lost:
        step = max(lost, key=lambda each: abs(each.size))
        yield _stepped(
            step,
            f"The velocity ({source}) falls {how_often(len(lost))} to rest while the vehicle goes"
            f" on, {SPEEDS[step.axis]} by {step.size:+.2f} m/s at {step.at_s:.1f} s from the"
            " start: neither accelerometer nor depth shows that it stops. The velocity log sees"
            " nothing any more, and reads noise about 0.",
        )
    elif unsure := [step for step in stops if not _is_felt(log, step)]:
        step = max(unsure, key=lambda each: abs(each.size))
        yield finding(
            "velocity_stops",
            f"The velocity ({source}) falls {how_often(len(unsure))} to rest from one sample to the"
            f" next, {SPEEDS[step.axis]} by {step.size:+.2f} m/s at {step.at_s:.1f} s from the"
            " start: the hull hits something, or the velocity log sees nothing any more. Nothing"
            " in the log tells which.",
            stream="velocity",
            value=abs(step.size),
            at_s=step.at_s,
            fields=LINEAR_VELOCITY[:2],
        )


def _stepped(step: _Step, text: str) -> Finding:
    return finding(
        "velocity_step",
        text,
        stream="velocity",
        value=abs(step.size),
        at_s=step.at_s,
        fields=LINEAR_VELOCITY[:2],
    )


def _is_lost(log: CheckedLog, step: _Step) -> bool:
    """Return whether the vehicle goes on where its velocity falls to rest."""
    return _is_felt(log, step) is False or _depth_goes_on(log, step.at_s)


def _is_felt(log: CheckedLog, step: _Step) -> bool | None:
    """Return whether the accelerometer shows a step; None where it cannot tell."""
    motion = inertial_motion(log.in_time())
    if motion is None:
        return None
    times, _, force = motion.imu
    first = step.at_s - 0.5 * WINDOW_S
    if first < times[0] or step.at_s + WINDOW_S > times[-1]:
        return None
    at = np.append(np.arange(times[0], times[-1] - WINDOW_S, WINDOW_S), first)
    gained = pulled_by(times, force, motion.attitude, STANDARD_GRAVITY, at)[:, step.axis]
    usual = float(np.median(gained[:-1]))
    spread = NORMAL_SPREAD * float(np.median(np.abs(gained[:-1] - usual)))
    if abs(step.size) < CLEARLY_FELT * spread:
        return None
    return bool((gained[-1] - usual) / step.size > FELT)


def _depth_goes_on(log: CheckedLog, at_s: float) -> bool:
    """Return whether the depth moves as no velocity says any more from a time on."""
    rates = log_depth_rates(log)
    if rates is None:
        return False
    missing, later = np.abs(rates.rise - rates.expected), rates.at > at_s
    if min(int(later.sum()), int((~later).sum())) < FEWEST_OF_DEPTH:
        return False
    before, behind = float(np.median(missing[~later])), float(np.median(missing[later]))
    return behind > max(GOES_ON * before, LEAST_RATE_M_S)


def _depth_outliers(log: CheckedLog) -> Iterator[Finding]:
    """Yield samples of the depth that leap and come back."""
    if not log.has("depth") or log.tables["depth"].num_rows < FEWEST_SAMPLES:
        return
    depth = log.column("depth", "depth_m")
    leaps = _leaps(depth[:, None], LEAP_M)
    share = float(np.mean(leaps))
    if share <= limit("depth_outliers"):
        return
    yield finding(
        "depth_outliers",
        f"{counted(int(leaps.sum()), 'sample')} of {depth.size} of the depth"
        f" ({log.source('depth')}) leap and come back, to"
        f" {significant(float(np.nanmax(np.abs(depth[leaps]))))} m.",
        stream="depth",
        value=share,
        at_s=float(log.t_s("depth")[np.flatnonzero(leaps)[0]]),
        fields=("depth_m",),
    )


def _saturated(log: CheckedLog) -> Iterator[Finding]:
    """Yield axes of the velocity that stand at their largest value, again and again."""
    if not log.has("velocity") or log.tables["velocity"].num_rows < FEWEST_SAMPLES:
        return
    values = log.values("velocity", LINEAR_VELOCITY)
    values = values[np.append(True, (np.diff(values, axis=0) != 0.0).any(axis=1))]  # none held
    parts, shares = [], []
    for axis, name in enumerate(SPEEDS):
        speed = values[np.isfinite(values[:, axis]), axis]
        top = max(np.abs(speed), default=0.0)
        share = _cut_share(speed)
        is_stuck = _longest_share(speed) >= ONE_RUN * share
        if top > LEAST_TOP_M_S and share > limit("velocity_saturated") and not is_stuck:
            parts.append(f"{name} at {significant(float(top))} m/s in {percent(share)}")
            shares.append(share)
    if parts:
        yield finding(
            "velocity_saturated",
            f"The velocity ({log.source('velocity')}) stands at its largest value again and again:"
            f" {listed(parts)} of its samples. What is faster is cut off.",
            stream="velocity",
            value=max(shares),
            fields=LINEAR_VELOCITY,
        )


def _cut_share(speed: Array) -> float:
    """Return the part of a speed (n,) that is cut off at an end of its range.

    A steady speed in coarse steps comes to its end by the smallest step of the sensor, one
    that is cut off by any.
    """
    at = ((speed == speed.max()) | (speed == speed.min())) & (speed != 0.0)
    steps = np.abs(np.diff(speed))
    runs = [(start, end) for start, end in runs_of(at) if end - start >= 3]
    entries = [steps[start - 1] for start, _ in runs if start]
    if not entries or np.median(entries) < COARSE_STEPS * steps[steps > 0.0].min():
        return 0.0
    return sum(end - start for start, end in runs) / speed.size


def _longest_share(values: Array) -> float:
    """Return the part of values (n,) that is the longest run of one of them."""
    return repeats(values[:, None]).run_count / max(values.size, 1)


def _leaps(values: Array, least: float) -> Mask:
    """Return the samples (n,) that are far from the median of five about them."""
    padded = np.pad(values, ((2, 2), (0, 0)), mode="edge")
    five = np.stack([padded[start : start + len(values)] for start in range(5)])
    off = np.abs(values - np.partition(five, 2, axis=0)[2])
    usual = LEAP_SPREADS * np.nanpercentile(off, 90.0, axis=0)
    # Where a dive turns into a climb the sample between is one step off.
    changes = np.abs(np.diff(values, axis=0))
    changes[:, np.isnan(changes).all(axis=0)] = 0.0  # every other value is missing
    steps = TURN_STEPS * np.nanpercentile(changes, 75.0, axis=0)
    return np.asarray((off > np.maximum(least, np.maximum(usual, steps))).any(axis=1))


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
