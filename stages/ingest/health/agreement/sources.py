"""Checks of attitude, depth and velocity against other sources of the same log."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.signal_checks import (
    Following,
    attitude_difference,
    following,
    jumps,
)
from auvid.stages.columns import ATTITUDE, LINEAR_VELOCITY, OF_POSES, SPEEDS
from auvid.stages.ingest.health.finding import (
    ESTIMATED,
    CheckedLog,
    Finding,
    finding,
    how_often,
    limit,
    listed,
    mounting_remedy,
)
from auvid.stages.ingest.streams.mapping import OtherSource
from auvid.stages.number_format import significant

SMALLEST_MOVE_M_S = 0.03
FASTEST_M_S = 1.0
"""A step of the depth that is slower may be a motion."""
BAROMETER = re.compile(r"^(BARO|BAR2|BAR3|sensor_baro|vehicle_air_data|SCALED_PRESSURE)")


def attitude_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield other attitudes of the log that disagree with the one that is used."""
    if not log.has("attitude"):
        return
    used = log.source("attitude")
    off = []
    for other in _comparable(log, "attitude"):
        assert other.columns is not None
        angles = np.stack([other.columns[name] for name in ATTITUDE], axis=1)
        difference = attitude_difference(
            log.t_s("attitude"),
            log.values("attitude", ATTITUDE),
            log.seconds(other.columns["time_us"]),
            angles,
        )
        if difference is not None and math.degrees(difference.angle) > limit("attitude_disagrees"):
            off.append(
                (
                    math.degrees(difference.angle),
                    other.source,
                    math.degrees(difference.heading),
                    math.degrees(difference.tilt),
                )
            )
    if off:
        sources = [f"{name} by {angle:.0f} degrees" for angle, name, _, _ in off]
        angle, _, heading, tilt = max(off)
        where = f"heading {heading:.0f}, tilt {tilt:.0f} degrees"
        text = (
            f"Attitudes disagree: {used}, which is used, and {listed(sources)} (median; {where})."
        )
        yield finding("attitude_disagrees", text, stream="attitude", value=angle)


def _comparable(log: CheckedLog, stream: str) -> list[OtherSource]:
    used = log.source(stream)
    return [
        other
        for other in log.others
        if other.stream == stream and other.source != used and other.columns is not None
    ]


