"""Check of the arm of the velocity log, by accelerometer and depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array, Mask
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.motion_checks import down_at
from auvid.hydro.identification.checks.velocity_answer import ArmOffset, arm_offset
from auvid.stages.columns import ATTITUDE, GYRO, LINEAR_VELOCITY, OF_FIXES, OF_POSES
from auvid.stages.ingest.health.actuation.push_answers import CLEAR
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

LEAST_OF_ARM, SAME_ARM_M = 0.6, 0.05
"""Least share that another arm explains, and how near it is to the stated one turned."""


@dataclass(frozen=True)
class InertialMotion:
    """What inertial unit, attitude, velocity log and depth sensor measured.

    imu: times (n,), gyro (n, 3), specific force (n, 3); attitude: times, angles (m, 3);
    velocity: times (k,), that of the inertial unit by the stated arms (k, 3); `rates`
    (k, 3) at these times; depth: times, depth of the inertial unit; None without them.
    """

    imu: tuple[Array, Array, Array]
    attitude: tuple[Array, Array]
    velocity: tuple[Array, Array]
    rates: Array
    depth: tuple[Array, Array] | None
    arm_m: Array | None

    def at_arm(self, offset: Array) -> Array:
        """Return the velocity (k, 3) with the log at so much another arm [m]."""
        return np.asarray(self.velocity[1] - np.cross(self.rates, offset))

    def arm(self) -> ArmOffset | None:
        """Return by how much the stated arm is off; None where none is stated."""
        return None if self.arm_m is None else self.free_arm()

    def free_arm(self) -> ArmOffset | None:
        """Return the arm beyond the stated one; all of it where none is stated."""
        return arm_offset(
            self.imu, self.attitude, self.velocity, self.depth, gravity=STANDARD_GRAVITY
        )


def inertial_motion(log: CheckedLog) -> InertialMotion | None:
    """Return what the sensors measured, where velocity and accelerometer are there.

    `log` is on one clock, without the lags of the vehicle file.
    """
    force = log.accelerometer()
    if force is None or log.info.accelerometer not in (None, "specific_force"):
        return None
    if not log.has("attitude", "velocity") or not np.isfinite(log.body_velocity()).all():
        return None
    if log.estimated("velocity") or log.source("velocity").startswith((OF_FIXES, OF_POSES)):
        return None
    good = np.isfinite(force).all(axis=1)
    times, gyro = log.t_s("imu")[good], log.values("imu", GYRO)[good]
    attitude = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    t, speed = log.t_s("velocity"), log.body_velocity()
    rates = np.column_stack([np.interp(t, times, part) for part in gyro.T])
    depth = (log.t_s("depth"), log.column("depth", "depth_m")) if log.has("depth") else None
    arm = None
    if log.vehicle is not None:  # all at the place of the inertial unit
        vehicle = log.vehicle
        arm = vehicle.dvl.arm_m - vehicle.imu.arm_m
        speed = speed - np.cross(rates, arm)
        if depth is not None:
            lower = vehicle.imu.arm_m - vehicle.depth_sensor.arm_m
            depth = depth[0], depth[1] + down_at(depth[0], *attitude) @ lower
    return InertialMotion((times, gyro, force[good]), attitude, (t, speed), rates, depth, arm)


def clear_arm(arm: ArmOffset) -> Mask:
    """Return the axes (3,) in which an arm is off for certain."""
    if arm.explained < LEAST_OF_ARM:
        return np.zeros(3, dtype=np.bool_)
    return np.asarray(np.abs(arm.offset) - CLEAR * arm.sd > limit("arm_off"))


def wrong_arm(log: CheckedLog, arm: ArmOffset | None) -> Iterator[Finding]:
    """Yield an arm of the velocity log that is another than the vehicle file states."""
    if arm is None or log.vehicle is None or not clear_arm(arm).any():
        return
    stated = log.vehicle.dvl.arm_m
    axes = np.flatnonzero(clear_arm(arm)).tolist()
    parts = [
        f"{'xyz'[axis]} {stated[axis] + arm.offset[axis]:+.2f} +- {2.0 * arm.sd[axis]:.2f} m, where"
        f" the vehicle file gives {stated[axis]:+.2f}"
        for axis in axes
    ]
    turned = [
        "xyz"[axis]
        for axis in axes
        if abs(arm.offset[axis] + 2.0 * stated[axis]) < max(CLEAR * arm.sd[axis], SAME_ARM_M)
    ]
    text = (
        f"The velocity log sits at {listed(parts)}, by what turns of the vehicle add to its"
        f" velocity ({arm.explained:.2f} explained)."
    )
    if turned:
        text += f" {listed(turned)} ha{'s' if len(turned) == 1 else 've'} the wrong sign."
    yield finding(
        "arm_off",
        text,
        stream="velocity",
        value=float(np.abs(arm.offset[axes]).max()),
        fields=LINEAR_VELOCITY,
    )
