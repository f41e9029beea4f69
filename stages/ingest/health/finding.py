"""The recorded log that all checks read, and the form of a finding."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import is_
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.checks import checks
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import arrow_array, column, matrix, numbers
from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.checks.motion_checks import down_at
from auvid.hydro.identification.checks.signal_checks import ClockStatistics, clock_statistics
from auvid.hydro.identification.signals.pose.track import PoseTrack
from auvid.hydro.long_series.long_arrays import is_mapped, laid_down, let_go
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, LINEAR_VELOCITY, OF_POSES
from auvid.stages.ingest.streams.mapping import OtherSource

Finding = dict[str, Any]
Result = TypeVar("Result")
ESTIMATED = re.compile(
    r"estimate of the navigation filter|relative altitude of the navigation filter"
)
ON_CHANGE = ("mode", "events")
UNDER_WATER = re.compile(r"ArduSub")
ELSEWHERE = re.compile(
    r"Ardu(Copter|Plane|Rover)|APM:(Copter|Plane|Rover)|APMrover|Blimp|AntennaTracker"
)
MAV_TYPE_SUBMARINE = 12
MOTOR_FUNCTIONS = (*range(33, 41), *range(82, 86))  # SERVOn_FUNCTION of Motor1 to Motor12
MOTORS = 8
SWING_US = 40.0
"""Pulses beyond the dead band of a speed controller."""
MOST_THERE = 0.5
"""Share of its numbers that a measured column has at least."""
MOST_KEPT_ROWS = 200_000
"""Of a stream whose arrays are kept from check to check; it bounds the memory."""


@dataclass(frozen=True)
class CheckedLog:
    """One log: streams, `log_info`, rejected samples, vehicle file, other sources.

    `track`: the motion that its poses show, in seconds from the first pose.
    """

    tables: Mapping[str, pa.Table]
    info: LogInfo
    dropped: pa.Table
    vehicle: Vehicle | None = None
    others: Sequence[OtherSource] = ()
    track: PoseTrack | None = None
    _times: dict[str, Array] = field(default_factory=dict, repr=False)
    _kept: dict[object, tuple[tuple[object, ...], Any]] = field(default_factory=dict, repr=False)

    def has(self, *streams: str) -> bool:
        """Return whether all of these streams are there."""
        return all(name in self.tables for name in streams)

    def t_s(self, stream: str) -> Array:
        """Return the times of a stream (n,) in seconds from the start of the log."""
        if stream not in self._times:
            stamps = numbers(self.tables[stream]["time_us"])
            self._times[stream] = laid_down(self.seconds(stamps))
        return self._times[stream]

    def clock(self, stream: str) -> ClockStatistics | None:
        """Return statistics of the steps of a stream's clock; None for too few."""
        t_s = self.t_s(stream)
        return self.once(("clock", stream), (t_s,), lambda: clock_statistics(t_s))

    def between(self, start_s: float, end_s: float) -> CheckedLog:
        """Return the log between two times [s] from its start."""
        tables, times = {}, {}
        for name, table in self.tables.items():
            first, last = np.searchsorted(self.t_s(name), (start_s, end_s)).tolist()
            if last > first:
                tables[name] = table.slice(first, last - first)
                times[name] = self.t_s(name)[first:last]
        return replace(self, tables=tables, _times=times, _kept={})

    def in_time(self) -> CheckedLog:
        """Return the log on one clock, without the lags of the vehicle file."""
        if self.vehicle is None:
            return self
        lags = self.vehicle.sensor_lags_s
        times = {
            name: self.t_s(name) - lags[name] if lags.get(name) else self.t_s(name)
            for name in self.tables
        }
        return replace(self, _times=times)

    def without(self, stream: str) -> CheckedLog:
        """Return the log as if it had no such stream."""
        tables = {name: table for name, table in self.tables.items() if name != stream}
        return replace(self, tables=tables)

    def without_accelerometer(self) -> CheckedLog:
        """Return the log as if its inertial unit had no accelerometer."""
        imu = self.tables["imu"].drop_columns(
            [name for name in ACCELEROMETER if name in self.tables["imu"].column_names]
        )
        return replace(self, tables={**self.tables, "imu": imu})

    def with_columns(self, stream: str, columns: Mapping[str, Array]) -> CheckedLog:
        """Return the log with other values in some columns of a stream."""
        table = self.tables[stream]
        for name, values in columns.items():
            place = table.column_names.index(name)
            cells = arrow_array(laid_down(values), pa.float64())
            table = table.set_column(place, table.schema.field(name), cells)
        return replace(self, tables={**self.tables, stream: table})

    def seconds(self, time_us: npt.NDArray[np.int64]) -> Array:
        """Return time stamps (n,) in seconds from the start of the log."""
        return np.asarray((time_us - int(self.info.start_us)) / 1e6)

    @property
    def beyond_stated(self) -> str:
        """Words that follow a lag; empty where the vehicle file states none."""
        lags = {} if self.vehicle is None else self.vehicle.sensor_lags_s
        return " beyond the lags that the vehicle file states" if any(lags.values()) else ""

    def once(self, name: object, of: Sequence[object], compute: Callable[[], Result]) -> Result:
        """Return what is computed once from these objects, on mended logs as well.

        Nobody may change it. Of a long log only what is laid down outside of memory is kept.
        """
        if name in self._kept:
            before, result = self._kept[name]
            if len(before) == len(of) and all(map(is_, before, of)):
                return result  # type: ignore[no-any-return]
        result = compute()
        if is_mapped(result) or all(
            table.num_rows <= MOST_KEPT_ROWS for table in self.tables.values()
        ):
            self._kept[name] = tuple(of), result
        return result

    def values(self, stream: str, names: Iterable[str]) -> Array:
        """Return columns of a stream as an array (n, k)."""
        table, columns = self.tables[stream], tuple(names)
        let_go()
        return self.once((stream, columns), (table,), lambda: laid_down(matrix(table, columns)))

    def column(self, stream: str, name: str) -> Array:
        """Return one column of a stream (n,)."""
        table = self.tables[stream]
        let_go()
        return self.once((stream, name), (table,), lambda: column(table, name))

    def swings(self, output: str) -> bool:
        """Return whether an output leaves neutral to both sides."""
        pulses = self.column("actuators", output)
        low, high = np.nanmin(pulses, initial=NEUTRAL_US), np.nanmax(pulses, initial=NEUTRAL_US)
        return bool(low < NEUTRAL_US - SWING_US and high > NEUTRAL_US + SWING_US)

    def without_empty(self, stream: str, names: Sequence[str]) -> CheckedLog:
        """Return the log without rows of a stream that lack one of these numbers.

        A column that lacks most of its numbers is one that is not measured, and takes no
        other with it.
        """
        if not self.has(stream):
            return self
        table, there = self.tables[stream], np.isfinite(self.values(stream, names))
        rows = there[:, there.mean(axis=0) > MOST_THERE].all(axis=1)
        if rows.all() or not rows.any():
            return self
        return replace(self, tables={**self.tables, stream: table.filter(rows)}, _times={})

    def body_velocity(self) -> Array:
        """Return the velocity (n, 3) without the mounting of the vehicle file."""
        measured = self.values("velocity", LINEAR_VELOCITY)
        rotation = np.eye(3) if self.vehicle is None else self.vehicle.dvl.rotation
        if np.array_equal(rotation, np.eye(3)):
            return measured  # an axis that is not measured spoils no other
        return np.asarray(measured @ rotation.T)

    def depth_of_velocity(self) -> tuple[Array, Array]:
        """Return times (n,) and depths (n,) of the place of the velocity log.

        By the arms of the vehicle file: a hull that pitches lifts one sensor and lowers the
        other.
        """
        t_s, depth = self.t_s("depth"), self.column("depth", "depth_m")
        vehicle = self.vehicle
        lower = vehicle.dvl.arm_m - vehicle.depth_sensor.arm_m if vehicle else np.zeros(3)
        if not lower.any() or not self.has("attitude"):
            return t_s, depth
        at, angles = self.t_s("attitude"), self.values("attitude", ATTITUDE)

        def moved() -> Array:
            return np.asarray(depth + down_at(t_s, at, angles) @ lower)

        return t_s, self.once("depth_of_velocity", (t_s, depth, at, angles, vehicle), moved)

    def source(self, stream: str) -> str:
        """Return the source of a stream."""
        return str(self.info.streams[stream].source)

    def estimated(self, stream: str) -> bool:
        """Return whether a stream is an estimate of the navigation filter."""
        return any(note.startswith(stream) and ESTIMATED.search(note) for note in self.info.notes)

    def accelerometer(self) -> Array | None:
        """Return the accelerometer (n, 3) if the inertial unit has one."""
        if not self.has("imu") or not set(ACCELEROMETER) <= set(self.tables["imu"].column_names):
            return None
        values = self.values("imu", ACCELEROMETER)
        return values if np.isfinite(values).any() else None

    @property
    def under_water(self) -> bool | None:
        """Return whether the firmware is that of an underwater vehicle.

        None if the log does not say.
        """
        firmware = str(self.info.vehicle or "")
        if UNDER_WATER.search(firmware):
            return True
        kind = self.info.parameters.get("MAV_TYPE")
        if ELSEWHERE.search(firmware) or (kind is not None and int(kind) != MAV_TYPE_SUBMARINE):
            return False
        return True if kind is not None else None

    def thrusters(self) -> list[str]:
        """Return the columns of the outputs that drive thrusters.

        They come from the vehicle file, else from the vehicle's parameters, else they
        are outputs 1 to 8.
        """
        there = self.tables["actuators"].column_names if self.has("actuators") else []
        entry = self.vehicle and self.vehicle.document.actuators.thrusters
        named = entry.outputs if entry else None
        if named is None:
            functions = {
                number: self.info.parameters.get(f"SERVO{number}_FUNCTION")
                for number in range(1, 17)
            }
            named = [
                number
                for number, function in functions.items()
                if function is not None and int(function) in MOTOR_FUNCTIONS
            ]
        columns = [f"pwm_{number}_us" for number in named or range(1, MOTORS + 1)]
        return [name for name in columns if name in there]

    def commands(self) -> list[str]:
        """Return the columns of normalised commands."""
        return (
            [name for name in self.tables["actuators"].column_names if name.startswith("command_")]
            if self.has("actuators")
            else []
        )


