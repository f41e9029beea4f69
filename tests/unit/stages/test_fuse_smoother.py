"""The stage fuse with method smoother: samples at the sensors' own times, through
resample, against a known motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.motion import InstallationEstimate, InstallationRecord
from auvid.data_schemas.tables import column, has_columns, make_table, matrix
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.stages import fuse, resample
from auvid.stages.columns import ACCELERATION, POSE_RATE, VELOCITY, named
from tests.support.motions import (
    IDEAL,
    ODD,
    RATE_HZ,
    Motion,
    Sensors,
    log_document,
    mounted_vehicle,
    resampled_table,
    rich_motion,
)
from tests.unit.stages.test_fuse import sampled


@pytest.fixture(scope="module")
def motion() -> Motion:
    return rich_motion(40.0, seed=4)


def inputs(motion: Motion, sensors: Sensors, described: Sensors | None = None) -> fuse.Inputs:
    """What resample gives of the motion as `sensors` see it, with the vehicle file that
    `told` describes.
    """
    vehicle = mounted_vehicle(described or sensors)
    streams = sampled(resampled_table(motion, sensors, sensor_axes=True), 0.0)
    log = log_document(
        end_us=int(motion.t_s[-1] * 1e6), start_us=0, accelerometer=sensors.convention
    )
    leg = resample.Inputs(LegEntry(id="one", log="log", use="training"), log, vehicle, **streams)
    cut = resample.run(leg, resample.Params(smoothing="none", rate_hz=RATE_HZ))
    samples = {
        name: getattr(cut, name)["one"]
        for name in ("samples_imu", "samples_velocity", "samples_depth")
    }
    return fuse.Inputs(cut.segment["one"], cut.resampled["one"], vehicle, log, **samples)


def run(inputs: fuse.Inputs, **params: Any) -> fuse.Outputs:
    outputs = fuse.run(
        inputs, fuse.Params(**{"method": "smoother", "cutoff_hz": None, "edge_s": 2.0, **params})
    )
    check_document(outputs.fusion, "fusion")
    return outputs


def errors(outputs: fuse.Outputs, motion: Motion) -> tuple[float, float]:
    """RMS errors of velocity [m/s] and its rate [m/s^2] over u, v, w."""
    t_s = column(outputs.fused, "t_s")
    rows = np.searchsorted(motion.t_s, t_s - 1e-9)
    velocity = matrix(outputs.fused, VELOCITY[:3]) - motion.nu[rows, :3]
    rate = matrix(outputs.fused, ACCELERATION[:3]) - motion.nu_dot[rows, :3]
    return float(np.sqrt(np.mean(velocity**2))), float(np.sqrt(np.mean(rate**2)))


@pytest.mark.parametrize("convention", ["specific_force", "inertial"])
def test_recovers_velocity_rate_and_bias(motion: Motion, convention: str) -> None:
    sensors = replace(ODD, convention=convention)
    outputs = run(inputs(motion, sensors))
    velocity, rate = errors(outputs, motion)
    # exact sensors sampled at 5 to 100 Hz: what is left is interpolation of attitude
    # and rates between samples
    assert velocity < 2e-3
    assert rate < 2e-2
    np.testing.assert_allclose(
        outputs.fusion.accel_bias_m_s2, sensors.accel_bias, rtol=0.0, atol=5e-3
    )
    assert outputs.fusion.warnings == []


def test_gives_standard_deviations(motion: Motion) -> None:
    outputs = run(inputs(motion, ODD)).fused
    names = ("u_sd_m_s", "v_sd_m_s", "w_sd_m_s")
    assert has_columns(outputs, names)
    assert np.all(matrix(outputs, names) > 0)


def test_takes_the_estimated_installation(motion: Motion) -> None:
    unknown = replace(ODD, dvl_arm=np.zeros(3))
    blind = inputs(motion, ODD, described=unknown)
    estimate = InstallationEstimate(arm_m=ODD.dvl_arm.tolist(), angles_rad=[0.0] * 3, lag_s=0.0)
    estimated = replace(blind, installation=installation_record(estimate))
    right, wrong = run(estimated, installation="estimate"), run(blind)
    assert errors(right, motion)[0] < 2e-3 < 0.02 < errors(wrong, motion)[0]  # m/s
    assert right.fusion.installation == "estimate"
    # m/s: measured sway uses the estimated arm, not that of the vehicle file.
    turned = float(np.std(matrix(right.fused, ("r_rad_s",)) * ODD.dvl_arm[0]))
    assert right.fusion.integrated_sway_rms_m_s < 0.5 * turned
    # An estimate is used where it is wanted, and nowhere else.
    np.testing.assert_array_equal(
        matrix(run(estimated).fused, VELOCITY), matrix(wrong.fused, VELOCITY)
    )


@pytest.mark.parametrize("method", ["kinematic", "smoother"])
def test_turns_and_shifts_the_velocity_log_by_the_estimate(motion: Motion, method: str) -> None:
    angle, lag = np.array([0.02, -0.03, 0.05]), 0.1
    turned = Rotation.from_rotvec(angle).as_matrix()
    true_inputs = inputs(motion, replace(IDEAL, convention="specific_force"))

    def faulty(table: pa.Table) -> pa.Table:
        # The log reads what was true `lag` ago, in axes turned back by `angle`.
        past = CubicSpline(motion.t_s, motion.nu[:, :3])(column(table, "t_s") - lag) @ turned
        for name, values in zip(VELOCITY[:3], past.T, strict=True):
            index = table.column_names.index(name)
            table = table.set_column(index, table.schema.field(name), pa.array(values))
        return table

    assert true_inputs.samples_velocity is not None
    true_inputs = replace(
        true_inputs,
        resampled=faulty(true_inputs.resampled),
        samples_velocity=faulty(true_inputs.samples_velocity),
        installation=installation_record(
            InstallationEstimate(arm_m=[0.0] * 3, angles_rad=angle.tolist(), lag_s=lag)
        ),
    )
    right = run(true_inputs, method=method, installation="estimate")
    wrong = run(true_inputs, method=method)
    assert errors(right, motion)[0] < 4e-3 < 0.03 < errors(wrong, motion)[0]  # m/s


def test_refuses_an_estimate_that_there_is_not(motion: Motion) -> None:
    fuse_inputs = inputs(motion, ODD)
    for record in (None, installation_record(None)):
        with pytest.raises(CampaignError, match="no estimate of how the velocity log is installed"):
            run(replace(fuse_inputs, installation=record), installation="estimate")
    with pytest.raises(CampaignError, match="takes no lever arm"):
        run(fuse_inputs, method="thesis", as_published=True, installation="estimate")


def installation_record(estimate: InstallationEstimate | None) -> InstallationRecord:
    return InstallationRecord(
        figures=[],
        estimate=estimate,
        convention="specific_force",
        convention_found=None,
        innovations={},
        legs=[],
        left_out={},
    )


def test_refuses_without_its_sensors(motion: Motion) -> None:
    fuse_inputs = inputs(motion, ODD)
    for name, word in (
        ("samples_imu", "accelerometer"),
        ("samples_velocity", "velocity"),
        ("samples_depth", "depth"),
    ):
        with pytest.raises(DataError, match=word):
            run(replace(fuse_inputs, **{name: None}))


def test_unknown_noise_is_refused_with_the_nearest_name(motion: Motion) -> None:
    with pytest.raises(CampaignError, match="velocity_m_s"):
        run(inputs(motion, ODD), noise={"velocity_m": 0.01})
    with pytest.raises(CampaignError, match="positive"):
        run(inputs(motion, ODD), noise={"velocity_m_s": 0.0})


CURRENT = np.array([0.25, -0.15, 0.0])


def in_current(motion: Motion, sensors: Sensors, *, samples: slice = slice(None)) -> fuse.Inputs:
    """As `inputs`, in water that moves with `CURRENT` north, east, down, with water
    track from the same sensor (`samples` of it).
    """
    fuse_inputs = inputs(motion, sensors)
    track = fuse_inputs.samples_velocity
    assert track is not None
    t_s = column(track, "t_s")
    rows = np.searchsorted(motion.t_s, t_s + float(fuse_inputs.segment.leg_start_s) - 1e-9)
    drift = np.einsum("nji,j->ni", rotation_body_to_ned(motion.eta[rows, 3:]), CURRENT)
    through = matrix(track, VELOCITY[:3]) - drift
    water = make_table(
        "samples_water", {"t_s": t_s[samples], **named(VELOCITY[:3], through[samples])}
    )
    return replace(fuse_inputs, samples_water=water)


def test_water_track_gives_the_current_and_the_velocity_that_forces_see(motion: Motion) -> None:
    """u v w are through the water, v_dot is theirs: nu_r = nu - R' c; pose and its rate
    are over ground.
    """
    by_water_track = run(in_current(motion, ODD), estimate_current=True)
    stated = run(inputs(motion, ODD), current_m_s={"log": CURRENT[:2].tolist()})
    assert by_water_track.fusion.current.verdict == "observable"
    assert stated.fusion.current.verdict == "stated"
    still = run(inputs(motion, ODD), current_m_s={"another": [0.1, 0.1]})
    for outputs in (by_water_track, stated):
        np.testing.assert_allclose(outputs.fusion.current.ned_m_s, CURRENT, rtol=0.0, atol=3e-3)
        sees_moving_water(outputs, motion)
        np.testing.assert_allclose(
            matrix(outputs.fused, POSE_RATE), matrix(still.fused, POSE_RATE), rtol=0.0, atol=5e-3
        )
        tables = [block for block in outputs.section["blocks"] if block["kind"] == "table"]
        assert tables[0]["title"] == "Water current"
    assert still.fusion.current is None
    with pytest.raises(CampaignError, match="to be found from velocity through the water, too"):
        run(inputs(motion, ODD), estimate_current=True, current_m_s={"log": [0.1, 0.1]})
    with pytest.raises(CampaignError, match="two components"):
        run(inputs(motion, ODD), current_m_s={"log": [0.1, 0.1, 0.0]})


def sees_moving_water(outputs: fuse.Outputs, motion: Motion) -> None:
    """Assert that velocity and its rate are those through water that goes with `CURRENT`."""
    t_s = column(outputs.fused, "t_s")
    rows = np.searchsorted(motion.t_s, t_s - 1e-9)
    drift = np.einsum("nji,j->ni", rotation_body_to_ned(motion.eta[rows, 3:]), CURRENT)
    velocity = matrix(outputs.fused, VELOCITY[:3]) - (motion.nu[rows, :3] - drift)
    rate = matrix(outputs.fused, ACCELERATION[:3]) - (
        motion.nu_dot[rows, :3] + np.cross(motion.nu[rows, 3:], drift)
    )
    assert np.sqrt(np.mean(velocity**2)) < 4e-3
    assert np.sqrt(np.mean(rate**2)) < 2e-2


@pytest.mark.parametrize("samples", [None, slice(0, 3)])
def test_current_without_water_track_is_not_observable(
    motion: Motion, samples: slice | None
) -> None:
    """Nothing is invented: verdict, reason and a warning, and the state is that over
    ground.
    """
    fuse_inputs = (
        inputs(motion, ODD) if samples is None else in_current(motion, ODD, samples=samples)
    )
    estimated, plain = run(fuse_inputs, estimate_current=True), run(fuse_inputs)
    assert estimated.fusion.current.verdict == "not observable"
    assert "stream water_velocity" in estimated.fusion.current.reason
    assert estimated.fusion.current.ned_m_s is None
    assert estimated.fused.equals(plain.fused)
    warned = [
        block["text"]
        for block in estimated.section["blocks"]
        if block["kind"] == "remark" and block["level"] == "warning"
    ]
    assert any(words.startswith("Water current: not observable, because ") for words in warned)
    assert plain.fusion.current is None


def test_current_belongs_to_the_smoother(motion: Motion) -> None:
    with pytest.raises(CampaignError, match="belongs to method smoother"):
        run(inputs(motion, ODD), method="kinematic", estimate_current=True)
