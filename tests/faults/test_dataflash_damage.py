"""Named damage to DataFlash logs: what must stay, what must be counted, and how the
file is judged.
"""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from tests.support.dataflash_writer import ATT, BAR, HEADER_RECORDS, IMU, dive, fmt, group, record

SMALL = (Path(__file__).parents[1] / "data" / "bluerov2_ugps_small" / "small.BIN").read_bytes()
GROUP = len(group(0))
IMU_BYTES, ATT_BYTES, BARO_BYTES = 16, 15, 19


def read(data: bytes) -> DecodedLog:
    log = DATAFLASH.read(RawFile("log.BIN", np.frombuffer(data, np.uint8)))
    account = log.account
    assert (
        account.record_bytes + account.definition_bytes + account.skipped_bytes
        == account.size
        == len(data)
    )
    return log


def at(step: int) -> int:
    """Offset of group `step` in `dive`."""
    return len(HEADER_RECORDS) + GROUP * step


def edited(offset: int, new: bytes, *, old: int | None = None, steps: int = 100) -> bytes:
    data = dive(steps)
    return data[:offset] + new + data[offset + (len(new) if old is None else old) :]


def reasons(log: DecodedLog) -> dict[str, tuple[int, int]]:
    return {part.reason: (part.count, part.bytes) for part in log.account.skipped}


def steps(log: DecodedLog, name: str) -> list[int]:
    return [
        (time_us - 1_000_000) // 100_000
        for time_us in log.messages[name].columns["TimeUS"].tolist()
    ]


def counts(log: DecodedLog) -> tuple[int, int, int]:
    return log.counts["IMU"], log.counts["ATT"], log.counts["BARO"]


@pytest.mark.parametrize("magic", [0, 1])
def test_magic_byte_flipped_loses_that_record_only(magic: int) -> None:
    log = read(edited(at(40) + magic, b"\x00"))
    assert counts(log) == (99, 100, 100)
    assert reasons(log) == {"damaged bytes": (1, IMU_BYTES)}
    assert log.status == "damaged"
    assert log.seconds_lost < 0.3


def test_isolated_record_between_two_damaged_headers_is_kept_by_its_time() -> None:
    """IMU 40 and BARO 40 lose their headers whole; ATT 40 has no record on either side
    that points to it.
    """
    data = bytearray(dive(100))
    data[at(40) : at(40) + 3] = bytes(3)
    data[at(40) + IMU_BYTES + ATT_BYTES : at(40) + IMU_BYTES + ATT_BYTES + 3] = bytes(3)
    log = read(bytes(data))
    assert counts(log) == (99, 100, 99)


def test_type_id_flipped_to_an_undefined_one() -> None:
    log = read(edited(at(40) + 2, b"\xee"))
    assert counts(log) == (99, 100, 100)
    assert reasons(log) == {"message type 238 without a definition": (1, IMU_BYTES)}


def test_type_id_flipped_to_a_shorter_or_longer_type_invents_nothing() -> None:
    for offset in (at(40), at(40) + IMU_BYTES, at(40) + IMU_BYTES + ATT_BYTES):
        for id in (IMU[0], ATT[0], BAR[0]):
            data = edited(offset + 2, bytes([id]))
            lost = int(data != dive(100))
            log = read(data)
            assert sum(counts(log)) == 300 - lost, (offset, id)


def test_block_overwritten_loses_what_it_touches() -> None:
    noise = np.random.default_rng(5).bytes(700)
    log = read(edited(at(30) + 5, noise))
    first, last = 30, 30 + (5 + 700) // GROUP
    assert set(steps(log, "BARO")) == set(range(100)) - set(range(first, last))
    assert 700 <= log.account.skipped_bytes <= 700 + GROUP
    assert log.seconds_lost == pytest.approx(
        0.1 * (last - first), abs=0.35
    )  # medians over two groups on either side
    assert log.status == "damaged"


def test_block_cut_out_loses_time_but_no_bytes_beside_it() -> None:
    """Twenty seconds are missing from within one record to within another."""
    log = read(edited(at(30) + 10, b"", old=200 * GROUP, steps=400))
    assert counts(log) == (200, 200, 200)
    assert (
        log.account.skipped_bytes == 0
    )  # both halves make one record: without checksums nobody can tell
    shifted = read(edited(at(30) + 10, b"", old=200 * GROUP + 7, steps=400))
    assert steps(shifted, "BARO") == [*range(30), *range(230, 400)]
    assert shifted.seconds_lost == pytest.approx(20.0, abs=0.5)


