"""The resample stage: one leg on a uniform clock; lags, gaps, segments, derivatives,
and what it refuses.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.tables import column, make_table, matrix
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages import resample
from auvid.stages.columns import ACCELERATION, ACCELEROMETER, GYRO, VELOCITY, Rows
from auvid.stages.resample.segments import Signal, gap_list
from tests.support.motions import log_document, shipped_vehicle, vehicle_document

DOCUMENT, VEHICLE = vehicle_document("bluerov2_heavy"), shipped_vehicle("bluerov2_heavy")
DVL_LAG_S = 0.15
START_US = 50_000_000
OMEGA = 2.0 * np.pi * 0.1
"""A slow sine: far below the sample rates, so that splines follow it to their own
accuracy.
"""
STREAM_VELOCITY = ("time_us", *VELOCITY[:3])
Array = np.ndarray[Any, Any]


def times(rate_hz: float, end_s: float = 60.0, start_s: float = 0.0) -> Array:
    return START_US + np.rint(
        np.arange(start_s * rate_hz, end_s * rate_hz) * (1e6 / rate_hz)
    ).astype(np.int64)


def seconds(time_us: Array) -> Array:
    return (time_us - START_US) / 1e6


def imu(time_us: Array) -> pa.Table:
    t = seconds(time_us)
    rates = {
        f"gyro_{axis}_rad_s": scale * np.sin(OMEGA * t)
        for axis, scale in zip("xyz", (0.1, 0.2, 0.3), strict=True)
    }
    return make_table(
        "imu",
        {
            "time_us": time_us,
            **rates,
            **{f"accel_{axis}_m_s2": np.full(t.size, -1.0) for axis in "xyz"},
        },
    )


def attitude(time_us: Array) -> pa.Table:
    """A steady turn to starboard at 0.5 rad/s that wraps several times, level
    otherwise.
    """
    t = seconds(time_us)
    angles = {
        "phi_rad": np.full(t.size, 0.02),
        "theta_rad": np.full(t.size, -0.03),
        "psi_rad": np.mod(0.5 * t + 3.0, 2.0 * np.pi),
    }
    return make_table("attitude", {"time_us": time_us, **angles})


def depth(time_us: Array, noise: float = 0.0) -> pa.Table:
    error = noise * np.random.default_rng(6).normal(size=time_us.size)
    return make_table(
        "depth", {"time_us": time_us, "depth_m": 5.0 + np.sin(OMEGA * seconds(time_us)) + error}
    )


def velocity(time_us: Array) -> pa.Table:
    """What the sensor reports at a time is the velocity of `DVL_LAG_S` before."""
    sine = np.sin(OMEGA * (seconds(time_us) - DVL_LAG_S))
    return make_table(
        "velocity", {"time_us": time_us, "u_m_s": sine, "v_m_s": 2.0 * sine, "w_m_s": 3.0 * sine}
    )


def actuators(time_us: Array) -> pa.Table:
    return make_table(
        "actuators", {"time_us": time_us, "pwm_1_us": 1500.0 + 10.0 * seconds(time_us)}
    )


def battery(time_us: Array) -> pa.Table:
    return make_table("battery", {"time_us": time_us, "voltage_v": 16.0 - 0.01 * seconds(time_us)})


def streams(**changes: pa.Table | Rows | None) -> dict[str, pa.Table | Rows | None]:
    tables = {
        "imu": imu(times(50)),
        "attitude": attitude(times(10)),
        "depth": depth(times(10)),
        "velocity": velocity(times(8)),
    }
    return {**tables, "actuators": actuators(times(10)), "battery": battery(times(1)), **changes}


def run(
    leg: dict[str, Any] | None = None,
    params: dict[str, Any] | None = None,
    vehicle: Vehicle = VEHICLE,
    **changes: pa.Table | Rows | None,
) -> resample.Outputs:
    info = log_document(start_us=START_US, end_us=START_US + 60_000_000)
    inputs = resample.Inputs(
        leg=LegEntry(**{"id": "leg", "log": "dive", "use": "training", **(leg or {})}),
        log_info=info,
        vehicle=vehicle,
        **streams(**changes),
    )
    return resample.run(inputs, resample.Params(**(params or {})))


def away_from_ends(table: pa.Table, margin_s: float = 2.0) -> Array:
    t = column(table, "t_s")
    return np.flatnonzero((t > margin_s) & (t < t[-1] - margin_s))


def without(time_us: Array, start_s: float, end_s: float) -> Array:
    t = seconds(time_us)
    return time_us[(t <= start_s) | (t >= end_s)]


def test_documents_and_clock() -> None:
    outputs = run({"start_s": 10, "end_s": 40})
    segment = outputs.segment["leg"]
    check_document(segment, "segment")
    table = outputs.resampled["leg"]
    t_s = column(table, "t_s")
    assert np.diff(t_s) == pytest.approx(0.02, abs=1e-12)
    assert np.abs(t_s).min() == 0.0
    # The leg starts where it is said to: all sensors go on before and after it.
    assert segment.leg_start_s == pytest.approx(10.0, abs=1e-9)
    assert segment.start_us == START_US + 10_000_000
    assert segment.duration_s == pytest.approx(30.0, abs=1e-9)
    assert segment.samples == np.count_nonzero((t_s > -1e-9) & (t_s < 30.0 + 1e-9)) == 1501
    assert segment.margins_s == pytest.approx([-t_s[0], t_s[-1] - 30.0], abs=1e-9)
    assert all(2.8 < margin <= 3.0 for margin in segment.margins_s)
    assert segment.lags_s["velocity"] == DVL_LAG_S


@pytest.mark.parametrize(("margin_s", "alike"), [(3.0, True), (0.0, False)])
def test_a_leg_inside_a_log_has_ends_as_good_as_its_middle(margin_s: float, alike: bool) -> None:
    params = {"smoothing": "cutoff", "cutoff_hz": 1.0, "margin_s": margin_s}
    complete, part = run({}, params), run({"start_s": 20, "end_s": 40}, params)
    shift = part.segment["leg"].leg_start_s - complete.segment["leg"].leg_start_s
    t_s = column(part.resampled["leg"], "t_s")
    inside = (t_s > -1e-9) & (t_s < 20.0 + 1e-9)
    worst = 0.0
    for name in ("z_dot_m_s", "u_dot_m_s2", "q_dot_rad_s2"):
        expected = np.interp(
            t_s[inside] + shift,
            column(complete.resampled["leg"], "t_s"),
            column(complete.resampled["leg"], name),
        )
        difference = np.abs(column(part.resampled["leg"], name)[inside] - expected)
        worst = max(worst, float(difference.max() / np.abs(expected).max()))
    # Without a margin a natural spline has no curvature at its ends.
    assert (worst < 1e-3) == alike


def test_signals_and_derivatives_are_those_that_were_sampled() -> None:
    outputs = run()
    table, segment = outputs.resampled["leg"], outputs.segment["leg"]
    rows = away_from_ends(table)
    t = column(table, "t_s") + segment.leg_start_s
    # 1e-4 of the amplitude: interpolation error of cubic splines at ten and more
    # samples per radian.
    assert column(table, "z_m")[rows] == pytest.approx((5.0 + np.sin(OMEGA * t))[rows], abs=1e-4)
    assert column(table, "z_dot_m_s")[rows] == pytest.approx(
        (OMEGA * np.cos(OMEGA * t))[rows], abs=1e-3
    )
    assert column(table, "r_dot_rad_s2")[rows] == pytest.approx(
        (0.3 * OMEGA * np.cos(OMEGA * t))[rows], abs=1e-4
    )
    assert column(table, "w_dot_m_s2")[rows] == pytest.approx(
        (3.0 * OMEGA * np.cos(OMEGA * t))[rows], abs=3e-3
    )
    assert column(table, "pwm_1_us") == pytest.approx(1500.0 + 10.0 * t, abs=1e-9)
    # The battery is sampled at 1 Hz: its last sample ends the segment.
    assert t[-1] == pytest.approx(59.0, abs=0.02)
    assert column(table, "voltage_v") == pytest.approx(16.0 - 0.01 * t, abs=1e-9)


def test_the_lag_of_the_velocity_sensor_is_taken_off() -> None:
    outputs = run()
    table = outputs.resampled["leg"]
    rows, t = away_from_ends(table), column(table, "t_s") + outputs.segment["leg"].leg_start_s
    assert column(table, "u_m_s")[rows] == pytest.approx(np.sin(OMEGA * t)[rows], abs=1e-4)
    samples = outputs.samples_velocity
    assert samples is not None
    sampled = column(samples["leg"], "t_s") + outputs.segment["leg"].leg_start_s
    assert column(samples["leg"], "u_m_s") == pytest.approx(np.sin(OMEGA * sampled), abs=1e-12)


def test_a_lag_of_the_campaign_replaces_that_of_the_vehicle() -> None:
    assert run(params={"lag_s": {"velocity": 0.3}}).segment["leg"].lags_s["velocity"] == 0.3
    with pytest.raises(CampaignError, match=r"unknown sensor.*Did you mean 'velocity'"):
        run(params={"lag_s": {"velocty": 0.3}})


def test_yaw_goes_on_through_its_wraps() -> None:
    table = run().resampled["leg"]
    psi = column(table, "psi_rad")
    assert np.diff(psi) == pytest.approx(0.01, abs=2e-6)
    assert psi[-1] - psi[0] > 4.0 * np.pi
    assert column(table, "psi_dot_rad_s") == pytest.approx(0.5, abs=1e-4)
    samples = column(run().samples_attitude["leg"], "psi_rad")
    assert np.diff(samples) == pytest.approx(0.05, abs=1e-9)


def test_noise_is_found_and_taken_off() -> None:
    noise = 0.01
    outputs = run(depth=depth(times(10), noise))
    table, segment = outputs.resampled["leg"], outputs.segment["leg"]
    rows, t = away_from_ends(table), column(table, "t_s") + segment.leg_start_s
    error = column(table, "z_m")[rows] - (5.0 + np.sin(OMEGA * t))[rows]
    assert segment.smoothing["z_m"].noise_sd == pytest.approx(
        noise, rel=0.2
    )  # 600 samples: 3 % standard error
    assert np.sqrt(np.mean(error**2)) < 0.5 * noise


@pytest.mark.parametrize(("smoothing", "cutoff"), [("none", None), ("cutoff", 0.8)])
def test_smoothing_can_be_fixed(smoothing: str, cutoff: float | None) -> None:
    outputs = run(params={"smoothing": smoothing, "cutoff_hz": 0.8}, depth=depth(times(10), 0.01))
    smoothing_z = outputs.segment["leg"].smoothing["z_m"]
    assert smoothing_z.cutoff_hz == (None if cutoff is None else pytest.approx(cutoff, rel=1e-9))
    samples = outputs.samples_depth
    assert samples is not None
    if cutoff is None:
        at = column(outputs.resampled["leg"], "z_m")[
            np.rint(column(samples["leg"], "t_s") * 50).astype(int)
        ]
        assert at == pytest.approx(column(samples["leg"], "z_m"), abs=1e-9)


def test_commands_are_held_if_wished() -> None:
    table = run(params={"actuator_interpolation": "hold"}).resampled["leg"]
    assert len(np.unique(column(table, "pwm_1_us"))) == pytest.approx(table.num_rows / 5, rel=0.02)


def test_a_gap_splits_the_leg() -> None:
    """DVL_DROPOUT: 6 s without velocity give two segments, and no sample in the gap."""
    outputs = run(velocity=velocity(without(times(8), 20.0, 26.0)))
    assert list(outputs.resampled) == ["leg.1", "leg.2"]
    first, second = outputs.segment["leg.1"], outputs.segment["leg.2"]
    assert first.leg_start_s + first.duration_s <= 20.0
    assert second.leg_start_s >= 26.0 - DVL_LAG_S - 1e-9
    assert [(gap.stream, gap.duration_s) for gap in first.gaps] == [("velocity", 6.0)]
    assert list(
        run(params={"max_gap_s": 7.0}, velocity=velocity(without(times(8), 20.0, 26.0))).resampled
    ) == ["leg"]


def test_gaps_are_listed_by_time() -> None:
    """Seconds of other lengths too: 9.5 s is before 10.5 s."""
    t_s = np.array([0.0, 9.5, 10.5, 20.0, 100.0, 101.0])
    signal = Signal("depth", t_s, ("depth_m",), np.zeros((6, 1)), ())
    starts = [gap.start_s for gap in gap_list([signal], 2.0, (0.0, 200.0))]
    assert starts == [0.0, 10.5, 20.0]
    late = Signal("velocity", np.array([9.0, 19.0]), ("u_m_s",), np.zeros((2, 1)), ())
    assert [gap.start_s for gap in gap_list([signal, late], 2.0, (0.0, 200.0))] == [
        0.0,
        9.0,
        10.5,
        20.0,
    ]


def test_a_part_that_is_too_short_is_left_out_and_named() -> None:
    outputs = run(depth=depth(without(times(10), 3.0, 8.0)))
    assert list(outputs.resampled) == ["leg"]
    assert outputs.segment["leg"].leg_start_s == 8.0
    assert any("shorter than 5 s" in note for note in outputs.segment["leg"].notes)


def test_a_leg_shorter_than_the_least_part_is_called_short() -> None:
    """Its sensors run throughout: no gap and no other source is to blame."""
    with pytest.raises(DataError, match=r"'leg' is too short; found '?10 to 14 s.*Move start_s"):
        run({"start_s": 10.0, "end_s": 14.0})


def test_a_log_that_ends_before_its_leg_is_called_short() -> None:
    """No pause and no other source is to blame."""
    with pytest.raises(DataError, match=r"ends too early; found '?after 60.0 s.*cut off"):
        run({"start_s": 57.0, "end_s": 90.0})


def test_nothing_is_extrapolated() -> None:
    outputs = run(
        depth=depth(times(10, start_s=5.0, end_s=50.0)), battery=battery(times(1, start_s=20.0))
    )
    table, segment = outputs.resampled["leg"], outputs.segment["leg"]
    assert segment.leg_start_s == 5.0
    assert segment.leg_start_s + segment.duration_s <= 49.9 + 1e-9
    t = column(table, "t_s") + 5.0
    assert (np.isnan(column(table, "voltage_v")) == (t < 20.0)).all()
    assert any("battery was not measured" in note for note in segment.notes)
    names = [name for name in table.column_names if name != "voltage_v"]
    assert np.isfinite(matrix(table, names)).all()


def test_without_a_gyro_the_attitude_gives_the_rates() -> None:
    outputs = run(imu=None)
    table = outputs.resampled["leg"]
    # Level to within 0.03 rad, turning at 0.5 rad/s: r = psi_dot cos(theta) cos(phi).
    assert column(table, "r_rad_s") == pytest.approx(0.5 * np.cos(0.03) * np.cos(0.02), abs=1e-4)
    assert "accel_x_m_s2" not in table.column_names
    assert outputs.samples_imu == {}
    assert any("no gyro" in note for note in outputs.segment["leg"].notes)


MOUNTINGS = {"imu": [0.0, 0.0, 1.0], "dvl": [np.pi, 0.0, 0.5]}
MOUNTED = vehicle_from_document(
    {
        **DOCUMENT,
        "sensors": DOCUMENT["sensors"]
        | {
            key: DOCUMENT["sensors"].get(key, {})
            | {"mounting": {"value": angles, "unit": "rad", "source": "test"}}
            for key, angles in MOUNTINGS.items()
        },
    }
)


def test_vectors_are_turned_from_sensor_to_body_axes() -> None:
    """Gyro and accelerometer by the mounting of the IMU, velocities by that of the DVL;
    the table, the samples and the derivatives alike.
    """
    water = make_table("water_velocity", {n: velocity(times(4))[n] for n in STREAM_VELOCITY})
    plain, turned = (
        run({}, {"smoothing": "none"}, vehicle=vehicle, water_velocity=water)
        for vehicle in (VEHICLE, MOUNTED)
    )
    rotations = {key: rotation_body_to_ned(np.array(angles)) for key, angles in MOUNTINGS.items()}
    for table, key, names in (
        ("resampled", "imu", VELOCITY[3:]),
        ("resampled", "imu", ACCELERATION[3:]),
        ("resampled", "imu", ACCELEROMETER),
        ("resampled", "dvl", VELOCITY[:3]),
        ("resampled", "dvl", ACCELERATION[:3]),
        ("samples_imu", "imu", GYRO),
        ("samples_imu", "imu", ACCELEROMETER),
        ("samples_velocity", "dvl", VELOCITY[:3]),
        ("samples_water", "dvl", VELOCITY[:3]),
    ):
        sensor, body = (
            matrix(getattr(outputs, table)["leg"], names) for outputs in (plain, turned)
        )
        assert np.abs(body - sensor).max() > 0.01
        np.testing.assert_allclose(body, sensor @ rotations[key].T, rtol=0.0, atol=1e-12)


def test_mounting_of_the_gyro_does_not_turn_rates_from_the_attitude() -> None:
    plain, turned = (
        run(imu=None, vehicle=vehicle).resampled["leg"] for vehicle in (VEHICLE, MOUNTED)
    )
    assert matrix(turned, VELOCITY[3:]).tolist() == matrix(plain, VELOCITY[3:]).tolist()


def test_without_an_accelerometer_its_columns_are_absent() -> None:
    gyro = {
        name: values
        for name, values in imu(times(50)).to_pydict().items()
        if not name.startswith("accel")
    }
    bare = make_table(
        "imu",
        {**gyro, **{f"accel_{axis}_m_s2": np.full(len(gyro["time_us"]), np.nan) for axis in "xyz"}},
    )
    outputs = run(imu=bare)
    assert "accel_x_m_s2" not in outputs.resampled["leg"].column_names
    assert "r_rad_s" in outputs.resampled["leg"].column_names


@pytest.mark.parametrize(
    ("leg", "words"),
    [
        (
            {"start_s": 100.0},
            "lies outside log 'dive'; found 'from 100 s on'; allowed: 0 to 60.000 s",
        ),
        ({"start_s": 70.0, "end_s": 80.0}, "field 'start_s'"),
    ],
)
def test_a_leg_outside_its_log(leg: dict[str, Any], words: str) -> None:
    with pytest.raises(DataError) as caught:
        run(leg)
    assert words in str(caught.value)


def test_a_leg_that_ends_after_its_log_says_so() -> None:
    notes = run({"start_s": 10.0, "end_s": 90.0}).segment["leg"].notes
    assert notes == ["the leg asks for data up to 90 s, the log ends at 60.000 s"]


class OnDisk:
    """A table whose rows are loaded; `loaded` counts them."""

    def __init__(self, table: pa.Table) -> None:
        self.table, self.loaded = table, 0

    def between(self, start_us: float, end_us: float) -> pa.Table:
        time_us = column(self.table, "time_us")
        part = self.table.filter(pa.array((time_us >= start_us) & (time_us <= end_us)))
        self.loaded += part.num_rows
        return part


def test_a_leg_is_the_same_of_the_rows_around_it_alone() -> None:
    leg, late = {"start_s": 20.0, "end_s": 31.0}, {"lag_s": {"depth": 2.5}}
    tables = {name: table for name, table in streams().items() if table is not None}
    stored = {name: OnDisk(table) for name, table in tables.items()}
    full, part = run(leg, late), run(leg, late, **stored)
    assert part.resampled["leg"].equals(full.resampled["leg"])
    assert part.segment == full.segment
    for name, rows in stored.items():
        assert rows.loaded < 0.4 * tables[name].num_rows, name


def test_a_missing_stream_says_what_could_supply_it() -> None:
    with pytest.raises(
        DataError,
        match=(
            r"needs stream 'attitude', and log 'dive' has none.*DataFlash: ATT \(Roll, Pitch, Yaw\)"
        ),
    ):
        run(attitude=None)
    with pytest.raises(
        DataError,
        match=(
            r"needs stream 'depth', .* fewer than five samples.*"
            r"depth begins at 0\.\d s of the log and ends at 1\d\.\d s"
        ),
    ):
        run({"start_s": 30.0}, depth=OnDisk(depth(times(10, end_s=20.0))))
    with pytest.raises(DataError, match=r"attitude begins at 40\.\d s.*Choose start_s and end_s"):
        run({"end_s": 30.0}, attitude=attitude(times(20, start_s=40.0)))


def test_no_part_is_covered_long_enough() -> None:
    with pytest.raises(
        DataError,
        match=r"no part of leg 'leg' is covered .*velocity 0.1 to 19.7 s.*"
        r"all run together from 18\.\d to 19\.7 s at most.*max_gap_s",
    ):
        run(velocity=velocity(times(8, end_s=20.0)), depth=depth(times(10, start_s=18.0)))


def test_inputs_are_not_written_to() -> None:
    tables = streams()
    before = {name: table.to_pydict() for name, table in tables.items() if table is not None}
    run()
    assert {
        name: table.to_pydict() for name, table in tables.items() if table is not None
    } == before


def test_velocity_through_the_water_keeps_its_samples_and_splits_nothing() -> None:
    """Water track with a pause of 20 s: lag taken off as for the velocity sensor, one
    segment, no samples made up in the pause.
    """
    stamps = times(4)
    kept = stamps[(seconds(stamps) < 20.0) | (seconds(stamps) > 40.0)]
    table = velocity(kept)
    water = make_table(
        "water_velocity", {name: table[name] for name in ("time_us", "u_m_s", "v_m_s", "w_m_s")}
    )
    outputs = run(water_velocity=water)
    assert list(outputs.segment) == ["leg"]
    assert outputs.samples_water is not None
    t = column(outputs.samples_water["leg"], "t_s")
    at = t + float(outputs.segment["leg"].leg_start_s)
    assert not ((at > 20.0) & (at < 40.0 - DVL_LAG_S)).any()
    np.testing.assert_allclose(
        column(outputs.samples_water["leg"], "v_m_s"), 2.0 * np.sin(OMEGA * at), rtol=0.0, atol=1e-9
    )


def test_a_leg_is_split_where_the_attitude_jumps_without_the_gyro() -> None:
    """An attitude that is set anew turns no vehicle: no segment spans the jump, and the
    note says when and how far.
    """
    time_us = times(10)
    unsplit = attitude(time_us)
    roll = np.where(seconds(time_us) > 30.05, np.radians(60.0), 0.02)
    outputs = run(
        attitude=unsplit.set_column(
            unsplit.column_names.index("phi_rad"), "phi_rad", pa.array(roll)
        )
    )
    assert list(outputs.segment) == ["leg.1", "leg.2"]
    first, second = outputs.segment.values()
    assert first.leg_start_s + first.duration_s == pytest.approx(30.0, abs=0.03)
    assert second.leg_start_s == pytest.approx(30.1, abs=1e-6)
    for segment in outputs.segment.values():
        check_document(segment, "segment")
        assert segment.notes == [
            "the attitude jumps by 59 degrees at 30.00 s without the gyro; the leg is split there"
        ]
    for table in outputs.resampled.values():
        assert np.abs(column(table, "phi_dot_rad_s")).max() < 0.01


def test_many_jumps_are_counted() -> None:
    time_us = times(10)
    unsplit = attitude(time_us)
    heading = column(unsplit, "psi_rad") + np.floor(seconds(time_us) / 6.0)
    outputs = run(
        attitude=unsplit.set_column(
            unsplit.column_names.index("psi_rad"), "psi_rad", pa.array(np.mod(heading, 2 * np.pi))
        )
    )
    assert len(outputs.segment) == 10
    assert (
        outputs.segment["leg.1"].notes[-1] == "the attitude jumps 4 times more, each splits the leg"
    )


def test_between_no_pulse_and_a_neutral_one_there_is_no_full_reverse() -> None:
    """Outputs that are disarmed (0 us) for 5 s: pulses of 100 to 1400 us are full reverse."""
    at = times(10)
    armed = np.where((seconds(at) > 20.0) & (seconds(at) < 25.0), 0.0, 1500.0)
    table = make_table("actuators", {"time_us": at, "pwm_1_us": armed})
    outputs = run(actuators=table)
    assert np.all(column(outputs.resampled["leg"], "pwm_1_us") == 1500.0)
