"""Put the sensors of a leg on a uniform clock, with spline derivatives.

Gaps, and jumps of the attitude, split the leg into segments. A smoothing spline stands
for each channel; attitude is smoothed as a rotation. Vectors are turned from sensor to
body axes first, here and nowhere after, so that all tables of a segment are in body
axes; lever arms stay, `fuse` takes them out. One smoothing parameter holds for a whole
segment, so a signal whose character changes within it is smoothed for the mixture.
Splines and low-pass filters are wrong near the ends of what they are given. So a segment
also takes what the log holds within `margin_s` before and after its leg, at negative
times and times beyond `duration_s`; `fuse` cuts it off, and an edge where the log has no
margin. Nothing is extrapolated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import CampaignError, nearest
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import LegGap, SegmentRecord
from auvid.data_schemas.tables import column
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.resampling import hold, linear
from auvid.stages.base import Stage, param, port
from auvid.stages.columns import Rows, Span, leg_window, rows_between
from auvid.stages.resample.segments import (
    COVERING,
    Signal,
    common,
    common_spans,
    gap_list,
    in_body_axes,
    missing_stream,
    segment_ids,
    signal,
    split_at_jumps,
    too_short,
    trimmed,
)
from auvid.stages.resample.uniform import SAMPLES, ResampledSegment, Smoothing, resample_segment


@dataclass(frozen=True)
class Inputs:
    """One leg, its log, its streams, and the vehicle with the lags of its sensors."""

    leg: LegEntry = port("leg")
    log_info: LogInfo = port("log_info")
    vehicle: Vehicle = port("vehicle")
    imu: pa.Table | Rows | None = port("imu", optional=True, by_rows=True)
    attitude: pa.Table | Rows | None = port("attitude", optional=True, by_rows=True)
    depth: pa.Table | Rows | None = port("depth", optional=True, by_rows=True)
    velocity: pa.Table | Rows | None = port("velocity", optional=True, by_rows=True)
    actuators: pa.Table | Rows | None = port("actuators", optional=True, by_rows=True)
    battery: pa.Table | Rows | None = port("battery", optional=True, by_rows=True)
    water_velocity: pa.Table | Rows | None = port("water_velocity", optional=True, by_rows=True)


@dataclass(frozen=True)
class Params:
    """The uniform clock, the smoothing, and what counts as a gap."""

    rate_hz: float = param("Hz", 50.0, meaning="rate of the uniform clock", low=0.1, high=10_000.0)
    smoothing: str = param(
        "1",
        "gcv",
        meaning=(
            "how much splines smooth: by generalised cross-validation, at a given frequency, or not"
        ),
        allowed=("gcv", "cutoff", "none"),
    )
    cutoff_hz: float = param(
        "Hz", 3.0, meaning="half-amplitude frequency of smoothing: cutoff", low=0.001, high=5000.0
    )
    max_gap_s: float = param(
        "s", 1.0, meaning="a longer pause of any sensor splits the leg", low=0.001
    )
    min_segment_s: float = param("s", 5.0, meaning="shorter parts of a leg are left out", low=0.1)
    margin_s: float = param(
        "s",
        3.0,
        meaning="data of the log taken on either side of a leg, so that its ends need no edge",
        low=0.0,
        high=60.0,
    )
    actuator_interpolation: str = param(
        "1",
        "linear",
        meaning=(
            "between samples of the actuators; linear, because logs sample a command that changes"
            " faster than they do"
        ),
        allowed=("linear", "hold"),
    )
    lag_s: Mapping[str, float] = param(
        "s", {}, meaning="sensor -> how late it reports, in place of the vehicle file's lag"
    )


@dataclass(frozen=True)
class Outputs:
    """Per segment: uniform table, samples of each sensor at their times, method."""

    resampled: Mapping[str, pa.Table] = port("resampled", many=True)
    samples_attitude: Mapping[str, pa.Table] = port("samples_attitude", many=True)
    segment: Mapping[str, SegmentRecord] = port("segment", many=True)
    samples_imu: Mapping[str, pa.Table] | None = port("samples_imu", many=True, optional=True)
    samples_depth: Mapping[str, pa.Table] | None = port("samples_depth", many=True, optional=True)
    samples_velocity: Mapping[str, pa.Table] | None = port(
        "samples_velocity", many=True, optional=True
    )
    samples_water: Mapping[str, pa.Table] | None = port("samples_water", many=True, optional=True)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return the segments of one leg.

    Raises `DataError` for a leg outside its log, without attitude or depth, or with no
    part that all sensors cover long enough.
    """
    lags = sensor_lags(inputs.vehicle, params.lag_s)
    window = leg_window(inputs.leg, inputs.log_info.start_us, inputs.log_info.end_us)
    signals, notes = _signals(inputs, params, lags, window)
    covering = [item for stream, item in signals.items() if stream in COVERING]
    covered = [
        trimmed(span, signals.get("battery"), params.max_gap_s) for span in common_spans(covering)
    ]
    spans = {part: span for span in covered if (part := common(span, window)) is not None}
    long = [span for span in spans if span[1] - span[0] >= params.min_segment_s]
    if not long:
        raise too_short(
            inputs.leg,
            covering,
            min_segment_s=params.min_segment_s,
            max_gap_s=params.max_gap_s,
            log_end_s=(inputs.log_info.end_us - inputs.log_info.start_us) / 1e6,
        )
    if len(long) < len(spans):
        lost = sum(end - start for start, end in spans if end - start < params.min_segment_s)
        notes.append(
            f"{len(spans) - len(long)} parts shorter than {params.min_segment_s:g} s are left out"
            f" ({lost:.1f} s)"
        )
    interpolation = linear if params.actuator_interpolation == "linear" else hold
    segments = {
        name: resample_segment(
            {
                stream: item.within(spans[span]) if stream in COVERING else item
                for stream, item in signals.items()
            },
            span,
            covered=spans[span],
            rate_hz=params.rate_hz,
            smoothing=Smoothing(params.smoothing, params.cutoff_hz),
            between=partial(interpolation, max_gap_s=params.max_gap_s),
        )
        for name, span in zip(segment_ids(inputs.leg.id, long), long, strict=True)
    }
    leg_gaps = gap_list(covering, params.max_gap_s, window)
    samples = {
        table: {
            name: part.samples[table] for name, part in segments.items() if table in part.samples
        }
        for table in SAMPLES
    }
    return Outputs(
        resampled={name: part.table for name, part in segments.items()},
        segment={
            name: _record(
                name,
                inputs,
                part,
                rate_hz=params.rate_hz,
                lags=lags,
                leg_gaps=leg_gaps,
                notes=notes,
            )
            for name, part in segments.items()
        },
        **samples,
    )


