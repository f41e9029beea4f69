"""The force that a viscous model has to explain: McCarter (4.4), all parts kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import column, has_columns, make_table, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import eta_ratio
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.stages.base import Document, Stage, param, port
from auvid.stages.columns import (
    ACCELERATION,
    FINS,
    POSE,
    VELOCITY,
    VELOCITY_SD,
    clock,
    force_columns,
    named,
)
from auvid.stages.residual.presentation import residual_section, residual_views, voltage_note


@dataclass(frozen=True)
class Inputs:
    segment: SegmentRecord = port("segment")
    fused: pa.Table = port("fused", columns=(*POSE, *VELOCITY, *VELOCITY_SD, *ACCELERATION))
    fusion: FusionRecord = port("fusion")
    resampled: pa.Table = port("resampled", columns=("voltage_v", *schema("actuators").columns))
    vehicle: Vehicle = port("vehicle")
    log_info: LogInfo = port("log_info")


@dataclass(frozen=True)
class Params:
    filter_actuators: bool = param(
        "1", True, meaning="pass the actuator inputs through the low-pass of fuse"
    )
    minimum_speed_m_s: float = param(
        "m/s", 0.05, meaning="lower bound of U in eta = u_c(n)/U", low=1e-3, high=1.0
    )
    allow_no_actuation: bool = param(
        "1", False, meaning="go on where no actuator acts (a towed or drifting vehicle)"
    )


@dataclass(frozen=True)
class Outputs:
    residual: pa.Table = port("residual")
    controls: pa.Table = port("controls")
    section: Document = port("section")
    views: Document = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return the residual force of one segment and the actuator inputs behind it.

    Raises `DataError` where commands are missing, or no actuator acts.
    """
    vehicle, direction_note = with_logged_directions(inputs.vehicle, inputs.log_info.parameters)
    voltage, bare = _voltage(inputs.resampled)
    control, level = _control(inputs, vehicle, params, voltage)
    fused = inputs.fused
    nu = matrix(fused, VELOCITY)
    components = residual_force(
        vehicle, matrix(fused, POSE), nu, matrix(fused, ACCELERATION), control
    ).components()
    columns: dict[str, Array] = {"t_s": clock(fused), **named(VELOCITY, nu)}
    if has_columns(fused, VELOCITY_SD):
        columns |= named(VELOCITY_SD, matrix(fused, VELOCITY_SD))
    if level is not None:
        columns["eta_ratio"] = eta_ratio(level, nu, params.minimum_speed_m_s)
    t = clock(fused) + float(inputs.segment.leg_start_s)
    warning = voltage_note(vehicle, bare)
    section = residual_section(str(inputs.segment.id), t, components, direction_note, warning)
    views = residual_views(components)
    for name in list(components):  # columns are copies, as long as the arrays that go
        columns |= named(force_columns(name), components.pop(name))
    return Outputs(
        residual=make_table("residual", columns),
        controls=_controls(clock(fused), control, level),
        section=section,
        views=views,
    )


def _control(
    inputs: Inputs, vehicle: Vehicle, params: Params, voltage: Array | None
) -> tuple[Control, Array | None]:
    """Return actuator inputs at the times of the fused table, and the level speed u_c.

    Inputs are filtered as the state was; the level speed (C.12) is that of the command.
    """
    raw: dict[str, Array] = {}
    if vehicle.propeller is not None:
        raw["propeller"] = _columns(inputs, ("propeller_rev_s",))[:, 0]
    if vehicle.fins is not None:
        raw["fins"] = _columns(inputs, FINS)
    if vehicle.thrusters is not None:
        outputs = tuple(f"pwm_{number}_us" for number in vehicle.thrusters.outputs)
        raw["thrusters"] = thruster_forces(vehicle.thrusters, _columns(inputs, outputs), voltage)
    t_s = clock(inputs.resampled)
    keep = np.searchsorted(t_s, clock(inputs.fused) - 1e-9)
    acts = any(np.any(values[keep] != 0.0) for values in raw.values())
    if not (params.allow_no_actuation or acts):
        raise DataError(
            f"no actuator acts in segment '{inputs.segment.id}': every command is zero or"
            " neutral (was the vehicle armed?)",
            remedy=(
                "Choose a leg in which the vehicle drives, or set"
                " stages.residual.allow_no_actuation if it was towed or drifting."
            ),
        )
    level = None
    if vehicle.propeller is not None:
        level = level_speed(vehicle.propeller, raw["propeller"][keep])
        if np.isnan(level).any():
            raise DataError(
                "the propeller speed leaves the table of level speeds in segment"
                f" '{inputs.segment.id}'",
                field="propeller_rev_s",
                value=float(np.max(np.abs(raw["propeller"]))),
                remedy=(
                    "Extend actuators.propeller.level_speed in the vehicle file; check the unit of"
                    " the column (revolutions per second)."
                ),
            )
    cutoff = inputs.fusion.cutoff_hz if params.filter_actuators else None
    if cutoff is not None:
        raw = {
            name: zero_phase_lowpass(t_s, values, cutoff_hz=float(cutoff))
            for name, values in raw.items()
        }
    kept = {name: np.asarray(values[keep]) for name, values in raw.items()}
    control = Control(
        propeller_rev_s=kept.get("propeller"),
        fins_rad=kept.get("fins"),
        thruster_force_N=kept.get("thrusters"),
    )
    return control, level


def _columns(inputs: Inputs, names: tuple[str, ...]) -> Array:
    missing = [name for name in names if name not in inputs.resampled.column_names]
    if missing:
        raise DataError(
            f"stage residual needs the stream 'actuators' with {', '.join(missing)} (segment"
            f" '{inputs.segment.id}')",
            remedy=f"It can come from: {supply_text('actuators')}.",
        )
    values = matrix(inputs.resampled, names)
    if np.isnan(values).any():
        raise DataError(
            f"the stream 'actuators' does not cover segment '{inputs.segment.id}'",
            remedy="Shorten the leg to where commands are logged.",
        )
    return values


def _voltage(resampled: pa.Table) -> tuple[Array | None, float]:
    """Return the battery voltage (n,), None without one, and the share not measured.

    Samples without a measured voltage get the nearest one.
    """
    voltage = column(resampled, "voltage_v") if has_columns(resampled, ("voltage_v",)) else None
    measured = np.zeros(1, dtype=np.bool_) if voltage is None else np.isfinite(voltage)
    if voltage is None or not measured.any():
        return None, 1.0
    t_s = clock(resampled)
    return np.interp(t_s, t_s[measured], voltage[measured]), float(np.mean(~measured))


def _controls(t_s: Array, control: Control, level: Array | None) -> pa.Table:
    columns: dict[str, Array] = {"t_s": t_s}
    if control.propeller_rev_s is not None and level is not None:
        columns["propeller_rev_s"] = np.asarray(control.propeller_rev_s)
        columns["level_speed_m_s"] = level
    if control.fins_rad is not None:
        columns |= named(FINS, np.asarray(control.fins_rad))
    if control.thruster_force_N is not None:
        force = np.asarray(control.thruster_force_N)
        columns |= named([f"thruster_{number}_N" for number in range(1, force.shape[1] + 1)], force)
    return make_table("controls", columns)


STAGE = Stage(
    "residual",
    "Residual force (4.4) with every component, per segment",
    "segment",
    Inputs,
    Params,
    Outputs,
    run,
)
