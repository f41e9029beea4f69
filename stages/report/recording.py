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

from data_schemas.tables import column, has_columns, matrix
from stages.report.blueprint import TIMELINE, Owned, Seen, parent, whole_view
from stages.report.colours import AXES, ROLES, Ink, ink, is_model, key
from stages.report.findings import AXIS_WORDS
from stages.report.html import visible
from stages.report.summary import Summary

Array = npt.NDArray[np.float64]
Document = Mapping[str, Any]
CHUNK_ROWS = 50_000
LOG_GAP_S = 10.0
MODELS_SHOWN = 3
RAW_OPACITY = 120
POSE = ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad")


@dataclass(frozen=True)
class Clock:
    """Where each log and segment stands on the recording's timeline, in seconds."""

    segments: Mapping[str, float]
    logs: Mapping[str, float]
    boot_s: Mapping[str, float]

    def seconds(self, name: str, table: pa.Table) -> Array | None:
        """The times (n,) of a table stored under `stage/item/port`; None if it has no clock or belongs to no log.

        A table with `t_s` that belongs to no segment (a bench leg, a closed-loop run) keeps its own seconds.
        """
        parts = name.split("/")
        segment = next((part for part in parts if part in self.segments), None)
        if "t_s" in table.column_names:
            return np.asarray(column(table, "t_s") + (self.segments[segment] if segment is not None else 0.0))
        log = next((part for part in parts if part in self.logs), None)
        if "time_us" in table.column_names and log is not None:
            return np.asarray(column(table, "time_us") * 1e-6 - self.boot_s[log] + self.logs[log])
        return None


def log_seconds(log: Document) -> float:
    """Length of a log from its first to its last time-stamped record."""
    return float(log["end_us"] - log["start_us"]) * 1e-6


def make_clock(segments: Mapping[str, Document], logs: Mapping[str, Document]) -> Clock:
    """Logs one after the other, `LOG_GAP_S` apart; a segment starts at its place in its log."""
    starts, place = {}, 0.0
    for name, log in logs.items():
        starts[name] = place
        place += log_seconds(log) + LOG_GAP_S
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
    stream.send_recording_name(str(visible(title)))
    _log_static(stream, "answer/text", rr.TextDocument(markdown(title, summary, segments, clock), media_type=rr.MediaType.MARKDOWN))
    ranges = _send_groups(stream, groups, tables, clock, _preferred(summary))
    corners = _send_path(stream, fused, segments, clock, path_rate_hz)
    _send_messages(stream, tables, segments, clock)
    parts = [(clock.segments[name], clock.segments[name] + float(item["duration_s"])) for name, item in segments.items()]
    whole = [(clock.logs[name], clock.logs[name] + log_seconds(log)) for name, log in logs.items()]
    stream.send_blueprint(whole_view(groups, frozenset(logs), Seen(ranges, _outer(parts), _outer(whole), corners)))
    stream.flush()
    data: bytes = sink.read(flush=True) or b""
    return data


def _outer(spans: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """From the first start to the last end."""
    return min((low for low, _ in spans), default=0.0), max((high for _, high in spans), default=1.0)


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
) -> dict[str, tuple[float, float]]:
    """Send every group that has its table; returns entity -> range of the series that are drawn at first."""
    ranges: dict[str, tuple[float, float]] = {}
    for entity, owner, bundle in _bundles(groups):
        name = find_table(tables, owner, str(bundle[0]["table"]))
        if name is None:
            continue
        table = tables[name]
        parts = [_rows(table, group) for group in bundle]
        times = clock.seconds(name, parts[0])
        if times is None or not len(times) or not all(has_columns(table, group["columns"]) for group in bundle):
            continue
        if entity not in ranges:
            _log_static(stream, entity, _lines(bundle, preferred))
        values = np.hstack([matrix(part, group["columns"]) for part, group in zip(parts, bundle, strict=True)])
        _send_series(stream, entity, times, values)
        drawn = values[:, _shown(bundle, preferred)]
        good = drawn[np.isfinite(drawn)]
        if good.size:
            ranges[entity] = _outer([ranges.get(entity, (np.inf, -np.inf)), (float(good.min()), float(good.max()))])
        ranges.setdefault(entity, (np.inf, -np.inf))
    return ranges


