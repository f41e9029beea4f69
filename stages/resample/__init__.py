"""Put the sensors of one leg on a uniform clock, with spline derivatives; gaps, and
jumps of the attitude, split the leg into segments.

A smoothing spline stands for each channel; attitude is smoothed as a rotation. One
smoothing parameter holds for a whole segment, so a signal whose character changes
within it is smoothed for the mixture. Splines bend at the ends of a segment over about
half a period of their cut-off; `fuse` cuts that off (`edge_s`). Nothing is
extrapolated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix
from auvid.hydro.dynamics.vehicle.vehicle import vehicle_from_document
from auvid.hydro.identification.signals.resampling import (
    hold,
    linear,
    smooth_attitude,
    uniform_clock,
    unwrap_angles,
)
from auvid.hydro.identification.signals.splines import (
    cutoff_from_lambda,
    lambda_from_cutoff,
    smoothing_spline,
)
from auvid.stages.base import Document, Stage, param, port
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, Array, Span, leg_window, named
from auvid.stages.resample.segments import (
    GYRO,
    Signal,
    common_spans,
    gap_list,
    missing_stream,
    segment_ids,
    signal,
    split_at_jumps,
    too_short,
    trimmed,
)

RATE = ("p_rad_s", "q_rad_s", "r_rad_s")
RATE_DOT = ("p_dot_rad_s2", "q_dot_rad_s2", "r_dot_rad_s2")
LINEAR = ("u_m_s", "v_m_s", "w_m_s")
LINEAR_DOT = ("u_dot_m_s2", "v_dot_m_s2", "w_dot_m_s2")
ATTITUDE_RATE = ("phi_dot_rad_s", "theta_dot_rad_s", "psi_dot_rad_s")
COVERING = ("attitude", "imu", "depth", "velocity", "actuators")
"""Streams whose gaps split a leg. The battery changes slowly and does not, it only
trims a segment's ends by a gap at most; nor does velocity through the water, which only
helps where it is.
"""
LONG, BLOCK, BLOCKS = 100_000, 10_000, 7


@dataclass(frozen=True)
class Inputs:
    """One leg, its log, the vehicle with the lags of its sensors, and the streams of
    the log.
    """

    leg: Document = port("leg")
    log_info: Document = port("log_info")
    vehicle: Document = port("vehicle")
    imu: pa.Table | None = port("imu", optional=True)
    attitude: pa.Table | None = port("attitude", optional=True)
    depth: pa.Table | None = port("depth", optional=True)
    velocity: pa.Table | None = port("velocity", optional=True)
    actuators: pa.Table | None = port("actuators", optional=True)
    battery: pa.Table | None = port("battery", optional=True)
    water_velocity: pa.Table | None = port("water_velocity", optional=True)


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
    """Per segment: the uniform table, the samples of each sensor at their own times,
    and how it was done.
    """

    resampled: Mapping[str, pa.Table] = port("resampled", many=True)
    samples_attitude: Mapping[str, pa.Table] = port("samples_attitude", many=True)
    segment: Mapping[str, dict[str, Any]] = port("segment", many=True)
    samples_imu: Mapping[str, pa.Table] | None = port("samples_imu", many=True, optional=True)
    samples_depth: Mapping[str, pa.Table] | None = port("samples_depth", many=True, optional=True)
    samples_velocity: Mapping[str, pa.Table] | None = port(
        "samples_velocity", many=True, optional=True
    )
    samples_water: Mapping[str, pa.Table] | None = port("samples_water", many=True, optional=True)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Segments of one leg.

    Raises `DataError` for a leg outside its log, without attitude or depth, or with no
    part that all sensors cover long enough.
    """
    leg, start_us = inputs.leg, int(inputs.log_info["start_us"])
    window = leg_window(leg, start_us, int(inputs.log_info["end_us"]))
    lags = sensor_lags(inputs.vehicle, params.lag_s)
    signals: dict[str, Signal] = {}
    notes = []
    length = (int(inputs.log_info["end_us"]) - start_us) / 1e6
    if window[1] > length + params.max_gap_s:
        notes.append(f"the leg asks for data up to {window[1]:g} s, the log ends at {length:.3f} s")
    for stream in (*COVERING, "battery", "water_velocity"):
        table = getattr(inputs, stream)
        found = None
        if table is not None:
            max_gap_s = params.max_gap_s if stream in COVERING else np.inf
            found = signal(
                stream,
                table,
                start_us=start_us,
                lag_s=lags[stream],
                window=window,
                max_gap_s=max_gap_s,
            )
        if found is not None:
            signals[stream] = found
        elif stream in ("attitude", "depth"):
            raise missing_stream(stream, leg, logged=table is not None)
        elif table is not None:
            notes.append(f"{stream} has fewer than five samples in the leg and is left out")
    if "imu" in signals:
        signals["attitude"], jumps = split_at_jumps(signals["attitude"], signals["imu"])
        notes += jumps
    covering = [item for name, item in signals.items() if name in COVERING]
    all_spans = [
        trimmed(span, signals.get("battery"), params.max_gap_s) for span in common_spans(covering)
    ]
    spans = [span for span in all_spans if span[1] - span[0] >= params.min_segment_s]
    if not spans:
        raise too_short(
            leg, covering, min_segment_s=params.min_segment_s, max_gap_s=params.max_gap_s
        )
    if len(spans) < len(all_spans):
        lost = sum(end - start for start, end in all_spans) - sum(
            end - start for start, end in spans
        )
        notes.append(
            f"{len(all_spans) - len(spans)} parts shorter than {params.min_segment_s:g} s are left"
            f" out ({lost:.1f} s)"
        )
    done = {}
    for name, span in zip(segment_ids(str(leg["id"]), spans), spans, strict=True):
        done[name] = resample_segment(
            {key: _covering_run(item, span) for key, item in signals.items()}, span, params
        )
    gaps = gap_list(covering, params.max_gap_s)
    documents = {}
    for (name, smooth), span in zip(done.items(), spans, strict=True):
        documents[name] = _document(name, inputs, params, lags, span, smooth, gaps, notes)
    tables = {
        name: {key: item.samples[name] for key, item in done.items() if name in item.samples}
        for name in SAMPLES
    }
    return Outputs(
        resampled={name: item.table for name, item in done.items()}, segment=documents, **tables
    )


