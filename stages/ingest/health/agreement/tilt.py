"""Roll and pitch that are off by a constant, or by a scale."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.attitude.angle_turns import (
    AngleTurns,
    angle_turns,
    depth_odds,
    gravity_gain,
)
from auvid.hydro.identification.checks.motion_checks import down_at, tilt_offset
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.hydro.identification.signals.pose.frames import (
    euler_of_quaternion,
    quaternion_of_euler,
)
from auvid.stages.columns import ATTITUDE, GYRO, OF_YAW, RATES
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import inertial_motion
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

CLEAR, LARGEST_RAD = 4.0, math.radians(35.0)
"""Standard deviations beyond the limit, and the largest tilt that is taken for one."""
TURNED_TILTS = ([-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, -1.0, 1.0])
SURE_INVERSE = 25.0
"""Logarithm of the likelihood of an inverse attitude over this one, or one with signs turned:
ten sound logs have -2 to -331, and their inverses as much the other way.
"""
CLOSE_RAD = math.radians(30.0)
"""How far gravity in the accelerometer may point from that of an attitude turned round."""
LEAST_TURN_RAD, LEAST_EXPLAINED = 0.004, 0.85
"""Standard deviation of the turns of a window, and the share of them that gyro and angle
share, from which on a scale is compared.
"""
ROUNDS = 4
YAW, ALIKE = 2, 0.1
"""Logarithm within which roll or pitch and yaw are off alike."""
SCALES = (0.4, 2.5)
"""Scales beyond are units, which have their own checks."""
NEARER = 3.0
"""In how many standard deviations gravity must be nearer to one of two scales."""


def tilt_findings(log: CheckedLog, *, least: float = 0.0) -> Iterator[Finding]:
    """Yield roll and pitch that are off by a constant against velocity and depth.

    `least`: share of what is not explained that the offset must explain.
    """
    attitude = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    offset = tilt_offset(
        *log.depth_of_velocity(), *attitude, log.t_s("velocity"), log.body_velocity()
    )
    if offset is None or offset.likelier <= 0.0 or offset.explained < least:
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


def with_upright(log: CheckedLog) -> tuple[CheckedLog, list[Finding]]:
    """Return the log with a roll that gravity agrees with, and a half turn."""
    force = log.accelerometer()
    if force is None or not log.has("attitude"):
        return log, []
    good = np.isfinite(force).all(axis=1)
    attitude = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    down = down_at(log.t_s("imu")[good], *attitude)
    size = np.maximum(np.linalg.norm(force[good], axis=1), 1e-9)
    along = float(np.median((force[good] * down).sum(axis=1) / size))
    turned = down * [1.0, -1.0, -1.0]
    other = float(np.median((force[good] * turned).sum(axis=1) / size))
    if np.median(down[:, 2]) > 0.0 or along < 0.0 or other > -math.cos(CLOSE_RAD):
        return log, []
    text = (
        f"The attitude ({log.source('attitude')}) has the vehicle upside down, and gravity in the"
        " accelerometer has it upright: roll is off by 180 degrees, as of a unit that is mounted"
        " upside down."
    )
    named = finding(
        "accelerometer_direction",
        text,
        stream="attitude",
        value=180.0,
        fields=ATTITUDE[:1],
        remedy="Take 180 degrees off the roll before the export, or turn the axes in its driver.",
    )
    roll = (attitude[1][:, 0] + 2.0 * np.pi) % (2.0 * np.pi) - np.pi
    return log.with_columns("attitude", {ATTITUDE[0]: roll}), [named]


def with_direction(log: CheckedLog) -> tuple[CheckedLog, list[Finding]]:
    """Return the log with an attitude that the depth follows without a gyro."""
    if log.has("imu") or not log.has("attitude", "depth", "velocity"):
        return log, []
    if not np.isfinite(log.body_velocity()).all():
        return log, []
    on_time = log.in_time()
    angles = on_time.values("attitude", ATTITUDE)
    inverse = euler_of_quaternion(quaternion_of_euler(angles) * [1.0, -1.0, -1.0, -1.0])
    others = [angles * signs for signs in ([1.0, 1.0, 1.0], *TURNED_TILTS)]
    odds = depth_odds(
        on_time.depth_of_velocity(),
        on_time.t_s("attitude"),
        [inverse, *others],
        (on_time.t_s("velocity"), on_time.body_velocity()),
    )
    if odds is None or odds[0] - max(odds[1:]) < SURE_INVERSE:
        return log, []
    named = finding(
        "attitude_inverse",
        f"The depth follows the velocity by the inverse of the attitude ({log.source('attitude')}),"
        f" e^{odds[0] - odds[1]:.0f} times as likely as by the attitude: it is that of the earth in"
        " axes of the body.",
        stream="attitude",
        value=odds[0] - odds[1],
        fields=ATTITUDE,
    )
    columns = dict(zip(ATTITUDE, inverse.T, strict=True))
    return log.with_columns("attitude", columns), [named]


def with_true_angles(log: CheckedLog) -> tuple[CheckedLog, list[Finding]]:
    """Return the log with roll and pitch of the right scale, and what was off."""
    if not log.has("imu", "attitude") or log.source("imu").startswith(OF_YAW):
        return log, []
    on_time = log.in_time()
    attitude = on_time.t_s("attitude"), on_time.values("attitude", ATTITUDE)
    scales = _scales(*attitude, on_time.t_s("imu"), on_time.values("imu", GYRO))
    sources = {axis: _of_gravity(on_time, axis, scales[axis]) for axis in scales if axis < YAW}
    if YAW in scales:  # it is the gyro where all that it turns is off alike
        alike = {axis: abs(math.log(scales[axis] / scales[YAW])) < ALIKE for axis in sources}
        sources = {axis: it for axis, it in sources.items() if it or not alike[axis]}
    scaled = {axis: scales[axis] for axis, source in sources.items() if source != "gyro"}
    if not scaled:
        return log, []
    parts = [f"{RATES[axis]} turns {scale:.2f} times as much" for axis, scale in scaled.items()]
    text = f"Of the attitude ({log.source('attitude')}) {listed(parts)} as the gyro"
    if all(sources[axis] for axis in scaled):
        text += ", and gravity in the accelerometer agrees with the gyro: the angle is scaled."
    else:
        text += ": the angle has another scale, or the gyro."
    fields = [ATTITUDE[axis] for axis in scaled]
    columns = {
        ATTITUDE[axis]: log.column("attitude", ATTITUDE[axis]) / scale
        for axis, scale in scaled.items()
    }
    largest = max(scaled.values(), key=lambda scale: abs(math.log(scale)))
    named = finding("attitude_scale", text, stream="attitude", value=largest - 1.0, fields=fields)
    return log.with_columns("attitude", columns), [named]


def _scales(t_s: Array, euler: Array, t_imu: Array, gyro: Array) -> dict[int, float]:
    """Return the scales of roll, pitch and yaw that are off for certain.

    Noise of the gyro lowers a gain g, which lies between g and g / R^2, as a filter of the
    angle does. Angles that are off turn each other wrongly: they are mended in rounds.
    """
    scales, clear = np.ones(3), {}
    for _ in range(ROUNDS):
        turns = angle_turns(t_s, euler / scales, t_imu, gyro)
        if turns is None:
            return {}
        gains = [turns.gain(axis) for axis in range(3)]
        clear = {
            axis: float(scales[axis] * gain.gain[0])
            for axis, gain in enumerate(gains)
            if gain is not None and _off(turns, axis, gain, scales[axis])
        }
        scales = scales * [1.0 if gain is None else gain.gain[0] for gain in gains]
        if not ((scales > SCALES[0]) & (scales < SCALES[1])).all():
            return {}
    return clear


def _off(turns: AngleTurns, axis: int, gain: AxisGains, scale: float) -> bool:
    size, sd = scale * float(gain.gain[0]), scale * float(gain.sd[0])
    moved = float(np.std(turns.by_gyro[:, axis].sum(axis=1)))
    if moved < LEAST_TURN_RAD or gain.explained < LEAST_EXPLAINED:
        return False
    high, least = size / gain.explained + CLEAR * sd, limit("attitude_scale")
    return high < 1.0 - least or size - CLEAR * sd > 1.0 + least


def _of_gravity(log: CheckedLog, axis: int, scale: float) -> str:
    """Return what gravity says is off, "angle" or "gyro"; empty for neither.

    What it says lies between a gain and that over the share that it explains.
    """
    force = log.accelerometer()
    if force is None or log.info.accelerometer not in (None, "specific_force"):
        return ""
    motion = inertial_motion(log)
    good = np.isfinite(force).all(axis=1)
    gain = gravity_gain(
        (log.t_s("imu")[good], log.values("imu", GYRO)[good], force[good]),
        (log.t_s("attitude"), log.values("attitude", ATTITUDE)),
        None if motion is None else motion.velocity,
        gravity=STANDARD_GRAVITY,
        axis=axis,
    )
    if gain is None or gain.gain[0] <= 0.0 or gain.explained <= 0.0:
        return ""
    low = float(gain.gain[0])
    high = low / gain.explained
    off = {
        name: max(low - expected, expected - high, 0.0)
        for name, expected in (("angle", 1.0 / scale), ("gyro", 1.0))
    }
    nearer = off["gyro"] - off["angle"]
    if abs(nearer) < NEARER * float(gain.sd[0]):
        return ""
    return "angle" if nearer > 0.0 else "gyro"