def test_block_of_zeros_is_named() -> None:
    log = read(edited(at(30), bytes(GROUP * 10)))
    assert reasons(log) == {"blank bytes (all zeros or all ones)": (1, GROUP * 10)}
    assert counts(log) == (90, 90, 90)
    assert log.seconds_lost == pytest.approx(1.1, abs=0.35)


def test_bytes_repeated_are_read_again_but_their_torn_edges_are_not() -> None:
    data = dive(100)
    log = read(data[: at(50)] + data[at(48) + 3 : at(50)] + data[at(50) :])
    assert counts(log) == (101, 102, 102)
    assert log.account.skipped_bytes == IMU_BYTES - 3


def test_file_cut_within_a_record_is_truncated() -> None:
    data = dive(100)[:-4]
    log = read(data)
    assert counts(log) == (100, 100, 99)
    assert log.status == "truncated"
    assert reasons(log) == {"record cut off by the end of the file": (1, BARO_BYTES - 4)}
    for left in (1, 2):
        assert read(dive(100)[: -BARO_BYTES + left]).status == "truncated"


def test_padding_at_the_end_is_no_damage_but_a_long_blank_end_is() -> None:
    assert read(dive(100) + b"\xff" * 200).status == "complete"
    assert read(dive(100) + bytes(200)).status == "complete"
    assert read(dive(100) + bytes(60_000)).status == "truncated"


def test_damaged_start_is_skipped() -> None:
    log = read(b"garbage " * 20 + dive(20))
    assert counts(log) == (20, 20, 20)
    assert reasons(log) == {"damaged bytes": (1, 160)}


def test_damaged_definition_leaves_its_type_undefined_and_the_others_whole() -> None:
    at_fmt = HEADER_RECORDS.index(fmt(*ATT))
    for offset, new, reason in (
        (0, b"\x00", "damaged bytes"),
        (4, b"\x21", "definition whose length does not match its format"),
        (9, b"\x01", "definition with an unknown format character"),
        (5, b"\x00", "definition without a readable name"),
        (31, b"\x00", "definition whose field names do not match its format"),
    ):
        log = read(edited(at_fmt + offset, new))
        assert (log.counts["IMU"], log.counts["BARO"]) == (100, 100), reason
        assert "ATT" not in log.counts
        lost = reasons(log)
        assert lost.pop("message type 11 without a definition") == (100, 100 * ATT_BYTES)
        assert lost == {reason: (1, 89)}


def test_damaged_definition_is_replaced_by_its_repetition() -> None:
    data = bytearray(dive(100) + fmt(*ATT) + dive(50)[len(HEADER_RECORDS) :])
    data[HEADER_RECORDS.index(fmt(*ATT)) + 4] ^= 0x40
    assert counts(read(bytes(data))) == (150, 150, 150)


def test_definition_that_took_the_id_of_another_type_is_contradicted_by_the_records() -> None:
    """The id in the FMT of BARO is damaged into that of ATT, which is declared before
    it and has records of another length.
    """
    at_fmt = HEADER_RECORDS.index(fmt(*BAR))
    log = read(edited(at_fmt + 3, bytes([ATT[0]])))
    assert (log.counts["IMU"], log.counts["ATT"]) == (100, 100)
    assert "definition contradicted by the records" in reasons(log)
    assert reasons(log)["message type 12 without a definition"] == (100, 100 * BARO_BYTES)


def test_definition_inside_a_record_is_data() -> None:
    """A FMT in the payload of a record is not in the chain: it must not redefine a
    type.
    """
    trap = fmt(*ATT)[:64]
    forged = record(70, "QZZ", 1, trap, fmt(IMU[0], "XXX", "QBf", "TimeUS,a,b")[:64])
    data = (
        HEADER_RECORDS
        + fmt(70, "FILE", "QZZ", "TimeUS,Data,More")
        + forged
        + b"".join(map(group, range(50)))
    )
    log = read(data)
    assert counts(log) == (50, 50, 50)
    assert log.counts["FILE"] == 1
    assert log.status == "complete"


def test_hostile_definitions_are_refused() -> None:
    for length, formats, columns in (
        (0, "B", "x"),
        (2, "", ""),
        (255, "QBf", "TimeUS,I,GyrX"),
        (16, "", "TimeUS,I,GyrX"),
    ):
        log = read(
            dive(20)
            + fmt(IMU[0], "IMU", formats, columns, length)
            + dive(20)[len(HEADER_RECORDS) :]
        )
        assert counts(log) == (40, 40, 40)
        assert log.account.skipped_bytes == 89
    relaid = read(
        HEADER_RECORDS + fmt(128, "FMT", "BB", "Type,Length", 5) + dive(20)[len(HEADER_RECORDS) :]
    )
    assert counts(relaid) == (20, 20, 20)
    assert reasons(relaid) == {"definition of FMT itself with another layout": (1, 89)}


