"""Markers off the place of the vehicle file: said, weak, and corrected where asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.data_schemas.documents.vehicle.quantities import Vector
from auvid.data_schemas.documents.vehicle.sensors import MountedEntry
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.pose.marker_arm import MarkerArm
from auvid.stages.fit_axes.fitted import AxisFits
from auvid.stages.fit_axes.fitting import fit_all
from auvid.stages.fit_axes.flight import FitOptions, LegData
from auvid.stages.fit_axes.markers import arm_doubts, at_origin, markers_of, markers_words
from auvid.stages.leg_record.motion import FIXES, POSES, VELOCITY_LOG
from tests.unit.stages.test_axes_together import TRUTH, body, file_inertia, legs_of

ARM = np.array([0.15, -0.08, 0.0])
OPTIONS = FitOptions(axes=("Y",), lag_s=0.08, fit_lag=False, together="never", marker_arm="file")


def off_origin(arm: Array) -> dict[str, LegData]:
    """Return two legs whose velocities are those of markers at `arm`."""
    legs = {
        key: item for key, item in legs_of(file_inertia(), coriolis=False).items() if key != "leg_2"
    }
    measured = dict.fromkeys("XYN", POSES)
    of_poses = {
        key: LegData(
            replace(item.record, measured_by=measured),
            item.windows.model_copy(update={"measured_by": measured}),
        )
        for key, item in legs.items()
    }
    return at_origin(of_poses, POSES, -arm)


def sway(fits: AxisFits) -> dict[str, str]:
    return {name: fits.fitted[0].verdict(name) for name in fits.fitted[0].equation.names}


def test_markers_off_the_origin_are_said_and_nothing_is_identified() -> None:
    fits = fit_all(off_origin(ARM), body(), OPTIONS)
    assert fits.markers is not None
    assert [item.verdict for item in fits.markers.figures[:2]] == ["departs", "departs"]
    for figure, truth in zip(fits.markers.figures[:2], ARM[:2], strict=True):
        assert figure.corrected == pytest.approx(truth, abs=0.01)
    assert "identified" not in sway(fits).values()
    assert "sensors.pose.arm" in markers_words(fits.markers)


def test_motion_by_poses_is_a_percent_less_sure() -> None:
    """Beside its noise, and in the figures that need no newtons too."""
    legs = off_origin(np.zeros(3))
    logged = {
        key: LegData(
            replace(item.record, measured_by=dict.fromkeys("XYN", VELOCITY_LOG)),
            item.windows.model_copy(update={"measured_by": dict.fromkeys("XYN", VELOCITY_LOG)}),
        )
        for key, item in legs.items()
    }
    poses, log = (fit_all(of, body(), OPTIONS).fitted[0] for of in (legs, logged))
    assert poses.equation.values == pytest.approx(log.equation.values)
    variances = [np.diag(item.equation.covariance) for item in (poses, log)]
    moved = [name != "constant" for name in log.equation.names]
    expected = np.where(moved, 0.01 * log.equation.values, 0.0) ** 2
    np.testing.assert_allclose(variances[0] - variances[1], expected, rtol=1e-6, atol=1e-15)
    for wide, plain in zip(poses.quantities, log.quantities, strict=True):
        half = np.hypot(plain.high - plain.value, 0.0196 * abs(plain.value))
        assert wide.high - wide.value == pytest.approx(half, rel=1e-3)


@pytest.mark.parametrize("smoothed_s", [0.2, 1.2])
def test_motion_by_fixes_may_be_slower_than_the_vehicle(smoothed_s: float) -> None:
    """What has time in it is less sure, by how long the smoother is; the steady speed is not."""
    legs = off_origin(np.zeros(3))
    fixes, log = (
        fit_all(
            {
                key: LegData(
                    replace(item.record, measured_by=dict.fromkeys("XYN", sensor)),
                    item.windows.model_copy(
                        update={
                            "measured_by": dict.fromkeys("XYN", sensor),
                            "smoothed_s": {"Y": smoothed_s} if sensor == FIXES else {},
                        }
                    ),
                )
                for key, item in legs.items()
            },
            body(),
            OPTIONS,
        ).fitted[0]
        for sensor in (FIXES, VELOCITY_LOG)
    )
    a, b = (log.equation.value(name) for name in ("v", "v*|v|"))
    rest = 1.0 - (smoothed_s * -(a + 2.0 * b * log.rate_rms)) ** 2
    factor = 1.0 / np.sqrt(max(rest, 1.0 / 9.0))
    added = np.diag(fixes.equation.covariance - log.equation.covariance)
    expected = ((factor - 1.0) / NORMAL_95 * np.asarray(log.equation.values)) ** 2
    np.testing.assert_allclose(added, expected, rtol=1e-6, atol=1e-15)
    told_apart = smoothed_s < 1.0
    assert (fixes.verdict("v*|v|") == "identified") == told_apart
    assert any("smoothed over" in words for words in fixes.warnings) == (not told_apart)
    for wide, plain in zip(fixes.quantities, log.quantities, strict=True):
        assert (wide.high > plain.high) == (not plain.name.startswith("steady speed"))
        assert (wide.low > 0.0) == (plain.low > 0.0) or plain.name.endswith("/M")


def test_the_arm_that_legs_show_gives_the_model_of_the_origin() -> None:
    options = replace(OPTIONS, marker_arm="where_assumed")
    fits = fit_all(off_origin(ARM), body(), options)
    assert sway(fits)["v*|v|"] == "identified"
    assert fits.fitted[0].equation.value("v*|v|") == pytest.approx(TRUTH["v"][1], rel=0.1)
    assert fits.markers is not None
    assert "corrected" in markers_words(fits.markers)
    legs = off_origin(ARM)
    sd = fits.markers.figures[0].standard_error
    assert sd is not None
    doubts = arm_doubts(legs, fits.markers)
    assert set(doubts) == {"arm forward", "arm right"}  # nothing turns about the third
    record, moved = legs["leg_1"].record, doubts["arm forward"]["leg_1"]
    assert moved.rate["v"] - record.rate["v"] == pytest.approx(-sd * record.rate["r"])


def test_markers_at_their_place_leave_verdicts_alone() -> None:
    markers = markers_of(off_origin(np.zeros(3)), body())
    assert markers is not None
    assert not markers.departs


def test_a_velocity_log_off_its_place_is_known_as_markers_are() -> None:
    log = dict.fromkeys("XY", VELOCITY_LOG)
    legs = {
        key: LegData(
            replace(leg.record, measured_by=log),
            leg.windows.model_copy(update={"measured_by": log}),
        )
        for key, leg in off_origin(ARM).items()
    }
    markers = markers_of(legs, body(), place="where_assumed")
    assert markers is not None
    assert markers.used
    assert markers.departure[:2] == pytest.approx(ARM[:2], abs=0.01)
    assert markers_words(markers).startswith("The velocity log sits off")


def test_a_small_departure_from_an_assumed_arm_is_not_applied() -> None:
    """Of a centimetre nothing is better known than of the centre of the added mass."""
    near = np.array([0.012, 0.0, 0.0])
    assumed = markers_of(off_origin(near), body(), place="where_assumed")
    estimated = markers_of(off_origin(near), body(), place="estimated")
    assert assumed is not None
    assert estimated is not None
    assert assumed.used
    assert not assumed.departure.any()
    assert estimated.departure[0] == pytest.approx(0.012, abs=0.005)


@pytest.mark.parametrize(("arm", "error"), [((0.15, 0.0, -1.2), 0.3), ((0.15, 0.0, -3.0), 0.05)])
def test_an_arm_that_no_vehicle_has_or_a_vague_one_is_not_determined(
    monkeypatch: pytest.MonkeyPatch, arm: tuple[float, ...], error: float
) -> None:
    estimate = MarkerArm(np.array(arm), np.array([0.005, 0.005, error]))
    monkeypatch.setattr("auvid.stages.fit_axes.markers.marker_arm", lambda *_: estimate)
    legs = off_origin(np.zeros(3))
    markers = markers_of(legs, body(), place="where_assumed")
    assert markers is not None
    assert markers.departure.tolist() == [0.15, 0.0, 0.0]
    assert "(arm down) is not determined" in markers_words(markers)
    assert f"{arm[2]:.3f}" not in markers_words(markers)
    # What it may be is that of a sensor on a hull.
    pitching = {
        key: LegData(
            replace(leg.record, rate={**leg.record.rate, "q": np.ones(len(leg.record.t_s))}),
            leg.windows,
        )
        for key, leg in legs.items()
    }
    doubtful = arm_doubts(pitching, markers)["arm down"]["leg_1"].rate["u"]
    assert doubtful == pytest.approx(legs["leg_1"].record.rate["u"] - 0.5)


def test_a_measured_arm_of_the_file_stays() -> None:
    stated = with_arm(body(), assumed=False)
    kept = markers_of(off_origin(ARM), stated, place="where_assumed")
    moved = markers_of(off_origin(ARM), with_arm(body(), assumed=True), place="where_assumed")
    assert kept is not None
    assert moved is not None
    assert (kept.used, moved.used) == (False, True)


def with_arm(vehicle: Vehicle, *, assumed: bool) -> Vehicle:
    """Return a vehicle whose file has markers at its origin, measured or assumed."""
    arm = Vector(value=[0.0, 0.0, 0.0], unit="m", source="tape", assumed=assumed)
    sensors = vehicle.document.sensors.model_copy(update={"pose": MountedEntry(arm=arm)})
    document = vehicle.document.model_copy(update={"sensors": sensors})
    return replace(vehicle, document=document, markers=vehicle.dvl)
