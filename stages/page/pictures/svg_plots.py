"""Plots as markup that needs no script: panels of SVG paths, labels, legend buttons.

The samples live once, in the path itself: `M x y l dx dy dx dy ...` in whole steps, x
in `X_STEPS` steps of the plot's time range and y in `Y_STEPS` steps of the series' own
range, so a value is exact to 1/8000 of its range. Lines keep their width under any
scale (`vector-effect`), so plots.js zooms by changing `viewBox`, and reads values back
from the path. Colours are CSS variables: themes and print need no redrawing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.hydro.arrays import Array, runs_of
from auvid.stages.page.colours import Ink, ink, is_model, key

X_STEPS = 30_000
Y_STEPS = 4_000
PANEL_STEPS = 8_000
MARGIN = 0.06
MODELS_SHOWN = 3
MOST_ASPECT = 6.0
FAR = 20.0
"""Lines that reach further than this many ranges of the measured one are cut at the
axis.
"""
DOWNWARDS = ("depth", "z")
"""Labels of panels whose values grow downwards."""
PRINTED = {"tau_bar": "residual force τ̄"}
NO_TITLES: Mapping[str, str] = {}
NO_INKS: Mapping[str, Ink] = {}


@dataclass(frozen=True)
class Line:
    """One drawn series: legend entry, path, and the matrix that places its steps.

    A value is top - step * y.
    """

    entry: int
    path: str
    scale: float
    shift: float
    top: float
    step: float
    samples: int


@dataclass(frozen=True)
class Tick:
    """A label at `percent` of the axis (from the left, or from the top)."""

    percent: float
    label: str


@dataclass(frozen=True)
class LegendEntry:
    """One legend entry: name, ink variable, dash, width, whether lines are drawn."""

    name: str
    ink: str
    dash: str
    width: float
    is_drawn: bool


@dataclass(frozen=True)
class Panel:
    """One y-axis: label, unit, range, ticks and lines.

    `sign` is -1 where values grow downwards: range and lines are of their negatives.
    """

    label: str
    unit: str
    low: float
    high: float
    ticks: tuple[Tick, ...]
    lines: tuple[Line, ...]
    cut: tuple[str, ...] = ()
    """Names of the lines that leave it."""
    sign: int = 1


@dataclass(frozen=True)
class Plot:
    """Everything that the page needs to draw one plot."""

    title: str
    look_for: str
    group: str
    x_label: str
    x_unit: str
    low: float
    high: float
    ticks: tuple[Tick, ...]
    panels: tuple[Panel, ...]
    entries: tuple[LegendEntry, ...]

    @property
    def note(self) -> str:
        """Return what to look for, and which lines leave their panel."""
        cut = list(dict.fromkeys(name for panel in self.panels for name in panel.cut))
        return (
            f"{self.look_for} Beyond the axis: {', '.join(cut)}.".strip() if cut else self.look_for
        )

    @property
    def aspect(self) -> float:
        """Return width over height of a plot of place over place, with equal scales.

        0 for others, and for very long or flat ones.
        """
        if len(self.panels) != 1 or (self.x_unit, self.panels[0].unit) != ("m", "m"):
            return 0.0
        ratio = (self.high - self.low) / (self.panels[0].high - self.panels[0].low)
        return round(ratio, 4) if 1 / MOST_ASPECT <= ratio <= MOST_ASPECT else 0.0

    @property
    def hidden(self) -> int:
        """Return how many legend entries are not drawn at first."""
        return sum(not entry.is_drawn for entry in self.entries)


def lay_out(
    block: Mapping[str, Any],
    preferred: Sequence[str] = (),
    titles: Mapping[str, str] = NO_TITLES,
    clock: str = "",
    inks: Mapping[str, Ink] = NO_INKS,
) -> Plot:
    """Lay out a plot block.

    Of many models only `preferred` (best first) are drawn at first; the legend shows
    the others.

    `titles` are names as printed for lines that are named by a word of the code;
    `clock` keeps plots of another clock out of the group; `inks`: colours of roles that
    have none of their own, those of the whole page. A panel without a finite sample
    keeps its place, so that the reader sees that there was nothing.
    """
    panels = block["panels"]
    data = [[samples_of(series) for series in panel["series"]] for panel in panels]
    finite = [x[np.isfinite(x)] for lines in data for x, _ in lines]
    times = np.concatenate([x for x in finite if x.size] or [np.array([0.0, 1.0])])
    low, high = float(times.min()), float(times.max())
    high = high if high > low else low + 1.0
    entries = _entries(panels, preferred, titles, inks)
    return Plot(
        title=str(block.get("title", "")),
        look_for=str(block.get("look_for", "")),
        group=f"{clock} {block['group']}".strip() if block.get("group") else "",
        x_label=str(block["x"]["label"]),
        x_unit=str(block["x"]["unit"]),
        low=low,
        high=high,
        ticks=ticks(low, high, 7),
        panels=tuple(
            _panel(panel, lines, list(entries), entries, (low, high))
            for panel, lines in zip(panels, data, strict=True)
        ),
        entries=tuple(entries.values()),
    )


def samples_of(series: Mapping[str, Any]) -> tuple[Array, Array]:
    """Return the samples (n,) of a series, NaN for none."""
    x = np.array([np.nan if value is None else value for value in series["x"]], dtype=np.float64)
    y = np.array([np.nan if value is None else value for value in series["y"]], dtype=np.float64)
    return x, y


def _entries(
    panels: Sequence[Mapping[str, Any]],
    preferred: Sequence[str],
    titles: Mapping[str, str],
    inks: Mapping[str, Ink],
) -> dict[str, LegendEntry]:
    roles = {
        str(series["name"]): str(series["role"]) for panel in panels for series in panel["series"]
    }
    models = [role for role in dict.fromkeys(roles.values()) if is_model(role)]
    ranked = sorted(models, key=lambda role: _place(role, preferred))
    drawn_models = (
        {key(role) for role in ranked[:MODELS_SHOWN]}
        if len(models) > MODELS_SHOWN
        else {key(role) for role in models}
    )
    entries = {}
    for name, role in roles.items():
        drawn = inks.get(key(role)) or ink(role)
        visible = not is_model(role) or key(role) in drawn_models
        entries[name] = LegendEntry(
            name=titles.get(name, PRINTED.get(name, name)),
            ink=f"--ink-{key(role) or 'none'}",
            dash=drawn.dash,
            width=drawn.width,
            is_drawn=visible,
        )
    return entries


def _place(role: str, preferred: Sequence[str]) -> int:
    order = [key(name) for name in preferred]
    return order.index(key(role)) if key(role) in order else len(order)


def _panel(
    panel: Mapping[str, Any],
    data: Sequence[tuple[Array, Array]],
    names: list[str],
    entries: Mapping[str, LegendEntry],
    span: tuple[float, float],
) -> Panel:
    sign = -1 if panel["label"] in DOWNWARDS else 1
    data = [(x, sign * y) for x, y in data]
    drawn = [
        y
        for (_, y), series in zip(data, panel["series"], strict=True)
        if entries[str(series["name"])].is_drawn
    ]
    roles = [
        str(series["role"]) for series in panel["series"] if entries[str(series["name"])].is_drawn
    ]
    limits = telling_range(drawn, roles)
    low, high = padded_range(drawn or [y for _, y in data]) if limits is None else limits
    lines = []
    for (x, y), series in zip(data, panel["series"], strict=True):
        good = np.isfinite(x) & np.isfinite(y)
        if good.any():
            lines.append(_line(x, y, good, names.index(str(series["name"])), span, (low, high)))
    return Panel(
        label=str(panel["label"]),
        unit=str(panel["unit"]),
        low=low,
        high=high,
        ticks=ticks(low, high, 4, upward=True, sign=sign),
        lines=tuple(lines),
        cut=() if limits is None else tuple(_leaving(panel, data, entries, (low, high))),
        sign=sign,
    )


def _leaving(
    panel: Mapping[str, Any],
    data: Sequence[tuple[Array, Array]],
    entries: Mapping[str, LegendEntry],
    limits: tuple[float, float],
) -> Iterator[str]:
    for (_, y), series in zip(data, panel["series"], strict=True):
        entry, finite = entries[str(series["name"])], y[np.isfinite(y)]
        if (
            entry.is_drawn
            and finite.size
            and (finite.min() < limits[0] or finite.max() > limits[1])
        ):
            yield entry.name


def telling_range(signals: Sequence[Array], roles: Sequence[str]) -> tuple[float, float] | None:
    """Return the range around measurements or estimates, if others hide them.

    Other lines or bands can leave it so far that nothing else can be seen.

    None where all of it can be shown: a simulation that runs away must not flatten the
    measurement that it is held against.
    """
    kept = [(role, y[np.isfinite(y)]) for role, y in zip(roles, signals, strict=True)]
    kept = [(role, y) for role, y in kept if y.size]
    near = [y for role, y in kept if role == "measured"] or [
        y for role, y in kept if role != "band"
    ]
    if not near or len(near) == len(kept):
        return None
    low, high = float(min(y.min() for y in near)), float(max(y.max() for y in near))
    full_range = float(max(y.max() for _, y in kept)) - float(min(y.min() for _, y in kept))
    span = max(high - low, 0.1 * max(abs(low), abs(high)))
    return None if span <= 0.0 or full_range <= FAR * span else (low - span, high + span)


SMALLEST_SPAN = 1e-30
"""A signal whose values differ by less is drawn as constant: no SI quantity here is
that small.
"""


def padded_range(signals: Sequence[Array]) -> tuple[float, float]:
    """Return the smallest and largest finite value with a margin.

    A constant signal gets room on either side.
    """
    kept = [y[np.isfinite(y)] for y in signals]
    values = np.concatenate([y for y in kept if y.size] or [np.zeros(1)])
    low, high = float(values.min()), float(values.max())
    varies = high - low > max(1e-12 * max(abs(low), abs(high)), SMALLEST_SPAN)
    room = MARGIN * (high - low) if varies else max(abs(high) * 0.1, 1e-3)
    return low - room, high + room


def _line(
    x: Array,
    y: Array,
    good: npt.NDArray[np.bool_],
    entry: int,
    span: tuple[float, float],
    limits: tuple[float, float],
) -> Line:
    low, high = float(y[good].min()), float(y[good].max())
    step = (high - low) / Y_STEPS or 1.0
    x_steps = np.rint(
        (np.where(good, x, span[0]) - span[0]) / (span[1] - span[0]) * X_STEPS
    ).astype(np.int64)
    y_steps = np.rint((high - np.where(good, y, high)) / step).astype(np.int64)
    per_panel = PANEL_STEPS / (limits[1] - limits[0])
    path = "".join(_run(x_steps[a:b], y_steps[a:b]) for a, b in runs_of(good))
    return Line(
        entry,
        path,
        scale=step * per_panel,
        shift=(limits[1] - high) * per_panel,
        top=high,
        step=step,
        samples=int(good.sum()),
    )


def _run(x: npt.NDArray[np.int64], y: npt.NDArray[np.int64]) -> str:
    start = f"M{x[0]} {y[0]}"
    if x.size == 1:
        return start + "l0 0"
    steps = np.column_stack([np.diff(x), np.diff(y)]).ravel().tolist()
    return start + "l" + " ".join(map(str, steps)).replace(" -", "-")


def ticks(
    low: float, high: float, count: int, *, upward: bool = False, sign: int = 1
) -> tuple[Tick, ...]:
    """Return about `count` round values between `low` and `high`, with labels.

    Two at least: one value says nothing of the scale. Labels tell neighbours apart; with `sign` -1
    they are of the negatives.
    """
    span = high - low
    power = 10.0 ** np.floor(np.log10(span / count))
    steps = [m * p for p in (power / 10, power) for m in (1, 2, 2.5, 5)] + [10 * power]
    place = next((i for i, s in enumerate(steps) if span / s <= count), len(steps) - 1)
    while place and np.floor(high / steps[place]) - np.ceil(low / steps[place]) < 1:
        place -= 1
    step = steps[place]
    values = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    digits = max(
        0, -int(np.floor(np.log10(step) + 1e-9)) + (1 if f"{step:.3e}".startswith("2.5") else 0)
    )
    labelled = []
    for value in values:
        share = (value - low) / span * 100
        labelled.append(
            Tick(round(100 - share if upward else share, 3), _label(sign * float(value), digits))
        )
    return tuple(labelled)


def _label(value: float, digits: int) -> str:
    if digits > 5 or abs(value) >= 1e6:
        return f"{value:.3g}".replace("-", "−")
    return f"{value:.{digits}f}".replace("-", "−") if value else "0"
