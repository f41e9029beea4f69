"""What the fuse stage shows: the fusion document, its report section and its views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from auvid.data_schemas.tables import has_columns, matrix
from auvid.stages.base import Document
from auvid.stages.columns import ATTITUDE, VELOCITY, Array, rms
from auvid.stages.fuse.current import current_blocks
from auvid.stages.fuse.motion import Found, Mask, Motion
from auvid.stages.presentation import Block, panel, plot, remark, section, series, table


def fusion_document(
    segment: Document,
    settings: Document,
    motion: Motion,
    sensed: Mapping[str, Array],
    nu: Array,
    keep: Mask,
    found: Found,
) -> dict[str, Any]:
    spread = {
        name: rms((sensed[name] - nu[:, index])[keep])
        for index, name in enumerate(VELOCITY)
        if name in sensed
    }
    return {
        "segment": segment["id"],
        **settings,
        "accelerometer": found.convention,
        "gyro_bias_rad_s": [float(value) for value in motion.gyro_bias],
        "accel_bias_m_s2": (
            None if found.accel_bias is None else [float(value) for value in found.accel_bias]
        ),
        "integrated_sway_rms_m_s": found.sway_rms,
        "installation": found.installation,
        "current": found.current,
        "rms": spread,
        "warnings": list(found.warnings),
    }


def fuse_section(
    segment: Document,
    raw: pa.Table,
    motion: Motion,
    sensed: Mapping[str, Array],
    nu: Array,
    pose: Array,
    keep: Mask,
    fusion: Document,
) -> dict[str, Any]:
    t = motion.t_s + float(segment["leg_start_s"])
    panels = []
    for index, (name, label, unit) in enumerate(
        zip(VELOCITY, "uvwpqr", ["m/s"] * 3 + ["rad/s"] * 3, strict=True)
    ):
        lines = [series("raw", t, sensed[name], "raw")] if name in sensed else []
        panels.append(
            panel(label, unit, [*lines, series("fused", t[keep], nu[keep, index], "fused")])
        )
    attitude = [
        panel(
            label,
            "rad",
            [
                series("raw", t, matrix(raw, (column,))[:, 0], "raw"),
                series("fused", t[keep], pose[keep, index], "fused"),
            ],
        )
        for index, label, column in (
            (3, "phi", "phi_rad"),
            (4, "theta", "theta_rad"),
            (5, "psi", "psi_rad"),
            (2, "z", "z_m"),
        )
    ]
    for item in attitude[3:]:
        item["unit"] = "m"
    rows = [
        [name.split("_")[0], value, "m/s" if name in VELOCITY[:3] else "rad/s"]
        for name, value in fusion["rms"].items()
    ]
    biases = [
        ["gyro " + axis, value, "rad/s"]
        for axis, value in zip("xyz", fusion["gyro_bias_rad_s"] or [], strict=False)
    ]
    biases += [
        ["accelerometer " + axis, value, "m/s^2"]
        for axis, value in zip("xyz", fusion["accel_bias_m_s2"] or [], strict=False)
    ]
    blocks = [remark(words, "warning") for words in fusion["warnings"]]
    blocks += current_blocks(fusion["current"])
    blocks += installation_blocks(fusion["installation"])
    blocks += uneven_bandwidth(segment["smoothing"], fusion["cutoff_hz"])
    blocks += [
        plot(
            "Velocity of the body origin, raw against fused",
            panels,
            group="time",
            look_for=(
                "The fused line follows the raw one without lag; what it leaves out looks like"
                " noise."
            ),
        ),
        plot("Attitude and depth", attitude, group="time"),
        table("Biases", ["channel", "value", "unit"], biases),
        table(
            "RMS of raw minus fused",
            ["channel", "RMS", "unit"],
            rows,
            note="It holds the lever arm and the bias too.",
        ),
    ]
    return section(f"State of {segment['id']} ({fusion['method']})", blocks, order=30)


def installation_blocks(found: Mapping[str, Any] | None) -> list[Block]:
    """What was found of the velocity sensor's arm and mounting, and a warning for what
    this segment leaves open.
    """
    if found is None:
        return []
    rows: list[list[Any]] = []
    left_open: list[str] = []
    for part, key, unit in (("arm", "dvl_arm", "m"), ("mounting", "dvl_mounting", "rad")):
        values, errors = (found[f"{key}{ending}_{unit}"] for ending in ("", "_sd"))
        for axis, value, error, used in zip(
            "xyz", values, errors, found[f"{key}_determined"], strict=True
        ):
            if value is not None:
                rows.append([f"{part} {axis}", value, error, unit, "yes" if used else "no"])
                left_open += [] if used else [f"{part} {axis}"]
    note = (
        "Mounting: small rotation in addition to that of the vehicle file. From this segment alone;"
        " a standard error too large is not used."
    )
    blocks = [
        table(
            "Velocity sensor as found to sit",
            ["figure", "value", "standard error", "unit", "used"],
            rows,
            note=note,
        )
    ]
    if left_open:
        words = (
            f"This segment does not determine the velocity sensor's {', '.join(left_open)}: the"
            " vehicle file's word stands there."
        )
        blocks.insert(
            0,
            remark(
                f"{words} Find them on a leg with turns and dives, and write them into the vehicle"
                " file.",
                "warning",
            ),
        )
    return blocks


def uneven_bandwidth(smoothing: Mapping[str, Any], cutoff_hz: float | None) -> list[Block]:
    """A note where the splines of `resample` cut off below the low-pass, which then
    does not make all channels alike.
    """
    if cutoff_hz is None:
        return []
    lower = {
        name: item["cutoff_hz"]
        for name, item in smoothing.items()
        if item.get("cutoff_hz") and item["cutoff_hz"] < cutoff_hz
    }
    if not lower:
        return []
    words = ", ".join(
        f"{name.partition('_')[0] if name != 'attitude' else name} {value:.2g} Hz"
        for name, value in lower.items()
    )
    return [
        remark(
            f"Below the low-pass of {cutoff_hz:g} Hz, the splines of resample already cut off:"
            f" {words}. These channels are narrower than the others, by the noise of their sensors;"
            " smoothing: none in resample leaves the low-pass alone to decide.",
            "note",
        )
    ]


def fuse_views(fused: pa.Table) -> dict[str, Any]:
    """Raw against fused, and twice the standard deviation around the fused state where
    the method gives one.
    """
    groups = []
    for entity, names, unit in (
        ("state/velocity", VELOCITY[:3], "m/s"),
        ("state/rates", VELOCITY[3:], "rad/s"),
        ("state/attitude", ATTITUDE, "rad"),
        ("state/depth", ("z_m",), "m"),
    ):
        symbols = [name.split("_")[0] for name in names]
        for table_name, role in (("resampled", "raw"), ("fused", "fused")):
            groups.append(
                _group(
                    f"{entity}/{role}",
                    table_name,
                    names,
                    [f"{symbol} {role}" for symbol in symbols],
                    role,
                    unit,
                )
            )
        spread = [name.replace("_", "_sd_", 1) for name in names]
        if has_columns(fused, spread):
            groups.append(
                _group(f"{entity}/band", "fused", names, symbols, "band", unit) | {"spread": spread}
            )
    return {"groups": groups}


def _group(
    entity: str, table: str, columns: Sequence[str], names: Sequence[str], role: str, unit: str
) -> dict[str, Any]:
    return {"entity": entity, "table": table, "columns": list(columns), "names": list(names)} | {
        "roles": [role] * len(columns),
        "tab": "State",
        "unit": unit,
    }
