"""Draft of a column map from the names of the columns, for a user to correct."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

from auvid.data_schemas.streams import NEEDED, STREAMS

WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
UNKNOWN = "'?'"
NO_MEASUREMENT = re.compile(r"desired|target|setpoint|std|fom|temperature|magnetometer")
UNITS = {
    "m": "m",
    "mps": "m/s",
    "rad": "rad",
    "radps": "rad/s",
    "deg": "deg",
    "degps": "deg/s",
    "us": "us",
    "ms": "ms",
    "s": "s",
    "v": "V",
}
UNITS |= {
    "dps": "deg/s",
    "cm": "cm",
    "ft": "ft",
    "knot": "knot",
    "g": "g0",
    "a": "A",
    "volt": "V",
    "sec": "s",
}
END = r"(?: (?:m|mps|rad|radps|deg|degps|dps|cm|ft|knot|g|v|a|volt))?$"
TIME = re.compile(r"\b(t|time|timestamp|stamp)\b")
AXIS = {
    "x": "x",
    "y": "y",
    "z": "z",
    "roll": "x",
    "pitch": "y",
    "yaw": "z",
    "p": "x",
    "q": "y",
    "r": "z",
}
PATTERNS: tuple[tuple[str, str, str, dict[str, str]], ...] = (
    (
        r"\b(?:gyro|gyroscope|gyr|angular rate|angular velocity) ([xyz])",
        "imu",
        "gyro_{}_rad_s",
        AXIS,
    ),
    (rf"^([pqr]){END}", "imu", "gyro_{}_rad_s", AXIS),
    (r"\b(roll|pitch|yaw) ?(?:rate|speed)", "imu", "gyro_{}_rad_s", AXIS),
    (r"\b(?:accel|accelerometer|acceleration|acc) ([xyz])", "imu", "accel_{}_m_s2", AXIS),
    (
        r"\b(surge|sway|heave) (?:rate|speed|velocity)",
        "velocity",
        "{}_m_s",
        {"surge": "u", "sway": "v", "heave": "w"},
    ),
    (r"\b(?:vel|velocity) ([xyz])", "velocity", "{}_m_s", {"x": "u", "y": "v", "z": "w"}),
    (rf"^([uvw]){END}", "velocity", "{}_m_s", {"u": "u", "v": "v", "w": "w"}),
    (
        r"^(surge|sway|heave)$|^(?:cmd|command) (surge|sway|heave|roll|pitch|yaw)$",
        "actuators",
        "command_{}",
        {},
    ),
    (r"^(?:pwm|servo|motor|thruster|output) (\d+)", "actuators", "pwm_{}_us", {}),
    (
        rf"\b(roll|pitch|yaw|heading)(?: angle)?{END}",
        "attitude",
        "{}_rad",
        {"roll": "phi", "pitch": "theta", "yaw": "psi", "heading": "psi"},
    ),
    (rf"\bdepth(?: value)?{END}", "depth", "depth_m", {}),
    (rf"^([xyz]){END}", "position", "{}_m", {}),
    (rf"\b(northing|easting){END}", "position", "{}_m", {"northing": "x", "easting": "y"}),
    (r"\b(?:voltage|volt)\b", "battery", "voltage_v", {}),
)
NAMED_COLUMNS = 20
NEEDS = {
    "attitude": "resample",
    "depth": "resample",
    "velocity": "fuse (kinematic)",
    "actuators": "residual",
}


def proposed_map(names: Sequence[str]) -> str:
    """Return a sentence on what the columns look like, and a column map as YAML.

    The sentence names what the chain would miss. `?` stands for what the names do not
    tell: units that no name ends with, and every column if no name is known. Columns
    without a guess stand in a comment.
    """
    words = [" ".join(WORDS.findall(name)).lower() for name in names]
    time = next((index for index, item in enumerate(words) if TIME.search(item)), 0)
    steered = {"surge", "sway"} <= set(words)  # then a bare `yaw` is a command as well
    guesses: dict[tuple[str, str], int] = {}
    for index, item in enumerate(words):
        if index == time or NO_MEASUREMENT.search(item):
            continue
        place = ("actuators", "command_yaw") if steered and item == "yaw" else _place(item)
        if place is not None:
            guesses.setdefault(place, index)
    lines = [
        f"time: {{column: {quoted(names[time])}, unit: {_unit(words[time], UNKNOWN)}, epoch: boot}}"
    ]
    lines += ["accelerometer: specific_force"] * any(
        field.startswith("accel") for _, field in guesses
    )
    lines.append("columns:")
    for (stream, field), index in guesses.items():
        unit = (
            "'1'"
            if field.startswith("command")
            else "us"
            if field.startswith("pwm")
            else _unit(words[index], UNKNOWN)
        )
        lines.append(
            f"  - {{column: {quoted(names[index])}, stream: {stream}, field: {field}, unit:"
            f" {unit}}}"
        )
    if not guesses:
        lines.append(f"  - {{column: {UNKNOWN}, stream: depth, field: depth_m, unit: {UNKNOWN}}}")
    rest = [name for index, name in enumerate(names) if index not in (time, *guesses.values())]
    if rest:
        more = f" and {len(rest) - NAMED_COLUMNS} more" if len(rest) > NAMED_COLUMNS else ""
        lines.append(f"# no guess for {', '.join(map(quoted, rest[:NAMED_COLUMNS]))}{more}")
    there = [stream for stream in STREAMS if any(item == stream for item, _ in guesses)]
    missing = [f"{stream} ({stage})" for stream, stage in NEEDS.items() if stream not in there]
    parts = {
        stream: [field for field in NEEDED[stream] if (stream, field) not in guesses]
        for stream in there
    }
    like = [
        stream + (f" (without {', '.join(lack)})" if (lack := parts[stream]) else "")
        for stream in there
    ]
    summary = f"The names look like {', '.join(like)}" if like else "No name tells what it is"
    summary += f"; nothing looks like {', '.join(missing)}." if missing else "."
    return f"{summary} A draft to correct (columns, units, signs and frames):\n" + "\n".join(lines)


def _place(words: str) -> tuple[str, str] | None:
    for pattern, stream, field, translated in PATTERNS:
        match = re.search(pattern, words)
        if match:
            part = next((item for item in match.groups() if item), "")
            return stream, field.format(translated.get(part, part))
    return None


def _unit(words: str, otherwise: str) -> str:
    return UNITS.get(words.split()[-1], otherwise) if " " in words else otherwise


def quoted(name: str) -> str:
    """Return a name as YAML, in quotes where it needs them."""
    return (
        name
        if re.fullmatch(r"[A-Za-z][\w.]*", name)
        and name.lower() not in ("y", "n", "yes", "no", "on", "off")
        else json.dumps(name)
    )
