"""A log in the pieces that legs are proposed from: motion, and what no leg may have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from auvid.hydro.arrays import Array, Mask, runs_of
from auvid.hydro.identification.checks.attitude.rate_agreement import attitude_jumps
from auvid.hydro.identification.selection.leg_proposal import DivePieces, dive_pieces
from auvid.stages.columns import ATTITUDE, GYRO
from auvid.stages.ingest.health.actuation.motions import motions
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.finding import CheckedLog
from auvid.stages.ingest.health.unusable_spans import unusable_spans
from auvid.stages.ingest.health.usability import COVERING
from auvid.stages.leg_streams import disarmed_between

SUBMERGED_M, DIVED_M = 0.2, 1.0
"""At less depth a vehicle of a log that dives deeper than DIVED_M is at the surface."""
JUMP_M, JUMP_M_S = 0.3, 5.0
"""Beyond what this speed explains, a step of the position by so much is a jump."""
NEAR_JUMP_S = 1.0


def pieces_of(
    log: CheckedLog, streams: Sequence[str] = COVERING, *, max_gap_s: float = 1.0
) -> DivePieces:
    """Return a log in pieces; `streams` are those that its legs need without a gap."""
    moving = activity(log) if log.has("actuators") else None
    return dive_pieces(
        (int(log.info.end_us) - int(log.info.start_us)) / 1e6,
        {axis: (at, values) for axis, (at, values, _) in _motions(log).items()},
        clocks=[log.t_s(name) for name in streams if log.has(name)],
        excluded=[span for _, span in excluded_spans(log)],
        driven=None if moving is None else (log.t_s("actuators"), moving),
        max_gap_s=max_gap_s,
    )


def _motions(log: CheckedLog) -> dict[str, tuple[Array, Array, str]]:
    """Return the motions of a log; yaw of the heading where no gyro shows it."""
    by_axis = motions(log)
    if "r" not in by_axis and log.has("attitude"):
        t_s, heading = log.t_s("attitude"), np.unwrap(log.column("attitude", "psi_rad"))
        if t_s.size > 2:
            by_axis["r"] = (t_s, np.gradient(heading, t_s), log.source("attitude"))
    return by_axis


def excluded_spans(log: CheckedLog) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield what no leg may have, in words and as from and to [s]."""
    for name, spans in unusable_spans(log).items():
        yield from ((name.replace("_", " "), span) for span in spans)
    yield from (("disarmed", span) for span in disarmed_spans(log))
    if log.has("depth"):
        t_s, depth = log.t_s("depth"), log.column("depth", "depth_m")
        if depth.size and float(np.nanmax(depth)) > DIVED_M:
            yield from (("at the surface", span) for span in _spans(t_s, depth < SUBMERGED_M))
    if log.has("attitude", "imu"):
        begins, ends, _ = attitude_jumps(
            log.t_s("attitude"),
            log.values("attitude", ATTITUDE),
            log.t_s("imu"),
            log.values("imu", GYRO),
        )
        for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
            yield "attitude jumps", (begin - NEAR_JUMP_S, end + NEAR_JUMP_S)
    if log.has("position"):
        t_s, place = log.t_s("position"), log.values("position", ("x_m", "y_m", "z_m"))
        steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
        for at in np.flatnonzero(steps > JUMP_M + JUMP_M_S * np.diff(t_s)).tolist():
            yield "position jumps", (float(t_s[at]) - NEAR_JUMP_S, float(t_s[at + 1]) + NEAR_JUMP_S)


def disarmed_spans(log: CheckedLog) -> list[tuple[float, float]]:
    """Return the spans [s] in which the log says that the vehicle is disarmed."""
    end_s = (int(log.info.end_us) - int(log.info.start_us)) / 1e6
    return disarmed_between(log.tables.get("mode"), int(log.info.start_us), end_s)


def _spans(t_s: Array, mask: Mask) -> list[tuple[float, float]]:
    return [(float(t_s[a]), float(t_s[b - 1])) for a, b in runs_of(mask)]


def modes_between(log: CheckedLog, start_s: float, end_s: float) -> list[str]:
    """Return the modes that the log names between two times [s], in their order."""
    if not log.has("mode"):
        return []
    at, names = log.t_s("mode"), [str(name) for name in log.tables["mode"]["mode"].to_pylist()]
    stops = [*at[1:].tolist(), np.inf]
    return list(
        dict.fromkeys(
            name
            for begin, stop, name in zip(at.tolist(), stops, names, strict=True)
            if begin < end_s and stop > start_s
        )
    )
