"""What a model does by itself: the verdict, its words and remedies, and the uses."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.records.models import ModelCard, MotionCheck, VelocityRange
from auvid.hydro.dynamics.equations_of_motion import restoring_of
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix
from auvid.hydro.dynamics.steady_motion import (
    Floating,
    SteadyDrive,
    SteadyMotion,
    steady_motions,
)
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.validate.motion_check import (
    ORIGIN,
    Tried,
    _range,
    _stable_end,
    _tips,
    decay_starts,
    motion_checks,
)
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
    return motion_checks([(floating, card(fastest))], minimum_speed=0.05)[0]


@pytest.mark.parametrize(("slowest", "nearest"), [(0.1, 0.1), (-0.1, 0.0)])
def test_decays_start_within_the_flown_velocities(slowest: float, nearest: float) -> None:
    """Of a vehicle that never stood none starts at rest ahead."""
    flown = card().conditions
    flown = flown | {"u": flown["u"].model_copy(update={"low": slowest})}
    starts = np.array(decay_starts(flown))
    assert np.all(starts >= [flown[name].low for name in "uvwpqr"])
    assert np.all(starts <= [flown[name].high for name in "uvwpqr"])
    assert starts[2].tolist() == [nearest, flown["v"].low, 0.0, 0.0, 0.0, 0.0]


def test_drag_at_the_height_of_the_thrusters_holds_and_a_force_at_the_origin_does_not() -> None:
    check = checked(M={"u": -0.085 * 50.0}, K={"v": 0.085 * 80.0})
    assert (check.verdict, check.decays_lost) == ("holds", 0)
    own = [item for item in check.ranges if item.drive == "thrusters"]
    assert [item.axis for item in own] == ["X", "Y", "Z", "N"]
    assert max(max(item.roll_rad, item.pitch_rad) for item in own) < 0.1
    surge = next(item for item in check.ranges if (item.axis, item.drive) == ("X", ORIGIN))
    assert (surge.tips_in, surge.cause) == ("pitch", "M_u")
    assert 0.1 < surge.upright[1] < 0.3
    assert "alone it tips over in pitch above" in check.words
    assert any("0.085 N m of pitch to each N of surge" in words for words in check.remedies)
    assert any("righting moment" in words for words in check.remedies)


def test_a_drive_that_tips_over_is_the_verdict_with_its_speed() -> None:
    check = checked(M={"u": -20.0})
    surge = next(item for item in check.ranges if (item.axis, item.drive) == ("X", "thrusters"))
    # 20 u less the .085 m of the thrusters' 50 u: at .084 m/s all of the righting moment.
    limit = 1.324 / (20.0 - 0.085 * 50.0)
    assert check.verdict == "tips over"
    assert 0.3 * limit < surge.upright[1] < limit
    assert surge.upright[0] < 0.0
    assert "driven by its thrusters it tips over in pitch" in check.words
    assert "of surge (most of it by M_u" in check.words
    growing = surge.model_copy(update={"tips_in": "unstable", "stable": [-0.02, 0.01]})
    assert _tips([growing])[0].startswith("it is unstable below -0.02 and above 0.01 m/s of surge")
    both = _tips([surge, surge.model_copy(update={"axis": "Y"})])
    assert [words.partition(" pitch")[0] for words in both] == ["it tips over in", "in"]


def test_an_unstable_equilibrium_is_said_with_its_growth() -> None:
    check = checked(0.01, K={"p": 0.06})
    assert check.verdict == "unstable"
    assert "unstable in roll: a disturbance grows by" in check.words


def test_a_vehicle_that_floats_askew_is_said_to() -> None:
    constant = np.array([0.0, 0.0, 0.0, 0.0, -0.45, 0.0])
    floating = Floating(VEHICLE, IdentifiedModel("coe", DAMPED), constant)
    check = motion_checks([(floating, card(0.01))], minimum_speed=0.05)[0]
    assert check.verdict == "holds"
    assert check.rest_rad is not None
    assert check.rest_rad[1] == pytest.approx(-np.arcsin(0.45 / check.righting_N_m[1]), rel=1e-6)
    assert "at rest it floats at roll 0, pitch −20 degrees" in check.words


def checked_model(
    coefficients: dict[str, dict[str, float]], constant: np.ndarray | None = None
) -> MotionCheck:
    floating = Floating(
        VEHICLE,
        IdentifiedModel("coe", coefficients),
        np.zeros(6) if constant is None else constant,
    )
    return motion_checks([(floating, card())], minimum_speed=0.05)[0]


def test_a_constant_moment_that_tips_it_over_has_its_name_in_the_table_of_coefficients() -> None:
    check = checked_model(DAMPED, np.array([0.0, 0.0, 0.0, 0.0, -0.9, 0.0]))
    assert "(most of it by M_0, 0.9 N m)" in check.words
    assert "-" not in check.words


def test_quadratic_damping_with_a_constant_heave_force_stays_upright() -> None:
    strengths = zip("XYZKMN", "uvwpqr", (60, 90, 90, 2, 2, 3), strict=True)
    rows = {axis: {f"{x}*|{x}|": -float(k)} for axis, x, k in strengths}
    check = checked_model(rows, -6.0 * np.eye(6)[2])
    own = [item for item in check.ranges if item.drive == "thrusters"]
    assert [item.tips_in for item in own] == [""] * 4
    assert max(item.pitch_rad for item in own) < np.radians(25.0)


def test_an_unstable_roll_is_worded_with_the_sign_of_the_flown_end() -> None:
    check = checked(K={"p": 0.5})
    assert check.verdict == "unstable"
    assert "it is unstable below 0 and above 0 m/s of sway" in check.words
    assert check.decays_lost > 0
    assert f"{check.decays_lost} of {check.decays} decays" in check.words


def test_rest_is_without_drive_and_slowest_speed() -> None:
    rows = DAMPED | {"M": {"q": -1.0, "u": -8.0}}
    flown = card()
    conditions = dict(flown.conditions) | {"u": VelocityRange(rms=0.1, low=0.12, high=0.2)}
    floating = Floating(VEHICLE, IdentifiedModel("coe", rows), np.zeros(6))
    flown = flown.model_copy(update={"conditions": conditions})
    check = motion_checks([(floating, flown)], minimum_speed=0.05)[0]
    assert check.rest_rad == pytest.approx([0.0, 0.0], abs=1e-9)
    assert "at rest" not in check.words


def test_nothing_flown_is_not_tried() -> None:
    spans = {n: VelocityRange(rms=0.0, low=0.0, high=0.0) for n in "uvwpqr"}
    flown = card().model_copy(update={"conditions": spans})
    floating = Floating(VEHICLE, IdentifiedModel("coe", DAMPED), np.zeros(6))
    check = motion_checks([(floating, flown)], minimum_speed=0.05)[0]
    assert check.verdict == "not tried"
    assert "no drive was tried" in check.words


def test_no_balance_is_unknown_and_has_no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("auvid.hydro.dynamics.steady_motion.ITERATIONS", 0)
    check = checked()
    assert check.verdict == "unknown"
    assert {(item.tips_in, item.cause) for item in check.ranges} == {("no steady motion", "")}
    assert "no steady motion was found below" in check.words


def test_the_worse_of_both_directions_ends_a_range() -> None:
    rows = DAMPED | {"M": {"q": -1.0, "u": -20.0}}
    floating = Floating(VEHICLE, IdentifiedModel("coe", rows), np.zeros(6))
    drive, back = np.eye(6)[0], np.linspace(0.0, -0.3, 8)
    motions, end = steady_motions([(floating, SteadyDrive("X", drive, back))], minimum_speed=0.05)[
        0
    ]
    tilted = Tried("X", ORIGIN, drive, back, motions, end)
    lost = Tried("X", ORIGIN, drive, -back, [], "no steady motion")
    flights = [(tilted, np.ones(len(motions), dtype=bool)), (lost, np.zeros(0, dtype=bool))]
    surge = _range(floating, card(), flights, minimum_speed=0.05)
    assert (surge.tips_in, surge.cause) == ("pitch", "M_u")


def test_the_fastest_mode_is_said_though_no_step_reaches_it() -> None:
    """Sway and yaw that push each other grow by .82 1/s; heave alone grows by .06 1/s."""
    mass = VEHICLE.mass_matrix
    push = 1.0  # sway and yaw without damping: the rate is sqrt(push^2 / (m_2 m_6))
    rows = {
        "Y": {"v": 0.0, "r": push},
        "N": {"r": 0.0, "v": 0.82**2 * (mass[1, 1] * mass[5, 5] - mass[1, 5] ** 2) / push},
        "Z": {"w": 0.06 * mass[2, 2]},
    }
    check = checked(0.02, **rows)
    assert check.verdict == "unstable"
    worst = max(check.ranges, key=lambda item: item.growth_1_s)
    assert worst.growth_1_s == pytest.approx(0.82, abs=0.06)  # roll and speed have a part in it
    assert worst.grows_on in ("Y", "N")
    assert worst.grows_by in ("N_v", "Y_r")
    assert f"grows by {worst.growth_1_s:.2g} 1/s" in check.words
    assert f"mostly by {worst.grows_by}" in check.words
    assert "unstable in heave" not in check.words


def test_a_range_is_stable_up_to_the_speed_from_which_a_disturbance_grows() -> None:
    motions = [
        SteadyMotion(speed, 0.0, np.zeros(6), np.zeros(2), growth, "Y")
        for speed, growth in ((0.0, -0.05), (0.2, 0.15), (0.4, 0.9))
    ]
    assert _stable_end(motions, 0.0) == pytest.approx(0.1)
    assert _stable_end(motions[:1], 0.0) == 0.0
    assert _stable_end(motions[1:], 0.1) == pytest.approx(0.1 + 0.1 * 0.05 / 0.15)


def test_growth_of_a_steady_motion_is_that_of_differences_of_its_free_motion() -> None:
    """Munk's moment turns a hull without fins: the linearisation, without the derivatives."""
    rows = DAMPED | {"X": {"u*|u|": -30.0}, "Y": {"v": -4.0}, "N": {"r": -0.5}}
    floating = Floating(VEHICLE, IdentifiedModel("coe", rows), np.zeros(6))
    speeds = np.linspace(0.0, 1.0, 5)
    track = SteadyDrive("X", np.eye(6)[0], speeds)
    motion = steady_motions([(floating, track)], minimum_speed=0.05)[0][0][-1]

    def rates(x: np.ndarray) -> np.ndarray:
        force = motion.force * np.eye(6)[0] + sum(floating.moments(x[:6]).values())
        eta = np.array([0.0, 0.0, 0.0, *x[6:], 0.0])
        moved = np.linalg.solve(VEHICLE.mass_matrix, force + restoring_of(VEHICLE, eta))
        return np.append(moved, (euler_rate_matrix(eta[3:]) @ x[3:6])[:2])

    at, steps = np.append(motion.nu, motion.tilt), 1e-6 * np.eye(8)
    assert np.max(np.abs(rates(at))) < 1e-6
    slopes = np.array([(rates(at + d) - rates(at - d)) / 2e-6 for d in steps]).T
    assert motion.growth == pytest.approx(np.linalg.eigvals(slopes).real.max(), rel=1e-5)
    assert motion.growth > 0.05


def test_a_step_of_a_vehicle_that_never_stood_starts_at_its_slowest_speed() -> None:
    """Below .4 m/s its pitch moment would tip it over, and nothing of that was flown."""
    rows = DAMPED | {"M": {"q": -1.0, "u": 40.0, "u*|u|": -100.0}}
    flown = card()
    spans = dict(flown.conditions) | {"u": VelocityRange(rms=0.4, low=0.39, high=0.41)}
    floating = Floating(VEHICLE, IdentifiedModel("coe", rows), np.zeros(6))
    ahead = flown.model_copy(update={"conditions": spans})
    (check,) = motion_checks([(floating, ahead)], minimum_speed=0.05)
    surge = next(item for item in check.ranges if (item.axis, item.drive) == ("X", ORIGIN))
    assert (surge.tips_in, surge.upright[1]) == ("", 0.41)
