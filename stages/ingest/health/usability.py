"""Uses of a log: excitation per axis, and which stages can run on it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from auvid.data_schemas.checks import checks
from auvid.hydro.identification.regression.excitation import THRESHOLDS, velocity_excitation
from auvid.hydro.identification.signals.resampling import gaps
from auvid.stages.base import Document
from auvid.stages.columns import FINS, OF_POSES
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS, motions
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit, listed
from auvid.stages.ingest.health.unusable_spans import unusable_spans
from auvid.stages.number_format import significant
from auvid.stages.presentation import degrees

UNITS = {"u": "m/s", "v": "m/s", "w": "m/s", "p": "rad/s", "q": "rad/s", "r": "rad/s"}
SHORTEST_DRIVEN_S = 20.0
"""A small vehicle needs one to three seconds to answer a command; ten answers are the
least that tell drag from inertia.
"""
SHORTEST_S = 5.0
"""The default of stages.resample.min_segment_s."""
FEWEST = 5
NO_STATE, NO_FORCE = "no fused state", "no residual force"
IDLE = "no actuator acts"
PASSIVE = "the vehicle file names no actuator"
PASSIVE_KIND, SHOW_A_BODY = "passive", ("velocity", "attitude", "imu", "depth", "position", "tow")
"""Stage of bodies that nothing on board drives, and the streams of which it takes one."""
CAVEATS = {
    "low_actuator_rate": "commands are recorded too slowly",
    "estimated_velocity": "velocity is the estimate of the navigation filter",
    "simulated": "the log is simulated",
    "gyro_sign": "the gyro turns against the attitude",
    "gyro_axes": "axes of the gyro are exchanged",
    "gyro_scale": "gyro and attitude differ in scale",
    "accelerometer_unit": "the accelerometer has another unit",
    "accelerometer_convention": "the accelerometer does not measure what is declared",
    "accelerometer_direction": "the accelerometer contradicts the attitude",
    "depth_sign": "depth and vertical velocity contradict each other",
    "velocity_disagrees": "two velocities contradict each other",
    "constant_signal": "a sensor is dead",
}
GLIDE = "glide"
GLIDER_FIELDS = {
    "pressure_pa": "pressure",
    "pitch_rad": "pitch",
    "buoyancy_drive_m3": "buoyancy drive",
    "density_kg_m3": "density",
}
"""What stage glide needs of a log, with its words."""
SPEED_AXES = ("u", "v", "w")
POSE_UNIT = (
    "If it did move, the unit of the position may be wrong: cm taken for mm makes all speeds a"
    " tenth, m a thousandth. Then set unit: cm (or m) at x_m, y_m and z_m in the column map; else"
    " add legs that move in this axis."
)
"""Remedy where velocities are those of poses."""
COVERING = ("attitude", "imu", "depth", "velocity", "actuators")


def excitation(
    log: CheckedLog, window: tuple[float, float] = (-np.inf, np.inf)
) -> dict[str, dict[str, Any]]:
    """Return the motion per axis u v w p q r; null where nothing measures an axis.

    `window` is in seconds from the start of the log. Without a velocity sensor heave is
    the rate of depth, which is the body's w only while it is level.
    """
    by_axis = motions(log)
    result = {}
    for axis in MOTION_WORDS:
        empty = {"rms": None, "low": None, "high": None, "share_beyond": None}
        about = {"threshold": THRESHOLDS[axis], "unit": UNITS[axis]}
        at, values, source = by_axis.get(axis, (np.zeros(0), np.zeros(0), "not measured"))
        values = values[(at >= window[0]) & (at <= window[1]) & np.isfinite(values)]
        if not values.size:
            result[axis] = {**empty, **about, "source": source, "excited": False}
            continue
        item = velocity_excitation(axis, values, THRESHOLDS[axis])
        measured = {
            "rms": item.rms,
            "low": item.low,
            "high": item.high,
            "share_beyond": item.share_beyond,
        }
        result[axis] = {**measured, **about, "source": source, "excited": item.excited}
    return result


def excitation_findings(excited: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """Yield axes that are measured and hardly move."""
    still = [
        (axis, item)
        for axis, item in excited.items()
        if item["rms"] is not None and not item["excited"]
    ]
    if still:
        parts = [
            f"{MOTION_WORDS[axis]} {significant(factor * item['rms'], 2)} {unit}"
            for axis, item in still
            for factor, unit in [degrees(item["unit"])]
        ]
        least = limit("not_excited")
        factor, unit = degrees("rad/s")
        text = (
            f"Hardly any motion in {listed(parts)} (RMS; threshold {least:g} m/s,"
            f" {factor * least:.1f} {unit})."
        )
        of_poses = any(
            axis in SPEED_AXES and str(item["source"]).startswith(OF_POSES) for axis, item in still
        )
        largest = max(float(item["rms"]) for _, item in still)
        yield finding("not_excited", text, value=largest, remedy=POSE_UNIT if of_poses else "")


def capabilities(log: CheckedLog, excited: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return which stages can run on the log, and why not: {name, possible, reason}."""
    resample = _resample(log)
    dead = log.has("imu") and not set(motions(log)) & set("pqr")
    kinematic = resample or _without(log, "velocity") or ("no live gyro" if dead else None)
    accelerometer = None if log.accelerometer() is not None else "no accelerometer"
    integrating = kinematic or _without(log, "imu") or accelerometer
    residual = _forces(log) or (NO_STATE if kinematic else None)
    rows = [
        ("resample", resample, "attitude and depth"),
        ("fuse (kinematic)", kinematic, "velocity, depth, and the gyro or attitude"),
        (
            "fuse (thesis)",
            integrating,
            "accelerometer, its bias found against the velocity; drifts on slow vehicles",
        ),
        (
            "fuse (smoother)",
            integrating,
            "accelerometer, velocity, gyro and depth, each at its own times",
        ),
        ("residual", residual, "commands to forces through the vehicle file"),
    ]
    short = (
        None
        if residual is not None or driven_s(log) >= SHORTEST_DRIVEN_S
        else f"outputs act for {driven_s(log):.1f} s only"
    )
    for axis, name in MOTION_WORDS.items():
        item = excited[axis]
        motion = short
        if item["rms"] is None:
            motion = "not measured"
        elif not item["excited"]:
            motion = "hardly any motion"
        reason = "" if item["rms"] is None else f"RMS {significant(item['rms'])} {item['unit']}"
        rows.append((f"synthesise {name}", (residual and NO_FORCE) or motion, reason))
    if log.has("tow") or residual == PASSIVE:
        moves = None if any(map(log.has, SHOW_A_BODY)) else "nothing measures how it moves"
        rows.append((PASSIVE_KIND, moves, "tows, coasts, decays and drifts"))
    if log.has("glider"):
        rows.append((GLIDE, glider_lacks(log), "drag, lift and trim from settled glides"))
    return [{"name": name, "possible": why is None, "reason": why or on} for name, why, on in rows]


