"""What tells one log of a fleet from another: clock, vehicle, conditions, motion."""

from __future__ import annotations

import datetime

import numpy as np

from auvid.data_schemas.tables import column
from auvid.pipeline.commands.check.log_page import LogPage
from auvid.pipeline.commands.fleet.fleet_tables import UNNAMED

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