def _shown(bundle: Sequence[Document], preferred: Sequence[str]) -> list[bool]:
    """Which series of an entity are drawn at first: all but the models that are not preferred."""
    liked = {key(name) for name in preferred}
    roles = [str(role) for group in bundle for role in group["roles"]]
    return [not is_model(role) or not liked or key(role) in liked for role in roles]


def _rows(table: pa.Table, group: Document) -> pa.Table:
    for wanted, value in (group.get("filter") or {}).items():
        table = table.filter(pc.equal(table[wanted], value))
    return table


def _bundles(groups: Sequence[Owned]) -> list[tuple[str, str, list[Document]]]:
    """(entity, owner, groups): groups that cut the same long table by a filter share its clock, so they become one entity."""
    bundles: dict[tuple[str, ...], list[Document]] = defaultdict(list)
    for owner, group in groups:
        cut = bool(group.get("filter")) and bool(parent(group))
        entity = parent(group) if cut else str(visible(group["entity"]))
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
    names, inks, faint = [], [], []
    for group in bundle:
        by_axis = len(set(group["roles"])) == 1 and len(group["roles"]) > 1
        for name, role in zip(group["names"], group["roles"], strict=True):
            names.append(str(visible(str(name))))
            inks.append(_series_ink(str(name), str(role), by_axis))
            faint.append(str(role) == "raw")
    colours = [(*item.rgb, RAW_OPACITY if pale else 255) for item, pale in zip(inks, faint, strict=True)]
    return rr.SeriesLines(colors=colours, names=names, widths=[item.width for item in inks], visible_series=_shown(bundle, preferred))


def _series_ink(name: str, role: str, many_of_one_role: bool) -> Ink:
    """Three axes in one plot are told apart by axis; otherwise the role has its colour."""
    axis = next((word for word in key(name).split("_") if word in AXES), None)
    if many_of_one_role and axis is not None:
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
) -> Array:
    """Send the path of each segment and the vehicle on it; returns the corners (2, 3) of the box that holds all paths, in m, NED."""
    corners = np.array([np.full(3, np.inf), np.full(3, -np.inf)])
    _log_static(stream, "path", rr.ViewCoordinates.FRD)
    for name, table in fused.items():
        use = str(segments[name]["use"])
        pose = matrix(table, POSE)
        times = column(table, "t_s") + clock.segments[name]
        good = np.isfinite(pose).all(axis=1)
        if not good.any():
            continue
        stride = max(1, round((times.size - 1) / max(times[-1] - times[0], 1e-9) / rate_hz)) if times.size > 1 else 1
        pose, times = pose[good][::stride], times[good][::stride]
        corners = np.array([np.minimum(corners[0], pose[:, :3].min(axis=0)), np.maximum(corners[1], pose[:, :3].max(axis=0))])
        _log_static(
            stream,
            "path/" + rr.escape_entity_path_part(name),
            rr.LineStrips3D([pose[:, :3]], colors=[ROLES[use].rgb], labels=[str(visible(f"{name} ({use})"))]),
        )
        stream.send_columns(
            "path/vehicle",
            [rr.TimeColumn(TIMELINE, duration=times)],
            rr.Transform3D.columns(translation=pose[:, :3], quaternion=_quaternions(pose[:, 3:])),
        )
    axes = [AXES[name].rgb for name in ("x", "y", "z")]
    _log_static(stream, "path/vehicle/axes", rr.Arrows3D(vectors=0.6 * np.eye(3), colors=axes, labels=["x", "y", "z"]))
    return corners if np.isfinite(corners).all() else np.array([np.full(3, -1.0), np.full(3, 1.0)])


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
