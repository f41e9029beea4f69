"""Small ULog files made message by message, and reading them."""

from __future__ import annotations

import struct

import numpy as np

from auvid.data_schemas.formats import ulog as layout
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.ulog.reader import ULOG

HEADER = layout.MAGIC + b"\x01" + struct.pack("<Q", 1_000_000)


def message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def declare(text: str) -> bytes:
    return message("F", text.encode())


def subscribe(id: int, topic: str, instance: int = 0) -> bytes:
    return message("A", struct.pack("<BH", instance, id) + topic.encode())


def data(id: int, payload: bytes) -> bytes:
    return message("D", struct.pack("<H", id) + payload)


def keyed(key: str, value: bytes) -> bytes:
    return bytes([len(key)]) + key.encode() + value


def text(time_us: int, words: str) -> bytes:
    return message("L", b"6" + struct.pack("<Q", time_us) + words.encode())


def sync() -> bytes:
    return message("S", layout.SYNC)


def flag_bits(*offsets: int, incompatible: int = 1) -> bytes:
    return message(
        "B",
        bytes(8) + bytes([incompatible]) + bytes(7) + struct.pack("<3Q", *(*offsets, 0, 0, 0)[:3]),
    )


DEPTH = declare("depth:uint64_t timestamp;float metres;uint8_t[4] _padding0;")


def depth(number: int, id: int = 0) -> bytes:
    """Record `number` of the topic `depth`, at 10 Hz from 1 s on: `number` metres."""
    return data(id, struct.pack("<Qf", 1_000_000 + 100_000 * number, number))


def depths(first: int, last: int, id: int = 0) -> bytes:
    return b"".join(depth(number, id) for number in range(first, last))


def read(raw: bytes, topics: frozenset[str] | None = None) -> DecodedLog:
    """Read, and check that every byte is accounted for and that what is given is
    consistent.
    """
    log = ULOG.read(RawFile("test.ulg", np.frombuffer(raw, np.uint8)), topics)
    account = log.account
    assert (
        account.size
        == len(raw)
        == account.record_bytes + account.definition_bytes + account.skipped_bytes
    )
    assert all(
        part.count > 0 and part.bytes > 0 and part.first_offset <= part.last_offset < len(raw)
        for part in account.skipped
    )
    for table in log.messages.values():
        assert len(table) == log.counts[table.name] > 0
        assert all(column.shape == (len(table),) for column in table.columns.values())
        assert (np.diff(table.offset) > 0).all()
    return log


def reasons(log: DecodedLog) -> dict[str, int]:
    """Skipped bytes by reason."""
    return {part.reason: part.bytes for part in log.account.skipped}
