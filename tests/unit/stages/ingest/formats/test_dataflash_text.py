"""The reader of DataFlash text logs: against pymavlink and the binary reader on one
real dive, and line by line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_text

from auvid.data_schemas.errors import LogError
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog, LogReader
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from auvid.stages.ingest.formats.dataflash.text_reader import DATAFLASH_TEXT

SMALL = Path(__file__).parents[4] / "data/bluerov2_ugps_small/small.BIN"
FMT_LINE = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\n"
HEAD = (
    "ArduSub V4\n\n"
    + FMT_LINE
    + "FMT, 129, 23, PARM, Nf, Name,Value\nFMT, 131, 31, IMU, Iff, TimeMS,GyrX,AccZ\n"
    + "FMT, 132, 67, MSG, Z, Message\nFMT, 1, 19, ATT, cc, Roll,Pitch\nFMT, 3, 6, MODE, Mh,"
    " Mode,ThrCrs\nFMT, 10, 3, STRT, , \n"
)


def read(text: str | bytes, types: frozenset[str] | None = None) -> DecodedLog:
    data = text.encode() if isinstance(text, str) else text
    log = DATAFLASH_TEXT.read(RawFile("dive.log", np.frombuffer(data, np.uint8)), types)
    account = log.account
    assert (
        account.record_bytes + account.definition_bytes + account.skipped_bytes
        == account.size
        == len(data)
    )
    return log


def reasons(log: DecodedLog) -> dict[str, tuple[int, int]]:
    return {part.reason: (part.count, part.bytes) for part in log.account.skipped}


@pytest.fixture(scope="module")
def dive() -> str:
    """The real dive printed as the firmware of 2015 would: scaled numbers, one record
    per line, in the order of the binary log.
    """
    log = DATAFLASH.read(RawFile("small.BIN", np.fromfile(SMALL, np.uint8)))
    lines: list[tuple[int, str]] = []
    for name, table in log.messages.items():
        columns = [column.tolist() for column in table.columns.values()]
        for offset, *row in zip(table.offset.tolist(), *columns, strict=True):
            cells = [
                value.decode("latin-1") if isinstance(value, bytes) else repr(value)
                for value in row
            ]
            lines.append((offset, f"{name}, {', '.join(cells)}"))
    return "\n".join(line for _, line in sorted(lines)) + "\n"


def test_every_field_of_every_message_equals_pymavlink(dive: str, tmp_path: Path) -> None:
    path = tmp_path / "dive.log"
    path.write_text(dive)
    expected: dict[str, list[Any]] = {}
    reference = DFReader_text(str(path))
    while (message := reference.recv_msg()) is not None:
        expected.setdefault(message.get_type(), []).append(message)
    reference.close()
    log = read(dive)
    assert log.counts == {
        name: len(rows) + (name == "UNIT") for name, rows in expected.items()
    }  # it drops the unit without a label
    for name, rows in expected.items():
        if name in ("MSG", "UNIT"):  # it ends a text at its first comma
            continue
        for field, column in log.messages[name].columns.items():
            values = [getattr(row, field) for row in rows]
            if column.dtype.kind == "S":
                assert [raw.decode() for raw in column.tolist()] == values, (name, field)
            else:
                np.testing.assert_array_equal(column, np.asarray(values), err_msg=f"{name}.{field}")
    assert log.status == "complete"


def test_text_and_binary_log_give_the_same_values(dive: str) -> None:
    binary = DATAFLASH.read(RawFile("small.BIN", np.fromfile(SMALL, np.uint8)))
    log = read(dive)
    assert log.counts == binary.counts
    assert log.parameters == binary.parameters
    assert log.texts == binary.texts
    for name, table in binary.messages.items():
        assert log.messages[name].units == table.units, name
        for field, column in table.columns.items():
            if column.dtype.kind == "S":
                assert log.messages[name].columns[field].tolist() == column.tolist(), (name, field)
            else:
                np.testing.assert_array_equal(
                    log.messages[name].columns[field].astype(column.dtype),
                    column,
                    err_msg=f"{name}.{field}",
                )


def test_lines_before_the_first_definition_and_blank_lines_are_counted_and_harmless() -> None:
    log = read(HEAD + "IMU, 10, 0.1, -9.8\n\n")
    assert reasons(log) == {"blank line": (2, 2), "text before the first definition": (1, 11)}
    assert log.status == "complete"
    assert log.counts == {"FMT": 7, "IMU": 1}


@pytest.mark.parametrize("rows", [3, 100])
def test_values_of_each_kind(rows: int) -> None:
    lines = "".join(f"IMU, {10 * k}, {k}.5, nan\nATT, -1.25, {k}\n" for k in range(rows))
    log = read(
        HEAD
        + lines
        + "PARM, PSC_D, 1\nPARM, PSC_D, nan\nMODE, Alt Hold, 500\nMSG, depth, 3 m\nSTRT, \n"
    )
    imu = log.messages["IMU"].columns
    assert imu["TimeMS"].dtype == np.int64
    assert imu["TimeMS"].tolist() == [10 * k for k in range(rows)]
    assert imu["GyrX"].tolist() == [k + 0.5 for k in range(rows)]
    assert np.isnan(imu["AccZ"]).all()
    assert log.messages["ATT"].columns["Roll"].tolist() == [-1.25] * rows
    assert log.messages["MODE"].columns["Mode"].tolist() == [b"Alt Hold"]
    assert log.texts == ((0, "depth, 3 m"),)
    assert np.isnan(log.parameters["PSC_D"])
    assert log.counts["STRT"] == 1
    assert any("milliseconds" in note for note in log.notes)
    assert any("Without a time field" in note and "ATT, MODE" in note for note in log.notes)


@pytest.mark.parametrize("rows", [3, 100])
def test_integer_field_printed_with_decimals(rows: int) -> None:
    times = read(HEAD + "IMU, 10.000, 1, 2\n" * rows).messages["IMU"].columns["TimeMS"]
    assert times.dtype == np.int64
    assert times.tolist() == [10] * rows
    broken = read(HEAD + "IMU, 10.5, 1, 2\n" * rows).messages["IMU"].columns["TimeMS"]
    assert broken.tolist() == [10.5] * rows


def test_separators_without_blanks_and_line_ends_of_windows() -> None:
    text = (HEAD + "IMU, 10, 0.1, -9.8\nMSG, hello\n").replace(", ", ",").replace("\n", "\r\n")
    log = read(text)
    assert log.messages["IMU"].columns["AccZ"].tolist() == [-9.8]
    assert log.texts == ((0, "hello"),)
    assert log.status == "complete"


@pytest.mark.parametrize("rows", [3, 100])
def test_damaged_lines_are_counted_by_reason(rows: int) -> None:
    good = "".join(f"IMU, {100 * k}, 1, 2\n" for k in range(rows))
    bad = (
        "IMU, 100, 1\nIMU, 1, 2, 3IMU, 4, 5, 6\nIMU, 1O0, 1, 2\nXYZ, 1, 2\nga\x01rbage\nIMU, ,"
        " 1, 2\n"
    )
    log = read(HEAD + good + bad + "".join(f"IMU, {100 * k + 60_000}, 1, 2\n" for k in range(rows)))
    lost = reasons(log)
    assert lost["line with a wrong number of fields"] == (2, 12 + 25)
    assert lost["line with an unreadable number"] == (2, 15 + 12)
    assert lost["message type XYZ without a definition"] == (1, 10)
    assert lost["line that is not a record"] == (1, 9)
    assert log.counts["IMU"] == 2 * rows
    assert log.status == "damaged"
    assert log.seconds_lost == pytest.approx(60.0 - 0.1 * rows, abs=0.6)


def test_last_line_without_an_end_is_not_believed() -> None:
    """Its last number may have lost digits."""
    log = read(HEAD + "IMU, 10, 0.1, -9.8\nIMU, 20, 0.1, -9.")
    assert log.counts["IMU"] == 1
    assert log.status == "truncated"
    assert reasons(log)["line cut off by the end of the file"] == (1, 17)


def test_unsound_definitions_are_refused_with_their_type() -> None:
    log = read(
        HEAD + "FMT, 5, 9, BAD, f?, a,b\nFMT, 6, 9, FEW, ff, a\nFMT, 7, 9\nBAD, 1, 2\nFEW, 1, 2\n"
    )
    lost = reasons(log)
    assert lost["definition with an unknown format character"][0] == 1
    assert lost["definition whose field names do not match its format"][0] == 1
    assert lost["line with a wrong number of fields"][0] == 1
    assert {"BAD", "FEW"}.isdisjoint(log.counts)
    assert log.status == "damaged"


def test_redefined_type_is_joined_by_field_name() -> None:
    log = read(HEAD + "IMU, 1, 2, 3\n" * 2 + "FMT, 131, 31, IMU, If, TimeMS,GyrY\n" + "IMU, 4, 5\n")
    columns = log.messages["IMU"].columns
    assert columns["TimeMS"].tolist() == [1, 1, 4]
    np.testing.assert_array_equal(columns["GyrY"], [np.nan, np.nan, 5.0])
    np.testing.assert_array_equal(columns["GyrX"], [2.0, 2.0, np.nan])


def test_only_wanted_types_are_decoded_and_all_are_counted() -> None:
    text = HEAD + "IMU, 10, 0.1, -9.8\nATT, 1, 2\nPARM, A, 1\n"
    log = read(text, frozenset({"ATT"}))
    assert set(log.messages) == {"ATT"}
    assert log.counts == read(text).counts
    assert log.account == read(text).account
    assert log.parameters == {"A": 1.0}


@pytest.mark.parametrize("text", ["", "\n", "time,depth\n0,1\n", "FMT", "no log\n"])
def test_what_is_no_log_is_refused(text: str) -> None:
    with pytest.raises(LogError, match=r"dive\.log"):
        read(text)


def test_any_damage_of_bytes_gives_an_account() -> None:
    rng = np.random.default_rng(3)
    text = np.frombuffer(
        (HEAD + "".join(f"IMU, {k}, 1, 2\nATT, 1, {k}\n" for k in range(200))).encode(), np.uint8
    )
    for _ in range(100):
        data = text.copy()
        data[rng.integers(len(HEAD), data.size, 20)] = rng.integers(0, 256, 20)
        log = read(data.tobytes())
        assert 0 < log.counts["IMU"] + log.counts["ATT"] <= 420


def test_recognises_by_content() -> None:
    reader: LogReader = DATAFLASH_TEXT
    assert reader.name == "dataflash_text"
    assert reader.recognises(HEAD.encode())
    assert reader.recognises(FMT_LINE.replace(", ", ",").encode())
    assert not reader.recognises(b"time,depth\n0,1\n")
    assert not reader.recognises(SMALL.read_bytes()[:65536])
    assert not DATAFLASH.recognises(HEAD.encode())
