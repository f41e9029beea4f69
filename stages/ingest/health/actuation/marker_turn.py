"""Poses whose x is not ahead: commands of surge and sway push them aside by one angle."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from auvid.hydro.identification.signals.pose.pushed_turn import pushed_turn
from auvid.stages.columns import OF_POSES, SPEEDS
from auvid.stages.ingest.health.actuation.push_answers import CLEAR, coupling
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit


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
    turn = pushed_turn(
        log.t_s("actuators"), commands[:, moving], at, log.body_velocity()[:, :2], coupled
    )
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
