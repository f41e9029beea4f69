"""Streams of telemetry logs: the vehicle's clock, pressure to depth, cells, modes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from auvid.hydro.arrays import Array, Ints
from auvid.hydro.constants import STANDARD_PRESSURE_PA
from auvid.hydro.identification.signals.pose.fixes import metres_from_degrees
from auvid.hydro.identification.signals.pose.frames import Body, World
from auvid.stages.columns import UNIX_TIME_US
from auvid.stages.ingest.decoded_log import DecodedLog, Messages
from auvid.stages.ingest.streams.common import (
    NO_SENSOR,
    PWM_OUTPUTS,
    Columns,
    depth_m,
    displacement_velocity,
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
from auvid.stages.ingest.streams.flight_modes import SUB_MODES, SUBMARINE
from auvid.stages.ingest.streams.mapping import Rules, rate_hz

WRAP_US = 1 << 32  # ArduPilot's servo time stamp has 32 bits: it starts again after 71.6 minutes
RESTART_US = -2_000_000
BLOCKS = 40
DRIFT_SPAN_US = 60_000_000
SLOWEST_HZ = 10.0
UNUSED_CELL = 65535
ARMED_BIT = 128
VELOCITY_HORIZONTAL, CONSTANT_POSITION = 2, 128  # EKF_STATUS_FLAGS
SMALLEST_CHANGE_M = 0.02
FIX_2D = 2  # GPS_FIX_TYPE
WORLD_OF_FRAME: Mapping[int, World] = {4: "enu", 15: "enu", 17: "enu", 19: "enu", 21: "nwu"}
"""MAV_FRAME -> world, where it is not north-east-down: LOCAL_ENU, those of motion capture,
vision and estimate before 2019, LOCAL_FLU.
"""
BODY_FLU = 13
TWIN_ARRAY_ID = 2759
TWIN_ARRAY = ("propeller_rev_s", "fin_s_rad", "fin_p_rad", "fin_b_rad", "fin_t_rad")
TIMEKEEPERS = (
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "GLOBAL_POSITION_INT",
    "SYSTEM_TIME",
    "SCALED_IMU2",
)


def own_time_us(messages: Messages) -> Ints | None:
    """Return the sender's own time stamps in us: time_boot_ms or time_usec.

    None where there is none or it stands still.
    """
    for name, factor in (("time_boot_ms", 1000), ("time_usec", 1)):
        if name in messages.columns:
            own = messages.ints(name) * factor
            if own.size and own.max() > own.min():
                return own
    return None


def boot_offset(log: DecodedLog) -> Array | None:
    """Return the recorder's clock minus the autopilot's boot clock in us.

    It is a straight line (slope, intercept) over the recorder's clock. Robust: medians
    over blocks of the messages with boot time, of the longest session if the vehicle
    was restarted. The usual delay of the link is in it. None if no message of the
    autopilot has boot time: the recorder's clock is then all there is.
    """
    messages = _timekeeper(log)
    if messages is None:
        return None
    stamp, boot = stamps(messages), messages.ints("time_boot_ms") * 1000
    session = _longest_session(boot)
    stamp, delay = stamp[session], (stamp[session] - boot[session]).astype(np.float64)
    if stamp[-1] - stamp[0] < DRIFT_SPAN_US:
        return np.array([0.0, float(np.median(delay))])
    centre = stamp[0]
    blocks = [part for part in np.array_split(np.arange(stamp.size), BLOCKS) if part.size]
    at = np.array([np.median(stamp[part] - centre) for part in blocks])
    level = np.array([np.median(delay[part]) for part in blocks])
    slope, intercept = np.polyfit(at, level, 1)
    return np.array([slope, intercept - slope * centre])


def _timekeeper(log: DecodedLog) -> Messages | None:
    messages = (log.get(name) for name in TIMEKEEPERS)
    return next((item for item in messages if item is not None and _of_autopilot(item, log)), None)


def _longest_session(boot: Ints) -> slice:
    starts = np.concatenate([[0], np.flatnonzero(np.diff(boot) < RESTART_US) + 1, [boot.size]])
    longest = int(np.argmax(np.diff(starts)))
    return slice(int(starts[longest]), int(starts[longest + 1]))


def _of_autopilot(messages: Messages, log: DecodedLog) -> bool:
    beats = log.get("HEARTBEAT")
    if beats is None or "compid" not in messages.columns:
        return True
    return bool(messages.columns["compid"][0] == beats.columns["compid"][0])


def stamps(messages: Messages) -> Ints:
    """Return the recorder's time stamps (Unix, us)."""
    return messages.ints("time_unix_us")


def to_boot(unix_us: Ints, log: DecodedLog) -> Ints:
    """Return the recorder's time stamps on the autopilot's boot clock."""
    line = boot_offset(log)
    if line is None:
        return unix_us
    offset: Ints = np.rint(line[0] * unix_us + line[1]).astype(np.int64)
    return unix_us - offset


