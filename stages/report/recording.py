"""The Rerun recording: every group of series that the stages name in their views, the path in 3D, messages, and the answer as text.

One timeline `t`, in seconds of the log; later logs of a campaign follow one another with a gap. One entity per group of series that
share a clock, sent in columns. The blueprint opens on the tab `Answer` and shows the whole time range. Known limit: Rerun stamps its
chunks with the time of writing, so two recordings of the same run are equal by `rerun rrd compare`, not byte for byte.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr
import rerun.blueprint as rrb

from data_schemas.tables import column, has_columns, matrix
from stages.report.colours import AXES, ROLES, Ink, ink, is_model, key
from stages.report.html import visible
from stages.report.summary import AXIS_WORDS, Summary

Array = npt.NDArray[np.float64]
Document = Mapping[str, Any]
Owned = tuple[str, Document]
"""A group of series and the stage/item whose view it is."""

TIMELINE = "t"
CHUNK_ROWS = 50_000
LOG_GAP_S = 10.0
ANSWER, PATH, LOG = "Answer", "Path", "Log"
MODELS_SHOWN = 3
RAW_OPACITY = 120
EVER = rrb.TimeRangeBoundary.infinite()
POSE = ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad")


@dataclass(frozen=True)
class Clock:
    """Where each log and segment stands on the recording's timeline, in seconds."""

    segments: Mapping[str, float]
    logs: Mapping[str, float]
    boot_s: Mapping[str, float]

    def seconds(self, name: str, table: pa.Table) -> Array | None:
        """The times (n,) of a table stored under `stage/item/port`; None if it has no clock or belongs to no log or segment."""
        parts = name.split("/")
        segment = next((part for part in parts if part in self.segments), None)
        if "t_s" in table.column_names and segment is not None:
            return column(table, "t_s") + self.segments[segment]
        log = next((part for part in parts if part in self.logs), None)
        if "time_us" in table.column_names and log is not None:
            return np.asarray(column(table, "time_us") * 1e-6 - self.boot_s[log] + self.logs[log])
        return None


def make_clock(segments: Mapping[str, Document], logs: Mapping[str, Document]) -> Clock:
    """Logs one after the other, `LOG_GAP_S` apart; a segment starts at its place in its log."""
    starts, place = {}, 0.0
    for name, log in logs.items():
        starts[name] = place
        place += _lengths({name: log})[name] + LOG_GAP_S
    return Clock(
        segments={name: starts.get(item["log"], 0.0) + item["leg_start_s"] for name, item in segments.items()},
        logs=starts,
        boot_s={name: log["start_us"] * 1e-6 for name, log in logs.items()},
    )


