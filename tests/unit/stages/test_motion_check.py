"""What a model does by itself: the verdict, its words and remedies, and the uses."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.records.models import ModelCard, MotionCheck, VelocityRange
from auvid.hydro.dynamics.steady_motion import Floating
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.validate.motion_check import ORIGIN, motion_check
from tests.support.example_run import example_run
from tests.support.motions import shipped_vehicle

VEHICLE = shipped_vehicle("bluerov2_heavy")
DAMPED = {
    "X": {"u": -50.0}, "Y": {"v": -80.0}, "Z": {"w": -70.0},
    "K": {"p": -2.0}, "M": {"q": -1.0}, "N": {"r": -5.0},
}  # fmt: skip


def card(fastest: float = 0.3) -> ModelCard:
    spans = dict.fromkeys("uvw", (-fastest / 3.0, fastest)) | dict.fromkeys("pq", (-0.05, 0.05))
    spans["r"] = (-0.2, 0.2)
    conditions = {
        name: VelocityRange(rms=0.1, low=low, high=high) for name, (low, high) in spans.items()
    }
    return (
        example_run({"train": 4.0, "check": 2.0})
        .cards["coe"]
        .model_copy(update={"conditions": {name: conditions[name] for name in "uvwpqr"}})
    )


def checked(fastest: float = 0.3, **rows: dict[str, float]) -> MotionCheck:
    coefficients = {axis: {**row, **rows.get(axis, {})} for axis, row in DAMPED.items()}
    floating = Floating(VEHICLE, IdentifiedModel("coe", coefficients), np.zeros(6))
    return motion_check(floating, card(fastest), minimum_speed=0.05)


def test_drag_at_the_height_of_the_thrusters_holds_and_a_force_at_the_origin_does_not() -> None:
    check = checked(M={"u": -0.085 * 50.0}, K={"v": 0.085 * 80.0})
    assert (check.verdict, check.decays_lost) == ("holds", 0)
    own = [item for item in check.ranges if item.drive == "thrusters"]
    assert [item.axis for item in own] == ["X", "Y", "Z", "N"]
    assert max(max(item.roll_rad, item.pitch_rad) for item in own) < 0.1
    surge = next(item for item in check.ranges if (item.axis, item.drive) == ("X", ORIGIN))
    assert (surge.tips_in, surge.cause) == ("pitch", "M_u")
    assert 0.1 < surge.upright[1] < 0.3
    assert "alone tips it over in pitch above" in check.words
    assert any("with 1 N of surge 0.085 N m of pitch" in words for words in check.remedies)
    assert any("righting moment" in words for words in check.remedies)


def test_a_drive_that_tips_over_is_the_verdict_with_its_speed() -> None:
    check = checked(M={"u": -20.0})
    surge = next(item for item in check.ranges if (item.axis, item.drive) == ("X", "thrusters"))
    # 20 u less the .085 m of the thrusters' 50 u: at .084 m/s all of the righting moment.
    limit = 1.324 / (20.0 - 0.085 * 50.0)
    assert check.verdict == "tips over"
    assert 0.3 * limit < surge.upright[1] < limit
    assert surge.upright[0] < 0.0
    assert "driven by its thrusters tips it over in pitch" in check.words
    assert "of surge (most of it by M_u" in check.words


def test_an_unstable_equilibrium_is_said_with_its_growth() -> None:
    check = checked(0.01, K={"p": 0.06})
    assert check.verdict == "unstable"
    assert "unstable in roll: a disturbance grows by" in check.words


def test_a_vehicle_that_floats_askew_is_said_to() -> None:
    constant = np.array([0.0, 0.0, 0.0, 0.0, -0.45, 0.0])
    floating = Floating(VEHICLE, IdentifiedModel("coe", DAMPED), constant)
    check = motion_check(floating, card(0.01), minimum_speed=0.05)
    assert check.verdict == "holds"
    assert check.rest_rad is not None
    assert check.rest_rad[1] == pytest.approx(-np.arcsin(0.45 / check.righting_N_m[1]), rel=1e-6)
    assert "at rest it floats at roll 0, pitch -20 degrees" in check.words
