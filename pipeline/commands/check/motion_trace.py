"""Depth and yaw rate of a log by its clock, and whether two logs are of one dive."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.fleet import MotionTrace
from auvid.data_schemas.tables import column
from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.clock_offset import clock_offset
from auvid.pipeline.commands.check.log_page import LogPage

TRACE_STEP_S, MOST_STEPS = 0.5, 2000
SAME_CORRELATION = 0.95
"""Two recorders of one dive agree at least so well in depth or in yaw rate."""
OVERLAP = 0.5
"""Share of the shorter log that both must have."""
LEAST_S = 20.0
MOST_STD_S = 1.0
LEAST_TURNING_RAD_S, LEAST_DEPTH_M = 0.02, 0.1
"""Standard deviation of the yaw rate over steps of half a second: less is a heading that is
held, and its noise; and of the depth.
"""


def motion_of(page: LogPage) -> MotionTrace | None:
    """Return depth and yaw rate of a log, each as means over the steps of one clock."""
    streams = page.streams
    series: dict[str, tuple[Array, Array]] = {}
    if "depth" in streams:
        series["depth"] = _clock_s(streams["depth"]), column(streams["depth"], "depth_m")
    if "attitude" in streams:
        angle = column(streams["attitude"], "psi_rad")
        at_s, finite = _clock_s(streams["attitude"]), np.isfinite(angle)
        series["yaw"] = at_s[finite], np.unwrap(angle[finite])
    series = {name: pair for name, pair in series.items() if pair[0].size > 1}
    if not series:
        return None
    first = min(float(times[0]) for times, _ in series.values())
    last = max(float(times[-1]) for times, _ in series.values())
    step_s = max(TRACE_STEP_S, (last - first) / MOST_STEPS)
    edges = np.arange(first, last + step_s, step_s)
    depth = _means(*series["depth"], edges) if "depth" in series else np.empty(0)
    yaw = _means(*series["yaw"], edges) if "yaw" in series else np.empty(0)
    return MotionTrace(
        step_s=step_s,
        start_s=first,
        depth_m=_rounded(depth),
        yaw_rate_rad_s=_rounded(np.diff(yaw) / step_s),
    )


def _clock_s(table: object) -> Array:
    times: Array = column(table, "time_us") / 1e6
    return times


def _means(at_s: Array, values: Array, edges: Array) -> Array:
    """Return the mean of the values between edges (n,), shape (n-1,); nan for none."""
    index = np.digitize(at_s, edges) - 1
    inside = (index >= 0) & (index < edges.size - 1) & np.isfinite(values)
    counts = np.bincount(index[inside], minlength=edges.size - 1)
    sums = np.bincount(index[inside], values[inside], minlength=edges.size - 1)
    means: Array = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    return means


def _rounded(values: npt.NDArray[np.float64]) -> list[float | None]:
    return [round(item, 4) if np.isfinite(item) else None for item in values.tolist()]


def turns(motion: MotionTrace) -> bool:
    """Return whether the yaw rate of a log is more than noise of its heading."""
    return _spread(motion.yaw_rate_rad_s) > LEAST_TURNING_RAD_S


def agreement(
    one: MotionTrace, two: MotionTrace, shorter_s: float, *, by_clock: bool
) -> str | None:
    """Return how two logs agree; '' where they do not, None where nothing tells.

    By the yaw rate, or by the depth where the yaw rate, if both turn, puts them at the same
    time: among half a million pairs of dives of a minute some depths look alike. Without
    turns and clock it takes the depth rate, since any two dives go down and come up.
    shorter_s: length of the shorter log; by_clock: both have the time of day.
    """
    depths = ("depth", one.depth_m, two.depth_m)
    if turns(one) and turns(two):
        series = [("yaw rate", one.yaw_rate_rad_s, two.yaw_rate_rad_s), depths]
    elif not by_clock:
        series = [("depth rate", _steps(one.depth_m), _steps(two.depth_m))]
    else:
        series = [depths]
    by_yaw: float | None = None
    compared = False
    for name, own, other in series:
        samples = _samples(one, own), _samples(two, other)
        try:
            offset = clock_offset(
                *samples[0], *samples[1], min_overlap_s=max(LEAST_S, OVERLAP * shorter_s)
            )
        except (DataError, IndexError):
            continue
        compared |= name == "yaw rate" or min(_spread(own), _spread(other)) > LEAST_DEPTH_M
        at_one_time = by_yaw is None or abs(offset.offset_s - by_yaw) <= MOST_STD_S
        by_yaw = offset.offset_s
        if offset.correlation >= SAME_CORRELATION and offset.std_s <= MOST_STD_S and at_one_time:
            clock = ", and by its clock" if by_clock else ""
            return f"{name} correlates by {offset.correlation:.2f}{clock}"
    return "" if compared else None


def _spread(values: Sequence[float | None]) -> float:
    """Return the standard deviation of numbers, 0 without any."""
    numbers = [item for item in values if item is not None]
    return float(np.std(numbers)) if numbers else 0.0


def _steps(values: Sequence[float | None]) -> list[float | None]:
    """Return the differences of neighbours; None where one has no number."""
    return [None if None in pair else pair[1] - pair[0] for pair in pairwise(values)]  # type: ignore[operator]


def _samples(motion: MotionTrace, values: Sequence[float | None]) -> tuple[Array, Array]:
    samples = np.array([np.nan if item is None else item for item in values], dtype=np.float64)
    times = np.asarray(motion.start_s + motion.step_s * np.arange(samples.size), np.float64)
    finite = np.isfinite(samples)
    return times[finite], samples[finite]
