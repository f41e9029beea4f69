"""What the findings of its logs decide for a run: go on, or stop before any fit."""

from __future__ import annotations

import filecmp
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auvid.data_schemas.checks import accepted_findings, checks, standing_findings
from auvid.data_schemas.errors import DataError
from auvid.pipeline.campaigns.campaign import Campaign, inside
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.commands.check.log_clocks import log_clocks
from auvid.stages.base import Document
from auvid.stages.ingest.health.usability import IDLE, NO_FORCE, NO_STATE, PASSIVE
from auvid.stages.ingest.health.vehicle import NEEDED

ACCELEROMETER = "accelerometer_"
"""How the findings begin that method `kinematic`, which takes no accelerometer, is
not concerned by.
"""
TOO_LATE = {
    1e8: "A time of day since 1970 is not meant: subtract the time of the first record.",
    1e4: "Milliseconds or a time of day? Divide, or subtract the time of the first record.",
}
"""Start of a leg beyond which it is probably of another clock or unit [s], and words."""
MOST_SEEN = 0.5
"""Share of a validation leg from which its being training data stops the run."""
ONE_CHANNEL = {"w": "heave", "r": "yaw"}
"""Channels that a log shows without a velocity sensor: depth rate and gyro."""


def refusal(
    campaign: Campaign,
    health: Mapping[str, Document],
    stages: Sequence[str],
    params: Mapping[str, Any],
) -> DataError | None:
    """Return why a run of these stages stops behind ingest, or None if it goes on.

    `health` by log; `params` by stage. One error holds all findings that stop the run,
    or else all that the logs lack.
    """
    method = str(params["fuse"].method) if "fuse" in params else ""
    forceless = "residual" in params and bool(params["residual"].allow_no_actuation)
    return (
        _stopped(campaign, health, method)
        or _outside(campaign, health, params)
        or _judged_by_training(campaign, health)
        or _starved(campaign, health, stages, method, forceless=forceless)
    )


def _stopped(campaign: Campaign, health: Mapping[str, Document], method: str) -> DataError | None:
    late = log_clocks(health)
    stopping = [
        (log, item)
        for log, document in health.items()
        for accepted in (accepted_findings(campaign.document, log),)
        for item in (*standing_findings(document, accepted), *late.get(log, ()))
        if checks()[item["id"]].stops
        and item["id"] not in accepted
        and not (method == "kinematic" and item["id"].startswith(ACCELEROMETER))
    ]
    if not stopping:
        return None
    names = list(dict.fromkeys(item["id"] for _, item in stopping))
    lines = [
        f"\n  log '{log}': {item['text']} ({item['id']})"
        f"\n    {item['remedy']}{_places(campaign, log, item)}"
        for log, item in stopping
    ]
    count = "a finding" if len(stopping) == 1 else f"{len(stopping)} findings"
    return DataError(
        f"{count} about units, signs, axes or clocks stopped the run:{''.join(lines)}\n"
        f"auvid check {campaign.name} shows all findings",
        file=campaign.file.path,
        remedy=(
            "Where the log is right, accept what was found, for the campaign or one log:"
            f" accept: [{', '.join(names)}]."
        ),
    )


def _outside(
    campaign: Campaign, health: Mapping[str, Document], params: Mapping[str, Any]
) -> DataError | None:
    """Return the legs behind the end of their log, or too short, all in one error."""
    least = float(params["resample"].min_segment_s) if "resample" in params else 0.0
    lines, remedies = [], []
    for name, leg in campaign.legs.items():
        length = float(health[leg["log"]]["duration_s"]) if leg["log"] in health else math.inf
        start = float(leg.get("start_s") or 0.0)
        took = float(length if leg.get("end_s") is None else leg["end_s"]) - start
        if start < length and took < least:
            lines.append(f"\n  leg '{name}' takes {took:.3g} s; {least:g} s are needed")
        if start < length:
            continue
        lines.append(
            f"\n  leg '{name}': start_s is {start:g}, log '{leg['log']}' has {length:.1f} s"
        )
        remedies += [words for low, words in TOO_LATE.items() if start > low][:1]
    if not lines:
        return None
    return DataError(
        f"legs that lie outside the log or are too short:{''.join(lines)}\n"
        f"auvid check {campaign.name} shows the log and what its legs cover",
        file=campaign.file.path,
        remedy=" ".join(
            dict.fromkeys(["start_s and end_s count seconds from the start of the log.", *remedies])
        ),
    )


def _judged_by_training(campaign: Campaign, health: Mapping[str, Document]) -> DataError | None:
    """Return validation legs that are training data by half or more, in one error."""
    lines = []
    for name, leg in campaign.legs.items():
        if leg.get("use") != "validation" or leg["log"] not in health:
            continue
        start, end = _span(leg, health)
        shared = {}
        for other, training in campaign.legs.items():
            if training.get("use") == "training" and _same_data(
                campaign, leg["log"], training["log"]
            ):
                first, last = _span(training, health)
                shared[other] = max(min(end, last) - max(start, first), 0.0)
        seconds = min(sum(shared.values()), end - start)
        if seconds >= MOST_SEEN * (end - start):
            most = max(shared, key=lambda other: shared[other])
            line = f"\n  leg '{name}' shares {seconds:.4g} s with training leg '{most}'"
            if campaign.legs[most]["log"] != leg["log"]:
                line += f": logs '{leg['log']}' and '{campaign.legs[most]['log']}' are one file"
            lines.append(line)
    if not lines:
        return None
    return DataError(
        f"validation on the data that the models are fitted to:{''.join(lines)}\n"
        "Any model passes there, and no error says how well it predicts",
        file=campaign.file.path,
        remedy="Give validation a stretch of its own, or a log of another dive.",
    )


