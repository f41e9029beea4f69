"""What a wrong CSV file or column map is told: file, row or key, value, what is
allowed, and the remedy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.errors import LogError, PipelineError
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.csv.reader import read_csv
from auvid.stages.ingest.formats.csv.tolerant_lines import (
    LONG_ROW,
    STRAY_QUOTE,
    UNREADABLE,
    WRONG_CELLS,
)

GOOD = "t,d\n0,1\n1,2\n"
DEPTH = {"column": "d", "stream": "depth", "field": "depth_m", "unit": "m"}


def message(text: str = GOOD, columns: list[dict[str, Any]] | None = None, **keys: Any) -> str:
    mapping = {"time": {"column": "t", "unit": "s"}, "columns": columns or [DEPTH], **keys}
    with pytest.raises(PipelineError) as caught:
        read_csv(RawFile("dive.csv", np.frombuffer(text.encode(), np.uint8), mapping))
    return str(caught.value)


def changed(**keys: Any) -> list[dict[str, Any]]:
    return [{**DEPTH, **keys}]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (changed(column="dd"), ("columns[0].column", "'dd'", "Did you mean 'd'?")),
        (changed(stream="dept"), ("columns[0].stream", "Did you mean 'depth'?")),
        (changed(field="depth"), ("columns[0].field", "Did you mean 'depth_m'?")),
        (changed(unit="kg"), ("columns[0].unit", "'kg'", "a unit of m")),
        (changed(unit="banana"), ("columns[0].unit", "'banana'")),
        (changed(sing=1), ("unknown key", "columns[0].sing", "Did you mean 'sign'?")),
        (changed(sign=2), ("columns[0].sign", "found 2")),
        ([DEPTH, DEPTH], ("mapped twice",)),
        (
            [{**DEPTH, "stream": "velocity", "field": "u_m_s", "unit": "m/s"}],
            ("stream 'velocity' is incomplete", "v_m_s, w_m_s"),
        ),
        (
            [{**DEPTH, "stream": "velocity", "field": "u_m_s", "unit": "m/s", "frame": "enu"}],
            ("body axis", "frd, flu"),
        ),
    ],
)
def test_wrong_column_maps(columns: list[dict[str, Any]], words: tuple[str, ...]) -> None:
    text = message(columns=columns)
    assert all(word in text for word in words), text


def test_all_faults_of_a_column_map_come_together() -> None:
    text = message(
        columns=[
            {**DEPTH, "unit": "kg"},
            {**DEPTH, "stream": "nothing"},
            {**DEPTH, "column": "no", "field": "depth_m"},
        ]
    )
    assert (
        text.count("column map of dive.csv") == 5
    )  # three entries, the field mapped twice, and the headline
    assert "4 faults" in text


def test_gram_is_not_gravity() -> None:
    columns = [{"column": "d", "stream": "imu", "field": "accel_x_m_s2", "unit": "g"}]
    assert "write g0" in message(columns=columns)


def test_accelerometer_without_its_convention() -> None:
    fields = [f"gyro_{axis}_rad_s" for axis in "xyz"]
    columns = [
        {"column": "d", "stream": "imu", "field": field, "unit": "rad/s"} for field in fields
    ]
    columns.append({"column": "d", "stream": "imu", "field": "accel_x_m_s2", "unit": "m/s^2"})
    assert "specific_force, inertial, derivative" in message(columns=columns)


def test_cells_that_are_no_numbers_are_named_with_their_rows() -> None:
    rows = "".join(f"{index},{'x' if index % 2 else index}\n" for index in range(60))
    text = message("t,d\n" + rows)
    assert "dive.csv, row 3, field 'd': not a number; found 'x'" in text
    assert "30 faults" in text
    assert "... and 10 more" in text
    assert "'missing'" in text


def test_blank_lines_do_not_shift_the_row() -> None:
    assert "row 5, field 'd'" in message("t,d\n0,1\n\n\n1,abc\n")


def test_a_time_that_is_no_time() -> None:
    text = message(
        "t,d\n2024-05-01T10:00:00,1\nyesterday,2\n", time={"column": "t", "unit": "iso8601"}
    )
    assert "row 3" in text
    assert "'yesterday'" in text
    assert "wrong unit" in message(time={"column": "t", "unit": "m"})


def test_without_a_column_map_the_header_is_shown() -> None:
    with pytest.raises(PipelineError) as caught:
        read_csv(RawFile("dive.csv", np.frombuffer(GOOD.encode(), np.uint8)))
    text = str(caught.value)
    assert "needs a column map; found '2 columns'" in text
    assert "columns: FILE" in text


@pytest.mark.parametrize("text", ["", "\n\n"])
def test_an_empty_file(text: str) -> None:
    assert "the file is empty" in message(text)


def test_a_held_stream_that_is_not_mapped() -> None:
    assert "field 'held'" in message(held=["velocity"])


def log_of(data: bytes, **keys: Any) -> DecodedLog:
    mapping = {"time": {"column": "t", "unit": "s"}, "columns": [DEPTH], **keys}
    log, _ = read_csv(RawFile("dive.csv", np.frombuffer(data, np.uint8), mapping))
    account = log.account
    assert (
        account.record_bytes + account.definition_bytes + account.skipped_bytes
        == account.size
        == len(data)
    )
    return log


def rows(count: int) -> list[bytes]:
    return [b"t,d\n", *(b"%d,%d\n" % (number, number) for number in range(count))]


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        (b"20,2x\n", UNREADABLE),
        (b"2\xff,20\n", UNREADABLE),
        (b"20,\x0020\n", UNREADABLE),
        (b'20,"20\n', STRAY_QUOTE),
        (b'20,2"0\n', STRAY_QUOTE),
        (b"20,20,\n", WRONG_CELLS.format(2)),
        pytest.param(b"20," + b"7" * 3_000_000 + b"\n", LONG_ROW, id="long row"),
        (b"\x00\x01garbage\xfe\n", WRONG_CELLS.format(2)),
    ],
)
def test_a_damaged_row_is_left_out_and_counted(row: bytes, reason: str) -> None:
    lines = rows(100)
    lines[21] = row
    log = log_of(b"".join(lines))
    assert log.messages["depth"].columns["depth_m"].tolist() == [*range(20), *range(21, 100)]
    assert [
        (part.reason, part.bytes, part.count, part.first_offset) for part in log.account.skipped
    ] == [(reason, len(row), 1, 22)]
    assert log.status == "damaged"
    assert log.seconds_lost == pytest.approx(2.0)  # s: between the rows on either side
    assert len(log.notes) == (reason == UNREADABLE)


def test_a_quotation_mark_swallows_no_rows() -> None:
    lines = rows(100)
    lines[10], lines[60] = b'9,"9\n', b'59"59",\n'
    assert len(log_of(b"".join(lines)).messages["depth"]) == 98


def test_quoted_cells_are_no_damage() -> None:
    log = log_of(b't,d,note\n0,1,"a, ""b"""\n1,"2",c\n2,x,y,z\n', columns=[DEPTH])
    assert log.messages["depth"].columns["depth_m"].tolist() == [1.0, 2.0]
    assert log.account.skipped[0].count == 1


