"""Write a log of the twin as MAVLink telemetry (.tlog), packed by pymavlink.

ATTITUDE, HIGHRES_IMU, VISION_POSITION_DELTA and SCALED_PRESSURE2 hold single-precision
SI numbers (RAW_IMU's whole millirad/s would not do for recovery). Propeller [rev/s] and
fins S, P, B, T [rad] are the first five numbers of DEBUG_FLOAT_ARRAY 2759. The recorder
stamps each message with the vehicle's own time, as over a link without delay. Pulses
stand in SERVO_OUTPUT_RAW. A log has the messages of the streams that were recorded.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.hydro.constants import STANDARD_PRESSURE_PA
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.stages.simulate.dataflash_writer import FRESH_WATER_PA_M
from auvid.stages.simulate.sensing import FINS, Recorded

UNIX_START_US = 1_404_208_800_000_000  # 2014-07-01, any date will do
ARRAY_NAME, ARRAY_ID, ARRAY_LENGTH = b"ACTU", 2759, 58
HEARTBEAT_US = 1_000_000
SYSTEM, COMPONENT = 1, 1
Streams = Mapping[str, Mapping[str, npt.NDArray[Any]]]
Messages = Iterator[tuple[int, Any]]
"""Times [us] and messages, which are of pymavlink, without types."""


def write_tlog(recorded: Recorded) -> bytes:
    """Return the whole log as bytes, MAVLink 2."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    mav = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
    messages = sorted(_messages(mav, mavlink, recorded), key=lambda item: item[0])
    parts = []
    for time_us, message in messages:
        parts += [struct.pack(">Q", UNIX_START_US + time_us), message.pack(mav)]
        mav.seq = (mav.seq + 1) % 256
    return b"".join(parts)


def _messages(mav: Any, mavlink: Any, recorded: Recorded) -> Messages:
    streams = recorded.streams
    end = max(int(stream["time_us"][-1]) for stream in streams.values())
    beats = np.arange(START_US, end, HEARTBEAT_US)
    for time_us, mode in zip(beats.tolist(), _modes(streams, beats), strict=True):
        yield (
            time_us,
            mav.heartbeat_encode(
                mavlink.MAV_TYPE_SUBMARINE, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 128, mode, 4
            ),
        )
    for index, (name, value) in enumerate(recorded.parameters.items()):
        yield (
            START_US,
            mav.param_value_encode(
                name.encode(),
                value,
                mavlink.MAV_PARAM_TYPE_REAL32,
                len(recorded.parameters),
                index,
            ),
        )
    yield START_US, mav.statustext_encode(mavlink.MAV_SEVERITY_INFO, recorded.text.encode()[:50])
    for stream, encode in (
        ("imu", _imu),
        ("attitude", _attitude),
        ("velocity", _velocity),
        ("depth", _depth),
        ("actuators", _actuators),
        ("battery", _battery),
    ):
        if stream in streams:
            yield from encode(mav, streams)


def _imu(mav: Any, streams: Streams) -> Messages:
    imu = streams["imu"]
    for t, *values in _rows(
        imu["time_us"], *(imu[f"accel_{axis}_m_s2"] for axis in "xyz"), *_gyro(imu)
    ):
        yield int(t), mav.highres_imu_encode(int(t), *values, *[0.0] * 7, 0x3F)


def _attitude(mav: Any, streams: Streams) -> Messages:
    attitude = streams["attitude"]
    angles = (attitude[f"{name}_rad"] for name in ("phi", "theta", "psi"))
    imu = streams["imu"]
    gyro = [np.interp(attitude["time_us"], imu["time_us"], rate) for rate in _gyro(imu)]
    for t, *values in _rows(attitude["time_us"], *angles, *gyro):
        yield int(t), mav.attitude_encode(int(t) // 1000, *values)


def _velocity(mav: Any, streams: Streams) -> Messages:
    velocity = streams["velocity"]
    steps = np.diff(
        velocity["time_us"], prepend=2 * velocity["time_us"][0] - velocity["time_us"][1]
    )
    for t, step, u, v, w in _rows(
        velocity["time_us"], steps, *(velocity[f"{axis}_m_s"] for axis in "uvw")
    ):
        moved = [value * step / 1e6 for value in (u, v, w)]
        yield int(t), mav.vision_position_delta_encode(int(t), int(step), [0.0] * 3, moved, 100.0)


def _depth(mav: Any, streams: Streams) -> Messages:
    depth = streams["depth"]
    pressure = (STANDARD_PRESSURE_PA + FRESH_WATER_PA_M * depth["depth_m"]) / 100.0
    for t, hpa in _rows(depth["time_us"], pressure):
        yield int(t), mav.scaled_pressure2_encode(int(t) // 1000, hpa, 0.0, 2000)


def _actuators(mav: Any, streams: Streams) -> Messages:
    actuators = streams["actuators"]
    pulses = [values for name, values in actuators.items() if name.startswith("pwm_")]
    if pulses:
        for t, *values in _rows(actuators["time_us"], *pulses):
            yield int(t), mav.servo_output_raw_encode(int(t), 0, *(int(value) for value in values))
        return
    for t, *values in _rows(
        actuators["time_us"], actuators["propeller_rev_s"], *(actuators[name] for name in FINS)
    ):
        yield (
            int(t),
            mav.debug_float_array_encode(
                int(t), ARRAY_NAME, ARRAY_ID, [*values, *[0.0] * (ARRAY_LENGTH - len(values))]
            ),
        )


def _battery(mav: Any, streams: Streams) -> Messages:
    """Yield BATTERY_STATUS with the whole pack in the first cell, as ArduPilot does."""
    battery = streams["battery"]
    unused = [65535] * 9
    for t, volt, ampere in _rows(battery["time_us"], battery["voltage_v"], battery["current_a"]):
        cells = [round(volt * 1000.0), *unused]
        current = round(ampere * 100.0)
        yield int(t), mav.battery_status_encode(0, 0, 0, 32767, cells, current, -1, -1, -1)


def _modes(streams: Streams, time_us: npt.NDArray[np.int64]) -> list[int]:
    """Return the number of the mode at times; 0 where the twin has none."""
    if "mode" not in streams:
        return [0] * len(time_us)
    at = np.searchsorted(streams["mode"]["time_us"], time_us, side="right") - 1
    return [int(mode) for mode in streams["mode"]["mode"][np.maximum(at, 0)]]


def _gyro(imu: Mapping[str, npt.NDArray[Any]]) -> list[npt.NDArray[Any]]:
    return [imu[f"gyro_{axis}_rad_s"] for axis in "xyz"]


def _rows(*columns: npt.NDArray[Any]) -> Iterator[tuple[float, ...]]:
    return zip(*(column.tolist() for column in columns), strict=True)
