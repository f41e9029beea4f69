"""Legs as maximum likelihood takes them: samples at their own times, and actuators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.streams import supply_text
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array, Mask
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.logged_directions import with_logged_directions
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor, Vehicle
from auvid.hydro.identification.maximum_likelihood.records import (
    ActuatorRecord,
    LegRecord,
    SensorGeometry,
    SensorRecord,
)
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, FINS, GYRO, VELOCITY, clock
from auvid.stages.sensor_motion import VelocityLogPlacement

ALWAYS = ("attitude", "gyro", "velocity")
"""Sensors without which nothing is fitted; a leg may do without the others."""
Tables = Mapping[str, pa.Table]
NEEDED = {"imu": "angular rates", "velocity": "a body velocity"}
"""Stream without which a leg takes no part, and what it gives."""


@dataclass(frozen=True)
class SegmentSamples:
    """What earlier stages hand on of one segment; None for a sensor it lacks."""

    segment: SegmentRecord
    fusion: FusionRecord
    log: LogInfo
    resampled: pa.Table
    attitude: pa.Table
    imu: pa.Table | None
    velocity: pa.Table | None
    depth: pa.Table | None


def leg_record(
    samples: SegmentSamples, vehicle: Vehicle, place: VelocityLogPlacement
) -> LegRecord | str:
    """Return a segment without its margins, or the reason why it takes no part.

    Actuators keep the margin before the leg, in which a lag settles.
    """
    tables = {"imu": samples.imu, "velocity": samples.velocity}
    for stream, need in NEEDED.items():
        if tables[stream] is None:
            return (
                f"'{samples.segment.id}' lacks {need}: the stream '{stream}' is missing; it can"
                f" come from: {supply_text(stream)}"
            )
    actuators = actuator_record(samples, vehicle)
    if isinstance(actuators, str):
        return f"'{samples.segment.id}' {actuators}"
    end = samples.segment.duration_s
    assert samples.imu is not None
    assert samples.velocity is not None
    sensors = {
        "attitude": _record(samples.attitude, ATTITUDE, end),
        "gyro": _record(samples.imu, GYRO, end),
        "velocity": _record(samples.velocity, VELOCITY[:3], end, lag_s=place.lag_s),
    }
    if samples.fusion.current is not None and samples.fusion.current.ned_m_s is not None:
        sensors["velocity"] = through_water(
            sensors["velocity"], sensors["attitude"], place.turn, samples.fusion.current.ned_m_s
        )
    convention = samples.fusion.accelerometer or samples.log.accelerometer or vehicle.accelerometer
    accelerometer = has_columns(samples.imu, ACCELEROMETER) and bool(
        np.isfinite(matrix(samples.imu, ACCELEROMETER)).any()
    )
    if accelerometer and convention != "derivative":
        sensors["accel"] = _record(samples.imu, ACCELEROMETER, end)
    if samples.depth is not None:
        sensors["depth"] = _record(samples.depth, ("z_m",), end)
    silent = [name for name, record in sensors.items() if not len(record.t_s)]
    needed = [name for name in silent if name in ALWAYS]
    if needed:
        return f"'{samples.segment.id}' has no sample of {' and '.join(needed)} on the leg"
    for name in silent:
        del sensors[name]
    geometry = SensorGeometry(
        imu=_placed(vehicle.imu.arm_m),
        velocity=MountedSensor(place.arm_m, place.turn, 0.0),
        depth=vehicle.depth_sensor,
        # A specific force has gravity inside, an inertial acceleration has not.
        gravity=vehicle.gravity if convention == "specific_force" else 0.0,
    )
    return LegRecord(samples.segment.id, sensors, actuators, geometry)


def through_water(
    velocity: SensorRecord, attitude: SensorRecord, turn: Array, ned_m_s: Sequence[float]
) -> SensorRecord:
    """Return velocities over ground less a steady current: those that the forces see.

    turn (3, 3): axes of the velocity log to body axes. In water that moves steadily the
    motion through it obeys the same equations, specific force included.
    """
    angles = np.unwrap(attitude.values, axis=0)
    euler = np.array([np.interp(velocity.t_s, attitude.t_s, column) for column in angles.T]).T
    drift = np.einsum("nji,j->ni", rotation_body_to_ned(euler), np.asarray(ned_m_s))
    return replace(velocity, values=velocity.values - drift @ turn)


def actuator_record(samples: SegmentSamples, vehicle: Vehicle) -> ActuatorRecord | str:
    """Return what the actuators do, on the uniform clock, or what is missing."""
    vehicle, _ = with_logged_directions(vehicle, samples.log.parameters)
    table = samples.resampled
    pulses = tuple(
        f"pwm_{number}_us"
        for number in (vehicle.thrusters.outputs if vehicle.thrusters is not None else ())
    )
    names = (
        *pulses,
        *(("propeller_rev_s",) if vehicle.propeller is not None else ()),
        *(FINS if vehicle.fins is not None else ()),
    )
    if not names:
        return "belongs to a vehicle without actuators"
    if not has_columns(table, names):
        return f"lacks the stream 'actuators'; it can come from: {supply_text('actuators')}"
    finite: Mask = np.all(np.isfinite(matrix(table, names)), axis=1)
    t_s = clock(table)
    if not finite[(t_s >= 0.0) & (t_s <= samples.segment.duration_s)].all():
        return "is not covered by the stream 'actuators'"
    table, t_s = table.filter(pa.array(finite)), t_s[finite]
    force = None
    if vehicle.thrusters is not None:
        thrust = thruster_forces(vehicle.thrusters, matrix(table, pulses), _voltage(table))
        force = thrust @ vehicle.thrusters.allocation.T
    return ActuatorRecord(
        t_s,
        column(table, "propeller_rev_s") if vehicle.propeller is not None else None,
        matrix(table, FINS) if vehicle.fins is not None else None,
        force,
    )


def _placed(arm: Array) -> MountedSensor:
    """Return a sensor whose samples are turned to body axes and free of lag already."""
    return MountedSensor(arm, np.eye(3), 0.0)


def _voltage(table: pa.Table) -> Array | None:
    """Return the battery voltage (n,), nearest where not measured; None for none."""
    if not has_columns(table, ("voltage_v",)):
        return None
    voltage = column(table, "voltage_v")
    measured = np.isfinite(voltage)
    t_s = clock(table)
    return np.interp(t_s, t_s[measured], voltage[measured]) if measured.any() else None


def _record(
    table: pa.Table, names: tuple[str, ...], end_s: float, *, lag_s: float = 0.0
) -> SensorRecord:
    t_s = clock(table) - lag_s
    inside = (t_s >= 0.0) & (t_s <= end_s)
    return SensorRecord(t_s[inside], matrix(table, names)[inside])
