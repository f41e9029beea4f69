"""Messages to streams: which source is taken, in which unit and frame, and why another
is refused.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import (
    NEEDED,
    STREAMS,
    format_names,
    format_streams,
    mapping_table,
    supply_text,
)
from auvid.stages.ingest.decoded_log import ByteAccount, DecodedLog, Messages
from auvid.stages.ingest.registry import FORMATS, RULES
from auvid.stages.ingest.streams import common
from auvid.stages.ingest.streams import dataflash as streams_dataflash
from auvid.stages.ingest.streams import tlog as streams_tlog
from auvid.stages.ingest.streams import ulog as streams_ulog
from auvid.stages.ingest.streams.mapping import Stream, map_streams

STEP_US = 100_000


def message(name: str, count: int = 20, **columns: Any) -> Messages:
    values: dict[str, Any] = {"TimeUS": np.arange(count, dtype=np.uint64) * STEP_US + 7_000_000}
    values |= {
        key: np.asarray(value) if np.ndim(value) else np.full(count, value)
        for key, value in columns.items()
    }
    return Messages(name, values, np.arange(count) * 50)


def log(
    *messages: Messages,
    counts: dict[str, int] | None = None,
    parameters: dict[str, float] | None = None,
) -> DecodedLog:
    named = {item.name: item for item in messages}
    return DecodedLog(
        format="test",
        messages=named,
        counts={**{name: len(item) for name, item in named.items()}, **(counts or {})},
        account=ByteAccount(1000, 1000, 0),
        status="complete",
        parameters=parameters or {},
    )


def dataflash(decoded: DecodedLog, **sources: str) -> dict[str, Stream]:
    return map_streams(decoded, streams_dataflash.RULES, sources)


def statuses(stream: Stream) -> dict[str, str]:
    return {item["source"]: item["status"] for item in stream.alternatives}


@pytest.mark.parametrize("name", format_names())
def test_every_declared_source_fills_its_stream(name: str) -> None:
    spec = format_streams(name)
    rules = next(rules for _, rules in FORMATS if rules is not None and rules.mapping == name)
    assert spec is not None
    for stream, sources in spec.streams.items():
        assert stream in STREAMS
        for source in sources:
            assert source.compute is None or source.compute in rules.compute
            assert source.choose is None or source.choose in rules.scores
            assert source.when is None or source.when in rules.conditions
            if source.fields:
                assert set(NEEDED[stream]) <= set(source.fields) <= set(schema(stream).columns)


def test_every_reader_has_a_mapping_or_gives_streams_itself() -> None:
    assert [reader.name for reader, rules in FORMATS if rules is None] == ["csv"]
    assert {rules.mapping for rules in RULES.values() if rules} == set(format_names())


@pytest.mark.parametrize("stream", STREAMS)
def test_supply_names_every_format(stream: str) -> None:
    text = supply_text(stream)
    assert "CSV: columns mapped to" in text
    assert ("DataFlash: " in text) == (
        stream not in {"water_velocity", "glider", "tow", "fixes"}
    ), (
        "DataFlash logs have no message for velocity through the water, a glider's drive, a tow"
        " or an acoustic position"
    )


def test_attitude_and_imu_become_si() -> None:
    imu: dict[str, Any] = {f"Gyr{axis}": 0.1 for axis in "XYZ"} | {
        f"Acc{axis}": -9.8 for axis in "XYZ"
    }
    streams = dataflash(
        log(message("ATT", Roll=90.0, Pitch=-45.0, Yaw=270.0), message("IMU", **imu))
    )
    assert streams["attitude"].columns["phi_rad"][0] == pytest.approx(np.pi / 2, rel=1e-15)
    assert streams["attitude"].columns["psi_rad"][0] == pytest.approx(1.5 * np.pi, rel=1e-15)
    assert streams["imu"].columns["accel_z_m_s2"][0] == -9.8
    assert streams["imu"].columns["time_us"][1] - streams["imu"].columns["time_us"][0] == STEP_US


def test_the_unit_that_the_log_declares_goes_before_the_mapping() -> None:
    decoded = log(replace(message("RFND", Dist=250.0), units={"Dist": "cm"}))
    assert dataflash(decoded)["range"].columns["range_m"][0] == pytest.approx(2.5, rel=1e-15)
    assert dataflash(log(message("RFND", Dist=2.5)))["range"].columns["range_m"][0] == 2.5


def test_viso_displacement_over_its_own_interval() -> None:
    moved = {"PosDX": [0.01, 0.04, 1.0], "PosDY": [0.0, -0.02, 1.0], "PosDZ": [0.005, 0.0, 1.0]}
    viso = message("VISO", 3, dt=[0.1, 0.2, 0.0], conf=[100.0, 50.0, 0.0], **moved)
    columns = dataflash(log(viso))["velocity"].columns
    assert columns["u_m_s"][:2] == pytest.approx([0.1, 0.2], rel=1e-15)
    assert columns["v_m_s"][:2] == pytest.approx([0.0, -0.1], rel=1e-15)
    assert np.isnan(columns["w_m_s"][2])
    assert columns["quality"].tolist() == [1.0, 0.5, 0.0]


def test_the_barometer_in_the_water_agrees_with_the_depth_of_the_vehicle() -> None:
    depth = np.repeat(np.linspace(-1.0, -3.0, 20), 2)
    instance = np.tile([0, 1], 20)
    baro = message("BARO", 40, I=instance, Alt=np.where(instance == 1, depth, -77.0))
    stream = dataflash(log(baro, message("CTUN", 40, BAlt=depth)))["depth"]
    assert stream.source == "BARO[1]"
    assert stream.columns["depth_m"][[0, -1]].tolist() == [1.0, 3.0]
    # Without the vehicle's own depth the wider range of altitude decides.
    assert dataflash(log(baro))["depth"].source == "BARO[1]"
    assert dataflash(log(baro), depth="BARO[0]")["depth"].columns["depth_m"][0] == 77.0


def test_several_barometers_in_messages_of_their_own() -> None:
    deep = np.linspace(-1.0, -3.0, 20)
    assert (
        dataflash(log(message("BARO", Alt=-77.0), message("BAR2", Alt=deep)))["depth"].source
        == "BAR2"
    )


def test_filter_velocity_without_a_sensor_is_refused() -> None:
    xkf1 = message(
        "XKF1", C=0, VN=1.0, VE=0.0, VD=0.0, Roll=0.0, Pitch=0.0, Yaw=90.0, PN=0.0, PE=0.0, PD=0.0
    )
    streams = dataflash(log(xkf1))
    assert "velocity" not in streams
    assert "position" not in streams
    forced = dataflash(log(xkf1), velocity="XKF1")["velocity"]
    assert any("although" in note for note in forced.notes)
    aided = dataflash(log(xkf1, counts={"XKFD": 5}))["velocity"]
    # North at 1 m/s and heading east: the water comes from the left, the body moves to
    # its left.
    assert [aided.columns[f"{axis}_m_s"][0] for axis in "uvw"] == pytest.approx(
        [0.0, -1.0, 0.0], abs=1e-15
    )
    assert any("not a velocity sensor" in note for note in aided.notes)


def test_records_from_before_there_were_instances_are_those_of_the_first() -> None:
    """Two logs in one file: the layout of the first had no instance, which leaves NaN
    in the joined column.
    """
    instance = np.where(np.arange(20) < 10, np.nan, np.arange(20) % 2)
    streams = dataflash(log(message("BARO", Alt=-0.1 * np.arange(20), I=instance)))
    assert {label for label in statuses(streams["depth"]) if label.startswith("BARO")} == {
        "BARO[0]",
        "BARO[1]",
    }


def test_utc_from_the_fix_of_new_and_of_old_firmware() -> None:
    """Week 1815, 8363.0 s: Sunday 19 October 2014, 02:19:07 UTC, while GPS was 16 s
    ahead.
    """
    unix_us = 1_413_685_147_000_000
    old = message(
        "GPS",
        Status=3.0,
        TimeMS=8_363_000.0 + 50.0 * np.arange(20),
        Week=1815.0,
        T=32_461.0 + 50.0 * np.arange(20),
    )
    del old.columns["TimeUS"]  # type: ignore[attr-defined]
    assert streams_dataflash.utc_offset_us(log(old)) == unix_us - 32_461_000
    stamps = streams_dataflash.clock(old, log(old))
    assert stamps is not None
    assert stamps[0] == 32_461_000, "TimeMS of such records is the time of the week"
    new = message("GPS", Status=3.0, GMS=8_363_000.0 + 100.0 * np.arange(20), GWk=1815.0)
    assert streams_dataflash.utc_offset_us(log(new)) == unix_us - 7_000_000
    assert (
        streams_dataflash.utc_offset_us(log(message("GPS", Status=1.0, GMS=0.0, GWk=0.0))) is None
    )


def test_a_clock_that_counts_from_1970_needs_no_fix() -> None:
    wrong = message(
        "GPS",
        Status=6.0,
        GMS=536_629_400.0,
        GWk=5377.0,
        TimeUS=1_784_255_537_479_288 + np.arange(20) * 200_000,
    )
    assert streams_dataflash.utc_offset_us(log(wrong)) == 0


def test_fallback_attitude_says_so() -> None:
    stream = dataflash(log(message("AHR2", Roll=0.0, Pitch=0.0, Yaw=10.0)))["attitude"]
    assert stream.source == "AHR2"
    assert statuses(stream)["ATT"] == "not logged"
    assert "tens of degrees" in stream.notes[0]


def test_unhealthy_inertial_unit_comes_last() -> None:
    instance = np.tile([0, 1], 10)
    columns: dict[str, Any] = {f"{kind}{axis}": 0.0 for kind in ("Gyr", "Acc") for axis in "XYZ"}
    stream = dataflash(log(message("IMU", I=instance, GH=instance, AH=1, **columns)))["imu"]
    assert stream.source == "IMU[1]"
    assert statuses(stream) == {
        "IMU[1]": "used",
        "IMU[0]": "available",
        "IMU2": "not logged",
        "IMU3": "not logged",
    }


def test_outputs_without_a_pulse_are_left_out_and_rco2_is_paired() -> None:
    first = message("RCOU", C1=1500, C2=0, C14=1100)
    second = message("RCO2", 10, C15=0, C16=1900)
    columns = dataflash(log(first, second))["actuators"].columns
    assert sorted(columns) == ["pwm_14_us", "pwm_16_us", "pwm_1_us", "time_us"]
    assert (
        np.isnan(columns["pwm_16_us"]).sum() == 10
    )  # no RCO2 record within 20 ms of the later half


def test_outputs_that_never_have_a_pulse_are_no_stream() -> None:
    """A safety switch that stays off writes zeros; telemetry may have the other port only."""
    still = log(message("RCOU", C1=0, C2=0))
    assert "actuators" not in dataflash(still)
    unix_us = np.arange(20) * STEP_US
    names = {"time_unix_us": unix_us, "time_usec": unix_us, "port": 1, "servo1_raw": 1600}
    second = message("SERVO_OUTPUT_RAW", **names)
    assert "actuators" not in map_streams(log(second), streams_tlog.RULES, {})
    fins = dict.fromkeys(("FinS", "FinP", "FinB", "FinT"), 0.1)
    both = log(message("RCOU", C1=0, C2=0), message("ACTU", RevS=12.0, **fins))
    assert "propeller_rev_s" in dataflash(both)["actuators"].columns


def test_early_battery_records_are_whole_hundredths() -> None:
    """Firmware before 2015 wrote CURR as integers: 1612 is 16.12 V."""
    hundredths = message("CURR", Volt=np.full(20, 1612, np.int16), Curr=np.full(20, -250, np.int16))
    early = dataflash(log(hundredths))["battery"].columns
    later = dataflash(log(message("CURR", Volt=16.12, Curr=-2.5)))["battery"].columns
    for name, value in (("voltage_v", 16.12), ("current_a", -2.5)):
        assert early[name] == pytest.approx(np.full(20, value), rel=1e-12)
        assert later[name] == pytest.approx(np.full(20, value), rel=1e-12)


def test_modes_and_arming_are_merged() -> None:
    mode = message("MODE", 2, ModeNum=[19, 2], Mode=[19, 2])
    arm = replace(
        message("ARM", 1, ArmState=[1]),
        columns={"TimeUS": np.array([7_050_000]), "ArmState": np.array([1])},
    )
    columns = dataflash(log(mode, arm))["mode"].columns
    assert columns["time_us"].tolist() == [7_000_000, 7_050_000, 7_100_000]
    assert columns["mode"].tolist() == ["MANUAL", "MANUAL", "ALT_HOLD"]
    assert columns["armed"].tolist() == [False, True, True]


def test_to_body_is_the_transpose_of_the_rotation_of_the_dynamics() -> None:
    from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned

    rng = np.random.default_rng(1)
    angles, vector = rng.uniform(-1.5, 1.5, (3, 6)), rng.normal(size=(3, 6))
    expected = np.einsum("nji,jn->in", rotation_body_to_ned(angles.T), vector)
    turned = np.stack(list(common.to_body(vector, *angles).values()))
    assert turned == pytest.approx(expected, abs=1e-14)


def test_quaternions_become_euler_angles() -> None:
    from scipy.spatial.transform import Rotation

    angles = np.random.default_rng(2).uniform([-3, -1.5, -3], [3, 1.5, 3], (50, 3))
    q = Rotation.from_euler("ZYX", angles[:, ::-1]).as_quat()[:, [3, 0, 1, 2]]
    columns = common.euler_angles(q.T)
    assert np.stack(list(columns.values()), axis=1) == pytest.approx(angles, abs=1e-12)


UNIX = 1_700_000_000_000_000


def telemetry(name: str, arrival_us: Any, compid: int = 1, **columns: Any) -> Messages:
    arrival = np.asarray(arrival_us, np.int64)
    values: dict[str, Any] = {
        "time_unix_us": arrival,
        "compid": np.full(arrival.size, compid, np.uint8),
    }
    return Messages(
        name,
        values | {key: np.asarray(value) for key, value in columns.items()},
        np.arange(arrival.size) * 30,
    )


def flight(duration_s: int = 600, drift: float = 40e-6) -> tuple[DecodedLog, np.ndarray[Any, Any]]:
    """Attitude at 10 Hz; the recorder's clock runs `drift` faster, every frame is 5 ms
    late and some are 300 ms late.
    """
    boot = np.arange(0, duration_s * 1_000_000, 100_000, dtype=np.int64) + 30_000_000
    late = 5000 + 300_000 * (np.random.default_rng(3).random(boot.size) < 0.1)
    arrival = UNIX + np.rint(boot * (1 + drift)).astype(np.int64) + late.astype(np.int64)
    zero = np.zeros(boot.size)
    attitude = telemetry(
        "ATTITUDE",
        arrival,
        time_boot_ms=(boot // 1000).astype(np.uint32),
        roll=zero,
        pitch=zero,
        yaw=zero,
    )
    beats = telemetry(
        "HEARTBEAT",
        arrival[::10],
        custom_mode=np.zeros(boot.size // 10),
        base_mode=np.zeros(boot.size // 10, int),
    )
    return log(attitude, beats), arrival


def test_recorder_time_is_set_on_the_boot_clock_of_the_vehicle() -> None:
    decoded, _ = flight()
    boot = np.array([40_000_000, 600_000_000])
    unstamped = telemetry("SYS_STATUS", UNIX + np.rint(boot * (1 + 40e-6)).astype(np.int64) + 5000)
    # 2 ms: the tenth of late frames moves the medians of the blocks by little; an
    # uncorrected drift would be 24 ms.
    assert streams_tlog.clock(unstamped, decoded) == pytest.approx(boot, abs=2000)


def test_another_component_has_a_clock_of_its_own() -> None:
    decoded, arrival = flight()
    other = telemetry(
        "DISTANCE_SENSOR",
        arrival,
        compid=194,
        time_boot_ms=np.arange(arrival.size, dtype=np.uint32) * 100 + 999_000,
    )
    own = telemetry(
        "ATTITUDE", arrival, time_boot_ms=decoded.messages["ATTITUDE"].columns["time_boot_ms"]
    )
    assert streams_tlog.clock(other, decoded) == pytest.approx(
        streams_tlog.clock(own, decoded), abs=30_000
    )


def test_servo_time_stamps_of_32_bits_start_again() -> None:
    decoded, _ = flight(duration_s=5000, drift=0.0)
    boot = np.array([4_294_000_000, 4_296_000_000, 4_300_000_000])
    servo = telemetry(
        "SERVO_OUTPUT_RAW", UNIX + boot, time_usec=(boot % (1 << 32)).astype(np.uint32)
    )
    got = streams_tlog.clock(servo, decoded)
    assert got is not None
    assert got.tolist() == boot.tolist()


def test_slow_inertial_messages_give_way_to_the_rates_of_attitude() -> None:
    decoded, arrival = flight(20)
    scaled: dict[str, Any] = {
        f"{kind}{suffix}": np.zeros(40) for kind in "xyz" for suffix in ("acc", "gyro")
    }
    slow = telemetry(
        "RAW_IMU",
        arrival[::5],
        time_usec=np.arange(40, dtype=np.uint64) * 500_000 + 30_000_000,
        **scaled,
    )
    attitude = decoded.messages["ATTITUDE"]
    rates = {name: np.full(len(attitude), 0.2) for name in ("rollspeed", "pitchspeed", "yawspeed")}
    both = replace(
        decoded,
        messages={
            **decoded.messages,
            "RAW_IMU": slow,
            "ATTITUDE": replace(attitude, columns={**attitude.columns, **rates}),
        },
    )
    stream = map_streams(both, streams_tlog.RULES, {})["imu"]
    assert stream.source == "ATTITUDE"
    assert statuses(stream)["RAW_IMU"] == "sent at 2.0 Hz only"


def test_an_altitude_that_stands_still_is_refused() -> None:
    decoded, arrival = flight(20)
    still = telemetry(
        "VFR_HUD", arrival, alt=np.full(arrival.size, -0.1), groundspeed=np.zeros(arrival.size)
    )
    pressure = telemetry(
        "SCALED_PRESSURE2", arrival, press_abs=np.linspace(1013.25, 1111.3165, arrival.size)
    )
    both = replace(
        decoded, messages={**decoded.messages, "VFR_HUD": still, "SCALED_PRESSURE2": pressure}
    )
    depth = map_streams(both, streams_tlog.RULES, {})["depth"]
    assert depth.source == "SCALED_PRESSURE2"
    assert depth.columns["depth_m"][[0, -1]] == pytest.approx([0.0, 1.0], abs=1e-5)
    assert "depth" not in map_streams(
        replace(both, messages={**decoded.messages, "VFR_HUD": still}),
        streams_tlog.RULES,
        {},
    )
    calibrated = replace(both, parameters={"BARO2_GND_PRESS": 100_000.0, "BARO_SPEC_GRAV": 1.024})
    first = map_streams(calibrated, streams_tlog.RULES, {})["depth"].columns["depth_m"][0]
    assert first == pytest.approx(1325.0 / (1024.0 * 9.80665), rel=1e-12)


def test_px4_odometry_in_the_frame_that_it_names() -> None:
    stamps = np.arange(1, 6, dtype=np.uint64) * 100_000
    half = np.sqrt(0.5)
    attitude = Messages(
        "vehicle_attitude",
        {
            "timestamp": stamps,
            **{f"q[{i}]": np.full(5, q) for i, q in enumerate((half, 0, 0, half))},
        },
        np.arange(5),
    )
    columns = {
        "timestamp": stamps,
        "velocity_frame": np.array([1, 3, 2, 3, 1]),
        **{f"velocity[{i}]": np.full(5, v) for i, v in enumerate((1.0, 2.0, 3.0))},
    }
    odometry = Messages("vehicle_visual_odometry", columns, np.arange(5))
    # A velocity log leaves the pose empty; that is no pose of which nothing can be used.
    columns |= {f"{name}[{i}]": np.full(5, np.nan) for name in ("position", "q") for i in range(4)}
    streams = map_streams(log(attitude, odometry), streams_ulog.RULES, {})
    assert "pose" not in streams
    columns |= {f"position[{i}]": np.full(5, 1.0) for i in range(3)}
    assert "pose" in map_streams(log(attitude, odometry), streams_ulog.RULES, {})
    got = streams["velocity"].columns
    body = np.stack([got[name] for name in ("u_m_s", "v_m_s", "w_m_s")])
    assert body[:, 0] == pytest.approx([2.0, -1.0, 3.0], abs=1e-12)  # north-east-down, heading east
    assert body[:, 1].tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(body[:, 2]).all()


def test_px4_barometer_of_another_instance() -> None:
    stamps = np.arange(1, 21, dtype=np.uint64) * 100_000
    housing = Messages(
        "sensor_baro", {"timestamp": stamps, "pressure": np.full(20, 1010.0)}, np.arange(20)
    )
    water = Messages(
        "sensor_baro.1",
        {"timestamp": stamps, "pressure": np.linspace(1013.25, 1994.0, 20)},
        np.arange(20),
    )
    stream = map_streams(log(housing, water), streams_ulog.RULES, {})["depth"]
    assert stream.source == "sensor_baro[1]"
    assert stream.columns["depth_m"][-1] == pytest.approx(10.0, abs=0.01)


@pytest.mark.parametrize("name", format_names())
def test_the_page_shows_the_mapping_as_it_is(name: str) -> None:
    page = (Path(__file__).parents[5] / "docs/streams.md").read_text(encoding="utf-8")
    table = mapping_table(name)
    assert table in page, f"docs/streams.md needs this table under the format {name}:\n{table}"
