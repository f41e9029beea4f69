"""Which parts of a leg every sensor covers: the segments, and the gaps between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.motion import LegGap
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import column, matrix, numbers
from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.attitude.rate_agreement import attitude_jumps
from auvid.hydro.identification.signals.resampling import gaps
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, GYRO, VELOCITY, Span

COVERING = ("attitude", "imu", "depth", "velocity", "actuators")
"""Streams whose gaps split a leg. The battery changes slowly and does not, it only
trims a segment's ends by a gap at most; nor does velocity through the water, which only
helps where it is.
"""
VECTORS = (GYRO, ACCELEROMETER, VELOCITY[:3])
"""Columns of the raw streams that are vectors in the axes of their sensor."""
NAMED_JUMPS = 5
MIN_SAMPLES = 5  # a spline needs as many


@dataclass(frozen=True)
class Signal:
    """The samples of one stream in the leg: times (n,), the stream's columns (n, k).

    Times in s from the start of the log, lag taken off; `spans` are free of gaps.
    """

    stream: str
    t_s: Array
    names: tuple[str, ...]
    values: Array
    spans: tuple[Span, ...]

    @property
    def step_s(self) -> float:
        """Mean time between samples."""
        return float(self.t_s[-1] - self.t_s[0]) / (self.t_s.size - 1)

    def within(self, span: Span) -> Signal:
        """Return the samples of the gap-free part that covers a span."""
        run = next(item for item in self.spans if item[0] <= span[0] and item[1] >= span[1])
        return self.cut(run)

    def cut(self, span: Span) -> Signal:
        """Return the samples at or between two times."""
        rows = (self.t_s >= span[0]) & (self.t_s <= span[1])
        return Signal(self.stream, self.t_s[rows], self.names, self.values[rows], (span,))

    def columns(self, *names: str) -> Array:
        """Return the columns of these names (n, k)."""
        return self.values[:, [self.names.index(name) for name in names]]


def signal(
    stream: str, table: pa.Table, *, start_us: int, lag_s: float, window: Span, max_gap_s: float
) -> Signal | None:
    """Return the samples of a stream in the window, None for fewer than five."""
    t = (numbers(table["time_us"]) - start_us) / 1e6 - lag_s
    rows = np.flatnonzero((t >= window[0]) & (t <= window[1]))
    if rows.size < MIN_SAMPLES:
        return None
    names = tuple(name for name in table.column_names if name != "time_us")
    first, last = int(rows[0]), int(rows[-1])
    t, values = t[rows], matrix(table.slice(first, last + 1 - first), names)[rows - first]
    spans = tuple(
        (float(t[first]), float(t[last - 1]))
        for first, last in gaps(t, max_gap_s)
        if last - first >= MIN_SAMPLES
    )
    return Signal(stream, t, names, values, spans)


def in_body_axes(item: Signal, rotation: Array) -> Signal:
    """Return the signal with its vectors turned to body axes, x_body = R x_sensor.

    rotation: R (3, 3), sensor axes to body axes, from the vehicle's mounting.
    """
    values = item.values.copy()
    for names in VECTORS:
        if set(names) <= set(item.names):
            columns = [item.names.index(name) for name in names]
            values[:, columns] = values[:, columns] @ rotation.T
    return replace(item, values=values)


def split_at_jumps(item: Signal, imu: Signal, window: Span) -> tuple[Signal, list[str]]:
    """Return the attitude cut where it jumps without the gyro, and a note per jump.

    A spline through a jump would turn the vehicle in a motion that never was. Jumps
    outside the window of the leg are not noted.
    """
    sizes = attitude_jumps(item.t_s, item.columns(*ATTITUDE), imu.t_s, imu.columns(*GYRO))
    jumps = list(zip(*(array.tolist() for array in sizes), strict=True))
    spans = list(item.spans)
    for start, end, _ in jumps:
        spans = [
            part
            for first, last in spans
            for part in ((first, min(last, start)), (max(first, end), last))
            if part[0] < part[1]
        ]
    kept = tuple(
        span
        for span in spans
        if np.count_nonzero((item.t_s >= span[0]) & (item.t_s <= span[1])) >= MIN_SAMPLES
    )
    noted = [jump for jump in jumps if jump[1] >= window[0] and jump[0] <= window[1]]
    notes = [
        f"the attitude jumps by {math.degrees(size):.0f} degrees at {start:.2f} s without the gyro;"
        " the leg is split there"
        for start, _, size in noted[:NAMED_JUMPS]
    ]
    if len(noted) > NAMED_JUMPS:
        notes.append(
            f"the attitude jumps {len(noted) - NAMED_JUMPS} times more, each splits the leg"
        )
    return (replace(item, spans=kept) if jumps else item), notes


def common_spans(signals: Sequence[Signal]) -> list[Span]:
    """Return the spans that all signals cover without a gap."""
    spans: list[Span] = [(-np.inf, np.inf)]
    for item in signals:
        both = [common(one, other) for one in spans for other in item.spans]
        spans = [span for span in both if span is not None]
    return spans


def common(one: Span, other: Span) -> Span | None:
    """Return what two spans share; None where that is nothing."""
    start, end = max(one[0], other[0]), min(one[1], other[1])
    return (start, end) if start < end else None


def trimmed(span: Span, item: Signal | None, longest_s: float) -> Span:
    """Return the span without ends, up to `longest_s`, that a slow signal lacks."""
    if item is None:
        return span
    first, last = float(item.t_s[0]), float(item.t_s[-1])
    start = first if span[0] < first <= span[0] + longest_s else span[0]
    end = last if span[1] - longest_s <= last < span[1] else span[1]
    return (start, end) if start < end else span


def segment_ids(leg: str, spans: Sequence[Span]) -> list[str]:
    """Return the leg's own id for a single segment, else `<leg>.1`, `<leg>.2` ..."""
    return [leg] if len(spans) == 1 else [f"{leg}.{number}" for number in range(1, len(spans) + 1)]


