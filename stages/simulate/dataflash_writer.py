"""Write a log of the twin as ArduPilot DataFlash (.BIN).

As a vehicle would: definitions, units, then records in order of time.

IMU, ATT, BARO and VISO have the layouts of ArduSub 4.5 (single precision: 1e-7 of a
value, 2e-7 rad of attitude, enough to recover coefficients from sensors without noise).
Propeller and fins stand in a message of our own, ACTU, pulses in RCOU. Fields that the
twin does not know are 0; a log has the types of the streams that were recorded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats.dataflash import FMT, MAGIC, Definition, define
from auvid.hydro.constants import FRESH_WATER_KG_M3, STANDARD_GRAVITY, STANDARD_PRESSURE_PA
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.stages.simulate.sensing import Recorded

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
    "Y": "us",
    "v": "V",
    "A": "A",
    "w": "Ohm",
    "a": "Ah",
    "X": "W.h",
}
MULTIPLIERS = {"-": 0.0, "0": 1.0, "F": 1e-6, "C": 1e-3, "B": 1e-2}
FRESH_WATER_PA_M = FRESH_WATER_KG_M3 * STANDARD_GRAVITY

UNIT = define(117, "UNIT", "QbZ", "TimeUS,Id,Label")
MULT = define(118, "MULT", "Qbd", "TimeUS,Id,Mult")
FMTU = define(116, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
MSG = define(59, "MSG", "QZ", "TimeUS,Message")
IMU = define(
    164, "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
)
ATT = define(72, "ATT", "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF")
BARO = define(
    64, "BARO", "QBfffcfIffBf", "TimeUS,I,Alt,AltAMSL,Press,Temp,CRt,SMS,Offset,GndTemp,H,CPress"
)
VISO = define(168, "VISO", "Qffffffff", "TimeUS,dt,AngDX,AngDY,AngDZ,PosDX,PosDY,PosDZ,conf")
ACTU = define(200, "ACTU", "Qfffff", "TimeUS,RevS,FinS,FinP,FinB,FinT")
BAT = define(
    208,
    "BAT",
    "QBfffffcfBBB",
    "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct,H,SH",
)
MODE = define(209, "MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn")
ARM = define(210, "ARM", "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method")
PARM = define(71, "PARM", "QNff", "TimeUS,Name,Value,Default")
RCOU = define(
    132, "RCOU", "QHHHHHHHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10,C11,C12,C13,C14"
)
COMMON: tuple[tuple[Definition, str, str], ...] = (
    (FMT, "", ""),
    (UNIT, "s--", "F--"),
    (MULT, "s--", "F--"),
    (FMTU, "s---", "F---"),
    (MSG, "s-", "F-"),
)
OF_PARAMETERS: tuple[Definition, str, str] = (PARM, "s---", "F---")
OF_STREAMS: tuple[tuple[Definition, str, str], ...] = (
    (IMU, "s#EEEooo--O--zz", "F-000000--0--00"),
    (ATT, "sdddddd-", "F000000-"),
    (BARO, "s#mmPOnsmO-P", "F-000-0C00-0"),
    (VISO, "ssdddmmm%", "F00000000"),
    (ACTU, "szrrrr", "F00000"),
    (RCOU, "sYYYYYYYYYYYYYY", "F--------------"),
    (BAT, "s#vvAaXOw%--", "F-000CF00---"),
    (MODE, "s---", "F---"),
    (ARM, "s----", "F----"),
)
"""Every message type with the letters of its units and multipliers."""


def write_dataflash(recorded: Recorded) -> bytes:
    """Return the log as bytes.

    Records with equal times keep the order MSG, PARM, IMU, ATT, VISO, BARO, ACTU, RCOU,
    BAT, MODE, ARM.
    """
    tables = _tables(recorded)
    present = {definition.id for definition, *_ in tables}
    types = [*COMMON, *(item for item in OF_STREAMS if item[0].id in present)]
    types += [OF_PARAMETERS] if recorded.parameters else []
    head = b"".join(item.pack() for item, _, _ in types)
    used = {key for _, units, _ in types for key in units}
    letters = [
        _rows(UNIT, {"Id": [ord(key)], "Label": [text.encode()]}, _start())
        for key, text in UNITS.items()
        if key in used
    ]
    letters += [
        _rows(MULT, {"Id": [ord(key)], "Mult": [value]}, _start())
        for key, value in MULTIPLIERS.items()
    ]
    letters += [
        _rows(
            FMTU,
            {"FmtType": [item.id], "UnitIds": [units.encode()], "MultIds": [factors.encode()]},
            _start(),
        )
        for item, units, factors in types
        if units
    ]
    words = _rows(MSG, {"Message": [recorded.text.encode()[:64]]}, _start())
    parameters = [
        _rows(PARM, {"Name": [name.encode()], "Value": [value], "Default": [np.nan]}, _start())
        for name, value in recorded.parameters.items()
    ]
    return (
        head
        + words.tobytes()
        + b"".join(item.tobytes() for item in parameters)
        + b"".join(item.tobytes() for item in letters)
        + in_order(_records(tables))
    )


def in_order(blocks: list[tuple[npt.NDArray[np.int64], list[bytes]]]) -> bytes:
    """Return records of several types in order of time.

    Times (n,) and bytes of each; types keep their order at equal times.
    """
    times = np.concatenate([when for when, _ in blocks])
    records = [item for _, items in blocks for item in items]
    return b"".join(records[index] for index in np.argsort(times, kind="stable"))


Columns = Mapping[str, npt.NDArray[Any]]
RecordColumns = Mapping[str, npt.NDArray[Any] | Sequence[float | bytes] | float]
"""Columns of a message type; a number stands in every record."""
TypedColumns = tuple[Definition, RecordColumns]


def _start() -> npt.NDArray[np.int64]:
    return np.array([START_US])


def _rows(
    definition: Definition, columns: RecordColumns, time_us: npt.NDArray[np.int64]
) -> npt.NDArray[np.void]:
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


def _tables(
    recorded: Recorded,
) -> list[tuple[Definition, RecordColumns, npt.NDArray[np.int64]]]:
    """Message type, columns and times of each stream that there is."""
    tables = []
    for stream, table in (
        ("imu", _imu),
        ("attitude", _attitude),
        ("velocity", _velocity),
        ("depth", _depth),
        ("actuators", _actuators),
        ("battery", _battery),
        ("mode", _mode),
    ):
        if stream in recorded.streams:
            columns = recorded.streams[stream]
            tables.append((*table(columns), np.asarray(columns["time_us"])))
    if "mode" in recorded.streams:
        tables.append((ARM, {"ArmState": 1}, _start()))
    return tables


def _imu(imu: Columns) -> TypedColumns:
    gyro = {f"Gyr{axis.upper()}": imu[f"gyro_{axis}_rad_s"] for axis in "xyz"}
    return IMU, gyro | {f"Acc{axis.upper()}": imu[f"accel_{axis}_m_s2"] for axis in "xyz"} | {
        "GH": 1,
        "AH": 1,
        "T": 20.0,
    }


def _attitude(attitude: Columns) -> TypedColumns:
    degrees = {
        name: np.degrees(attitude[f"{symbol}_rad"])
        for name, symbol in (("Roll", "phi"), ("Pitch", "theta"), ("Yaw", "psi"))
    }
    degrees["Yaw"] = np.remainder(degrees["Yaw"], 360.0)
    return ATT, {**degrees, "AEKF": 3}


def _velocity(velocity: Columns) -> TypedColumns:
    interval = (
        np.diff(velocity["time_us"], prepend=2 * velocity["time_us"][0] - velocity["time_us"][1])
        / 1e6
    )
    interval = interval.astype(np.float32).astype(np.float64)
    moved = {
        f"PosD{name}": velocity[f"{axis}_m_s"] * interval
        for name, axis in zip("XYZ", "uvw", strict=True)
    }
    return VISO, {"dt": interval, "conf": 100.0, **moved}


def _depth(depth: Columns) -> TypedColumns:
    below = depth["depth_m"]
    return BARO, {
        "Alt": -below,
        "AltAMSL": -below,
        "H": 1,
        "SMS": depth["time_us"] // 1000,
        "Temp": 1000,
        "Press": STANDARD_PRESSURE_PA + FRESH_WATER_PA_M * below,
    }


def _actuators(actuators: Columns) -> TypedColumns:
    pulses = {
        f"C{name.split('_')[1]}": values
        for name, values in actuators.items()
        if name.startswith("pwm_")
    }
    if pulses:
        return RCOU, pulses
    return ACTU, {"RevS": actuators["propeller_rev_s"]} | {
        f"Fin{name.upper()}": actuators[f"fin_{name}_rad"] for name in "spbt"
    }


def _battery(battery: Columns) -> TypedColumns:
    """Return the current drawn so far is summed from that of the samples."""
    hours = np.diff(battery["time_us"], prepend=battery["time_us"][0]) / 3.6e9
    return BAT, {
        "Volt": battery["voltage_v"],
        "VoltR": battery["voltage_v"],
        "Curr": battery["current_a"],
        "CurrTot": 1000.0 * np.cumsum(hours * battery["current_a"]),
        "EnrgTot": np.cumsum(hours * battery["current_a"] * battery["voltage_v"]),
        "RemPct": 255,
        "H": 1,
    }


def _mode(mode: Columns) -> TypedColumns:
    return MODE, {"Mode": mode["mode"], "ModeNum": mode["mode"], "Rsn": 1}


def _records(
    tables: list[tuple[Definition, RecordColumns, npt.NDArray[np.int64]]],
) -> list[tuple[npt.NDArray[np.int64], list[bytes]]]:
    blocks = []
    for definition, columns, time_us in tables:
        data, size = _rows(definition, columns, time_us).tobytes(), definition.length
        blocks.append(
            (time_us, [data[start : start + size] for start in range(0, len(data), size)])
        )
    return blocks