def test_text_that_is_not_utf8_is_kept() -> None:
    log = read(
        dive(3) + fmt(71, "MSG", "QZ", "TimeUS,Message") + record(71, "QZ", 5, b"\xff\xfe\x80")
    )
    assert log.messages["MSG"].columns["Message"][0] == b"\xff\xfe\x80"
    assert log.texts == ((5, "ÿþ\x80"),)


def test_false_headers_in_the_data_do_not_break_the_chain() -> None:
    payload = (b"\xa3\x95" + bytes([IMU[0]])) * 21
    rows = b"".join(group(k) + record(72, "Z", payload) for k in range(50))
    log = read(HEADER_RECORDS + fmt(72, "BLOB", "Z", "Data") + rows)
    assert counts(log) == (50, 50, 50)
    assert log.counts["BLOB"] == 50
    assert log.status == "complete"


@pytest.mark.parametrize(
    "filling",
    [
        b"\xa3\x95",
        b"\xa3\x95\x80",
        b"\xa3\x95\x0b",
        b"\xa3\x95\x0a\x00",
        bytes(8),
        b"\xff" * 8,
        group(0)[:20],
        fmt(*IMU) + fmt(10, "XXX", "Q", "TimeUS"),
    ],
    ids=[
        "magic",
        "fmt headers",
        "att headers",
        "imu headers",
        "zeros",
        "ones",
        "torn records",
        "redefinitions",
    ],
)
def test_hostile_bytes_cost_memory_in_proportion_to_their_number(filling: bytes) -> None:
    """What follows them is found; a walk that is not linear would run into the time
    limit of the suite.
    """
    data = dive(20) + filling * (300_000 // len(filling)) + dive(20)[len(HEADER_RECORDS) :]
    tracemalloc.start()
    log = read(data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert log.counts["BARO"] >= 39
    assert peak < 100 * len(data)


@pytest.mark.parametrize(
    "later_us", [5_108_454_704, 491_855_354_069, 758_139_733_258, 775_329_667_910]
)
def test_a_clock_that_holds_the_magic_bytes_is_no_damage(later_us: int) -> None:
    """For 65 ms every 72 minutes all time stamps hold the magic bytes, and false
    headers outnumber the true ones.
    """
    undamaged = read(SMALL)
    stamps = np.concatenate(
        [
            item.offset
            for item in undamaged.messages.values()
            if next(iter(item.columns), None) == "TimeUS"
        ]
    )
    places = stamps[:, None] + 3 + np.arange(8)
    data = np.frombuffer(SMALL, np.uint8).copy()
    data[places] = (data[places].view("<u8") + np.uint64(later_us)).view(np.uint8)
    log = read(data.tobytes())
    assert log.status == "complete"
    assert not log.account.skipped
    assert dict(log.counts) == dict(undamaged.counts)


def test_splice_of_another_log_is_read_by_its_own_definitions() -> None:
    """Two logs in one file, the second with other ids: each part by the definitions
    that stand before it.
    """
    other = fmt(10, "BARO", BAR[2], BAR[3]) + fmt(12, "IMU", IMU[2], IMU[3])
    other += b"".join(
        record(10, BAR[2], 10_000_000 + k, 1.0, 2.0) + record(12, IMU[2], 10_000_000 + k, 0, 3.0)
        for k in range(30)
    )
    log = read(dive(100) + other)
    assert log.counts == {"FMT": 6, "IMU": 130, "ATT": 100, "BARO": 130}
    assert log.messages["IMU"].columns["GyrX"].tolist()[-30:] == [3.0] * 30


def test_most_damaged_real_log_still_gives_its_whole_records() -> None:
    """Every 2000th byte of a real log is flipped: all records without such a byte and
    with a whole definition are there.
    """
    clean = read(SMALL)
    data = np.frombuffer(bytearray(SMALL), np.uint8)
    hit = np.arange(20_000, data.size, 2000)
    data[hit] ^= 0x55
    log = read(data.tobytes())
    lengths = dict(
        zip(
            clean.messages["FMT"].columns["Name"].tolist(),
            clean.messages["FMT"].columns["Length"].tolist(),
            strict=True,
        )
    )
    for name, table in clean.messages.items():
        stop = table.offset + lengths[name.encode()]
        untouched = table.offset[np.searchsorted(hit, table.offset) == np.searchsorted(hit, stop)]
        assert np.isin(untouched, log.messages[name].offset).all(), name