def test_a_damaged_iso_time_costs_its_row() -> None:
    lines = [b"t,d\n", *(b"2024-05-01T10:00:%02d,%d\n" % (second, second) for second in range(60))]
    lines[30] = b"2024-05-01T1\xb0:00:29,29\n"
    log = log_of(b"".join(lines), time={"column": "t", "unit": "iso8601"})
    assert len(log.messages["depth"]) == 59


def test_nothing_but_damaged_rows() -> None:
    assert "no row can be read" in message("t,d\n1\n2\n")


SIMPLE: dict[str, object] = {
    "time": {"column": "t", "unit": "s"},
    "columns": [{"column": "d", "stream": "depth", "field": "depth_m", "unit": "m"}],
}


@pytest.mark.parametrize(
    ("content", "message_part"),
    [
        (b"t;d\n0,0;1,5\n", 'add delimiter: ";" to the column map, and decimal: ","'),
        (b"t\td\n0\t1\n", 'add delimiter: "\\t" to the column map'),
        ("t,d\n0,1\n".encode("utf-16"), "UTF-16"),
        (b"t,d\r\r0,1\n", "stray carriage return"),
        (b't,d\n0,"1,5"\n', 'add decimal: ","'),
    ],
)
def test_what_a_spreadsheet_makes_of_a_log_is_refused_with_the_remedy(
    content: bytes, message_part: str
) -> None:
    with pytest.raises(LogError) as refused:
        read_csv(RawFile("dive.csv", np.frombuffer(content, np.uint8), SIMPLE))
    assert message_part in str(refused.value)


def clock_log(first_s: float, count: int) -> RawFile:
    """Depth at 5 Hz; time 101530.25 is 10:15:30.25."""
    t = first_s + 0.2 * np.arange(count)
    digits = t % 86400 // 3600 * 1e4 + t // 60 % 60 * 100 + t % 60
    rows = "".join(f"{stamp:.2f},{5 + number}\n" for number, stamp in enumerate(digits))
    mapping = {"time": {"column": "t", "unit": "hhmmss"}, "columns": [DEPTH]}
    return RawFile("dive.csv", np.frombuffer(f"t,d\n{rows}".encode(), np.uint8), mapping)


@pytest.mark.parametrize("first_s", [36_930.0, 86_370.0])
def test_digits_of_a_clock_are_read_over_minutes_and_midnight(first_s: float) -> None:
    (decoded,) = read_csv(clock_log(first_s, 600))[:1]
    (message,) = decoded.messages.values()
    time_us = np.asarray(message.columns["time_us"])
    np.testing.assert_allclose(np.diff(time_us), 200_000, atol=1.5)  # us, digits are rounded


def test_digits_of_a_clock_are_no_seconds() -> None:
    file = clock_log(36_930.0, 600)
    mapping = {"time": {"column": "t", "unit": "s"}, "columns": [DEPTH]}
    with pytest.raises(LogError, match=r"digits of a clock.*hhmmss"):
        read_csv(RawFile(file.name, file.buffer, mapping))
