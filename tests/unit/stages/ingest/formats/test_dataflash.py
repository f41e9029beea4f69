"""The DataFlash reader on logs written record by record: formats, scaling, units,
redefinition, selection, errors.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import dataflash as layout
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog, LogReader
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from tests.support.dataflash_writer import (
    ATT,
    BAR,
    HEADER_RECORDS,
    IMU,
    PACKING,
    dive,
    fmt,
    group,
    record,
    unit_records,
)


def read(data: bytes, types: frozenset[str] | None = None) -> DecodedLog:
    log = DATAFLASH.read(RawFile("log.BIN", np.frombuffer(data, np.uint8)), types)
    account = log.account
    assert (
        account.record_bytes + account.definition_bytes + account.skipped_bytes
        == account.size
        == len(data)
    )
    return log


def test_layout_has_the_sizes_of_the_firmware() -> None:
    assert {char: form.bytes for char, form in layout.FIELD_FORMATS.items()} == {
        char: struct.calcsize("<" + packing) for char, packing in PACKING.items()
    }
    assert layout.FMT.length == layout.FMT_BYTES == 89
    assert layout.record_dtype("QBf").itemsize == 3 + 13


def test_packed_definition_is_the_fmt_record() -> None:
    assert layout.define(10, "IMU", "QBf", "TimeUS,I,GyrX").pack() == fmt(*IMU)
    with pytest.raises(ValueError, match="longer than 4 bytes"):
        layout.define(10, "GYROS", "Q", "TimeUS").pack()


@pytest.mark.parametrize(
    ("char", "stored", "expected", "dtype"),
    [
        ("b", -128, -128, np.int8),
        ("B", 255, 255, np.uint8),
        ("h", -32768, -32768, np.int16),
        ("H", 65535, 65535, np.uint16),
        ("i", -(2**31), -(2**31), np.int32),
        ("I", 2**32 - 1, 2**32 - 1, np.uint32),
        ("q", -(2**63), -(2**63), np.int64),
        ("Q", 2**64 - 1, 2**64 - 1, np.uint64),
        ("g", 0.099975586, 0.099975586, np.float32),
        ("f", 0.1, np.float32(0.1), np.float32),
        ("d", 0.1, 0.1, np.float64),
        ("n", b"abcd", b"abcd", "S4"),
        ("N", b"name\0rest", b"name", "S16"),
        ("Z", b"text\0garbage\0x", b"text", "S64"),
        ("c", -123, -1.23, np.float64),
        ("C", 65535, 655.35, np.float64),
        ("e", -1234567, -12345.67, np.float64),
        ("E", 2**32 - 1, 42949672.95, np.float64),
        ("L", 476049123, 47.6049123, np.float64),
        ("M", 21, 21, np.int8),
    ],
)
def test_every_format_character(char: str, stored: object, expected: object, dtype: object) -> None:
    data = fmt(30, "TST", "Q" + char, "TimeUS,V") + record(30, "Q" + char, 5, stored) * 3
    column = read(data).messages["TST"].columns["V"]
    assert column.dtype == np.dtype(dtype)  # type: ignore[call-overload]
    assert column.tolist() == [np.asarray(expected, column.dtype).item()] * 3
    assert not column.flags.writeable


def test_array_field_is_two_dimensional() -> None:
    rows = [list(range(k, k + 32)) for k in (0, -32768, 100)]
    data = fmt(31, "ISBD", "Qa", "TimeUS,x") + b"".join(record(31, "Qa", 1, row) for row in rows)
    column = read(data).messages["ISBD"].columns["x"]
    assert column.dtype == np.int16
    assert column.tolist() == rows


def test_file_contents_are_not_cut_at_nul() -> None:
    contents = bytes(range(64))
    log = read(
        fmt(32, "FILE", "NhZ", "FileName,Offset,Data") + record(32, "NhZ", b"@SYS/x", 0, contents)
    )
    assert log.messages["FILE"].columns["Data"][0] == contents
    assert log.messages["FILE"].columns["FileName"][0] == b"@SYS/x"


def test_unit_texts_carry_the_multiplier_unless_the_format_scales() -> None:
    types = fmt(33, "TST", "QBcffff", "TimeUS,I,Roll,Gyr,Dist,Other,None")
    log = read(
        types
        + unit_records({33: ("s#dEmm-", "F-BBBJ-")})
        + record(33, "QBcffff", 1, 0, 100, 1.0, 2.0, 3.0, 4.0)
    )
    assert log.messages["TST"].units == {
        "TimeUS": "µs",
        "I": "#",
        "Roll": "deg",
        "Gyr": "crad/s",
        "Dist": "cm",
        "Other": "2.5 m",
    }
    assert log.messages["TST"].columns["Dist"].tolist() == [2.0]


def test_instances_stay_in_one_table_in_file_order() -> None:
    log = read(dive(20))
    assert log.messages["IMU"].columns["I"].tolist() == [0, 1] * 10
    assert np.all(np.diff(log.messages["IMU"].offset) > 0)
    assert log.messages["IMU"].columns["GyrX"].tolist() == [0.5 * step for step in range(20)]


def test_redefined_type_is_joined_by_field_name() -> None:
    first = fmt(40, "DVL", "Qhf", "TimeUS,Conf,Vx") + b"".join(
        record(40, "Qhf", t, t, 0.5) for t in range(10)
    )
    second = fmt(40, "DVL", "Qff", "TimeUS,Vx,Vy") + b"".join(
        record(40, "Qff", t, 1.5, 2.5) for t in range(10, 15)
    )
    third = fmt(40, "DVL", "QfB", "TimeUS,Vx,S") + b"".join(
        record(40, "QfB", t, 3.5, 7) for t in range(15, 18)
    )
    log = read(first + second + fmt(40, "DVL", "Qff", "TimeUS,Vx,Vy") + third)
    table = log.messages["DVL"]
    assert table.columns["TimeUS"].tolist() == list(range(18))
    assert table.columns["Vx"].tolist() == [0.5] * 10 + [1.5] * 5 + [3.5] * 3
    np.testing.assert_array_equal(table.columns["Conf"], [*range(10), *[np.nan] * 8])
    np.testing.assert_array_equal(table.columns["S"], [*[np.nan] * 15, 7, 7, 7])
    assert log.counts["DVL"] == 18
    assert any("several layouts" in note and "DVL" in note for note in log.notes)


def test_name_that_moves_to_another_id_and_id_that_changes_its_name() -> None:
    data = fmt(40, "AAA", "Qf", "TimeUS,v") + record(40, "Qf", 1, 1.0) * 5
    data += (
        fmt(41, "AAA", "Qf", "TimeUS,v")
        + fmt(40, "BBB", "QH", "TimeUS,w")
        + (record(41, "Qf", 2, 2.0) + record(40, "QH", 3, 9)) * 5
    )
    log = read(data)
    assert log.messages["AAA"].columns["v"].tolist() == [1.0] * 5 + [2.0] * 5
    assert log.messages["BBB"].columns["w"].tolist() == [9] * 5
    assert log.status == "complete"


def test_record_before_its_definition_is_read_with_it() -> None:
    log = read(
        fmt(*BAR)
        + record(IMU[0], IMU[2], 1, 0, 1.0) * 3
        + record(BAR[0], BAR[2], 1, 1.0, 2.0)
        + fmt(*IMU)
    )
    assert log.counts["IMU"] == 3
    assert log.status == "complete"


def test_only_wanted_types_are_decoded_and_all_are_counted() -> None:
    data = (
        dive(30)
        + fmt(50, "PARM", "QNf", "TimeUS,Name,Value")
        + record(50, "QNf", 1, b"FRAME_CONFIG", 2.0)
    )
    log = read(data, frozenset({"ATT", "NONE"}))
    assert set(log.messages) == {"ATT"}
    assert log.counts == {"FMT": 5, "IMU": 30, "ATT": 30, "BARO": 30, "PARM": 1}
    assert log.parameters == {"FRAME_CONFIG": 2.0}
    assert log.account == read(data).account


def test_parameters_keep_the_last_value_and_texts_their_time() -> None:
    data = fmt(50, "PARM", "QNf", "TimeUS,Name,Value") + fmt(
        51, "MSG", "QBBZ", "TimeUS,ID,Seq,Message"
    )
    data += b"".join(record(50, "QNf", k, b"PSC_D", float(k)) for k in (1, 2, 3))
    data += (
        record(51, "QBBZ", 7, 4, 0, b"a long ")
        + record(51, "QBBZ", 7, 4, 1, b"text")
        + record(51, "QBBZ", 9, 5, 0, b"caf\xe9")
    )
    log = read(data)
    assert log.parameters == {"PSC_D": 3.0}
    assert log.texts == ((7, "a long text"), (9, "café"))


def test_old_clock_in_milliseconds_is_told_and_left_alone() -> None:
    data = fmt(60, "ATT", "Icc", "TimeMS,Roll,Pitch") + b"".join(
        record(60, "Icc", t, 1, 2) for t in range(0, 1000, 100)
    )
    log = read(data)
    assert log.messages["ATT"].columns["TimeMS"].tolist() == list(range(0, 1000, 100))
    assert any("milliseconds" in note for note in log.notes)


def test_clock_that_goes_back_is_told() -> None:
    log = read(dive(50) + dive(50)[len(HEADER_RECORDS) :])
    assert any("goes back by 4.9 s" in note for note in log.notes)
    assert log.status == "complete"


def test_types_without_a_time_are_told() -> None:
    log = read(dive(5) + fmt(61, "MODE", "Mh", "Mode,ThrCrs") + record(61, "Mh", 2, 500))
    assert any(note.endswith(": MODE.") for note in log.notes)


def test_log_with_definitions_only_is_told() -> None:
    log = read(HEADER_RECORDS)
    assert log.counts == {"FMT": 4}
    assert log.account.definition_bytes == len(HEADER_RECORDS)
    assert any("definitions only" in note for note in log.notes)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"x", "no DataFlash record"),
        (b"\xa3\x95", "no DataFlash record"),
        (b"time,depth\n0,1\n" * 40, "no DataFlash record"),
        (bytes(4096), "no DataFlash record"),
        (group(0) * 20, "no DataFlash record"),
    ],
)
def test_what_is_no_log_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(LogError, match=message) as caught:
        DATAFLASH.read(RawFile("dive.BIN", np.frombuffer(data, np.uint8)))
    assert "dive.BIN" in str(caught.value)


def test_recognises_by_content() -> None:
    reader: LogReader = DATAFLASH
    assert reader.name == "dataflash"
    assert reader.recognises(dive(3))
    assert reader.recognises(bytes(500) + dive(3))
    assert not reader.recognises(b"")
    assert not reader.recognises(b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\n")
    assert not reader.recognises(b"ULog\x01\x12\x35\x01" + bytes(100))
    assert not reader.recognises(bytes(100) + b"\xa3\x95\x80" + bytes(100))


def test_buffer_is_not_written_to() -> None:
    buffer = np.frombuffer(bytearray(dive(40)), np.uint8)
    before = buffer.copy()
    DATAFLASH.read(RawFile("log.BIN", buffer))
    np.testing.assert_array_equal(buffer, before)


def test_field_names_cut_off_at_64_letters_are_used_as_far_as_they_go() -> None:
    names = "TimeUS," + ",".join(f"VeryLongName{k}" for k in range(5))
    data = fmt(62, "LONG", "Qfffff", names[:64]) + record(62, "Qfffff", 1, 1.0, 2.0, 3.0, 4.0, 5.0)
    log = read(data)
    assert list(log.messages["LONG"].columns)[:4] == [
        "TimeUS",
        "VeryLongName0",
        "VeryLongName1",
        "VeryLongName2",
    ]
    assert log.messages["LONG"].columns["VeryLongName2"].tolist() == [3.0]


def test_centidegrees_are_the_nearest_double() -> None:
    stored = range(-18000, 18000, 7)
    data = fmt(*ATT) + b"".join(record(ATT[0], ATT[2], 1, value, value) for value in stored)
    assert read(data).messages["ATT"].columns["Roll"].tolist() == [value / 100 for value in stored]
