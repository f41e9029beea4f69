"""The stage fuse: known truth from ideal sensors, what the thesis's procedure does
wrong, filters, edges, and what is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.tables import column, make_table, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.stages import fuse, resample
from auvid.stages.columns import ACCELERATION, ACCELEROMETER, GYRO, POSE, VELOCITY
from auvid.stages.fuse import methods
from tests.support.motions import (
    IDEAL,
    ODD,
    RATE_HZ,
    UNSMOOTHED,
    Motion,
    Sensors,
    log_document,
    mounted_vehicle,
    resampled_table,
    rich_motion,
    segment_document,
)

SAMPLES = {"imu": 100.0, "attitude": 50.0, "depth": 10.0, "velocity": 5.0}


@pytest.fixture(scope="module")
def motion() -> Motion:
    return rich_motion(40.0, seed=4)


def inputs(table: pa.Table, sensors: Sensors, *, gyro: bool = True, **log: Any) -> fuse.Inputs:
    return fuse.Inputs(
        segment_document(gyro=gyro),
        table,
        mounted_vehicle(sensors),
        log_document(**log),
        imu_samples(table) if gyro else None,
    )


def imu_samples(table: pa.Table) -> pa.Table | None:
    """Samples of the gyro on the segment's own clock, where the table has rates."""
    if "p_rad_s" not in table.column_names:
        return None
    gyro = {name: column(table, source) for name, source in zip(GYRO, VELOCITY[3:], strict=True)}
    return make_table(
        "samples_imu",
        {
            "t_s": column(table, "t_s"),
            **gyro,
            **dict.fromkeys(ACCELEROMETER, np.full(table.num_rows, np.nan)),
        },
    )


def run(
    motion: Motion, sensors: Sensors = IDEAL, *, without: tuple[str, ...] = (), **params: Any
) -> fuse.Outputs:
    chosen = fuse.Params(**{"cutoff_hz": None, "edge_s": 0.0, **params})
    outputs = fuse.run(inputs(resampled_table(motion, sensors, without=without), sensors), chosen)
    check_document(outputs.fusion, "fusion")
    return outputs


def inner(values: Array, seconds: float = 1.0) -> Array:
    """Without the ends, where splines bend."""
    cut = int(seconds * RATE_HZ)
    return values[cut:-cut]


@pytest.mark.parametrize(
    "sensors", [IDEAL, ODD], ids=["at the origin", "arms, mountings and gyro bias"]
)
def test_kinematic_recovers_the_truth(motion: Motion, sensors: Sensors) -> None:
    outputs = run(motion, sensors)
    # the gyro bias is found from attitude at 50 Hz: integration by splines is good to
    # 1e-8 rad/s
    np.testing.assert_allclose(
        outputs.fusion.gyro_bias_rad_s, sensors.gyro_bias, rtol=0.0, atol=1e-7
    )
    np.testing.assert_allclose(
        matrix(outputs.fused, VELOCITY), motion.nu, rtol=0.0, atol=1e-7
    )  # m/s, rad/s
    np.testing.assert_allclose(
        matrix(outputs.fused, POSE[2:]), motion.eta[:, 2:], rtol=0.0, atol=1e-12
    )  # m, rad
    # spline derivative of waves up to 0.6 Hz at 50 Hz
    np.testing.assert_allclose(
        inner(matrix(outputs.fused, ACCELERATION)), inner(motion.nu_dot), rtol=0.0, atol=2e-5
    )
    assert outputs.fusion.accel_bias_m_s2 is None


def test_track_is_the_integral_of_the_velocity(motion: Motion) -> None:
    track = matrix(run(motion).fused, POSE[:2])
    np.testing.assert_allclose(
        track - track[0], motion.eta[:, :2] - motion.eta[0, :2], rtol=0.0, atol=1e-6
    )  # m over 60 m


