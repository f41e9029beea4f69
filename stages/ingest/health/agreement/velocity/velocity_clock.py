"""One axis of the velocity that is late, or early, by itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.response import Response, tone_share
from auvid.hydro.identification.checks.velocity_answer import odds_of_velocities
from auvid.stages.columns import LINEAR_VELOCITY, OF_POSES
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS, motions
from auvid.stages.ingest.health.actuation.responses import drives, slow_by_itself
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import inertial_motion
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, listed

EARLY_S, LATER_S, LATEST_S = 0.15, 0.5, 0.9
"""Lead over the outputs, and lag over all other axes of the velocity, from which on an axis
is out of time by itself; and lag of the others that hulls and thrusters make at most.
"""
LARGEST_TONE = 0.7
"""Part of the power of a motion that one frequency may have where its lag tells."""
SURE_ODDS, SHARES = 10.0, (0.4, 0.7, 1.0)
"""Logarithm of the likelihood from which on the accelerometer tells an axis of the velocity,
and parts of the time by which it may be late: the hull may be slow along it as well.
"""


def axis_out_of_time(answers: Mapping[str, Response]) -> tuple[str, float] | None:
    """Return the axis of the velocity that is late by itself, and by how much [s].

    It follows the outputs much later than the other axes do, or comes before them while
    the others follow: negative. Heave that is late is told by the depth: where a hull holds
    its depth it is slow (1.18 s for .57 s on a recorded dive).
    """
    lags = {axis: answers[axis].lag_s for axis in "uvw" if axis in answers}
    if len(lags) < 2:
        return None
    for axis, lag in lags.items():
        others = [each for name, each in lags.items() if name != axis]
        usual = float(np.mean(others))
        if lag < -EARLY_S and min(others) > EARLY_S:
            return axis, lag - usual
        if axis != "w" and max(others) < LATEST_S and lag > max(others) + LATER_S:
            return axis, lag - usual
    return None


def felt_elsewhen(log: CheckedLog, axes: str, off_s: float) -> bool | None:
    """Return whether the accelerometer feels these axes of the velocity at other times.

    It is as slow as the hull and moves with its waves. off_s: how late they may be at most,
    negative early. None where it does not tell, or there is none.
    """
    motion = inertial_motion(log.in_time())
    if motion is None:
        return None
    t_s, speed = motion.velocity
    speeds = [speed.copy() for _ in (0.0, *SHARES)]
    for share, each in zip(SHARES, speeds[1:], strict=True):
        for column in map("uvw".index, axes):
            each[:, column] = np.interp(t_s + share * off_s, t_s, speed[:, column])
    odds = odds_of_velocities(motion.imu, motion.attitude, t_s, speeds, gravity=STANDARD_GRAVITY)
    if odds is None or float(odds.max()) <= SURE_ODDS:
        return None
    return bool(odds[1:].max() > odds[0])


def _is_off(log: CheckedLog, axis: str, off_s: float) -> bool:
    """Return whether an axis of the velocity is late or early, and not the hull.

    Without an accelerometer a late axis is told by how well drag and inertia explain the
    motion against any delay.
    """
    felt = felt_elsewhen(log, axis, off_s)
    return felt if felt is not None else off_s < 0.0 or not slow_by_itself(log, axis, less=0.0)


def axis_findings(log: CheckedLog, answers: Mapping[str, Response]) -> Iterator[Finding]:
    """Yield an axis of the velocity with another clock, or filter, than the others."""
    single = axis_out_of_time(answers)
    if single is None or log.estimated("velocity"):
        return
    if log.source("velocity").startswith(OF_POSES):
        return  # one clock in the axes of the tank: the hull is slower along this axis
    axis, off_s = single
    at, motion, _ = motions(log)[axis]
    if tone_share(at, motion[:, None])[1] > LARGEST_TONE:
        return  # lags repeat with the period
    if off_s < 0.0 and drives(log, axis):
        return  # a controller answers the motion
    if not _is_off(log, axis, off_s):
        return  # a hull that answers more slowly along this axis, or a controller its waves
    others = [
        f"{MOTION_WORDS[name]} by {answers[name].lag_s:.2f} s"
        for name in "uvw"
        if name in answers and name != axis
    ]
    late = "late" if off_s > 0.0 else "early"
    yield finding(
        "velocity_lag",
        f"{MOTION_WORDS[axis].capitalize()} of the velocity ({log.source('velocity')}) follows the"
        f" outputs by {answers[axis].lag_s:.2f} s, {listed(others)}: {MOTION_WORDS[axis]} alone is"
        f" some {abs(off_s):.1f} s {late}"
        f"{', by a filter or another clock' if off_s > 0.0 else ': a setpoint, or another clock'}.",
        stream="velocity",
        value=abs(off_s),
        fields=(LINEAR_VELOCITY["uvw".index(axis)],),
        remedy=f"Map the measured {MOTION_WORDS[axis]} as it is, no setpoint and no filtered one,"
        " or mend the time of this column before the export.",
    )
