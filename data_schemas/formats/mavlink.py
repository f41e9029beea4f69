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
HEADER_BYTES_V1 = STAMPED_HEADER_V1.itemsize - STAMP_BYTES
HEADER_BYTES_V2 = STAMPED_HEADER_V2.itemsize - STAMP_BYTES


def _byte_table() -> Checksums:
    state = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        state = np.where(state & 1, (state >> 1) ^ 0x8408, state >> 1).astype(np.uint16)
    return state


def _word_table(table: Checksums) -> Checksums:
    state = np.arange(65536, dtype=np.uint16)
    for _ in range(2):
        state = table[state & 0xFF] ^ (state >> 8)
    return state


_BYTE_TABLE = _byte_table()
_BYTES: list[int] = _BYTE_TABLE.tolist()
_WORD_TABLE = _word_table(_BYTE_TABLE)
_BATCH = 1 << 16
"""Frames that advance together; each batch takes as many steps as its longest frame."""
_BLOCK_BYTES = 32
_BLOCK_WORDS = _BLOCK_BYTES // 2
_LEFT_IN_BLOCK = np.where(
    np.arange(_BLOCK_BYTES) >= np.arange(_BLOCK_BYTES)[:, None], 0xFF, 0
).astype(np.uint8)
_PART_MASKS = np.ascontiguousarray(
    _LEFT_IN_BLOCK.view(np.uint64).T
)  # of each eight bytes of a block, by the number of bytes to clear
_FEW = 40  # frames that one look-up per byte has done before the blocks are set up
_LONGEST_CHECKED = 9 + LARGEST_PAYLOAD


def checksum(data: bytes, crc_extra: int) -> int:
    """Checksum of one frame: `data` is header and payload without the magic byte."""
    return _state(data + bytes([crc_extra]))


def _state(data: bytes) -> int:
    state = CHECKSUM_START
    for byte in data:
        state = _BYTES[(state ^ byte) & 0xFF] ^ (state >> 8)
    return state


def _start_by_length() -> Checksums:
    state = np.full(_LONGEST_CHECKED + 1, CHECKSUM_START, dtype=np.uint16)
    for length in range(1, state.size):
        state[length] = _BYTE_TABLE[state[length - 1] & 0xFF] ^ (state[length - 1] >> 8)
    return state


_START_BY_LENGTH = _start_by_length()


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
    """Checksum states after bytes start:stop.

    All frames advance together, two bytes per table look-up, in blocks that end where
    the frame ends. The checksum is linear over bits: zeros before the first byte change
    nothing when the state starts at zero, and the true start is added by length at the
    end.
    """
    out = np.empty(start.size, dtype=np.uint16)
    early = (
        stop - start
    ) % -_BLOCK_BYTES + start < 0  # their first block would begin before the file
    if start.size < _FEW:
        early[:] = True
    if early.any():
        for row in np.flatnonzero(early).tolist():
            out[row] = _state(buffer[start[row] : stop[row]].tobytes())
        if not early.all():
            out[~early] = _states(buffer, start[~early], stop[~early])
        return out
    blocks = np.ndarray(
        (max(buffer.size - _BLOCK_BYTES + 1, 0),),
        np.dtype(f"V{_BLOCK_BYTES}"),
        buffer=buffer,
        strides=(1,),
    )
    for first in range(0, start.size, _BATCH):
        part = slice(first, first + _BATCH)
        out[part] = _checksum_batch(blocks, start[part], stop[part])
    out ^= _START_BY_LENGTH[stop - start]
    return out


def _checksum_batch(blocks: npt.NDArray[np.void], start: Integers, stop: Integers) -> Checksums:
    """Return checksum states from a zero start, without crc_extra.

    Longer frames come first, so that those still waiting stand at the end.
    """
    size = (stop - start).astype(np.uint16)
    words = ((size + np.uint16(1)) >> np.uint16(1)).astype(np.uint8)
    order = np.argsort(words, kind="stable")[::-1]
    words = words[order]
    in_blocks = np.int64(_BLOCK_BYTES) * (
        (words + np.uint8(_BLOCK_WORDS - 1)) // np.uint8(_BLOCK_WORDS)
    )
    missing = in_blocks - size[order]
    at = stop[order] - in_blocks
    state, mixed = np.zeros((2, order.size), dtype=np.uint16)
    reached = [
        *np.cumsum(np.bincount(words, minlength=1)[::-1])[::-1].tolist(),
        *[0] * _BLOCK_WORDS,
    ]  # frames with so many words or more
    running, most = 0, int(in_blocks[0]) // 2 if words.size else 0
    for left in range(most, 0, -_BLOCK_WORDS):
        active = reached[left - _BLOCK_WORDS + 1]
        content = blocks[at[:active]].view(np.uint64).reshape(active, _BLOCK_BYTES // 8)
        for number, masks in enumerate(_PART_MASKS):
            begun = reached[left - 4 * number - 3]
            part = content[:begun, number]
            part[running:] &= masks.take(missing[running:begun])
            for word, column in enumerate(part[:, None].view("<u2").T):
                count = reached[left - 4 * number - word]
                np.bitwise_xor(state[:count], column[:count], out=mixed[:count])
                _WORD_TABLE.take(mixed[:count], out=state[:count], mode="clip")
        at[:active] += _BLOCK_BYTES
        running = active
    result = np.empty_like(state)
    result[order] = state
    return result


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
    """The message classes of the dialect by message id."""
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
