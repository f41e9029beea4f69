"""Commands of axes that push other axes as much as their own, and turned markers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.identification.checks.motion_checks import angles_at, response_gains
from auvid.hydro.identification.checks.outputs.pushed_turn import pushed_turn
from auvid.stages.columns import ATTITUDE, GYRO, LINEAR_VELOCITY, OF_POSES, RATES, SPEEDS
from auvid.stages.ingest.health.actuation.push_answers import (
    CLEAR,
    DRIVEN,
    body_motion,
    coupling,
)
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

LEAST_GAIN_SD, MIXED_AXES = 6.0, 2
"""A push of a command counts from so many standard deviations on; a thing of two axes."""
MOTIONS = dict(zip((*SPEEDS, RATES[2]), (*LINEAR_VELOCITY, GYRO[2]), strict=True))
WITH_Y_UP = {SPEEDS[1]: LINEAR_VELOCITY[2], SPEEDS[2]: LINEAR_VELOCITY[1], RATES[2]: GYRO[1]}
"""Where sway, heave and yaw go if poses with y up are read with z up or down."""
STEADY_SIDE, LEVEL_SIDE, TILTED = 0.9, 0.3, 0.5
"""Length of the mean direction of the body's y axis in such poses, its part up or down, and
the cosine of a tilt.
"""
LEAST_TILTED, STEADY_HEADING = 0.02, 0.9
"""Share of the time for which an upright vehicle is tilted, and length of the mean heading of
one that does not turn.
"""
CIRCLE_AS_DEGREES, LESS_LEFT = 1.01 * math.radians(2.0 * math.pi), 0.7
"""Largest angle of radians read as degrees, and the share of what commands leave unexplained of
surge and sway that they leave where such angles are taken for radians, at most.
"""


def mixed_commands(log: CheckedLog) -> Iterator[Finding]:
    """Yield axes that the commands of others push as much as their own do.

    Poses whose y is up are named as such.
    """
    names = log.commands()
    if not log.has("actuators") or len(names) < MIXED_AXES:
        return
    commands = np.nan_to_num(log.values("actuators", names))
    moving = np.ptp(commands, axis=0) > 0.0
    commands = commands[:, moving]  # gains are per unit: a coupled hull is no mixed command
    driven = [
        name.removeprefix("command_") for name, moves in zip(names, moving, strict=True) if moves
    ]
    if len(driven) < MIXED_AXES:
        return
    tilted = _turns_about_y(log)
    if tilted > limit("pose_up"):
        answers = _answers(log, driven, commands, WITH_Y_UP)
        own = [axis for axis, pushing in answers.items() if pushing == [axis]]
        if 2 * len(own) > len(answers):
            answer = "answer their own commands" if len(own) > 1 else "answers its own command"
            yield finding(
                "pose_up",
                "The poses look as if y were up: read as they are, the vehicle is tilted by more"
                f" than 60 degrees for {tilted:.0%} of the time about a y axis that keeps its"
                f" direction; with y up {listed(own)} {answer}.",
                stream="pose",
                value=tilted,
            )
            return
    if _level_heave(log, driven, commands):
        yield finding(
            "pose_up",
            "The poses look as if y were up: the vehicle is upright and turns, but heave moves"
            " it to one side of the tank and not down.",
            stream="pose",
            value=1.0,
        )
        return
    turned = list(turned_markers(log))
    if turned:
        yield from turned
        return
    words = [
        f"{axis} the commands of {listed(pushing)}"
        for axis, pushing in _answers(log, driven, commands, MOTIONS).items()
        if pushing != [axis]
    ]
    if len(words) >= MIXED_AXES:
        yield finding(
            "commands_mixed",
            f"Axes answer commands of other axes: {'; '.join(words)}.",
            stream="actuators",
            value=float(len(words)),
        )


def turned_markers(log: CheckedLog) -> Iterator[Finding]:
    """Yield the angle by which commands of surge and sway push the poses aside."""
    first = [f"command_{name}" for name in SPEEDS[:2]]
    if not log.has("velocity", "imu", "actuators") or not set(first) <= set(log.commands()):
        return
    if not log.source("velocity").startswith(OF_POSES):
        return
    names = first + [name for name in log.commands() if name not in first]
    commands = np.nan_to_num(log.values("actuators", names))
    moving = np.ptp(commands, axis=0) > 0.0
    at = log.t_s("velocity")
    coupled = coupling(log, 0, at)
    if not moving[:2].all() or coupled is None:
        return
    commands = commands[:, moving]
    if _is_in_radians(log, commands):
        yield finding(
            "attitude_unit",
            "The angles of the poses stay within 6.3 degrees: they are in rad, declared as degrees."
            " Taken for rad, commands of surge and sway push the poses ahead and aside.",
            stream="pose",
            fields=ATTITUDE,
            remedy="Set unit: rad for the columns of the angles, in a column map of this log's own"
            " where other logs are in degrees.",
        )
        return
    turn = pushed_turn(log.t_s("actuators"), commands, at, log.body_velocity()[:, :2], coupled)
    if turn is None:
        return
    angle, sd = (math.degrees(value) for value in turn)
    if abs(angle) < max(limit("pose_turned"), CLEAR * sd):
        return
    yield finding(
        "pose_turned",
        f"Commands of surge and sway both push the poses {abs(angle):.0f} +- {2.0 * sd:.0f} degrees"
        f" to the {'right' if angle > 0.0 else 'left'}: x of the markers is not ahead, or the"
        " attitude has another heading than the path"
        + (", or both commands have the wrong sign." if abs(angle) > 170.0 else "."),
        stream="pose",
        value=angle,
        remedy=(
            "Where all runs show this angle, write sensors: {pose: {mounting: {value: [0, 0,"
            f" {-angle:.0f}], unit: deg, source: commands}}}}}} into the vehicle file; where one"
            " run does, turn its poses before the export, or leave that run out."
        ),
    )


def _is_in_radians(log: CheckedLog, commands: Array) -> bool:
    """Return whether small angles of poses explain the motion if taken for radians.

    commands (n, k): those of axes.
    """
    if not log.has("attitude", "imu"):
        return False
    angles = log.values("attitude", ATTITUDE)
    if np.abs(angles).max() > CIRCLE_AS_DEGREES:
        return False
    at, sensor = log.t_s("velocity"), log.vehicle and log.vehicle.dvl
    read, meant = (
        rotation_body_to_ned(angles_at(at, log.t_s("attitude"), each))
        for each in (angles, np.degrees(angles))
    )
    body = np.einsum("nji,njk,nk->ni", meant, read, log.body_velocity())
    sensed = body @ sensor.rotation if sensor else body
    rates = np.degrees(log.values("imu", GYRO))
    other = log.with_columns("velocity", dict(zip(LINEAR_VELOCITY, sensed.T, strict=True)))
    other = other.with_columns("imu", dict(zip(GYRO, rates.T, strict=True)))
    return _unexplained(other, commands) < LESS_LEFT * _unexplained(log, commands)


def _unexplained(log: CheckedLog, commands: Array) -> float:
    """Return the share of surge and sway that commands (n, k) leave, in the mean."""
    at, velocity = log.t_s("velocity"), log.body_velocity()
    coupled = coupling(log, 0, at)
    gains = [
        response_gains(
            log.t_s("actuators"), commands, at, np.ascontiguousarray(own), coupled=coupled
        )
        for own in velocity[:, :2].T
    ]
    return float(np.mean([1.0 if item is None else 1.0 - item.explained for item in gains]))


def _answers(
    log: CheckedLog, driven: list[str], commands: Array, motions: Mapping[str, str]
) -> dict[str, list[str]]:
    """Return the axes whose commands push each axis; itself where its own push most.

    motions: column of the motion of each axis; only of axes that commands explain.
    """
    pushing = {}
    for axis in driven:
        stream = "imu" if axis == RATES[2] else "velocity"
        if axis in motions and log.has(stream):
            motion = body_motion(log, stream, motions[axis])
            pushing[axis] = _pushing(log, driven, commands, axis, stream, motion)
    return {axis: axes for axis, axes in pushing.items() if axes}


def _pushing(
    log: CheckedLog, driven: list[str], commands: Array, axis: str, stream: str, motion: Array
) -> list[str]:
    """Return axes whose commands push a motion (n,); `axis` where its own push most.

    None where they explain too little.
    """
    gains = response_gains(log.t_s("actuators"), commands, log.t_s(stream), motion)
    if gains is None or gains.explained < DRIVEN:
        return []
    number = driven.index(axis)
    sure = np.abs(gains.gain) > LEAST_GAIN_SD * gains.sd
    size = np.where(sure, np.abs(gains.gain), 0.0)
    if np.delete(size, number).max() <= limit("commands_mixed") * size[number]:
        return [axis]
    return [driven[n] for n in np.argsort(-size) if size[n] > 0.5 * size.max()]


def _level_heave(log: CheckedLog, driven: list[str], commands: Array) -> bool:
    """Return whether heave moves poses of an upright vehicle level, at any heading."""
    heave = SPEEDS[2]
    if heave not in driven or not log.has("attitude", "velocity"):
        return False
    if not log.source("velocity").startswith(OF_POSES):
        return False
    angles = log.values("attitude", ATTITUDE)
    rotation = rotation_body_to_ned(angles)
    if np.mean(rotation[:, 2, 2] < TILTED) > LEAST_TILTED:
        return False
    if np.hypot(*rotation[:, :2, 0].mean(axis=0)) > STEADY_HEADING:
        return False
    at = angles_at(log.t_s("velocity"), log.t_s("attitude"), angles)
    world = np.einsum("nij,nj->ni", rotation_body_to_ned(at), log.body_velocity())
    pushing = [
        _pushing(log, driven, commands, heave, "velocity", np.ascontiguousarray(motion)) == [heave]
        for motion in world.T
    ]
    return any(pushing[:2]) and not pushing[2]


def _turns_about_y(log: CheckedLog) -> float:
    """Return how often poses are tilted about a level y axis that keeps its direction.

    Zero where y moves: poses with y up have their heading there.
    """
    if not log.has("attitude") or not log.source("attitude").startswith(OF_POSES):
        return 0.0
    rotation = rotation_body_to_ned(log.values("attitude", ATTITUDE))
    side = np.asarray(rotation[:, :, 1].mean(axis=0))
    if np.linalg.norm(side) < STEADY_SIDE or abs(side[2]) > LEVEL_SIDE:
        return 0.0
    return float(np.mean(rotation[:, 2, 2] < TILTED))
