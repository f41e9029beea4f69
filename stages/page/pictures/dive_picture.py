"""The picture of the dive: track from above, depth with modes and legs, actuators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from auvid.hydro.arrays import Array, Ints, runs_of
from auvid.stages.number_format import number, visible
from auvid.stages.page.pictures.drawing import (
    SVG,
    X_STEPS,
    Y_STEPS,
    CurveRow,
    SignalCurve,
    Span,
    curve_row,
    figure,
    ink_variable,
    legend,
    steps_path,
    time_axis,
    to_steps,
)

TRACK_STEPS = 400
TRACK_POINTS = 700
"""Most points of the track of one leg, about."""
USE_BINS = 140
MOST_MODES = 60


@dataclass(frozen=True)
class DrawnLeg:
    """A leg on the picture's clock: times (n,) in s, place (n, 3) in m NED."""

    name: str
    use: str
    t_s: Array
    place: Array


@dataclass(frozen=True)
class ActuatorUse:
    """One actuator over all legs, in the order of the legs: values at their times.

    Of a long leg those that `largest_of_bins` leaves show the same.
    """

    label: str
    unit: str
    t_s: tuple[Array, ...]
    values: tuple[Array, ...]


def dive_picture(
    legs: Sequence[DrawnLeg],
    *,
    depth: tuple[Array, Array] | None = None,
    modes: Sequence[tuple[float, str]] = (),
    actuators: Sequence[ActuatorUse] = (),
    span: Span,
    clock: str = "time in s",
) -> Markup:
    """Return the picture of a dive over times `span` in s.

    `depth`: times and depth in m of the whole logs, legs or not. `modes`: when each
    begins. What there is nothing of is left out. `clock` names the time axis.
    """
    uses = list(dict.fromkeys(leg.use for leg in legs))
    outside = depth is not None and depth[0].size > 0
    entries = [(use, use, True) for use in uses]
    if outside:
        entries.append(("outside the legs", "raw", False))
    track = _track(legs)
    rows = Markup("").join(
        [_modes(modes, span), _lane(legs, span), _depth(legs, depth, span)]
        + ([_actuators(actuators, legs, span)] if actuators else [])
        + [time_axis(span, clock)]
    )
    drawn = [*(["track from above"] if track else []), "depth"]
    drawn += ["use of the actuators"] if actuators else []
    words = ", ".join(drawn)
    body = Markup('<div class="split{}">{}<div class="rows">{}</div></div>').format(
        "" if track else " single", track, rows
    )
    return figure("dive", "The dive", words, legend(entries), body)


def track_picture(title: str, tracks: Sequence[DrawnLeg]) -> Markup:
    """Return tracks from above alone, each in the colour of its use."""
    entries = [(leg.name, leg.use, False) for leg in tracks]
    body = Markup('<div class="split single">{}</div>').format(_track(tracks))
    return figure("dive", title, "", legend(entries), body)


def _track(legs: Sequence[DrawnLeg]) -> Markup:
    """Return the track from above with a grid in m, north up; empty without a place."""
    drawn = [leg for leg in legs if np.isfinite(leg.place[:, :2]).all(axis=1).any()]
    if not drawn:
        return Markup("")
    places = np.vstack([leg.place[:, :2] for leg in drawn])
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    size = 1.12 * max(float((high - low).max()), 1e-3)
    middle = (low + high) / 2.0
    step = round_step(size / 4.0)
    lines, marks = [], []
    for leg in drawn:
        # North is up: x (north) counts against the rows, y (east) along the columns.
        east = (leg.place[:, 1] - middle[1]) / size * TRACK_STEPS
        north = -(leg.place[:, 0] - middle[0]) / size * TRACK_STEPS
        path = "".join(_raster(east[run], north[run]) for run in _finite_runs(east, north))
        ink = ink_variable(leg.use)
        lines.append(Markup('<path class="line" style="--c:var({})" d="{}"/>').format(ink, path))
        first = int(np.flatnonzero(np.isfinite(east))[0])
        marks.append(
            Markup('<path class="start" style="--c:var({})" d="M{} {}h0"/>').format(
                ink, round(east[first]), round(north[first])
            )
        )
    cell = step / size * TRACK_STEPS
    at = [number_ * cell for number_ in range(-40, 41)]
    far = 40 * cell
    mesh = "".join(f"M{-far:.0f} {a:.1f}H{far:.0f}M{a:.1f} {-far:.0f}V{far:.0f}" for a in at)
    half = TRACK_STEPS / 2
    names = ", ".join(f"{leg.name} ({leg.use})" for leg in drawn)
    drawing = Markup(
        '<svg viewBox="{} {} {} {}" role="img"><title>{}</title><path class="grid" d="{}"/>{}</svg>'
    ).format(
        -half, -half, TRACK_STEPS, TRACK_STEPS,
        visible(f"Track from above, north up, grid of {number(step)} m: {names}"),
        mesh, Markup("").join([*lines, *marks]),
    )  # fmt: skip
    return Markup(
        '<div class="track"><div class="draw">{}</div><p>from above, <span>north ↑</span>,'
        " <span>grid {} m</span>, <span>● start</span></p></div>"
    ).format(drawing, number(step))


