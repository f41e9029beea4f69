"""CSV logs through a column map: units, frames, time, held and empty samples, and the
account of rows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.errors import CampaignError, LogError
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.csv.reader import CSV, header, read_csv

TIME = {"column": "t", "unit": "s"}


def csv_file(
    text: str, columns: list[dict[str, Any]] | None, encoding: str = "utf-8", **keys: Any
) -> RawFile:
    mapping = None if columns is None else {"time": TIME, "columns": columns, **keys}
    return RawFile("dive.csv", np.frombuffer(text.encode(encoding), np.uint8), mapping)


def item(column: str, stream: str, field: str, unit: str, **keys: Any) -> dict[str, Any]:
    return {"column": column, "stream": stream, "field": field, "unit": unit, **keys}


DEPTH = [item("d", "depth", "depth_m", "m")]


def read_one(
    text: str, columns: list[dict[str, Any]], stream: str, **keys: Any
) -> dict[str, np.ndarray[Any, Any]]:
    return dict(read_csv(csv_file(text, columns, **keys))[0].messages[stream].columns)


@pytest.mark.parametrize(
    ("unit", "field", "stream", "value", "expected"),
    [
        ("cm", "depth_m", "depth", "250", 2.5),
        ("feet", "depth_m", "depth", "10", 3.048),
        ("mV", "voltage_v", "battery", "15900", 15.9),
        ("degC", "depth_m", "depth", "1", None),
    ],
)
def test_units_become_si(
    unit: str, field: str, stream: str, value: str, expected: float | None
) -> None:
    columns = [item("d", stream, field, unit)]
    if expected is None:
        with pytest.raises(Exception, match="wrong unit"):
            read_one(f"t,d\n0,{value}\n", columns, stream)
        return
    got = read_one(f"t,d\n0,{value}\n", columns, stream)
    assert got[field][0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "value", "rev_s"),
    [("rpm", 1800.0, 30.0), ("rev/s", 30.0, 30.0), ("1/s", 30.0, 30.0), ("rad/s", 2 * np.pi, 1.0)],
)
def test_propeller_speed_counts_revolutions(unit: str, value: float, rev_s: float) -> None:
    got = read_one(
        f"t,n\n0,{value!r}\n", [item("n", "actuators", "propeller_rev_s", unit)], "actuators"
    )
    assert got["propeller_rev_s"][0] == pytest.approx(rev_s, rel=1e-12)


def test_gravity_as_unit_of_the_accelerometer() -> None:
    text = "t,p,q,r,x,y,z\n0,0,0,0,0,0,-1\n"
    columns = [
        item(c, "imu", f"gyro_{a}_rad_s", "deg/s") for c, a in zip("pqr", "xyz", strict=True)
    ]
    columns += [item(c, "imu", f"accel_{c}_m_s2", "g0") for c in "xyz"]
    got = read_one(text, columns, "imu", accelerometer="specific_force")
    assert got["accel_z_m_s2"][0] == pytest.approx(-9.80665, rel=1e-12)


def test_frame_flu_flips_left_and_up_and_sign_comes_on_top() -> None:
    columns = [
        item(c, "velocity", f"{f}_m_s", "m/s", frame="flu")
        for c, f in zip("xyz", "uvw", strict=True)
    ]
    columns[2]["sign"] = -1
    got = read_one("t,x,y,z\n0,1,2,3\n", columns, "velocity")
    assert [got[f"{f}_m_s"][0] for f in "uvw"] == [1.0, -2.0, 3.0]


def test_velocity_through_the_water_is_a_stream_of_its_own() -> None:
    columns = [
        item(f"{name}{stream[0]}", stream, f"{name}_m_s", "m/s", frame="flu")
        for stream in ("velocity", "water_velocity")
        for name in "uvw"
    ]
    text = "t,uv,vv,wv,uw,vw,ww\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n"
    assert [read_one(text, columns, "velocity")[f"{name}_m_s"][0] for name in "uvw"] == [
        1.0,
        -2.0,
        -3.0,
    ]
    assert [read_one(text, columns, "water_velocity")[f"{name}_m_s"][0] for name in "uvw"] == [
        4.0,
        -5.0,
        -6.0,
    ]


def test_attitude_against_east_north_up() -> None:
    # Facing east, nose up by 10 degrees: ENU yaw 0 and pitch -10 (positive nose down
    # there) are NED yaw 90 and pitch 10.
    columns = [
        item(c, "attitude", f"{f}_rad", "deg", frame="enu")
        for c, f in zip("xyz", ("phi", "theta", "psi"), strict=True)
    ]
    got = read_one("t,x,y,z\n0,5,-10,0\n", columns, "attitude")
    assert np.degrees([got[f"{f}_rad"][0] for f in ("phi", "theta", "psi")]) == pytest.approx(
        [5.0, 10.0, 90.0], abs=1e-12
    )


@pytest.mark.parametrize(
    ("unit", "stamps", "expected"),
    [
        ("s", ["0.25", "1.5"], [250_000, 1_500_000]),
        ("ms", ["250", "1500"], [250_000, 1_500_000]),
        ("ns", ["250000", "1500000"], [250, 1_500]),
        ("iso8601", ["1970-01-01T00:00:00.25", "1970-01-01 00:00:01.5"], [250_000, 1_500_000]),
        (
            "iso8601",
            ["1970-01-01T01:00:00.25+01:00", "1970-01-01T00:00:01.5Z"],
            [250_000, 1_500_000],
        ),
    ],
)
def test_time_becomes_microseconds(unit: str, stamps: list[str], expected: list[int]) -> None:
    text = "t,d\n" + "".join(f"{stamp},1\n" for stamp in stamps)
    file = csv_file(text, DEPTH, time={"column": "t", "unit": unit})
    assert (
        np.rint(read_csv(file)[0].messages["depth"].columns["time_us"].astype(float)).tolist()
        == expected
    )


def test_nanoseconds_stand_beside_whole_seconds() -> None:
    text = "sec,nanosec,d\n1700000000,250000000,1\n1700000001,5000,1\n"
    clock = {"column": "sec", "unit": "s", "nanoseconds": "nanosec"}
    log, _ = read_csv(csv_file(text, DEPTH, time=clock))
    assert log.messages["depth"].columns["time_us"].tolist() == [
        1.70000000025e15,
        1.700000001000005e15,
    ]
    with pytest.raises(CampaignError, match="within a second; found 'ms'"):
        read_csv(csv_file(text, DEPTH, time=clock | {"unit": "ms"}))
    with pytest.raises(CampaignError, match="no such column; found 'nsec'"):
        read_csv(csv_file(text, DEPTH, time=clock | {"nanoseconds": "nsec"}))


def test_held_stream_keeps_changes_only() -> None:
    rows = "t,d,u\n0,1,5\n1,1,6\n2,2,7\n3,2,8\n4,1,9\n"
    log, _ = read_csv(csv_file(rows, [*DEPTH, item("u", "range", "range_m", "m")], held=["depth"]))
    assert log.messages["depth"].columns["time_us"].tolist() == [0.0, 2e6, 4e6]
    assert len(log.messages["range"]) == 5
    assert [
        (part.reason, part.count, part.first_offset, part.last_offset)
        for part in log.account.skipped
    ] == [("depth: held value repeated", 2, 3, 5)]


def test_rows_without_a_value_are_no_samples_of_the_stream() -> None:
    text = "t,d,u\n0,1,\n1,,2\n2,--.--,3\n3,4,\n"
    log, _ = read_csv(
        csv_file(text, [*DEPTH, item("u", "range", "range_m", "m")], missing=["--.--"])
    )
    assert log.messages["depth"].columns["depth_m"].tolist() == [1.0, 4.0]
    assert log.messages["range"].columns["range_m"].tolist() == [2.0, 3.0]
    assert log.messages["range"].offset.tolist() == [3, 4]


def test_rows_are_counted_as_an_editor_counts_them() -> None:
    log, _ = read_csv(csv_file("t,d\n\n0,1\n\n\n1,2\n2,3,4\n3,4\n", DEPTH))
    assert log.messages["depth"].offset.tolist() == [3, 6, 8]
    assert [(part.count, part.first_offset) for part in log.account.skipped] == [(1, 7)]
    assert log.status == "damaged"


@pytest.mark.parametrize("tail", ["", "\n", "2", "2\n", "2,3"])
def test_every_byte_is_accounted_for(tail: str) -> None:
    text = "t,d\n0,1\n1,2\n" + tail
    log, _ = read_csv(csv_file(text, DEPTH))
    account = log.account
    assert (
        account.record_bytes + account.definition_bytes + account.skipped_bytes
        == account.size
        == len(text)
    )
    assert log.status == ("truncated" if tail in ("2", "2\n") else "complete")


def test_semicolons_decimal_commas_and_latin_1() -> None:
    file = csv_file(
        "t;Tiefe (°)\n0,5;1,25\n",
        [item("Tiefe (°)", "depth", "depth_m", "m")],
        "latin-1",
        delimiter=";",
        decimal=",",
    )
    columns = read_csv(file)[0].messages["depth"].columns
    assert (columns["time_us"][0], columns["depth_m"][0]) == (500_000.0, 1.25)


def test_byte_order_mark_and_windows_line_ends() -> None:
    columns = read_one("\ufefft,d\r\n0,1\r\n1,2\r\n", DEPTH, "depth")
    assert columns["depth_m"].tolist() == [1.0, 2.0]


def test_a_log_of_qgroundcontrol_needs_no_column_map() -> None:
    header = "Timestamp,roll,pitch,heading,rollRate,pitchRate,altitudeRelative,battery0.voltage"
    rows = (
        "2023-07-14 08:57:35.476,-1.0,0.8,309,0.1,0.2,-2.5,--.--\n2023-07-14"
        " 08:57:36.476,-1.0,0.8,310,0.1,0.2,-3.5,16.5\n"
    )
    log, mapping = read_csv(csv_file(f"{header}\n{rows}", None))
    assert sorted(log.messages) == [
        "attitude",
        "battery",
        "depth",
    ]  # no yaw rate in this version: no rates at all
    assert log.messages["depth"].columns["depth_m"].tolist() == [2.5, 3.5]
    assert log.messages["battery"].offset.tolist() == [3]
    assert mapping.epoch == "arbitrary"
    assert "QGroundControl" in log.notes[0]


QGC = "Timestamp,roll,pitch,heading,rollRate,altitudeRelative"
BATTERY = "0,0,0,17.0,-3.5,1,2,3,4,5,6,7"


def test_rows_of_qgroundcontrol_may_have_a_battery_that_its_header_lacks() -> None:
    """It writes the header before the vehicle has reported a battery, and never again."""
    early = [f"2023-07-14 08:57:3{n}.5,1,2,3,0,-{n},08:57:3{n},7/14/23" for n in range(2)]
    late = [f"2023-07-14 08:57:3{n}.5,1,2,3,0,-{n},{BATTERY},08:57:3{n},7/14/23" for n in (2, 3)]
    text = "\n".join([f"{QGC},clock.currentTime,clock.currentDate", *early, *late, ""])
    log, _ = read_csv(csv_file(text, None))
    assert (log.status, log.account.skipped[0].bytes) == ("complete", 0)
    assert log.messages["depth"].columns["depth_m"].tolist() == [0, 1, 2, 3]
    assert log.messages["battery"].columns["current_a"].tolist() == [-3.5, -3.5]
    assert log.messages["battery"].offset.tolist() == [4, 5]
    assert "the header lacks 12 columns (battery0.id ...)" in log.notes[-1]


def test_longer_rows_that_are_no_battery_stay_damage() -> None:
    row = f"2023-07-14 08:57:31.5,1,2,3,0,-1,08:57:31,7/14/23,{BATTERY}"
    text = "\n".join([f"{QGC},clock.currentTime,clock.currentDate", row, row[:48], ""])
    log, _ = read_csv(csv_file(text, None))
    assert log.status == "damaged"
    assert "row that has not 8 cells" in {item.reason for item in log.account.skipped}


def test_infinite_values_are_kept_for_the_check_of_samples() -> None:
    assert np.isinf(read_one("t,d\n0,inf\n1,-inf\n", DEPTH, "depth")["depth_m"]).all()


def test_columns_that_nobody_mapped_are_listed() -> None:
    log, _ = read_csv(csv_file("t,d,spare\n0,1,2\n", DEPTH))
    assert log.notes == ("dive.csv: columns that the column map does not name: spare",)


@pytest.mark.parametrize(
    ("head", "expected"),
    [
        (b"t,d\n0,1\n", True),
        (b"\xa3\x95\x80,", True),
        (b"\0\0,\0\n", False),
        (b"no columns\n", False),
    ],
)
def test_recognises_text_with_columns(head: bytes, expected: bool) -> None:
    assert CSV.recognises(head) is expected


@pytest.mark.parametrize("above", ["# dive 29\n", "\n\n", "# a, pool\nVehicle: ROV\n", "sep=,\n"])
def test_lines_above_the_names_are_named(above: str) -> None:
    text = above + "t,d,e,f\n" + "".join(f"{row},{row}.5,1,2\n" for row in range(9))
    file = csv_file(text, DEPTH)
    row = above.count("\n") + 1
    assert CSV.recognises(text.encode())
    with pytest.raises(LogError, match=f"names of the columns stand in row {row}, and not in the"):
        read_csv(file)


@pytest.mark.parametrize(("rotation", "bodies"), [("Quaternion", 1), ("XYZ", 1), ("Quaternion", 2)])
def test_an_export_of_motive_is_named_with_its_names_in_one_line(
    rotation: str, bodies: int
) -> None:
    kinds = ["Rotation"] * 4 + ["Position"] * 3
    head = [
        ["Format Version", "1.23", "Rotation Type", rotation, "Coordinate Space", "Global"],
        [],
        ["", "", *["Rigid Body"] * 7 * bodies],
        ["", "Name", *[f"ROV{number}" for number in range(bodies) for _ in kinds]],
        ["", "ID", *["1"] * 7 * bodies],
        ["", "", *kinds * bodies],
        ["Frame", "Time (Seconds)", *"XYZWXYZ" * bodies],
    ]
    rows = [[str(n), f"{n / 100}", *["0.5"] * 7 * bodies] for n in range(30)]
    text = "".join(",".join(row) + "\n" for row in head + rows)
    with pytest.raises(LogError, match="an export of OptiTrack Motive") as caught:
        header(RawFile("run1.csv", np.frombuffer(text.encode(), np.uint8)), None)
    line = "Frame,Time (Seconds),Rotation X,Rotation Y,Rotation Z,Rotation W,Position X"
    to_do = f"(echo '{line},Position Y,Position Z'; tail -n +8 run1.csv) > table_run1.csv"
    assert (to_do in str(caught.value)) == (rotation == "Quaternion" and bodies == 1)
    assert ("rotation type Quaternion" in str(caught.value)) == (rotation == "XYZ")


def test_utf_16_without_a_mark_is_named() -> None:
    data = "time_s,depth_m\n0,1\n".encode("utf-16-le")
    assert CSV.recognises(data)
    with pytest.raises(LogError, match="UTF-16"):
        read_csv(RawFile("dive.csv", np.frombuffer(data, np.uint8), None))


def test_unix_microseconds_declared_as_seconds_are_named() -> None:
    with pytest.raises(LogError, match="Set unit: us for the time column, and epoch: unix"):
        read_one("t,d\n1772406020000000,1\n1772406020100000,2\n", DEPTH, "depth")
