"""What the report shows of the record of a leg: windows, what was left out, and why."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.stages.axis_tables import FORCES
from auvid.stages.columns import VELOCITY
from auvid.stages.leg_record.record import NOT_COMMANDED, NOT_MEASURED, WORDS, RecordedLeg
from auvid.stages.presentation import Block, fold, panel, plot, remark, section, series, table, view

SHOWN_STRETCHES = 3
UNITS = {axis: "m/s" if axis in "uvw" else "rad/s" for axis in VELOCITIES}


def record_section(windows: AxisWindowsRecord, result: RecordedLeg) -> dict[str, Any]:
    """Return the section of a leg: findings, a row for each axis, all stretches."""
    rows = [_row(axis, windows, result) for axis in AXES]
    blocks: list[Block] = [remark(words, "warning") for words in windows.warnings]
    blocks.append(
        table(
            f"Axes of leg {windows.leg}",
            ["axis", "measured by", ("windows", "1"), ("in all", "s"), "left out"],
            rows,
            note=f"Force: {windows.force}. {' '.join(windows.notes)}".strip(),
        )
    )
    plots = [_plot(axis, result) for axis in windows.windows_s]
    every = [[WORDS[item.axis], item.start_s, item.end_s, item.reason] for item in windows.left_out]
    columns: list[str | tuple[str, str]] = ["axis", ("from", "s"), ("to", "s"), "reason"]
    blocks += fold("Signals", plots)
    blocks += fold("Every stretch that was left out", [table("Left out", columns, every)])
    return section(f"Record of leg {windows.leg}", blocks, order=30)


def _row(axis: str, windows: AxisWindowsRecord, result: RecordedLeg) -> list[Any]:
    spans: dict[str, list[str]] = defaultdict(list)
    for item in windows.left_out:
        if item.axis == axis:
            spans[item.reason].append(f"{item.start_s:.0f} to {item.end_s:.0f} s")
    words = [
        reason
        if reason in (NOT_MEASURED, NOT_COMMANDED)
        else f"{reason} ({', '.join(own[:SHOWN_STRETCHES])}"
        + (f", {len(own) - SHOWN_STRETCHES} more)" if len(own) > SHOWN_STRETCHES else ")")
        for reason, own in spans.items()
    ]
    return [
        WORDS[axis],
        result.record.measured_by.get(axis, "nothing"),
        len(result.record.windows.get(axis, ())),
        result.length_s(axis),
        "; ".join(words),
    ]


def _plot(axis: str, result: RecordedLeg) -> Block:
    record, letter = result.record, VELOCITIES[AXES.index(axis)]
    depth = axis == "Z" and record.measured_by[axis] == "depth"
    measured = record.depth_m if depth else record.rate[letter]
    assert measured is not None
    unit = "full commands" if record.normalised else "N" if axis in "XYZ" else "N m"
    motion = ("depth", "m") if depth else (letter, UNITS[letter])
    return plot(
        WORDS[axis].capitalize(),
        [
            panel(*motion, [series("measured", record.t_s, measured, "measured")]),
            panel(axis, unit, [series("force", record.t_s, record.force[axis], "raw")]),
        ],
        group="axis_record",
    )


def record_views(record: AxisRecord) -> dict[str, Any]:
    """Return what the recording shows of a leg: measured motion and force."""
    groups = []
    for at, axis in enumerate(AXES):
        if axis not in record.windows:
            continue
        depth = axis == "Z" and record.measured_by[axis] == "depth"
        column = "depth_m" if depth else VELOCITY[at]
        groups.append(
            view(f"axes/{WORDS[axis]}", "axis_record", [column], ["measured"], tab="Axes")
        )
        groups.append(
            view(
                f"axes/{WORDS[axis]}_force",
                "axis_record",
                [FORCES[at]],
                ["raw"],
                tab="Axes",
                names=[axis],
                unit="full commands" if record.normalised else None,
            )
        )
    return {"groups": groups}
