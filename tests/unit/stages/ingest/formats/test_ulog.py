"""The ULog reader against pyulog on whole logs, and against the file format on logs
made here.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from pyulog import ULog

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import ulog as layout
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.ulog import skipped_bytes
from auvid.stages.ingest.formats.ulog.reader import ULOG
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

LOGS = Path(__file__).parents[4] / "data" / "px4_ulog"
NAMES = ["sample_appended_multiple.ulg", "sample_log_small.ulg"]


@pytest.mark.parametrize("name", NAMES)
def test_every_field_equals_pyulog(name: str) -> None:
    ours, theirs = read((LOGS / name).read_bytes()), ULog(str(LOGS / name))
    assert ours.status == "complete"
    assert ours.account.skipped_bytes == 0
    compared = set()
    for item in theirs.data_list:
        table = ours.messages[f"{item.name}.{item.multi_id}" if item.multi_id else item.name]
        compared.add(table.name)
        expected = {field: values for field, values in item.data.items() if "_padding" not in field}
        characters = {
            field
            for field in expected
            if field.partition("[")[0] in table.columns and field not in table.columns
        }
        assert set(table.columns) == (set(expected) - characters) | {
            field.partition("[")[0] for field in characters
        }
        for field in set(expected) - characters:
            column = table.columns[field]
            assert column.tobytes() == np.ascontiguousarray(expected[field]).tobytes(), (
                table.name,
                field,
            )
            assert column.dtype.itemsize == expected[field].dtype.itemsize
        assert table.columns["timestamp"].dtype == np.uint64
    assert compared == set(ours.messages)


@pytest.mark.parametrize("name", NAMES)
def test_parameters_and_texts_equal_pyulog(name: str) -> None:
    ours, theirs = read((LOGS / name).read_bytes()), ULog(str(LOGS / name))
    last = theirs.initial_parameters | {
        parameter: value for _, parameter, value in theirs.changed_parameters
    }
    assert dict(ours.parameters) == {parameter: float(value) for parameter, value in last.items()}
    assert list(ours.texts) == [(item.timestamp, item.message) for item in theirs.logged_messages]


def test_wanted_topics_only_are_decoded_and_all_are_counted() -> None:
    raw = (LOGS / NAMES[1]).read_bytes()
    all_topics = read(raw)
    some = read(
        raw, frozenset({"sensor_combined", "actuator_outputs.1", "estimator_status", "none_such"})
    )
    instances = {
        name for name in all_topics.messages if name.partition(".")[0] == "estimator_status"
    }
    assert set(some.messages) == {"sensor_combined", "actuator_outputs.1"} | instances
    assert some.counts == all_topics.counts
    assert some.account == all_topics.account
    np.testing.assert_array_equal(
        some.messages["sensor_combined"].columns["timestamp"],
        all_topics.messages["sensor_combined"].columns["timestamp"],
    )


def test_stray_time_stamp_and_dropout_are_noted() -> None:
    notes = " ".join(read((LOGS / NAMES[1]).read_bytes()).notes)
    assert "1 time stamp(s) of mission stray ahead of the clock, up to 1194.37 s" in notes
    assert "1 time(s), 0.03 s in all (dropouts)" in notes


def test_nested_formats_arrays_and_characters_are_taken_apart() -> None:
    declared = declare("motor:uint16_t rpm;uint8_t[2] _padding0;float[2] volts;") + declare(
        "thrust:uint64_t timestamp;motor[2] motors;char[8] label;char grade;bool armed;motor"
        " spare;uint8_t[3] _padding0;"
    )
    payload = struct.pack("<Q", 77)
    payload += struct.pack("<HHff", 100, 0xFFFF, 1.5, 2.5) + struct.pack(
        "<HHff", 200, 0xFFFF, 3.5, 4.5
    )
    payload += b"left\0\xffXY" + b"A" + b"\x01" + struct.pack("<HHff", 300, 0xFFFF, 5.5, 6.5)
    log = read(
        HEADER + declared + subscribe(3, "thrust") + data(3, payload) + data(3, payload + bytes(3))
    )
    columns = {name: column.tolist() for name, column in log.messages["thrust"].columns.items()}
    assert columns == {
        "timestamp": [77, 77],
        "motors[0].rpm": [100, 100],
        "motors[0].volts[0]": [1.5, 1.5],
        "motors[0].volts[1]": [2.5, 2.5],
        "motors[1].rpm": [200, 200],
        "motors[1].volts[0]": [3.5, 3.5],
        "motors[1].volts[1]": [4.5, 4.5],
        "label": [b"left", b"left"],
        "grade": [b"A", b"A"],
        "armed": [1, 1],
        "spare.rpm": [300, 300],
        "spare.volts[0]": [5.5, 5.5],
        "spare.volts[1]": [6.5, 6.5],
    }
    assert log.status == "complete"


def test_instances_are_separate_and_the_records_keep_their_places() -> None:
    start = (
        HEADER + DEPTH + subscribe(0, "depth") + subscribe(1, "depth", 1) + subscribe(9, "depth", 4)
    )
    log = read(start + depth(0, 0) + depth(1, 1) + depth(2, 0) + depth(3, 9))
    assert dict(log.counts) == {"depth": 2, "depth.1": 1, "depth.4": 1}
    assert log.messages["depth"].columns["metres"].tolist() == [0.0, 2.0]
    assert log.messages["depth.1"].offset.tolist() == [len(start) + len(depth(0))]
    assert log.messages["depth.4"].columns["metres"].tolist() == [3.0]


def test_a_number_can_be_subscribed_again() -> None:
    other = declare("heading:uint64_t timestamp;double radians;")
    turned = data(0, struct.pack("<Qd", 5, 0.25))
    log = read(
        HEADER
        + DEPTH
        + other
        + subscribe(0, "depth")
        + depth(1)
        + message("R", b"\0\0")
        + subscribe(0, "heading")
        + turned
    )
    assert log.messages["depth"].columns["metres"].tolist() == [1.0]
    assert log.messages["heading"].columns["radians"].tolist() == [0.25]
    assert log.status == "complete"


def test_a_number_that_was_removed_is_free_for_a_topic_of_equal_size() -> None:
    other = declare("heading:uint64_t timestamp;float radians;")
    turned = data(0, struct.pack("<Qf", 5, 0.25))
    start = HEADER + DEPTH + other + subscribe(0, "depth") + depth(1)
    log = read(start + message("R", b"\0\0") + subscribe(0, "heading") + turned)
    assert log.messages["depth"].columns["metres"].tolist() == [1.0]
    assert log.messages["heading"].columns["radians"].tolist() == [0.25]
    assert not log.notes


def test_last_parameter_wins_and_defaults_do_not_count() -> None:
    def parameter(kind: str, name: str, value: bytes) -> bytes:
        return message("P", keyed(f"{kind} {name}", value))

    log = read(
        HEADER
        + parameter("float", "SURGE", struct.pack("<f", 1.5))
        + parameter("int32_t", "MODE", struct.pack("<i", -3))
        + message("Q", b"\x01" + keyed("float SURGE", struct.pack("<f", 9.0)))
        + DEPTH
        + subscribe(0, "depth")
        + depth(0)
        + parameter("float", "SURGE", struct.pack("<f", 2.5))
    )
    assert dict(log.parameters) == {"SURGE": 2.5, "MODE": -3.0}


def test_texts_with_and_without_tag_in_file_order() -> None:
    tagged = message("C", b"4" + struct.pack("<HQ", 7, 20) + "tether 5 µm".encode())
    log = read(
        HEADER
        + DEPTH
        + subscribe(0, "depth")
        + text(10, "dive")
        + tagged
        + depth(0)
        + text(30, "surface\0")
    )
    assert log.texts == ((10, "dive"), (20, "tether 5 µm"), (30, "surface"))


def test_information_and_sync_are_accounted() -> None:
    about = message("I", keyed("char[3] sys_name", b"PX4")) + message(
        "M", b"\0" + keyed("char[2] boot", b"ok")
    )
    about += message("I", keyed("uint32_t ver", bytes(4))) + message(
        "I", keyed("uint8_t[3] id", bytes(3))
    )
    about += message("I", keyed("char[0] perf_top", b""))
    start = HEADER + about + DEPTH + subscribe(0, "depth")
    log = read(start + depth(0) + sync() + message("O", struct.pack("<H", 250)))
    assert log.account.definition_bytes == len(start)
    assert log.status == "complete"
    assert "0.25 s in all (dropouts)" in " ".join(log.notes)


def appended(cut: int) -> bytes:
    """A log of ten records, the last without its last `cut` bytes, to which five were
    appended.
    """
    first = HEADER + flag_bits(0) + DEPTH + subscribe(0, "depth") + depths(0, 10)
    first = first[: len(first) - cut]
    place = len(first)
    return first.replace(flag_bits(0), flag_bits(place)) + depths(10, 15)


@pytest.mark.parametrize("cut", [0, 1, 9, 15, 16])
def test_appended_data_begin_at_their_offset(cut: int) -> None:
    log = read(appended(cut))
    expected = list(range(15)) if cut == 0 else [*range(9), *range(10, 15)]
    assert log.messages["depth"].columns["metres"].tolist() == expected
    assert reasons(log) == ({skipped_bytes.CUT_BY_APPENDED: 17 - cut} if cut else {})
    assert log.status == "complete"  # the format provides for it


def test_wrong_offset_of_appended_data_loses_nothing() -> None:
    start = HEADER + flag_bits(0) + DEPTH + subscribe(0, "depth")
    raw = start + depths(0, 20)
    for place in (len(start) + 3, len(start) + 17 * 4 + 1, len(raw) - 1, len(raw) + 5, 1, 1 << 63):
        log = read(raw.replace(flag_bits(0), flag_bits(place)))
        assert log.counts == {"depth": 20}
        assert log.status == "complete"


def test_unknown_message_types_and_features_are_passed_over() -> None:
    raw = (
        HEADER
        + flag_bits(incompatible=2)
        + DEPTH
        + subscribe(0, "depth")
        + depths(0, 3)
        + message("Z", b"novel")
        + depths(3, 6)
    )
    log = read(raw.replace(layout.MAGIC + b"\x01", layout.MAGIC + b"\x02"))
    assert log.counts == {"depth": 6}
    assert reasons(log) == {skipped_bytes.UNKNOWN_TYPE: 8}
    assert log.status == "complete"
    assert "version 2" in log.notes[0]
    assert "feature that auvid does not know" in log.notes[1]


def test_topic_without_time_stamp_is_decoded_and_noted() -> None:
    log = read(
        HEADER
        + declare("level:float volts;")
        + subscribe(0, "level")
        + data(0, struct.pack("<f", 16.5))
    )
    assert log.messages["level"].columns["volts"].tolist() == [16.5]
    assert log.notes == ("Topics without a time stamp: level.",)


def test_clock_that_goes_back_is_noted() -> None:
    log = read(HEADER + DEPTH + subscribe(0, "depth") + depths(1000, 1256) + depths(0, 256))
    assert any("goes back by" in note for note in log.notes)


def test_recognised_by_content() -> None:
    assert ULOG.recognises(HEADER)
    assert not ULOG.recognises(b"ULogEnc\0\1")
    assert not ULOG.recognises(b"")


@pytest.mark.parametrize("raw", [b"", b"\xa3\x95\x80" * 30, bytes(64)])
def test_other_files_are_refused(raw: bytes) -> None:
    with pytest.raises(LogError, match=r"test\.ulg"):
        ULOG.read(RawFile("test.ulg", np.frombuffer(raw, np.uint8)))


def test_input_may_be_read_only_and_is_not_changed() -> None:
    raw = np.frombuffer(HEADER + DEPTH + subscribe(0, "depth") + depths(0, 5), np.uint8)
    before = raw.tobytes()
    assert not raw.flags.writeable
    ULOG.read(RawFile("test.ulg", raw))
    assert raw.tobytes() == before


def test_format_packs_to_what_is_parsed() -> None:
    content = b"thrust:uint64_t timestamp;motor[2] motors;char[8] label;"
    declared = layout.parse_format(content)
    assert declared is not None
    assert declared.pack() == content


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"a",
        b"a:",
        b"a:float",
        b"a:float x;float x;",
        b"a:float[0] x;",
        b"a:float[] x;",
        b"a:fl\xffat x;",
    ],
)
def test_bad_formats_are_not_believed(content: bytes) -> None:
    assert layout.parse_format(content) is None
