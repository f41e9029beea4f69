"""Checks of poses: jumps, freezes, outliers, units, handedness, wraps."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from auvid.hydro.identification.signals.pose.pose_checks import (
    averaged_across_wrap,
    handedness,
)
from auvid.hydro.identification.signals.pose.track import PoseFault
from auvid.stages.columns import ATTITUDE, POSITION
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.finding import CheckedLog, Finding, counted, finding, limit, listed

NAMED = 4
FASTER_THAN = 80.0
"""Percentile of the speeds: outliers are no fifth of them, and pauses no four fifths."""
SLOWEST_M_S, USUAL_M_S = 0.05, 0.4
"""Speed [m/s] below which poses of a vehicle that commands drive are in another unit; and a
usual one, of what is .2 to .6 in sound tanks.
"""
FACTORS = {
    1e-3: "unit: mm, where it has m",
    1e-2: "unit: cm, where it has m",
    1e-1: "unit: mm, where it has cm",
    1e1: "unit: cm, where it has mm",
    1e2: "unit: m, where it has cm",
    1e3: "unit: m, where it has mm",
}
LEAST_ADVANTAGE = 0.2
SMALLEST_JUMP_RAD = math.radians(1.0)
LEAST_EXPLAINED = 0.3


def pose_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield what is wrong with the poses of a log."""
    if not log.has("pose"):
        return
    yield from _units(log)
    track = log.track
    if track is None:
        return
    begin = float(log.t_s("pose")[0])
    yield from _faults(track.faults, begin)
    share = track.outliers_s.size / max(track.t_s.size, 1)
    if share > limit("pose_outliers"):
        yield finding(
            "pose_outliers",
            f"{track.outliers_s.size} of {track.t_s.size} poses fit no motion and are left out,"
            f" the first at {begin + float(track.outliers_s[0]):.1f} s.",
            stream="pose",
            value=share,
            at_s=begin + float(track.outliers_s[0]),
        )
    yield from _mirrored(log, begin)


def _faults(faults: tuple[PoseFault, ...], begin: float) -> Iterator[Finding]:
    jumps = [
        item
        for item in faults
        if item.kind == "jump"
        and (item.moved_m > limit("pose_jump") or item.turned_rad > SMALLEST_JUMP_RAD)
    ]
    if jumps:
        places = [
            f"at {begin + item.end_s:.1f} s by {item.moved_m:.2g} m and"
            f" {math.degrees(item.turned_rad):.0f} degrees"
            for item in jumps[:NAMED]
        ]
        more = f" and {len(jumps) - NAMED} more" if len(jumps) > NAMED else ""
        yield finding(
            "pose_jump",
            f"The pose jumps {listed(places)}{more}; 0.6 s on either side are left out.",
            stream="pose",
            value=max(item.moved_m for item in jumps),
            at_s=begin + jumps[0].end_s,
        )
    for kind, words in (("freeze", "stands still to the last digit"), ("lost", "fits no motion")):
        spans = [item for item in faults if item.kind == kind]
        if spans:
            places = [
                f"from {begin + item.start_s:.1f} to {begin + item.end_s:.1f} s"
                for item in spans[:NAMED]
            ]
            more = f" and {len(spans) - NAMED} times more" if len(spans) > NAMED else ""
            yield finding(
                "pose_freeze" if kind == "freeze" else "pose_lost",
                f"The pose {words} {listed(places)}{more}.",
                stream="pose",
                value=max(item.end_s - item.start_s for item in spans),
                at_s=begin + spans[0].start_s,
            )