def round_step(size: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most `size`.

    >>> [round_step(size) for size in [3.4, 51.0]]
    [2.0, 50.0]
    """
    power = 10.0 ** np.floor(np.log10(size))
    return float(max(m * power for m in (1.0, 2.0, 5.0) if m * power <= size * (1 + 1e-9)))


def _finite_runs(x: Array, y: Array) -> list[slice]:
    return [slice(*run) for run in runs_of(np.isfinite(x) & np.isfinite(y))]


def _raster(x: Array, y: Array) -> str:
    """Return a path of at most about `TRACK_POINTS` points on the raster of the track.

    One point is kept for each equal length of the way, so a long track keeps its curves.
    """
    across, down = np.rint(x).astype(np.int64), np.rint(y).astype(np.int64)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(across), np.diff(down)))])
    places = np.floor(way / max(1.0, way[-1] / TRACK_POINTS))
    kept = np.flatnonzero(np.concatenate([[True], np.diff(places) > 0.0]))
    kept = np.union1d(kept, len(across) - 1)
    return steps_path(across[kept], down[kept])


def _percent(time: float, span: Span) -> float:
    return round(100.0 * (time - span[0]) / (span[1] - span[0]), 2)


def _modes(modes: Sequence[tuple[float, str]], span: Span) -> Markup:
    """Return the lane of flight modes; empty where the log has none or too many."""
    kept = [
        (time, mode)
        for place, (time, mode) in enumerate(modes)
        if place == 0 or modes[place - 1][1] != mode
    ]
    if not kept or len(kept) > MOST_MODES:
        return Markup("")
    ends = [time for time, _ in kept[1:]] + [span[1]]
    parts = [
        (max(time, span[0]), min(end, span[1]), mode, "")
        for (time, mode), end in zip(kept, ends, strict=True)
        if end > span[0] and time < span[1]
    ]
    return _blocks("mode", parts, span)


def _lane(legs: Sequence[DrawnLeg], span: Span) -> Markup:
    parts = [
        (float(leg.t_s[0]), float(leg.t_s[-1]), leg.name, f"--c:var({ink_variable(leg.use)});")
        for leg in legs
        if leg.t_s.size
    ]
    return _blocks("leg", parts, span)


def _blocks(name: str, parts: Sequence[tuple[float, float, str, str]], span: Span) -> Markup:
    cells = Markup("").join(
        Markup('<span style="{}left:{}%;width:{}%" title="{}">{}</span>').format(
            style,
            _percent(start, span),
            round(_percent(end, span) - _percent(start, span), 2),
            visible(words),
            visible(words),
        )
        for start, end, words, style in parts
    )
    return Markup('<div class="lane {}"><div class="name">{}</div><div>{}</div></div>').format(
        name, name, cells
    )


def _depth(legs: Sequence[DrawnLeg], depth: tuple[Array, Array] | None, span: Span) -> Markup:
    curves = [] if depth is None else [SignalCurve("raw", *depth, thin=True)]
    curves += [SignalCurve(leg.use, leg.t_s, leg.place[:, 2]) for leg in legs]
    if not any(np.isfinite(curve.y).any() for curve in curves):
        return Markup("")
    row = CurveRow("depth", "m", tuple(curves), downwards=True, height="tall")
    return curve_row(row, span)


def _actuators(uses: Sequence[ActuatorUse], legs: Sequence[DrawnLeg], span: Span) -> Markup:
    """Return a strip per actuator: the largest size of its value in each bin of time.

    Strips of one unit share their scale.
    """
    scales = {
        unit: max(_largest(use) for use in uses if use.unit == unit) or 1.0
        for unit in dict.fromkeys(use.unit for use in uses)
    }
    words = ", ".join(f"{number(float(f'{top:.2g}'))} {unit}" for unit, top in scales.items())
    strips = []
    for use in uses:
        shapes = Markup("").join(
            Markup('<path class="fill" style="--c:var({})" d="{}"/>').format(
                ink_variable(leg.use), _bars(t_s, values, span, scales[use.unit])
            )
            for leg, t_s, values in zip(legs, use.t_s, use.values, strict=True)
        )
        title = visible(f"{use.label}: size in {use.unit} over time, largest of each bin")
        drawing = SVG.format(X_STEPS, Y_STEPS, title, shapes)
        strips.append(
            Markup(
                '<div class="strip"><div class="name">{}</div><div class="draw">{}</div></div>'
            ).format(visible(use.label), drawing)
        )
    return Markup(
        '<div class="strips"><div class="name"><b>use of the actuators</b> <span class="unit">full'
        " height {}</span></div>{}</div>"
    ).format(words, Markup("").join(strips))


def _largest(use: ActuatorUse) -> float:
    return max(float(np.nanmax(np.abs(part), initial=0.0)) for part in use.values)


def largest_of_bins(t_s: Array, values: Array, span: Span) -> tuple[Array, Array]:
    """Return the first time and the largest size in each bin of a strip over `span`."""
    good = np.isfinite(values)
    t_s, sizes = t_s[good], np.abs(values[good])
    starts = np.flatnonzero(np.append(True, np.diff(_bins(t_s, span)) > 0)[: t_s.size])
    return t_s[starts], np.maximum.reduceat(sizes, starts) if starts.size else sizes


def _bins(t_s: Array, span: Span) -> Ints:
    return ((t_s - span[0]) / _bin_width(span)).astype(np.int64)


def _bin_width(span: Span) -> float:
    return (span[1] - span[0]) / USE_BINS


def _bars(t_s: Array, values: Array, span: Span, top: float) -> str:
    """Return the outline of the largest size per bin of time, down to zero."""
    times, high = largest_of_bins(t_s, values, span)
    if not times.size:
        return ""
    width = _bin_width(span)
    left = span[0] + _bins(times, span) * width
    x = np.column_stack([left, left + width]).ravel()
    x = np.concatenate([x[:1], x, x[-1:]])
    y = np.concatenate([[0.0], np.repeat(high, 2), [0.0]])
    return steps_path(*to_steps(x, y, span, (0.0, top))) + "z"
