"""Telemetry records made byte by byte, for tests of the reader; independent of the
reader's own scan.
"""

from __future__ import annotations

import struct

from auvid.data_schemas.formats import mavlink

START_US = 1_700_000_000_000_000


def frame(
    message: int | str,
    payload: bytes,
    *,
    version: int = 2,
    system: int = 1,
    component: int = 1,
    sequence: int = 0,
    signed: bool = False,
    crc_extra: int | None = None,
) -> bytes:
    """One MAVLink frame; version 2 cuts trailing zeros of the payload, as the protocol
    asks.
    """
    number = mavlink.ids_by_name()[message] if isinstance(message, str) else message
    extra = int(mavlink.crc_extras()[number]) if crc_extra is None else crc_extra
    if version == 1:
        head = struct.pack("<BBBBB", len(payload), sequence, system, component, number)
        magic = mavlink.MAGIC_V1
    else:
        payload = payload.rstrip(b"\x00") or payload[:1]
        head = struct.pack(
            "<BBBBBBHB",
            len(payload),
            int(signed),
            0,
            sequence,
            system,
            component,
            number & 0xFFFF,
            number >> 16,
        )
        magic = mavlink.MAGIC_V2
    body = head + payload
    return (
        bytes([magic])
        + body
        + struct.pack("<H", mavlink.checksum(body, extra))
        + (b"S" * 13 if signed and version == 2 else b"")
    )


def stamped(time_us: int, content: bytes) -> bytes:
    """A record: time stamp and frame."""
    return struct.pack(">Q", time_us) + content


def heartbeat(*, system: int = 1, component: int = 1, autopilot: int = 3, kind: int = 12) -> bytes:
    """A HEARTBEAT frame: custom_mode, type, autopilot, base_mode, system_status,
    mavlink_version.
    """
    return frame(
        "HEARTBEAT",
        struct.pack("<IBBBBB", 19, kind, autopilot, 81, 4, 3),
        system=system,
        component=component,
    )


def attitude(time_boot_ms: int, roll: float = 0.25, **header: int) -> bytes:
    """An ATTITUDE frame."""
    return frame(
        "ATTITUDE", struct.pack("<I6f", time_boot_ms, roll, -0.5, 1.0, 0.0, 0.0, 0.125), **header
    )  # type: ignore[arg-type]


def log(frames: list[bytes], *, start_us: int = START_US, step_us: int = 20_000) -> bytes:
    """Records at a constant rate."""
    return b"".join(
        stamped(start_us + number * step_us, content) for number, content in enumerate(frames)
    )
