"""The pictures of the first screen, from the tables that the stages gave.

A dive and its answer where legs were identified; else the signals of the bench and what
was fitted, or the flights of a controller.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
from markupsafe import Markup

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, has_columns, matrix, split_by
from auvid.hydro.arrays import AXES, Array
from auvid.stages.base import Document, part_of
from auvid.stages.columns import AXIS_UNITS, FINS, POSITION, VELOCITY, force_columns
from auvid.stages.page.first_screen import AXIS_WORDS, Summary
from auvid.stages.page.pictures.answer_picture import ForceCloud, answer_picture, cloud_picture
from auvid.stages.page.pictures.dive_picture import (
    ActuatorUse,
    DrawnLeg,
    dive_picture,
    largest_of_bins,
    track_picture,
)
from auvid.stages.page.pictures.drawing import CurveRow, SignalCurve, Span
from auvid.stages.page.pictures.signal_picture import signal_picture
from auvid.stages.presentation import degrees
from auvid.stages.report.clock import Clock, make_clock
from auvid.stages.report.glide_pictures import glide_pictures

Tables = Mapping[str, pa.Table]
NO_VIEWS: Mapping[str, Document] = {}
DEGREES = 180.0 / np.pi
RUN_ROWS = {
    "u_m_s": ("surge u", "m/s", 1.0),
    "v_m_s": ("sway v", "m/s", 1.0),
    "w_m_s": ("heave w", "m/s", 1.0),
    "r_rad_s": ("yaw rate r", "°/s", DEGREES),
}
"""Quantities of the free run on the first screen: name, unit, factor."""
MOST_ROWS = 4
FLIGHT_ROLES = ("training", "validation", "y")
"""Colours of the flights of a controller: three that differ among themselves and from
that of what is desired.
"""


def first_pictures(
    tables: Tables,
    fused: Tables,
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    summary: Summary,
    views: Mapping[str, Document] = NO_VIEWS,
) -> tuple[Markup, ...]:
    """Return the pictures that this kind of campaign has, at most two.

    `views` of the stages tell the units of single channels.
    """
    if fused and segments:
        clock = make_clock(segments, logs)
        pictures = [_dive(tables, fused, segments, logs, clock)]
        answer = _answer(tables, fused, segments, summary, clock)
        return (*pictures, answer) if answer else tuple(pictures)
    by_port = {name: name.split("/") for name in tables}
    channels = [name for name, parts in by_port.items() if parts[-1] == "channel_run"]
    swings = [name for name, parts in by_port.items() if parts[-1] in ("decays", "swings")]
    flights = [name for name, parts in by_port.items() if "flights" in parts]
    motions = [name for name, parts in by_port.items() if "axis_motion" in parts]
    glides = [name for name, parts in by_port.items() if parts[-1] == "glides"]
    passive = [name for name, parts in by_port.items() if parts[-1] == "passive_motions"]
    drawings: list[Markup] = []
    if glides and tables[glides[0]].num_rows:
        drawings += glide_pictures(tables[glides[0]], tables, logs)
    if motions:
        drawings += _axes({name.split("/")[-1]: tables[name] for name in motions})
    if passive and tables[passive[0]].num_rows:
        drawings += _stretches(tables[passive[0]])
    if channels:
        units = {
            str(group["entity"]): str(group["unit"])
            for item in views.values()
            for group in item["groups"]
        }
        drawings += _channels({name.split("/")[-2]: tables[name] for name in channels}, units)
    if swings:
        drawings += _swings({name: tables[name] for name in swings})
    if flights:
        drawings += _flights(tables, flights)
    return tuple(drawings[:2])


def _dive(
    tables: Tables,
    fused: Tables,
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    clock: Clock,
) -> Markup:
    legs = []
    for name, item in segments.items():
        if name in fused:
            table = part_of(fused, name, POSITION)
            t_s = column(table, "t_s") + clock.segments[name]
            legs.append(DrawnLeg(name, item.use, t_s, matrix(table, POSITION)))
    depth, modes = _depth(tables, logs, clock), _modes(tables, logs, clock)
    clocks = [*(leg.t_s for leg in legs), *([depth[0]] if depth is not None else [])]
    everything = np.concatenate([time[[0, -1]] for time in clocks if time.size])
    span = (float(everything.min()), float(everything.max()))
    starts = {f"residual/{leg.name}/controls": clock.segments[leg.name] for leg in legs}
    return dive_picture(
        legs,
        depth=depth,
        modes=sorted(modes),
        actuators=_actuators(tables, starts, span),
        span=span,
        clock=_clock_words(logs),
    )


def _depth(tables: Tables, logs: Mapping[str, LogInfo], clock: Clock) -> tuple[Array, Array] | None:
    """Return times and depth of all logs, with a gap behind each; None for none."""
    depths: list[tuple[Array, Array]] = []
    for place in (f"ingest/{name}/depth" for name in logs):
        table = part_of(tables, place, ("depth_m",)) if place in tables else None
        if table is not None and (times := clock.seconds(place, table)) is not None:
            depths.append(
                (np.append(times, times[-1:]), np.append(column(table, "depth_m"), np.nan))
            )
    return _joined(depths) if depths else None


def _modes(tables: Tables, logs: Mapping[str, LogInfo], clock: Clock) -> list[tuple[float, str]]:
    """Return when each flight mode of all logs begins."""
    modes: list[tuple[float, str]] = []
    for place in (f"ingest/{name}/mode" for name in logs):
        table = tables.get(place)
        if table is not None and (times := clock.seconds(place, table)) is not None:
            modes += zip(times.tolist(), map(str, table["mode"].to_pylist()), strict=True)
    return modes


def _clock_words(logs: Mapping[str, LogInfo]) -> str:
    return "time in s" if len(logs) < 2 else f"time in s, {len(logs)} logs one after the other"


def _joined(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    times, values = zip(*parts, strict=True)
    return np.concatenate(times), np.concatenate(values)


def _actuators(tables: Tables, starts: Mapping[str, float], span: Span) -> list[ActuatorUse]:
    """Return what every actuator did over the legs; thrusters, propeller and fins.

    starts: when each table of controls begins. One of them is in memory at a time.
    """
    uses: dict[str, list[tuple[Array, Array]]] = {}
    nothing = (np.zeros(0), np.zeros(0))
    for count, (place, start) in enumerate(starts.items()):
        table = tables.get(place)
        for name in () if table is None else table.column_names:
            label, _, factor = _actuator(name)
            if label and table is not None:
                earlier = uses.setdefault(name, [nothing] * count)
                times = column(table, "t_s") + start
                earlier.append(largest_of_bins(times, factor * column(table, name), span))
        for parts in uses.values():
            parts += [nothing] * (count + 1 - len(parts))
    return [
        ActuatorUse(*_actuator(name)[:2], *zip(*parts, strict=True)) for name, parts in uses.items()
    ]


def _actuator(name: str) -> tuple[str, str, float]:
    """Return label, unit and factor of a column of `controls`; empty for no actuator.

    >>> _actuator("thruster_3_N"), _actuator("level_speed_m_s")
    (('3', 'N', 1.0), ('', '', 1.0))
    """
    if name.startswith("thruster_"):
        return name.removeprefix("thruster_").removesuffix("_N"), "N", 1.0
    if name == "propeller_rev_s":
        return "prop", "rev/s", 1.0
    if name in FINS:
        return f"fin {name.split('_')[1]}", "°", DEGREES
    return "", "", 1.0


def _answer(
    tables: Tables,
    fused: Tables,
    segments: Mapping[str, SegmentRecord],
    summary: Summary,
    clock: Clock,
) -> Markup | None:
    """Return the picture of the recommended model, else of the first one judged."""
    model = next((m for m in summary.models if m.name == summary.recommended), None)
    if model is None:
        if not summary.models:
            return None
        model = summary.models[0]
    on_validation = summary.judged_on == "validation"
    legs = [
        name
        for name, item in segments.items()
        if item.use == summary.judged_on
        and f"validate/predictions/{name}" in tables
        and f"residual/{name}/residual" in tables
    ]
    if not legs:
        return None
    measured, predicted = [], []
    for name in legs:
        table = split_by(tables[f"validate/predictions/{name}"], "model")[model.name]
        measured.append(matrix(tables[f"residual/{name}/residual"], force_columns("tau_bar")))
        predicted.append(matrix(table, force_columns("tau")))
    force, answer = np.vstack(measured), np.vstack(predicted)
    clouds = []
    for i, axis in enumerate(AXES):
        merit = model.axes[axis]
        ratio = merit.validation if on_validation else merit.training
        clouds.append(
            ForceCloud(
                f"{axis} {AXIS_WORDS[axis]}", AXIS_UNITS[axis], force[:, i], answer[:, i], ratio
            )
        )
    flown = [name for name in legs if f"validate/simulated_motion/{name}" in tables]
    rows, span = _run_rows(tables, fused, flown, model.name, clock)
    title = model.title if summary.recommended else f"{model.title} (not recommended)"
    return answer_picture(
        title,
        model.name,
        clouds,
        rows,
        judged_on=summary.judged_on,
        span=span,
        clock="time in s, validation legs one after the other" if len(flown) > 1 else "time in s",
    )


def _run_rows(
    tables: Tables, fused: Tables, legs: list[str], model: str, clock: Clock
) -> tuple[list[CurveRow], Span]:
    """Return rows of the free run over what was measured, the legs joined together."""
    measured: dict[str, list[tuple[Array, Array]]] = {name: [] for name in RUN_ROWS}
    flown: dict[str, list[tuple[Array, Array]]] = {name: [] for name in RUN_ROWS}
    first, place = (clock.segments[legs[0]] if len(legs) == 1 else 0.0), 0.0
    for leg in legs:
        run, truth = tables[f"validate/simulated_motion/{leg}"], fused[leg]
        times, own = column(run, "t_s"), column(truth, "t_s")
        for name, (_, _, factor) in RUN_ROWS.items():
            flown[name].append((times + first + place, factor * column(run, name)))
            measured[name].append(
                (
                    np.append(own, own[-1]) + first + place,
                    np.append(factor * column(truth, name), np.nan),
                )
            )
        place += float(own[-1])
    if not legs:
        return [], (0.0, 1.0)
    rows = []
    for name, (label, unit, _) in RUN_ROWS.items():
        curves = (
            SignalCurve("measured", *_joined(measured[name])),
            SignalCurve(model, *_joined(flown[name])),
        )
        rows.append(CurveRow(label, unit, curves))
    return rows, (first, first + place)


def _channels(runs: Tables, units: Mapping[str, str]) -> tuple[Markup, ...]:
    """Return signals of single-channel runs with the damping of their results.

    `units`: entity of a view -> its unit. What is measured in metres is a depth.
    """
    rows: list[tuple[CurveRow, Span]] = []
    clouds = []
    for leg, table in list(runs.items())[:MOST_ROWS]:
        factor, unit = degrees(units.get(f"rlse/{leg}/run", ""))
        times, measured = column(table, "t_s"), factor * column(table, "measured")
        damping = _chosen(table)
        simulated = factor * column(table, damping.replace(" ", "_"))
        curves = (
            SignalCurve("measured", times, measured),
            SignalCurve("predicted", times, simulated),
        )
        span = (float(times[0]), float(times[-1]))
        is_depth = unit == "m"
        label = f"{leg}: {'depth, ' if is_depth else ''}{damping} damping"
        rows.append((CurveRow(label, unit, curves, downwards=is_depth), span))
        clouds.append(ForceCloud(leg, unit, measured, simulated))
    return _bench_pictures("Measured and simulated", "runs", len(runs), rows, clouds)


def _axes(motions: Tables) -> tuple[Markup, ...]:
    """Return measured and simulated rates over windows, longest legs first."""
    rows: list[tuple[CurveRow, Span]] = []
    clouds = []
    by_length = sorted(motions.items(), key=lambda item: -item[1].num_rows)
    for leg, table in by_length:
        times = 1e-6 * column(table, "t_us")
        times = times - times[0]
        for axis, name in zip(AXES, VELOCITY, strict=True):
            simulated = column(table, f"simulated_{name}")
            if not np.isfinite(simulated).any() or len(rows) == MOST_ROWS:
                continue
            factor, unit = degrees("rad/s" if name.endswith("rad_s") else "m/s")
            measured = factor * column(table, f"measured_{name}")
            curves = (
                SignalCurve("measured", times, measured),
                SignalCurve("predicted", times, factor * simulated),
            )
            label = f"{AXIS_WORDS[axis]}, leg {leg}"
            rows.append((CurveRow(label, unit, curves), (float(times[0]), float(times[-1]))))
            clouds.append(ForceCloud(label, unit, measured, factor * simulated))
    count = sum(
        bool(np.isfinite(column(table, f"simulated_{name}")).any())
        for table in motions.values()
        for name in VELOCITY
    )
    title = "Measured and simulated, window by window"
    return _bench_pictures(title, "axes of the legs", count, rows, clouds)


def _bench_pictures(
    title: str,
    what: str,
    count: int,
    rows: list[tuple[CurveRow, Span]],
    clouds: list[ForceCloud],
) -> tuple[Markup, ...]:
    """Return signals over time with their fits, and fitted against measured."""
    note = f"first {len(rows)} of {count} {what}" if count > len(rows) else ""
    entries = [("measured", "measured"), ("simulated", "predicted")]
    return (
        signal_picture(title, note, rows, entries),
        cloud_picture("Simulated (up) against measured (across)", note, clouds),
    )


def _chosen(table: pa.Table) -> str:
    """Return the damping that the results of a recording are of."""
    return str(table["chosen"][0].as_py())


def _swings(recorded: Tables) -> tuple[Markup, ...]:
    """Return decays and swings over time with their fits, of the first recordings."""
    rows: list[tuple[CurveRow, Span]] = []
    clouds, count = [], 0
    for name in sorted(recorded, key=lambda name: not name.endswith("decays")):
        is_decay = name.endswith("decays")
        for recording, part in split_by(recorded[name], "recording").items():
            count += 1
            if len(rows) == MOST_ROWS:
                continue
            times = column(part, "t_s")
            measured = DEGREES * column(
                part, "theta_measured_rad" if is_decay else "rate_measured_rad_s"
            )
            if is_decay:
                damping = _chosen(part)
                fitted = DEGREES * column(part, f"theta_{damping.replace(' ', '_')}_rad")
                label, unit = f"{recording}: angle, {damping} damping", "°"
            else:
                fitted = DEGREES * column(part, "rate_fitted_rad_s")
                label, unit = f"{recording}: rate of the swing", "°/s"
            curves = (
                SignalCurve("measured", times, measured),
                SignalCurve("predicted", times, fitted),
            )
            rows.append((CurveRow(label, unit, curves), (float(times[0]), float(times[-1]))))
            clouds.append(ForceCloud(recording, unit, measured, fitted))
    return _bench_pictures("Decays and swings", "recordings", count, rows, clouds)


def _stretches(motions: pa.Table) -> tuple[Markup, ...]:
    """Return tows, coasts and decays with their fits, one of each motion first."""
    turns: dict[int, list[tuple[str, pa.Table]]] = {}
    for name, of_motion in split_by(motions, "motion").items():
        for channel, of_channel in split_by(of_motion, "channel").items():
            for place, part in enumerate(split_by(of_channel, "number").values()):
                turns.setdefault(place, []).append((f"{name} in {channel}", part))
    parts = [item for place in sorted(turns) for item in turns[place]]
    rows: list[tuple[CurveRow, Span]] = []
    clouds = []
    for label, part in parts[:MOST_ROWS]:
        rotates = label.split()[-1] in ("roll", "pitch", "yaw")
        factor, unit = (DEGREES, "°") if rotates else (1.0, "N" if "tow" in label else "m/s")
        if label.endswith("yaw"):
            unit = "°/s"
        elif label == "decay in heave":
            unit = "m"
        times = column(part, "t_s")
        measured, fitted = (factor * column(part, name) for name in ("measured", "fitted"))
        curves = (
            SignalCurve("measured", times, measured),
            SignalCurve("predicted", times, fitted),
        )
        whose = f"{label}, {part['recording'][0].as_py()}"
        rows.append((CurveRow(whose, unit, curves), (float(times[0]), float(times[-1]))))
        clouds.append(ForceCloud(whose, unit, measured, fitted))
    return _bench_pictures("Motion without thrust", "stretches", len(parts), rows, clouds)


def _flights(tables: Tables, names: list[str]) -> tuple[Markup, ...]:
    """Return depth and distance from the desired place of one trajectory's flights.

    Beside them their tracks from above. Flights of the first trajectory, the first few.
    """
    first = names[0].split("/")[-1].partition("-")[0]
    desired = tuple(f"desired_{name}" for name in POSITION)
    chosen = [name for name in names if name.split("/")[-1].partition("-")[0] == first]
    errors: list[SignalCurve] = []
    depths: list[SignalCurve] = []
    tracks: list[DrawnLeg] = []
    entries = [("desired", "desired")]
    for role, name in zip(FLIGHT_ROLES, chosen, strict=False):
        table = tables[name]
        if not has_columns(table, (*POSITION, *desired)):
            return ()
        flight = name.split("/")[-1].partition("-")[2]
        times, flown, target = column(table, "t_s"), matrix(table, POSITION), matrix(table, desired)
        errors.append(SignalCurve(role, times, np.linalg.norm(flown - target, axis=1)))
        if not tracks:
            depths.append(SignalCurve("desired", times, target[:, 2]))
            tracks.append(DrawnLeg("desired", "desired", times, target))
        depths.append(SignalCurve(role, times, flown[:, 2]))
        tracks.append(DrawnLeg(flight.replace("_", " "), role, times, flown))
        entries.append((flight.replace("_", " "), role))
    span = (0.0, float(max(curve.x[-1] for curve in errors)))
    rows = [
        (CurveRow("depth", "m", tuple(depths), downwards=True, height="tall"), span),
        (CurveRow("distance from the desired place", "m", tuple(errors), height="tall"), span),
    ]
    note = f"first {len(errors)} of {len(chosen)} flights" if len(chosen) > len(errors) else ""
    return (
        track_picture(f"Track of {first}", tracks),
        signal_picture(f"Flights of {first}", note, rows, entries),
    )
