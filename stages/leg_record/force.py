"""What drives a leg on a uniform clock: newtons, or full commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import has_columns, matrix
from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import AXES, Array, Mask
from auvid.hydro.dynamics.actuators.commands import (
    ARDUSUB_FRAMES,
    COMMANDS,
    axis_of,
    commanded_force,
    full_commands,
)
from auvid.hydro.dynamics.actuators.propeller import propeller_force
from auvid.hydro.dynamics.actuators.thrusters import (
    NO_PULSE_US,
    Thrusters,
    thruster_force,
    thruster_forces,
)
from auvid.hydro.dynamics.vehicle.logged_directions import (
    UnscaledLayout,
    layout_without_curve,
    turned_as_logged,
)
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.record import ThrusterForces
from auvid.stages.columns import Samples
from auvid.stages.leg_record.between_samples import between_samples
from auvid.stages.leg_record.heading_law import level_by_law
from auvid.stages.leg_record.motion import enough, on_clock, step_s
from auvid.stages.leg_streams import Streams

SLOW_HZ = 5.0
"""Outputs at a lower rate are rebuilt between their samples."""
DEAD_BAND_US, DEAD_COMMAND = 28.0, 0.02
"""Within so much of neutral an output, or a command, does not act."""
FRAME_REMEDY = (
    "Name the frame of the autopilot in the vehicle file (actuators.commands.frame), or give"
    " actuators.thrusters with position and axis, or effect."
)
OUTPUTS_REMEDY = (
    "Log these outputs, or map their columns to pwm_n_us. A vehicle with fewer thrusters has"
    f" another frame. {FRAME_REMEDY}"
)


@dataclass(frozen=True)
class LegDrive:
    """Force of a leg on its clock: `values` (n, 6), nan where outputs are not logged.

    `acting` (n,): some output or command left its dead band. `full` (6,): what the
    actuators can give in each axis, in the unit of the values; nan where not known.
    `axes`: letters that are driven at all. `full_thrust`: see `AxisWindowsRecord`.
    `thrusters`: what makes `values` up, None where nothing says how outputs mix.
    """

    values: Array
    normalised: bool
    acting: Mask
    full: Array
    words: str
    axes: tuple[str, ...]
    full_thrust: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    thrusters: ThrusterForces | None = None


def actuator_table(streams: Streams) -> pa.Table:
    """Return the table of the actuators; raise `DataError` without one."""
    table = streams.tables.get("actuators")
    if table is None:
        raise DataError(
            "no actuators are logged", remedy=f"They can come from: {supply_text('actuators')}."
        )
    return table


def output_columns(thrusters: Thrusters) -> tuple[str, ...]:
    """Return the columns of the outputs that thrusters listen to."""
    return tuple(f"pwm_{number}_us" for number in thrusters.outputs)


def drive_of(
    streams: Streams,
    info: LogInfo,
    t_s: Array,
    *,
    surge: Array,
    max_gap_s: float,
    commands: bool = False,
    rebuild: bool = True,
) -> LegDrive:
    """Return what drives a leg on a uniform clock (n,) [s].

    surge (n,): u [m/s], which the thrust of a propeller depends on. commands: take
    normalised commands even where pulses are logged. rebuild: slow outputs between their
    samples. Raises `DataError` where nothing
    drives the vehicle that is logged, or nothing says how its outputs mix.
    """
    table, vehicle = actuator_table(streams), streams.vehicle
    logged = [name for name in COMMANDS if f"command_{name}" in table.column_names]
    pulses = any(name.startswith("pwm_") for name in table.column_names)
    if not (commands and logged):
        if vehicle.thrusters is not None and has_columns(table, output_columns(vehicle.thrusters)):
            return _newtons(streams, vehicle.thrusters, info, t_s, max_gap_s, rebuild)
        if vehicle.propeller is not None and has_columns(table, ("propeller_rev_s",)):
            return _propeller(streams, vehicle, t_s, surge, max_gap_s)
        if pulses and not logged:
            layout = _layout(vehicle, info, table)
            return _full_commands(streams, layout, info, t_s, max_gap_s, rebuild)
    if logged:
        return _commands(streams, logged, t_s, max_gap_s)
    raise DataError(
        "nothing that drives the vehicle is logged",
        field="actuators",
        value=", ".join(name for name in table.column_names if name != "time_us") or "no columns",
        allowed="pulses of the thrusters, propeller_rev_s if the vehicle file has a propeller, or"
        " command_surge to command_yaw",
    )


def pulses_of(
    streams: Streams,
    thrusters: Thrusters,
    info: LogInfo,
    t_s: Array,
    max_gap_s: float,
    rebuild: bool,
) -> tuple[Array, str]:
    """Return the pulses (n, k) of thrusters on a clock, and how slow ones were rebuilt.

    thrusters: with the directions of the log. No pulse counts as neutral. Between samples
    they are linear: held outputs of a slow log would lag by half a step.
    """
    samples = _samples(streams, output_columns(thrusters))
    # Between no pulse (0) and a neutral one there is no pulse of full reverse.
    pulses = np.where(samples.values < NO_PULSE_US, NEUTRAL_US, samples.values)
    width = on_clock(Samples(samples.t_s, pulses), t_s, max_gap_s)
    if not rebuild or step_s(samples) <= 1.0 / SLOW_HZ:
        return width, ""
    slow = Samples(samples.t_s, pulses)
    way = between_samples(streams, thrusters, slow, t_s, width, max_gap_s)
    law = level_by_law(streams, thrusters, slow, t_s, way.pulses, info.parameters)
    return (way.pulses, way.words) if law is None else (law.pulses, way.words + law.words)


def _samples(streams: Streams, names: tuple[str, ...]) -> Samples:
    samples = enough(streams.samples("actuators", names))
    if samples is None:
        raise DataError(
            "the actuators are empty",
            field="actuators",
            value=", ".join(names),
            remedy="Choose a leg in which commands are logged.",
        )
    return samples


def _turned(thrusters: Thrusters, info: LogInfo) -> tuple[Thrusters, str]:
    turned = turned_as_logged(thrusters, info.parameters)
    if turned is None:
        return thrusters, "Motor directions are not in the log: those of the vehicle file hold."
    return turned, ""


def _newtons(
    streams: Streams,
    thrusters: Thrusters,
    info: LogInfo,
    t_s: Array,
    max_gap_s: float,
    rebuild: bool,
) -> LegDrive:
    """Return the force by thrust curve, layout and voltage, in N and N m."""
    thrusters, note = _turned(thrusters, info)
    width, words = pulses_of(streams, thrusters, info, t_s, max_gap_s, rebuild)
    voltage = streams.voltage(t_s)
    forces = thruster_forces(thrusters, width, voltage)
    values = thruster_force(thrusters, forces)
    notes = [item for item in (note, words) if item]
    if voltage is None and thrusters.curve.voltage_exponent != 0.0:
        notes.append(
            f"No battery voltage is logged: thrust is taken at {thrusters.curve.voltage_v:g} V."
        )
    full = full_commands(thrusters)
    return LegDrive(
        values,
        False,
        _acting(width),
        full * float(np.abs(thrusters.curve.force_N).max()),
        "pulses of the thrusters by thrust curve and layout of the vehicle file",
        tuple(axis for axis, size in zip(AXES, full, strict=True) if size > 0.0),
        notes=tuple(notes),
        thrusters=ThrusterForces(thrusters.outputs, forces, thrusters.allocation),
    )


def _full_commands(
    streams: Streams,
    layout: UnscaledLayout,
    info: LogInfo,
    t_s: Array,
    max_gap_s: float,
    rebuild: bool,
) -> LegDrive:
    """Return the force of thrusters without a curve, in full commands.

    By a layout with lengths the pull of one axis tells that of another.
    """
    thrusters, note = _turned(layout.thrusters, info)
    width, words = pulses_of(streams, thrusters, info, t_s, max_gap_s, rebuild)
    full = full_commands(thrusters)
    axes = tuple(axis for axis, size in zip(AXES, full, strict=True) if size > 0.0)
    return LegDrive(
        commanded_force(thrusters, width),
        True,
        _acting(width),
        np.where(full > 0.0, 1.0, np.nan),
        f"pulses of the thrusters in full commands, mixed by {layout.source}",
        axes,
        {axis: float(full[AXES.index(axis)]) for axis in axes if layout.sized},
        tuple(item for item in (note, words) if item),
        ThrusterForces(
            thrusters.outputs,
            thruster_forces(thrusters, width),
            thrusters.allocation / np.where(full > 0.0, full, 1.0)[:, None],
        ),
    )


def _acting(width: Array) -> Mask:
    return np.asarray((np.abs(width - NEUTRAL_US) > DEAD_BAND_US).any(axis=1))


def _layout(vehicle: Vehicle, info: LogInfo, table: pa.Table) -> UnscaledLayout:
    """Return how outputs become forces; raise `DataError` where nobody says."""
    layout = layout_without_curve(vehicle.commands, info.parameters)
    if layout is None:
        config = info.parameters.get("FRAME_CONFIG")
        raise DataError(
            "frame unknown: nothing says how outputs become forces",
            field="FRAME_CONFIG",
            value="not logged" if config is None else f"{config:g}",
            allowed=", ".join(ARDUSUB_FRAMES),
            remedy=FRAME_REMEDY,
        )
    columns = output_columns(layout.thrusters)
    lacking = [name for name in columns if name not in table.column_names]
    if lacking:
        raise DataError(
            f"outputs are missing that {layout.source} has",
            field="actuators",
            value=", ".join(lacking),
            allowed=", ".join(columns),
            remedy=OUTPUTS_REMEDY,
        )
    return layout


def _propeller(
    streams: Streams, vehicle: Vehicle, t_s: Array, surge: Array, max_gap_s: float
) -> LegDrive:
    """Return the thrust of a propeller at the measured surge, else at rest."""
    assert vehicle.propeller is not None
    turns = on_clock(_samples(streams, ("propeller_rev_s",)), t_s, max_gap_s)[:, 0]
    nu = np.zeros((t_s.size, 6))
    nu[:, 0] = np.nan_to_num(surge)
    still = not np.isfinite(surge).any()
    return LegDrive(
        propeller_force(vehicle.propeller, nu, turns, water_density=vehicle.water_density),
        False,
        np.abs(np.nan_to_num(turns)) > 0.0,
        np.full(6, np.nan),
        "propeller speed by the propeller of the vehicle file",
        ("X",),
        notes=("No velocity is logged: the propeller's thrust is that at rest.",) if still else (),
    )


def _commands(streams: Streams, logged: list[str], t_s: Array, max_gap_s: float) -> LegDrive:
    """Return normalised commands as they are, in the axes that the vehicle has."""
    allowed = streams.vehicle.commands.axes
    names = [name for name in logged if not allowed or axis_of(name) in allowed]
    if not names:
        raise DataError(
            "no logged command acts",
            field="actuators.commands.axes",
            value=", ".join(allowed),
            allowed=", ".join(logged),
            remedy="Name the commands of the log in actuators.commands.axes.",
        )
    table = actuator_table(streams)
    times = streams.times("actuators")
    inside = (times >= streams.window[0]) & (times <= streams.window[1])
    values, empty = np.zeros((t_s.size, 6)), []
    for name in names:
        cells = matrix(table, (f"command_{name}",))
        rows = inside & np.isfinite(cells[:, 0])
        samples = enough(Samples(times[rows], cells[rows]))
        if samples is None:
            empty.append(name)  # no command of that axis; the others have theirs
        else:
            values[:, AXES.index(axis_of(name))] = on_clock(samples, t_s, max_gap_s)[:, 0]
    if len(empty) == len(names):
        raise DataError(
            "the commands are empty",
            field="actuators",
            value=", ".join(f"command_{name}" for name in names),
            remedy="Choose a leg in which commands are logged.",
        )
    axes = tuple(axis for axis in AXES if axis in (axis_of(n) for n in names if n not in empty))
    return LegDrive(
        values,
        True,
        np.asarray((np.abs(np.nan_to_num(values)) > DEAD_COMMAND).any(axis=1)),
        np.ones(6),
        "normalised commands of the log, without a unit of force",
        axes,
        notes=tuple(f"command_{name} is empty: taken as 0." for name in empty),
    )
