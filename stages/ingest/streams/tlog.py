"""What the mapping of telemetry logs needs besides renaming: the vehicle's clock,
pressure to depth, cells of the battery, modes.
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
from auvid.stages.ingest.streams.flight_modes import mode_name
from auvid.stages.ingest.streams.mapping import Columns, Rules, rate_hz

WRAP_US = 1 << 32  # ArduPilot's servo time stamp has 32 bits: it starts again after 71.6 minutes
RESTART_US = -2_000_000
BLOCKS = 40
DRIFT_SPAN_US = 60_000_000
SLOWEST_HZ = 10.0
UNUSED_CELL = 65535
ARMED_BIT = 128
VELOCITY_HORIZONTAL, CONSTANT_POSITION = 2, 128  # EKF_STATUS_FLAGS
SMALLEST_CHANGE_M = 0.02
TWIN_ARRAY_ID = 2759
TWIN_ARRAY = ("propeller_rev_s", "fin_s_rad", "fin_p_rad", "fin_b_rad", "fin_t_rad")


def own_time_us(messages: Messages) -> Ints | None:
    """The sender's own time stamps in us: time_boot_ms or time_usec; None where there
    is none or it stands still.
    """
    for name, factor in (("time_boot_ms", 1000), ("time_usec", 1)):
        if name in messages.columns:
            own = np.asarray(messages.columns[name]).astype(np.int64) * factor
            if own.size and own.max() > own.min():
                return own
    return None


def boot_offset(log: DecodedLog) -> Array | None:
    """Recorder's clock minus the autopilot's boot clock in us as a straight line
    (slope, intercept) over the recorder's clock.

    Robust: medians over blocks of the messages with boot time, of the longest session
    if the vehicle was restarted. The usual delay of the link is in it. None if no
    message of the autopilot has boot time: the recorder's clock is then all there is.
    """
    messages = _timekeeper(log)
    if messages is None:
        return None
    stamp, boot = (
        stamps(messages),
        np.asarray(messages.columns["time_boot_ms"]).astype(np.int64) * 1000,
    )
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
    for name in (
        "ATTITUDE",
        "ATTITUDE_QUATERNION",
        "GLOBAL_POSITION_INT",
        "SYSTEM_TIME",
        "SCALED_IMU2",
    ):
        messages = log.messages.get(name)
        if messages is not None and len(messages) and _of_autopilot(messages, log):
            return messages
    return None


def _longest_session(boot: Ints) -> slice:
    starts = np.concatenate([[0], np.flatnonzero(np.diff(boot) < RESTART_US) + 1, [boot.size]])
    longest = int(np.argmax(np.diff(starts)))
    return slice(int(starts[longest]), int(starts[longest + 1]))


def _of_autopilot(messages: Messages, log: DecodedLog) -> bool:
    beats = log.messages.get("HEARTBEAT")
    if beats is None or not len(beats) or "compid" not in messages.columns:
        return True
    return bool(messages.columns["compid"][0] == beats.columns["compid"][0])


def stamps(messages: Messages) -> Ints:
    """The recorder's time stamps (Unix, us)."""
    return np.asarray(messages.columns["time_unix_us"]).astype(np.int64)


def to_boot(unix_us: Ints, log: DecodedLog) -> Ints:
    """Recorder's time stamps on the autopilot's boot clock."""
    line = boot_offset(log)
    if line is None:
        return unix_us
    offset: Ints = np.rint(line[0] * unix_us + line[1]).astype(np.int64)
    return unix_us - offset


