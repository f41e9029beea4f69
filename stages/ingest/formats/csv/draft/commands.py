"""Columns of a CSV file that are commands or outputs, by names, values and motion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auvid.data_schemas.errors import LogError
from auvid.hydro.arrays import Array
from auvid.stages.ingest.formats.csv.column_names import (
    NamedColumn,
)
from auvid.stages.ingest.formats.csv.draft.answered_commands import answered_commands
from auvid.stages.ingest.formats.csv.draft.units import (
    LARGEST_COMMAND,
    are_pulses,
    in_percent,
    percentile,
)

FEWEST_OUTPUTS = 3
MATCHED, MATCHED_REVERSED = "matched", "matched reversed"
"""Marks of commands that were matched to the axis that answers them."""
NAMED_COMMAND, NAMED_REVERSED = "named", "named reversed"
"""Marks of commands whose axis the user names."""
COMMANDS = re.compile(
    r"^(?:cmd|command|u|tau|ctrl|control|input|joy|axis|demand|act|actuators?|channel|ch|rc) ?\d+$"
)
AXIS_NAMES = dict(zip("uvwpqr", ("surge", "sway", "heave", "roll", "pitch", "yaw"), strict=True))


SHARES = (
    "Divide it by the force of a full command, and write that force as"
    " actuators.commands.full_force of the vehicle file (docs/axes.md): figures then are in"
    " newtons."
)
"""What to do with a command in newtons."""


def as_command(item: NamedColumn, axis: str, *, file: str) -> NamedColumn:
    """Return a column as the command of an axis that the user named.

    Raises `LogError` for newtons: a command is a share of the full one.
    """
    if item.unit.removeprefix("k").startswith("N"):
        raise LogError(
            "a command in newtons",
            file=file,
            row=1,
            field=item.name,
            value=item.unit,
            allowed="shares of the full command, percent, or pulses in us",
            remedy=SHARES,
        )
    mark = NAMED_REVERSED if axis.startswith("-") else NAMED_COMMAND
    return replace(item, place=("actuators", f"command_{axis.lstrip('-')}"), frame=mark)


def without_guess(item: NamedColumn) -> NamedColumn:
    """Return a column that is no command where the user named all of these."""
    is_command = item.place is not None and item.place[1].startswith("command_")
    return replace(item, place=None) if is_command or COMMANDS.search(item.words) else item


def with_commands(
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
    t_s: Array,
    velocities: Mapping[str, Array],
) -> list[NamedColumn]:
    """Return the columns with numbered commands at the axes that answer them.

    Only where no name tells a command or an output. velocities: those of a pose.
    """
    numbered = [item for item in columns if COMMANDS.search(item.words)]
    largest = 100.0 if in_percent([values[item.name] for item in numbered]) else LARGEST_COMMAND
    numbered = [item for item in numbered if percentile([values[item.name]]) <= largest]
    there = {item.place[0] for item in columns if item.place is not None and item not in numbered}
    if "actuators" in there or len(numbered) < 2 or t_s.size != values[columns[0].name].size:
        return list(columns)
    fields = {**dict(zip(("u_m_s", "v_m_s", "w_m_s"), "uvw", strict=True))}
    fields |= dict(zip(("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"), "pqr", strict=True))
    motions = {
        fields[item.place[1]]: values[item.name]
        for item in columns
        if item.place is not None and item.place[1] in fields
    }
    motions = motions or dict(velocities)
    commands = {item.name: values[item.name] for item in numbered}
    answers = {item.command: item for item in answered_commands(t_s, commands, motions)}
    placed = []
    for item in columns:
        answer = answers.get(item.name)
        if answer is not None:
            mark = MATCHED if answer.correlation > 0.0 else MATCHED_REVERSED
            item = replace(
                item, place=("actuators", f"command_{AXIS_NAMES[answer.axis]}"), frame=mark
            )
        elif item in numbered:
            item = replace(item, place=None)
        placed.append(item)
    return placed


def with_pulses(columns: Sequence[NamedColumn], values: Mapping[str, Array]) -> list[NamedColumn]:
    """Return the columns, with numbered ones that hold pulses as outputs.

    Only where no name tells an output. Six numbers may name the parts of a velocity: not
    where all of them are pulses.
    """
    if any(item.place is not None and item.place[1].startswith("pwm_") for item in columns):
        return list(columns)
    stems: dict[str, list[NamedColumn]] = {}
    numbers: dict[str, int] = {}
    for item in columns:
        by_number = item.place is not None and item.place[0] in ("velocity", "imu")
        words = item.name if by_number and not item.unit else item.words
        match = re.fullmatch(r"(.*\D)(\d{1,2})\]?", words)
        if match and (item.place is None or by_number) and are_pulses(values[item.name]):
            stems.setdefault(match[1], []).append(item)
            numbers[item.name] = int(match[2])
    outputs = max(stems.values(), key=len, default=[])
    if len(outputs) < FEWEST_OUTPUTS:
        return list(columns)
    return [
        replace(item, place=("actuators", f"pwm_{numbers[item.name]}_us"))
        if item in outputs
        else item
        for item in columns
    ]


def possible_outputs(
    chosen: dict[tuple[str, str], NamedColumn],
    values: Mapping[str, Array],
    remarks: list[str],
) -> dict[tuple[str, str], NamedColumn]:
    """Return the columns without outputs that are no pulses; outputs count from 1."""
    outputs = {place: item for place, item in chosen.items() if place[1].startswith("pwm_")}
    if not outputs:
        return chosen
    rest = {place: item for place, item in chosen.items() if place not in outputs}
    known_units = {item.unit for item in outputs.values() if item.unit}
    finite = np.concatenate([values[item.name] for item in outputs.values()])
    finite = finite[np.isfinite(finite) & (finite != 0.0)]
    unit = "us" if are_pulses(finite) else _normalised(finite)
    if not unit or known_units - {unit, "1"}:
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        remarks.append(
            f"outputs {', '.join(item.name for item in outputs.values())} are no pulses in us"
            f" ({low:g} to {high:g}); a column map takes pulses or normalised commands of each"
            " output, or commands of surge, sway, heave, roll, pitch, yaw."
        )
        return rest
    outputs = {place: replace(item, unit=unit) for place, item in outputs.items()}
    numbers = [int(name.split("_")[1]) for _, name in outputs]
    shift = 1 if 0 in numbers else 0
    if shift:
        remarks.append("outputs are counted from 0 in the file, from 1 here.")
    moved = {
        (stream, f"pwm_{int(name.split('_')[1]) + shift}_us"): item
        for (stream, name), item in outputs.items()
        if int(name.split("_")[1]) + shift <= 16
    }
    return rest | moved


def _normalised(finite: Array) -> str:
    """Return the unit of commands from -1 to 1 or from -100 to 100 %, '' for others."""
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    both = bool(finite.size) and float(finite.min()) < 0.0 < float(finite.max())
    if not both or largest > 100.0:
        return ""
    return "1" if largest <= 1.05 else "percent" if largest > 5.0 else ""
