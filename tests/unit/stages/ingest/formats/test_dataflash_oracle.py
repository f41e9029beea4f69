"""The DataFlash reader against pymavlink: every field of every message of two real
dives, whole and damaged.
"""

from __future__ import annotations

import contextlib
import datetime
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary

from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from tests.support.dataflash_writer import HEADER_RECORDS, fmt, group, record
from tests.support.mutate import mutations

ROOT = Path(__file__).parents[5]
SMALL = ROOT / "tests/data/bluerov2_ugps_small/small.BIN"
DIVE = ROOT / "campaigns/bluerov2_dvl/logs/00000029_first130s.BIN"


def ours(data: bytes) -> DecodedLog:
    return DATAFLASH.read(RawFile("log.BIN", np.frombuffer(data, np.uint8)))


def theirs(path: Path, **match: Any) -> Iterator[Any]:
    """pymavlink's messages; its complaints about bad bytes are not printed."""
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        log = DFReader_binary(str(path))
        while (message := log.recv_match(**match)) is not None:
            yield message
        log.close()


def text(raw: bytes) -> str:
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


@pytest.mark.parametrize("path", [SMALL, DIVE], ids=lambda path: path.stem)
def test_every_field_of_every_message_equals_pymavlink(path: Path) -> None:
    log = ours(path.read_bytes())
    expected: dict[str, list[Any]] = {}
    for message in theirs(path):
        expected.setdefault(message.get_type(), []).append(message)
    assert {name: len(table) for name, table in log.messages.items()} == {
        name: len(rows) for name, rows in expected.items()
    }
    assert log.counts == {name: len(rows) for name, rows in expected.items()}
    for name, rows in expected.items():
        table = log.messages[name]
        assert list(table.columns) == rows[0].get_fieldnames(), name
        for field, column in table.columns.items():
            values = [getattr(row, field) for row in rows]
            if column.dtype.kind == "S":
                assert [text(raw) for raw in column.tolist()] == values, (name, field)
            else:
                np.testing.assert_array_equal(column, np.asarray(values), err_msg=f"{name}.{field}")
    assert log.status == "complete"
    assert log.account.skipped == ()


@pytest.mark.parametrize("path", [SMALL, DIVE], ids=lambda path: path.stem)
def test_units_parameters_and_texts_equal_pymavlink(path: Path) -> None:
    log = ours(path.read_bytes())
    reference = DFReader_binary(str(path))
    for definition in reference.formats.values():
        if definition.name not in log.messages:
            continue
        units = {
            name: unit
            for name, unit in zip(definition.columns, definition.units or [], strict=False)
            if unit
        }
        expected = {name: "#" if unit == "instance" else unit for name, unit in units.items()}
        assert {
            name: unit
            for name, unit in log.messages[definition.name].units.items()
            if unit != "#" or name in expected
        } == expected
    reference.close()
    parameters = {message.Name: message.Value for message in theirs(path, type="PARM")}
    assert log.parameters == pytest.approx(parameters, rel=0, abs=0)
    messages = list(theirs(path, type="MSG"))
    assert "".join(text for _, text in log.texts) == "".join(
        message.Message for message in messages
    )
    assert log.texts[0][0] == messages[0].TimeUS


def test_filtered_read_of_pymavlink_stops_at_the_first_damage(tmp_path: Path) -> None:
    """Known fault of pymavlink 2.4.50: its C index ends at an unknown type, so asking
    for one type loses the rest in silence.
    """
    clean = ours(SMALL.read_bytes())
    unused = set(range(256)) - set(clean.messages["FMT"].columns["Type"].tolist())
    data = bytearray(SMALL.read_bytes())
    data[int(clean.messages["IMU"].offset[100]) + 2] = min(unused)
    path = tmp_path / "damaged.BIN"
    path.write_bytes(data)
    filtered = sum(1 for _ in theirs(path, type="ATT", strict=True))
    log = ours(bytes(data))
    assert filtered < len(clean.messages["ATT"]) / 2
    assert len(log.messages["ATT"]) == len(clean.messages["ATT"])
    assert len(log.messages["IMU"]) == len(clean.messages["IMU"]) - 1


def test_clock_that_leaps_to_unix_time_is_kept_and_told(tmp_path: Path) -> None:
    """Known fault of pymavlink 2.4.50: with a clock that leaps from boot time to Unix
    time, its own clock reads the year 2083.
    """
    unix_us = 1_784_255_537_000_000
    week, ms = 2427, 300_000_000  # July 2026 in GPS weeks
    stamps = [*range(0, 1_000_000, 100_000), *range(unix_us, unix_us + 5_000_000, 100_000)]
    data = HEADER_RECORDS + fmt(13, "GPS", "QIH", "TimeUS,GMS,GWk") + group(0)[:16]
    data += record(13, "QIH", 0, ms, week) + b"".join(
        record(12, "Qff", stamp, 0.0, 1.0) for stamp in stamps
    )
    path = tmp_path / "leap.BIN"
    path.write_bytes(data)
    last = list(theirs(path, type="BARO"))[-1]
    assert datetime.datetime.fromtimestamp(last._timestamp, datetime.UTC).year == 2083
    log = ours(data)
    assert log.messages["BARO"].columns["TimeUS"].tolist() == stamps
    assert any("leaps forward by 1.78426e+09 s" in note for note in log.notes)
    assert any("counts from 1970" in note for note in log.notes)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_that_pymavlink_recovers_from_a_damaged_log_is_missing(
    seed: int, tmp_path: Path
) -> None:
    """Each undamaged record that pymavlink's unfiltered read finds, the reader finds.
    pymavlink dies of damaged units: those are kept.
    """
    clean = ours(SMALL.read_bytes())
    protect = int(clean.messages["FMTU"].offset.max()) + 200
    data, kept = mutations(
        SMALL.read_bytes(), seed, ("flips", "overwrite", "removal", "zeros", "hostile"), protect
    )
    path = tmp_path / "damaged.BIN"
    path.write_bytes(data)
    lengths = {
        text(name): int(length)
        for name, length in zip(
            *(clean.messages["FMT"].columns[key] for key in ("Name", "Length")), strict=True
        )
    }
    starts = {
        (name, offset) for name, table in clean.messages.items() for offset in table.offset.tolist()
    }
    expected = {
        (name, part.moved(start))
        for name, start in starts
        for part in kept
        if part.start <= start and start + lengths[name] <= part.stop
    }
    recovered = {
        (name, offset)
        for name, table in ours(data).messages.items()
        for offset in table.offset.tolist()
    }
    reference = set()
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        reader = DFReader_binary(str(path))
        while (message := reader.recv_msg()) is not None:
            reference.add((message.get_type(), reader.offset - message.fmt.len))
        reader.close()
    assert reference & expected <= recovered
    assert len(reference & expected) > 0.9 * len(expected)
    assert len(recovered & expected) >= 0.999 * len(expected)
