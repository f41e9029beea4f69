"""The picture of the answer: measured against predicted forces, and free runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from auvid.hydro.arrays import Array
from auvid.stages.number_format import visible
from auvid.stages.page.pictures.drawing import (
    SVG,
    X_STEPS,
    Y_STEPS,
    CurveRow,
    Span,
    curve_row,
    figure,
    grid,
    ink_variable,
    legend,
    limits_of,
    time_axis,
)
from auvid.stages.page.pictures.svg_plots import ticks

CELLS = 56
"""Cells of a box along each axis; a cell that holds a sample is drawn once."""


@dataclass(frozen=True)
class ForceCloud:
    """Measured and predicted samples (n,) of one axis, and its J/J0."""

    label: str
    unit: str
    measured: Array
    predicted: Array
    ratio: float | None = None


def answer_picture(
    model: str,
    role: str,
    clouds: Sequence[ForceCloud],
    runs: Sequence[CurveRow],
    *,
    judged_on: str,
    span: Span,
    clock: str = "time in s",
) -> Markup:
    """Return the picture of a model's answer on the legs that it is judged on.

    `role` colours the model. `runs`: rows with the measured state and the free run over
    it, over times `span` in s; none where there is no free run.
    """
    boxes = Markup('<div class="boxes n{}">{}</div>').format(
        len(clouds), Markup("").join(_box(cloud, role) for cloud in clouds)
    )
    note = f"{model} on the {judged_on} legs: force predicted (up) against measured (across)"
    if any(cloud.ratio is not None for cloud in clouds):
        note += " with its J/J₀"
    entries = [(model, role, True)]
    rows = Markup("")
    if runs:
        note += "; free run over what was measured"
        entries = [("measured", "measured", False), (model, role, False)]
        rows = Markup('<div class="rows">{}{}</div>').format(
            Markup("").join(curve_row(row, span) for row in runs), time_axis(span, clock)
        )
    body = Markup('<div class="split{}">{}{}</div>').format("" if runs else " single", boxes, rows)
    return figure("answer-picture", "The answer", note, legend(entries), body)


def cloud_picture(title: str, note: str, clouds: Sequence[ForceCloud]) -> Markup:
    """Return measured against predicted signals, a box for each."""
    boxes = Markup('<div class="boxes n{}">{}</div>').format(
        len(clouds), Markup("").join(_box(cloud, "predicted") for cloud in clouds)
    )
    body = Markup('<div class="split single">{}</div>').format(boxes)
    return figure("answer-picture", title, note, Markup(""), body)


def _box(cloud: ForceCloud, role: str) -> Markup:
    """Return one box of measured against predicted, both over the same range."""
    low, high = limits_of([cloud.measured])
    room = 0.35 * (high - low)
    near, far = limits_of([cloud.measured, cloud.predicted])
    low, high = max(near, low - room), min(far, high + room)
    marks = ticks(low, high, 3)
    upward = ticks(low, high, 3, upward=True)
    few, many, beyond = dots(cloud.measured, cloud.predicted, (low, high))
    words = f"{cloud.label}: predicted against measured"
    words += f" in {cloud.unit}" if cloud.unit else ""
    ratio = "" if cloud.ratio is None else f"{cloud.ratio:.2f}"
    if beyond:
        words += f"; {beyond} of the samples are predicted beyond the edges"
    drawing = SVG.format(
        X_STEPS,
        Y_STEPS,
        visible(words),
        grid(upward, marks)
        + Markup(
            '<path class="equal" d="M0 {}L{} 0"/><path class="dots few" style="--c:var({})"'
            ' d="{}"/><path class="dots" style="--c:var({})" d="{}"/>'
        ).format(Y_STEPS, X_STEPS, ink_variable(role), few, ink_variable(role), many),
    )
    labels = Markup("").join(
        Markup('<span style="left:{}%">{}</span>').format(mark.percent, mark.label)
        for mark in marks
    )
    return Markup(
        '<div class="box"><div class="name"><span><b>{}</b> <span class="unit">{}</span></span>'
        '<span class="ratio" title="J/J₀">{}</span></div><div class="draw">{}</div>'
        '<div class="foot"><div>{}</div></div></div>'
    ).format(visible(cloud.label), cloud.unit, ratio, drawing, labels)


def dots(measured: Array, predicted: Array, limits: Span) -> tuple[str, str, str]:
    """Return paths of the cells with few and with many samples, and the share outside.

    Every sample is in a cell, so that none is dropped; those outside stand at the edge.
    The share is empty where all are inside.
    """
    good = np.isfinite(measured) & np.isfinite(predicted)
    low, high = limits

    def cell(values: Array) -> npt.NDArray[np.int64]:
        share = (values[good] - low) / (high - low)
        return np.clip(np.floor(share * CELLS), 0, CELLS - 1).astype(np.int64)

    across, up = cell(measured), cell(predicted)
    outside = np.mean((predicted[good] < low) | (predicted[good] > high)) if good.any() else 0.0
    places, counts = np.unique(across * CELLS + up, return_counts=True)
    usual = np.median(counts) if counts.size else 0.0
    paths = []
    for chosen in (counts <= usual, counts > usual):
        x, y = np.divmod(places[chosen], CELLS)
        columns = ((x + 0.5) * X_STEPS / CELLS).astype(np.int64)
        rows = ((CELLS - 0.5 - y) * Y_STEPS / CELLS).astype(np.int64)
        paths.append(
            "".join(f"M{a} {b}h0" for a, b in zip(columns.tolist(), rows.tolist(), strict=True))
        )
    share = f"{100 * outside:.2g} %" if outside > 0 else ""
    return paths[0], paths[1], share
