"""What the fuse stage shows: the fusion document, its report section and its views."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pyarrow as pa

from data_schemas.tables import matrix
from stages.base import Document
from stages.fuse.motion import Found, Mask, Motion
from stages.sections import panel, plot, remark, section, series, table
from stages.signals import ATTITUDE, VELOCITY, Array, rms


def fusion_document(
    segment: Document, settings: Document, motion: Motion, sensed: Mapping[str, Array], nu: Array, keep: Mask, found: Found
) -> dict[str, Any]:
    spread = {name: rms((sensed[name] - nu[:, index])[keep]) for index, name in enumerate(VELOCITY) if name in sensed}
    return {
        "segment": segment["id"],
        **settings,
        "accelerometer": found.convention,
        "gyro_bias_rad_s": [float(value) for value in motion.gyro_bias],
        "accel_bias_m_s2": None if found.accel_bias is None else [float(value) for value in found.accel_bias],
        "integrated_sway_rms_m_s": found.sway_rms,
        "installation": found.installation,
        "rms": spread,
        "warnings": list(found.warnings),
    }


def fuse_section(
    segment: Document, raw: pa.Table, motion: Motion, sensed: Mapping[str, Array], nu: Array, pose: Array, keep: Mask, fusion: Document
) -> dict[str, Any]:
    t = motion.t_s + float(segment["leg_start_s"])
    panels = []
    for index, (name, label, unit) in enumerate(zip(VELOCITY, "uvwpqr", ["m/s"] * 3 + ["rad/s"] * 3, strict=True)):
        lines = [series("raw", t, sensed[name], "raw")] if name in sensed else []
        panels.append(panel(label, unit, [*lines, series("fused", t[keep], nu[keep, index], "fused")]))
    attitude = [
        panel(label, "rad", [series("raw", t, matrix(raw, (column,))[:, 0], "raw"), series("fused", t[keep], pose[keep, index], "fused")])
        for index, label, column in ((3, "phi", "phi_rad"), (4, "theta", "theta_rad"), (5, "psi", "psi_rad"), (2, "z", "z_m"))
    ]
    for item in attitude[3:]:
        item["unit"] = "m"
    rows = [[name.split("_")[0], value, "m/s" if name in VELOCITY[:3] else "rad/s"] for name, value in fusion["rms"].items()]
    biases = [["gyro " + axis, value, "rad/s"] for axis, value in zip("xyz", fusion["gyro_bias_rad_s"] or [], strict=False)]
    biases += [["accelerometer " + axis, value, "m/s^2"] for axis, value in zip("xyz", fusion["accel_bias_m_s2"] or [], strict=False)]
    blocks = [remark(words, "warning") for words in fusion["warnings"]]
    blocks += [
        plot(
            "Velocity of the body origin, raw against fused",
            panels,
            group="time",
            look_for="The fused line follows the raw one without lag; what it leaves out looks like noise.",
        ),
        plot("Attitude and depth", attitude, group="time"),
        table("Biases", ["channel", "value", "unit"], biases),
        table("RMS of raw minus fused", ["channel", "RMS", "unit"], rows, note="It holds the lever arm and the bias too."),
    ]
    return section(f"State of {segment['id']} ({fusion['method']})", blocks, order=30)


def fuse_views() -> dict[str, Any]:
    groups = []
    for entity, names, unit in (
        ("state/velocity", VELOCITY[:3], "m/s"),
        ("state/rates", VELOCITY[3:], "rad/s"),
        ("state/attitude", ATTITUDE, "rad"),
    ):
        symbols = [name.split("_")[0] for name in names]
        for table_name, role in (("resampled", "raw"), ("fused", "fused")):
            groups.append(
                {
                    "entity": f"{entity}/{role}",
                    "table": table_name,
                    "columns": list(names),
                    "names": [f"{symbol} {role}" for symbol in symbols],
                    "roles": [role] * 3,
                    "tab": "State",
                    "unit": unit,
                }
            )
    return {"groups": groups}