def record(
    title: str,
    summary: Summary,
    views: Mapping[str, Document],
    tables: Mapping[str, pa.Table],
    fused: Mapping[str, pa.Table],
    segments: Mapping[str, Document],
    logs: Mapping[str, Document],
    path_rate_hz: float,
) -> bytes:
    """The recording as .rrd bytes."""
    stream = rr.RecordingStream("auvid", recording_id=key(title) or "campaign", send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    sink = rr.binary_stream(recording=stream)
    clock = make_clock(segments, logs)
    groups = [(owner, group) for owner, document in views.items() for group in document["groups"]]
    stream.send_blueprint(_blueprint(groups, segments, logs, clock))
    stream.send_recording_name(str(visible(title)))
    _log_static(stream, "answer/text", rr.TextDocument(markdown(title, summary, segments, clock), media_type=rr.MediaType.MARKDOWN))
    _send_groups(stream, groups, tables, clock, _preferred(summary))
    _send_path(stream, fused, segments, clock, path_rate_hz)
    _send_messages(stream, tables, segments, clock)
    stream.flush()
    data: bytes = sink.read(flush=True) or b""
    return data


def _preferred(summary: Summary) -> list[str]:
    return list(dict.fromkeys(name for name in (summary.take, *(model.name for model in summary.models)) if name))[:MODELS_SHOWN]


def _log_static(stream: rr.RecordingStream, entity: str, value: Any) -> None:
    """One static value in a chunk of its own, so that chunks come in the same order every time."""
    stream.log(entity, value, static=True)
    stream.flush()


def _send_groups(
    stream: rr.RecordingStream,
    groups: Sequence[Owned],
    tables: Mapping[str, pa.Table],
    clock: Clock,
    preferred: Sequence[str],
) -> None:
    named: set[str] = set()
    for entity, owner, bundle in _bundles(groups):
        name = find_table(tables, owner, str(bundle[0]["table"]))
        if name is None:
            continue
        table = tables[name]
        parts = [_rows(table, group) for group in bundle]
        times = clock.seconds(name, parts[0])
        if times is None or not len(times) or not all(has_columns(table, group["columns"]) for group in bundle):
            continue
        if entity not in named:
            named.add(entity)
            _log_static(stream, entity, _lines(bundle, preferred))
        values = [matrix(part, group["columns"])[: times.size] for part, group in zip(parts, bundle, strict=True)]
        _send_series(stream, entity, times, np.hstack(values))


def _rows(table: pa.Table, group: Document) -> pa.Table:
    for wanted, value in (group.get("filter") or {}).items():
        table = table.filter(pc.equal(table[wanted], value))
    return table


def _bundles(groups: Sequence[Owned]) -> list[tuple[str, str, list[Document]]]:
    """(entity, owner, groups): groups that cut the same long table by a filter share its clock, so they become one entity."""
    bundles: dict[tuple[str, ...], list[Document]] = defaultdict(list)
    for owner, group in groups:
        cut = bool(group.get("filter")) and bool(_parent(group))
        entity = _parent(group) if cut else str(visible(group["entity"]))
        bundles[(owner, entity, str(group["table"]), "cut" if cut else "whole")].append(group)
    found = []
    for (owner, entity, _, how), members in bundles.items():
        models = all(is_model(str(role)) for group in members for role in group["roles"])
        name = f"{entity}/{'models' if models else 'series'}" if how == "cut" else entity
        found.append((name, owner, members))
    return found


def find_table(tables: Mapping[str, pa.Table], owner: str, wanted: str) -> str | None:
    """The key of the table that a view of `owner` (stage/item) means: its own artefact, a full key, or another stage's of the same item."""
    own = f"{owner}/{wanted}"
    for name in (own, wanted):
        if name in tables:
            return name
    item = owner.partition("/")[2]
    for name in tables:
        parts = name.split("/")
        if sorted(parts) == sorted(own.split("/")) or (item and wanted in parts and item in parts):
            return name
    return None


def _lines(bundle: Sequence[Document], preferred: Sequence[str]) -> rr.SeriesLines:
    """Names, colours and widths of the series of an entity; of many models only the preferred are drawn at first."""
    liked = {key(name) for name in preferred}
    names, inks, faint, shown = [], [], [], []
    for group in bundle:
        by_axis = len(set(group["roles"])) == 1 and len(group["roles"]) > 1
        for name, role in zip(group["names"], group["roles"], strict=True):
            names.append(str(visible(str(name))))
            inks.append(_series_ink(str(name), str(role), by_axis))
            faint.append(str(role) == "raw")
            shown.append(not is_model(str(role)) or not liked or key(str(role)) in liked)
    colours = [(*item.rgb, RAW_OPACITY if pale else 255) for item, pale in zip(inks, faint, strict=True)]
    return rr.SeriesLines(colors=colours, names=names, widths=[item.width for item in inks], visible_series=shown)


def _series_ink(name: str, role: str, many_of_one_role: bool) -> Ink:
    """Three axes in one plot are told apart by axis; otherwise the role has its colour."""
    axis = key(name).split("_")[0]
    if many_of_one_role and axis in AXES:
        return Ink(AXES[axis].light, AXES[axis].dark, width=ink(role).width)
    return ink(role)


def _send_series(stream: rr.RecordingStream, entity: str, times: Array, values: Array) -> None:
    """Series (n, k) at `times` (n,), ended by an empty row so that no line crosses to the next segment."""
    for start in range(0, times.size, CHUNK_ROWS):
        part, lengths = times[start : start + CHUNK_ROWS], [values.shape[1]] * len(times[start : start + CHUNK_ROWS])
        if start + CHUNK_ROWS >= times.size:
            step = times[-1] - times[-2] if times.size > 1 else 1e-3
            part, lengths = np.append(part, times[-1] + max(step, 1e-6)), [*lengths, 0]
        columns = rr.Scalars.columns(scalars=values[start : start + CHUNK_ROWS].ravel())
        stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=part)], columns.partition(lengths))