def clock(messages: Messages, log: DecodedLog) -> Ints | None:
    """Boot time of the autopilot in us.

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
    if (
        messages.columns.get("time_usec") is not None
        and messages.columns["time_usec"].dtype == np.uint32
    ):
        own = own + np.rint((arrived - own) / WRAP_US).astype(np.int64) * WRAP_US
    return own


def fast(messages: Messages, log: DecodedLog) -> str | None:
    """Refuse an inertial message that is sent too slowly to show the motion."""
    time_us = clock(messages, log)
    rate = 0.0 if time_us is None else rate_hz(time_us)
    return None if rate >= SLOWEST_HZ else f"sent at {rate:.1f} Hz only"


def varies(messages: Messages, log: DecodedLog) -> str | None:
    """Refuse an altitude that stands still over the whole log, as VFR_HUD.alt of some
    firmware does.
    """
    name, factor = (
        ("alt", 1.0)
        if "alt" in messages.columns and "groundspeed" in messages.columns
        else ("relative_alt", 1e-3)
    )
    spread = float(np.ptp(floats(messages, name))) * factor
    return None if spread > SMALLEST_CHANGE_M else "stands still over the whole log"


def aided(messages: Messages, log: DecodedLog) -> str | None:
    """Why velocity and position of the navigation filter mean nothing, or None if it
    had a velocity or position sensor.
    """
    report = log.messages.get("EKF_STATUS_REPORT")
    if report is not None and len(report):
        flags = np.asarray(report.columns["flags"]).astype(np.int64)
        good = (flags & VELOCITY_HORIZONTAL != 0) & (flags & CONSTANT_POSITION == 0)
        if float(np.mean(good)) > 0.5:
            return None
        if not flags.any():
            return "the navigation filter was not running (EKF_STATUS_REPORT has no flag set)"
        return (
            "the navigation filter had no velocity or position sensor (constant-position mode in"
            " EKF_STATUS_REPORT)"
        )
    return (
        None
        if log.counts.get("VISION_POSITION_DELTA")
        else "nothing shows that the navigation filter had a velocity or position sensor"
    )


def displacement_over_interval(messages: Messages, log: DecodedLog) -> Columns:
    """Body velocity in m/s from VISION_POSITION_DELTA: displacement over its own
    interval; NaN where the interval is not positive.
    """
    interval = floats(messages, "time_delta_usec") / 1e6
    delta = np.asarray(messages.columns["position_delta"], dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = np.where(interval[:, None] > 0.0, delta / interval[:, None], np.nan)
    columns: Columns = {f"{axis}_m_s": velocity[:, index] for index, axis in enumerate("uvw")}
    columns["interval_s"] = interval
    if "confidence" in messages.columns:
        columns["quality"] = np.clip(floats(messages, "confidence") / 100.0, 0.0, 1.0)
    return columns


def navigation_velocity(messages: Messages, log: DecodedLog) -> Columns:
    """LOCAL_POSITION_NED velocity in body axes with the attitude of the latest two
    ATTITUDE messages; NaN outside of them.
    """
    attitude = log.messages.get("ATTITUDE")
    names = ("u_m_s", "v_m_s", "w_m_s")
    if attitude is None or len(attitude) < 2:
        return {name: np.full(len(messages), np.nan) for name in names}
    time_us, at = clock(messages, log), clock(attitude, log)
    assert time_us is not None
    assert at is not None
    # At 4 Hz and more the angles between two samples are small enough for each to be
    # taken as linear.
    angles = [
        np.interp(time_us, at, np.unwrap(floats(attitude, name)), left=np.nan, right=np.nan)
        for name in ("roll", "pitch", "yaw")
    ]
    ned = np.stack([floats(messages, name) for name in ("vx", "vy", "vz")])
    return dict(zip(names, to_body(ned, *angles), strict=True))


def quaternion(messages: Messages, log: DecodedLog) -> Columns:
    """ZYX Euler angles of ATTITUDE_QUATERNION (w, x, y, z; NED to FRD)."""
    return euler_from_quaternion(
        np.stack([floats(messages, f"q{number}") for number in range(1, 5)], axis=1)
    )


def euler_from_quaternion(q: Array) -> Columns:
    """Roll, pitch, yaw (ZYX) in rad of quaternions (n, 4), w first, that turn body FRD
    into NED. NaN for a quaternion of no length.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return {
        "phi_rad": np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        "theta_rad": np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        "psi_rad": np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    }


def pressure_depth(messages: Messages, log: DecodedLog) -> Columns:
    """Depth below the surface in m from the second barometer: (p - p_surface) / (1000
    kg/m3 SPEC_GRAV g).

    The surface pressure is the one that the vehicle calibrated (BARO2_GND_PRESS), else
    1013.25 hPa; specific gravity is BARO_SPEC_GRAV, else 1.
    """
    surface = next(
        (
            log.parameters[key]
            for key in ("BARO2_GND_PRESS", "GND_ABS_PRESS2")
            if log.parameters.get(key, 0.0) > 0.0
        ),
        None,
    )
    gravity = next(
        (
            log.parameters[key]
            for key in ("BARO_SPEC_GRAV", "GND_SPEC_GRAV")
            if log.parameters.get(key, 0.0) > 0.0
        ),
        1.0,
    )
    pressure = floats(messages, "press_abs") * 100.0
    return {
        "depth_m": (pressure - (surface or STANDARD_PRESSURE_PA))
        / (FRESH_WATER_KG_M3 * gravity * STANDARD_GRAVITY)
    }