def sensor_lags(vehicle: Vehicle, changed: Mapping[str, float]) -> dict[str, float]:
    """Return the lag [s] of each sensor: the parameter's, the vehicle's, else 0.

    Raises `CampaignError` for an unknown sensor.
    """
    lags = {**vehicle.sensor_lags_s, "actuators": 0.0, "battery": 0.0}
    for sensor in changed:
        if sensor not in lags:
            raise CampaignError(
                "unknown sensor",
                field=f"stages.resample.lag_s.{sensor}",
                allowed=lags,
                remedy=nearest(sensor, lags),
            )
    return lags | {sensor: float(lag_s) for sensor, lag_s in changed.items()}


def _signals(
    inputs: Inputs, params: Params, lags: Mapping[str, float], window: Span
) -> tuple[dict[str, Signal], list[str]]:
    """Return the streams of a leg and its margins in body axes, and notes on splits."""
    start_us, end_us = inputs.log_info.start_us, inputs.log_info.end_us
    rotations = {
        "imu": inputs.vehicle.imu.rotation,
        "velocity": inputs.vehicle.dvl.rotation,
        "water_velocity": inputs.vehicle.dvl.rotation,
    }
    signals: dict[str, Signal] = {}
    notes = []
    length = (end_us - start_us) / 1e6
    if window[1] > length + params.max_gap_s:
        notes.append(f"the leg asks for data up to {window[1]:g} s, the log ends at {length:.3f} s")
    for stream in (*COVERING, "battery", "water_velocity"):
        table = getattr(inputs, stream)
        item = None
        if table is not None:
            span = (max(0.0, window[0] - params.margin_s), window[1] + params.margin_s)
            at_us = [start_us + 1e6 * (second + lags[stream]) for second in span]
            item = signal(
                stream,
                rows_between(table, at_us[0] - 1.0, at_us[1] + 1.0),
                start_us=start_us,
                lag_s=lags[stream],
                window=span,
                max_gap_s=params.max_gap_s if stream in COVERING else np.inf,
            )
        if item is not None:
            rotation = rotations.get(stream)
            signals[stream] = item if rotation is None else in_body_axes(item, rotation)
        elif stream in ("attitude", "depth"):
            log = None if table is None else rows_between(table, -np.inf, np.inf)
            raise missing_stream(stream, inputs.leg, log, start_us=start_us)
        elif table is not None:
            notes.append(f"{stream} has fewer than five samples in the leg and is left out")
    if "imu" in signals:
        signals["attitude"], jumps = split_at_jumps(signals["attitude"], signals["imu"], window)
        notes += jumps
    return signals, notes


def _record(
    name: str,
    inputs: Inputs,
    part: ResampledSegment,
    *,
    rate_hz: float,
    lags: dict[str, float],
    leg_gaps: list[LegGap],
    notes: list[str],
) -> SegmentRecord:
    t_s = column(part.table, "t_s")
    inside = (t_s >= 0.0) & (t_s <= part.span[1] - part.span[0] + 1e-9)
    return SegmentRecord(
        id=name,
        leg=inputs.leg.id,
        log=inputs.leg.log,
        use=inputs.leg.use,
        start_us=inputs.log_info.start_us + round(part.span[0] * 1e6),
        leg_start_s=part.span[0],
        duration_s=float(t_s[inside][-1]),
        margins_s=[0.0 - float(t_s[0]), float(t_s[-1] - t_s[inside][-1])],
        samples=int(inside.sum()),
        rate_hz=rate_hz,
        lags_s=lags,
        smoothing=dict(part.smoothing),
        gaps=leg_gaps,
        notes=[*notes, *part.notes],
    )


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="resample",
    summary=(
        "Put the sensors of each leg on a uniform clock with spline derivatives; gaps split a leg"
    ),
    maps_over="leg",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
    yields="segment",
    no_views="fuse shows the resampled channels beside the state",
)
