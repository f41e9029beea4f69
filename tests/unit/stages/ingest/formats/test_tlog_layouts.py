"""Payload layouts and checksums against pymavlink, message by message."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from auvid.data_schemas.formats import mavlink
from auvid.stages.ingest.formats.tlog.byte_account import explain
from auvid.stages.ingest.formats.tlog.columns import decode
from tests.support.tlog_records import frame, log


def assert_equal_to_message(columns: dict[str, np.ndarray], row: int, message: object) -> None:
    """All fields of a pymavlink message equal one row; floats bit by bit up to the sign
    of NaN.
    """
    for field in message.get_fieldnames():  # type: ignore[attr-defined]
        ours = columns[field][row]
        theirs = getattr(message, field)
        if isinstance(theirs, (str, bytes)):
            raw = getattr(message, f"_{field}_raw", theirs)
            raw = raw if isinstance(raw, bytes) else raw.encode("latin-1")
            assert bytes(ours) == raw.split(b"\x00")[0], field
        else:
            np.testing.assert_array_equal(ours, theirs, err_msg=field)


@pytest.mark.parametrize("version", [1, 2])
def test_every_message_decodes_as_pymavlink_does(version: int) -> None:
    rng = np.random.default_rng(version)
    parser = ardupilotmega.MAVLink(None)
    for number, definition in ardupilotmega.mavlink_map.items():
        if version == 1 and number > 255:
            continue
        layout = mavlink.layout(number)
        size = definition.unpacker.size
        assert layout.dtype.itemsize == size
        assert layout.crc_extra == definition.crc_extra
        assert [name for name, *_ in layout.columns] == definition.fieldnames
        payloads = [
            rng.bytes(size),
            bytes(size),
            rng.bytes(max(size // 2, 1)),
            rng.bytes(size - 1) + b"\x00",
        ]
        frames = [frame(number, payload, version=version) for payload in payloads if payload]
        account = explain(np.frombuffer(log(frames), dtype=np.uint8))
        assert len(account.records) == len(frames)
        assert account.status == "complete"
        table = decode(np.frombuffer(log(frames), dtype=np.uint8), account.records, layout)
        for row, content in enumerate(frames):
            assert_equal_to_message(dict(table.columns), row, parser.decode(bytearray(content)))


def test_checksum_of_the_x25_test_vector() -> None:
    # CRC-16/MCRF4XX (X.25 without the final inversion) of "123456789" is 0x6F91; the
    # last byte goes in as crc_extra.
    assert mavlink.checksum(b"12345678", ord("9")) == 0x6F91


def test_checksums_of_all_lengths_equal_the_scalar_one() -> None:
    rng = np.random.default_rng(3)
    buffer = rng.integers(0, 256, 40_000, dtype=np.uint8)
    start = np.concatenate([np.arange(20), rng.integers(0, 39_000, 600)])
    stop = start + np.concatenate([np.arange(1, 21), rng.integers(1, 265, 600)])
    extra = rng.integers(0, 256, start.size, dtype=np.uint8)
    expected = [
        mavlink.checksum(buffer[a:b].tobytes(), int(c))
        for a, b, c in zip(start, stop, extra, strict=True)
    ]
    np.testing.assert_array_equal(mavlink.checksums(buffer, start, stop, extra), expected)
    assert mavlink.checksums(buffer[:5], start[:0], stop[:0], extra[:0]).size == 0


def test_units_are_those_of_the_definition() -> None:
    assert mavlink.layout(30).units["roll"] == "rad"
    assert mavlink.layout(74).units["groundspeed"] == "m/s"
