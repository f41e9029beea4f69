"""A constant tilt between attitude and velocity log, by the depth that both make."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.motion_checks import down_at, tilt_offset
from auvid.stages.columns import ATTITUDE, RATES
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

CLEAR, LARGEST_RAD = 4.0, math.radians(20.0)
"""Standard deviations beyond the limit, and the largest tilt that is taken for one."""


def tilt_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield roll and pitch that are off by a constant against velocity and depth."""
    attitude = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    offset = tilt_offset(
        *log.depth_of_velocity(), *attitude, log.t_s("velocity"), log.body_velocity()
    )
    if offset is None or offset.likelier <= 0.0:
        return
    size, sd = np.abs(offset.angle), offset.sd
    clear = (size - CLEAR * sd > math.radians(limit("tilt_offset"))) & (size < LARGEST_RAD)
    axes = np.flatnonzero(clear).tolist()
    if not axes:
        return
    off, spread = np.degrees(-offset.angle), np.degrees(2.0 * sd)
    parts = [f"{RATES[axis]} reads {off[axis]:+.1f} +- {spread[axis]:.1f} degrees" for axis in axes]
    yield finding(
        "tilt_offset",
        f"Depth and velocity ({log.source('velocity')}) say that {listed(parts)} too much: the"
        f" attitude is off, or the velocity log is mounted so much askew.{_by_gravity(log, axes)}",
        stream="attitude",
        value=float(off[axes[0]]),
        fields=[ATTITUDE[axis] for axis in axes],
    )


def _by_gravity(log: CheckedLog, axes: list[int]) -> str:
    """Return by how much the attitude reads too much against the accelerometer.

    f + g R^T [0 0 1] = g [b, -a] on average, where roll reads a and pitch b too little.
    """
    force = log.accelerometer()
    if force is None or log.info.accelerometer not in (None, "specific_force"):
        return ""
    good = np.isfinite(force).all(axis=1)
    t_s = log.t_s("imu")[good]
    down = down_at(t_s, log.t_s("attitude"), log.values("attitude", ATTITUDE))
    rest: Array = np.median(force[good] / STANDARD_GRAVITY + down, axis=0)
    off = np.degrees([rest[1], -rest[0]])
    parts = [f"{RATES[axis]} {off[axis]:+.1f} degrees" for axis in axes]
    return f" By the accelerometer the attitude reads {listed(parts)} too much."
