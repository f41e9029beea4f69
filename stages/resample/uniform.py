"""One segment on a uniform clock, from smoothing splines through its samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.motion import ChannelSmoothing
from auvid.data_schemas.tables import make_table
from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import NO_PULSE_US
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix
from auvid.hydro.identification.signals.resampling import (
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
from auvid.hydro.long_series.threads import at_once
from auvid.stages.columns import (
    ACCELERATION,
    ACCELEROMETER,
    ATTITUDE,
    GYRO,
    POSE_RATE,
    VELOCITY,
    Span,
    named,
)
from auvid.stages.resample.segments import Signal

LONG, BLOCK, BLOCKS = 100_000, 10_000, 7
"""Samples beyond which blocks choose the smoothing; samples of a block; blocks."""
SAMPLES: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "samples_attitude": ("attitude", {name: name for name in ATTITUDE}),
    "samples_imu": ("imu", {name: name for name in (*GYRO, *ACCELEROMETER)}),
    "samples_depth": ("depth", {"z_m": "depth_m"}),
    "samples_velocity": ("velocity", {name: name for name in VELOCITY[:3]}),
    "samples_water": ("water_velocity", {name: name for name in VELOCITY[:3]}),
}
"""Table of samples -> its stream, and the stream's field of each column."""
Channel = tuple[str, str, str | None]
"""Field of a stream, column of the value, column of the rate."""


@dataclass(frozen=True)
class Smoothing:
    """How much splines smooth: `gcv`, `cutoff` (half amplitude there), `none`."""

    method: str
    cutoff_hz: float

    def parameter(self, item: Signal, values: Array) -> float | None:
        """Return lambda; None leaves it to cross-validation on all samples.

        That takes 2 s for a million samples, so beyond `LONG` it is the median (of the
        logarithm) over blocks, which cost a tenth of that.
        """
        if self.method == "none":
            return 0.0
        if self.method == "cutoff":
            return lambda_from_cutoff(self.cutoff_hz, item.step_s)
        if item.t_s.size <= LONG:
            return None
        starts = np.linspace(0, item.t_s.size - BLOCK, BLOCKS).astype(int)

        def log_lambda(at: int) -> float:
            block = slice(at, at + BLOCK)
            fit = smoothing_spline(item.t_s[block], values[block], shared=True)
            return float(np.log(np.min(fit.lambda_)))

        return float(np.exp(np.median(at_once(log_lambda, starts.tolist()))))

    def record(self, item: Signal, lam: float, sigma: float) -> ChannelSmoothing:
        """Return the entry of a channel in the segment's document."""
        return ChannelSmoothing(
            method=self.method,
            lam=lam,
            cutoff_hz=cutoff_from_lambda(lam, item.step_s) if lam > 0.0 else None,
            noise_sd=sigma if lam > 0.0 else None,
            sample_hz=1.0 / item.step_s,
        )


@dataclass(frozen=True)
class ResampledSegment:
    """A segment: uniform table, samples by schema, smoothing, notes."""

    span: Span
    table: pa.Table
    samples: Mapping[str, pa.Table]
    smoothing: Mapping[str, ChannelSmoothing]
    notes: tuple[str, ...]


def resample_segment(
    signals: Mapping[str, Signal],
    span: Span,
    *,
    covered: Span,
    rate_hz: float,
    smoothing: Smoothing,
    between: Callable[[Array, Array, Array], Array],
) -> ResampledSegment:
    """Return one segment on its uniform clock, 0 at its start.

    span: [s] from the start of the log; covered: the same with margins, covered by
    every signal but the battery. between: values of the actuators (n, k) at other
    times, from theirs.
    """
    before = np.floor((span[0] - covered[0]) * rate_hz + 1e-3) / rate_hz
    t_s = uniform_clock(-before, covered[1] - span[0], rate_hz)
    columns: dict[str, Array] = {"t_s": t_s}
    records: dict[str, Any] = {}
    notes = []

    def inside(item: Signal) -> Array:
        # The uniform clock may stand a rounding error beyond the last sample.
        return np.clip(t_s + span[0], item.t_s[0], item.t_s[-1])

    def smooth(stream: str, channels: Sequence[Channel]) -> None:
        item = signals[stream]
        at = inside(item)

        def smoothed(channel: Channel) -> tuple[Array, Array | None, ChannelSmoothing]:
            field, _, rate = channel
            values = item.columns(field)[:, 0]
            spline = smoothing_spline(item.t_s, values, lam=smoothing.parameter(item, values))
            record = smoothing.record(item, float(spline.lambda_), float(spline.sigma))
            return spline.evaluate(at), spline.evaluate(at, 1) if rate else None, record

        results = at_once(smoothed, channels, long=item.t_s.size > LONG)
        for (_, name, rate), (values, rates, record) in zip(channels, results, strict=True):
            columns[name], records[name] = values, record
            if rate is not None and rates is not None:
                columns[rate] = rates

    smooth("depth", [("depth_m", "z_m", "z_dot_m_s")])
    item = signals["attitude"]
    euler = unwrap_angles(item.columns(*ATTITUDE))
    attitude = smooth_attitude(item.t_s, euler, inside(item), lam=smoothing.parameter(item, euler))
    columns |= named(ATTITUDE, attitude.euler)
    columns |= named(
        POSE_RATE[3:], np.einsum("nij,nj->ni", euler_rate_matrix(attitude.euler), attitude.omega)
    )
    records["attitude"] = smoothing.record(item, attitude.lambda_, attitude.sigma_rad)
    if "imu" in signals:
        smooth("imu", list(zip(GYRO, VELOCITY[3:], ACCELERATION[3:], strict=True)))
        if bool(np.isfinite(signals["imu"].values).all()):
            smooth("imu", [(name, name, None) for name in ACCELEROMETER])
    else:
        columns |= named(VELOCITY[3:], attitude.omega)
        columns |= named(ACCELERATION[3:], attitude.omega_dot)
        notes.append("angular rates come from the attitude: the log has no gyro in this leg")
    if "velocity" in signals:
        smooth("velocity", list(zip(VELOCITY[:3], VELOCITY[:3], ACCELERATION[:3], strict=True)))
    if "actuators" in signals:
        item = signals["actuators"]
        pulses = np.array([name.startswith("pwm_") for name in item.names])
        # Between no pulse (0) and a neutral one there is no pulse of full reverse.
        values = np.where(pulses & (item.values < NO_PULSE_US), NEUTRAL_US, item.values)
        columns |= named(item.names, between(item.t_s, values, inside(item)))
    if "battery" in signals:
        item = signals["battery"]
        voltage = linear(item.t_s, item.columns("voltage_v")[:, 0], t_s + span[0])
        columns["voltage_v"] = voltage
        bare = float(np.mean(np.isnan(voltage)))
        if bare > 0.0:
            notes.append(f"the battery was not measured in {100.0 * bare:.1f} % of the segment")
    return ResampledSegment(
        span,
        make_table("resampled", columns),
        _samples(signals, span, covered),
        records,
        tuple(notes),
    )


def _samples(signals: Mapping[str, Signal], span: Span, covered: Span) -> dict[str, pa.Table]:
    tables = {}
    for name, (stream, fields) in SAMPLES.items():
        if stream in signals:
            item = signals[stream].cut(covered)
            values = item.columns(*fields.values())
            if stream == "attitude":
                values = unwrap_angles(values)
            tables[name] = make_table(
                name, {"t_s": item.t_s - span[0], **named(tuple(fields), values)}
            )
    return tables