def _units(log: CheckedLog) -> Iterator[Finding]:
    """Yield positions in mm and angles in degrees, by the speeds they would mean."""
    t, place = log.t_s("pose"), log.values("pose", POSITION)
    angles = log.values("pose", ATTITUDE)
    if t.size < NAMED:
        return
    step = max(1, int(np.ceil(0.2 / max(float(np.median(np.diff(t))), 1e-6))))
    dt = t[step:] - t[:-step]
    speeds = np.linalg.norm(place[step:] - place[:-step], axis=1) / dt
    speed = float(np.nanpercentile(speeds, FASTER_THAN))
    if speed > limit("pose_unit") or (0.0 < speed < SLOWEST_M_S and _commanded(log)):
        factor = min(FACTORS, key=lambda each: abs(math.log(each * speed / USUAL_M_S)))
        words = "faster than vehicles do" if factor < 1.0 else "though commands drive them"
        yield finding(
            "pose_unit",
            f"The poses move at {speed:.2g} m/s (one step in five is faster), {words}: the position"
            f" is in another unit. {factor:g} times that, {factor * speed:.2g} m/s, is usual.",
            stream="pose",
            value=speed,
            fields=POSITION,
            remedy=""
            if factor == 1e-3
            else (
                "Set the unit of the columns of the position in this log's column map"
                f" ({FACTORS[factor]}), or accept it where something holds the vehicle."
            ),
        )
    step = max(1, step // 2)
    turn = (angles[step:] - angles[:-step] + np.pi) % (2.0 * np.pi) - np.pi
    rate = float(np.percentile(np.abs(turn) / (t[step:] - t[:-step])[:, None], 90.0))
    if rate > limit("pose_angle_unit"):
        yield finding(
            "pose_angle_unit",
            f"The poses turn at {rate:.3g} rad/s (one in ten turns faster): the angles are no"
            " radians.",
            stream="pose",
            value=rate,
            fields=ATTITUDE,
        )


def _commanded(log: CheckedLog) -> bool:
    """Return whether commands of axes act in a tenth of the samples or more."""
    if not log.has("actuators") or not log.commands():
        return False
    moving = activity(log)
    return moving is not None and float(np.mean(moving)) > limit("little_actuation")


def _mirrored(log: CheckedLog, begin: float) -> Iterator[Finding]:
    assert log.track is not None
    track, t_commands, commands = log.track, np.zeros(0), None
    if log.has("actuators"):
        names = [*log.commands(), *log.thrusters()]
        values = log.values("actuators", names) if names else np.zeros((0, 0))
        moving = [column for column in range(len(names)) if np.ptp(values[:, column]) > 0.0]
        if moving and np.isfinite(values[:, moving]).all():
            t_commands, commands = log.t_s("actuators") - begin, values[:, moving]
    agreement = handedness(
        track.t_s,
        track.position,
        track.attitude[:, 2],
        t_commands=t_commands,
        commands=commands,
    )
    if agreement is None or agreement.mirrored < max(
        agreement.as_is + LEAST_ADVANTAGE, LEAST_EXPLAINED
    ):
        return
    how = (
        f"commands explain {agreement.as_is:.0%} of surge and sway, with yaw the other way round"
        f" {agreement.mirrored:.0%}"
        if agreement.by_commands
        else f"motion keeps to one direction of the body by {agreement.as_is:.2f}, with yaw the"
        f" other way round by {agreement.mirrored:.2f}"
    )
    yield finding(
        "pose_handedness",
        f"The path turns against the heading: {how}.",
        stream="pose",
        value=agreement.mirrored - agreement.as_is,
        fields=(POSITION[1], ATTITUDE[2]),
    )


def wrap_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield yaw that was averaged across its wrap, of attitude or pose.

    One column may be mapped to both.
    """
    for stream in ("attitude", "pose"):
        if not log.has(stream) or (stream == "attitude" and log.source(stream).startswith("pose")):
            continue
        rows = averaged_across_wrap(log.column(stream, ATTITUDE[2]))
        if rows.size:
            first = float(log.t_s(stream)[rows[0]])
            yield finding(
                "yaw_across_wrap",
                f"{counted(int(rows.size), 'yaw')} {'is a mean' if rows.size == 1 else 'are means'}"
                f" across the wrap, half a turn off, the first at {first:.1f} s.",
                stream=stream,
                value=float(rows.size),
                at_s=first,
                fields=(ATTITUDE[2],),
            )
            return
