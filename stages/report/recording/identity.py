"""Id and typed properties of a recording, for a catalogue of many."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping

import auvid
from auvid.data_schemas.records.models import ModelCard
from auvid.stages.base import Document
from auvid.stages.model_use import damping_verdict
from auvid.stages.page.colours import key
from auvid.stages.page.first_screen import ALL, AXIS_WORDS, Summary

Property = str | int | float
ID_DIGITS = 12
SEVERITIES = ("error", "warning")
VERDICTS = (
    "identified",
    "weak",
    "not excited",
    "inseparable",
    "at its bound",
    "from the prior",
)


def recording_id(title: str, content: object) -> str:
    """Return an id that two recordings share only where title and content are the same.

    >>> recording_id("A dive", {"log": 1}) == recording_id("A dive", {"log": 2})
    False
    """
    words = json.dumps(content, sort_keys=True, default=str)
    digest = hashlib.sha256(f"{title}\n{words}".encode()).hexdigest()
    return f"{key(title)[:40] or 'campaign'}-{digest[:ID_DIGITS]}"


def log_properties(name: str, health: Document) -> dict[str, Property]:
    """Return the properties of a raw log: its length, and its findings by severity."""
    findings = Counter(str(item["severity"]) for item in health["findings"])
    return {
        "log": name,
        "vehicle": str(health.get("vehicle") or ""),
        "version": auvid.__version__,
        "status": str(health.get("status", "")),
        "duration_s": float(health.get("duration_s") or 0.0),
        **{f"count_{severity}": findings.get(severity, 0) for severity in SEVERITIES},
    }


def run_properties(
    title: str,
    vehicle: str,
    summary: Summary,
    cards: Mapping[str, ModelCard],
) -> dict[str, Property]:
    """Return the properties of a run, each of one type in all recordings.

    Counts of verdicts are those of the coefficients of the recommended model, or of the
    figures of a bench or a controller; `surge` ... `yaw` are the verdicts on their damping.
    What a run does not have is left out.
    """
    properties: dict[str, Property] = {
        "campaign": title,
        "vehicle": vehicle,
        "version": auvid.__version__,
        "headline": summary.headline,
    }
    best = next((m for m in summary.models if m.name == summary.recommended), None)
    if best is not None:
        properties["best_model"] = best.name
        for use in ("validation", "training"):
            ratio = getattr(best.axes[ALL], use)
            if ratio is not None:
                properties[f"ratio_{use}"] = float(ratio)
    card = cards.get(summary.recommended or "")
    if card is not None:
        verdicts = Counter[str](item.verdict for part in card.axes.values() for item in part.terms)
        for verdict in VERDICTS:
            properties[f"count_{key(verdict)}"] = verdicts.get(verdict, 0)
        for axis, word in AXIS_WORDS.items():
            properties[word] = damping_verdict(card, axis)
    elif summary.figures:
        counts = Counter(item.verdict for item in summary.figures if item.verdict)
        properties |= {f"count_{key(name)}": count for name, count in sorted(counts.items())}
    return properties
