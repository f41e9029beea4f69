"""What a log can be used for: excitation per axis, and which stages can run on it and why not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hydro.identification.excitation import THRESHOLDS, axis_excitation
from hydro.identification.resampling import gaps

from .checks_common import Finding, Recorded, finding, limit, listed, number
from .checks_vehicle import AXES, activity, motions

UNITS = {"u": "m/s", "v": "m/s", "w": "m/s", "p": "rad/s", "q": "rad/s", "r": "rad/s"}
SHORTEST_S = 5.0
"""The default of stages.resample.min_segment_s."""
FEWEST = 5
COVERING = ("attitude", "imu", "depth", "velocity", "actuators")


def excitation(log: Recorded, window: tuple[float, float] = (-np.inf, np.inf)) -> dict[str, dict[str, Any]]:
    """Motion per axis u v w p q r within a window of seconds from the start of the log; null where nothing measures an axis.

    Without a velocity sensor heave is the rate of depth, which is the body's w only while it is level.
    """
    found = motions(log)
    result = {}
    for axis in AXES:
        empty = {"rms": None, "low": None, "high": None, "share_beyond": None}
        about = {"threshold": THRESHOLDS[axis], "unit": UNITS[axis]}
        at, values, source = found.get(axis, (np.zeros(0), np.zeros(0), "not measured"))
        values = values[(at >= window[0]) & (at <= window[1])]
        if not values.size:
            result[axis] = {**empty, **about, "source": source, "excited": False}
            continue
        column = "uvwpqr".index(axis)
        nu = np.zeros((values.size, 6))
        nu[:, column] = values
        item = axis_excitation(nu)[axis]
        measured = {"rms": item.rms, "low": item.low, "high": item.high, "share_beyond": item.share_beyond}
        result[axis] = {**measured, **about, "source": source, "excited": item.excited}
    return result


def excitation_findings(excited: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """Axes that are measured and hardly move."""
    still = [(axis, item) for axis, item in excited.items() if item["rms"] is not None and not item["excited"]]
    if still:
        said = [f"{AXES[axis]} {number(item['rms'])} {item['unit']}" for axis, item in still]
        text = f"Hardly any motion in {listed(said)} (RMS; threshold {limit('not_excited'):g})."
        yield finding("not_excited", text, value=max(float(item["rms"]) for _, item in still))


def capabilities(log: Recorded, excited: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Which stages can run on the log, and why not: {name, possible, reason}."""
    resample = _resample(log)
    kinematic = resample or _without(log, "velocity", "imu")
    accelerometer = None if log.accelerometer() is not None else "no accelerometer"
    thesis = resample or _without(log, "imu") or accelerometer
    fused = kinematic is None or thesis is None
    residual = (None if fused else "no fused state") or _forces(log)
    rows = [
        ("resample", resample, "attitude and depth"),
        ("fuse (kinematic)", kinematic, "velocity, gyro and depth"),
        ("fuse (thesis)", thesis, "accelerometer, gyro and depth; drifts on slow vehicles"),
        ("residual", residual, "commands to forces through the vehicle file"),
    ]
    for axis, name in AXES.items():
        item = excited[axis]
        motion = None
        if item["rms"] is None:
            motion = f"{name} is not measured"
        elif not item["excited"]:
            motion = f"RMS {number(item['rms'])} {item['unit']} lies below {item['threshold']:g}"
        reason = "" if item["rms"] is None else f"RMS {number(item['rms'])} {item['unit']}"
        rows.append((f"synthesise {name}", (residual and "no residual force") or motion, reason))
    return [{"name": name, "possible": why is None, "reason": why or on} for name, why, on in rows]


def _without(log: Recorded, *streams: str) -> str | None:
    missing = [name for name in streams if not log.has(name)]
    return f"no {listed(missing)}" if missing else None


def _resample(log: Recorded) -> str | None:
    missing = _without(log, "attitude", "depth")
    if missing is not None:
        return missing
    longest = longest_common_s(log)
    return None if longest >= SHORTEST_S else f"all sensors together cover {longest:.1f} s at most, {SHORTEST_S:g} s are needed"


def longest_common_s(log: Recorded, window: tuple[float, float] = (-np.inf, np.inf)) -> float:
    """The longest time within a window that all motion sensors and commands cover without a gap [s]."""
    spans = [window]
    for stream in COVERING:
        if not log.has(stream):
            continue
        t_s = log.t_s(stream)
        own = [(float(t_s[a]), float(t_s[b - 1])) for a, b in gaps(t_s, limit("gap")) if b - a >= FEWEST]
        spans = [(max(a, c), min(b, d)) for a, b in spans for c, d in own if min(b, d) > max(a, c)]
    return max((end - start for start, end in spans), default=0.0)


def _forces(log: Recorded) -> str | None:
    """Why the commands of a log cannot become forces; None if they can."""
    if not log.has("actuators"):
        return "no actuators"
    if log.under_water is False:
        return "not an underwater vehicle"
    columns = log.tables["actuators"].column_names
    if not log.thrusters() and not any(name.startswith(("propeller", "fin_")) for name in columns):
        return "normalised commands only, which give no newtons"
    moving = activity(log)
    return "no actuator acts" if moving is not None and not moving.any() else None
