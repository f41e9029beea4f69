"""Dives of each vehicle over time: their state, and how many warnings they have."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from markupsafe import Markup

from auvid.stages.number_format import visible
from auvid.stages.page.pictures.drawing import (
    SVG,
    X_STEPS,
    Y_STEPS,
    area_row,
    figure,
    grid,
    ink_variable,
    legend,
)
from auvid.stages.page.pictures.svg_plots import ticks

ROLES = {"done": "true", "partly": "validation", "refused": "raw"}
"""State -> role of its colour."""
MOST_VEHICLES = 8
LABELS = 4
"""Dates beneath the picture: on a phone more would touch."""
LEAST_SPAN_S = 86_400.0
ROOM = 0.03
"""Of the span, left free at both ends."""


def time_picture(runs: Sequence[Mapping[str, Any]]) -> Iterator[Markup]:
    """Yield a row per vehicle: a dot per dive at its day, as high as its findings.

    `runs`: rows of table `runs`. Dives without a clock have no place in it.
    """
    by_vehicle: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for row in runs:
        if row["start_utc"] and row["vehicle"] and not row["same_as"]:
            by_vehicle[row["vehicle"]].append(row)
    times = [_seconds(row) for rows in by_vehicle.values() for row in rows]
    if len(times) < 2:
        return
    span = max(max(times) - min(times), LEAST_SPAN_S)
    low, high = min(times) - ROOM * span, min(times) + (1.0 + ROOM) * span
    rows = [
        _row(vehicle, by_vehicle[vehicle], low, high)
        for vehicle in sorted(by_vehicle, key=lambda name: -len(by_vehicle[name]))[:MOST_VEHICLES]
    ]
    marks = [(place + 0.5) / LABELS for place in range(LABELS)]
    dates = Markup("").join(
        Markup('<span style="left:{:.1f}%">{}</span>').format(100.0 * at, _date(low, high, at))
        for at in marks
    )
    body = Markup("").join(rows) + Markup(
        '<div class="foot"><div>{}</div><p>start of the dive</p></div>'
    ).format(dates)
    missing = sum(not row["start_utc"] for row in runs)
    note = "a dot per dive, as high as its errors and warnings"
    if missing:
        note += f"; {missing} logs without a clock are left out"
    key = legend([(state, role, False) for state, role in ROLES.items()])
    yield figure("wide", "Vehicles and findings over time", note, key, body)


def _row(vehicle: str, rows: Sequence[Mapping[str, Any]], low: float, high: float) -> Markup:
    top = 1.15 * max(3, *(row["errors"] + row["warnings"] for row in rows))
    lines = [grid(marks := ticks(0.0, top, 2, upward=True))]
    for row in rows:
        x = round((_seconds(row) - low) / (high - low) * X_STEPS)
        y = round(Y_STEPS * (1.0 - (row["errors"] + row["warnings"]) / top))
        lines.append(
            Markup('<path class="dot" style="--c:var({})" d="M{} {}h0"/>').format(
                ink_variable(ROLES[row["state"]]), x, y
            )
        )
    words = f"{vehicle}: findings of {len(rows)} dives over time"
    drawing = SVG.format(X_STEPS, Y_STEPS, visible(words), Markup("").join(lines))
    return area_row(vehicle, "findings", marks, drawing)


def _seconds(row: Mapping[str, Any]) -> float:
    return datetime.fromisoformat(row["start_utc"]).timestamp()


def _date(low: float, high: float, share: float) -> str:
    return datetime.fromtimestamp(low + share * (high - low), UTC).strftime("%Y-%m-%d")
