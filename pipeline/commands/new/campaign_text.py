"""The text of a written campaign: comments say what to check, in order."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from auvid.hydro.identification.selection.leg_proposal import (
    SHORTEST_LEG_S,
    LegProposal,
    ProposedLeg,
)
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS
from auvid.stages.ingest.health.finding import CheckedLog, listed
from auvid.stages.ingest.health.leg_pieces import modes_between

WIDTH = 88


@dataclass(frozen=True)
class WrittenFile:
    """A file of a log in the campaign: its place, and that of its column map."""

    file: str
    columns: str | None = None


@dataclass(frozen=True)
class CampaignContent:
    """What a campaign.yaml is written from."""

    kind: str
    title: str
    vehicle_name: str
    vehicle_why: str
    logs: Mapping[str, Sequence[WrittenFile]]
    checked: Mapping[str, CheckedLog]
    proposal: LegProposal
    stages: Mapping[str, str]
    """Stage -> its parameters, as YAML in one line."""
    remarks: Sequence[str] = field(default_factory=tuple)
    """What a reader should know of the data, as sentences."""
    shelf: str = ""
    """Beginning of the names of published vehicles to judge on this dive."""


def campaign_text(content: CampaignContent) -> str:
    """Return campaign.yaml."""
    lines = [
        *_comment(
            "Written by `auvid new campaign`. What no log tells stands behind `# check:`; read"
            " those first, from top to bottom."
        ),
        f"kind: {content.kind}",
        f"title: {_text(content.title)}  # check: one line for the report",
    ]
    if content.remarks:
        lines.append("notes: >-")
        lines += _wrapped(" ".join(content.remarks), "  ")
    lines += [
        "",
        *_comment(f"check: {content.vehicle_name}, {content.vehicle_why}; figures in the file."),
        "vehicle: vehicle.yaml",
        *(
            [f'shelf: ["{content.shelf.split("_")[0]}_*"]  # published sets, judged on this dive']
            if content.shelf
            else []
        ),
        "",
        "logs:",
        *_logs(content),
        "",
        *_leg_comment(content),
        "legs:  # seconds from the log's first time-stamped record",
        *_legs(content),
    ]
    if content.stages:
        lines += ["", "stages:  # only what differs from the defaults: auvid stages"]
        lines += [f"  {name}: {params}" for name, params in content.stages.items()]
    return "\n".join(lines) + "\n"


def _logs(content: CampaignContent) -> list[str]:
    lines = []
    for name, files in content.logs.items():
        entries = [
            ", ".join(
                [
                    f"file: {_text(item.file)}",
                    *([f"columns: {_text(item.columns)}"] if item.columns else []),
                ]
            )
            for item in files
        ]
        if len(entries) == 1:
            lines.append(f"  - {{id: {_text(name)}, {entries[0]}}}")
        else:
            lines += [f"  - id: {_text(name)}", "    files:"]
            lines += [f"      - {{{entry}}}" for entry in entries]
    return lines


def _leg_comment(content: CampaignContent) -> list[str]:
    text = (
        "check: proposed where the vehicle moves under its own thrust, armed and submerged, with"
        " every sensor there. Take out what the model does not hold: a taut tether, walls, the"
        " bottom, cargo."
    )
    if content.kind == "axes":
        text = "check: whole logs; stage axis_record takes windows and says what it leaves out."
    if content.kind == "glide":
        text = "check: whole logs; stage glide takes settled glides and says what it leaves out."
    if content.kind == "passive":
        text = (
            "check: whole logs; stage passive finds tows, coasts and swings itself. A leg with a"
            " role (tow, coast, decay, drift) and a channel is taken as that from its start on."
        )
    if content.kind == "bench":
        text += " Each channel is fitted alone: best where the others rest."
    lines = _comment(text)
    if content.proposal.dropped_s:
        lines += _comment(f"In no leg: {dropped_words(content.proposal)}.")
    for use, axes in content.proposal.lacking.items():
        for how in dict.fromkeys(axes.values()):
            names = listed([MOTION_WORDS[axis] for axis, why in axes.items() if why == how])
            part = f"In {use} " if content.kind == "identification" else "Here "
            verb = how if " and " not in names else how.replace("moves", "move")
            verb = verb.replace("hardly moves", "hardly move") if " and " in names else verb
            lines += _comment(
                f"check: {part}{names} {verb}: linear and quadratic drag, or drag and a constant"
                " force, are hardly told apart."
                if "one way" in how
                else f"check: {part}{names} {verb}."
            )
    return lines


def dropped_words(proposal: LegProposal) -> str:
    """Return the moving time that is in no leg, and why, in words."""
    return f"{proposal.dropped_s:g} s that move, in stretches shorter than {SHORTEST_LEG_S:g} s"


def _legs(content: CampaignContent) -> list[str]:
    rows = []
    names = list(content.logs)
    counts: dict[str, int] = {}
    for leg in content.proposal.legs:
        log = names[leg.dive]
        name = MOTION_WORDS[leg.channel] if leg.channel else _short(leg.use)
        counts[name] = counts.get(name, 0) + 1
        rows.append((f"{name}_{counts[name]}", log, leg))
    several = {name for name, count in counts.items() if count > 1}
    lines = []
    for name, log, leg in rows:
        base = name.rsplit("_", 1)[0]
        use = f"channel: {MOTION_WORDS[leg.channel]}" if leg.channel else f"use: {leg.use}"
        entry = (
            f"  - {{id: {name if base in several else base}, log: {_text(log)},"
            f" start_s: {leg.start_s:g}, end_s: {leg.end_s:g}, {use}}}"
        )
        lines.append(f"{entry}  # {_about(leg, content.checked[log])}")
    return lines


def _short(use: str) -> str:
    return "train" if use == "training" else "check"


def _about(leg: ProposedLeg, log: CheckedLog) -> str:
    """Return what moves in a leg, and the modes flown, in words."""
    words = []
    if leg.both_ways:
        words.append(f"{', '.join(MOTION_WORDS[axis] for axis in leg.both_ways)} both ways")
    one_way = [MOTION_WORDS[axis] for axis in leg.excited if axis not in leg.both_ways]
    if one_way:
        words.append(f"{', '.join(one_way)} one way")
    modes = modes_between(log, leg.start_s, leg.end_s)
    if modes:
        words.append(f"mode{'s' * (len(modes) > 1)} {', '.join(modes)}")
    span_s = (int(log.info.end_us) - int(log.info.start_us)) / 1e6
    return "; ".join(words) or (
        "whole log" if leg.end_s - leg.start_s >= span_s else "small motion"
    )


def _text(text: str) -> str:
    """Return a text as YAML in one line, in quotes where it needs them."""
    safe = re.fullmatch(r"[A-Za-z_./][\w./ +-]*", text) and not text.endswith(" ")
    words = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
    return text if safe and text.lower() not in words else json.dumps(text, ensure_ascii=False)


def _comment(text: str) -> list[str]:
    return _wrapped(text, "# ")


def _wrapped(text: str, indent: str) -> list[str]:
    lines, line = [], indent.rstrip()
    for word in text.split():
        if len(line) + 1 + len(word) > WIDTH:
            lines.append(line)
            line = indent.rstrip() if indent.strip() else indent[:-1]
        line += f" {word}"
    return [*lines, line]
