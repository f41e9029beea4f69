"""Layout of the recording: tabs of plots from the stages' views, path and messages.

The answer comes first, all of it in view.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from auvid.data_schemas.errors import UsageError, nearest
from auvid.hydro.arrays import Array
from auvid.stages.base import Document
from auvid.stages.number_format import visible
from auvid.stages.page.colours import is_model
from auvid.stages.report.recording.readable import readable_group
from auvid.stages.report.recording.rerun_stream import TIMELINE

Owned = tuple[str, Document]
"""A group of series and the stage/item whose view it is."""

ANSWER, PATH, LOG, TABLES = "Answer", "Path", "Log", "Tables"
EVER = rrb.TimeRangeBoundary.infinite()
MARGIN = 0.06
MOST_PLOTS = 10
MOST_VIEWS = 120
"""Plots of one recording: Rerun 0.41 opens none whose blueprint has between 160 and 180
(measured), and says only that it is empty.
"""
LEFT_OUT = "answer/left_out"
EYE = np.array([-0.5, -0.7, -0.65])
"""Where the eye stands from the middle of the path, in diagonals of the box around it:
south-west of it and above, NED.
"""
NO_RANGE = (np.inf, -np.inf)


@dataclass(frozen=True)
class LoggedSeries:
    """Series logged to an entity: the range of those drawn, and of their times in s."""

    values: tuple[float, float] = NO_RANGE
    times: tuple[float, float] = NO_RANGE

    def add(self, times: Array, values: Array) -> LoggedSeries:
        """With these times (n,) and series (n, k)."""
        good = values[np.isfinite(values)]
        value_range = (float(good.min()), float(good.max())) if good.size else NO_RANGE
        return LoggedSeries(
            outer([self.values, value_range]),
            outer([self.times, (float(times[0]), float(times[-1]))]),
        )


@dataclass(frozen=True)
class VisibleTabs:
    """Content of the tabs: what was logged, by entity.

    Entity -> its ranges, path -> corners of its box, stages with texts, times of the
    spans if there are any.
    """

    logged: Mapping[str, LoggedSeries]
    paths: Mapping[str, Array] = field(default_factory=dict)
    texts: tuple[str, ...] = ()
    spans: tuple[float, float] | None = None


def outer(spans: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """From the lowest start to the highest end."""
    lows, highs = zip(*spans, strict=True) if (spans := list(spans)) else ((np.inf,), (-np.inf,))
    return float(min(lows)), float(max(highs))


def parent(group: Document) -> str:
    """Return the entity above that of a group, empty at the top."""
    return str(visible(group["entity"])).rpartition("/")[0]


def whole_view(
    groups: Sequence[Owned],
    contents: VisibleTabs,
    tab: str = "",
    first: Callable[[Any], Any] | None = None,
) -> tuple[rrb.Blueprint, str]:
    """Return the blueprint of a run, and the series that have no plot.

    Tabs: `Answer` with the summary next to it, the path, one per tab of the views,
    texts of the stages, and messages. `first` makes a tab before them, beside the summary.

    `tab`: where it opens, as `State` or `Answer/leg`; the first where that is empty.
    Also returned is which series have no plot, for the text `LEFT_OUT`; empty if all
    have. Raises `UsageError` for a tab that there is not.
    """
    opening, _, leg = tab.partition("/")
    tabs: dict[str, list[Owned]] = {ANSWER: []}
    for owner, group in groups:
        tabs.setdefault(str(visible(group["tab"])), []).append((owner, group))
    plots, left_out = limited(
        {name: _plots(items, groups, contents) for name, items in tabs.items()}, leg
    )
    answer = plots.pop(ANSWER)
    words = _summary_view(left_out)
    left = (
        in_pages(answer, None, 2, leg)
        if answer
        else paths_view(contents.paths)
        if contents.paths
        else None
    )
    pages: list[Any] = [] if first is None else [first(_summary_view(left_out))]
    pages += [
        (
            rrb.Horizontal(left, words, column_shares=[7, 3], name=ANSWER)
            if left is not None
            else words
        )
    ]
    pages += [path_view("path", contents.paths, PATH)] if contents.paths else []
    pages += [in_pages(views, name, 2, leg) for name, views in plots.items() if views]
    texts = [rrb.TextDocumentView(origin=f"tables/{stage}", name=stage) for stage in contents.texts]
    pages += [rrb.Tabs(*texts, name=TABLES)] if texts else []
    log = rrb.TextLogView(origin="log", name=LOG)
    spans = spans_view("Modes and segments", contents.spans) if contents.spans is not None else None
    pages.append(
        rrb.Vertical(spans, log, row_shares=[1, 2], name=LOG) if spans is not None else log
    )
    return opened(pages, opening), left_out


def _summary_view(left_out: str) -> Any:
    """Return a new view of the summary: the viewer draws a view in one place only."""
    words = rrb.TextDocumentView(origin="answer/text", name="Summary")
    if not left_out:
        return words
    return rrb.Tabs(words, rrb.TextDocumentView(origin=LEFT_OUT, name="Without a plot"))


def limited(
    tabs: Mapping[str, Mapping[str, rrb.TimeSeriesView]], leg: str = "", most: int = MOST_VIEWS
) -> tuple[dict[str, dict[str, rrb.TimeSeriesView]], str]:
    """Return at most `most` plots, and in Markdown those left out.

    The plots are shared among the tabs, those of `leg` first.
    """
    kept = {name: dict(plots) for name, plots in tabs.items()}
    spare = sum(map(len, tabs.values())) - most
    if spare <= 0:
        return kept, ""
    lines = [
        (
            "Rerun opens no recording with more plots than these. The series below are in it,"
            " without a plot of their own."
        ),
        "",
    ]
    lines += ["A plot of each leg is made by `auvid inspect CAMPAIGN --tab TAB/LEG`.", ""]
    room, waiting = most, len(kept)
    for name, plots in sorted(kept.items(), key=lambda item: len(item[1])):
        share, waiting = room // waiting, waiting - 1
        ranked = sorted(plots, key=lambda origin: origin.split("/")[1:2] != [leg])
        gone = ranked[share:]
        kept[name] = {origin: view for origin, view in plots.items() if origin not in gone}
        room -= len(kept[name])
        lines += [f"- {name}: {origin}" for origin in gone]
    return kept, "\n".join(lines)


def opened(pages: Sequence[Any], tab: str = "") -> rrb.Blueprint:
    """Return a blueprint of tabs that opens on the first or on a named one.

    All panels but the timeline are folded away.
    """
    names = [str(page.name) for page in pages]
    if tab and tab not in names:
        raise UsageError(
            "no such tab in this recording", value=tab, allowed=names, remedy=nearest(tab, names)
        )
    return rrb.Blueprint(
        rrb.Tabs(*pages, active_tab=names.index(tab) if tab else 0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def paths_view(paths: Mapping[str, Array]) -> Any:
    """Return the paths side by side, each in its own view; one view for one path."""
    if len(paths) == 1:
        return path_view("path", paths, PATH)
    columns = 1 if len(paths) == 2 else 2
    return rrb.Grid(
        *(
            path_view(f"path/{rr.escape_entity_path_part(name)}", {name: box}, name)
            for name, box in paths.items()
        ),
        grid_columns=columns,
    )


def path_view(origin: str, paths: Mapping[str, Array], name: str) -> rrb.Spatial3DView:
    """Return the 3D view of paths within boxes with these corners (2, 3) in m, NED."""
    corners = np.array(
        [
            np.min([box[0] for box in paths.values()], axis=0),
            np.max([box[1] for box in paths.values()], axis=0),
        ]
    )
    middle, size = corners.mean(axis=0), max(float(np.linalg.norm(np.ptp(corners, axis=0))), 2.0)
    eye = rrb.EyeControls3D(
        position=middle + size * EYE, look_target=middle, eye_up=(0.0, 0.0, -1.0)
    )
    floor = rr.components.Plane3D.XY.with_distance(float(corners[1, 2]) + 0.05 * size)
    return rrb.Spatial3DView(
        origin=origin, name=name, eye_controls=eye, line_grid=rrb.LineGrid3D(plane=floor)
    )


def spans_view(name: str, times: tuple[float, float]) -> rrb.StateTimelineView:
    """Return the lanes of spans over a range of times in s."""
    return rrb.StateTimelineView(
        origin="spans", name=name, time_view=rrb.TimeAxis(view_range=_time_range(times))
    )


def _time_range(times: tuple[float, float]) -> rrb.TimeRange:
    low, high = (rrb.TimeRangeBoundary.absolute(seconds=value) for value in times)
    return rrb.TimeRange(low, high)


def time_plot(
    origin: str,
    name: str,
    times: tuple[float, float],
    values: tuple[float, float],
    *,
    legend: bool = True,
) -> rrb.TimeSeriesView:
    """Return a plot of the series below `origin` over times in s.

    The y-range has a little room above and below.
    """
    return rrb.TimeSeriesView(
        origin=origin,
        contents="$origin/**",
        name=name,
        axis_x=rrb.TimeAxis(view_range=_time_range(times)),
        axis_y=rrb.ScalarAxis(range=with_room(values)),
        time_ranges=rrb.VisibleTimeRange(TIMELINE, start=EVER, end=EVER),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
    )


def _plots(
    groups: Sequence[Owned], every: Sequence[Owned], contents: VisibleTabs
) -> dict[str, rrb.TimeSeriesView]:
    """Return the plots of a tab, all over the same time.

    One plot per parent entity below which all is of one unit and tab, else one per
    group.

    `groups`: those of the tab; `every`: those of all tabs. A legend that stands beside
    an earlier plot is not repeated.
    """
    below_of = {parent(group) for _, group in every}
    kinds: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for _, group in every:
        parts = str(visible(group["entity"])).split("/")
        kind = (str(group["tab"]), readable_group(group)[1])
        for count in range(1, len(parts) + 1):
            kinds["/".join(parts[:count])].add(kind)
    chosen: dict[str, Document] = {}
    named: dict[str, list[str]] = defaultdict(list)
    for _, group in groups:
        above, entity = parent(group), str(visible(group["entity"]))
        origin = above if above and len(kinds[above]) == 1 and entity not in below_of else entity
        chosen.setdefault(origin, group)
        named[origin] += map(str, group["names"])
    below = {
        origin: [
            item for name, item in contents.logged.items() if f"{name}/".startswith(f"{origin}/")
        ]
        for origin in chosen
    }
    times = outer(item.times for items in below.values() for item in items)
    names = _names(
        {origin: str(group["unit"]) for origin, group in chosen.items() if below[origin]}
    )
    plots: dict[str, rrb.TimeSeriesView] = {}
    explained: set[tuple[str, ...]] = set()
    for origin, name in names.items():
        group, lines = chosen[origin], tuple(sorted(set(named[origin])))
        models = all(is_model(str(role)) or role in ("measured", "true") for role in group["roles"])
        unit = readable_group(group)[1]
        title = f"{name} [{unit}]" if unit else name
        legend = not plots or (not models and lines not in explained)
        explained.add(lines)
        plots[origin] = time_plot(
            origin, title, times, outer(item.values for item in below[origin]), legend=legend
        )
    return plots


def _names(units: Mapping[str, str]) -> dict[str, str]:
    """Return a short name for each entity with its unit.

    The name is the last part that distinguishes it, with the one before where that is
    not enough.
    """
    parts = {
        origin: [part for part in origin.split("/") if part != _slug(unit)] or [origin]
        for origin, unit in units.items()
    }
    last = Counter((words[-1], units[origin]) for origin, words in parts.items())
    return {
        origin: words[-1] if last[words[-1], units[origin]] == 1 else " ".join(words[-2:])
        for origin, words in parts.items()
    }


def in_pages(
    plots: Mapping[str, rrb.TimeSeriesView], name: str | None, columns: int, leg: str = ""
) -> Any:
    """Return the plots of a tab in a grid, or in pages where they are many.

    Pages keep legs (second parts of entities) together; `leg` is open.
    """
    if len(plots) <= MOST_PLOTS:
        return rrb.Grid(*plots.values(), grid_columns=columns if len(plots) > 2 else 1, name=name)
    clusters: dict[str, list[str]] = defaultdict(list)
    for origin in plots:
        clusters["/".join(origin.split("/")[:2])].append(origin)
    pages: list[list[str]] = [[]]
    for members in clusters.values():
        for start in range(0, len(members), MOST_PLOTS):
            part = members[start : start + MOST_PLOTS]
            if len(pages[-1]) + len(part) > MOST_PLOTS:
                pages.append([])
            pages[-1] += part
    grids = [
        rrb.Grid(*(plots[origin] for origin in page), grid_columns=columns, name=_page_name(page))
        for page in pages
        if page
    ]
    places = [
        place
        for place, page in enumerate(filter(None, pages))
        if any(origin.split("/")[1:2] == [leg] for origin in page)
    ]
    return rrb.Tabs(*grids, name=name, active_tab=places[0] if places else 0)


def _page_name(origins: Sequence[str]) -> str:
    names = list(dict.fromkeys(origin.split("/")[min(1, origin.count("/"))] for origin in origins))
    return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"


def _slug(unit: str) -> str:
    """A unit as the last part of an entity that tells the units of one stream apart."""
    return unit.replace("/", "_").replace("^", "")


def with_room(span: tuple[float, float]) -> tuple[float, float]:
    """Return a y-range with room around a span.

    Set here, because the viewer takes the end of a line (an empty row) for a zero.
    """
    low, high = span
    if not (np.isfinite(low) and np.isfinite(high)):
        return -1.0, 1.0
    room = MARGIN * (high - low) or max(abs(high) * 0.1, 1e-3)
    return low - room, high + room