def test_kinematic_with_lag_through_resample(motion: Motion) -> None:
    """Samples of each sensor at its own rate, the velocity 0.2 s late: resampling and
    fusing give the truth back.
    """
    lag, sensors = 0.2, ODD
    vehicle = mounted_vehicle(sensors, dvl_lag_s=lag)
    dense = resampled_table(motion, sensors, sensor_axes=True)
    streams = sampled(dense, lag)
    log = log_document(end_us=int(motion.t_s[-1] * 1e6), start_us=0)
    resample_inputs = resample.Inputs(
        LegEntry(id="one", log="log", use="training"), log, vehicle, **streams
    )
    cut = resample.run(resample_inputs, resample.Params(smoothing="none", rate_hz=RATE_HZ))
    assert cut.samples_imu is not None
    given_fuse = fuse.Inputs(
        cut.segment["one"], cut.resampled["one"], vehicle, log, cut.samples_imu["one"]
    )
    outputs = fuse.run(given_fuse, fuse.Params(cutoff_hz=None, edge_s=2.0))
    t_s = column(outputs.fused, "t_s") + float(cut.segment["one"].leg_start_s)
    truth = np.column_stack([np.interp(t_s, motion.t_s, motion.nu[:, index]) for index in range(6)])
    # 5 Hz samples of waves up to 0.6 Hz: the spline between them is good to a few mm/s;
    # an uncorrected lag costs 0.1 m/s
    assert np.abs(matrix(outputs.fused, VELOCITY) - truth).max() < 5e-3


def sampled(dense: pa.Table, lag_s: float, *, every: int | None = None) -> dict[str, pa.Table]:
    """Return raw streams at the sensors' own rates, or of every so many rows.

    `dense` in sensor axes; the velocity is stamped late by `lag_s`.
    """
    t = column(dense, "t_s")
    names = {
        "imu": (dict(zip(GYRO, VELOCITY[3:], strict=True)) | {n: n for n in ACCELEROMETER}),
        "attitude": {name: name for name in POSE[3:]},
        "depth": {"depth_m": "z_m"},
        "velocity": {name: name for name in VELOCITY[:3]},
    }
    streams = {}
    for stream, columns in names.items():
        rows = np.arange(0, t.size, every or max(int(RATE_HZ / SAMPLES[stream]), 1))
        time_us = np.round((t[rows] + (lag_s if stream == "velocity" else 0.0)) * 1e6).astype(
            np.int64
        )
        streams[stream] = make_table(
            stream,
            {
                "time_us": time_us,
                **{field: column(dense, name)[rows] for field, name in columns.items()},
            },
        )
    return streams


@pytest.mark.parametrize("convention", ["specific_force", "inertial", "derivative"])
def test_thesis_as_corrected_recovers_velocity_and_biases(motion: Motion, convention: str) -> None:
    sensors = replace(ODD, convention=convention)
    outputs = run(motion, sensors, method="thesis")
    assert outputs.fusion.accelerometer == convention
    np.testing.assert_allclose(
        outputs.fusion.accel_bias_m_s2, sensors.accel_bias, rtol=0.0, atol=1e-5
    )  # m/s^2
    np.testing.assert_allclose(
        matrix(outputs.fused, VELOCITY[:3]), motion.nu[:, :3], rtol=0.0, atol=1e-4
    )  # m/s, 40 s of integration
    np.testing.assert_allclose(
        inner(matrix(outputs.fused, ACCELERATION)), inner(motion.nu_dot), rtol=0.0, atol=1e-3
    )  # m/s^2, rad/s^2
    assert outputs.fusion.integrated_sway_rms_m_s < 1e-4
    assert outputs.fusion.warnings == []


def test_convention_comes_from_parameter_then_log_then_vehicle(motion: Motion) -> None:
    table, sensors = resampled_table(motion, ODD), replace(ODD, convention="inertial")
    params = fuse.Params(method="thesis", cutoff_hz=None)
    assert fuse.run(inputs(table, sensors), params).fusion.accelerometer == "inertial"
    stated = inputs(table, sensors, accelerometer="specific_force")
    assert fuse.run(stated, params).fusion.accelerometer == "specific_force"
    chosen = replace(params, accelerometer="derivative")
    assert fuse.run(stated, chosen).fusion.accelerometer == "derivative"


