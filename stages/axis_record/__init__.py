"""The record of a leg for the fits of single axes: motion, what drives it, windows.

From the raw streams, so that a log without a velocity sensor has a route: yaw from the
gyro, heave from depth. Forces are newtons where the vehicle file has a thrust curve, else
full commands, through the frame of the autopilot or a layout of the vehicle file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.records.axes import AxisWindowsRecord, LeftOutStretch
from auvid.data_schemas.records.logs import LogInfo
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.axis_record.presentation import record_section, record_views
from auvid.stages.axis_tables import axis_record_table, effects_of
from auvid.stages.base import Stage, param, port
from auvid.stages.columns import TOO_COARSE, leg_window
from auvid.stages.leg_record.motion import smoothed_s
from auvid.stages.leg_record.record import RecordedLeg, RecordOptions, leg_record
from auvid.stages.leg_streams import Streams

STREAMS = ("imu", "attitude", "depth", "velocity", "actuators", "battery", "mode", "sticks")


@dataclass(frozen=True)
class Inputs:
    """One leg, its log, the vehicle, and the raw streams of the log."""

    leg: LegEntry = port("leg")
    log_info: LogInfo = port("log_info")
    vehicle: Vehicle = port("vehicle")
    imu: pa.Table | None = port("imu", optional=True)
    attitude: pa.Table | None = port("attitude", optional=True)
    depth: pa.Table | None = port("depth", optional=True)
    velocity: pa.Table | None = port("velocity", optional=True)
    actuators: pa.Table | None = port("actuators", optional=True)
    battery: pa.Table | None = port("battery", optional=True)
    mode: pa.Table | None = port("mode", optional=True)
    sticks: pa.Table | None = port("sticks", optional=True)


@dataclass(frozen=True)
class Params:
    """Clock, windows, and what drives."""

    rate_hz: float = param(
        "Hz",
        20.0,
        meaning="rate of the uniform clock; that of the log where it is lower",
        low=0.5,
        high=200.0,
    )
    window_s: float = param("s", 10.0, meaning="length of a window, about", low=5.0, high=600.0)
    max_gap_s: float = param(
        "s", 1.0, meaning="a longer pause of a stream, beyond four of its steps, is a gap", low=0.01
    )
    use_commands: bool = param(
        "1", False, meaning="take normalised commands for the force even where pulses are logged"
    )
    rebuild_outputs: bool = param(
        "1",
        True,
        meaning="rebuild outputs below 5 Hz from sticks, gyro and attitude, where that is better",
    )
    lag_s: Mapping[str, float] = param(
        "s", {}, meaning="stream -> how late its stamps are, beside the lags of the vehicle file"
    )


@dataclass(frozen=True)
class Outputs:
    """The record as table and document, and what the report shows of it."""

    axis_record: pa.Table = port("axis_record")
    axis_windows: AxisWindowsRecord = port("axis_windows")
    section: dict[str, Any] = port("section")
    views: dict[str, Any] = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return the record of one leg.

    Raises `DataError` for a leg outside its log, without motion or outputs, or whose
    outputs nobody knows how to turn into forces.
    """
    info = inputs.log_info
    start_us = int(info.start_us)
    streams = Streams(
        {name: getattr(inputs, name) for name in STREAMS},
        start_us,
        leg_window(inputs.leg, start_us, int(info.end_us)),
        inputs.vehicle,
        params.lag_s,
    )
    options = RecordOptions(
        rate_hz=params.rate_hz,
        max_gap_s=params.max_gap_s,
        window_s=params.window_s,
        commands=params.use_commands,
        rebuild=params.rebuild_outputs,
    )
    result = leg_record(streams, info, inputs.leg.id, options)
    windows = _document(inputs, result)
    return Outputs(
        axis_record_table(result.record, start_us),
        windows,
        record_section(windows, result),
        record_views(result.record),
    )


def _document(inputs: Inputs, result: RecordedLeg) -> AxisWindowsRecord:
    record, drive, notes = result.record, result.drive, inputs.log_info.notes
    return AxisWindowsRecord.model_validate(
        {
            "leg": inputs.leg.id,
            "log": inputs.leg.log,
            "use": inputs.leg.use,
            "start_s": float(record.t_s[0]),
            "rate_hz": result.rate_hz,
            "normalised": record.normalised,
            "force": drive.words,
            "measured_by": dict(record.measured_by),
            "smoothed_s": smoothed_s(record.measured_by, inputs.log_info),
            "windows_s": {axis: result.length_s(axis) for axis in record.windows},
            "left_out": [LeftOutStretch.model_validate(item._asdict()) for item in record.left_out],
            "full_force": dict(inputs.vehicle.commands.full_force),
            "full_thrust": dict(drive.full_thrust),
            "thrusters": [] if record.thrusters is None else effects_of(record.thrusters),
            "notes": [*result.notes, *(note for note in notes if TOO_COARSE in note)],
            "warnings": list(result.warnings),
        }
    )


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="axis_record",
    summary="Put motion and force of a leg on one clock and choose windows for each axis",
    maps_over="leg",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
)
