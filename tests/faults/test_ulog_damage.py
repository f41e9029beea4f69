"""Damaged ULog files: what must stay, what must be accounted as lost, and files made to
mislead.
"""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from pyulog import ULog

from auvid.data_schemas.formats import ulog as layout
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.ulog import skipped_bytes
from tests.support.mutate import Kept, mutations
from tests.support.ulog_file import (
    DEPTH,
    HEADER,
    data,
    declare,
    depth,
    depths,
    flag_bits,
    keyed,
    message,
    read,
    reasons,
    subscribe,
    sync,
    text,
)

LOGS = Path(__file__).parents[1] / "data" / "px4_ulog"
START = HEADER + DEPTH + subscribe(0, "depth")
SIZE_BYTES = 2
RECORD = len(depth(0))

Ints = npt.NDArray[np.int64]


def metres(log: DecodedLog) -> list[float]:
    return log.messages["depth"].columns["metres"].tolist()


def test_truncated_anywhere() -> None:
    raw = START + depths(0, 3) + text(5, "ping") + sync() + depths(3, 5)
    for size in range(1, len(raw)):
        if size < len(layout.MAGIC):
            continue
        log = read(raw[:size])
        assert log.status in ("complete", "truncated")
        every_record = sum(log.counts.values())
        assert every_record == sum(
            size >= len(START) + RECORD * (n + 1) + (len(text(5, "ping") + sync()) if n >= 3 else 0)
            for n in range(5)
        )