def test_as_published_leaves_the_transport_term_in(motion: Motion) -> None:
    """The accelerometer taken for v_dot: the error of the rate is omega x v up to the
    constant that the bias takes up, and it is told.
    """
    sensors = replace(IDEAL, convention="inertial")
    outputs = run(motion, sensors, method="thesis", as_published=True)
    error = matrix(outputs.fused, ACCELERATION[:3]) - motion.nu_dot[:, :3]
    transport = np.cross(motion.nu[:, 3:], motion.nu[:, :3])
    bias = np.array(outputs.fusion.accel_bias_m_s2)
    np.testing.assert_allclose(error, transport - bias, rtol=0.0, atol=1e-5)  # m/s^2
    assert np.sqrt(np.mean(error**2)) > 0.05
    assert outputs.fusion.integrated_sway_rms_m_s > methods.SWAY_WARNING_M_S
    assert "sway" in outputs.fusion.warnings[0]
    assert [block["level"] for block in outputs.section["blocks"] if block["kind"] == "remark"] == [
        "warning"
    ]


def test_as_published_is_right_for_what_the_thesis_takes_the_accelerometer_for(
    motion: Motion,
) -> None:
    """Negative control: with a rate of change of body velocity in the accelerometer's
    columns the printed procedure holds.
    """
    outputs = run(
        motion, replace(IDEAL, convention="derivative"), method="thesis", as_published=True
    )
    np.testing.assert_allclose(
        matrix(outputs.fused, VELOCITY[:3]), motion.nu[:, :3], rtol=0.0, atol=1e-4
    )  # m/s
    assert outputs.fusion.warnings == []


def test_as_published_belongs_to_the_thesis_method(motion: Motion) -> None:
    with pytest.raises(CampaignError, match=r"stages\.fuse\.as_published.*method thesis"):
        run(motion, as_published=True)


def test_the_depth_gives_the_vertical_velocity_of_method_thesis(motion: Motion) -> None:
    """A wrong heave of the velocity sensor is replaced by the rate of the depth
    (McCarter 2.77).
    """
    rate = np.zeros((motion.t_s.size, 3))
    to_ned_down = np.column_stack(
        [
            -np.sin(motion.eta[:, 4]),
            *(np.cos(motion.eta[:, 4]) * f(motion.eta[:, 3]) for f in (np.sin, np.cos)),
        ]
    )
    rate[:] = 0.2 * to_ned_down  # 0.2 m/s down, in body axes
    fixed = methods.with_depth_rate(
        motion.nu[:, :3] + rate,
        motion.eta[:, 3:],
        np.gradient(motion.eta[:, 2], motion.t_s, edge_order=2),
    )
    np.testing.assert_allclose(
        inner(fixed), inner(motion.nu[:, :3]), rtol=0.0, atol=1e-3
    )  # m/s; second-order differences at 50 Hz


def test_low_pass_has_no_phase_and_halves_the_amplitude_at_its_frequency() -> None:
    t = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
    zero, wave = np.zeros((t.size, 6)), 0.3 * np.sin(2.0 * np.pi * 1.0 * t)
    nu = zero.copy()
    nu[:, 0] = wave
    still = Motion(t, zero, nu, zero, np.full(t.size, 30.0), np.zeros((t.size, 4)))
    for cutoff, gain in ((1.0, 0.5), (4.0, 1.0)):
        fused = column(run(still, cutoff_hz=cutoff, edge_s=5.0).fused, "u_m_s")
        expected = gain * wave[250:-250]
        np.testing.assert_allclose(
            fused, expected, rtol=0.0, atol=2e-3 * 0.3
        )  # bilinear frequency at 50 Hz
        assert (
            abs(fused @ np.cos(2.0 * np.pi * t[250:-250])) / fused.size < 1e-6
        )  # m/s out of phase


def test_all_channels_pass_the_same_filter(motion: Motion) -> None:
    fused = run(motion, cutoff_hz=1.0, fit_gyro_bias=False).fused
    expected = zero_phase_lowpass(
        motion.t_s, np.hstack([motion.nu, motion.eta[:, 2:]]), cutoff_hz=1.0
    )
    np.testing.assert_allclose(
        matrix(fused, (*VELOCITY, *POSE[2:])), expected, rtol=0.0, atol=1e-12
    )


def test_edges_are_cut_on_both_sides(motion: Motion) -> None:
    t_s = column(run(motion, edge_s=0.5).fused, "t_s")
    assert (t_s[0], t_s[-1]) == pytest.approx((0.5, motion.t_s[-1] - 0.5))
    assert t_s.size == motion.t_s.size - 50


