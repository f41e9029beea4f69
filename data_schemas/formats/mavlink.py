"""MAVLink 1 and 2 frames as bytes: headers, checksum and payload layouts.

Shared by the telemetry reader and writer.

A telemetry log repeats [8-byte big-endian Unix time in microseconds][frame]. A frame is
magic, header, payload, checksum (2 bytes), and, in MAVLink 2 with incompatibility flag
1, a signature (13 bytes). The checksum is X.25 (polynomial 0x1021 reflected, start
0xFFFF) over everything between magic and checksum, plus one byte that depends on the
message definition (`crc_extra`). Source: MAVLink developer guide, "Packet
Serialization". Layouts come from pymavlink's ardupilotmega dialect, imported when first
needed (it takes about half a second).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Checksums = npt.NDArray[np.uint16]
Integers = npt.NDArray[np.int64]

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
STAMP_BYTES = 8
CHECKSUM_BYTES = 2
SIGNATURE_BYTES = 13
SIGNED_FLAG = 1
CHECKSUM_START = 0xFFFF
LARGEST_PAYLOAD = 255
AUTOPILOT_INVALID = 8
AUTOPILOT_PX4 = 12

STAMPED_HEADER_V1 = np.dtype(
    [
        ("stamp", ">u8"),
        ("magic", "u1"),
        ("length", "u1"),
        ("sequence", "u1"),
        ("system", "u1"),
        ("component", "u1"),
        ("id", "u1"),
    ]
)
STAMPED_HEADER_V2 = np.dtype(
    [
        ("stamp", ">u8"),
        ("magic", "u1"),
        ("length", "u1"),
        ("incompatible", "u1"),
        ("compatible", "u1"),
        ("sequence", "u1"),
        ("system", "u1"),
        ("component", "u1"),
        ("id_low", "<u2"),
        ("id_high", "u1"),
    ]
)
HEADER_BYTES_V2 = STAMPED_HEADER_V2.itemsize - STAMP_BYTES


def _byte_table() -> Checksums:
    state = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        state = np.where(state & 1, (state >> 1) ^ 0x8408, state >> 1).astype(np.uint16)
    return state


_BYTE_TABLE = _byte_table()
_BYTES: list[int] = _BYTE_TABLE.tolist()
_FEW = 40
"""Frames for which the compiled loop is not worth loading."""


def checksum(data: bytes, crc_extra: int) -> int:
    """Checksum of one frame: `data` is header and payload without the magic byte."""
    return _state(data + bytes([crc_extra]))


def _state(data: bytes) -> int:
    state = CHECKSUM_START
    for byte in data:
        state = _BYTES[(state ^ byte) & 0xFF] ^ (state >> 8)
    return state


def _four_bytes() -> Checksums:
    """Return the states (4, 256) that one byte leaves k zero bytes later."""
    rows = [_BYTE_TABLE]
    for _ in range(3):
        rows.append(_step(rows[-1], np.zeros(256, dtype=np.uint8)))
    return np.stack(rows)


def checksums(buffer: Bytes, start: Integers, stop: Integers, crc_extra: Bytes) -> Checksums:
    """Return the checksums of many frames.

    They cover bytes start:stop of the buffer (after the magic byte, up to the
    checksum), plus crc_extra.
    """
    return _step(_states(buffer, start, stop), crc_extra)


def implied_crc_extras(
    buffer: Bytes, start: Integers, stop: Integers, stored: Checksums
) -> npt.NDArray[np.int16]:
    """Return the crc_extra that makes the checksum of each frame the stored one.

    It is -1 where none does (255 of 256 damaged frames).
    """
    state = _states(buffer, start, stop)
    entry = np.full(1 << 16, -1, dtype=np.int16)
    entry[_BYTE_TABLE] = np.arange(256)
    index = entry[stored ^ (state >> np.uint16(8))]
    return np.where(index < 0, np.int16(-1), index ^ (state & np.uint16(0xFF)).astype(np.int16))


def _states(buffer: Bytes, start: Integers, stop: Integers) -> Checksums:
    """Return the checksum states (n,) after bytes start:stop."""
    out = np.empty(start.size, dtype=np.uint16)
    if start.size < _FEW:
        for row in range(start.size):
            out[row] = _state(buffer[start[row] : stop[row]].tobytes())
        return out
    from auvid.data_schemas.formats.compiled_mavlink import checksum_states

    readable = buffer.view()
    readable.flags.writeable = False  # numba compiles once more for what can be written to
    checksum_states(readable, start, stop, _four_bytes(), CHECKSUM_START, out)
    return out


def _step(state: Checksums, byte: Bytes) -> Checksums:
    result: Checksums = _BYTE_TABLE[(state ^ byte) & np.uint16(0xFF)] ^ (state >> np.uint16(8))
    return result


@dataclass(frozen=True)
class MessageLayout:
    """The payload of one message type.

    `dtype` is the full payload with extension fields, in wire order; `columns` are
    name, shape of one value and element type in the order of the definition; `units`
    the unit texts of the definition; `text` names the character arrays.
    """

    id: int
    name: str
    crc_extra: int
    dtype: np.dtype[np.void]
    columns: tuple[tuple[str, tuple[int, ...], np.dtype[Any]], ...]
    text: frozenset[str]
    units: Mapping[str, str]


@lru_cache(maxsize=1)
def definitions() -> Mapping[int, Any]:
    """Return the message classes of the dialect by message id."""
    from pymavlink.dialects.v20 import ardupilotmega

    table: Mapping[int, Any] = ardupilotmega.mavlink_map
    return table


@lru_cache(maxsize=1)
def crc_extras() -> npt.NDArray[np.int16]:
    """Return crc_extra by message id, -1 where the id is not defined.

    Ids beyond the end are not defined either.
    """
    dialect = definitions()
    table = np.full(max(dialect) + 2, -1, dtype=np.int16)
    for number, message in dialect.items():
        table[number] = message.crc_extra
    return table


@lru_cache(maxsize=1)
def ids_by_name() -> Mapping[str, int]:
    """Message ids by message name."""
    return {str(message.msgname): number for number, message in definitions().items()}


@lru_cache(maxsize=512)
def layout(message_id: int) -> MessageLayout:
    """The layout of a defined message (KeyError if the dialect has no such id)."""
    message = definitions()[message_id]
    codes = bytes(message.native_format).decode("ascii")[1:]
    fields: list[tuple[Any, ...]] = []
    text = set()
    for name, code, size in zip(
        message.ordered_fieldnames, codes, message.array_lengths, strict=True
    ):
        if code == "c":
            text.add(name)
            fields.append((name, f"S{max(size, 1)}"))
        elif size:
            fields.append((name, f"<{_NUMPY_CODE[code]}", (size,)))
        else:
            fields.append((name, f"<{_NUMPY_CODE[code]}"))
    dtype = np.dtype(fields)
    return MessageLayout(
        id=message_id,
        name=str(message.msgname),
        crc_extra=int(message.crc_extra),
        dtype=dtype,
        columns=tuple((name, dtype[name].shape, dtype[name].base) for name in message.fieldnames),
        text=frozenset(text),
        units=dict(message.fieldunits_by_name),
    )


_NUMPY_CODE = {
    "b": "i1",
    "B": "u1",
    "h": "i2",
    "H": "u2",
    "i": "i4",
    "I": "u4",
    "q": "i8",
    "Q": "u8",
    "f": "f4",
    "d": "f8",
}
