"""Draft of a column map from the names of the columns, for a user to correct."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

from auvid.data_schemas.streams import NEEDED, STREAMS
from auvid.stages.ingest.formats.csv.column_names import named_columns
from auvid.stages.ingest.formats.csv.names.unit_words import MEASURES

UNKNOWN = "'?'"
NAMED_COLUMNS = 20
SPEED_AHEAD = "speed through the water ahead"
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
    named = named_columns(names)
    time = next((index for index, item in enumerate(named) if item.may_be_time), 0)
    guesses: dict[tuple[str, str], int] = {}
    for index, item in enumerate(named):
        if index != time and item.place is not None:
            guesses.setdefault(item.place, index)
    lines = [
        f"time: {{column: {quoted(names[time])}, unit: {named[time].unit or UNKNOWN}, epoch: boot}}"
    ]
    lines += ["accelerometer: specific_force"] * any(
        field.startswith("accel") for _, field in guesses
    )
    lines.append("columns:")
    for (stream, field), index in guesses.items():
        unit = (
            "'1'"
            if field.startswith("command") and not named[index].unit
            else "us"
            if field.startswith("pwm") and MEASURES.get(named[index].unit) != "ratio"
            else named[index].unit or UNKNOWN
        )
        frame = f", frame: {named[index].frame}" if named[index].frame else ""
        lines.append(
            f"  - {{column: {quoted(names[index])}, stream: {stream}, field: {field}, unit:"
            f" {unit}{frame}}}"
        )
    if not guesses:
        lines.append(f"  - {{column: {UNKNOWN}, stream: depth, field: depth_m, unit: {UNKNOWN}}}")
    rest = [name for index, name in enumerate(names) if index not in (time, *guesses.values())]
    ahead = [item.name for item in named if item.place is None and item.is_speed_ahead]
    lines += [f"# {line}" for line in ahead_words(ahead)]
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


def ahead_words(names: Sequence[str]) -> list[str]:
    """Return a sentence on columns of a speed ahead, which fill no stream."""
    if not names:
        return []
    return [
        f"{', '.join(map(quoted, names))}: {SPEED_AHEAD}. It tells lift of a glider"
        " and drag of a tow; a velocity has three axes, so that nothing else uses it."
    ]


def quoted(name: str) -> str:
    """Return a name as YAML, in quotes where it needs them."""
    return (
        name
        if re.fullmatch(r"[A-Za-z][\w.]*", name)
        and name.lower() not in ("y", "n", "yes", "no", "on", "off")
        else json.dumps(name)
    )
