"""The force that a viscous model has to explain: McCarter (4.4), every component kept."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import column, has_columns, make_table, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.equations_of_motion import Control, ForceComponents, residual_force
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle, vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import eta_ratio
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.stages.base import Document, Stage, param, port
from auvid.stages.columns import (
    ACCELERATION,
    AXIS_UNITS,
    POSE,
    VELOCITY,
    VELOCITY_SD,
    clock,
    force_columns,
    named,
    rms,
)
from auvid.stages.presentation import panel, plot, remark, section, series, table

FINS = ("fin_s_rad", "fin_p_rad", "fin_b_rad", "fin_t_rad")


@dataclass(frozen=True)
class Inputs:
    segment: Document = port("segment")
    fused: pa.Table = port("fused")
    fusion: Document = port("fusion")
    resampled: pa.Table = port("resampled")
    vehicle: Document = port("vehicle")
    log_info: Document = port("log_info")


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
    vehicle, said = with_logged_directions(
        vehicle_from_document(inputs.vehicle), inputs.log_info["parameters"]
    )
    commands, level = _commands(inputs, vehicle, params)
    fused = inputs.fused
    nu = matrix(fused, VELOCITY)
    parts = residual_force(vehicle, matrix(fused, POSE), nu, matrix(fused, ACCELERATION), commands)
    columns: dict[str, Array] = {"t_s": clock(fused), **named(VELOCITY, nu)}
    if has_columns(fused, VELOCITY_SD):
        columns |= named(VELOCITY_SD, matrix(fused, VELOCITY_SD))
    if level is not None:
        columns["eta_ratio"] = eta_ratio(level, nu, params.minimum_speed_m_s)
    for name, force in parts.components().items():
        columns |= named(force_columns(name), force)
    return Outputs(
        residual=make_table("residual", columns),
        controls=_controls(inputs, commands, level),
        section=_section(inputs, vehicle, parts, said),
        views=_views(parts.components()),
    )


def _commands(inputs: Inputs, vehicle: Vehicle, params: Params) -> tuple[Control, Array | None]:
    """Actuator inputs at the times of the fused table, filtered as the state was, and
    the level speed u_c of the command (C.12).
    """
    keep = np.searchsorted(clock(inputs.resampled), clock(inputs.fused) - 1e-9)
    cutoff = inputs.fusion["cutoff_hz"] if params.filter_actuators else None

    def smooth(values: Array) -> Array:
        filtered = (
            values
            if cutoff is None
            else zero_phase_lowpass(clock(inputs.resampled), values, cutoff_hz=float(cutoff))
        )
        return np.asarray(filtered[keep])

    rev_s = fins = thrust = level = None
    active, raw_speed = False, np.zeros(1)
    if vehicle.propeller is not None:
        raw = raw_speed = _columns(inputs, ("propeller_rev_s",))[:, 0]
        active |= bool(np.any(raw != 0.0))
        rev_s, level = smooth(raw), level_speed(vehicle.propeller, raw[keep])
    if vehicle.fins is not None:
        raw = _columns(inputs, FINS)
        active |= bool(np.any(raw != 0.0))
        fins = smooth(raw)
    if vehicle.thrusters is not None:
        pulses = _columns(inputs, tuple(f"pwm_{number}_us" for number in vehicle.thrusters.outputs))
        raw = thruster_forces(vehicle.thrusters, pulses, _voltage(inputs)[0])
        active |= bool(np.any(raw != 0.0))
        thrust = smooth(raw)
    if not active and not params.allow_no_actuation:
        raise DataError(
            f"no actuator acts in segment '{inputs.segment['id']}': every command is zero or"
            " neutral (was the vehicle armed?)",
            remedy=(
                "Choose a leg in which the vehicle drives, or set"
                " stages.residual.allow_no_actuation if it was towed or drifting."
            ),
        )
    if level is not None and np.isnan(level).any():
        raise DataError(
            "the propeller speed leaves the table of level speeds in segment"
            f" '{inputs.segment['id']}'",
            field="propeller_rev_s",
            value=float(np.max(np.abs(raw_speed))),
            remedy=(
                "Extend actuators.propeller.level_speed in the vehicle file; check the unit of the"
                " column (revolutions per second)."
            ),
        )
    return Control(propeller_rev_s=rev_s, fins_rad=fins, thruster_force_N=thrust), level


def _controls(inputs: Inputs, commands: Control, level: Array | None) -> pa.Table:
    columns: dict[str, Array] = {"t_s": clock(inputs.fused)}
    if commands.propeller_rev_s is not None:
        columns["propeller_rev_s"] = np.asarray(commands.propeller_rev_s)
    if level is not None:
        columns["level_speed_m_s"] = level
    if commands.fins_rad is not None:
        columns |= named(FINS, np.asarray(commands.fins_rad))
    if commands.thruster_force_N is not None:
        force = np.asarray(commands.thruster_force_N)
        columns |= named([f"thruster_{number}_N" for number in range(1, force.shape[1] + 1)], force)
    return make_table("controls", columns)


def _columns(inputs: Inputs, names: tuple[str, ...]) -> Array:
    missing = [name for name in names if not has_columns(inputs.resampled, (name,))]
    if missing:
        raise DataError(
            f"stage residual needs the stream 'actuators' with {', '.join(missing)} (segment"
            f" '{inputs.segment['id']}')",
            remedy=f"It can come from: {supply_text('actuators')}.",
        )
    values = matrix(inputs.resampled, names)
    if np.isnan(values).any():
        raise DataError(
            f"the stream 'actuators' does not cover segment '{inputs.segment['id']}'",
            remedy="Shorten the leg to where commands are logged.",
        )
    return values


def _voltage(inputs: Inputs) -> tuple[Array | None, float]:
    """Battery voltage (n,), None where it was never measured, and the share of samples
    that got the nearest measured one.
    """
    if not has_columns(inputs.resampled, ("voltage_v",)):
        return None, 1.0
    voltage, t_s = column(inputs.resampled, "voltage_v"), clock(inputs.resampled)
    known = np.isfinite(voltage)
    if not known.any():
        return None, 1.0
    return np.interp(t_s, t_s[known], voltage[known]), float(np.mean(~known))


def _section(inputs: Inputs, vehicle: Vehicle, parts: ForceComponents, said: str) -> dict[str, Any]:
    t = clock(inputs.fused) + float(inputs.segment["leg_start_s"])
    components = parts.components()
    panels = [
        panel(
            axis,
            AXIS_UNITS[axis],
            [series(_words(name), t, force[:, index], name) for name, force in components.items()],
        )
        for index, axis in enumerate(AXES)
    ]
    rows = [
        [_words(name), *(rms(force[:, index]) for index in range(6))]
        for name, force in components.items()
    ]
    blocks = [remark(said)] if said else []
    if vehicle.thrusters is not None and vehicle.thrusters.curve.voltage_exponent != 0.0:
        voltage, bare = _voltage(inputs)
        if voltage is None:
            words = (
                f"No battery voltage: thrust is taken at {vehicle.thrusters.curve.voltage_v:g} V,"
                " the voltage of the thrust curve."
            )
            blocks.append(remark(words, "warning"))
        elif bare > 0.0:
            words = (
                f"The battery voltage is missing in {100.0 * bare:.1f} % of the segment; the"
                " nearest measured one stands in."
            )
            blocks.append(remark(words, "warning"))
    blocks += [
        plot(
            "Components of the residual force",
            panels,
            group="time",
            look_for=(
                "tau_bar is what the other components leave over. Where one of them dominates, its"
                " errors do too."
            ),
        ),
        table(
            "RMS of each component",
            ["component", *((axis, AXIS_UNITS[axis]) for axis in AXES)],
            rows,
        ),
    ]
    return section(f"Residual force of {inputs.segment['id']}", blocks, order=40)


def _words(component: str) -> str:
    return component if component == "tau_bar" else component.replace("_", " ")


def _views(components: Iterable[str]) -> dict[str, Any]:
    """The residual force beside the models, and every component of it in a tab of its
    own.
    """
    groups = []
    parts = list(components)
    for index, axis in enumerate(AXES):
        whole = {"table": "residual", "unit": AXIS_UNITS[axis]}
        measured = {
            "columns": [force_columns("tau_bar")[index]],
            "names": [f"{axis} measured"],
            "roles": ["measured"],
            "tab": "Answer",
        }
        columns = [force_columns(name)[index] for name in parts]
        shown = {
            "columns": columns,
            "names": [f"{axis} {_words(name)}" for name in parts],
            "roles": parts,
            "tab": "Components",
        }
        groups += [
            {"entity": f"residual/{axis}", **whole, **measured},
            {"entity": f"components/{axis}", **whole, **shown},
        ]
    return {"groups": groups}


STAGE = Stage(
    "residual",
    "Residual force (4.4) with every component, per segment",
    "segment",
    Inputs,
    Params,
    Outputs,
    run,
)