def glider_lacks(log: CheckedLog) -> str | None:
    """Return what a log lacks for stage glide, None for nothing."""
    has = [name for name in GLIDER_FIELDS if name in log.tables["glider"].column_names]
    lacking = [
        words
        for name, words in GLIDER_FIELDS.items()
        if name not in has and not (name == "pitch_rad" and log.has("attitude"))
    ]
    return f"no {listed(lacking)}" if lacking else None


def driven_s(log: CheckedLog) -> float:
    """Return for how long outputs act [s]; the whole log if that is unknown."""
    moving = activity(log) if log.has("actuators") else None
    if moving is None:
        return (int(log.info.end_us) - int(log.info.start_us)) / 1e6
    steps = np.minimum(np.diff(log.t_s("actuators"), append=log.t_s("actuators")[-1]), limit("gap"))
    return float(np.sum(steps[moving]))


def verdict(uses: Sequence[Mapping[str, Any]], findings: Sequence[Finding]) -> str:
    """Return one sentence on what a log can be used for."""
    possible = {item["name"]: item["possible"] for item in uses}
    reasons = {item["name"]: item["reason"] for item in uses}
    axes = [
        name.removeprefix("synthesise ")
        for name in possible
        if name.startswith("synthesise ") and possible[name]
    ]
    if axes:
        caveats = list(
            dict.fromkeys(CAVEATS[item["id"]] for item in findings if item["id"] in CAVEATS)
        )
        return (
            "A force model can be fitted in"
            f" {listed(axes)}{', but ' if caveats else ''}{'; '.join(caveats)}."
        )
    if possible.get(GLIDE):
        return "Drag, lift and trim can be fitted to settled glides (kind: glide)."
    if possible.get(PASSIVE_KIND):
        return (
            "Nothing on board drives it: tows and coasts give drag, decays restoring, drifts the"
            " current (kind: passive)."
        )
    if not possible["residual"]:
        blocked = [name for name in ("resample", "fuse (kinematic)") if not possible[name]][:1]
        why = dict.fromkeys(reasons[name] for name in (*blocked, "residual"))
        return (
            f"No force model can be fitted: {'; '.join(item for item in why if item != NO_STATE)}."
        )
    why = dict.fromkeys(reasons[name] for name in reasons if name.startswith("synthesise "))
    return f"No force model can be fitted: {'; '.join(why)}."