def clock(messages: Messages, log: DecodedLog) -> Ints | None:
    """Return boot time of the autopilot in us.

    Its own stamp where the message has one; of another component the own stamp set onto
    the recorder's clock by the median delay; else the recorder's stamp. The latter two
    carry the delay of the link.
    """
    arrived = to_boot(stamps(messages), log)
    own = own_time_us(messages)
    if own is None:
        return arrived
    if own.max() >= UNIX_TIME_US or not _of_autopilot(messages, log):
        return own + int(np.median(arrived - own))
    if "time_usec" in messages.columns and messages.columns["time_usec"].dtype == np.uint32:
        own = own + np.rint((arrived - own) / WRAP_US).astype(np.int64) * WRAP_US
    return own


def fast(messages: Messages, log: DecodedLog) -> str | None:
    """Refuse an inertial message that is sent too slowly to show the motion."""
    time_us = clock(messages, log)
    rate = 0.0 if time_us is None else rate_hz(time_us)
    return None if rate >= SLOWEST_HZ else f"sent at {rate:.1f} Hz only"


def varies(messages: Messages, log: DecodedLog) -> str | None:
    """Refuse an altitude that stands still, as VFR_HUD.alt of some firmware does."""
    hud = {"alt", "groundspeed"} <= set(messages.columns)
    name, factor = ("alt", 1.0) if hud else ("relative_alt", 1e-3)
    change = float(np.ptp(messages.floats(name))) * factor
    return None if change > SMALLEST_CHANGE_M else "stands still over the whole log"


def aided(messages: Messages, log: DecodedLog) -> str | None:
    """Return why the navigation filter's velocity and position mean nothing, or None.

    None if the filter had a velocity or position sensor.
    """
    report = log.get("EKF_STATUS_REPORT")
    if report is None:
        unaided = "nothing shows that the navigation filter had a velocity or position sensor"
        return None if log.counts.get("VISION_POSITION_DELTA") else unaided
    flags = report.ints("flags")
    if mostly((flags & VELOCITY_HORIZONTAL != 0) & (flags & CONSTANT_POSITION == 0)):
        return None
    if not flags.any():
        return "the navigation filter was not running (EKF_STATUS_REPORT has no flag set)"
    return f"{NO_SENSOR} (constant-position mode in EKF_STATUS_REPORT)"


