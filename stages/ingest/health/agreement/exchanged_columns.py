"""Columns of two sensors that a map takes for each other."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.attitude.rate_agreement import RateAgreement, rate_agreement
from auvid.hydro.identification.checks.motion_checks import depth_gains
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, GYRO, LINEAR_VELOCITY, RATES
from auvid.stages.ingest.health.agreement.gyro import agrees
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding
from auvid.stages.number_format import percent

LEAST_ALIKE, MOST_ALIKE = 0.9, 0.5
"""Correlation of an exchanged gyro with the attitude, and what the mapped one has at most."""
PERHAPS_ALIKE = 0.7
"""The largest that it has at any lag is not less, whatever turns count as jumps."""
SCALES, SCALE_PART = (1.0, math.radians(1.0), math.degrees(1.0)), 0.15
"""What units make of an exchanged gyro, and how near its scale is to one of them."""
EXPLAINED, GAIN_PART = 0.8, 0.3
"""Share of the depth rate that exchanged columns explain, how near its gain of heave is to one."""
UNEXPLAINED, FITTING = 0.3, 0.5
"""Share, and distance of the gain from one, beyond which the mapped columns do not fit."""


def exchanged_columns(log: CheckedLog) -> Iterator[Finding]:
    """Yield columns of two sensors that fit each other once they are exchanged."""
    if log.has("imu", "attitude"):
        yield from _of_gyro(log)
    if log.has("depth", "velocity", "attitude"):
        yield from _of_depth(log)


def _of_gyro(log: CheckedLog) -> Iterator[Finding]:
    """Yield a gyro exchanged with an accelerometer's axis, or with an angle."""
    t_s, angles = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    t_imu, gyro = log.t_s("imu"), log.values("imu", GYRO)
    agreement = rate_agreement(t_s, angles, t_imu, gyro)
    if agreement is None or agrees(agreement):
        return
    force = log.accelerometer()
    of_force = None if force is None else rate_agreement(t_s, angles, t_imu, force)
    for axis, place in np.ndindex(3, 3):
        if force is None or abs(agreement.correlation[axis, axis]) > MOST_ALIKE:
            continue
        if of_force is not None and of_force.largest[axis, place] < PERHAPS_ALIKE:
            continue
        other = gyro.copy()
        other[:, axis] = force[:, place]
        again = rate_agreement(t_s, angles, t_imu, other)
        if again is not None and _alike(again, axis):
            yield _exchanged(log, "imu", GYRO[axis], "imu", ACCELEROMETER[place], RATES[axis])
            return
    for axis in range(3):
        turned, other = angles.copy(), gyro.copy()
        turned[:, axis] = np.interp(t_s, t_imu, gyro[:, axis])
        other[:, axis] = np.interp(t_imu, t_s, angles[:, axis])
        again = rate_agreement(t_s, turned, t_imu, other)
        if again is not None and agrees(again):
            yield _exchanged(log, "attitude", ATTITUDE[axis], "imu", GYRO[axis], RATES[axis])
            return


def _alike(agreement: RateAgreement, axis: int) -> bool:
    """Return whether a gyro turns as the attitude about an axis, in some unit."""
    scale = float(agreement.scale[axis])
    if scale <= 0.0 or float(agreement.correlation[axis, axis]) < LEAST_ALIKE:
        return False
    return any(abs(math.log(scale / unit)) < SCALE_PART for unit in SCALES)


def _of_depth(log: CheckedLog) -> Iterator[Finding]:
    """Yield a depth that is exchanged with heave of the velocity."""
    t_s, depth = log.t_s("depth"), log.column("depth", "depth_m")
    t_velocity, velocity = log.t_s("velocity"), log.values("velocity", LINEAR_VELOCITY)
    attitude = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    own = depth_gains(t_s, depth, *attitude, t_velocity, velocity)
    if own is None or not np.isfinite(velocity).all():
        return
    if own.explained > UNEXPLAINED and abs(float(own.gain[2]) - 1.0) < FITTING:
        return
    other: Array = velocity.copy()
    other[:, 2] = np.interp(t_velocity, t_s, depth)
    again = depth_gains(t_velocity, velocity[:, 2], *attitude, t_velocity, other)
    if again is None or again.explained < EXPLAINED:
        return
    if abs(float(again.gain[2]) - 1.0) < GAIN_PART:
        share = f"the depth rate follows heave ({percent(again.explained)} explained)"
        yield _exchanged(log, "depth", "depth_m", "velocity", LINEAR_VELOCITY[2], "heave", share)


def _exchanged(
    log: CheckedLog, stream: str, one: str, other_stream: str, other: str, axis: str, why: str = ""
) -> Finding:
    reason = why or f"attitude and gyro agree about {axis}"
    return finding(
        "columns_exchanged",
        f"{one} ({log.source(stream)}) and {other} ({log.source(other_stream)}) are exchanged: the"
        f" other way round {reason}.",
        stream=stream,
        value=1.0,
        fields=(one, other),
    )
