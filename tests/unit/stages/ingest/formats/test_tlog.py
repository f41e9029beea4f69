"""The telemetry reader: equal to pymavlink on real logs, and right on records made byte
by byte.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import mavlink
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog, LogReader
from auvid.stages.ingest.formats.tlog.reader import TLOG, decode_tlog
from tests.support.tlog_records import START_US, attitude, frame, heartbeat, log
from tests.unit.stages.ingest.formats.test_tlog_layouts import assert_equal_to_message

DATA = Path(__file__).parents[4] / "data"
SMALL = DATA / "bluerov2_ugps_small" / "small.tlog"
RECUT = DATA / "bluerov2_bad_data" / "bad_data.tlog"


def read(data: bytes, types: frozenset[str] | None = None, reader: LogReader = TLOG) -> DecodedLog:
    buffer = np.frombuffer(data, dtype=np.uint8)
    decoded = reader.read(RawFile("log.tlog", buffer), types)
    account = decoded.account
    assert account.size == len(data)
    assert account.record_bytes + account.definition_bytes + account.skipped_bytes == len(data)
    return decoded


def of_system(system: int) -> LogReader:
    return replace(TLOG, decode=partial(decode_tlog, system=system))


def statustext(text: bytes, number: int = 0, chunk: int = 0) -> bytes:
    return frame("STATUSTEXT", struct.pack("<B50sHB", 6, text, number, chunk))


def parameter(name: bytes, value: float, kind: int = 9) -> bytes:
    return frame("PARAM_VALUE", struct.pack("<fHH16sB", value, 1, 0, name, kind))


def test_is_a_log_reader() -> None:
    reader: LogReader = TLOG
    assert reader.name == "tlog"


@pytest.mark.parametrize(
    "path",
    [
        # Of this log tests/end_to_end/test_agreement.py compares each field, too.
        pytest.param(SMALL, id="small", marks=pytest.mark.release),
        pytest.param(RECUT, id="bad_data"),
    ],
)
def test_every_field_equals_pymavlink(path: Path) -> None:
    decoded = read(path.read_bytes())
    link = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    theirs = defaultdict(list)
    while (message := link.recv_msg()) is not None:
        theirs[message.get_type()].append(message)
    link.close()
    bad = theirs.pop("BAD_DATA", [])
    assert sum(decoded.counts.values()) == sum(map(len, theirs.values())) + len(bad)
    compared = 0
    for name, table in decoded.messages.items():
        sender = int(table.columns["sysid"][0]), int(table.columns["compid"][0])
        assert (
            len(np.unique(table.columns["sysid"])) == len(np.unique(table.columns["compid"])) == 1
        )
        messages = [
            each
            for each in theirs[name]
            if (each.get_srcSystem(), each.get_srcComponent()) == sender
        ]
        sequence = table.columns[
            (
                "frame_seq"
                if "seq" in mavlink.definitions()[mavlink.ids_by_name()[name]].fieldnames
                else "seq"
            )
        ]
        rows = {
            key: row
            for row, key in enumerate(
                zip(table.columns["time_unix_us"].tolist(), sequence.tolist(), strict=True)
            )
        }
        missing = len(table) - len(messages)
        assert missing == 0 or any(
            f"{missing} {name}" in note and "after the checksum" in note for note in decoded.notes
        )
        for each in messages:
            assert_equal_to_message(
                dict(table.columns), rows[round(each._timestamp * 1e6), each.get_seq()], each
            )
        compared += len(messages)
    assert compared > 4000
    assert decoded.status == "complete"


@pytest.mark.compiles("data_schemas/formats/compiled_mavlink.py")
def test_frames_whose_zeros_were_cut_after_the_checksum_are_read() -> None:
    decoded = read(RECUT.read_bytes())
    assert decoded.account.skipped == ()
    altimeter = decoded.messages["DISTANCE_SENSOR"].columns
    assert set(altimeter["max_distance"].tolist()) == {5000}
    assert float(np.abs(altimeter["quaternion"]).max()) == 0.0
    assert any(
        "router cut trailing zeros" in note and "DISTANCE_SENSOR" in note for note in decoded.notes
    )


def test_wanted_types_only_but_parameters_and_texts_always() -> None:
    everything = read(SMALL.read_bytes())
    some = read(SMALL.read_bytes(), frozenset({"ATTITUDE", "NO_SUCH_MESSAGE"}))
    assert set(some.messages) == {"ATTITUDE"}
    np.testing.assert_array_equal(
        some.messages["ATTITUDE"].columns["yaw"], everything.messages["ATTITUDE"].columns["yaw"]
    )
    assert some.counts == everything.counts
    assert some.account == everything.account
    assert some.parameters == everything.parameters
    assert some.texts == everything.texts
    assert everything.parameters["FRAME_CONFIG"] == 2.0
    assert everything.texts[0][1].startswith("ArduSub V4.1.1")
    assert everything.messages["ATTITUDE"].units["yaw"] == "rad"
    assert everything.messages["ATTITUDE"].units["time_unix_us"] == "us"


def test_recognises_by_content() -> None:
    head = SMALL.read_bytes()[:4096]
    assert TLOG.recognises(head)
    assert TLOG.recognises(b"\x55" * 100 + head)
    assert TLOG.recognises(log([heartbeat()]))
    unset = log([heartbeat(), attitude(10), attitude(20)], start_us=3_000_000)
    assert TLOG.recognises(unset), "the recorder's clock began in 1970"
    wrong = [frame("HEARTBEAT", b"\x01" * 9, crc_extra=1)] * 3
    assert TLOG.recognises(log(wrong))
    assert not TLOG.recognises(log(wrong, start_us=3_000_000))
    unstamped = b"".join(heartbeat() + attitude(number) for number in range(60))
    binary = (DATA / "bluerov2_ugps_small" / "small.BIN").read_bytes()[:4096]
    for other in (
        b"",
        b"\x00" * 4096,
        b"t_s,u,v\n0.0,1,2\n" * 99,
        unstamped,
        binary,
        np.random.default_rng(1).bytes(8192),
    ):
        assert not TLOG.recognises(other)


def test_both_versions_signatures_and_extension_fields() -> None:
    old = attitude(10, version=1, sequence=7)
    signed = attitude(20, signed=True, sequence=8)
    decoded = read(log([heartbeat(), old, signed, attitude(30, sequence=9)]))
    columns = decoded.messages["ATTITUDE"].columns
    assert columns["time_boot_ms"].tolist() == [10, 20, 30]
    assert columns["seq"].tolist() == [7, 8, 9]
    assert columns["time_unix_us"].tolist() == [START_US + 20_000 * number for number in (1, 2, 3)]
    assert decoded.messages["ATTITUDE"].offset.tolist()[:2] == [
        8 + len(heartbeat()),
        8 + len(heartbeat()) + 8 + len(old),
    ]
    status = read(log([heartbeat(), frame("SYS_STATUS", bytes(range(1, 32)), version=1)])).messages[
        "SYS_STATUS"
    ]
    assert status.columns["onboard_control_sensors_present_extended"].tolist() == [0]


def test_own_seq_field_keeps_its_name() -> None:
    decoded = read(log([heartbeat(), frame("MISSION_CURRENT", struct.pack("<H", 513), sequence=5)]))
    columns = decoded.messages["MISSION_CURRENT"].columns
    assert columns["seq"].tolist() == [513]
    assert columns["frame_seq"].tolist() == [5]


def test_longer_payload_of_a_newer_definition() -> None:
    newer = struct.pack("<I6f", 40, 0.25, 0, 0, 0, 0, 1.5) + b"new"
    decoded = read(log([heartbeat(), frame("ATTITUDE", newer)]))
    assert decoded.messages["ATTITUDE"].columns["yawspeed"].tolist() == [1.5]


def test_vehicle_is_the_autopilot_and_others_are_noted() -> None:
    ground = [heartbeat(system=255, component=190, autopilot=8, kind=6)] * 9
    camera = [heartbeat(component=100, autopilot=8, kind=30), attitude(5, roll=9.0, component=100)]
    position = frame("GPS_INPUT", struct.pack("<QI", 1, 2) + bytes(range(51)), component=220)
    decoded = read(log([*ground, *camera, heartbeat(), attitude(1), position]))
    assert decoded.messages["ATTITUDE"].columns["roll"].tolist() == [0.25]
    assert decoded.messages["HEARTBEAT"].columns["compid"].tolist() == [1]
    assert decoded.messages["GPS_INPUT"].columns["compid"].tolist() == [220]
    assert decoded.counts == {"HEARTBEAT": 11, "ATTITUDE": 2, "GPS_INPUT": 1}
    assert "system 255 component 190: 9 messages (ground station)" in decoded.notes
    assert "system 1 component 100: 2 messages (camera)" in decoded.notes


def test_two_vehicles_are_named_and_one_can_be_chosen() -> None:
    records = [
        heartbeat(),
        attitude(1),
        attitude(2),
        heartbeat(system=2),
        attitude(7, system=2),
        frame("VFR_HUD", b"\x01" * 20, system=2),
    ]
    first = read(log(records))
    assert first.messages["ATTITUDE"].columns["time_boot_ms"].tolist() == [1, 2]
    assert "VFR_HUD" not in first.messages
    expected = (
        "several vehicles: system 1 component 1 (3 messages) and system 2 component 1 (3 messages);"
        " system 1 component 1 is read"
    )
    assert expected in first.notes
    second = read(log(records), reader=of_system(2))
    assert second.messages["ATTITUDE"].columns["time_boot_ms"].tolist() == [7]
    assert set(second.messages) == {"HEARTBEAT", "ATTITUDE", "VFR_HUD"}
    absent = read(log(records), reader=of_system(3))
    assert absent.messages == {}
    assert absent.notes == ("system 3 sends no message in this log",)


def test_no_autopilot_heartbeat() -> None:
    decoded = read(
        log([attitude(1), attitude(2), heartbeat(system=255, component=190, autopilot=8, kind=6)])
    )
    assert decoded.messages["ATTITUDE"].columns["time_boot_ms"].tolist() == [1, 2]
    assert any(note.startswith("no heartbeat of an autopilot") for note in decoded.notes)


def test_last_parameter_value_and_integers_of_px4() -> None:
    value = struct.unpack("<f", struct.pack("<i", -7))[0]
    records = [parameter(b"A", 1.0), parameter(b"SIXTEEN_LETTERS_", 2.5), parameter(b"A", 3.0, 6)]
    ardupilot = read(log([heartbeat(), *records]))
    assert ardupilot.parameters == {"A": 3.0, "SIXTEEN_LETTERS_": 2.5}
    px4 = read(log([heartbeat(autopilot=12), parameter(b"B", 0.5), parameter(b"A", value, 6)]))
    assert px4.parameters == {"B": 0.5, "A": -7.0}


def test_status_texts_of_several_chunks() -> None:
    long = bytes(range(65, 115))
    texts = [
        statustext(b"short"),
        statustext(long, 3, 0),
        statustext(b"tail", 3, 1),
        statustext(long, 4, 0),
        statustext(b"late", 4, 2),
    ]
    decoded = read(
        log([heartbeat(), *texts, statustext(b"caf\xe9 \xc3\xa9"), statustext(b"cut\x00off")])
    )
    tail = long.decode() + "tail", long.decode() + "...late"
    assert [text for _, text in decoded.texts] == ["short", *tail, "caf\ufffd \u00e9", "cut"]
    assert [time_us for time_us, _ in decoded.texts] == [
        START_US + 20_000 * number for number in (1, 2, 4, 6, 7)
    ]


def test_unknown_message_is_skipped_with_its_number_and_does_no_harm() -> None:
    unknown = frame(54321, b"hello", crc_extra=77)
    decoded = read(log([heartbeat(), unknown, attitude(1), unknown]))
    assert [(part.reason, part.count, part.bytes) for part in decoded.account.skipped] == [
        ("unknown message id 54321", 2, 2 * (8 + len(unknown)))
    ]
    assert decoded.status == "complete"
    assert decoded.counts == {"HEARTBEAT": 1, "ATTITUDE": 1}


@pytest.mark.parametrize(
    "data",
    [
        b"\x00",
        b"\xfd" * 500,
        b"\x00\x05" + b"\xfd" * 400,
        b"not a log at all" * 40,
        bytes(5000),
    ],
)
def test_nothing_to_read(data: bytes) -> None:
    decoded = read(data)
    assert decoded.messages == {}
    assert decoded.counts == {}
    assert decoded.account.record_bytes == 0


def test_an_empty_file_is_refused() -> None:
    with pytest.raises(LogError, match=r"log\.tlog: the file is empty\. Copy the log"):
        TLOG.read(RawFile("log.tlog", np.zeros(0, np.uint8)))


def test_input_is_not_written_to() -> None:
    buffer = np.frombuffer(SMALL.read_bytes()[:50_000], dtype=np.uint8).copy()
    before = buffer.copy()
    TLOG.read(RawFile("log.tlog", buffer))
    np.testing.assert_array_equal(buffer, before)


def test_a_stray_byte_before_the_first_record() -> None:
    data = b"\x01" + log([heartbeat(), attitude(1)])
    decoded = read(data)
    assert decoded.messages["ATTITUDE"].offset.tolist() == [1 + 8 + len(heartbeat())]
    assert [part.reason for part in decoded.account.skipped] == ["garbage between frames"]
