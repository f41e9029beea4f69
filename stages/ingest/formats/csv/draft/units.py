"""Units of drafted columns by the size of their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from auvid.hydro.arrays import Array
from auvid.stages.ingest.formats.csv.column_names import (
    NamedColumn,
)
from auvid.stages.ingest.formats.csv.draft.column_draft import DraftColumn
from auvid.stages.ingest.formats.csv.draft.pose_draft import (
    pose_unit,
)

FULL_TURN = 6.4
"""An angle beyond it [rad] is in degrees."""
NEAR_ONE, NEAR_GRAVITY = (0.8, 1.2), (8.5, 11.0)
"""Median length of an accelerometer at rest in g and in m/s^2."""
FASTEST_M_S, FASTEST_CM_S = 15.0, 300.0
"""Larger velocities (99th percentile) are in cm/s, and beyond that in mm/s."""
LARGEST_COMMAND = 1.5
"""Commands of -1 to 1 stay below it (99th percentile)."""
LEAST_PERCENT = 5.0
"""Commands of -100 to 100 reach beyond it."""
FURTHEST_FIN_RAD = 1.6
"""No fin is turned further [rad]; larger deflections are in degrees."""
FASTEST_RAD_S = 8.0
"""Larger rates (99th percentile) are in deg/s."""
HELD_SHARE = 0.5
UNITS_APART = 200.0
"""Ratio of noises from which on two signals of one kind are in units of their own."""
PRESSURES = ("mbar", "dbar", "bar", "kPa", "Pa", "psi")
PULSES = (800.0, 2200.0)
GLIDER_UNITS = {
    "pressure_pa": ("dbar", "Pa", 12e3),
    "pitch_rad": ("rad", "deg", 1.6),
    "buoyancy_drive_m3": ("m^3", "cm^3", 0.02),
    "density_kg_m3": ("g/cm^3", "kg/m^3", 2.0),
    "temperature_K": ("degC", "K", 200.0),
    "speed_m_s": ("m/s", "cm/s", 5.0),
}
"""Field of a glider -> unit, and the one of values beyond a limit."""


def unit_of(stream: str, name: str, item: NamedColumn, group: Sequence[Array]) -> tuple[str, str]:
    """Return the unit of a column, and in words what was assumed of it."""
    if name.startswith("command_"):
        return _command_unit(item, group)
    if name.startswith("pwm_"):
        return item.unit, "" if item.unit == "us" else "full command taken for 1100 or 1900 us"
    depth = "" if stream != "depth" or "depth" in item.words else f"depth from {item.name}"
    if depth and item.unit in PRESSURES:
        depth = "pressure as depth of sea water; its zero may not be the surface"
    if name.startswith("gyro") and item.unit in ("rad", "deg"):
        return f"{item.unit}/s", f"a rate, though the name says {item.unit}"
    if item.unit:
        return item.unit, depth
    size = percentile(group)
    if stream == "glider":
        return _glider_unit(name, size)
    if stream == "pose":
        return pose_unit(name, size)
    if stream == "fixes" and name.endswith("_rad"):
        return "deg", "assumed"
    if stream == "attitude":
        return ("deg", "") if size > FULL_TURN else ("rad", "no value is beyond a turn in rad")
    if name.startswith("gyro"):
        return ("deg/s", "by its size") if size > FASTEST_RAD_S else ("rad/s", "by its size")
    if name.startswith("accel"):
        return ("g0", "by its size") if size < 4.0 else ("m/s^2", "by its size")
    if name.startswith("fin_"):
        return ("deg", "by its size") if size > FURTHEST_FIN_RAD else ("rad", "by its size")
    if stream in ("velocity", "water_velocity") or name == "tow_speed_m_s":
        unit = "m/s" if size < FASTEST_M_S else "cm/s" if size < FASTEST_CM_S else "mm/s"
        return unit, "by its size"
    if stream == "battery":
        return ("mV", "by its size") if size > 1000.0 else ("V", "by its size")
    assumed = {"propeller_rev_s": "rpm", "interval_s": "s", "quality": "1", "tow_force_n": "N"}
    return assumed.get(name, "m"), depth or "assumed"


def _command_unit(item: NamedColumn, group: Sequence[Array]) -> tuple[str, str]:
    """Return the unit of a command, and what was assumed of it.

    group: the column, then all commands of the file.
    """
    if item.unit:
        return item.unit, ""
    if are_pulses(group[0]):
        return "us", "full command taken for 1100 or 1900 us"
    if in_percent(group[1:]) and percentile(group[:1]) <= 100.0:
        return "percent", "by the size of all commands"
    largest = percentile(group[:1])
    if largest <= LARGEST_COMMAND:
        return "1", ""
    divide = "; of -1000 to 1000 divide the column by 1000" if largest > 100.0 else ""
    return "1", f"beyond 1: another unit, or a set point{divide}"


def in_percent(commands: Sequence[Array]) -> bool:
    """Return whether commands of a file reach from 5 to 100, most of those that move.

    >>> in_percent([np.array([-40.0, 60.0]), np.array([0.0, 3.0]), np.array([0.0, 50.0])])
    True
    """
    sizes = [size for item in commands if (size := percentile([item])) > 0.0]
    return bool(sizes) and LEAST_PERCENT < float(np.median(sizes)) <= 100.0


def are_pulses(values: Array) -> bool:
    """Return whether values of a column are pulses [us], but for a few."""
    finite = values[np.isfinite(values)]
    inside = (finite >= PULSES[0]) & (finite <= PULSES[1])
    return bool(finite.size) and float(inside.mean()) >= 0.95


def _glider_unit(name: str, size: float) -> tuple[str, str]:
    """Return the unit of a glider's column by the size of its values."""
    small, large, limit = GLIDER_UNITS[name]
    return (large if size > limit else small), "by its size"


