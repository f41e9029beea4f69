"""Rows and boxes of a small picture: SVG that stretches, with labels that do not.

A row or box is an SVG of `X_STEPS` by `Y_STEPS` steps without a fixed aspect; its lines
keep their width at any size. Labels stand beside it as text of the page, so they stay
readable on a phone. Colours are CSS variables of the page. Samples are thinned to the
extremes of each bin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from auvid.hydro.arrays import Array, runs_of
from auvid.stages.number_format import visible
from auvid.stages.page.colours import key
from auvid.stages.page.pictures.svg_plots import Tick, ticks
from auvid.stages.presentation import thin

X_STEPS, Y_STEPS = 1000, 400
LINE_POINTS = 500
"""Most points of one line over the whole width."""
Span = tuple[float, float]
SVG = Markup(
    '<svg viewBox="0 0 {} {}" preserveAspectRatio="none" role="img"><title>{}</title>{}</svg>'
)
LINE = Markup('<path class="line{}" style="--c:var({})" d="{}"/>')
GRID = Markup('<path class="grid" d="{}"/>')
SWATCH = Markup('<li><i style="--c:var({})"{}></i>{}</li>')


@dataclass(frozen=True)
class SignalCurve:
    """One line of a row: samples y (n,) at x (n,), and the role that colours it.

    A gap is a sample of nan. `thin` draws it lighter, behind what it is held against.
    """

    role: str
    x: Array
    y: Array
    thin: bool = False


@dataclass(frozen=True)
class CurveRow:
    """Curves over one y-axis: name, unit, and whether it counts downwards."""

    label: str
    unit: str
    curves: tuple[SignalCurve, ...]
    downwards: bool = False
    height: str = "normal"
    """`tall`, `normal` or `small`: a class of the style sheet."""


def ink_variable(role: str) -> str:
    """Return the CSS variable of a role's colour."""
    return f"--ink-{key(role) or 'none'}"


def legend(entries: Sequence[tuple[str, str, bool]]) -> Markup:
    """Return a legend of (name, role, whether it is an area)."""
    return Markup('<ul class="key">{}</ul>').format(
        Markup("").join(
            SWATCH.format(
                ink_variable(role), Markup(' class="patch"' if area else ""), visible(name)
            )
            for name, role, area in entries
        )
    )


def figure(kind: str, title: str, note: str, key_: Markup, body: Markup) -> Markup:
    """Return a picture of a class `kind` with its caption and legend."""
    return Markup(
        '<figure class="picture {}"><figcaption><strong>{}</strong> <span class="note">{}</span>{}'
        "</figcaption>{}</figure>"
    ).format(kind, visible(title), visible(note), key_, body)


def curve_row(row: CurveRow, span: Span) -> Markup:
    """Return one row of curves over x in `span`."""
    low, high = limits_of([curve.y for curve in row.curves])
    bottom, top = (high, low) if row.downwards else (low, high)
    marks = ticks(low, high, 3 if row.height == "tall" else 2, upward=not row.downwards)
    if row.height != "tall":
        marks = marks[:: len(marks) - 1]  # a row of 32 px has room for two labels
    lines = Markup("").join(
        LINE.format(
            " soft" if curve.thin else "",
            ink_variable(curve.role),
            polyline(curve.x, curve.y, span, (bottom, top)),
        )
        for curve in row.curves
    )
    words = f"{row.label} in {row.unit} over time" if row.unit else f"{row.label} over time"
    drawing = SVG.format(X_STEPS, Y_STEPS, visible(words), grid(marks) + lines)
    return area_row(row.label, row.unit, marks, drawing, row.height)


def area_row(
    label: str, unit: str, marks: Sequence[Tick], drawing: Markup, height: str = "normal"
) -> Markup:
    """Return a row: name and unit, labels of the y-axis, and the drawing."""
    words = Markup('<b>{}</b> <span class="unit">{}</span>').format(visible(label), unit)
    labels = Markup("").join(
        Markup('<span style="top:{}%">{}</span>').format(mark.percent, mark.label) for mark in marks
    )
    return Markup(
        '<div class="row {}"><div class="name">{}</div><div class="side">{}</div>'
        '<div class="draw">{}</div></div>'
    ).format(height, words, labels, drawing)


def time_axis(span: Span, words: str = "time in s") -> Markup:
    """Return the axis below rows that share their x."""
    labels = Markup("").join(
        Markup('<span style="left:{}%">{}</span>').format(mark.percent, mark.label)
        for mark in ticks(*span, 6)
    )
    return Markup('<div class="foot"><div>{}</div><p>{}</p></div>').format(labels, words)


def grid(marks: Sequence[Tick], across: Sequence[Tick] = ()) -> Markup:
    """Return the lines of the grid at ticks of the y-axis and of the x-axis."""
    rows = "".join(f"M0 {mark.percent * Y_STEPS / 100:.0f}H{X_STEPS}" for mark in marks)
    columns = "".join(f"M{mark.percent * X_STEPS / 100:.0f} 0V{Y_STEPS}" for mark in across)
    return GRID.format(rows + columns)


def limits_of(signals: Sequence[Array], room: float = 0.06) -> Span:
    """Return the range of finite values with room on either side.

    >>> limits_of([np.array([0.0, 1.0, np.nan])], room=0.1)
    (-0.1, 1.1)
    """
    values = np.concatenate([y[np.isfinite(y)] for y in signals] or [np.zeros(0)])
    if not values.size:
        return -1.0, 1.0
    low, high = float(values.min()), float(values.max())
    more = room * (high - low) if high > low else max(0.1 * abs(high), 1e-3)
    return low - more, high + more


def polyline(x: Array, y: Array, span: Span, limits: Span) -> str:
    """Return the path of a line in steps, thinned to the extremes of each bin.

    span: x at the left and the right; limits: y at the bottom and at the top. `LINE_POINTS`
    are for the whole width; a run of samples gets its share.
    """
    good = np.isfinite(x) & np.isfinite(y)
    parts = []
    for first, end in runs_of(good):
        run = slice(first, end)
        share = (x[run][-1] - x[run][0]) / (span[1] - span[0])
        kept = thin(x[run], y[run], max(8, 2 * int(LINE_POINTS * share / 2)))
        parts.append(steps_path(*to_steps(*kept, span, limits)))
    return "".join(parts)


def to_steps(
    x: Array, y: Array, span: Span, limits: Span
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return places in steps; what lies far outside is held at twice the height."""
    across = np.rint((x - span[0]) / (span[1] - span[0]) * X_STEPS)
    down = np.rint((limits[1] - y) / (limits[1] - limits[0]) * Y_STEPS)
    return across.astype(np.int64), np.clip(down, -Y_STEPS, 2 * Y_STEPS).astype(np.int64)


def steps_path(x: npt.NDArray[np.int64], y: npt.NDArray[np.int64]) -> str:
    """Return `M x y l dx dy ...` without steps that stay in place."""
    moved = np.append(True, (np.diff(x) != 0) | (np.diff(y) != 0))
    x, y = x[moved], y[moved]
    if x.size == 1:
        return f"M{x[0]} {y[0]}h0"
    steps = np.column_stack([np.diff(x), np.diff(y)]).ravel().tolist()
    return f"M{x[0]} {y[0]}l" + " ".join(map(str, steps)).replace(" -", "-")