@dataclass(frozen=True)
class Resampled:
    """One segment: its uniform table, tables of samples by schema name, the smoothing
    per channel, and notes.
    """

    table: pa.Table
    samples: Mapping[str, pa.Table]
    smoothing: Mapping[str, Any]
    notes: tuple[str, ...]


SAMPLES: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "samples_attitude": ("attitude", {name: name for name in ATTITUDE}),
    "samples_imu": ("imu", {name: name for name in (*GYRO, *ACCELEROMETER)}),
    "samples_depth": ("depth", {"z_m": "depth_m"}),
    "samples_velocity": ("velocity", {name: name for name in LINEAR}),
    "samples_water": ("water_velocity", {name: name for name in LINEAR}),
}


def sensor_lags(vehicle: Document, given: Mapping[str, float]) -> dict[str, float]:
    """Lag of each sensor in s: the parameter's, else the vehicle file's, else 0. Raises
    `CampaignError` for an unknown sensor.
    """
    known = vehicle_from_document(vehicle)
    lags = {
        "imu": known.imu.lag_s,
        "attitude": known.imu.lag_s,
        "depth": known.depth_sensor.lag_s,
        "velocity": known.dvl.lag_s,
    }
    lags |= {"actuators": 0.0, "battery": 0.0, "water_velocity": known.dvl.lag_s}
    for key, value in given.items():
        if key not in lags:
            raise CampaignError(
                "unknown sensor",
                field=f"stages.resample.lag_s.{key}",
                allowed=lags,
                remedy=nearest(key, lags),
            )
        lags[key] = float(value)
    return lags