def legs(log: CheckedLog, entries: Sequence[Document]) -> list[dict[str, Any]]:
    """Return the legs of a manifest in this log.

    Span, time that all sensors cover in one piece, share of active outputs, stretches
    that it should not have, RMS per axis.
    """
    length = (int(log.info.end_us) - int(log.info.start_us)) / 1e6
    moving = activity(log) if log.has("actuators") else None
    unusable = unusable_spans(log)
    rows = []
    for entry in entries:
        start = float(entry.get("start_s") or 0.0)
        end = length if entry.get("end_s") is None else float(entry["end_s"])
        inside = start < min(end, length)
        within = (
            (log.t_s("actuators") >= start) & (log.t_s("actuators") <= end)
            if moving is not None
            else np.zeros(0, bool)
        )
        active = float(np.mean(moving[within])) if moving is not None and within.any() else None
        excited = excitation(log, (start, end)) if inside else {}
        rows.append(
            {
                "id": str(entry["id"]),
                "use": entry.get("use"),
                "start_s": start,
                "end_s": end,
                "inside": inside,
                "covered_s": longest_common_s(log, (start, min(end, length))) if inside else 0.0,
                "active_share": active,
                "unusable": [
                    f"{max(start, first):.0f} to {min(end, last):.0f} s {checks()[name].title}"
                    for name, spans in unusable.items()
                    for first, last in spans
                    if max(start, first) < min(end, last)
                ],
                "rms": {axis: item["rms"] for axis, item in excited.items()},
                "excited": [
                    MOTION_WORDS[axis] for axis, item in excited.items() if item["excited"]
                ],
            }
        )
    return rows


def _without(log: CheckedLog, *streams: str) -> str | None:
    missing = [name for name in streams if not log.has(name)]
    return f"no {listed(missing)}" if missing else None


def _resample(log: CheckedLog) -> str | None:
    missing = _without(log, "attitude", "depth")
    if missing is not None:
        return missing
    longest = longest_common_s(log)
    return (
        None
        if longest >= SHORTEST_S
        else f"all sensors together cover {longest:.1f} s at most, {SHORTEST_S:g} s are needed"
    )


def common_spans(
    log: CheckedLog, window: tuple[float, float] = (-np.inf, np.inf)
) -> list[tuple[float, float]]:
    """Return the spans [s] that all sensors and commands cover without a gap."""
    spans = [window]
    for stream in COVERING:
        if not log.has(stream):
            continue
        t_s = log.t_s(stream)
        own = [
            (float(t_s[a]), float(t_s[b - 1]))
            for a, b in gaps(t_s, limit("gap"))
            if b - a >= FEWEST
        ]
        spans = [(max(a, c), min(b, d)) for a, b in spans for c, d in own if min(b, d) > max(a, c)]
    return spans


def longest_common_s(log: CheckedLog, window: tuple[float, float] = (-np.inf, np.inf)) -> float:
    """Return the longest time [s] that all sensors and commands cover without a gap."""
    return max((end - start for start, end in common_spans(log, window)), default=0.0)


def _forces(log: CheckedLog) -> str | None:
    """Return why the commands of a log cannot become forces; None if they can."""
    if log.vehicle is not None and not _listened(log):
        return PASSIVE
    if not log.has("actuators"):
        return "no actuators"
    if log.under_water is False:
        return "not an underwater vehicle"
    columns = log.tables["actuators"].column_names
    if not log.thrusters() and not any(name.startswith(("propeller", "fin_")) for name in columns):
        return "normalised commands only, which give no newtons"
    unheard = [name for name in _listened(log) if name not in columns]
    if unheard:
        return f"no {listed(unheard)} among the actuators, to which the vehicle listens"
    moving = activity(log)
    return IDLE if moving is not None and not moving.any() else None


def _listened(log: CheckedLog) -> list[str]:
    """Return the columns of the actuators that the vehicle file listens to."""
    if log.vehicle is None:
        return []
    parts = log.vehicle
    return [
        *([] if parts.propeller is None else ["propeller_rev_s"]),
        *([] if parts.fins is None else FINS),
        *([] if parts.thrusters is None else [f"pwm_{n}_us" for n in parts.thrusters.outputs]),
    ]