def depth_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield wrong signs of depth, a barometer in the housing, depths that disagree."""
    if not log.has("depth"):
        return
    depth, t_s = log.column("depth", "depth_m"), log.t_s("depth")
    level = float(np.median(depth))
    if level < limit("depth_above_water") and not _of_a_pose(log):
        yield finding(
            "depth_above_water", f"The median depth is {level:.2f} m.", stream="depth", value=level
        )
    least = float(depth.min())
    if least > limit("depth_zero_unseen") and _of_csv(log):
        yield finding(
            "depth_zero_unseen",
            f"Whether the depth ({log.source('depth')}) has the pressure of the air in it, 10 m of"
            f" water, is not observable: it is never less than {least:.1f} m.",
            stream="depth",
            value=least,
            fields=("depth_m",),
        )
    if any(note.startswith("depth") and ESTIMATED.search(note) for note in log.info.notes):
        text = f"Depth is taken from {log.source('depth')}, an estimate of the navigation filter."
        yield finding("depth_estimated", text, stream="depth")
    yield from _jumps(log, t_s, depth)
    yield from _other_depths(log, t_s, depth)


def _jumps(log: CheckedLog, t_s: Array, depth: Array) -> Iterator[Finding]:
    """Yield a depth that goes on at another level; poses have a check of their own."""
    at = jumps(t_s, depth, least=limit("depth_jumps"), rate=FASTEST_M_S)
    if _of_a_pose(log) or not at.size:
        return
    steps = depth[at + 1] - depth[at]
    largest = int(np.argmax(np.abs(steps)))
    yield finding(
        "depth_jumps",
        f"Depth ({log.source('depth')}) jumps {how_often(int(at.size))} and goes on at"
        f" another level, by {steps[largest]:+.2f} m at {t_s[at[largest]]:.1f} s from the start.",
        stream="depth",
        value=float(abs(steps[largest])),
        at_s=float(t_s[at[largest]]),
        fields=("depth_m",),
    )


def _of_csv(log: CheckedLog) -> bool:
    return all(str(item.format).startswith("CSV") for item in log.info.files)


def _of_a_pose(log: CheckedLog) -> bool:
    """Return whether depth is made from a pose, whose zero need not be the surface.

    A column that is mapped to depth says that it is one, whatever else it is mapped to.
    """
    return log.source("depth").startswith(OF_POSES)


def _other_depths(log: CheckedLog, t_s: Array, depth: Array) -> Iterator[Finding]:
    used, moved = log.source("depth"), _spread(depth)
    others = _comparable(log, "depth")
    for other in others:
        assert other.columns is not None
        values, at = other.columns["depth_m"], log.seconds(other.columns["time_us"])
        relation = following(t_s, depth, at, values)
        if relation is None:
            continue
        own = _spread(values)
        pressures = BAROMETER.match(other.source) and (BAROMETER.match(used) or used == "CTUN")
        if pressures and log.under_water is not False and _in_housing(relation, own, moved):
            named = log.vehicle is not None and log.vehicle.barometer_instance is not None
            reason = _choice(named, any(item.source == "CTUN" for item in others))
            text = (
                f"{other.source} reads {_range(values)} while {used} reads {_range(depth)}: it sits"
                f" in the housing. {used} is used{reason}."
            )
            yield finding("housing_barometer", text, stream="depth", value=own)
        elif (
            moved > limit("housing_barometer")
            and relation.correlation > 0.9
            and _wrong_unit(relation.scale)
        ):
            text = (
                f"{other.source} moves {significant(relation.scale)} times as much as {used}: the"
                " log declares a wrong unit for it."
            )
            yield finding("depth_unit", text, stream="depth", value=relation.scale)
        elif moved > limit("housing_barometer") and (
            abs(relation.scale - 1.0) > limit("depth_disagrees") or relation.correlation < 0.5
        ):
            text = (
                f"{other.source} moves {significant(relation.scale)} times as much as {used}"
                f" (correlation {relation.correlation:.2f})."
            )
            yield finding("depth_disagrees", text, stream="depth", value=abs(relation.scale - 1.0))


def _range(values: Array) -> str:
    # Adding zero keeps a rounded -0.004 from being shown as -0.00.
    low, high = (round(float(value), 2) + 0.0 for value in (np.min(values), np.max(values)))
    return f"{low:.2f} to {high:.2f} m"


def _in_housing(relation: Following, own: float, moved: float) -> bool:
    """Return whether a second barometer moves on its own.

    It does if it moves much more than a depth that hardly moves, or unlike one that
    does.
    """
    if moved < limit("housing_barometer"):
        return own > moved + limit("housing_barometer")
    return abs(relation.scale - 1.0) > 0.5 or relation.correlation < 0.5


def _wrong_unit(scale: float) -> bool:
    return any(
        abs(scale / factor - 1.0) < 0.1 for factor in (0.001, 0.01, 0.1, 10.0, 100.0, 1000.0)
    )


def _choice(named: bool, controller: bool) -> str:
    if named:
        return ", because the vehicle file names it"
    return (
        ", because it agrees with the vehicle's own depth (CTUN)"
        if controller
        else ", because it saw the larger pressures"
    )


def _spread(values: Array) -> float:
    low, high = np.percentile(values, (5.0, 95.0))
    return float(high - low)


def velocity_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield velocities that are unaided or estimates, or that contradict each other."""
    refused = [
        other for other in log.others if other.stream == "velocity" and other.refused is not None
    ]
    unaided = [other for other in refused if "navigation filter" in str(other.refused)]
    if unaided:
        text = (
            f"The velocity of {listed([item.source for item in unaided])} is not offered:"
            f" {unaided[0].refused}."
        )
        yield finding("unaided_velocity", text, stream="velocity")
    if log.has("velocity") and any(
        note.startswith("velocity") and ESTIMATED.search(note) for note in log.info.notes
    ):
        text = f"Velocity is the estimate of the navigation filter ({log.source('velocity')})."
        yield finding("estimated_velocity", text, stream="velocity")
    if log.has("velocity"):
        yield from _other_velocities(log)


def _other_velocities(log: CheckedLog) -> Iterator[Finding]:
    used, t_s, own = (
        log.source("velocity"),
        log.t_s("velocity"),
        log.values("velocity", LINEAR_VELOCITY),
    )
    for other in _comparable(log, "velocity"):
        assert other.columns is not None
        at = log.seconds(other.columns["time_us"])
        against = []
        for axis, name in enumerate(LINEAR_VELOCITY):
            values = other.columns[name]
            if min(_spread(own[:, axis]), _spread(values)) < SMALLEST_MOVE_M_S:
                continue
            relation = following(t_s, own[:, axis], at, values)
            if relation is not None and relation.correlation < limit("velocity_disagrees"):
                against.append((relation.correlation, SPEEDS[axis]))
        if against:
            text = (
                f"{other.source} moves against {used} in {listed([name for _, name in against])}"
                f" (correlation {min(against)[0]:.2f})."
            )
            yield finding(
                "velocity_disagrees",
                text,
                stream="velocity",
                value=min(against)[0],
                remedy=f"{mounting_remedy(log)}, or choose a source in the manifest.",
            )
