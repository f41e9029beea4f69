"""Write the dive of campaigns/bluerov2_dvl as the telemetry log that a ground station
would have recorded, packed by pymavlink.

Run from the root of the repository: `python campaigns/bluerov2_dvl_tlog/make_tlog.py`.
Every sample of a stream becomes one message, at the rate of the DataFlash log, which is
more than most links carry. The link has no delay: the recorder's clock is the vehicle's
boot clock plus a constant. `STEPS` is all that gets lost.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from auvid.data_schemas.tables import column
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog
from auvid.stages.ingest.streams.flight_modes import SUB_MODES

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent / "bluerov2_dvl" / "logs" / "00000029_first130s.BIN"
TARGET = HERE / "logs" / "dive.tlog"
RECORDER_START_US = 1_767_800_000_000_000  # 7 January 2026, when the vehicle's boot clock showed 0
GRAVITY = 9.80665
SURFACE_PA, SPECIFIC_GRAVITY = 101_325.0, 1.024
PARAMETERS = {"BARO2_GND_PRESS": SURFACE_PA, "BARO_SPEC_GRAV": SPECIFIC_GRAVITY}
PASCAL_PER_METRE = 1000.0 * SPECIFIC_GRAVITY * GRAVITY
UNUSED_CELL = 65535
HEARTBEAT_US = 1_000_000
BASE_MODE = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED

Streams = Mapping[str, pa.Table]
Stamped = tuple[int, Any]  # boot time in us, message


@dataclass(frozen=True)
class Step:
    """The smallest differences that a message carries: of the fields of a stream (SI),
    and of its time stamp (us).
    """

    message: str
    fields: Mapping[str, float]
    time_us: int = 1


STEPS: Mapping[str, Step] = {
    "imu": Step(
        "RAW_IMU",
        {f"gyro_{axis}_rad_s": 1e-3 for axis in "xyz"}
        | {f"accel_{axis}_m_s2": 1e-3 * GRAVITY for axis in "xyz"},
    ),  # whole milliradians per second and thousandths of g
    "attitude": Step(
        "ATTITUDE", dict.fromkeys(("phi_rad", "theta_rad", "psi_rad"), 4.8e-7), 1000
    ),  # float32 up to 2 pi
    "depth": Step("SCALED_PRESSURE2", {"depth_m": 2.5e-6}, 1000),  # float32 of 2400 hPa
    "velocity": Step(
        "VISION_POSITION_DELTA", dict.fromkeys(("u_m_s", "v_m_s", "w_m_s"), 3e-6)
    ),  # interval in whole microseconds
    "actuators": Step("SERVO_OUTPUT_RAW", {f"pwm_{number}_us": 1.0 for number in range(1, 17)}),
    "battery": Step("BATTERY_STATUS", {"voltage_v": 1e-3, "current_a": 1e-2}),
}


def rows(table: pa.Table, *names: str) -> Iterator[tuple[Any, ...]]:
    """Time stamp and the named columns, row by row."""
    return zip(*(table[name].to_pylist() for name in ("time_us", *names)), strict=True)


def inertial(streams: Streams) -> Iterator[Stamped]:
    table = streams["imu"]
    for time_us, *values in rows(table, *STEPS["imu"].fields):
        gyro, accel = (
            [round(value / 1e-3) for value in values[:3]],
            [round(value / (1e-3 * GRAVITY)) for value in values[3:]],
        )
        yield time_us, mavlink.MAVLink_raw_imu_message(time_us, *accel, *gyro, 0, 0, 0)


def attitude(streams: Streams) -> Iterator[Stamped]:
    table, imu = streams["attitude"], streams["imu"]
    rates = [
        np.interp(
            column(table, "time_us"), column(imu, "time_us"), column(imu, f"gyro_{axis}_rad_s")
        )
        for axis in "xyz"
    ]
    for (time_us, *angles), *rate in zip(
        rows(table, "phi_rad", "theta_rad", "psi_rad"), *rates, strict=True
    ):
        yield time_us, mavlink.MAVLink_attitude_message(round(time_us / 1000), *angles, *rate)


def pressure(streams: Streams) -> Iterator[Stamped]:
    for time_us, depth in rows(streams["depth"], "depth_m"):
        hectopascal = (SURFACE_PA + depth * PASCAL_PER_METRE) / 100.0
        yield (
            time_us,
            mavlink.MAVLink_scaled_pressure2_message(round(time_us / 1000), hectopascal, 0.0, 0),
        )


def displacement(streams: Streams) -> Iterator[Stamped]:
    for time_us, u, v, w, interval_s, quality in rows(
        streams["velocity"], "u_m_s", "v_m_s", "w_m_s", "interval_s", "quality"
    ):
        delta = [velocity * round(interval_s * 1e6) * 1e-6 for velocity in (u, v, w)]
        message = mavlink.MAVLink_vision_position_delta_message(
            time_us, round(interval_s * 1e6), [0.0] * 3, delta, 100.0 * quality
        )
        yield time_us, message


def outputs(streams: Streams) -> Iterator[Stamped]:
    table = streams["actuators"]
    names = [f"pwm_{number}_us" for number in range(1, 17)]
    for time_us, *values in rows(table, *(name for name in names if name in table.column_names)):
        pulses = dict(
            zip((name for name in names if name in table.column_names), values, strict=True)
        )
        yield (
            time_us,
            mavlink.MAVLink_servo_output_raw_message(
                time_us, 0, *(round(pulses.get(name, 0)) for name in names)
            ),
        )


def battery(streams: Streams) -> Iterator[Stamped]:
    for number, (time_us, volt, ampere) in enumerate(
        rows(streams["battery"], "voltage_v", "current_a")
    ):
        cells = [round(volt * 1000), *[UNUSED_CELL] * 9]
        yield (
            time_us,
            mavlink.MAVLink_battery_status_message(
                0, 0, 0, 0, cells, round(ampere * 100), -1, -1, -1
            ),
        )
        if number % 10 == 0:
            yield (
                time_us,
                mavlink.MAVLink_sys_status_message(
                    0, 0, 0, 0, cells[0], round(ampere * 100), -1, 0, 0, 0, 0, 0, 0
                ),
            )


def state(streams: Streams) -> Iterator[Stamped]:
    """Parameters at the start, a heartbeat every second with the mode of the time,
    status texts.
    """
    start, end = (
        int(column(streams["velocity"], "time_us")[0]),
        int(column(streams["imu"], "time_us")[-1]),
    )
    for index, (name, value) in enumerate(PARAMETERS.items()):
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        yield (
            start,
            mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(PARAMETERS), index),
        )
    numbers = {name: number for number, name in SUB_MODES.items()}
    changes = [(time_us, numbers[mode]) for time_us, mode in rows(streams["mode"], "mode")]
    for time_us in range(start, end, HEARTBEAT_US):
        mode = next(
            (number for changed, number in reversed(changes) if changed <= time_us), changes[0][1]
        )
        sub, pilot, active = (
            mavlink.MAV_TYPE_SUBMARINE,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_STATE_ACTIVE,
        )
        yield time_us, mavlink.MAVLink_heartbeat_message(sub, pilot, BASE_MODE, mode, active, 3)
    for time_us, text in rows(streams["events"], "text"):
        yield time_us, mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_INFO, text.encode())


# What has the first time stamp of the log comes first: legs count from the first
# record.
MESSAGES: tuple[Callable[[Streams], Iterator[Stamped]], ...] = (
    displacement,
    inertial,
    attitude,
    pressure,
    outputs,
    battery,
    state,
)


def telemetry(streams: Streams) -> bytes:
    """The log: for each message the recorder's time stamp (big-endian, us) and a
    MAVLink 2 frame, in order of time.
    """
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    stamped = sorted(
        (pair for messages in MESSAGES for pair in messages(streams)), key=lambda pair: pair[0]
    )
    log = []
    for number, (time_us, message) in enumerate(stamped):
        link.seq = number % 256
        log.append(struct.pack(">Q", RECORDER_START_US + time_us) + bytes(message.pack(link)))
    return b"".join(log)


def streams_of(source: Path) -> dict[str, pa.Table]:
    """The streams of a log by name."""
    log = RawLog("dive", (RawFile(source.name, np.memmap(source, np.uint8, "r")),))
    outputs = ingest.run(ingest.Inputs(log), ingest.Params())
    return {
        name: table
        for name in (*STEPS, "mode", "events")
        if (table := getattr(outputs, name)) is not None
    }


def main() -> None:
    TARGET.write_bytes(telemetry(streams_of(SOURCE)))


if __name__ == "__main__":
    main()
