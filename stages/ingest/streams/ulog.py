"""What the mapping of PX4 logs needs besides renaming: quaternions, odometry in its
frame, pressure to depth, modes.
"""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array, Ints
from auvid.hydro.constants import FRESH_WATER_KG_M3, STANDARD_GRAVITY, STANDARD_PRESSURE_PA
from auvid.stages.columns import UNIX_TIME_US
from auvid.stages.ingest.decoded_log import DecodedLog, Messages
from auvid.stages.ingest.streams.dataflash import (
    PWM_OUTPUTS,
    apart,
    downward_score,
    floats,
    merge_modes,
    to_body,
)
from auvid.stages.ingest.streams.flight_modes import px4_mode
from auvid.stages.ingest.streams.mapping import Columns, Rules
from auvid.stages.ingest.streams.tlog import euler_from_quaternion

NED, BODY_FRD = 1, 3  # vehicle_odometry.velocity_frame
ARMED = 2  # vehicle_status.arming_state
HIGHEST_HPA = 20_000.0  # pressures below this are hectopascal: PX4 changed to pascal in 2022
RANGE_STEP_PA = 2000.0
VELOCITY = ("u_m_s", "v_m_s", "w_m_s")


def clock(messages: Messages, log: DecodedLog) -> Ints | None:
    """Boot time in us: when the sample was taken (timestamp_sample) where the topic
    says so, else when it was published.
    """
    for name in ("timestamp_sample", "timestamp"):
        if name in messages.columns:
            stamps = np.asarray(messages.columns[name]).astype(np.int64)
            if stamps.size and (stamps > 0).all():
                return stamps
    return None


def quaternion(messages: Messages, log: DecodedLog) -> Columns:
    """ZYX Euler angles of vehicle_attitude (w, x, y, z; body FRD to NED)."""
    return euler_from_quaternion(
        np.stack([floats(messages, f"q[{number}]") for number in range(4)], axis=1)
    )


def attitude_at(time_us: Ints, log: DecodedLog) -> list[Array] | None:
    """Roll, pitch, yaw at the given times, linear between samples (vehicle_attitude is
    fast); NaN outside. None without attitude.
    """
    attitude = log.messages.get("vehicle_attitude")
    at = None if attitude is None else clock(attitude, log)
    if attitude is None or at is None:
        return None
    angles = quaternion(attitude, log).values()
    return [
        np.interp(time_us, at, np.unwrap(values), left=np.nan, right=np.nan) for values in angles
    ]


def _turned(ned: Array, messages: Messages, log: DecodedLog) -> Array:
    time_us = clock(messages, log)
    angles = None if time_us is None else attitude_at(time_us, log)
    return np.full_like(ned, np.nan) if angles is None else to_body(ned, *angles)


def odometry_velocity(messages: Messages, log: DecodedLog) -> Columns:
    """Velocity of an external sensor in body axes; in another frame than body or
    north-east-down it is NaN.
    """
    names = (
        ["velocity[0]", "velocity[1]", "velocity[2]"]
        if "velocity[0]" in messages.columns
        else ["vx", "vy", "vz"]
    )
    given = np.stack([floats(messages, name) for name in names])
    frame = (
        floats(messages, "velocity_frame")
        if "velocity_frame" in messages.columns
        else np.full(len(messages), NED)
    )
    body = np.where(frame == BODY_FRD, given, np.nan)
    if (frame == NED).any():
        body = np.where(frame == NED, _turned(given, messages, log), body)
    return dict(zip(VELOCITY, body, strict=True))


def navigation_velocity(messages: Messages, log: DecodedLog) -> Columns:
    """vehicle_local_position velocity turned into body axes with vehicle_attitude."""
    ned = np.stack([floats(messages, name) for name in ("vx", "vy", "vz")])
    return dict(zip(VELOCITY, _turned(ned, messages, log), strict=True))


def aided(messages: Messages, log: DecodedLog) -> str | None:
    """Why velocity and position of the navigation filter mean nothing, or None if it
    called them valid most of the time.
    """
    flags = [
        floats(messages, name) for name in ("v_xy_valid", "xy_valid") if name in messages.columns
    ]
    if flags and all(float(np.mean(flag)) > 0.5 for flag in flags):
        return None
    return (
        "the navigation filter did not call its velocity and position valid (v_xy_valid, xy_valid)"
    )


def pressure_pa(messages: Messages) -> Array:
    values = floats(
        messages, "baro_pressure_pa" if "baro_pressure_pa" in messages.columns else "pressure"
    )
    return values * 100.0 if values.size and np.nanmedian(values) < HIGHEST_HPA else values


def pressure_depth(messages: Messages, log: DecodedLog) -> Columns:
    """Depth in m: (p - 1013.25 hPa) / (1000 kg/m3 g)."""
    return {
        "depth_m": (pressure_pa(messages) - STANDARD_PRESSURE_PA)
        / (FRESH_WATER_KG_M3 * STANDARD_GRAVITY)
    }


def submerged(messages: Messages, log: DecodedLog) -> float:
    """Minus the range of pressure in steps of 20 cm of water: the barometer in the
    water sees more than the one in the housing.
    """
    return -float(np.ptp(pressure_pa(messages)) // RANGE_STEP_PA)


def servo_outputs(messages: Messages, log: DecodedLog) -> Columns:
    """Pulse widths of outputs 1 to 16; outputs without any pulse are left out."""
    names = {f"output[{number - 1}]": f"pwm_{number}_us" for number in range(1, PWM_OUTPUTS + 1)}
    columns: Columns = {
        field: floats(messages, name) for name, field in names.items() if name in messages.columns
    }
    return {field: values for field, values in columns.items() if bool(np.any(values > 0.0))}


def modes(messages: Messages, log: DecodedLog) -> Columns:
    """Changes of mode and of arming."""
    time_us = clock(messages, log)
    assert time_us is not None
    state = np.asarray(messages.columns["nav_state"]).astype(np.int64)
    armed = np.asarray(messages.columns["arming_state"]).astype(np.int64) == ARMED
    change = np.append(True, (np.diff(state) != 0) | (np.diff(armed.astype(np.int8)) != 0))
    return merge_modes(
        time_us[change],
        [px4_mode(int(item)) for item in state[change]],
        time_us[change],
        armed[change],
    )


def texts(messages: Messages, log: DecodedLog) -> Columns:
    """Text messages in the order of the log."""
    return apart(
        np.array([stamp for stamp, _ in log.texts], np.int64), [text for _, text in log.texts]
    )


def utc_offset_us(log: DecodedLog) -> int | None:
    """UTC minus boot clock in us from the receiver's own time (median); None where the
    log has none.
    """
    for name in ("vehicle_gps_position", "sensor_gps"):
        fix = log.messages.get(name)
        if fix is not None and "time_utc_usec" in fix.columns:
            unix = np.asarray(fix.columns["time_utc_usec"]).astype(np.int64)
            known = unix > UNIX_TIME_US
            if known.any():
                return int(
                    np.median((unix - np.asarray(fix.columns["timestamp"]).astype(np.int64))[known])
                )
    return None


RULES = Rules(
    clock=clock,
    utc=utc_offset_us,
    compute={
        "quaternion": quaternion,
        "odometry_velocity": odometry_velocity,
        "navigation_velocity": navigation_velocity,
        "pressure_depth": pressure_depth,
        "servo_outputs": servo_outputs,
        "modes": modes,
        "texts": texts,
    },
    conditions={"aided": aided},
    scores={"submerged": submerged, "downward": downward_score("orientation")},
    also=frozenset({"vehicle_gps_position", "sensor_gps"}),
)
