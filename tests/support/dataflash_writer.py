"""A small writer of DataFlash logs for tests, independent of auvid's own layout tables."""

from __future__ import annotations

import struct

PACKING = {
    "a": "32h",
    "b": "b",
    "B": "B",
    "h": "h",
    "H": "H",
    "i": "i",
    "I": "I",
    "q": "q",
    "Q": "Q",
    "g": "e",
    "f": "f",
    "d": "d",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
    "M": "b",
}
HEADER = b"\xa3\x95"
UNITS = {"s": "s", "d": "deg", "m": "m", "E": "rad/s", "#": "instance"}
MULTIPLIERS = {"-": 0.0, "0": 1.0, "B": 1e-2, "F": 1e-6, "J": 2.5}


def fmt(id: int, name: str, formats: str, columns: str, length: int | None = None) -> bytes:
    """A FMT record; `length` overrides the true record length."""
    size = (
        3 + struct.calcsize("<" + "".join(PACKING[char] for char in formats))
        if length is None
        else length
    )
    texts = struct.pack("<4s16s64s", name.encode(), formats.encode(), columns.encode())
    return HEADER + bytes([128, id, size]) + texts


def record(id: int, formats: str, *values: object) -> bytes:
    """A record with the stored (unscaled) values; an array field takes 32 values."""
    flat: list[object] = []
    for char, value in zip(formats, values, strict=True):
        flat += list(value) if char == "a" else [value]  # type: ignore[call-overload]
    return (
        HEADER + bytes([id]) + struct.pack("<" + "".join(PACKING[char] for char in formats), *flat)
    )


def unit_records(fmtu: dict[int, tuple[str, str]]) -> bytes:
    """FMTU, UNIT and MULT with their definitions: `fmtu` maps a type id to its unit and
    multiplier letters.
    """
    out = fmt(240, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    out += fmt(241, "UNIT", "QbZ", "TimeUS,Id,Label") + fmt(242, "MULT", "Qbd", "TimeUS,Id,Mult")
    for letter, label in UNITS.items():
        out += record(241, "QbZ", 1, ord(letter), label.encode())
    for letter, factor in MULTIPLIERS.items():
        out += record(242, "Qbd", 1, ord(letter), struct.unpack("f", struct.pack("f", factor))[0])
    for id, (units, multipliers) in fmtu.items():
        out += record(240, "QBNN", 1, id, units.encode(), multipliers.encode())
    return out


IMU = (10, "IMU", "QBf", "TimeUS,I,GyrX")
ATT = (11, "ATT", "Qcc", "TimeUS,Roll,Pitch")
BAR = (12, "BARO", "Qff", "TimeUS,Alt,Press")
HEADER_RECORDS = (
    fmt(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89)
    + fmt(*IMU)
    + fmt(*ATT)
    + fmt(*BAR)
)


def group(step: int) -> bytes:
    """One step of 0.1 s of a made-up dive: IMU, ATT and BARO."""
    time_us = 1_000_000 + 100_000 * step
    return (
        record(IMU[0], IMU[2], time_us, step % 2, step * 0.5)
        + record(ATT[0], ATT[2], time_us, step % 9000, -step % 9000)
        + record(BAR[0], BAR[2], time_us, -0.1 * step, 101325.0 + step)
    )


def dive(steps: int) -> bytes:
    """A made-up log: definitions, then `steps` groups of three records at 10 Hz."""
    return HEADER_RECORDS + b"".join(map(group, range(steps)))
