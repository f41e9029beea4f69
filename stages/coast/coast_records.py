"""Coasts and powered legs of a segment, axis by axis, as the methods take them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array, Mask
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.coasting.decay import CoastRecord
from auvid.hydro.identification.coasting.finding import Coast, CoastRule, CoastSearch, find_coasts
from auvid.hydro.identification.coasting.finding import idle_axes as idle_by_thrusters
from auvid.hydro.identification.coasting.thrust_scale import PoweredLeg
from auvid.stages.columns import (
    ACCELERATION,
    ATTITUDE,
    GYRO,
    VELOCITY,
    clock,
    force_columns,
    forces,
)
from auvid.stages.sensor_motion import VelocityLogPlacement

DEGREES = {"u": 0, "v": 1, "w": 2, "r": 5}
"""Velocity -> its place; roll and pitch swing about upright, they do not coast."""
ACTUATORS = ("thrusters", "propeller")
FORCE_COLUMNS = tuple(
    name
    for part in (
        "tau_bar",
        "restoring",
        "rigid_body_coriolis",
        "added_mass_coriolis",
        "fins",
        *ACTUATORS,
    )
    for name in force_columns(part)
)
"""Of the residual force, beside its clock."""
COMMANDS = tuple(schema("actuators").columns)
STILL_REV_S = 0.05
"""A propeller that turns slower stands."""
BEFORE_S = 2.0
"""What of the thrust before a stop may still fade after it."""
OVER_GROUND = 2
"""Surge and sway of a velocity log over ground have a current in them."""


@dataclass(frozen=True)
class SegmentCoasts:
    """Coasts of a segment on one velocity."""

    search: CoastSearch
    records: tuple[CoastRecord, ...]


@dataclass(frozen=True)
class SegmentTables:
    """What earlier stages hand on of one segment; None for a sensor that it lacks."""

    segment: SegmentRecord
    fusion: FusionRecord
    log: LogInfo
    fused: pa.Table
    residual: pa.Table
    resampled: pa.Table
    imu: pa.Table | None
    velocity: pa.Table | None


def segment_coasts(
    tables: SegmentTables,
    vehicle: Vehicle,
    place: VelocityLogPlacement,
    rules: Mapping[str, CoastRule],
    *,
    lag_s: float,
    released: bool,
    logs: Sequence[str],
) -> dict[str, SegmentCoasts]:
    """Return the coasts of a segment by velocity; `lag_s`: lag of the thrust.

    `released`: something else let go of the body at the start of the segment. `logs`: of
    all segments, each with its current.
    """
    fused, residual = tables.fused, tables.residual
    t_s = clock(fused)
    thrust, idle = _drive(tables, vehicle)
    mass = vehicle.mass_matrix
    diagonal = np.diag(mass)
    # All of the equation of motion but drag and thrust.
    coupled = matrix(fused, ACCELERATION) @ (mass - np.diag(diagonal)).T
    modelled = forces(residual, "restoring") - coupled
    modelled = modelled - sum(
        forces(residual, f"{kind}_coriolis") for kind in ("rigid_body", "added_mass")
    )
    if has_columns(residual, force_columns("fins")):
        modelled = modelled + forces(residual, "fins")
    down = _down(fused, vehicle)
    step_s = float(t_s[1] - t_s[0])
    late = first_order_lag(thrust, lag_s=lag_s, step_s=step_s)
    out = {}
    for name, place_of in DEGREES.items():
        speed = column(fused, VELOCITY[place_of])
        search = find_coasts(t_s, idle[:, place_of], speed, rules[name], released=released)
        times, measured = _samples(tables, place, name)
        shapes = down[:, [place_of]] if place_of < 3 else np.zeros((t_s.size, 0))
        drift = drift_shares(fused, tables.segment, tables.fusion, place_of, logs)
        m = diagonal[place_of]
        records = []
        for item in search.coasts:
            rows = (times >= item.start_s) & (times <= item.end_s)
            at = times[rows]
            records.append(
                CoastRecord(
                    at,
                    measured[rows],
                    np.interp(at, t_s, modelled[:, place_of] / m),
                    np.column_stack(
                        [np.interp(at, t_s, shape / m) for shape in shapes.T]
                        or [np.zeros((at.size, 0))]
                    ),
                    np.interp(at, t_s, late[:, place_of] / m),
                    drift[(t_s >= item.start_s) & (t_s <= item.end_s)].mean(axis=0),
                    _driven(t_s, thrust[:, place_of] / m, item),
                )
            )
        out[name] = SegmentCoasts(search, tuple(records))
    return out


def _driven(t_s: Array, thrust: Array, coast: Coast) -> Array:
    """Return times and thrust (k, 2) from before the stop of a coast to its end."""
    rows = (t_s >= coast.stop_s - BEFORE_S) & (t_s <= coast.end_s)
    return np.column_stack([t_s[rows], thrust[rows]])


def force_columns_of(place: int) -> tuple[str, ...]:
    """Return the columns of the residual force that a powered leg on an axis takes."""
    return tuple(force_columns(name)[place] for name in ("tau_bar", *ACTUATORS))


def drift_shares(
    fused: pa.Table,
    segment: SegmentRecord,
    fusion: FusionRecord,
    place: int,
    logs: Sequence[str],
) -> Array:
    """Return what of each log's current, north and east, lies along an axis (n, q).

    q = 0 on axes that have none; 0 throughout for velocities through the water.
    """
    samples = clock(fused).size
    if place >= OVER_GROUND:
        return np.zeros((samples, 0))
    shares = np.zeros((samples, 2 * len(logs)))
    if fusion.current is None or fusion.current.ned_m_s is None:
        first = 2 * list(logs).index(str(segment.log))
        rotation = rotation_body_to_ned(matrix(fused, ATTITUDE))
        shares[:, first : first + 2] = rotation[:, :2, place]
    return shares


def powered_leg(
    fused: pa.Table, residual: pa.Table, vehicle: Vehicle, place: int, drift: Array
) -> PoweredLeg:
    """Return the whole of a segment as a powered leg on the axis of a place.

    drift (n, q): that of `drift_shares`.
    """
    total, *actuators = force_columns_of(place)
    driving = [column(residual, name) for name in actuators if has_columns(residual, (name,))]
    acting = np.asarray(np.sum(driving, axis=0))
    speed = column(fused, VELOCITY[place])
    shapes = _down(fused, vehicle)[:, [place]] if place < 3 else np.zeros((speed.size, 0))
    step_s = float(np.mean(np.diff(clock(fused))))
    return PoweredLeg(column(residual, total) + acting, acting, speed, shapes, step_s, drift)


def _down(fused: pa.Table, vehicle: Vehicle) -> Array:
    """Return the vertical (n, 3) in body axes times the weight.

    Along it acts net buoyancy that the vehicle file does not have.
    """
    return np.asarray(rotation_body_to_ned(matrix(fused, ATTITUDE))[:, 2, :] * vehicle.weight)


def _drive(tables: SegmentTables, vehicle: Vehicle) -> tuple[Array, Mask]:
    """Return thrust (n, 6) [N, N m] as commanded and which axes are idle (n, 6)."""
    vehicle, _ = with_logged_directions(vehicle, tables.log.parameters)
    table, t_s = tables.resampled, clock(tables.fused)
    rows = np.searchsorted(clock(table), t_s - 1e-9)
    thrust, idle = np.zeros((t_s.size, 6)), np.ones((t_s.size, 6), dtype=np.bool_)
    if vehicle.thrusters is not None:
        pulses = matrix(table, tuple(f"pwm_{k}_us" for k in vehicle.thrusters.outputs))[rows]
        along = thruster_forces(vehicle.thrusters, pulses)
        thrust += along @ vehicle.thrusters.allocation.T
        largest = float(np.abs(vehicle.thrusters.curve.force_N).max())
        idle &= idle_by_thrusters(along, vehicle.thrusters.allocation, largest_N=largest)
    if vehicle.propeller is not None:
        turning = np.abs(column(table, "propeller_rev_s")[rows]) > STILL_REV_S
        thrust += forces(tables.residual, "propeller")
        idle[:, 0] &= ~turning
    return thrust, idle


def _samples(tables: SegmentTables, place: VelocityLogPlacement, name: str) -> tuple[Array, Array]:
    """Return times (n,) and values (n,) of a velocity at the log's own samples.

    Those of the fused state where the log lacks the sensor, or where the state is
    relative to a current that the sensor does not see.
    """
    t_s = clock(tables.fused)
    gyro_bias = tables.fusion.gyro_bias_rad_s or [0.0, 0.0, 0.0]
    if name == "r" and tables.imu is not None:
        return clock(tables.imu), column(tables.imu, GYRO[2]) - gyro_bias[2]
    if name != "r" and tables.velocity is not None and tables.fusion.current is None:
        at = clock(tables.velocity)
        omega = np.column_stack(
            [np.interp(at, t_s, column(tables.fused, rate)) for rate in VELOCITY[3:]]
        )
        sensed = matrix(tables.velocity, VELOCITY[:3])
        return at - place.lag_s, place.at_origin(sensed, omega)[:, DEGREES[name]]
    rows = slice(None, None, 5)
    return t_s[rows], column(tables.fused, VELOCITY[DEGREES[name]])[rows]
