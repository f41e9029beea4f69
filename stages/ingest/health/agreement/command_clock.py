"""Clock of normalised commands against poses, or against velocities that are logged."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.pose.pose_checks import command_clock
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS, motions
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed

LEAST_CORRELATION = 0.5
LEAST_OVERLAP = 0.6
"""Part of the time in common that has to be left behind an offset: any two ramps look alike
over a few seconds (16 of 102 s of a descent, correlation .92, gave 86 s).
"""
SHORTEST_HALF_S, CLEAR_CORRELATION = 30.0, 0.7
LEAST_DRIFT_S, CLEAR_SD = 0.3, 4.0
"""Change of an offset from half to half of a log that is a drift; both, and an offset, are
so many standard deviations at least.
"""
AXES = {"surge": "u", "sway": "v", "heave": "w", "roll": "p", "pitch": "q", "yaw": "r"}

TURNED_BY_UP = "vwqr"
"""Motions of the body whose sign is turned where z is up."""
CLEARLY_BETTER = 0.2


def answers_upward(log: CheckedLog) -> bool:
    """Tell whether poses answer the commands clearly better with z up, on any clock."""
    names = [name.removeprefix("command_") for name in log.commands()]
    axes = [AXES[name] for name in names if name in AXES]
    if not log.has("pose") or sum(axis in TURNED_BY_UP for axis in axes) < 2:
        return False
    axes, t_s, motion = _motion(log, axes)
    if not axes:
        return False
    of_axis = {axis: f"command_{name}" for name, axis in AXES.items()}
    commands = log.values("actuators", [of_axis[axis] for axis in axes])
    at = log.t_s("actuators")
    signs = np.array([-1.0 if axis in TURNED_BY_UP else 1.0 for axis in axes])
    as_is, upward = (
        0.0 if offset is None else offset.correlation
        for offset in (
            command_clock(t_s, turned, at, commands) for turned in (motion, motion * signs)
        )
    )
    return upward >= LEAST_CORRELATION and upward > as_is + CLEARLY_BETTER


def command_clock_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield an offset between the clocks of commands and of the motion."""
    names = [name.removeprefix("command_") for name in log.commands()]
    axes, t_s, motion = _motion(log, [AXES[name] for name in names if name in AXES])
    if not axes:
        return
    of_axis = {axis: f"command_{name}" for name, axis in AXES.items()}
    commands = log.values("actuators", [of_axis[axis] for axis in axes])
    at = log.t_s("actuators")
    drift = list(_drift(t_s, motion, at, commands))
    yield from drift
    offset = None if drift else command_clock(t_s, motion, at, commands)
    if offset is None or offset.correlation < LEAST_CORRELATION:
        return
    if offset.overlap_s < LEAST_OVERLAP * (min(t_s[-1], at[-1]) - max(t_s[0], at[0])):
        return
    if abs(offset.offset_s) > max(limit("pose_clock"), CLEAR_SD * offset.std_s):
        yield finding(
            "pose_clock",
            f"{listed([MOTION_WORDS[axis].capitalize() for axis in axes])} answer the"
            f" commands {offset.offset_s:+.2f} +- {offset.std_s:.2f} s off (correlation"
            f" {offset.correlation:.2f} over {offset.overlap_s:.0f} s): two clocks.",
            stream="actuators",
            value=offset.offset_s,
            remedy=(
                "Give the commands a column map of their own with time: {..., shift_s:"
                f" {offset.offset_s:.2f}}} (the same file twice under files: of the log, once for"
                f" the {'poses' if log.track is not None else 'motion'}), or shift them before the"
                " export."
            ),
        )


def _motion(log: CheckedLog, driven: Sequence[str]) -> tuple[list[str], Array, Array]:
    """Return those axes that are measured, times (n,) [s] and their motion (n, k).

    Of a log without poses the times are those of its slowest sensor of motion.
    """
    if log.track is not None:
        begin = float(log.t_s("pose")[0])
        motion = np.hstack([log.track.velocity, log.track.rate])
        return list(driven), log.track.t_s + begin, motion[:, ["uvwpqr".index(a) for a in driven]]
    measured = motions(log) if driven else {}
    records = {axis: measured[axis] for axis in driven if axis in measured}
    if not records:
        return [], np.zeros(0), np.zeros((0, 0))
    first = max(at[0] for at, _, _ in records.values())
    last = min(at[-1] for at, _, _ in records.values())
    slowest = min((at for at, _, _ in records.values()), key=len)
    t_s = slowest[(slowest >= first) & (slowest <= last)]
    values = [np.interp(t_s, at, values) for at, values, _ in records.values()]
    return list(records), t_s, np.column_stack(values)


def _drift(t_s: Array, motion: Array, at: Array, commands: Array) -> Iterator[Finding]:
    """Yield an offset of commands and poses that changes in a log."""
    start, end = max(t_s[0], at[0]), min(t_s[-1], at[-1])
    if end - start < 2.0 * SHORTEST_HALF_S:
        return
    middle = 0.5 * (start + end)
    first, last = (
        command_clock(t_s[own], motion[own], at[others], commands[others])
        for own, others in ((t_s < middle, at < middle), (t_s >= middle, at >= middle))
    )
    if first is None or last is None:
        return
    if min(first.correlation, last.correlation) < CLEAR_CORRELATION:
        return
    change, sd = last.offset_s - first.offset_s, math.hypot(first.std_s, last.std_s)
    if abs(change) < max(LEAST_DRIFT_S, CLEAR_SD * sd):
        return
    rate = change / (middle - start)
    yield finding(
        "pose_clock",
        f"The motion answers the commands {first.offset_s:+.2f} s off in the first half and"
        f" {last.offset_s:+.2f} s in the second (+- {sd:.2f} s): two clocks, one of which drifts by"
        f" {100.0 * abs(rate):.2g} %.",
        stream="actuators",
        value=change,
        remedy=(
            f"Multiply the times of the commands by {1.0 + rate:.4f} before the export, or log"
            " both with one clock."
        ),
    )
