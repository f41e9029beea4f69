"""Commands of axes that push other axes as much as their own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.hydro.identification.checks.motion_checks import response_gains
from auvid.stages.columns import GYRO, LINEAR_VELOCITY, RATES, SPEEDS
from auvid.stages.ingest.health.actuation.push_answers import DRIVEN, body_motion
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

LEAST_GAIN_SD, MIXED_AXES = 6.0, 2
"""A push of a command counts from so many standard deviations on; a thing of two axes."""


def mixed_commands(log: CheckedLog) -> Iterator[Finding]:
    """Yield axes that the commands of others push as much as their own do."""
    names = log.commands()
    if not log.has("actuators") or len(names) < MIXED_AXES:
        return
    t_s, commands = log.t_s("actuators"), np.nan_to_num(log.values("actuators", names))
    moving = np.ptp(commands, axis=0) > 0.0
    commands = commands[:, moving]  # gains are per unit: a coupled hull is no mixed command
    driven = [
        name.removeprefix("command_") for name, moves in zip(names, moving, strict=True) if moves
    ]
    if len(driven) < MIXED_AXES:
        return
    columns = dict(zip((*SPEEDS, RATES[2]), (*LINEAR_VELOCITY, GYRO[2]), strict=True))
    words = []
    for number, axis in enumerate(driven):
        stream = "imu" if axis == RATES[2] else "velocity"
        if axis not in columns or not log.has(stream):
            continue
        gains = response_gains(
            t_s, commands, log.t_s(stream), body_motion(log, stream, columns[axis])
        )
        if gains is None or gains.explained < DRIVEN:
            continue
        sure = np.abs(gains.gain) > LEAST_GAIN_SD * gains.sd
        size = np.where(sure, np.abs(gains.gain), 0.0)
        others = np.delete(size, number)
        if others.max() > limit("commands_mixed") * size[number]:
            pushing = [driven[n] for n in np.argsort(-size) if size[n] > 0.5 * size.max()]
            words.append(f"{axis} the commands of {listed(pushing)}")
    if len(words) >= MIXED_AXES:
        yield finding(
            "commands_mixed",
            f"Axes answer commands of other axes: {'; '.join(words)}.",
            stream="actuators",
            value=float(len(words)),
        )
