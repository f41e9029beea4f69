"""Sections on the campaign's logs and legs, and on where the results come from.

They belong to no other stage.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from typing import Any

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Document
from auvid.stages.presentation import Block, remark, section, table

LEGS, LAST = 89, 1000
"""Logs and legs stand before the health of the logs, behind what was found; the
provenance is last.
"""


def legs_section(
    segments: Mapping[str, SegmentRecord], logs: Mapping[str, LogInfo]
) -> dict[str, Any]:
    """Logs with their files, and the segments that the legs gave."""
    files = [
        [
            name,
            item.name,
            item.format,
            item.size_bytes,
            item.status,
            log.vehicle,
        ]
        for name, log in logs.items()
        for item in log.files
    ]
    rows = [
        [
            name,
            item.use,
            item.log,
            item.leg_start_s,
            item.duration_s,
            item.samples,
            item.rate_hz,
            len(item.gaps),
        ]
        for name, item in segments.items()
    ]
    heads = (
        "segment",
        "use",
        "log",
        ("start", "s"),
        ("length", "s"),
        "samples",
        ("rate", "Hz"),
        "gaps",
    )
    blocks: list[Block] = [
        table("Logs", ["log", "file", "format", ("size", "bytes"), "status", "vehicle"], files),
    ]
    if rows:
        note = (
            "Start in seconds from the first time-stamped record of the log. Gaps split a leg into"
            " segments."
        )
        blocks.append(table("Segments", heads, rows, note=note))
    blocks += [remark(f"{name}: {words}") for name, item in logs.items() for words in item.notes]
    blocks += [
        remark(f"{name}: {words}", "warning")
        for name, item in segments.items()
        for words in item.notes
    ]
    blocks += [remark(words, "warning") for words in shared_data(segments)]
    return section(
        "Logs and legs",
        blocks,
        order=LEGS,
        look_for="Whether each file is whole, and how training and validation are parted.",
    )


def shared_data(segments: Mapping[str, SegmentRecord]) -> list[str]:
    """Return a sentence for each training and validation segment that overlap.

    They overlap where they cover the same stretch of a log.
    """
    sentences = []
    for one, first in segments.items():
        for other, second in segments.items():
            if first.log != second.log or (first.use, second.use) != (
                "training",
                "validation",
            ):
                continue
            spans = [
                (item.leg_start_s, item.leg_start_s + item.duration_s) for item in (first, second)
            ]
            shared = min(span[1] for span in spans) - max(span[0] for span in spans)
            if shared > 1.0 / first.rate_hz:
                words = (
                    f"Training segment {one} and validation segment {other} share {shared:.1f} s of"
                    f" log {first.log}"
                )
                sentences.append(f"{words}: validation there is on data that the models have seen.")
    return sentences


def provenance_section(
    provenance: Document, campaign: Document, cards: Mapping[str, ModelCard]
) -> dict[str, Any]:
    """Return the section on where the results come from.

    Hashes of what went in, every parameter in force, assumed figures, the source of
    each model form, and versions.
    """
    chosen = campaign.get("stages") or {}
    settings = [
        [
            stage,
            name,
            _setting(value),
            "campaign" if name in (chosen.get(stage) or {}) else "default",
        ]
        for stage, entry in provenance["stages"].items()
        for name, value in entry["parameters"].items()
    ]
    files = [
        [log, item["name"], item["content"]]
        for log, items in provenance["logs"].items()
        for item in items
    ]
    blocks: list[Block] = [
        table(
            "Logs that went in",
            ["log", "file", "content hash"],
            [*files, ["", "vehicle document", provenance["vehicle"]]],
        ),
        table("Parameters in force", ["stage", "parameter", "value", "set by"], settings),
    ]
    assumed = list(dict.fromkeys(str(item) for card in cards.values() for item in card.assumed))
    if assumed:
        blocks.append(
            table("Assumed figures of the vehicle", ["figure"], [[item] for item in assumed])
        )
    forms = [[card.title, card.n_bar, card.n_bar_declared, card.source] for card in cards.values()]
    blocks.append(
        table("Model forms", ["model", "terms fitted", "terms declared", "source"], forms)
    )
    codes = [[stage, entry["code"]] for stage, entry in provenance["stages"].items()]
    blocks.append(table("Code", ["stage", "hash of code and schemas"], codes))
    packages = [
        ["python", platform.python_version()],
        *([name, number] for name, number in provenance["packages"].items()),
    ]
    blocks.append(table("Versions", ["package", "version"], packages))
    return section("Provenance", blocks, order=LAST)


def vehicle_line(vehicle: Vehicle, *, with_mass: bool = True) -> str:
    """Return the vehicle in one line: its title, and its mass where it counts."""
    if not with_mass:
        return vehicle.title
    mass = vehicle.document.rigid_body.mass
    return f"{vehicle.title}, {mass.value:g} {mass.unit}{' (assumed)' if mass.assumed else ''}"


def _setting(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_setting(item)}" for key, item in value.items())
    return (
        {True: "true", False: "false", None: "null"}.get(value, str(value))
        if isinstance(value, bool | None)
        else str(value)
    )