def roughness(values: Array) -> float:
    """Return the median change of slope from sample to sample, 0 where there is none.

    >>> roughness(np.array([0.0, 1.0, 0.0, 1.0]))
    2.0
    """
    change = np.abs(np.diff(values[np.isfinite(values)], 2))
    return float(np.median(change[change > 0.0])) if np.any(change > 0.0) else 0.0


def of_one_unit(values: Array, group: Sequence[Array]) -> list[Array]:
    """Return the signals of a group in the unit of one of them, by their noise.

    Cameras see all three axes about alike; in mm and m noise differs by a thousand.
    """
    own = roughness(values)
    sizes = [roughness(each) for each in group]
    return [
        each
        for each, size in zip(group, sizes, strict=True)
        if 0.0 in (own, size) or 1.0 / UNITS_APART < size / own < UNITS_APART
    ]


def percentile(group: Sequence[Array]) -> float:
    """Return the 99th percentile of the moduli of signals, 0 without any."""
    finite = np.concatenate([np.abs(each[np.isfinite(each)]) for each in group])
    return float(np.percentile(finite, 99.0)) if finite.size else 0.0


def accelerometer_of(columns: Sequence[DraftColumn], values: Mapping[str, Array]) -> str:
    """Return what the accelerometer measures, by its length at rest; '' without one."""
    axes = [values[item.column] for item in columns if item.field.startswith("accel_")]
    if not axes:
        return ""
    length = float(np.nanmedian(np.sqrt(np.sum(np.square(axes), axis=0))))
    gravity = any(low < length < high for low, high in (NEAR_ONE, NEAR_GRAVITY))
    return "specific_force" if gravity or len(axes) < 3 else "inertial"


def repeating_streams(
    columns: Sequence[DraftColumn], values: Mapping[str, Array]
) -> tuple[str, ...]:
    """Return the streams whose values mostly repeat those of the row before."""
    repeating = []
    for stream in ("velocity", "imu"):
        own = [values[item.column] for item in columns if item.stream == stream]
        if own:
            table = np.column_stack(own)
            same = (table[1:] == table[:-1]).all(axis=1)
            if same.size and same.mean() > HELD_SHARE and np.ptp(table[:, 0]) > 0.0:
                repeating.append(stream)
    return tuple(repeating)
