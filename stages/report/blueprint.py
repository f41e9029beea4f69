"""How the recording opens: tabs of plots from the stages' views, the 3D path and the messages; the answer first, all of it in view."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from stages.report.colours import is_model
from stages.report.html import visible

Document = Mapping[str, Any]
Owned = tuple[str, Document]
"""A group of series and the stage/item whose view it is."""

TIMELINE = "t"
ANSWER, PATH, LOG = "Answer", "Path", "Log"
EVER = rrb.TimeRangeBoundary.infinite()
MARGIN = 0.06
EYE = np.array([-0.75, -1.0, -0.9])
"""Where the eye stands from the middle of the path, in sizes of the path: south-west of it and above, NED."""


@dataclass(frozen=True)
class Seen:
    """What was sent: entity -> range of its drawn series, first and last second of all segments and of all logs, corners of the path."""

    ranges: Mapping[str, tuple[float, float]]
    segments_s: tuple[float, float]
    logs_s: tuple[float, float]
    corners: npt.NDArray[np.float64]


def parent(group: Document) -> str:
    """The entity above that of a group, empty at the top."""
    return str(visible(group["entity"])).rpartition("/")[0]


def whole_view(groups: Sequence[Owned], logs: frozenset[str], seen: Seen) -> rrb.Blueprint:
    """The blueprint: `Answer` with the summary beside it, the path, one tab per tab of the views, and the messages."""
    tabs: dict[str, list[Owned]] = defaultdict(list)
    for owner, group in groups:
        tabs[str(visible(group["tab"]))].append((owner, group))
    words = rrb.TextDocumentView(origin="answer/text", name="Summary")
    answer = _plots(tabs.pop(ANSWER, []), logs, seen)
    opening = rrb.Horizontal(rrb.Grid(*answer, grid_columns=2), words, column_shares=[7, 3], name=ANSWER) if answer else words
    plots = {name: _plots(items, logs, seen) for name, items in tabs.items()}
    others = [rrb.Grid(*views, grid_columns=1 if len(views) < 3 else 2, name=name) for name, views in plots.items()]
    return rrb.Blueprint(
        rrb.Tabs(opening, _path_view(seen.corners), *others, rrb.TextLogView(origin="log", name=LOG), active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def _path_view(corners: npt.NDArray[np.float64]) -> rrb.Spatial3DView:
    middle, size = corners.mean(axis=0), max(float(np.ptp(corners, axis=0).max()), 2.0)
    eye = rrb.EyeControls3D(position=middle + size * EYE, look_target=middle, eye_up=(0.0, 0.0, -1.0))
    floor = rr.components.Plane3D.XY.with_distance(float(corners[1, 2]) + 0.05 * size)
    return rrb.Spatial3DView(origin="path", name=PATH, eye_controls=eye, line_grid=rrb.LineGrid3D(plane=floor))


def _span(seconds: tuple[float, float]) -> rrb.TimeRange:
    low, high = (rrb.TimeRangeBoundary.absolute(seconds=value) for value in seconds)
    return rrb.TimeRange(low, high)


def _plots(groups: Sequence[Owned], logs: frozenset[str], seen: Seen) -> list[rrb.TimeSeriesView]:
    """One plot per parent entity whose groups share a unit, else one per group; over all segments, or over all logs for a log's views."""
    units: dict[str, set[str]] = defaultdict(set)
    for _, group in groups:
        units[parent(group)].add(str(group["unit"]))
    parents = {parent(group) for _, group in groups}
    plots: dict[str, rrb.TimeSeriesView] = {}
    for owner, group in groups:
        together = len(units[parent(group)]) == 1 and parent(group) and str(visible(group["entity"])) not in parents
        origin = parent(group) if together else str(visible(group["entity"]))
        if origin in plots:
            continue
        models = all(is_model(str(role)) or role == "measured" for role in group["roles"])
        name = origin.split("/")[-1]
        plots[origin] = rrb.TimeSeriesView(
            origin=origin,
            name=f"{name} [{group['unit']}]" if group["unit"] else name,
            axis_x=rrb.TimeAxis(view_range=_span(seen.logs_s if owner.partition("/")[2] in logs else seen.segments_s)),
            axis_y=rrb.ScalarAxis(range=_range(origin, seen.ranges)),
            time_ranges=rrb.VisibleTimeRange(TIMELINE, start=EVER, end=EVER),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=not plots or not models),
        )
    return list(plots.values())


def _range(origin: str, ranges: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """The y-range of a plot over its entities. Set here, because the viewer takes the end of a line (an empty row) for a zero."""
    inside = [span for entity, span in ranges.items() if entity == origin or entity.startswith(f"{origin}/")]
    low, high = min((low for low, _ in inside), default=0.0), max((high for _, high in inside), default=1.0)
    if not (np.isfinite(low) and np.isfinite(high)):
        return -1.0, 1.0
    room = MARGIN * (high - low) or max(abs(high) * 0.1, 1e-3)
    return low - room, high + room