def finite(values: Array, *, nan: float = 0.0) -> Array:
    """Return values with a number for nan, themselves where all are finite."""
    if np.isfinite(values).all():
        return values
    return laid_down(np.nan_to_num(values, nan=nan))


def finding(
    name: str,
    text: str,
    *,
    stream: str | None = None,
    value: float | None = None,
    at_s: float | None = None,
    fields: Sequence[str] = (),
    remedy: str = "",
) -> Finding:
    """Return a finding of the catalogue with its sentence and measured value.

    `at_s` is its time from the start of the log, where it has one; `fields` are those
    of the stream in question; `remedy` knows more than the catalogue's.
    """
    check = checks()[name]
    number = None if value is None or not np.isfinite(value) else float(value)
    return {
        "id": name,
        "severity": check.severity,
        "stream": stream,
        "text": text,
        "value": number,
        "threshold": check.threshold,
        "unit": check.unit,
        "remedy": remedy or check.remedy,
        "at_s": None if at_s is None or not np.isfinite(at_s) else float(at_s),
        "fields": list(fields),
    }


def limit(name: str) -> float:
    """Return the threshold of a check."""
    return checks()[name].limit


def listed(words: Sequence[str]) -> str:
    """Join words with commas, and `and` before the last."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def how_often(count: int) -> str:
    """Return `once`, `3 times`."""
    return "once" if count == 1 else f"{count} times"


def counted(count: int, word: str) -> str:
    """Return `1 gap`, `3 gaps`."""
    return f"{count} {word}{'' if count == 1 else 's'}"


def mounting_remedy(log: CheckedLog) -> str:
    """Return what to correct of a velocity in turned axes, without a full stop."""
    if log.source("velocity").startswith(OF_POSES):
        return (
            "Correct the frame of the pose in the column map, or how its axes are turned"
            " (sensors.pose.mounting in the vehicle file)"
        )
    return "Correct the mounting of the velocity sensor (sensors.dvl in the vehicle file)"
