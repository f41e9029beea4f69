"""What tells one log of a fleet from another: clock, vehicle, conditions, motion."""

from __future__ import annotations

import datetime

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.records.fleet import MotionTrace
from auvid.data_schemas.tables import column
from auvid.hydro.arrays import Array
from auvid.pipeline.commands.check.log_page import LogPage
from auvid.pipeline.commands.fleet.fleet_tables import UNNAMED

TRACE_STEP_S, MOST_STEPS = 0.5, 2000
FIRST_YEAR = 2000
"""A clock before this was never set."""
SERIAL = "BRD_SERIAL_NUM"
OFFSETS = (
    ("INS_ACCOFFS_X", "INS_ACCOFFS_Y", "INS_ACCOFFS_Z"),
    ("INS_ACC1OFFS_X", "INS_ACC1OFFS_Y", "INS_ACC1OFFS_Z"),
    ("CAL_ACC0_XOFF", "CAL_ACC0_YOFF", "CAL_ACC0_ZOFF"),
)
"""Of accelerometers, as ArduPilot and PX4 name them."""


def unnamed(firmware: object) -> str:
    """Return the name of a vehicle without one: by its autopilot, not its version."""
    return f"{UNNAMED} ({str(firmware).split()[0]})" if firmware else UNNAMED


def conditions(page: LogPage) -> dict[str, float | str]:
    """Return firmware, median battery voltage, mean depth, where the log has them."""
    result: dict[str, float | str] = {}
    if page.health is not None and page.health["vehicle"]:
        result["firmware"] = str(page.health["vehicle"])
    for name, stream, field, middle in (
        ("battery_v", "battery", "voltage_v", np.median),
        ("mean_depth_m", "depth", "depth_m", np.mean),
    ):
        values = column(page.streams[stream], field) if stream in page.streams else np.empty(0)
        values = values[np.isfinite(values)]
        if values.size:
            result[name] = round(float(middle(values)), 3)
    board = _board(page)
    if board:
        result["board"] = board
    return result


def _board(page: LogPage) -> str:
    """Return what tells one autopilot from another of its kind; empty for nothing.

    Its serial number, else the offsets of its accelerometer, which no two share.
    """
    outputs = page.outputs
    parameters = {} if outputs is None else outputs.log_info.parameters
    if serial := parameters.get(SERIAL):
        return f"serial number {serial:.0f}"
    for names in OFFSETS:
        offsets = [parameters.get(name) or 0.0 for name in names]
        if any(offsets):
            return "accelerometer offsets " + " ".join(f"{value:.4f}" for value in offsets)
    return ""


def start_utc(start_us: int, offset_us: int | None) -> str | None:
    """Return a start in UTC; None for a clock that is none, or was never set."""
    if offset_us is None:
        return None
    try:
        start = datetime.datetime.fromtimestamp((start_us + offset_us) // 1_000_000, datetime.UTC)
    except (OverflowError, ValueError, OSError):
        return None
    return start.strftime("%Y-%m-%dT%H:%M:%SZ") if start.year >= FIRST_YEAR else None


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
