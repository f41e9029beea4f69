"""Check of attitude and gyro together against accelerometer, velocity and depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.attitude.inertial_lag import InertialLag, inertial_lag
from auvid.hydro.identification.checks.attitude.rate_agreement import rate_agreement
from auvid.stages.columns import (
    ACCELEROMETER,
    ATTITUDE,
    GYRO,
)
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import clear_arm, inertial_motion
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit

SURE_ODDS, SURE_OF_ATTITUDE, SURE_BY_DEPTH = 30.0, 10.0, 10.0
"""Logarithm of the likelihood of a lag over none: by accelerometer and velocity (no
sound leg of 60 exceeds 16); over a late velocity, which explains more where it is the
cause (by 20 to 900), and less where it is not (by 15 to 900); and in the depth rate, where
it tells which of both is late.
"""
ROUNDING = 1e-9
AFTER = ("before", "after")


def with_inertial_lag(log: CheckedLog) -> tuple[CheckedLog, list[Finding]]:
    """Return the log with its inertial unit and attitude in time, and what was late."""
    answer = _lag(log.in_time())
    if answer is None or answer.better_than_none < SURE_ODDS:
        return log, []
    if answer.better_than_velocity < SURE_OF_ATTITUDE:
        return log, []
    lag = answer.lag_s
    if abs(lag) < limit("inertial_lag") - ROUNDING:
        return log, []
    by_depth = answer.by_depth or 0.0
    if by_depth < -SURE_BY_DEPTH:
        text = (
            f"The accelerometer ({log.source('imu')}) comes {abs(lag):.2f} s {AFTER[lag < 0.0]}"
            " attitude, gyro and velocity, which agree with each other and with the depth; or"
            f" attitude, gyro and depth all come so much {AFTER[lag > 0.0]} accelerometer and"
            " velocity."
        )
        return _read_later(log, ACCELEROMETER, -lag), [_late(text, lag, ACCELEROMETER)]
    times = {name: log.t_s(name) for name in log.tables}
    times["attitude"] = times["attitude"] - lag
    later_s = _after_gyro(log)
    if abs(lag - later_s) < 0.5 * abs(lag):  # a filter of the angles, not of the gyro
        text = (
            f"The attitude ({log.source('attitude')}) comes {abs(later_s):.2f} s"
            f" {AFTER[later_s > 0.0]} the gyro, and {abs(lag):.2f} s {AFTER[lag > 0.0]}"
            " accelerometer and velocity, by gravity."
        )
        return replace(log, _times=times), [_late(text, lag, ATTITUDE)]
    text = (
        f"Attitude ({log.source('attitude')}) and gyro ({log.source('imu')}) both come"
        f" {abs(lag):.2f} s {AFTER[lag > 0.0]} accelerometer and velocity, by gravity"
    )
    if by_depth > SURE_BY_DEPTH:
        text += " and by the depth that the velocity makes: they pass a filter, or their clock is"
        text += " another."
    else:
        text += f"; or the accelerometer comes so much {AFTER[lag < 0.0]} them."
    mended = _read_later(replace(log, _times=times), GYRO, lag)
    return mended, [_late(text, lag, (*ATTITUDE, *GYRO))]


def _after_gyro(log: CheckedLog) -> float:
    """Return how late the attitude shows what the gyro shows [s], or 0."""
    gyro = log.t_s("imu"), log.values("imu", GYRO)
    agreement = rate_agreement(log.t_s("attitude"), log.values("attitude", ATTITUDE), *gyro)
    return 0.0 if agreement is None else -agreement.lag_s


def _lag(log: CheckedLog) -> InertialLag | None:
    motion = inertial_motion(log)
    if motion is None:
        return None
    t, speed = log.t_s("velocity"), log.body_velocity()
    arm_m = np.zeros(3) if motion.arm_m is None else motion.arm_m
    arm = motion.free_arm()
    other_arm_m = None
    if arm is not None:  # turns of a wrong arm are no lag
        other_arm_m = arm_m + arm.offset
        arm_m = arm_m + arm.offset * clear_arm(arm)
    return inertial_lag(
        motion.imu,
        motion.attitude,
        (t, speed),
        motion.depth,
        gravity=STANDARD_GRAVITY,
        arm_m=arm_m,
        other_arm_m=other_arm_m,
    )


def _read_later(log: CheckedLog, fields: tuple[str, ...], lag_s: float) -> CheckedLog:
    """Return the log with columns of its inertial unit read so much later."""
    t = log.t_s("imu")
    columns = {name: np.interp(t + lag_s, t, log.column("imu", name)) for name in fields}
    return log.with_columns("imu", columns)


def _late(text: str, lag_s: float, fields: tuple[str, ...]) -> Finding:
    return finding("inertial_lag", text, stream="imu", value=abs(lag_s), fields=fields)
