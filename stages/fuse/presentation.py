"""The fusion document, report section and recording views of the fuse stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from auvid.data_schemas.records.motion import (
    ChannelSmoothing,
    CurrentRecord,
    FusionRecord,
    SegmentRecord,
)
from auvid.data_schemas.tables import column, has_columns
from auvid.hydro.arrays import Array, Mask
from auvid.stages.base import Document
from auvid.stages.columns import ATTITUDE, VELOCITY, clock, rms
from auvid.stages.fuse.current import NOT_OBSERVABLE
from auvid.stages.fuse.methods import FusionResult
from auvid.stages.presentation import (
    Block,
    panel,
    plot,
    remark,
    section,
    series,
    symbol,
    table,
    unit_of,
    view,
)


def fusion_document(
    segment: SegmentRecord,
    settings: Document,
    gyro_bias: Array,
    result: FusionResult,
    resampled: pa.Table,
    state: Mapping[str, Array],
    keep: Mask,
) -> FusionRecord:
    """Return what was estimated on the way, and how far raw and fused differ."""
    return FusionRecord(
        segment=segment.id,
        **settings,
        accelerometer=result.convention,
        gyro_bias_rad_s=gyro_bias.tolist(),
        accel_bias_m_s2=None if result.accel_bias is None else result.accel_bias.tolist(),
        integrated_sway_rms_m_s=result.sway_rms,
        current=result.current,
        rms={
            name: rms((column(resampled, name) - state[name])[keep])
            for name in VELOCITY
            if has_columns(resampled, (name,))
        },
        warnings=list(result.warnings),
    )


def fuse_section(
    segment: SegmentRecord,
    fusion: FusionRecord,
    resampled: pa.Table,
    state: Mapping[str, Array],
    keep: Mask,
) -> dict[str, Any]:
    """Return the report section: warnings, raw against fused, biases."""
    t = clock(resampled) + float(segment.leg_start_s)

    def panels(*names: str) -> list[dict[str, Any]]:
        return [
            panel(
                symbol(name),
                unit_of("fused", name),
                [
                    *(
                        [series("raw", t, column(resampled, name), "raw")]
                        if has_columns(resampled, (name,))
                        else []
                    ),
                    series("fused", t[keep], state[name][keep], "fused"),
                ],
            )
            for name in names
        ]

    biases = [
        [f"{sensor} {axis}", value, unit]
        for sensor, values, unit in (
            ("gyro", fusion.gyro_bias_rad_s, "rad/s"),
            ("accelerometer", fusion.accel_bias_m_s2, "m/s^2"),
        )
        for axis, value in zip("xyz", values or (), strict=False)
    ]
    blocks = [
        *[remark(words, "warning") for words in fusion.warnings],
        *_current_blocks(fusion.current),
        *_uneven_bandwidth(segment.smoothing, fusion.cutoff_hz),
        plot(
            "Velocity of the body origin, raw against fused",
            panels(*VELOCITY),
            group="time",
            look_for=(
                "The fused line follows the raw one without lag; what it leaves out looks like"
                " noise."
            ),
        ),
        plot("Attitude and depth", panels(*ATTITUDE, "z_m"), group="time"),
        table("Biases", ["channel", "value", "unit"], biases),
        table(
            "RMS of raw minus fused",
            ["channel", "RMS", "unit"],
            [[symbol(name), value, unit_of("fused", name)] for name, value in fusion.rms.items()],
            note="It holds the lever arm and the bias too.",
        ),
    ]
    return section(f"State of {segment.id} ({fusion.method})", blocks, order=30)


def _current_blocks(current: CurrentRecord | None) -> list[Block]:
    if current is None:
        return []
    if current.verdict == NOT_OBSERVABLE:
        words = (
            f"Water current: {NOT_OBSERVABLE}, because {current.reason}. Forces are taken in"
            " still water."
        )
        return [remark(words, "warning")]
    values = current.ned_m_s or ()
    errors: Sequence[float | None] = current.sd_m_s or [None] * 3
    rows = [
        [name, value, sd, "m/s"]
        for name, value, sd in zip(("north", "east", "down"), values, errors, strict=True)
    ]
    note = (
        f"Mean over the segment, {current.reason}. The forces are taken at the velocity through"
        " the water; position is over ground."
    )
    heads = ["towards", "value", "standard deviation", "unit"]
    return [table("Water current", heads, rows, note=note)]


def _uneven_bandwidth(
    smoothing: Mapping[str, ChannelSmoothing], cutoff_hz: float | None
) -> list[Block]:
    """Return a note where splines of `resample` cut off below the low-pass.

    The channels are then not filtered alike.
    """
    if cutoff_hz is None:
        return []
    lower = {
        name: item.cutoff_hz
        for name, item in smoothing.items()
        if item.cutoff_hz and item.cutoff_hz < cutoff_hz
    }
    if not lower:
        return []
    words = ", ".join(f"{symbol(name)} {value:.2g} Hz" for name, value in lower.items())
    return [
        remark(
            f"Below the low-pass of {cutoff_hz:g} Hz, the splines of resample already cut off:"
            f" {words}. These channels are narrower than the others, by the noise of their sensors;"
            " with smoothing: none in resample the low-pass alone decides."
        )
    ]


def fuse_views(fused: pa.Table) -> dict[str, Any]:
    """Return raw against fused, with two standard deviations where they are known."""
    groups = []
    for entity, columns in (
        ("state/velocity", VELOCITY[:3]),
        ("state/rates", VELOCITY[3:]),
        ("state/attitude", ATTITUDE),
        ("state/depth", ("z_m",)),
    ):
        groups += [
            view(
                f"{entity}/{role}",
                source,
                columns,
                [role] * len(columns),
                tab="State",
                names=[f"{symbol(name)} {role}" for name in columns],
            )
            for source, role in (("resampled", "raw"), ("fused", "fused"))
        ]
        spread = [name.replace("_", "_sd_", 1) for name in columns]
        if has_columns(fused, spread):
            roles = ["band"] * len(columns)
            groups.append(
                view(f"{entity}/band", "fused", columns, roles, tab="State", spread=spread)
            )
    return {"groups": groups}
