"""Body velocities that a log measures."""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array
from auvid.stages.columns import GYRO, LINEAR_VELOCITY, RATES, SPEEDS
from auvid.stages.ingest.health.finding import CheckedLog

DEPTH_RATE_S = 1.0
MOTION_WORDS = dict(zip("uvwpqr", (*SPEEDS, *RATES), strict=True))


def motions(log: CheckedLog) -> dict[str, tuple[Array, Array, str]]:
    """Return times (n,), values (n,) and source of each body velocity u v w p q r.

    The gyro is without its median.
    """
    streams = [name for name in ("velocity", "depth", "imu") if log.has(name)]
    of = [part for name in streams for part in (log.tables[name], log.t_s(name))]
    return log.once("motions", of, lambda: _motions(log))


def _motions(log: CheckedLog) -> dict[str, tuple[Array, Array, str]]:
    by_axis: dict[str, tuple[Array, Array, str]] = {}
    if log.has("velocity"):
        for axis, name in zip("uvw", LINEAR_VELOCITY, strict=True):
            by_axis[axis] = (
                log.t_s("velocity"),
                log.column("velocity", name),
                log.source("velocity"),
            )
    elif log.has("depth"):
        t_s, depth = log.t_s("depth"), log.column("depth", "depth_m")
        inside = (t_s >= t_s[0] + DEPTH_RATE_S / 2.0) & (t_s <= t_s[-1] - DEPTH_RATE_S / 2.0)
        at = t_s[inside]
        ends = [np.interp(at + side * DEPTH_RATE_S / 2.0, t_s, depth) for side in (-1.0, 1.0)]
        if at.size:
            by_axis["w"] = (
                at,
                (ends[1] - ends[0]) / DEPTH_RATE_S,
                f"rate of depth ({log.source('depth')})",
            )
    if log.has("imu"):
        for axis, name in zip("pqr", GYRO, strict=True):
            rate = log.column("imu", name)
            if np.ptp(rate) == 0.0:
                continue  # no live sensor
            by_axis[axis] = (log.t_s("imu"), rate - np.median(rate), log.source("imu"))
    return by_axis
