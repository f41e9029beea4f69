"""Write a log of the twin as ArduPilot DataFlash (.BIN), as a vehicle would: definitions, units, then records in order of time.

IMU, ATT, BARO and VISO have the layouts of ArduSub 4.5 (single precision: 1e-7 of a value, 2e-7 rad of attitude, enough to recover
coefficients from sensors without noise). Propeller and fins stand in a message of our own, ACTU. Fields that the twin does not know are 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from data_schemas.formats.dataflash import FMT, MAGIC, Definition, define

from .sensing import BOOT_US, Recorded

UNITS = {
    "s": "s",
    "#": "instance",
    "E": "rad/s",
    "o": "m/s/s",
    "d": "deg",
    "m": "m",
    "z": "Hz",
    "r": "rad",
    "P": "Pa",
    "O": "degC",
    "n": "m/s",
    "%": "%",
}
MULTIPLIERS = {"-": 0.0, "0": 1.0, "F": 1e-6, "C": 1e-3, "B": 1e-2}
FRESH_WATER_PA_M = 1000.0 * 9.80665
STANDARD_PRESSURE_PA = 101_325.0

UNIT = define(117, "UNIT", "QbZ", "TimeUS,Id,Label")
MULT = define(118, "MULT", "Qbd", "TimeUS,Id,Mult")
FMTU = define(116, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
MSG = define(59, "MSG", "QZ", "TimeUS,Message")
IMU = define(164, "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz")
ATT = define(72, "ATT", "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF")
BARO = define(64, "BARO", "QBfffcfIffBf", "TimeUS,I,Alt,AltAMSL,Press,Temp,CRt,SMS,Offset,GndTemp,H,CPress")
VISO = define(168, "VISO", "Qffffffff", "TimeUS,dt,AngDX,AngDY,AngDZ,PosDX,PosDY,PosDZ,conf")
ACTU = define(200, "ACTU", "Qfffff", "TimeUS,RevS,FinS,FinP,FinB,FinT")
TYPES: tuple[tuple[Definition, str, str], ...] = (
    (FMT, "", ""),
    (UNIT, "s--", "F--"),
    (MULT, "s--", "F--"),
    (FMTU, "s---", "F---"),
    (MSG, "s-", "F-"),
    (IMU, "s#EEEooo--O--zz", "F-000000--0--00"),
    (ATT, "sdddddd-", "F000000-"),
    (BARO, "s#mmPOnsmO-P", "F-000-0C00-0"),
    (VISO, "ssdddmmm%", "F00000000"),
    (ACTU, "szrrrr", "F00000"),
)
"""Every message type with the letters of its units and multipliers."""


def write_dataflash(recorded: Recorded) -> bytes:
    """The whole log as bytes. Records with equal times keep the order MSG, IMU, ATT, VISO, BARO, ACTU."""
    head = b"".join(item.pack() for item, _, _ in TYPES)
    letters = [_rows(UNIT, {"Id": [ord(key)], "Label": [text.encode()]}, _start()) for key, text in UNITS.items()]
    letters += [_rows(MULT, {"Id": [ord(key)], "Mult": [value]}, _start()) for key, value in MULTIPLIERS.items()]
    letters += [
        _rows(FMTU, {"FmtType": [item.id], "UnitIds": [units.encode()], "MultIds": [factors.encode()]}, _start())
        for item, units, factors in TYPES
        if units
    ]
    words = _rows(MSG, {"Message": [recorded.text.encode()[:64]]}, _start())
    return head + words.tobytes() + b"".join(item.tobytes() for item in letters) + in_order(_records(recorded))


def in_order(blocks: list[tuple[npt.NDArray[np.int64], list[bytes]]]) -> bytes:
    """Records of several types (times (n,), bytes of each) in order of time; types keep their order at equal times."""
    times = np.concatenate([when for when, _ in blocks])
    records = [item for _, items in blocks for item in items]
    return b"".join(records[index] for index in np.argsort(times, kind="stable"))


def _start() -> npt.NDArray[np.int64]:
    return np.array([BOOT_US])


def _rows(definition: Definition, columns: Mapping[str, Any], time_us: npt.NDArray[np.int64]) -> npt.NDArray[np.void]:
    """Records (n,) of a type with these columns; the others are 0."""
    rows = np.zeros(time_us.size, definition.record)
    raw = rows.view(np.uint8).reshape(time_us.size, -1)
    raw[:, :2] = np.frombuffer(MAGIC, np.uint8)
    raw[:, 2] = definition.id
    for index, name in enumerate(definition.columns):
        if name == "TimeUS":
            rows[f"f{index}"] = time_us
        elif name in columns:
            rows[f"f{index}"] = columns[name]
    return rows


def _records(recorded: Recorded) -> list[tuple[npt.NDArray[np.int64], list[bytes]]]:
    imu, attitude, velocity, depth, actuators = (recorded.streams[name] for name in ("imu", "attitude", "velocity", "depth", "actuators"))
    degrees = {name: np.degrees(attitude[f"{symbol}_rad"]) for name, symbol in (("Roll", "phi"), ("Pitch", "theta"), ("Yaw", "psi"))}
    degrees["Yaw"] = np.remainder(degrees["Yaw"], 360.0)
    interval = np.diff(velocity["time_us"], prepend=2 * velocity["time_us"][0] - velocity["time_us"][1]) / 1e6
    interval = interval.astype(np.float32).astype(np.float64)
    tables: list[tuple[Definition, Mapping[str, Any], Any]] = [
        (
            IMU,
            {f"Gyr{axis.upper()}": imu[f"gyro_{axis}_rad_s"] for axis in "xyz"}
            | {f"Acc{axis.upper()}": imu[f"accel_{axis}_m_s2"] for axis in "xyz"}
            | {"GH": 1, "AH": 1, "T": 20.0},
            imu["time_us"],
        ),
        (ATT, {**degrees, "AEKF": 3}, attitude["time_us"]),
        (
            VISO,
            {"dt": interval, "conf": 100.0}
            | {f"PosD{name}": velocity[f"{axis}_m_s"] * interval for name, axis in zip("XYZ", "uvw", strict=True)},
            velocity["time_us"],
        ),
        (
            BARO,
            {"Alt": -depth["depth_m"], "AltAMSL": -depth["depth_m"], "H": 1, "SMS": depth["time_us"] // 1000, "Temp": 1000}
            | {"Press": STANDARD_PRESSURE_PA + FRESH_WATER_PA_M * depth["depth_m"]},
            depth["time_us"],
        ),
        (
            ACTU,
            {"RevS": actuators["propeller_rev_s"]} | {f"Fin{name.upper()}": actuators[f"fin_{name}_rad"] for name in "spbt"},
            actuators["time_us"],
        ),
    ]
    blocks = []
    for definition, columns, time_us in tables:
        data, size = _rows(definition, columns, time_us).tobytes(), definition.length
        blocks.append((np.asarray(time_us), [data[start : start + size] for start in range(0, len(data), size)]))
    return blocks
