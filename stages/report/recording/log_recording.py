"""Recording of one raw log: its streams, modes, legs, findings and path.

Streams are plotted by group, modes and legs are spans, findings and messages text;
attitude and path are in 3D.

It opens on what the log can be used for. Seconds count from the log's first
time-stamped record. The path is what the log says of its position; else it is reckoned
from velocity and attitude, or stands on the spot, and its label says which.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.stages.base import Document
from auvid.stages.number_format import printed_unit, visible
from auvid.stages.page.colours import GREEN, GREY, ROLES, VERMILLION, Ink, distinct
from auvid.stages.presentation import degrees
from auvid.stages.report.recording.blueprint import opened, paths_view, spans_view, time_plot
from auvid.stages.report.recording.identity import log_properties
from auvid.stages.report.recording.readable import readable
from auvid.stages.report.recording.recording import line_inks
from auvid.stages.report.recording.rerun_stream import PREVIEW_BINS, Recording

TABS: Mapping[str, tuple[str, ...]] = {
    "Motion": ("velocity", "attitude", "imu"),
    "Place": ("depth", "position", "range"),
    "Vehicle": ("actuators", "battery"),
}
OPENING = ("depth/m", "velocity/m_s", "attitude/deg", "actuators/us")
ATTITUDE = ("phi_rad", "theta_rad", "psi_rad")
VELOCITY = ("u_m_s", "v_m_s", "w_m_s")
PLACE = ("x_m", "y_m", "z_m")
PATH_RATE_HZ = 10.0
LONG_PAUSE_S = 1.0
MOST_PAUSES = 100
MOST_LEGS = 40


@dataclass(frozen=True)
class StreamPlot:
    """One plot: its entity, stream, unit, range of values and number of lines."""

    entity: str
    stream: str
    unit: str
    low: float
    high: float
    lines: int


def record_log(
    name: str,
    tables: Mapping[str, pa.Table],
    info: LogInfo,
    health: Document,
    legs: Sequence[Document] = (),
    *,
    preview: bool = False,
    tab: str = "",
) -> bytes:
    """Return the recording of a log as .rrd bytes, which opens on `tab`.

    `tables`: its streams, `info` and `health`: its documents (schemas `log_info`,
    `health`); `legs`: id, use, start_s and end_s of each.
    """
    out = Recording(
        f"Log {name}",
        content=[health, info.start_us, info.end_us],
        properties=log_properties(name, health),
        bins=PREVIEW_BINS if preview else None,
    )
    origin_us = int(info.start_us)
    clocks = {
        stream: (column(table, "time_us") - origin_us) * 1e-6 for stream, table in tables.items()
    }
    end = max((float(clock[-1]) for clock in clocks.values() if clock.size), default=1.0)
    span = (min(0.0, *(float(clock[0]) for clock in clocks.values() if clock.size)), end)
    out.document("answer/text", log_text(name, info, health))
    plots = [
        plot
        for stream, table in tables.items()
        for plot in _send_stream(out, stream, table, clocks[stream])
    ]
    lanes = _send_spans(out, tables, clocks, legs, end)
    _send_messages(out, tables, clocks, health)
    corners = _send_path(out, tables, clocks)
    try:
        blueprint = _blueprint(plots, lanes, corners, span, tab)
    except PipelineError:  # a tab that there is not
        out.discard()
        raise
    return out.finish(blueprint)


def _send_stream(out: Recording, stream: str, table: pa.Table, clock: Array) -> list[StreamPlot]:
    """One entity per unit of a stream; a pause longer than a second stays a gap."""
    units: dict[str, list[str]] = {}
    for item in schema(stream).columns.values():
        for name in (
            [item.name]
            if item.name in table.column_names
            and pa.types.is_floating(table.schema.field(item.name).type)
            else []
        ):
            units.setdefault(str(item.unit or ""), []).append(name)
    plots = []
    for unit, names in units.items():
        factor, reading = readable(unit, names)
        values = factor * matrix(table, names)
        good = values[np.isfinite(values)]
        if not good.size:
            continue
        own = degrees(unit)[1]
        entity = f"raw/{stream}/{own.replace('/', '_').replace('^', '') or 'value'}"
        inks = line_inks(names, ["raw"] * len(names))
        out.static(
            entity,
            rr.SeriesLines(
                colors=[item.rgb for item in inks],
                names=[_words(name, unit) for name in names],
                widths=1.5,
                aggregation_policy="MinMax",
            ),
        )
        out.series(entity, clock, values, pause_s=LONG_PAUSE_S)
        plots.append(
            StreamPlot(entity, stream, reading, float(good.min()), float(good.max()), len(names))
        )
    return plots


def _words(column_name: str, unit: str) -> str:
    """Return the name of a column without its unit, which the plot has.

    >>> _words("gyro_x_rad_s", "rad/s"), _words("depth_m", "m")
    ('gyro x', 'depth')
    """
    suffix = unit.replace("/", "_").replace("^", "")
    return column_name.removesuffix(f"_{suffix}").replace("_", " ")


def _send_spans(
    out: Recording,
    tables: Mapping[str, pa.Table],
    clocks: Mapping[str, Array],
    legs: Sequence[Document],
    end: float,
) -> bool:
    """Send mode, arming, legs and the pauses of streams as lanes of spans.

    Returns whether there is any.
    """
    has_spans = False
    if "mode" in tables and len(clocks["mode"]):
        table, clock = tables["mode"], clocks["mode"]
        modes = [str(mode) for mode in table["mode"].to_pylist()]
        out.states("spans/mode", [*clock, end], [*modes, None], distinct(modes))
        if has_columns(table, ("armed",)):
            armed = [
                {True: "armed", False: "disarmed"}.get(value)
                for value in table["armed"].to_pylist()
            ]
            out.states(
                "spans/armed",
                [*clock, end],
                [*armed, None],
                {"armed": Ink(*GREEN), "disarmed": Ink(*GREY)},
            )
        has_spans = True
    for leg in legs[:MOST_LEGS]:
        use = str(leg.get("use") or "leg")
        times = [float(leg["start_s"]), float(leg["end_s"])]
        out.states(
            f"spans/legs/{rr.escape_entity_path_part(str(leg['id']))}",
            times,
            [use, None],
            {use: ROLES.get(use, Ink(*GREY))},
        )
        has_spans = True
    for stream, clock in clocks.items():
        after = _pauses(stream, clock)
        if after.size:
            times = np.column_stack([clock[after], clock[after + 1]]).ravel().tolist()
            out.states(
                f"spans/pauses/{stream}",
                times,
                ["pause", None] * after.size,
                {"pause": Ink(*VERMILLION)},
            )
            has_spans = True
    return has_spans


def _pauses(stream: str, clock: Array) -> npt.NDArray[np.intp]:
    """Return the indices of the samples after which a stream pauses.

    A stream that is logged on change does not pause.
    """
    if stream in ("mode", "events") or clock.size < 3:
        return np.zeros(0, dtype=np.intp)
    steps = np.diff(clock)
    return np.flatnonzero(steps > max(LONG_PAUSE_S, 5.0 * float(np.median(steps))))


def _send_messages(
    out: Recording, tables: Mapping[str, pa.Table], clocks: Mapping[str, Array], health: Document
) -> None:
    messages = [
        (float(item.get("at_s") or 0.0), str(item["severity"]), f"{item['text']} {item['remedy']}")
        for item in health["findings"]
    ]
    out.messages("log/findings", messages)
    for stream, words in (("events", "text"), ("mode", "mode")):
        if stream in tables:
            texts = tables[stream][words].to_pylist()
            lead = "mode " if stream == "mode" else ""
            out.messages(
                f"log/{stream}",
                [
                    (time, "note", f"{lead}{text}")
                    for time, text in zip(clocks[stream].tolist(), texts, strict=True)
                ],
            )
    for stream, clock in clocks.items():
        after = _pauses(stream, clock)
        rows = [
            (float(clock[at]), "warning", f"{stream} pauses for {clock[at + 1] - clock[at]:.2f} s")
            for at in after[:MOST_PAUSES]
        ]
        if after.size > MOST_PAUSES:
            rows.append(
                (
                    float(clock[after[MOST_PAUSES]]),
                    "warning",
                    f"{stream} pauses {after.size - MOST_PAUSES} times more",
                )
            )
        out.messages(f"log/pauses/{stream}", rows)


def _send_path(
    out: Recording, tables: Mapping[str, pa.Table], clocks: Mapping[str, Array]
) -> Array | None:
    """Send path and attitude at 10 Hz, each the last sample before.

    Returns the corners (2, 3) of its box in m, None without attitude.
    """
    if "attitude" not in tables or clocks["attitude"].size < 2:
        return None
    clock, euler = clocks["attitude"], matrix(tables["attitude"], ATTITUDE)
    good = np.isfinite(euler).all(axis=1)
    if good.sum() < 2:
        return None
    clock, euler = clock[good], euler[good]
    times = np.arange(
        clock[0], clock[-1], max(1.0 / PATH_RATE_HZ, (clock[-1] - clock[0]) / 200_000)
    )
    euler = last_before(times, clock, euler)
    place, source = _places(times, euler, tables, clocks)
    out.static("path", rr.ViewCoordinates.FRD)
    out.static(
        "path/line",
        rr.LineStrips3D([place], colors=[ROLES["fused"].rgb], labels=[f"path from {source}"]),
    )
    out.body("path/vehicle", times, np.hstack([place, euler]))
    out.body_axes("path/vehicle")
    return np.array([place.min(axis=0), place.max(axis=0)])


def _places(
    times: Array, euler: Array, tables: Mapping[str, pa.Table], clocks: Mapping[str, Array]
) -> tuple[Array, str]:
    """Places (n, 3) in m NED at `times` (n,) and what they were taken from."""
    depth = np.zeros(times.size)
    if "depth" in tables and clocks["depth"].size:
        depth = np.nan_to_num(
            last_before(times, clocks["depth"], column(tables["depth"], "depth_m"))
        )
    if "position" in tables and clocks["position"].size:
        place = last_before(times, clocks["position"], matrix(tables["position"], PLACE))
        if np.isfinite(place[:, :2]).all(axis=1).any():
            place[:, 2] = np.where(np.isfinite(place[:, 2]), place[:, 2], depth)
            return np.nan_to_num(place), "logged positions"
    if (
        "velocity" in tables
        and clocks["velocity"].size
        and has_columns(tables["velocity"], VELOCITY)
    ):
        velocity = np.nan_to_num(
            last_before(times, clocks["velocity"], matrix(tables["velocity"], VELOCITY))
        )
        step = np.diff(times, append=times[-1])[:, None]
        place = np.cumsum(
            np.einsum("nij,nj->ni", rotation_body_to_ned(euler), velocity) * step, axis=0
        )
        place[:, 2] = depth if "depth" in tables else place[:, 2]
        return place, "velocity and attitude, reckoned"
    return np.column_stack([np.zeros((times.size, 2)), depth]), "depth alone"


def last_before(times: Array, clock: Array, values: Array) -> Array:
    """Return the last of the values at `clock` (m,) before each of `times` (n,).

    Values are (m,) or (m, k); the first is used before all of them.
    """
    latest: Array = values[
        np.clip(np.searchsorted(clock, times, side="right") - 1, 0, clock.size - 1)
    ]
    return latest


def log_text(name: str, info: LogInfo, health: Document) -> str:
    """Return what the log is, what it can be used for, its findings and its streams."""
    size = (
        f"{health['bytes'] / 1e6:.2f} MB" if health["bytes"] >= 1e4 else f"{health['bytes']} bytes"
    )
    lines = [f"# Log {name}", f"**{health['verdict']}**", ""]
    about = [
        f"{health['vehicle'] or 'vehicle not named'}",
        *health["formats"],
        size,
        f"{health['duration_s']:.1f} s",
        health["status"],
    ]
    lines += [", ".join(about), ""]
    marks = {"error": "✗", "warning": "!", "note": "·"}
    lines += (
        [
            "## Findings",
            *(f"- {marks[item['severity']]} {item['text']}" for item in health["findings"]),
        ]
        if health["findings"]
        else []
    )
    lines += ["", "| stream | source | samples | Hz | longest gap |", "|---|---|---|---|---|"]
    for stream, item in health["streams"].items():
        rate = "" if item["rate_hz"] is None else f"{item['rate_hz']:.3g}"
        lines.append(
            f"| {stream} | {_cell(item['source'])} | {item['rows']} | {rate} |"
            f" {item['longest_gap_s']:.3g} s |"
        )
    cannot = [item for item in health["capabilities"] if not item["possible"]]
    lines += (
        [
            "",
            "## What it cannot be used for",
            *(f"- {item['name']}: {item['reason']}" for item in cannot),
        ]
        if cannot
        else []
    )
    lines += ["", "## Notes", *(f"- {note}" for note in info.notes)] if info.notes else []
    return "\n".join(lines)


def _cell(words: object) -> str:
    return str(visible(str(words))).replace("|", "\\|").replace("\n", " ")


def _blueprint(
    plots: Sequence[StreamPlot],
    lanes: bool,
    corners: Array | None,
    span: tuple[float, float],
    tab: str,
) -> rrb.Blueprint:
    views = {
        plot.entity: time_plot(
            plot.entity, f"{plot.stream} [{printed_unit(plot.unit)}]", span, (plot.low, plot.high)
        )
        for plot in plots
    }
    opening: list[Any] = [spans_view("Modes, legs and pauses", span)] if lanes else []
    opening += [views[f"raw/{name}"] for name in OPENING if f"raw/{name}" in views][:3]
    words = rrb.TextDocumentView(origin="answer/text", name="Summary")
    tabs: list[Any] = [
        (
            rrb.Horizontal(rrb.Vertical(*opening), words, column_shares=[7, 3], name="Answer")
            if opening
            else words
        )
    ]
    tabs += [paths_view({"path": corners})] if corners is not None else []
    for name, streams in TABS.items():
        chosen = [
            views[plot.entity] for stream in streams for plot in plots if plot.stream == stream
        ]
        if chosen:
            tabs.append(rrb.Grid(*chosen, grid_columns=1 if len(chosen) < 4 else 2, name=name))
    return opened([*tabs, rrb.TextLogView(origin="log", name="Log")], tab)