def displacement_over_interval(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return body velocity in m/s from VISION_POSITION_DELTA."""
    delta = np.asarray(messages.columns["position_delta"], dtype=np.float64)
    rated = "confidence" in messages.columns
    return displacement_velocity(
        delta.T,
        messages.floats("time_delta_usec") / 1e6,
        messages.floats("confidence") if rated else None,
    )


def navigation_velocity(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return LOCAL_POSITION_NED velocity in body axes, by ATTITUDE."""
    attitude = log.get("ATTITUDE")
    at = None if attitude is None else clock(attitude, log)
    angles = [] if attitude is None else [attitude.floats(n) for n in ("roll", "pitch", "yaw")]
    return to_body_at(time_us, vector(messages, ("vx", "vy", "vz")), at, angles)


def quaternion(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return ZYX Euler angles of ATTITUDE_QUATERNION (w, x, y, z; NED to FRD)."""
    return euler_angles(vector(messages, (f"q{number}" for number in range(1, 5))))


def pose_of_quaternion(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return the pose of ATT_POS_MOCAP (w, x, y, z; NED to FRD)."""
    q = np.asarray(messages.columns["q"], dtype=np.float64)
    return pose_in_ned(vector(messages, "xyz").T, q, "ned", "frd")


def odometry_pose(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return the pose of ODOMETRY in its frames; NaN in a frame that moves along."""
    frame, child = messages.ints("frame_id"), messages.ints("child_frame_id")
    q = np.asarray(messages.columns["q"], dtype=np.float64)
    position = vector(messages, "xyz").T
    world: World = WORLD_OF_FRAME.get(int(np.median(frame)), "ned")
    body: Body = "flu" if int(np.median(child)) == BODY_FLU else "frd"
    position = np.where((frame == np.median(frame))[:, None], position, np.nan)
    return pose_in_ned(position, q, world, body)


def globe_fixes(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return fixes of GPS_INPUT in metres from the first; NaN without a fix."""
    degrees = np.column_stack([messages.floats("lat"), messages.floats("lon")]) * 1e-7
    if "fix_type" in messages.columns:
        degrees[messages.floats("fix_type") < FIX_2D] = np.nan
    north, east = metres_from_degrees(*np.radians(degrees).T).T
    return {"north_m": north, "east_m": east}


def pressure_depth(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return depth below the surface in m from the second barometer.

    The surface pressure is the one that the vehicle calibrated (BARO2_GND_PRESS), else
    1013.25 hPa; specific gravity is BARO_SPEC_GRAV, else 1.
    """

    def parameter(names: tuple[str, ...], default: float) -> float:
        values = (log.parameters.get(name, 0.0) for name in names)
        return next((value for value in values if value > 0.0), default)

    surface = parameter(("BARO2_GND_PRESS", "GND_ABS_PRESS2"), STANDARD_PRESSURE_PA)
    specific = parameter(("BARO_SPEC_GRAV", "GND_SPEC_GRAV"), 1.0)
    return {"depth_m": depth_m(messages.floats("press_abs") * 100.0, surface, specific)}


def manual_sticks(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return the sticks of MANUAL_CONTROL; z is upward from 0 to 1000, 500 at rest."""
    return {
        "stick_surge": messages.floats("x") / 1000.0,
        "stick_sway": messages.floats("y") / 1000.0,
        "stick_heave": (500.0 - messages.floats("z")) / 500.0,
        "stick_yaw": messages.floats("r") / 1000.0,
    }


def servo_outputs(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return pulse widths of outputs 1 to 16 of the main port.

    Outputs without any pulse are left out.
    """
    columns = pulse_widths(messages, {n: f"servo{n}_raw" for n in PWM_OUTPUTS})
    if "port" in messages.columns:
        main = messages.floats("port") == 0
        columns = {field: np.where(main, values, np.nan) for field, values in columns.items()}
    return live(columns)


def propeller_and_fins(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return propeller speed and fins from the float array of the twin.

    They are its first five numbers; NaN for other arrays.
    """
    ours = np.asarray(messages.columns["array_id"]) == TWIN_ARRAY_ID
    data = np.asarray(messages.columns["data"], dtype=np.float64)[:, : len(TWIN_ARRAY)]
    return dict(zip(TWIN_ARRAY, np.where(ours, data.T, np.nan), strict=True))


def battery_cells(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return current, and voltage as the sum of the cells that are reported.

    ArduPilot puts the whole pack into the first.
    """
    cells = messages.ints("voltages")
    used = cells != UNUSED_CELL
    volts = np.where(used.any(axis=1), np.sum(np.where(used, cells, 0), axis=1) / 1000.0, np.nan)
    return {"voltage_v": volts, "current_a": messages.floats("current_battery") / 100.0}


def battery_total(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return voltage and current of SYS_STATUS; 65535 mV stands for unknown."""
    millivolts = messages.floats("voltage_battery")
    return {
        "voltage_v": np.where(millivolts == UNUSED_CELL, np.nan, millivolts / 1000.0),
        "current_a": messages.floats("current_battery") / 100.0,
    }


def modes(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return changes of mode and of arming from the heartbeats of the autopilot."""
    armed = (messages.ints("base_mode") & ARMED_BIT) != 0
    kind = messages.ints("type")[0] if "type" in messages.columns else 0
    names = SUB_MODES if kind == SUBMARINE else {}
    return mode_changes(time_us, messages.ints("custom_mode"), armed, names)


def texts(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return status texts with the chunks of long ones joined, in order of arrival."""
    when = to_boot(np.array([at for at, _ in log.texts], np.int64), log)
    return text_rows(when, [text for _, text in log.texts])


def utc_offset_us(log: DecodedLog) -> int | None:
    """Return UTC minus boot clock in us.

    By the vehicle's own SYSTEM_TIME if it knew the time, else by the recorder's clock.
    """
    own = log.get("SYSTEM_TIME")
    if own is not None:
        unix = own.ints("time_unix_usec")
        dated = unix > UNIX_TIME_US
        if dated.any():
            return int(np.median((unix - own.ints("time_boot_ms") * 1000)[dated]))
    line, keeper = boot_offset(log), _timekeeper(log)
    if line is None or keeper is None:
        return 0
    return int(np.rint(line[0] * float(stamps(keeper)[0]) + line[1]))


RULES = Rules(
    mapping="tlog",
    clock=clock,
    utc=utc_offset_us,
    compute={
        "displacement_over_interval": displacement_over_interval,
        "navigation_velocity": navigation_velocity,
        "quaternion": quaternion,
        "pose_of_quaternion": pose_of_quaternion,
        "globe_fixes": globe_fixes,
        "odometry_pose": odometry_pose,
        "pressure_depth": pressure_depth,
        "manual_sticks": manual_sticks,
        "servo_outputs": servo_outputs,
        "propeller_and_fins": propeller_and_fins,
        "battery_cells": battery_cells,
        "battery_total": battery_total,
        "modes": modes,
        "texts": texts,
    },
    conditions={"aided": aided, "fast": fast, "varies": varies},
    scores={"downward": downward_score("orientation")},
    also=frozenset({"EKF_STATUS_REPORT", "SYSTEM_TIME", "PARAM_VALUE"}),
)