def _send_path(
    stream: rr.RecordingStream, fused: Mapping[str, pa.Table], segments: Mapping[str, Document], clock: Clock, rate_hz: float
) -> None:
    _log_static(stream, "path", rr.ViewCoordinates.FRD)
    for name, table in fused.items():
        use = str(segments[name]["use"]) if name in segments else "training"
        pose = matrix(table, POSE)
        times = clock.seconds(f"fuse/{name}/fused", table)
        good = np.isfinite(pose).all(axis=1)
        if times is None or not good.any():
            continue
        stride = max(1, round((times.size - 1) / max(times[-1] - times[0], 1e-9) / rate_hz)) if times.size > 1 else 1
        pose, times = pose[good][::stride], times[good][::stride]
        _log_static(stream, f"path/{name}", rr.LineStrips3D([pose[:, :3]], colors=[ROLES[use].rgb], labels=[f"{name} ({use})"]))
        stream.send_columns(
            "path/vehicle",
            [rr.TimeColumn(TIMELINE, duration=times)],
            rr.Transform3D.columns(translation=pose[:, :3], quaternion=_quaternions(pose[:, 3:])),
        )
    axes = [AXES[name].rgb for name in ("x", "y", "z")]
    _log_static(stream, "path/vehicle/axes", rr.Arrows3D(vectors=0.6 * np.eye(3), colors=axes, labels=["x", "y", "z"]))


