"""Streams of DataFlash logs: velocity from displacements, barometer, modes, arming."""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Ints, Mask
from auvid.stages.columns import UNIX_TIME_US
from auvid.stages.ingest.decoded_log import DecodedLog, Messages
from auvid.stages.ingest.streams.common import (
    NO_SENSOR,
    PWM_OUTPUTS,
    Columns,
    displacement_velocity,
    downward_score,
    live,
    merge_modes,
    mostly,
    pulse_widths,
    text_rows,
    to_body,
    vector,
)
from auvid.stages.ingest.streams.flight_modes import SUB_MODES
from auvid.stages.ingest.streams.mapping import Rules

PAIR_US = 20_000
STICK_NEUTRAL_US, STICK_RANGE_US = 1500.0, 400.0
ARMED, DISARMED = 10, 11  # identifiers of the EV message
FIX_3D = 3
GPS_EPOCH_US = 315_964_800_000_000  # 6 January 1980
WEEK_US = 604_800_000_000
LAST_WEEK = 10_000
LATEST_US = 1 << 52
LEAP_SECONDS = (
    (1_483_228_800, 18),
    (1_435_708_800, 17),
    (1_341_100_800, 16),
    (0, 15),
)  # GPS minus UTC [s] since a Unix time (IERS C)


def clock(messages: Messages, log: DecodedLog) -> Ints | None:
    """Return boot time in us: TimeUS, or TimeMS of logs before 2015.

    -1 for a damaged number of a text log. In the GPS records of old logs TimeMS is the
    time of the GPS week, and T the boot time.
    """
    names = set(messages.columns)
    old_fix = {"T", "TimeMS"} <= names and bool({"Week", "GPSTime"} & names)
    for name, factor in (("T", 1000),) if old_fix else (("TimeUS", 1), ("TimeMS", 1000)):
        stamps = messages.columns.get(name, np.zeros(0, "S1"))
        if stamps.dtype.kind in "iuf":
            if stamps.dtype.kind == "f":
                stamps = np.where(np.abs(messages.floats(name)) < LATEST_US, stamps, -1.0)
            return stamps.astype(np.int64) * factor
    return None