def test_a_margin_is_cut_off_in_place_of_the_edge(motion: Motion) -> None:
    """The leg lasts from 1 to 38 s of 40 s: 1 s before it is less than the edge, 2 s after
    it are more.
    """
    table = resampled_table(motion, IDEAL)
    shifted = table.set_column(0, "t_s", pa.array(column(table, "t_s") - 1.0))
    fuse_inputs = replace(
        inputs(shifted, IDEAL), segment=segment_document().model_copy(update={"duration_s": 37.0})
    )
    t_s = column(fuse.run(fuse_inputs, fuse.Params(cutoff_hz=None, edge_s=1.5)).fused, "t_s")
    assert (t_s[0], t_s[-1]) == pytest.approx((0.5, 37.0))


def test_a_segment_shorter_than_its_edges_is_refused(motion: Motion) -> None:
    with pytest.raises(DataError, match=r"too short for its edges.*edge_s") as caught:
        run(motion, edge_s=20.0)
    assert "'one'" in str(caught.value)


def test_a_cutoff_above_half_the_rate_names_its_key_and_what_to_do(motion: Motion) -> None:
    with pytest.raises(CampaignError, match=r"stages\.fuse\.cutoff_hz.*raise stages\.resample"):
        run(motion, cutoff_hz=0.5 * RATE_HZ)


@pytest.mark.parametrize(("cutoff", "edge"), [(None, 0.5), (10.0, 0.5), (1.0, 1.915)])
def test_edge_follows_the_low_pass(motion: Motion, cutoff: float | None, edge: float) -> None:
    """The zone in which the low-pass follows its continuation, ln(100) / (2 pi f sin(pi
    / 8)), and at least half a second.
    """
    outputs = run(motion, cutoff_hz=cutoff, edge_s=None)
    assert outputs.fusion.edge_s == pytest.approx(edge, abs=1e-3)
    t_s = column(outputs.fused, "t_s")
    assert t_s[0] == pytest.approx(edge, abs=1.0 / RATE_HZ)
    assert t_s[-1] == pytest.approx(motion.t_s[-1] - edge, abs=1.0 / RATE_HZ)


def test_channels_narrower_than_the_low_pass_are_named(motion: Motion) -> None:
    """A spline that cuts off at 0.8 Hz under a low-pass of 3 Hz: both figures in the
    section.
    """
    fuse_inputs = inputs(resampled_table(motion, IDEAL), IDEAL)
    smoothing = {
        **fuse_inputs.segment.smoothing,
        "z_m": UNSMOOTHED.model_copy(update={"cutoff_hz": 0.8}),
        "u_m_s": UNSMOOTHED.model_copy(update={"cutoff_hz": 5.0}),
    }
    narrow = replace(
        fuse_inputs, segment=fuse_inputs.segment.model_copy(update={"smoothing": smoothing})
    )
    for cutoff, expected in ((3.0, 1), (0.5, 0), (None, 0)):
        blocks = fuse.run(narrow, fuse.Params(cutoff_hz=cutoff)).section["blocks"]
        warnings = [
            block["text"]
            for block in blocks
            if block["kind"] == "remark" and block["level"] == "note"
        ]
        assert len(warnings) == expected
        assert all(
            "Below the low-pass of 3 Hz" in words
            and "z 0.8 Hz." in words
            and "u " not in words.split(":")[1]
            for words in warnings
        )


@pytest.mark.parametrize(
    ("without", "params", "stream"),
    [
        (VELOCITY[:3], {}, "velocity"),
        (VELOCITY[:3], {"method": "thesis"}, "velocity"),
        (VELOCITY[3:], {}, "imu"),
        (ACCELEROMETER, {"method": "thesis"}, "imu"),
    ],
)
def test_what_is_missing_is_named(
    motion: Motion, without: tuple[str, ...], params: Mapping[str, Any], stream: str
) -> None:
    with pytest.raises(
        DataError, match=f"stage fuse needs .*stream '{stream}'.*can come from"
    ) as caught:
        run(motion, without=without, **params)
    assert "DataFlash" in str(caught.value)


def test_accelerometer_is_not_needed_for_kinematic(motion: Motion) -> None:
    assert run(motion, without=ACCELEROMETER).fused.num_rows == motion.t_s.size