def _quaternions(euler: Array) -> Array:
    """Quaternions xyzw (n, 4), body to NED, of Euler angles phi theta psi (n, 3) in the order z y x (Fossen 2011, 2.2)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(euler.T / 2), np.sin(euler.T / 2)
    parts = [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy]
    return np.column_stack(parts)


def _send_messages(stream: rr.RecordingStream, tables: Mapping[str, pa.Table], segments: Mapping[str, Document], clock: Clock) -> None:
    """Messages and mode changes of the vehicle, and the start of each segment, as text on the timeline."""
    lines: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for name in tables:
        port = name.split("/")[-1]
        if port not in ("events", "mode"):
            continue
        table = tables[name]
        times = clock.seconds(name, table)
        if times is not None:
            words = table["text" if port == "events" else "mode"].to_pylist()
            lines[f"log/{port}"] += [
                (time, f"mode {line}" if port == "mode" else line) for time, line in zip(times.tolist(), words, strict=True)
            ]
    lines["log/segments"] = [(clock.segments[name], f"{item['use']} segment {name} starts") for name, item in segments.items()]
    for entity, rows in sorted(lines.items()):
        rows.sort(key=lambda row: row[0])
        stream.send_columns(
            entity,
            [rr.TimeColumn(TIMELINE, duration=[time for time, _ in rows])],
            rr.TextLog.columns(text=[str(visible(words)) for _, words in rows], level=["INFO"] * len(rows)),
        )


def markdown(title: str, summary: Summary, segments: Mapping[str, Document], clock: Clock) -> str:
    """The first screen as Markdown, for the text panel beside the plots."""
    lines = [f"# {title}", f"**{summary.headline}.** {summary.explanation}", ""]
    lines += [f"| J/J0, {summary.judged_on} | all | {' | '.join(AXIS_WORDS)} |", "|" + "---|" * (2 + len(AXIS_WORDS))]
    for model in summary.models:
        ratios = [score.validation if summary.judged_on == "validation" else score.training for score in model.scores]
        cells = ["–" if ratio is None else f"**{ratio:.2f}**" if ratio > 1 else f"{ratio:.2f}" for ratio in ratios]
        lines.append(f"| {model.title} | {' | '.join(cells)} |")
    lines += ["", "Bold: above 1, no better than predicting no force.", ""]
    if summary.missing:
        lines += ["## What is missing or uncertain", *(f"- {words}" for words in summary.missing), ""]
    if summary.warnings:
        lines += ["## Warnings", *(f"- {words}" for words in summary.warnings), ""]
    lines += ["## Segments", *(_segment_line(name, item, clock) for name, item in segments.items())]
    return str(visible("\n".join(lines)))


def _segment_line(name: str, item: Document, clock: Clock) -> str:
    start = clock.segments[name]
    return f"- {name}: {item['use']}, {start:.1f} to {start + item['duration_s']:.1f} s (log {item['log']})"


def _blueprint(groups: Sequence[Owned], segments: Mapping[str, Document], logs: Mapping[str, Document], clock: Clock) -> rrb.Blueprint:
    spans = (_span(clock.segments, {name: float(item["duration_s"]) for name, item in segments.items()}), _span(clock.logs, _lengths(logs)))
    tabs: dict[str, list[Owned]] = defaultdict(list)
    for owner, group in groups:
        tabs[str(visible(group["tab"]))].append((owner, group))
    words = rrb.TextDocumentView(origin="answer/text", name="Summary")
    answer = _plots(tabs.pop(ANSWER, []), logs, spans)
    opening = rrb.Horizontal(rrb.Grid(*answer, grid_columns=2), words, column_shares=[7, 3], name=ANSWER) if answer else words
    path = rrb.Spatial3DView(origin="path", name=PATH)
    plots = {name: _plots(items, logs, spans) for name, items in tabs.items()}
    others = [rrb.Grid(*views, grid_columns=1 if len(views) < 3 else 2, name=name) for name, views in plots.items()]
    log = rrb.TextLogView(origin="log", name=LOG)
    return rrb.Blueprint(
        rrb.Tabs(opening, path, *others, log, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def _lengths(logs: Mapping[str, Document]) -> dict[str, float]:
    return {name: (log["end_us"] - log["start_us"]) * 1e-6 for name, log in logs.items()}


def _span(starts: Mapping[str, float], lengths: Mapping[str, float]) -> rrb.TimeRange:
    """From the first start to the last end, in seconds of the timeline."""
    low = min(starts.values(), default=0.0)
    high = max((start + lengths[name] for name, start in starts.items()), default=1.0)
    return rrb.TimeRange(rrb.TimeRangeBoundary.absolute(seconds=low), rrb.TimeRangeBoundary.absolute(seconds=high))


def _plots(groups: Sequence[Owned], logs: Mapping[str, Document], spans: tuple[rrb.TimeRange, rrb.TimeRange]) -> list[rrb.TimeSeriesView]:
    """One plot per parent entity whose groups share a unit, else one per group; over all segments, or over all logs for a log's views."""
    units: dict[str, set[str]] = defaultdict(set)
    for _, group in groups:
        units[_parent(group)].add(str(group["unit"]))
    parents = {_parent(group) for _, group in groups}
    plots: dict[str, rrb.TimeSeriesView] = {}
    for owner, group in groups:
        legend = not plots or not all(is_model(str(role)) or role == "measured" for role in group["roles"])
        together = len(units[_parent(group)]) == 1 and _parent(group) and str(visible(group["entity"])) not in parents
        origin = _parent(group) if together else str(visible(group["entity"]))
        name = f"{origin.split('/')[-1]} [{group['unit']}]" if group["unit"] else origin.split("/")[-1]
        if origin not in plots:
            plots[origin] = rrb.TimeSeriesView(
                origin=origin,
                name=name,
                axis_x=rrb.TimeAxis(view_range=spans[owner.partition("/")[2] in logs]),
                time_ranges=rrb.VisibleTimeRange(TIMELINE, start=EVER, end=EVER),
                plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
            )
    return list(plots.values())


def _parent(group: Document) -> str:
    return str(visible(group["entity"])).rpartition("/")[0]