def servo_outputs(messages: Messages, log: DecodedLog) -> Columns:
    """Pulse widths of outputs 1 to 16 of the main port; outputs without any pulse are
    left out.
    """
    names = {f"servo{number}_raw": f"pwm_{number}_us" for number in range(1, PWM_OUTPUTS + 1)}
    columns: Columns = {
        field: floats(messages, name) for name, field in names.items() if name in messages.columns
    }
    if "port" in messages.columns:
        aux = floats(messages, "port") != 0
        columns = {field: np.where(aux, np.nan, values) for field, values in columns.items()}
    return {field: values for field, values in columns.items() if bool(np.any(values > 0.0))}


def propeller_and_fins(messages: Messages, log: DecodedLog) -> Columns:
    """Propeller speed and fins from the first five numbers of the float array of that
    number; NaN for other arrays.
    """
    ours = np.asarray(messages.columns["array_id"]) == TWIN_ARRAY_ID
    data = np.where(
        ours[:, None],
        np.asarray(messages.columns["data"], dtype=np.float64)[:, : len(TWIN_ARRAY)],
        np.nan,
    )
    return dict(zip(TWIN_ARRAY, data.T, strict=True))


def battery_cells(messages: Messages, log: DecodedLog) -> Columns:
    """Voltage as the sum of the cells that are reported (ArduPilot puts the whole pack
    into the first), and current.
    """
    cells = np.asarray(messages.columns["voltages"]).astype(np.int64)
    used = cells != UNUSED_CELL
    volts = np.where(used.any(axis=1), np.sum(np.where(used, cells, 0), axis=1) / 1000.0, np.nan)
    return {"voltage_v": volts, "current_a": floats(messages, "current_battery") / 100.0}


def battery_total(messages: Messages, log: DecodedLog) -> Columns:
    """Voltage and current of SYS_STATUS; 65535 mV stands for unknown."""
    millivolts = floats(messages, "voltage_battery")
    return {
        "voltage_v": np.where(millivolts == UNUSED_CELL, np.nan, millivolts / 1000.0),
        "current_a": floats(messages, "current_battery") / 100.0,
    }


def modes(messages: Messages, log: DecodedLog) -> Columns:
    """Changes of mode and of arming from the heartbeats of the autopilot."""
    time_us = clock(messages, log)
    assert time_us is not None
    mode = np.asarray(messages.columns["custom_mode"]).astype(np.int64)
    armed = (np.asarray(messages.columns["base_mode"]).astype(np.int64) & ARMED_BIT) != 0
    change = np.append(True, (np.diff(mode) != 0) | (np.diff(armed.astype(np.int8)) != 0))
    kind = int(messages.columns["type"][0]) if "type" in messages.columns else 0
    names = [mode_name(int(number), vehicle_type=kind) for number in mode[change]]
    return merge_modes(time_us[change], names, time_us[change], armed[change])


def texts(messages: Messages, log: DecodedLog) -> Columns:
    """Status texts with the chunks of long ones joined, in order of arrival."""
    when = to_boot(np.array([stamp for stamp, _ in log.texts], np.int64), log)
    return apart(when, [text for _, text in log.texts])


def utc_offset_us(log: DecodedLog) -> int | None:
    """UTC minus boot clock in us: by the vehicle's own SYSTEM_TIME if it knew the time,
    else by the recorder's clock.
    """
    known = log.messages.get("SYSTEM_TIME")
    if known is not None and len(known):
        unix = np.asarray(known.columns["time_unix_usec"]).astype(np.int64)
        set_rows = unix > UNIX_TIME_US
        if set_rows.any():
            boot = np.asarray(known.columns["time_boot_ms"]).astype(np.int64) * 1000
            return int(np.median((unix - boot)[set_rows]))
    line = boot_offset(log)
    if line is None:
        return 0
    keeper = _timekeeper(log)
    assert keeper is not None
    return int(np.rint(line[0] * float(stamps(keeper)[0]) + line[1]))


RULES = Rules(
    clock=clock,
    utc=utc_offset_us,
    compute={
        "displacement_over_interval": displacement_over_interval,
        "navigation_velocity": navigation_velocity,
        "quaternion": quaternion,
        "pressure_depth": pressure_depth,
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