def test_truncated_real_log_gives_all_that_pyulog_gives() -> None:
    raw = (LOGS / "sample_log_small.ulg").read_bytes()
    cut = raw[: len(raw) * 2 // 3 + 11]
    ours, theirs = read(cut), ULog(io.BytesIO(cut))
    assert ours.status == "truncated"
    assert list(reasons(ours)) == [skipped_bytes.CUT_OFF]
    assert sum(ours.counts.values()) == sum(
        item.data["timestamp"].size for item in theirs.data_list
    )


def test_blank_end_is_a_truncated_log() -> None:
    log = read(START + depths(0, 10) + bytes(4096))
    assert log.status == "truncated"
    assert metres(log) == list(range(10))
    assert reasons(log) == {skipped_bytes.BLANK_END: 4096}


def test_record_whose_end_is_blank_too_is_not_read() -> None:
    log = read(START + depths(0, 10)[:-2] + bytes(4096))
    assert log.status == "truncated"
    assert metres(log) == list(range(9))
    assert reasons(log) == {skipped_bytes.CUT_OFF: RECORD, skipped_bytes.BLANK_END: 4094}


def test_garbage_between_records_costs_no_record_that_follows() -> None:
    garbage = np.random.default_rng(5).bytes(700)
    log = read(START + depths(0, 100) + sync() + garbage + depths(150, 200))
    assert metres(log) == [*range(100), *range(150, 200)]
    assert reasons(log) == {skipped_bytes.DAMAGED: 700}
    assert log.status == "damaged"
    assert log.seconds_lost == pytest.approx(
        5.1, abs=0.01
    )  # s: from the last record before to the first behind


def test_record_whose_end_was_cut_away_is_not_read() -> None:
    """The record after it is damaged too: nothing begins at its end, nor inside it."""
    log = read(START + depths(0, 50) + depth(50)[:-2] + b"\x99" * 300 + depths(60, 100))
    assert metres(log) == [*range(50), *range(60, 100)]


def test_formats_that_come_behind_a_stray_subscription_are_used() -> None:
    log = read(HEADER + subscribe(0, "depth") + DEPTH + subscribe(0, "depth") + depths(0, 20))
    assert metres(log) == list(range(20))


def test_flag_bits_of_an_unlikely_size_swallow_nothing() -> None:
    broken = bytearray(flag_bits())
    broken[1] ^= 0x40
    log = read(HEADER + bytes(broken) + START[layout.HEADER_BYTES :] + depths(0, 2000))
    assert metres(log) == list(range(2000))


def test_known_records_between_many_of_unknown_number_are_read() -> None:
    unknown = b"".join(data(9, bytes([n]) * 30) for n in range(20))
    log = read(START + (unknown[:-5] + depth(1) + unknown) * 3)
    assert metres(log) == [1, 1, 1]


def test_record_that_lost_bytes_is_not_read() -> None:
    for lost in range(1, RECORD):
        undamaged = depth(50)
        log = read(START + depths(0, 50) + undamaged[: RECORD - lost] + depths(51, 100))
        left = RECORD - lost
        # A single byte that is left does not say whether it belongs to the record
        # before it: that one goes too.
        before = 50 if left >= SIZE_BYTES else 49
        assert metres(log) == [*range(before), *range(51, 100)]
        assert set(reasons(log)) == {skipped_bytes.DAMAGED}


@pytest.mark.parametrize("place", range(5))
def test_damaged_header_costs_its_own_record_only(place: int) -> None:
    for bit in range(8):
        broken = bytearray(depth(50))
        broken[place] ^= 1 << bit
        log = read(START + depths(0, 50) + bytes(broken) + depths(51, 100))
        assert metres(log) == [*range(50), *range(51, 100)]
        assert log.account.skipped_bytes == RECORD
        assert log.status == "damaged" or list(reasons(log)) == [skipped_bytes.UNKNOWN_TYPE]


def test_data_without_subscription_are_counted_and_the_chain_goes_on() -> None:
    raw = START + b"".join(depth(n) + data(7, bytes(20)) + data(8, bytes(31)) for n in range(50))
    log = read(raw)
    assert metres(log) == list(range(50))
    assert reasons(log) == {skipped_bytes.NO_SUBSCRIPTION: 50 * (25 + 36)}
    assert log.status == "damaged"
    assert log.seconds_lost == 0.0


def test_data_that_do_not_fit_their_format_are_counted() -> None:
    log = read(START + b"".join(depth(n) + data(0, bytes(13)) for n in range(50)))
    assert metres(log) == list(range(50))
    assert reasons(log) == {skipped_bytes.WRONG_SIZE: 50 * 18}


def test_definitions_that_look_right_but_stand_in_a_payload_do_not_count() -> None:
    inside = subscribe(0, "other") + subscribe(4, "depth")
    carrier = declare("other:uint64_t timestamp;double x;") + declare(
        f"carrier:uint64_t timestamp;uint8_t[{len(inside)}] bytes;"
    )
    carried = data(1, struct.pack("<Q", 9) + inside)
    log = read(
        HEADER
        + DEPTH
        + carrier
        + subscribe(0, "depth")
        + subscribe(1, "carrier")
        + depth(0)
        + carried * 3
        + depths(1, 4)
    )
    assert dict(log.counts) == {"depth": 4, "carrier": 3}
    assert log.status == "complete"


def test_damaged_beginning_is_passed() -> None:
    log = read(b"\0" * layout.HEADER_BYTES + START[layout.HEADER_BYTES :] + depths(0, 20))
    assert metres(log) == list(range(20))
    assert log.status == "damaged"
    log = read(HEADER + b"\xff" * 40 + START[layout.HEADER_BYTES :] + depths(0, 20))
    assert metres(log) == list(range(20))
    assert reasons(log) == {skipped_bytes.DAMAGED: 40}


def misleading() -> dict[str, bytes]:
    """Files that would take long, or a lot of memory, or crash, if their lengths and
    formats were believed.
    """
    tree = b"".join(declare(f"f{n}:f{n + 1} a;f{n + 1} b;") for n in range(40))
    size = 100_000
    return {
        "circular": (
            HEADER + declare("a:b x;") + declare("b:a x;") + subscribe(0, "a") + data(0, bytes(8))
        ),
        "exponential": (
            HEADER + tree + declare("f40:uint8_t x;") + subscribe(0, "f0") + data(0, bytes(60000))
        ),
        "exponential, unfinished": HEADER + tree + subscribe(0, "f0"),
        "huge array": (
            HEADER
            + declare("a:uint64_t timestamp;double[65535] x;")
            + subscribe(0, "a")
            + data(0, bytes(65000))
        ),
        "array of nothing": (
            HEADER
            + declare("n:uint8_t[4] _padding0;")
            + declare("a:n[65535] x;")
            + subscribe(0, "a")
            + data(0, b"")
        ),
        "only padding": (
            HEADER + declare("a:uint8_t[4] _padding0;") + subscribe(0, "a") + data(0, b"") * 9
        ),
        "sizes": START + depth(0) + b"\xff\xffD\0\0" * (size // 5),
        "headers everywhere": START + depth(0) + b"\x0e\x00D\0\0" * (size // 5),
        "letters P": START + depth(0) + b"P" * size,
        "letters F": START + depth(0) + (b"F" * 100 + b":" + b"int8_t a;" * 900) * (size // 8200),
        "subscriptions": (
            START
            + b"".join(subscribe(n % 65536, "depth", n % 256) + depth(n) for n in range(size // 30))
        ),
        "unknown numbers": (
            START
            + b"".join(depth(n) + data(n % 60000 + 1, bytes(n % 50)) for n in range(size // 40))
        ),
        "syncs": START + depth(0) + (sync() + b"x") * (size // 12),
        "no room": HEADER + b"\x01",
        "zero messages": START + depth(0) + b"\0\0D" * (size // 3),
    }


@pytest.mark.parametrize("name", misleading())
def test_misleading_files_end_well(name: str) -> None:
    log = read(misleading()[name])
    assert log.account.skipped_bytes > 0 or name in ("only padding", "subscriptions")


def frames(raw: bytes) -> Ints:
    """Begin, end and type of every message of a whole log, shape (n, 3)."""
    place, ends = layout.HEADER_BYTES, []
    while place < len(raw):
        stop = (
            place + layout.MESSAGE_HEADER_BYTES + int.from_bytes(raw[place : place + 2], "little")
        )
        ends.append((place, stop, raw[place + 2]))
        place = stop
    return np.array(ends, np.int64)


def moved(kept: list[Kept], begin: Ints, end: Ints) -> Ints:
    """Where in the damaged file what was at `begin:end` begins; -1 if it is not whole."""
    starts, stops, offsets = (np.array(column, np.int64) for column in zip(*kept, strict=True))
    part = np.maximum(np.searchsorted(starts, begin, side="right") - 1, 0)
    untouched = (starts[part] <= begin) & (end <= stops[part])
    return np.where(untouched, begin - starts[part] + offsets[part], -1)


@pytest.mark.parametrize(
    "seeds",
    [range(30), pytest.param(range(120), marks=pytest.mark.release)],
    ids=["30", "120"],
)
@pytest.mark.parametrize("name", ["sample_appended_multiple.ulg", "sample_log_small.ulg"])
def test_what_damage_left_whole_is_read_and_nothing_else(name: str, seeds: range) -> None:
    raw = (LOGS / name).read_bytes()
    source = read(raw)
    chain = frames(raw)
    records = {
        label: (table.offset, chain[np.searchsorted(chain[:, 0], table.offset), 1])
        for label, table in source.messages.items()
    }
    defining = chain[np.isin(chain[:, 2], list(b"BFA"))]
    shares, invented, total = [], 0, 0
    for seed in seeds:
        damaged, kept = mutations(raw, seed, protect=layout.HEADER_BYTES)
        log = read(damaged)
        offsets = {label: table.offset for label, table in log.messages.items()}
        if (moved(kept, defining[:, 0], defining[:, 1]) >= 0).all():
            intact = read_back = 0
            for label, (begin, end) in records.items():
                places = moved(kept, begin, end)
                intact += np.count_nonzero(places >= 0)
                read_back += np.count_nonzero(
                    np.isin(places[places >= 0], offsets.get(label, np.empty(0, np.int64)))
                )
            shares.append(read_back / intact)
        got = np.sort(np.concatenate([np.empty(0, np.int64), *offsets.values()]))
        total += got.size
        expected = moved(kept, chain[:, 0], chain[:, 0] + 1)
        for place in got[~np.isin(got, expected)].tolist():
            size = layout.MESSAGE_HEADER_BYTES + int.from_bytes(
                damaged[place : place + 2], "little"
            )
            invented += (
                damaged[place : place + size] not in raw
            )  # a piece that the damage copied may hold whole records
    assert len(shares) > len(seeds) / 2
    assert np.mean(shares) >= 0.999
    assert min(shares) >= 0.99
    # A copied piece that breaks off inside a record and meets the rest of another of
    # the same size is framed perfectly: one of the 30 cases has one.
    assert invented <= max(1.0, 5e-6 * total)


def test_same_bytes_give_the_same_log() -> None:
    raw = (LOGS / "sample_log_small.ulg").read_bytes()
    damaged, _ = mutations(raw, 3, protect=layout.HEADER_BYTES)
    first, second = read(damaged), read(damaged)
    assert first.account == second.account
    assert all(
        column.tobytes() == second.messages[name].columns[field].tobytes()
        for name, table in first.messages.items()
        for field, column in table.columns.items()
    )


def instances(*numbers: int) -> bytes:
    """A log of instances of one topic, subscribed with these numbers; their data have 0, 1, ..."""
    subscribed = b"".join(subscribe(id, "depth", k) for k, id in enumerate(numbers))
    records = b"".join(
        data(k, struct.pack("<Qf", 1_000_000 + 100_000 * n + k, 100 * k + n))
        for n in range(50)
        for k in range(len(numbers))
    )
    return HEADER + DEPTH + subscribed + records


@pytest.mark.parametrize("hit", range(3))
def test_a_subscription_whose_number_is_damaged_takes_no_records_of_another(hit: int) -> None:
    """Every bit of the number: records come from their own instance or are lost."""
    assert read(instances(0, 1, 2)).status == "complete"
    for bit in range(16):
        numbers = [0, 1, 2]
        numbers[hit] ^= 1 << bit
        log = read(instances(*numbers))
        assert log.status == "damaged"
        for k, name in enumerate(("depth", "depth.1", "depth.2")):
            table = log.messages.get(name)
            values = [] if table is None else table.columns["metres"].tolist()
            assert values in ([], [100 * k + n for n in range(50)]), (bit, name)
        shared = [note for note in log.notes if "subscribed with one number" in note]
        assert len(shared) == (len(set(numbers)) < len(numbers)), bit


def test_two_subscriptions_of_one_number_out_of_place_are_named() -> None:
    log = read(instances(5, 5))
    assert any("depth and depth.1 are subscribed with one number, 5" in n for n in log.notes)


def test_message_whose_size_is_damaged_swallows_nothing() -> None:
    about = bytearray(message("I", keyed("char[5] sys_name", b"auvid")))
    about[1] = 2  # 512 bytes more
    log = read(HEADER + bytes(about) + DEPTH + subscribe(0, "depth") + depths(0, 100))
    assert metres(log) == list(range(100))
    assert reasons(log) == {skipped_bytes.DAMAGED: len(about)}


def test_beginning_of_a_long_message_in_the_data_swallows_nothing() -> None:
    piece = message("M", b"\0" + keyed("char[800] fault", bytes(800)))[:60]
    log = read(START + depths(0, 50) + piece + depths(50, 150))
    assert metres(log) == list(range(150))
    assert reasons(log) == {skipped_bytes.DAMAGED: len(piece)}


def test_text_in_data_is_not_a_message() -> None:
    words = message("P", bytes([9]) + b"float ABC" + bytes(4))
    note = declare(f"note:uint64_t timestamp;char[{len(words)}] words;")
    log = read(HEADER + note + subscribe(0, "note") + data(0, bytes(8) + words) * 5)
    assert log.parameters == {}
    assert log.counts == {"note": 5}
