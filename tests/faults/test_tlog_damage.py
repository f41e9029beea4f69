"""Named damage to telemetry logs: what must stay, what must be counted, and how the
file is judged.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.tlog.byte_account import explain
from auvid.stages.ingest.formats.tlog.clock import implausible
from auvid.stages.ingest.formats.tlog.reader import TLOG
from tests.support.mutate import mutations
from tests.support.tlog_records import START_US, attitude, frame, heartbeat, log, stamped

SMALL = (Path(__file__).parents[1] / "data" / "bluerov2_ugps_small" / "small.tlog").read_bytes()
FRAMES = [heartbeat(), *(attitude(number) for number in range(1, 100))]
RECORD = 8 + len(FRAMES[1])
FIRST = 8 + len(FRAMES[0])


def read(data: bytes) -> DecodedLog:
    decoded = TLOG.read(RawFile("log.tlog", np.frombuffer(data, dtype=np.uint8)))
    account = decoded.account
    assert (
        account.record_bytes + account.definition_bytes + account.skipped_bytes
        == account.size
        == len(data)
    )
    return decoded


def boots(decoded: DecodedLog) -> list[int]:
    return [int(value) for value in decoded.messages["ATTITUDE"].columns["time_boot_ms"]]


def reasons(decoded: DecodedLog) -> dict[str, tuple[int, int]]:
    return {part.reason: (part.count, part.bytes) for part in decoded.account.skipped}


def at(number: int) -> int:
    """Offset of ATTITUDE record `number`."""
    return FIRST + (number - 1) * RECORD


def edited(offset: int, new: bytes, *, old: int | None = None) -> bytes:
    data = log(FRAMES)
    return data[:offset] + new + data[offset + (len(new) if old is None else old) :]


def test_payload_bit_flipped() -> None:
    data = bytearray(log(FRAMES))
    data[at(40) + 25] ^= 4
    decoded = read(bytes(data))
    assert boots(decoded) == [number for number in range(1, 100) if number != 40]
    assert reasons(decoded) == {"CRC mismatch": (1, RECORD)}
    assert decoded.status == "damaged"
    assert decoded.seconds_lost == 0.0
    assert "system 1 component 1: wrong checksum, not read: 1 ATTITUDE" in decoded.notes


@pytest.mark.parametrize(("frames", "status"), [(1100, "complete"), (900, "damaged")])
def test_one_broken_frame_of_a_thousand_is_no_damage_of_the_file(frames: int, status: str) -> None:
    """Links lose frames; a ground station's own heartbeat may be one of them."""
    data = bytearray(log([heartbeat(), *(attitude(number) for number in range(1, frames))]))
    data[at(40) + 25] ^= 4
    decoded = read(bytes(data))
    assert (decoded.status, reasons(decoded)) == (status, {"CRC mismatch": (1, RECORD)})
    assert "system 1 component 1: wrong checksum, not read: 1 ATTITUDE" in decoded.notes