@pytest.mark.parametrize("mounting", ["imu_mounting", "dvl_mounting"])
def test_views_draw_raw_and_fused_in_the_same_axes(motion: Motion, mounting: str) -> None:
    """A sensor turned by 1 rad about z: raw minus fused, as the recording draws it, is
    noise; in sensor axes the difference would be 0.25 rad/s and 0.6 m/s.
    """
    sensors = replace(IDEAL, **{mounting: np.array([0.0, 0.0, 1.0])})
    vehicle = mounted_vehicle(sensors)
    log = log_document(end_us=int(motion.t_s[-1] * 1e6), start_us=0)
    streams = sampled(resampled_table(motion, sensors, sensor_axes=True), 0.0, every=1)
    noise = np.random.default_rng(3)
    for stream, names in (("imu", GYRO), ("velocity", VELOCITY[:3])):
        for name in names:
            place = streams[stream].column_names.index(name)
            noisy = column(streams[stream], name) + noise.normal(0.0, 1e-3, len(streams[stream]))
            streams[stream] = streams[stream].set_column(
                place, streams[stream].schema.field(name), pa.array(noisy)
            )
    cut = resample.run(
        resample.Inputs(LegEntry(id="one", log="log", use="training"), log, vehicle, **streams),
        resample.Params(smoothing="none", rate_hz=RATE_HZ),
    )
    outputs = fuse.run(
        fuse.Inputs(cut.segment["one"], cut.resampled["one"], vehicle, log),
        fuse.Params(cutoff_hz=3.0, edge_s=2.0, fit_gyro_bias=False),
    )
    tables = {"resampled": cut.resampled["one"], "fused": outputs.fused}
    groups = {group["entity"]: group for group in outputs.views["groups"]}
    for entity in ("state/velocity", "state/rates"):
        raw, fused = (groups[f"{entity}/{role}"] for role in ("raw", "fused"))
        rows = np.searchsorted(
            column(tables[raw["table"]], "t_s"), column(tables[fused["table"]], "t_s") - 1e-9
        )
        difference = matrix(tables[raw["table"]], raw["columns"])[rows] - matrix(
            tables[fused["table"]], fused["columns"]
        )
        # noise of 1e-3, and what the low-pass of 3 Hz takes of waves up to 0.6 Hz
        assert np.sqrt(np.mean(difference**2, axis=0)).max() < 2e-3


def test_biases_belong_to_their_segment() -> None:
    for seed, bias in ((1, 0.01), (2, -0.02)):
        sensors = replace(
            IDEAL, gyro_bias=np.array([0.0, bias, 0.0]), accel_bias=np.array([bias, 0.0, 0.0])
        )
        outputs = run(rich_motion(30.0, seed=seed), sensors, method="thesis").fusion
        assert outputs.gyro_bias_rad_s == pytest.approx([0.0, bias, 0.0], abs=1e-6)
        assert outputs.accel_bias_m_s2 == pytest.approx([bias, 0.0, 0.0], abs=1e-4)


def test_gyro_bias_can_be_left_alone(motion: Motion) -> None:
    sensors = replace(IDEAL, gyro_bias=np.array([0.01, 0.0, 0.0]))
    outputs = run(motion, sensors, fit_gyro_bias=False)
    assert outputs.fusion.gyro_bias_rad_s == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(
        column(outputs.fused, "p_rad_s"), motion.nu[:, 3] + 0.01, rtol=0.0, atol=1e-12
    )


def test_section_shows_raw_in_body_axes_beside_fused(motion: Motion) -> None:
    blocks = {block["title"]: block for block in run(motion, ODD).section["blocks"]}
    lines = blocks["Velocity of the body origin, raw against fused"]["panels"][0]["series"]
    assert [line["name"] for line in lines] == ["raw", "fused"]
    spread = {row[0]: row[1] for row in blocks["RMS of raw minus fused"]["rows"]}
    arm = np.cross(motion.nu[:, 3:], ODD.dvl_arm)
    assert spread["u"] == pytest.approx(np.sqrt(np.mean(arm[:, 0] ** 2)), rel=1e-5)
    assert spread["p"] == pytest.approx(abs(ODD.gyro_bias[0]), rel=1e-3)


def test_inputs_are_not_written_to(motion: Motion) -> None:
    table = resampled_table(motion, ODD)
    before = table.to_pydict()
    fuse.run(inputs(table, ODD), fuse.Params(method="thesis"))
    assert table.to_pydict() == before
