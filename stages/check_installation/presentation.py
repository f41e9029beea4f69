"""The report section of the installation check: findings first, then every figure."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvid.data_schemas.records.motion import InstallationFigure, InstallationRecord
from auvid.stages.presentation import Block, remark, section, table

AXES_OF = {"x": "forward", "y": "to starboard", "z": "down"}
TURN_OF = {"x": "roll", "y": "pitch", "z": "yaw"}
LARGE_INNOVATION = 9.0
"""Mean squared innovation over its variance that is worth a word."""


def installation_section(record: InstallationRecord) -> dict[str, Any]:
    """Return the section: what departs, what cannot be seen, the table."""
    return section("Installation of the sensors", list(_blocks(record)), order=25)


def _blocks(record: InstallationRecord) -> list[Block]:
    blocks = [remark(words, "warning") for words in findings(record)]
    unseen = [figure_name(item) for item in record.figures if item.verdict == "not observable"]
    if record.legs and unseen:
        blocks.append(
            remark(
                f"These legs cannot show {', '.join(unseen)} of the velocity log closely enough to"
                " be called right. Turns both ways, dives and changes of speed do."
            )
        )
    if record.left_out:
        reasons = sorted({f"{reason}" for reason in record.left_out.values()})
        names = ", ".join(record.left_out)
        blocks.append(remark(f"Not checked: {names} ({'; '.join(reasons)})."))
    if record.figures and record.legs:
        blocks.append(
            table(
                "Installation, all legs together against the vehicle file",
                ["figure", "departure", "standard error", "counts beyond", "unit", "verdict"],
                [_row(item) for item in record.figures],
                note=(
                    "Seen is where the velocity log sits against the accelerometer: an arm that"
                    " departs may be that of either. Not observable: these legs could miss a"
                    " departure of twice the size that counts."
                ),
            )
        )
    return blocks


def findings(record: InstallationRecord) -> list[str]:
    """Return a sentence for each departure: what is wrong, by how much, what to do."""
    if record.convention_found is not None:
        return [
            f"The accelerometer is taken for {_words(record.convention)}, and reads"
            f" {_words(record.convention_found)}. Set accelerometer: {record.convention_found} in"
            " the vehicle file (or stages.fuse.accelerometer)."
        ]
    words = []
    for item in record.figures:
        if item.verdict != "departs":
            continue
        assert item.standard_error is not None
        factor, unit = _for_people(item)
        size, error = factor * item.departure, factor * item.standard_error
        what = f"The velocity log's {figure_name(item)}"
        if "scale" in item.name:
            sensor = item.name.removesuffix(" scale")
            words.append(
                f"The {sensor} reads {size:+.1f} +- {error:.1f} {unit} against the accelerometer:"
                f" check the unit and scale of {sensor}, and of the accelerometer."
            )
            continue
        if item.corrected is not None:
            remedy = f"the vehicle file says {item.file_value:g}, these legs {item.corrected:.3g}"
        else:
            remedy = f"turn sensors.dvl by {size:+.2g} {unit} about {item.name[-1]}"
        words.append(
            f"{what} departs by {size:+.2g} +- {error:.1g} {unit} from the vehicle file: {remedy}."
            " Correct the file; stages.fuse.installation: estimate takes what these legs say."
        )
    for sensor, ratio in record.innovations.items():
        if ratio > LARGE_INNOVATION and not words:
            words.append(
                f"Innovations of {sensor} are {np.sqrt(ratio):.1f} times what the noise of the"
                " sensors explains, and no departure of the installation accounts for them: look"
                " for outliers, a clock that drifts, or a wrong place of another sensor."
            )
    return words


def figure_name(item: InstallationFigure) -> str:
    """Return a figure in words: `arm forward`, `yaw angle`, `lag`, `velocity scale`."""
    part, _, axis = item.name.partition(" ")
    if part == "arm":
        return f"arm {AXES_OF[axis]}"
    return f"{TURN_OF[axis]} angle" if part == "angle" else item.name


def _row(item: InstallationFigure) -> list[Any]:
    factor, unit = _for_people(item)
    error = item.standard_error
    return [
        figure_name(item),
        None if error is None else factor * item.departure,
        None if error is None else factor * error,
        factor * item.limit,
        unit,
        item.verdict,
    ]


def _for_people(item: InstallationFigure) -> tuple[float, str]:
    """Return factor and unit of a figure for people: m, deg, s or %."""
    return {"rad": (float(np.degrees(1.0)), "deg"), "1": (100.0, "%")}.get(
        item.unit, (1.0, item.unit)
    )


def _words(convention: str | None) -> str:
    return {
        "specific_force": "specific force (gravity in the reading)",
        "inertial": "inertial acceleration (gravity taken off)",
        "derivative": "the rate of change of body velocity",
    }.get(str(convention), "several things")
