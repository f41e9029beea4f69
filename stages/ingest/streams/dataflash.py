"""What the mapping of DataFlash logs needs besides renaming: velocity from
displacements, the choice of barometer, modes, arming.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.hydro.arrays import Array, Ints
from auvid.stages.columns import UNIX_TIME_US
from auvid.stages.ingest.decoded_log import DecodedLog, Messages
from auvid.stages.ingest.streams.flight_modes import mode_name
from auvid.stages.ingest.streams.mapping import Columns, Rules

PWM_OUTPUTS = 16
PAIR_US = 20_000
ARMED, DISARMED = 10, 11  # identifiers of the EV message
DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270
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
    """Boot time in microseconds: TimeUS, or TimeMS of logs before 2015; -1 for a
    damaged number of a text log.

    In the GPS records of such logs TimeMS is the time of the GPS week, and T the boot
    time.
    """
    old_fix = {"T", "TimeMS"} <= set(messages.columns) and bool(
        {"Week", "GPSTime"} & set(messages.columns)
    )
    for name, factor in (("T", 1000),) if old_fix else (("TimeUS", 1), ("TimeMS", 1000)):
        stamps = np.asarray(messages.columns.get(name, ()))
        if name in messages.columns and stamps.dtype.kind in "iuf":
            if stamps.dtype.kind == "f":
                stamps = np.where(np.abs(stamps) < LATEST_US, stamps, -1.0)
            return stamps.astype(np.int64) * factor
    return None


def floats(messages: Messages, name: str) -> Array:
    with np.errstate(invalid="ignore"):  # damage can leave a signalling NaN
        return np.asarray(messages.columns[name], dtype=np.float64)


def displacement_over_interval(messages: Messages, log: DecodedLog) -> Columns:
    """Body velocity (n,) in m/s from VISO: displacement over its own interval; NaN
    where the interval is not positive.
    """
    interval = floats(messages, "dt")
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(interval > 0.0, 1.0 / interval, np.nan)
    columns: Columns = {
        f"{axis}_m_s": floats(messages, f"PosD{name}") * scale
        for axis, name in zip("uvw", "XYZ", strict=True)
    }
    columns["interval_s"] = interval
    if "conf" in messages.columns:
        columns["quality"] = np.clip(floats(messages, "conf") / 100.0, 0.0, 1.0)
    return columns


def navigation_velocity(messages: Messages, log: DecodedLog) -> Columns:
    """North-east-down velocity of the navigation filter turned into body axes with the
    attitude of the same record.
    """
    phi, theta, psi = (np.radians(floats(messages, name)) for name in ("Roll", "Pitch", "Yaw"))
    north_east_down = np.stack([floats(messages, name) for name in ("VN", "VE", "VD")])
    return dict(
        zip(("u_m_s", "v_m_s", "w_m_s"), to_body(north_east_down, phi, theta, psi), strict=True)
    )


def to_body(vector: Array, phi: Array, theta: Array, psi: Array) -> Array:
    """A north-east-down vector (3, n) in body axes (3, n), ZYX Euler angles in rad: the
    transpose of Fossen's R(Theta).
    """
    sf, cf, st, ct, sp, cp = (
        np.sin(phi),
        np.cos(phi),
        np.sin(theta),
        np.cos(theta),
        np.sin(psi),
        np.cos(psi),
    )
    rotation = np.array(
        [
            [cp * ct, sp * ct, -st],
            [-sp * cf + cp * st * sf, cp * cf + sp * st * sf, ct * sf],
            [sp * sf + cp * st * cf, -cp * sf + sp * st * cf, ct * cf],
        ]
    )
    result: Array = np.einsum("ijn,jn->in", rotation, vector)
    return result


def aided(messages: Messages, log: DecodedLog) -> str | None:
    """Why velocity and position of the navigation filter mean nothing, or None if it
    had a velocity or position sensor.
    """
    if log.counts.get("VISO", 0) or log.counts.get("XKFD", 0) or log.counts.get("BCN", 0):
        return None
    fix = log.messages.get("GPS")
    if (
        fix is not None
        and "Status" in fix.columns
        and len(fix)
        and float(np.mean(floats(fix, "Status") >= FIX_3D)) > 0.5
    ):
        return None
    return (
        "the navigation filter had no velocity or position sensor (no VISO, no beacon, no GPS fix)"
    )


def servo_outputs(messages: Messages, log: DecodedLog) -> Columns:
    """Pulse widths of outputs 1 to 16; outputs without any pulse are left out. RCO2 is
    paired with RCOU within 20 ms.
    """
    columns: Columns = {}
    for number in range(1, PWM_OUTPUTS + 1):
        name = next(
            (
                key
                for key in (f"C{number}", f"Ch{number}", f"Chan{number}")
                if key in messages.columns
            ),
            None,
        )
        if name is not None:
            columns[f"pwm_{number}_us"] = floats(messages, name)
    further, time_us = log.messages.get("RCO2"), clock(messages, log)
    if further is not None and len(further) and time_us is not None:
        other = clock(further, log)
        assert other is not None
        nearest = _nearest(time_us, other)
        close = np.abs(other[nearest] - time_us) <= PAIR_US
        for number in range(15, PWM_OUTPUTS + 1):
            if f"C{number}" in further.columns:
                columns[f"pwm_{number}_us"] = np.where(
                    close, floats(further, f"C{number}")[nearest], np.nan
                )
    return {name: values for name, values in columns.items() if bool(np.any(values > 0.0))}


def _nearest(wanted: Ints, there: Ints) -> npt.NDArray[np.intp]:
    order = np.argsort(there, kind="stable")
    right = np.clip(np.searchsorted(there[order], wanted), 1, max(there.size - 1, 1))
    left, right = right - 1, np.minimum(right, there.size - 1)
    closer = np.abs(there[order[left]] - wanted) <= np.abs(there[order[right]] - wanted)
    return order[np.where(closer, left, right)]


def battery(messages: Messages, log: DecodedLog) -> Columns:
    """Voltage and current of CURR, which early firmware wrote as whole hundredths."""
    parts = {"voltage_v": messages.columns["Volt"], "current_a": messages.columns["Curr"]}
    return {
        name: np.asarray(values, dtype=np.float64) * (0.01 if values.dtype.kind in "iu" else 1.0)
        for name, values in parts.items()
    }


def healthy(messages: Messages, log: DecodedLog) -> float:
    """0 for an inertial unit that calls itself healthy most of the time, else 1."""
    flags = [floats(messages, name) for name in ("GH", "AH") if name in messages.columns]
    return float(any(np.mean(flag) < 0.5 for flag in flags))


def submerged(messages: Messages, log: DecodedLog) -> float:
    """How badly a barometer fits to the vehicle's own depth (median, m); without that,
    minus the range of its altitude.

    An underwater vehicle has one barometer in its housing and one in the water, and the
    log does not say which is which.
    """
    altitude, time_us = floats(messages, "Alt"), clock(messages, log)
    for name, column in (("CTUN", "BAlt"), ("CTUN", "BarAlt"), ("CTUN", "Alt")):
        own = log.messages.get(name)
        own_time = (
            clock(own, log) if own is not None and len(own) and column in own.columns else None
        )
        if own is None or own_time is None or time_us is None:
            continue
        return float(
            np.nanmedian(np.abs(altitude[_nearest(own_time, time_us)] - floats(own, column)))
        )
    return -float(np.nanmax(altitude) - np.nanmin(altitude)) if altitude.size else np.inf


def downward_score(column: str) -> Callable[[Messages, DecodedLog], float]:
    """A score that is 0 for a range finder that looks down (its orientation stands in
    `column`), else 1.
    """

    def score(messages: Messages, log: DecodedLog) -> float:
        return float(column in messages.columns and np.median(floats(messages, column)) != DOWNWARD)

    return score


def modes(messages: Messages, log: DecodedLog) -> Columns:
    """Changes of mode and of arming in time order; arming from ARM or EV records,
    absent where neither is logged.
    """
    number = messages.columns["ModeNum" if "ModeNum" in messages.columns else "Mode"]
    time_us = clock(messages, log)
    assert time_us is not None
    if number.dtype.kind == "f":  # of several layouts, of which one lacks the field
        time_us, number = time_us[~np.isnan(number)], number[~np.isnan(number)]
    return merge_modes(time_us, [mode_name(_mode_number(item)) for item in number], *_arming(log))


def _mode_number(value: Any) -> int | str:
    if isinstance(value, bytes):
        return value.decode("ascii", "replace")
    return int(value)


def _arming(log: DecodedLog) -> tuple[Ints, npt.NDArray[np.bool_]]:
    arm, event = log.messages.get("ARM"), log.messages.get("EV")
    if arm is not None and len(arm) and "ArmState" in arm.columns:
        times = clock(arm, log)
        if times is not None:
            return times, np.asarray(arm.columns["ArmState"]) != 0
    if event is not None and len(event) and "Id" in event.columns:
        times, code = clock(event, log), np.asarray(event.columns["Id"])
        if times is not None:
            kept = np.isin(code, (ARMED, DISARMED))
            return times[kept], code[kept] == ARMED
    return np.zeros(0, np.int64), np.zeros(0, np.bool_)


def merge_modes(
    time_us: Ints, names: list[str], armed_us: Ints, armed: npt.NDArray[np.bool_]
) -> Columns:
    """One row per change: the mode and the arming that hold from then on. Rows before
    the first mode are `unknown`.
    """
    times = np.unique(np.concatenate([time_us, armed_us]))
    order = np.argsort(time_us, kind="stable")
    at = np.searchsorted(time_us[order], times, side="right") - 1
    columns: Columns = {
        "time_us": times,
        "mode": np.array(
            [names[order[index]] if index >= 0 else "unknown" for index in at], dtype=object
        ),
    }
    if armed_us.size:
        by_time = np.argsort(armed_us, kind="stable")
        since = np.searchsorted(armed_us[by_time], times, side="right") - 1
        # Before the first arming event the state was the opposite of it.
        columns["armed"] = np.where(
            since >= 0, armed[by_time][np.maximum(since, 0)], ~armed[by_time][0]
        )
    return columns


def texts(messages: Messages, log: DecodedLog) -> Columns:
    """Text messages in file order; several with one time stamp are set 1 us apart,
    because rows of a stream have distinct times.
    """
    time_us = clock(messages, log)
    assert time_us is not None
    return apart(
        time_us, [bytes(item).decode("utf-8", "replace") for item in messages.columns["Message"]]
    )


def apart(time_us: Ints, words: list[str]) -> Columns:
    steps = np.arange(time_us.size)
    return {
        "time_us": np.maximum.accumulate(time_us - steps) + steps if time_us.size else time_us,
        "text": np.array(words, dtype=object),
    }


def utc_offset_us(log: DecodedLog) -> int | None:
    """UTC minus boot clock in us from the GPS week and time of week of records with a
    fix (median); None without a fix.

    0 for a clock that counts from 1970 itself, whatever the GPS says: that of a
    simulator may be decades off.
    """
    fix = log.messages.get("GPS")
    names = (
        ()
        if fix is None
        else next(
            (
                item
                for item in (("GWk", "GMS"), ("Week", "TimeMS"))
                if set(item) <= set(fix.columns)
            ),
            (),
        )
    )
    if fix is None or not names or "Status" not in fix.columns:
        return None
    time_us = clock(fix, log)
    week, of_week = (floats(fix, name) for name in names)
    good = (
        (floats(fix, "Status") >= FIX_3D)
        & (week > 0)
        & (week < LAST_WEEK)
        & (of_week >= 0)
        & (of_week * 1000 < WEEK_US)
    )
    if time_us is None or not good.any():
        return None
    if np.median(time_us[good]) > UNIX_TIME_US:
        return 0
    gps_us = (
        GPS_EPOCH_US + week[good].astype(np.int64) * WEEK_US + of_week[good].astype(np.int64) * 1000
    )
    leap = next(seconds for since, seconds in LEAP_SECONDS if np.median(gps_us) / 1e6 >= since)
    return int(np.median(gps_us - time_us[good])) - leap * 1_000_000


RULES = Rules(
    clock=clock,
    utc=utc_offset_us,
    compute={
        "displacement_over_interval": displacement_over_interval,
        "navigation_velocity": navigation_velocity,
        "servo_outputs": servo_outputs,
        "battery": battery,
        "modes": modes,
        "texts": texts,
    },
    conditions={"aided": aided},
    scores={"healthy": healthy, "submerged": submerged, "downward": downward_score("Orient")},
    also=frozenset({"GPS"}),
)
