"""Checks of signs that change under way, as after a driver has restarted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.identification.checks.attitude.angle_turns import angle_turns
from auvid.hydro.identification.checks.motion_checks import (
    WINDOW_S,
    down_at,
    integrals,
    shared_windows,
    track_windows,
)
from auvid.hydro.identification.checks.robust_gains import FEWEST_WINDOWS
from auvid.hydro.identification.checks.sign_change import SignChange, SignTarget, sign_change
from auvid.hydro.identification.checks.velocity_answer import changes_of
from auvid.stages.columns import (
    ATTITUDE,
    GYRO,
    LINEAR_VELOCITY,
    OF_FIXES,
    OF_POSES,
    OF_YAW,
    POSITION,
    RATES,
    SPEEDS,
)
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import inertial_motion
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

SHORTEST_S = 12.0
"""Least length of either part."""
LEAST_OF_ANY, LEAST_OF_BEST = -0.8, 0.5
"""Share of the changes that mended signs explain of any comparison, where noise alone takes
off .6, and of the best one: axes that are exchanged take off 1 to 7.
"""
LEAST_BY_GYRO = 30.0
"""Logarithm of the likelihood of either part of angles that change, by the gyro alone."""
OF_AXES: tuple[tuple[int, ...], ...] = ((0,), (1,), (2,), (0, 1), (1, 2), (0, 2), (0, 1, 2))
"""Axes of one sensor that may turn together."""
OF_ANGLES: dict[tuple[int, ...], tuple[tuple[int, ...], ...]] = {
    (0,): ((-1, 1, -1), (1, 1, -1), (1, -1, 1)),
    (1,): ((1, -1, -1), (1, -1, -1), (1, 1, 1)),
    (0, 1): ((-1, -1, 1), (1, -1, 1), (1, -1, 1)),
}
"""Signs of what gyro x, y and z turn roll, pitch and yaw by, if angles have the wrong one."""


def with_one_turn(log: CheckedLog) -> tuple[CheckedLog, list[Finding]]:
    """Return the log with one sign of gyro, roll and pitch, and what changed."""
    if not log.has("imu", "attitude") or log.source("imu").startswith(OF_YAW):
        return log, []
    on_time = log.in_time()
    attitude = on_time.t_s("attitude"), on_time.values("attitude", ATTITUDE)
    t_imu = on_time.t_s("imu")
    turns = angle_turns(*attitude, t_imu, on_time.values("imu", GYRO))
    if turns is None:
        return log, []
    targets = [SignTarget(turns.at, turns.by_angle[:, k], turns.by_gyro[:, k]) for k in range(3)]
    force = on_time.accelerometer()
    by_gravity = log.info.accelerometer in (None, "specific_force")
    if force is not None and by_gravity and np.isfinite(force).all():
        down = STANDARD_GRAVITY * integrals(t_imu, down_at(t_imu, *attitude), turns.at)
        felt = -integrals(t_imu, force, turns.at)
        targets += [SignTarget(turns.at, felt[:, k], down[:, [k]]) for k in range(2)]
    count = len(targets)
    entries: list[tuple[str, tuple[str, ...], str, list[Array]]] = []
    for axes in OF_AXES:
        words = "gyro " + listed(["xyz"[axis] for axis in axes])
        if count == 3 or 2 in axes:
            words += f" (or {listed([RATES[axis] for axis in axes])} of the attitude)"
        of_gyro = [_signs(3, axes)] * 3 + [np.ones(1)] * (count - 3)
        entries.append(("imu", tuple(GYRO[axis] for axis in axes), words, of_gyro))
    if count > 3:
        for axes, by_turn in OF_ANGLES.items():
            words = f"{listed([RATES[axis] for axis in axes])} of the attitude"
            fields = tuple(ATTITUDE[axis] for axis in axes)
            of_gravity = [_signs(1, [0] if 1 - k in axes else []) for k in range(2)]
            turned = [np.array(each, dtype=np.float64) for each in by_turn]
            entries.append(("attitude", fields, words, [*turned, *of_gravity]))
    signs = [each for *_, each in entries]
    change = sign_change(targets, signs)
    if change is None or not _sure(change):
        return log, []
    stream, fields, words, turned = entries[change.choice]
    by_gyro = sign_change(targets[:3], [turned[:3]])  # gravity alone may be an acceleration
    if by_gyro is None or by_gyro.odds < LEAST_BY_GYRO or min(by_gyro.explained) < LEAST_OF_BEST:
        return log, []
    mended = _turned(log, on_time, stream, fields, change)
    return mended, [_finding(log, stream, fields, words, change)]


def with_one_velocity(log: CheckedLog) -> tuple[CheckedLog, list[Finding]]:
    """Return the log with one sign of each axis of the velocity, and what changed."""
    if not log.has("velocity", "attitude") or log.estimated("velocity"):
        return log, []
    if log.source("velocity").startswith((OF_FIXES, OF_POSES)):
        return log, []
    if not np.isfinite(log.body_velocity()).all():
        return log, []
    on_time = log.in_time()
    felt = _by_accelerometer(on_time)
    targets = [*felt, *_by_depth(on_time), *_by_track(on_time)]
    signs = [_signs(4, axes) for axes in OF_AXES]
    change = sign_change(targets, [[each] * len(targets) for each in signs])
    if change is None or not _sure(change):
        return log, []
    axes = OF_AXES[change.choice]
    own = [change.explained[axis] for axis in axes if felt] + change.explained[len(felt) :]
    if max(own) < LEAST_OF_BEST:
        return log, []  # what fits is an axis that keeps its sign
    fields = tuple(LINEAR_VELOCITY[axis] for axis in axes)
    words = f"{listed([SPEEDS[axis] for axis in axes])} of the velocity"
    mended = _turned(log, on_time, "velocity", fields, change)
    return mended, [_finding(log, "velocity", fields, words, change)]


def _signs(count: int, turned: Sequence[int]) -> Array:
    return np.where(np.isin(np.arange(count), turned), -1.0, 1.0)


def _columns(log: CheckedLog) -> list[Array]:
    """Return what each column of the velocity is in body axes (k, 3)."""
    measured = log.values("velocity", LINEAR_VELOCITY)
    rotation = np.eye(3) if log.vehicle is None else log.vehicle.dvl.rotation
    return [measured[:, [axis]] * rotation[:, axis] for axis in range(3)]


def _by_accelerometer(log: CheckedLog) -> list[SignTarget]:
    motion = inertial_motion(log)
    if motion is None:
        return []
    (t_imu, gyro, force), attitude, (t, speed) = motion.imu, motion.attitude, motion.velocity
    clocks = t_imu, attitude[0], t
    at = shared_windows(*clocks)
    if at.size < FEWEST_WINDOWS:
        return []
    pulled = integrals(t_imu, force + STANDARD_GRAVITY * down_at(t_imu, *attitude), at)
    columns = _columns(log)
    by_arm = speed - sum(columns, np.zeros(speed.shape))
    parts = np.stack([changes_of(t_imu, gyro, t, part, at) for part in (*columns, by_arm)], axis=2)
    return [SignTarget(at, pulled[:, axis], parts[:, axis]) for axis in range(3)]


def _by_depth(log: CheckedLog) -> list[SignTarget]:
    if not log.has("depth"):
        return []
    (t_depth, depth), t = log.depth_of_velocity(), log.t_s("velocity")
    attitude = log.t_s("attitude"), log.values("attitude", ATTITUDE)
    clocks = t_depth, attitude[0], t
    at = shared_windows(*clocks)
    if at.size < FEWEST_WINDOWS:
        return []
    down = down_at(t, *attitude)
    rates = np.column_stack([*((down * part).sum(axis=1) for part in _columns(log)), 0.0 * t])
    rise = np.interp(at + WINDOW_S, t_depth, depth) - np.interp(at, t_depth, depth)
    return [SignTarget(at, rise, integrals(t, rates, at))]


def _by_track(log: CheckedLog) -> list[SignTarget]:
    if not log.has("position") or log.estimated("position"):
        return []
    t_position, position, t = (
        log.t_s("position"),
        log.values("position", POSITION),
        log.t_s("velocity"),
    )
    shared = track_windows(t_position, log.t_s("attitude"), log.values("attitude", ATTITUDE), t)
    if shared is None:
        return []
    at, turn, width_s = shared
    targets = []
    for row in range(2):
        rates = [(turn[:, row] * part).sum(axis=1) for part in _columns(log)]
        parts = integrals(t, np.column_stack([*rates, 0.0 * t]), at, width_s)
        ends = [np.interp(side, t_position, position[:, row]) for side in (at, at + width_s)]
        targets.append(SignTarget(at, ends[1] - ends[0], parts))
    return targets


def _sure(change: SignChange) -> bool:
    explains = min(change.explained) > LEAST_OF_ANY and max(change.explained) > LEAST_OF_BEST
    clear = change.odds > limit("sign_changes") and explains
    return clear and change.shorter_s >= SHORTEST_S


def _turned(
    log: CheckedLog, on_time: CheckedLog, stream: str, fields: Sequence[str], change: SignChange
) -> CheckedLog:
    wrong = (on_time.t_s(stream) >= change.at_s) == change.after
    columns = {name: np.where(wrong, -1.0, 1.0) * log.column(stream, name) for name in fields}
    return log.with_columns(stream, columns)


def _finding(
    log: CheckedLog, stream: str, fields: Sequence[str], words: str, change: SignChange
) -> Finding:
    several = len(fields) > 1
    side = "from" if change.after else "until"
    return finding(
        "sign_changes",
        f"{words[0].upper()}{words[1:]} ({log.source(stream)}) ha{'ve' if several else 's'} the"
        f" wrong sign {side} {change.at_s:.0f} s of the log{' on' * change.after}, and the right"
        f" one {'before' if change.after else 'after'}.",
        stream=stream,
        value=change.odds,
        at_s=change.at_s,
        fields=fields,
    )
