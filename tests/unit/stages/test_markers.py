"""Markers off the place of the vehicle file: said, weak, and corrected where asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.stages.fit_axes.fitted import AxisFits
from auvid.stages.fit_axes.fitting import fit_all
from auvid.stages.fit_axes.flight import FitOptions, LegData
from auvid.stages.fit_axes.markers import at_origin, markers_of, markers_words
from auvid.stages.leg_record.motion import POSES
from tests.unit.stages.test_axes_together import TRUTH, body, file_inertia, legs_of

ARM = np.array([0.15, -0.08, 0.0])
OPTIONS = FitOptions(axes=("Y",), lag_s=0.08, fit_lag=False, together="never")


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
    return at_origin(of_poses, -arm)


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


def test_the_arm_that_legs_show_gives_the_model_of_the_origin() -> None:
    options = replace(OPTIONS, move_markers=True)
    fits = fit_all(off_origin(ARM), body(), options)
    assert sway(fits)["v*|v|"] == "identified"
    assert fits.fitted[0].equation.value("v*|v|") == pytest.approx(TRUTH["v"][1], rel=0.1)
    assert fits.markers is not None
    assert "corrected" in markers_words(fits.markers)


def test_markers_at_their_place_leave_verdicts_alone() -> None:
    markers = markers_of(off_origin(np.zeros(3)), body(), use=False)
    assert markers is not None
    assert not markers.departs


def test_a_velocity_log_has_no_markers() -> None:
    assert markers_of(legs_of(file_inertia()), body(), use=False) is None
