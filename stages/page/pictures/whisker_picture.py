"""A picture of figures of several runs: a dot and whiskers for each, run over run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from auvid.stages.number_format import number, printed_unit, symbols, visible
from auvid.stages.page.pictures.drawing import (
    SVG,
    X_STEPS,
    Y_STEPS,
    figure,
    grid,
    ink_variable,
    legend,
    limits_of,
)
from auvid.stages.page.pictures.svg_plots import ticks

RUN_ROLES = (
    "training",
    "validation",
    "y",
    "true",
    "difference",
    "resampled",
    "uncoupled",
    "raw",
)
"""Roles whose colours tell runs apart, in their order; blue, vermillion, green, ..."""


@dataclass(frozen=True)
class Whiskers:
    """One run's value with half of its 95 % interval.

    `noise`: the half width by noise alone, where the interval holds more.
    """

    value: float
    half: float
    noise: float | None = None


@dataclass(frozen=True)
class WhiskerBox:
    """One figure by name and unit; a value per run, None where the run has none."""

    label: str
    unit: str
    runs: tuple[Whiskers | None, ...]


def whisker_picture(
    title: str, note: str, runs: Sequence[str], boxes: Sequence[WhiskerBox]
) -> Markup:
    """Return a box per figure over its own range, with zero where it is near."""
    entries = [(name, _role(place), False) for place, name in enumerate(runs)]
    body = Markup('<div class="boxes whiskers" style="--n:{}">{}</div>').format(
        len(runs), Markup("").join(_box(box, runs) for box in boxes)
    )
    return figure("wide", title, note, legend(entries), body)


def _role(place: int) -> str:
    return RUN_ROLES[place % len(RUN_ROLES)]


def _box(box: WhiskerBox, runs: Sequence[str]) -> Markup:
    ends = [
        value
        for item in box.runs
        if item is not None
        for value in (item.value - item.half, item.value + item.half)
    ]
    low, high = limits_of([np.array(ends)])
    marks = ticks(low, high, 3)
    lines = [grid((), marks)]
    if low < 0.0 < high:
        at = round(-low / (high - low) * X_STEPS)
        lines.append(Markup('<path class="equal" d="M{} 0V{}"/>').format(at, Y_STEPS))
    words = [f"{box.label} in {box.unit or '1'}"]
    for place, (item, name) in enumerate(zip(box.runs, runs, strict=True)):
        if item is None:
            words.append(f"{name}: none")
            continue
        words.append(f"{name}: {number(item.value)} ± {number(item.half)}")
        y = round((place + 0.5) / len(runs) * Y_STEPS)

        def across(value: float) -> int:
            return round((value - low) / (high - low) * X_STEPS)

        whisker = "M{} {}H{}"
        spans = [("whisker", item.half)]
        spans += [("whisker thick", item.noise)] if item.noise is not None else []
        for kind, half in spans:
            lines.append(
                Markup('<path class="{}" style="--c:var({})" d="{}"/>').format(
                    kind,
                    ink_variable(_role(place)),
                    whisker.format(across(item.value - half), y, across(item.value + half)),
                )
            )
        lines.append(
            Markup('<path class="dot" style="--c:var({})" d="M{} {}h0"/>').format(
                ink_variable(_role(place)), across(item.value), y
            )
        )
    drawing = SVG.format(X_STEPS, Y_STEPS, visible("; ".join(words)), Markup("").join(lines))
    labels = Markup("").join(
        Markup('<span style="left:{}%">{}</span>').format(mark.percent, mark.label)
        for mark in marks
    )
    return Markup(
        '<div class="box"><div class="name"><span><b>{}</b> <span class="unit">{}</span></span>'
        '</div><div class="draw">{}</div><div class="foot"><div>{}</div></div></div>'
    ).format(symbols(box.label), printed_unit(box.unit), drawing, labels)