def gap_list(signals: Sequence[Signal], max_gap_s: float, window: Span) -> list[LegGap]:
    """Return the pauses of a leg longer than allowed, in s from the log's start."""
    pauses: list[LegGap] = []
    for item in signals:
        for index in np.flatnonzero(np.diff(item.t_s) > max_gap_s):
            start, end = float(item.t_s[index]), float(item.t_s[index + 1])
            if common((start, end), window) is None:
                continue
            pauses.append(
                LegGap(stream=item.stream, start_s=start, end_s=end, duration_s=end - start)
            )
    return sorted(pauses, key=lambda gap: (gap.start_s, gap.stream))


def missing_stream(
    stream: str, leg: LegEntry, table: pa.Table | None, *, start_us: int
) -> DataError:
    """Return the error for a stream that the chain cannot do without.

    table: what the log has of it outside the leg, with the times from start_us on.
    """
    words, supply = f"leg '{leg.id}' needs stream '{stream}', and log '{leg.log}'", ""
    if table is None or not table.num_rows:
        supply = f"What could supply it: {supply_text(stream)}."
        return DataError(f"{words} has none", field=stream, remedy=supply)
    t_s = (column(table, "time_us") - start_us) / 1e6
    first, last = float(t_s.min()), float(t_s.max())
    return DataError(
        f"{words} has fewer than five samples of it in the leg",
        field=stream,
        value=f"{stream} begins at {first:.1f} s of the log and ends at {last:.1f} s",
        allowed="a leg in which all sensors run",
        remedy=(
            f"Choose start_s and end_s of the leg between {first:.1f} and {last:.1f} s, or another"
            f" source: {supply_text(stream)}."
        ),
    )


def too_short(
    leg: LegEntry,
    signals: Sequence[Signal],
    *,
    min_segment_s: float,
    max_gap_s: float,
    log_end_s: float,
) -> DataError:
    """Return the error for a leg of which no part is covered for long enough."""
    start_s, end_s = leg.start_s or 0.0, leg.end_s
    if end_s is not None and log_end_s < min(end_s, start_s + min_segment_s):
        return DataError(
            f"the log of leg '{leg.id}' ends too early",
            value=f"after {log_end_s:.1f} s; the leg is {start_s:g} to {end_s:g} s of it",
            allowed=f"{min_segment_s:g} s and more of the leg",
            remedy="Was the log cut off? Take a leg that lies within it, or another log.",
        )
    if end_s is not None and end_s - start_s < min_segment_s:
        return DataError(
            f"leg '{leg.id}' is too short",
            value=f"{start_s:g} to {end_s:g} s",
            allowed=f"{min_segment_s:g} s and more",
            remedy="Move start_s or end_s of the leg, or lower stages.resample.min_segment_s.",
        )
    cover = "; ".join(f"{item.stream} {_spans_text(item)}" for item in signals)
    shared = max(common_spans(signals), key=lambda span: span[1] - span[0], default=None)
    together = (
        "they never run together"
        if shared is None
        else f"all run together from {shared[0]:.1f} to {shared[1]:.1f} s at most"
    )
    return DataError(
        f"no part of leg '{leg.id}' is covered by all sensors for {min_segment_s:g} s",
        value=f"{cover}; {together}",
        allowed=f"pauses up to {max_gap_s:g} s",
        remedy=(
            "Raise stages.resample.max_gap_s, lower stages.resample.min_segment_s, choose another"
            " source, or leave the stream out (sources: {STREAM: none} in the manifest)."
        ),
    )


def _spans_text(item: Signal) -> str:
    if not item.spans:
        return f"pauses between all of its {item.t_s.size} samples"
    words = ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in item.spans[:3])
    return words if len(item.spans) <= 3 else f"{words} and {len(item.spans) - 3} more"
