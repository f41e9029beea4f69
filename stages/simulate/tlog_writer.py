"""Write a log of the twin as MAVLink telemetry (.tlog), packed by pymavlink.

ATTITUDE, HIGHRES_IMU, VISION_POSITION_DELTA and SCALED_PRESSURE2 hold single-precision SI numbers (RAW_IMU's whole millirad/s would not
do for recovery). Propeller [rev/s] and fins S, P, B, T [rad] are the first five numbers of DEBUG_FLOAT_ARRAY 2759. The recorder stamps
each message with the vehicle's own time, as over a link without delay.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from .dataflash_writer import FRESH_WATER_PA_M, STANDARD_PRESSURE_PA
from .sensing import BOOT_US, FINS, Recorded

UNIX_START_US = 1_404_208_800_000_000  # 2014-07-01, any date will do
ARRAY_NAME, ARRAY_ID, ARRAY_LENGTH = b"ACTU", 2759, 58
HEARTBEAT_US = 1_000_000
SYSTEM, COMPONENT = 1, 1


def write_tlog(recorded: Recorded) -> bytes:
    """The whole log as bytes, MAVLink 2."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    mav = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
    messages = sorted(_messages(mav, mavlink, recorded), key=lambda item: item[0])
    parts = []
    for time_us, message in messages:
        parts += [struct.pack(">Q", UNIX_START_US + time_us), message.pack(mav)]
        mav.seq = (mav.seq + 1) % 256
    return b"".join(parts)


def _messages(mav: Any, mavlink: Any, recorded: Recorded) -> Iterator[tuple[int, Any]]:
    streams = recorded.streams
    end = max(int(stream["time_us"][-1]) for stream in streams.values())
    for time_us in range(BOOT_US, end, HEARTBEAT_US):
        yield time_us, mav.heartbeat_encode(mavlink.MAV_TYPE_SUBMARINE, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 128, 0, 4)
    yield BOOT_US, mav.statustext_encode(mavlink.MAV_SEVERITY_INFO, recorded.text.encode()[:50])
    imu, attitude, velocity = streams["imu"], streams["attitude"], streams["velocity"]
    gyro = [imu[f"gyro_{axis}_rad_s"] for axis in "xyz"]
    for t, ax, ay, az, gx, gy, gz in _rows(imu["time_us"], *(imu[f"accel_{axis}_m_s2"] for axis in "xyz"), *gyro):
        yield int(t), mav.highres_imu_encode(int(t), ax, ay, az, gx, gy, gz, *[0.0] * 7, 0x3F)
    for t, phi, theta, psi, p, q, r in _rows(attitude["time_us"], *(attitude[f"{name}_rad"] for name in ("phi", "theta", "psi")), *gyro):
        yield int(t), mav.attitude_encode(int(t) // 1000, phi, theta, psi, p, q, r)
    steps = np.diff(velocity["time_us"], prepend=2 * velocity["time_us"][0] - velocity["time_us"][1])
    for t, step, u, v, w in _rows(velocity["time_us"], steps, *(velocity[f"{axis}_m_s"] for axis in "uvw")):
        moved = [value * step / 1e6 for value in (u, v, w)]
        yield int(t), mav.vision_position_delta_encode(int(t), int(step), [0.0] * 3, moved, 100.0)
    depth = streams["depth"]
    pressure = (STANDARD_PRESSURE_PA + FRESH_WATER_PA_M * depth["depth_m"]) / 100.0
    for t, hpa in _rows(depth["time_us"], pressure):
        yield int(t), mav.scaled_pressure2_encode(int(t) // 1000, hpa, 0.0, 2000)
    actuators = streams["actuators"]
    for t, *values in _rows(actuators["time_us"], actuators["propeller_rev_s"], *(actuators[name] for name in FINS)):
        yield int(t), mav.debug_float_array_encode(int(t), ARRAY_NAME, ARRAY_ID, [*values, *[0.0] * (ARRAY_LENGTH - len(values))])


def _rows(*columns: Any) -> Iterator[tuple[Any, ...]]:
    return zip(*(column.tolist() for column in columns), strict=True)
