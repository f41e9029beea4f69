"""Why the record of a leg feeds no fit of an axis, or which axes it feeds."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from auvid.data_schemas.records.logs import LogInfo
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.identification.regression.excitation import THRESHOLDS
from auvid.stages.leg_record.record import (
    NOT_COMMANDED,
    NOT_MEASURED,
    SURFACE_M,
    WORDS,
    RecordedLeg,
)
from auvid.stages.leg_streams import Streams, never_armed

LEAST_WINDOWS_S = 20.0
"""Two windows: one to fit, one to judge."""
SHORTEST_DRIVEN_S = 20.0
HAND_RAD_S = 0.3
"""RMS of turning beyond that of an idle vehicle in waves."""


def fed_axes(result: RecordedLeg) -> tuple[str, ...]:
    """Return the axes (X .. N) with windows enough in which they move."""
    return tuple(
        axis
        for axis in result.record.windows
        if result.length_s(axis) >= LEAST_WINDOWS_S and moves(result, axis)
    )


def moves(result: RecordedLeg, axis: str) -> bool:
    """Return whether the RMS of an axis in its windows reaches what sensors tell."""
    values = np.concatenate(
        [result.speed[axis][first:last] for first, last in result.record.windows[axis]]
    )
    limit = THRESHOLDS[VELOCITIES[AXES.index(axis)]]
    return bool(np.sqrt(np.nanmean(values**2)) >= limit)


def refusal(result: RecordedLeg, streams: Streams, info: LogInfo) -> str:
    """Return in one line why no axis can be fitted; '' where one can.

    The first cause counts: what was never driven need not be judged by its depth.
    """
    if fed_axes(result):
        return ""
    record, drive = result.record, result.drive
    turning = np.stack([record.rate[axis] for axis in "pqr"])
    by_hand = np.isfinite(turning).any() and np.nanmean(np.nansum(turning**2, 0)) > HAND_RAD_S**2
    turns = ", and it turns all the same: moved by hand" if by_hand else ""
    if never_armed(streams.tables.get("mode")):
        return f"never armed{turns}"
    driven_s = float(np.count_nonzero(drive.acting)) / result.rate_hz
    if driven_s == 0.0:
        loop = ", or by a controller whose outputs are not these" if by_hand else ""
        return f"thrusters idle: no output or command leaves neutral{turns}{loop}"
    if driven_s < SHORTEST_DRIVEN_S:
        return f"too short: outputs act for {driven_s:.1f} s, {SHORTEST_DRIVEN_S:g} s are needed"
    judged = [axis for axis in AXES if axis in record.measured_by]
    commanded = [
        axis
        for axis in judged
        if not any(item.axis == axis and item.reason == NOT_COMMANDED for item in record.left_out)
    ]
    if not judged:
        return "nothing measures how it moves: a gyro, a depth or a velocity is needed"
    if not commanded:
        driven = ", ".join(WORDS[axis] for axis in drive.axes) or "none"
        return (
            f"commands never leave neutral in {', '.join(WORDS[axis] for axis in judged)}, which"
            f" are measured (the log has commands of {driven})"
        )
    lost: dict[str, float] = defaultdict(float)
    for item in record.left_out:
        if item.axis in commanded and item.reason not in (NOT_MEASURED, NOT_COMMANDED):
            lost[item.reason] += item.end_s - item.start_s
    enough = [axis for axis in commanded if result.length_s(axis) >= LEAST_WINDOWS_S]
    if enough:
        names = ", ".join(WORDS[axis] for axis in enough)
        return f"hardly any motion in {names} while driven and submerged"
    cause = max(lost, key=lambda reason: lost[reason]) if lost else "too short"
    if cause == "at the surface" and record.depth_m is not None:
        deepest, least = float(np.nanmax(record.depth_m)), SURFACE_M["N"]
        if deepest < least:
            return f"at the surface: {deepest:.2f} m at its deepest, {least:g} m are needed"
        longest = max(result.length_s(axis) for axis in commanded)
        return (
            f"at the surface for {lost[cause] / len(commanded):.0f} s: windows of {longest:.0f} s"
            f" below {least:g} m, {LEAST_WINDOWS_S:g} s are needed"
        )
    longest = max(result.length_s(axis) for axis in commanded)
    return (
        f"too short: windows of {longest:.0f} s in all, {LEAST_WINDOWS_S:g} s are needed (most is"
        f" lost to: {cause})"
    )