def resample_segment(signals: Mapping[str, Signal], span: Span, params: Params) -> Resampled:
    """One segment on its uniform clock; `span` in s from the start of the log, covered
    by every signal but the battery.
    """
    start = span[0]
    t_s = uniform_clock(0.0, span[1] - start, params.rate_hz)
    columns: dict[str, Array] = {"t_s": t_s}
    smoothing: dict[str, Any] = {}
    notes = []

    def smooth(
        stream: str, fields: tuple[str, ...], names: tuple[str, ...], rates: tuple[str, ...] = ()
    ) -> None:
        item = signals[stream]
        at = _inside(t_s + start, item)
        for field, name, rate in zip(fields, names, rates or (None,) * len(names), strict=True):
            values = item.column(field)
            spline = smoothing_spline(item.t_s, values, lam=_lambda(item, values, params))
            columns[name] = spline.evaluate(at)
            if rate is not None:
                columns[rate] = spline.evaluate(at, 1)
            smoothing[name] = _smoothing(
                params, float(spline.lambda_), _step(item), float(spline.sigma)
            )

    smooth("depth", ("depth_m",), ("z_m",), ("z_dot_m_s",))
    angles = signals["attitude"]
    euler = unwrap_angles(_euler(angles))
    attitude = smooth_attitude(
        angles.t_s, euler, _inside(t_s + start, angles), lam=_lambda(angles, euler, params)
    )
    columns |= named(ATTITUDE, attitude.euler)
    columns |= named(
        ATTITUDE_RATE, np.einsum("nij,nj->ni", euler_rate_matrix(attitude.euler), attitude.omega)
    )
    smoothing["attitude"] = _smoothing(params, attitude.lambda_, _step(angles), attitude.sigma_rad)
    if "imu" in signals:
        smooth("imu", GYRO, RATE, RATE_DOT)
        if bool(np.isfinite(signals["imu"].values).all()):
            smooth("imu", ACCELEROMETER, ACCELEROMETER)
    else:
        columns |= named(RATE, attitude.omega) | named(RATE_DOT, attitude.omega_dot)
        notes.append("angular rates come from the attitude: the log has no gyro in this leg")
    if "velocity" in signals:
        smooth("velocity", LINEAR, LINEAR, LINEAR_DOT)
    between = linear if params.actuator_interpolation == "linear" else hold
    if "actuators" in signals:
        item = signals["actuators"]
        columns |= named(
            item.names,
            between(item.t_s, item.values, _inside(t_s + start, item), max_gap_s=params.max_gap_s),
        )
    if "battery" in signals:
        item = signals["battery"]
        columns["voltage_v"] = linear(item.t_s, item.column("voltage_v"), t_s + start)
        bare = float(np.mean(np.isnan(columns["voltage_v"])))
        if bare > 0.0:
            notes.append(f"the battery was not measured in {100.0 * bare:.1f} % of the segment")
    return Resampled(
        make_table("resampled", columns), _samples(signals, span), smoothing, tuple(notes)
    )


def _covering_run(item: Signal, span: Span) -> Signal:
    return item if item.stream not in COVERING else item.within(span)


def _inside(t_s: Array, item: Signal) -> Array:
    """The uniform clock may stand a rounding error beyond the last sample."""
    return np.clip(t_s, item.t_s[0], item.t_s[-1])


def _euler(item: Signal) -> Array:
    return np.column_stack([item.column(name) for name in ATTITUDE])


def _step(item: Signal) -> float:
    return float(item.t_s[-1] - item.t_s[0]) / (item.t_s.size - 1)


def _lambda(item: Signal, values: Array, params: Params) -> float | None:
    """The smoothing parameter; None leaves it to cross-validation on all samples, which
    takes 2 s for a million of them.

    Beyond `LONG` samples it is the median (of the logarithm) over blocks, which cost a
    tenth of that.
    """
    if params.smoothing == "gcv":
        if item.t_s.size <= LONG:
            return None
        starts = np.linspace(0, item.t_s.size - BLOCK, BLOCKS).astype(int)
        fits = [
            smoothing_spline(item.t_s[at : at + BLOCK], values[at : at + BLOCK], shared=True)
            for at in starts
        ]
        return float(np.exp(np.median([np.log(np.min(fit.lambda_)) for fit in fits])))
    return 0.0 if params.smoothing == "none" else lambda_from_cutoff(params.cutoff_hz, _step(item))


def _smoothing(params: Params, lam: float, step_s: float, sigma: float) -> dict[str, Any]:
    known = (
        {"cutoff_hz": cutoff_from_lambda(lam, step_s), "noise_sd": sigma}
        if lam > 0.0
        else {"cutoff_hz": None, "noise_sd": None}
    )
    return {"method": params.smoothing, "lambda": lam, **known, "sample_hz": 1.0 / step_s}


def _samples(signals: Mapping[str, Signal], span: Span) -> dict[str, pa.Table]:
    tables = {}
    for name, (stream, fields) in SAMPLES.items():
        if stream in signals:
            item = signals[stream].cut(span)
            columns = {column: item.column(field) for column, field in fields.items()}
            if stream == "attitude":
                columns = named(ATTITUDE, unwrap_angles(_euler(item)))
            tables[name] = make_table(name, {"t_s": item.t_s - span[0], **columns})
    return tables


def _document(
    name: str,
    inputs: Inputs,
    params: Params,
    lags: Mapping[str, float],
    span: Span,
    smooth: Resampled,
    gaps: list[dict[str, object]],
    notes: list[str],
) -> dict[str, Any]:
    t_s = smooth.table["t_s"].to_numpy()
    return {
        "id": name,
        "leg": inputs.leg["id"],
        "log": inputs.leg["log"],
        "use": inputs.leg.get("use", "training"),
        "start_us": int(inputs.log_info["start_us"]) + round(span[0] * 1e6),
        "leg_start_s": span[0],
        "duration_s": float(t_s[-1]),
        "samples": int(t_s.size),
        "rate_hz": params.rate_hz,
        "lags_s": dict(lags),
        "smoothing": dict(smooth.smoothing),
        "gaps": gaps,
        "notes": [*notes, *smooth.notes],
    }


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