def displacement_over_interval(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return body velocity in m/s from VISO."""
    confidence = messages.floats("conf") if "conf" in messages.columns else None
    delta = vector(messages, ("PosDX", "PosDY", "PosDZ"))
    return displacement_velocity(delta, messages.floats("dt"), confidence)


def navigation_velocity(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return the navigation filter's velocity, by its attitude, in body axes."""
    angles = np.radians(vector(messages, ("Roll", "Pitch", "Yaw")))
    return to_body(vector(messages, ("VN", "VE", "VD")), *angles)


def aided(messages: Messages, log: DecodedLog) -> str | None:
    """Return why the navigation filter's velocity and position mean nothing, or None.

    None if the filter had a velocity or position sensor.
    """
    fix = log.get("GPS", "Status")
    if any(log.counts.get(name) for name in ("VISO", "XKFD", "BCN")) or (
        fix is not None and mostly(fix.floats("Status") >= FIX_3D)
    ):
        return None
    return f"{NO_SENSOR} (no VISO, no beacon, no GPS fix)"


def receiver_sticks(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return the sticks of RCIN as ArduSub numbers its channels; throttle is upward."""
    channels = {"surge": ("C5", 1.0), "sway": ("C6", 1.0), "heave": ("C3", -1.0)}
    channels["yaw"] = ("C4", 1.0)
    return {
        f"stick_{axis}": sign * (messages.floats(name) - STICK_NEUTRAL_US) / STICK_RANGE_US
        for axis, (name, sign) in channels.items()
    }


def servo_outputs(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return pulse widths of outputs 1 to 16; outputs without any pulse are left out.

    RCO2 is paired with RCOU within 20 ms.
    """
    columns: Columns = {}
    for prefix in ("Chan", "Ch", "C"):
        columns |= pulse_widths(messages, {n: f"{prefix}{n}" for n in PWM_OUTPUTS})
    further = log.get("RCO2")
    if further is not None:
        other = clock(further, log)
        assert other is not None
        nearest = _nearest(time_us, other)
        close = np.abs(other[nearest] - time_us) <= PAIR_US
        for name, values in pulse_widths(further, {n: f"C{n}" for n in (15, 16)}).items():
            columns[name] = np.where(close, values[nearest], np.nan)
    return live(columns)


def _nearest(at: Ints, there: Ints) -> Ints:
    """Return the index of the time in `there` that is nearest to each time in `at`."""
    order = np.argsort(there, kind="stable")
    right = np.clip(np.searchsorted(there[order], at), 1, max(there.size - 1, 1))
    left, right = right - 1, np.minimum(right, there.size - 1)
    closer = np.abs(there[order[left]] - at) <= np.abs(there[order[right]] - at)
    return order[np.where(closer, left, right)]


def battery(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return voltage and current of CURR.

    Early firmware wrote them as whole hundredths.
    """
    return {
        name: messages.floats(column)
        * (0.01 if messages.columns[column].dtype.kind in "iu" else 1.0)
        for name, column in (("voltage_v", "Volt"), ("current_a", "Curr"))
    }


def healthy(messages: Messages, log: DecodedLog) -> float:
    """Return 0 for an inertial unit that mostly calls itself healthy, else 1."""
    flags = [messages.floats(name) for name in ("GH", "AH") if name in messages.columns]
    return float(any(np.mean(flag) < 0.5 for flag in flags))


def submerged(messages: Messages, log: DecodedLog) -> float:
    """Return how badly a barometer fits to the vehicle's own depth (median, m).

    Without that, minus the range of its altitude. An underwater vehicle has one
    barometer in its housing and one in the water, and the log does not say which is
    which.
    """
    altitude, time_us = messages.floats("Alt"), clock(messages, log)
    for column in ("BAlt", "BarAlt", "Alt"):
        own = log.get("CTUN", column)
        own_time = None if own is None else clock(own, log)
        if own is not None and own_time is not None and time_us is not None:
            difference = altitude[_nearest(own_time, time_us)] - own.floats(column)
            return float(np.nanmedian(np.abs(difference)))
    return -float(np.nanmax(altitude) - np.nanmin(altitude)) if altitude.size else np.inf


def modes(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return changes of mode and of arming in time order.

    Arming comes from ARM or EV records; it is absent where neither is logged.
    """
    number = messages.columns["ModeNum" if "ModeNum" in messages.columns else "Mode"]
    if number.dtype.kind == "f":  # of several layouts, of which one lacks the field
        time_us, number = time_us[~np.isnan(number)], number[~np.isnan(number)]
    return merge_modes(time_us, [_mode_name(item) for item in number.tolist()], *_arming(log))


def _mode_name(mode: bytes | float) -> str:
    if isinstance(mode, bytes):
        return mode.decode("ascii", "replace")
    return SUB_MODES.get(int(mode), str(int(mode)))


def _arming(log: DecodedLog) -> tuple[Ints, Mask]:
    arm, event = log.get("ARM", "ArmState"), log.get("EV", "Id")
    if arm is not None and (times := clock(arm, log)) is not None:
        return times, arm.columns["ArmState"] != 0
    if event is not None and (times := clock(event, log)) is not None:
        code = event.columns["Id"]
        kept = np.isin(code, (ARMED, DISARMED))
        return times[kept], code[kept] == ARMED
    return np.zeros(0, np.int64), np.zeros(0, np.bool_)


def texts(messages: Messages, time_us: Ints, log: DecodedLog) -> Columns:
    """Return text messages in file order."""
    raw = messages.columns["Message"].tolist()
    return text_rows(time_us, [text.decode("utf-8", "replace") for text in raw])


def utc_offset_us(log: DecodedLog) -> int | None:
    """Return UTC minus boot clock in us from GPS week and time of week (median).

    None without a fix. 0 for a clock that counts from 1970 itself, whatever the GPS
    says: that of a simulator may be decades off.
    """
    for names in (("GWk", "GMS"), ("Week", "TimeMS")):
        fix = log.get("GPS", "Status", *names)
        if fix is not None:
            break
    else:
        return None
    time_us = clock(fix, log)
    week, of_week = vector(fix, names)
    good = (fix.floats("Status") >= FIX_3D) & (week > 0) & (week < LAST_WEEK)
    good &= (of_week >= 0) & (of_week * 1000 < WEEK_US)
    if time_us is None or not good.any():
        return None
    if np.median(time_us[good]) > UNIX_TIME_US:
        return 0
    week_us, of_week_us = (
        week[good].astype(np.int64) * WEEK_US,
        of_week[good].astype(np.int64) * 1000,
    )
    gps_us = GPS_EPOCH_US + week_us + of_week_us
    leap = next(seconds for since, seconds in LEAP_SECONDS if np.median(gps_us) / 1e6 >= since)
    return int(np.median(gps_us - time_us[good])) - leap * 1_000_000


RULES = Rules(
    mapping="dataflash",
    clock=clock,
    utc=utc_offset_us,
    compute={
        "displacement_over_interval": displacement_over_interval,
        "navigation_velocity": navigation_velocity,
        "receiver_sticks": receiver_sticks,
        "servo_outputs": servo_outputs,
        "battery": battery,
        "modes": modes,
        "texts": texts,
    },
    conditions={"aided": aided},
    scores={"healthy": healthy, "submerged": submerged, "downward": downward_score("Orient")},
    also=frozenset({"GPS"}),
)
