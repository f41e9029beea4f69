"""Streams of PX4 logs: quaternions, odometry in its frame, pressure to depth, modes."""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array, Ints
from auvid.stages.columns import LINEAR_VELOCITY, UNIX_TIME_US
from auvid.stages.ingest.decoded_log import DecodedLog, Messages
from auvid.stages.ingest.streams.common import (
    PWM_OUTPUTS,
    Columns,
    depth_m,
    downward_score,
    euler_angles,
    live,
    mode_changes,
    mostly,
    pose_in_ned,
    pulse_widths,
    text_rows,
    to_body_at,
    vector,
)
from auvid.stages.ingest.streams.flight_modes import PX4_MODES
from auvid.stages.ingest.streams.mapping import Rules

NED, BODY_FRD = 1, 3  # vehicle_odometry.velocity_frame
ARMED = 2  # vehicle_status.arming_state
HIGHEST_HPA = 20_000.0  # pressures below this are hectopascal: PX4 changed to pascal in 2022
RANGE_STEP_PA = 2000.0


def clock(messages: Messages, log: DecodedLog) -> Ints | None:
    """Return boot time in us: of the sample (timestamp_sample), else of publication."""
    for name in ("timestamp_sample", "timestamp"):
        if name in messages.columns:
            stamps = messages.ints(name)
            if stamps.size and (stamps > 0).all():
                return stamps
    return None


def quaternion(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return ZYX Euler angles of vehicle_attitude (w, x, y, z; body FRD to NED)."""
    return euler_angles(vector(messages, (f"q[{number}]" for number in range(4))))


def _to_body(ned: Array, time_us: Ints, log: DecodedLog) -> Columns:
    attitude = log.messages.get("vehicle_attitude")
    at = None if attitude is None else clock(attitude, log)
    angles = [] if attitude is None else list(quaternion(attitude, time_us, log).values())
    return to_body_at(time_us, ned, at, angles)


def odometry_velocity(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return the velocity of an external sensor in body axes.

    NaN in another frame than body or north-east-down.
    """
    new = "velocity[0]" in messages.columns
    names = [f"velocity[{axis}]" for axis in range(3)] if new else ["vx", "vy", "vz"]
    velocity = vector(messages, names)
    has_frame = "velocity_frame" in messages.columns
    frame = messages.floats("velocity_frame") if has_frame else np.full(len(messages), NED)
    turned = _to_body(velocity, time_us, log)
    return {
        name: np.where(frame == BODY_FRD, own, np.where(frame == NED, turned[name], np.nan))
        for name, own in zip(LINEAR_VELOCITY, velocity, strict=True)
    }


def odometry_pose(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return the pose of an external system; PX4's frames have z down, body FRD."""
    new = "position[0]" in messages.columns
    names = [f"position[{axis}]" for axis in range(3)] if new else ["x", "y", "z"]
    q = vector(messages, (f"q[{number}]" for number in range(4))).T
    return pose_in_ned(vector(messages, names).T, q, "ned", "frd")


def placed(messages: Messages, log: DecodedLog) -> str | None:
    """Return why odometry is no pose: what no sensor gives is left empty."""
    names = [f"position[{axis}]" for axis in range(3)]
    places = vector(messages, names if names[0] in messages.columns else list("xyz"))
    return None if np.isfinite(places).all(axis=0).any() else "it gives no position"


def navigation_velocity(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return vehicle_local_position velocity in body axes, by vehicle_attitude."""
    return _to_body(vector(messages, ("vx", "vy", "vz")), time_us, log)


def aided(messages: Messages, log: DecodedLog) -> str | None:
    """Return why the navigation filter's velocity and position mean nothing, or None.

    None if the filter called them valid most of the time.
    """
    names = [name for name in ("v_xy_valid", "xy_valid") if name in messages.columns]
    if names and all(mostly(messages.floats(name)) for name in names):
        return None
    return (
        "the navigation filter did not call its velocity and position valid (v_xy_valid, xy_valid)"
    )


def pressure_pa(messages: Messages) -> Array:
    """Return pressure in Pa, whether the firmware logs Pa or hPa."""
    new = "baro_pressure_pa" in messages.columns
    values = messages.floats("baro_pressure_pa" if new else "pressure")
    return values * 100.0 if values.size and np.nanmedian(values) < HIGHEST_HPA else values


def pressure_depth(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return depth in m below standard pressure."""
    return {"depth_m": depth_m(pressure_pa(messages))}


def submerged(messages: Messages, log: DecodedLog) -> float:
    """Return minus the range of pressure in steps of 20 cm of water.

    The barometer in the water sees more than the one in the housing.
    """
    return -float(np.ptp(pressure_pa(messages)) // RANGE_STEP_PA)


def servo_outputs(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return pulse widths of outputs 1 to 16, without those that have no pulse."""
    return live(pulse_widths(messages, {n: f"output[{n - 1}]" for n in PWM_OUTPUTS}))


def modes(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return changes of mode and of arming."""
    armed = messages.ints("arming_state") == ARMED
    return mode_changes(time_us, messages.ints("nav_state"), armed, PX4_MODES)


def texts(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return text messages in the order of the log."""
    return text_rows(np.array([at for at, _ in log.texts], np.int64), [t for _, t in log.texts])


def utc_offset_us(log: DecodedLog) -> int | None:
    """Return UTC minus boot clock in us from the receiver's own time (median).

    None where the log has none.
    """
    for name in ("vehicle_gps_position", "sensor_gps"):
        fix = log.get(name, "time_utc_usec")
        if fix is not None:
            unix = fix.ints("time_utc_usec")
            dated = unix > UNIX_TIME_US
            if dated.any():
                return int(np.median((unix - fix.ints("timestamp"))[dated]))
    return None


RULES = Rules(
    mapping="ulog",
    clock=clock,
    utc=utc_offset_us,
    compute={
        "quaternion": quaternion,
        "odometry_velocity": odometry_velocity,
        "odometry_pose": odometry_pose,
        "navigation_velocity": navigation_velocity,
        "pressure_depth": pressure_depth,
        "servo_outputs": servo_outputs,
        "modes": modes,
        "texts": texts,
    },
    conditions={"aided": aided, "placed": placed},
    scores={"submerged": submerged, "downward": downward_score("orientation")},
    also=frozenset({"vehicle_gps_position", "sensor_gps"}),
)