def _span(leg: Mapping[str, Any], health: Mapping[str, Document]) -> tuple[float, float]:
    """Return start and end of a leg in seconds of its log."""
    length = float(health[leg["log"]]["duration_s"]) if leg["log"] in health else math.inf
    end = length if leg.get("end_s") is None else min(float(leg["end_s"]), length)
    return float(leg.get("start_s") or 0.0), end


def _same_data(campaign: Campaign, one: str, other: str) -> bool:
    """Return whether two logs are one: the same entry, or files of the same bytes."""
    if one == other:
        return True
    if campaign.twin is not None:
        return False
    pairs = list(itertools.zip_longest(_files(campaign, one), _files(campaign, other)))
    return all(
        a is not None
        and b is not None
        and a.is_file()
        and b.is_file()
        and filecmp.cmp(a, b, shallow=False)
        for a, b in pairs
    )


def _files(campaign: Campaign, log: str) -> list[Path]:
    entry = campaign.logs[log]
    return [
        inside(campaign.folder, file["file"], campaign.file.path)
        for file in entry.get("files") or [entry]
    ]


def _places(campaign: Campaign, log: str, item: Document) -> str:
    """Return where the column maps name what a finding is about: file and rows."""
    places = []
    entry = campaign.logs[log]
    for file in () if campaign.twin is not None else entry.get("files") or [entry]:
        if not file.get("columns"):
            continue
        map_file = load_yaml(inside(campaign.folder, file["columns"], campaign.file.path))
        rows = [
            map_file.line(f"columns[{index}]")
            for index, column in enumerate(map_file.value["columns"])
            if column["field"] in item["fields"]
        ]
        here = any(column["stream"] == item["stream"] for column in map_file.value["columns"])
        if "time_us" in item["fields"] and (here or item["stream"] is None):
            rows.append(map_file.line("time"))
        if rows:
            numbers = ", ".join(str(row) for row in rows)
            places.append(f"{file['columns']}, row{'s' * (len(rows) > 1)} {numbers}")
    return f" ({'; '.join(places)})" if places else ""


def _starved(
    campaign: Campaign,
    health: Mapping[str, Document],
    stages: Sequence[str],
    method: str,
    *,
    forceless: bool,
) -> DataError | None:
    """Return what the logs lack for the first stage that they cannot feed.

    `forceless`: stage residual goes on where no actuator acts.
    """
    named = {"resample": "resample", "fuse": f"fuse ({method})", "residual": "residual"}
    used = {leg["log"] for leg in campaign.legs.values()}
    feeds = {
        log: {item["name"]: item for item in document["capabilities"]}
        for log, document in health.items()
        if log in used
    }
    for position, stage in enumerate(stages):
        if stage not in named:
            continue
        reasons = {
            log: rows[named[stage]]["reason"]
            for log, rows in feeds.items()
            if not rows[named[stage]]["possible"]
        }
        idle = [log for log, why in reasons.items() if why == IDLE]
        if stage == "residual" and (forceless or len(idle) < len(feeds)):
            # A leg without a driven actuator is the stage's own decision.
            allowed = (IDLE, PASSIVE) if forceless else (IDLE,)
            reasons = {log: why for log, why in reasons.items() if why not in allowed}
        if reasons:
            fed = [name for name in stages[:position] if name in named]
            return _lacking(campaign, health, stage, reasons, fed)
    return None


def _lacking(
    campaign: Campaign,
    health: Mapping[str, Document],
    stage: str,
    reasons: Mapping[str, str],
    before: Sequence[str],
) -> DataError:
    logs: dict[str, list[str]] = {}
    for log, why in reasons.items():
        also = _also(health[log]) if stage != "residual" else None
        logs.setdefault("; ".join(filter(None, (why, also))), []).append(log)
    words = "; ".join(f"log {', '.join(map(repr, names))}: {why}" for why, names in logs.items())
    routes = []
    if before:
        routes.append(f"auvid run {campaign.name} --until {before[-1]} goes as far as the logs do.")
    first = health[next(iter(reasons))]
    if any(why == "no accelerometer" for why in reasons.values()):
        routes.append("stages.fuse.method: kinematic needs no accelerometer.")
    channels = [word for axis, word in ONE_CHANNEL.items() if first["excitation"][axis]["excited"]]
    if {IDLE, PASSIVE} & set(reasons.values()):
        routes.append(
            "stages.residual.allow_no_actuation: true goes on where nothing drives the vehicle"
            " (towed, gliding, drifting)."
        )
    if any(why.startswith("no ") and why.split()[1] in NEEDED for why in reasons.values()):
        maps = first["formats"] == ["CSV"]
        routes.append(
            "Columns of a CSV log reach a stream through its column map."
            if maps
            else "docs/streams.md lists the messages that fill a stream."
        )
    needs_velocity = any("no velocity" in why or "no newtons" in why for why in reasons.values())
    driven = "actuators" in first["streams"] and _also(first) not in (IDLE, PASSIVE)
    if needs_velocity and channels and driven:
        routes.append(
            f"Partial use: {' and '.join(channels)} only, which takes normalised commands too: in a"
            " campaign of kind axes, as auvid new campaign writes it (docs/axes.md),"
            f" or each from its own leg (channel: {channels[0]}) in one of kind bench"
            " (docs/bench.md)."
        )
    routes.append(f"auvid check {campaign.name} shows what each log can be used for.")
    return DataError(
        f"the logs cannot feed stage {stage}: {words}",
        file=campaign.file.path,
        remedy=" ".join(routes),
    )


def _also(document: Document) -> str | None:
    """Return why the same log could not feed the stage of forces either."""
    (row,) = (item for item in document["capabilities"] if item["name"] == "residual")
    return None if row["possible"] or row["reason"] in (NO_STATE, NO_FORCE) else row["reason"]