def test_block_overwritten_loses_only_what_it_touches() -> None:
    decoded = read(edited(at(40) + 10, b"\xfd\xfe\x00" * 40))
    touched = {*range(40, 40 + -(-(130) // RECORD))}
    assert boots(decoded) == [number for number in range(1, 100) if number not in touched]
    assert reasons(decoded) == {"garbage between frames": (1, len(touched) * RECORD)}
    assert decoded.seconds_lost == pytest.approx(0.02 * (len(touched) + 1))


def test_bytes_inserted_and_removed() -> None:
    inserted = read(edited(at(40), b"garbage", old=0))
    assert boots(inserted) == list(range(1, 100))
    assert reasons(inserted) == {"garbage between frames": (1, 7)}
    removed = read(edited(at(40) + 3, b"", old=9))
    assert boots(removed) == [number for number in range(1, 100) if number != 40]
    assert reasons(removed) == {"garbage between frames": (1, RECORD - 9)}


@pytest.mark.parametrize("left", [1, 5, 9, 17, 30, RECORD - 1])
def test_cut_inside_the_last_record(left: int) -> None:
    decoded = read(log(FRAMES)[: at(99) + left])
    assert boots(decoded) == list(range(1, 99))
    assert reasons(decoded) == {"cut at end of file": (1, left)}
    assert decoded.status == "truncated"
    assert decoded.seconds_lost == 0.0


def test_zeros_at_the_end_are_a_truncation_and_zeros_inside_are_damage() -> None:
    ended = read(log(FRAMES) + bytes(4096))
    assert boots(ended) == list(range(1, 100))
    assert reasons(ended) == {"zeros at end of file": (1, 4096)}
    assert ended.status == "truncated"
    inside = read(edited(at(40), bytes(3 * RECORD)))
    assert boots(inside) == [number for number in range(1, 100) if number not in (40, 41, 42)]
    assert reasons(inside) == {"garbage between frames": (1, 3 * RECORD)}
    assert inside.seconds_lost == pytest.approx(0.08)


@pytest.mark.parametrize("number", [1, 2, 50, 98, 99])
@pytest.mark.parametrize(
    "stamp", [struct.pack(">Q", START_US + 3_000_000_000_000), b"\xff" * 8, bytes(8)]
)
def test_time_stamp_destroyed(number: int, stamp: bytes) -> None:
    decoded = read(edited(at(number), stamp))
    assert boots(decoded) == [each for each in range(1, 100) if each != number]
    assert reasons(decoded) == {"implausible time stamp": (1, RECORD)}
    assert decoded.status == "damaged"


def test_several_stamps_in_a_row_destroyed() -> None:
    data = bytearray(log(FRAMES))
    for number in range(30, 50):
        data[at(number) : at(number) + 8] = b"\xee" * 8
    decoded = read(bytes(data))
    assert boots(decoded) == [*range(1, 30), *range(50, 100)]
    assert reasons(decoded) == {"implausible time stamp": (20, 20 * RECORD)}


@pytest.mark.parametrize("step_s", [-5.0, -0.7, -4e8, 7200.0])
def test_clock_step_is_a_note_and_loses_nothing(step_s: float) -> None:
    frames = [attitude(number) for number in range(1, 401)]
    later = START_US + 200 * 20_000 + int(step_s * 1e6)
    decoded = read(log([heartbeat(), *frames[:200]]) + log(frames[200:], start_us=later))
    assert boots(decoded) == list(range(1, 401))
    assert decoded.status == "complete"
    assert any("clock goes" in note for note in decoded.notes) == (abs(step_s) > 1)


def test_clock_never_set() -> None:
    decoded = read(log(FRAMES, start_us=60_000_000))
    assert boots(decoded) == list(range(1, 100))
    assert "time stamps lie before the year 2000: the recorder's clock was not set" in decoded.notes


def test_records_a_little_out_of_order_are_kept() -> None:
    rng = np.random.default_rng(4)
    stamps = START_US + np.arange(2000) * 20_000 + rng.integers(-50_000, 50_000, 2000)
    assert not implausible(stamps).any()


def test_file_in_no_order_of_time_is_kept_whole() -> None:
    rng = np.random.default_rng(5)
    assert not implausible(START_US + rng.integers(0, 10**12, 500)).any()


def test_frame_inside_a_payload_is_no_record() -> None:
    inner = stamped(START_US + 1, attitude(77))
    carrier = frame("FILE_TRANSFER_PROTOCOL", bytes([0, 1, 1]) + inner + b"\x01" * 40)
    decoded = read(log([heartbeat(), attitude(1), carrier, attitude(2)]))
    assert boots(decoded) == [1, 2]
    assert decoded.account.skipped == ()


def test_many_unknown_messages_are_summed_up() -> None:
    frames = [frame(30_000 + number, b"x", crc_extra=1) for number in range(60)]
    decoded = read(log([heartbeat(), *frames, heartbeat()]))
    assert len(decoded.account.skipped) == 21
    assert sum(part.count for part in decoded.account.skipped) == 60


@pytest.mark.parametrize(
    "seeds",
    [range(40), pytest.param(range(40, 150), marks=pytest.mark.release)],
    ids=["40", "110 more"],
)
def test_every_untouched_record_survives_random_damage(seeds: range) -> None:
    source = SMALL[:120_000]
    intact = explain(np.frombuffer(source, dtype=np.uint8)).records
    contents = {
        source[start + 8 : stop]
        for start, stop in zip(intact.start.tolist(), intact.stop.tolist(), strict=True)
    }
    share = []
    for seed in seeds:
        data, kept = mutations(source, seed)
        damaged_log = read(data)
        records = explain(np.frombuffer(data, dtype=np.uint8)).records
        assert sum(damaged_log.counts.values()) == len(records)
        strangers = [
            data[start + 8 : stop]
            for start, stop in zip(records.start.tolist(), records.stop.tolist(), strict=True)
        ]
        assert contents.issuperset(strangers), f"seed {seed} invents a record"
        expected = [
            intact.start[(intact.start >= part.start) & (intact.stop <= part.stop)]
            + (part.offset - part.start)
            for part in kept
        ]
        untouched = np.concatenate(expected)
        share.append(np.isin(untouched, records.start).mean())
    assert np.mean(share) >= 0.999
    assert min(share) >= 0.99


@pytest.mark.parametrize(
    "pattern",
    [
        b"\x00\x05\x00\x05\x00\x05\x00\x05\xfd",
        b"\x00\x05abcdef\xfe\xff",
        b"\xfd",
        b"\x00",
        b"\x00\x0e\xfd",
    ],
)
def test_hostile_patterns_give_no_records(pattern: bytes) -> None:
    decoded = read(pattern * (150_000 // len(pattern)))
    assert decoded.counts == {}


def test_a_damaged_message_id_is_damage_and_not_an_unknown_message() -> None:
    for bit in range(8):
        data = bytearray(log(FRAMES))
        data[at(40) + 8 + 9] ^= 1 << bit  # highest byte of the id
        decoded = read(bytes(data))
        assert reasons(decoded) == {"CRC mismatch": (1, RECORD)}
        assert decoded.status == "damaged"


def test_records_copied_to_another_place_are_kept_with_those_around_them() -> None:
    """A sound block of the file stands twice: the records have their checksum and a
    time of this log.
    """
    data = log(FRAMES)
    decoded = read(data[: at(20)] + data[at(70) : at(80)] + data[at(20) :])
    assert boots(decoded) == [*range(1, 20), *range(70, 80), *range(20, 100)]
    assert decoded.status == "complete"
