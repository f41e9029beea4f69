"""Steady motion with roll and pitch free: equilibria, their growth, what tips over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike

from auvid.hydro.dynamics.steady_motion import (
    NO_MOTION,
    TIPPED_RAD,
    Floating,
    Guess,
    SteadyDrive,
    SteadyMotion,
    _balanced,
    _batch,
    _newton_steps,
    _Together,
    overturning,
    rest_tilts,
    steady_motions,
)
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from tests.support.motions import shipped_vehicle

VEHICLE = shipped_vehicle("bluerov2_heavy")
RIGHTING = -float(VEHICLE.r_B[2]) * VEHICLE.buoyancy
DAMPED = {axis: {x: -4.0} for axis, x in zip("XYZKMN", "uvwpqr", strict=True)}
SPEEDS = np.linspace(0.0, 1.0, 101)


def floating(**rows: dict[str, float]) -> Floating:
    coefficients = {axis: {**row, **rows.get(axis, {})} for axis, row in DAMPED.items()}
    return Floating(VEHICLE, IdentifiedModel("test", coefficients), np.zeros(6))


def along(
    model: Floating, axis: str, speeds: ArrayLike, drive: ArrayLike
) -> tuple[list[SteadyMotion], str]:
    track = SteadyDrive(axis, np.asarray(drive), np.asarray(speeds))
    return steady_motions([(model, track)], minimum_speed=0.05)[0]


def test_drives_that_are_tried_together_find_what_each_finds_alone() -> None:
    model = floating(M={"u": -3.0}, N={"v": 1.0})
    heavier = replace(VEHICLE, added_mass=1.5 * VEHICLE.added_mass)
    rows = {**DAMPED, "Y": {"v": -9.0, "u*r": 4.0}, "Z": {"w*|w|": -20.0}}
    other = Floating(heavier, IdentifiedModel("other", rows), 0.3 * np.eye(6)[2])
    tracks = [
        (model, SteadyDrive("X", np.eye(6)[0], SPEEDS[::20])),
        (other, SteadyDrive("X", np.eye(6)[0], SPEEDS[::20])),
        (model, SteadyDrive("X", np.eye(6)[0], -SPEEDS[::10])),
        (model, SteadyDrive("N", np.eye(6)[5], SPEEDS[::25])),
        (other, SteadyDrive("N", np.eye(6)[5], SPEEDS[::25])),
    ]
    together = steady_motions(tracks, minimum_speed=0.05)
    for (vehicle, track), (motions, end) in zip(tracks, together, strict=True):
        single, single_end = along(vehicle, track.axis, track.speeds, track.direction)
        assert end == single_end
        assert len(motions) == len(single) > 2
        for one, same in zip(motions, single, strict=True):
            assert one.nu == pytest.approx(same.nu, abs=1e-12)
            assert one.tilt == pytest.approx(same.tilt, abs=1e-12)
            assert one.growth == pytest.approx(same.growth, abs=1e-9)


def test_pitch_of_steady_surge_balances_the_righting_moment_and_ends_at_sixty_degrees() -> None:
    """M_u u = (z_G W - z_B B) sin(theta), and X_u u + f = 0."""
    model = floating(M={"u": -3.0})
    motions, end = along(model, "X", SPEEDS, np.eye(6)[0])
    assert end == "pitch"
    for motion in motions:
        assert np.sin(motion.tilt[1]) == pytest.approx(-3.0 * motion.speed / RIGHTING, abs=1e-9)
        assert motion.force == pytest.approx(4.0 * motion.speed, abs=1e-9)
    ends = np.sin(TIPPED_RAD) * RIGHTING / 3.0
    assert motions[-1].speed <= ends < motions[-1].speed + 0.01


def test_thrusters_below_the_origin_hold_what_a_force_at_the_origin_tips_over() -> None:
    """A drag centre at the height of the thrusters gives no pitch."""
    model = floating(X={"u": -50.0}, M={"u": -0.085 * 50.0})
    drive = [1.0, 0.0, 0.0, 0.0, 0.085, 0.0]
    motions, _ = along(model, "X", SPEEDS, drive)
    assert len(motions) == len(SPEEDS)
    assert max(abs(motion.tilt[1]) for motion in motions) < 1e-9
    lost, _ = along(model, "X", SPEEDS, np.eye(6)[0])
    assert len(lost) < 40


def test_growth_is_that_of_a_damped_pendulum() -> None:
    """I p_dot = K_p p - righting phi, slower than every other motion of the vehicle."""
    fast = {axis: {x: -200.0} for axis, x in zip("XYZMN", "uvwqr", strict=True)}
    model = floating(**fast, K={"p": 0.3})
    model = Floating(
        VEHICLE,
        IdentifiedModel("test", {**model.model.coefficients, "M": {"q": -1.0}}),
        np.zeros(6),
    )
    inertia = VEHICLE.mass_matrix[3, 3]
    expected = np.roots([inertia, -0.3, RIGHTING]).real.max()
    still = np.zeros((1, 6)), np.zeros((1, 2))
    (rate,), (axis,) = _Together.of([model]).growths(0, *still, minimum_speed=0.05)
    assert rate == pytest.approx(expected, rel=1e-9)
    assert axis == "K"


def test_slopes_are_those_of_the_balance() -> None:
    model = floating(M={"u": -3.0, "w*|w|": 2.0}, Z={"u*w": -5.0}, N={"v": 1.0})
    nu, tilt = np.array([0.3, -0.1, 0.2, 0.05, -0.04, 0.2]), np.array([0.2, -0.4])
    slope, step, together = model.slopes(nu, tilt), 1e-6, _Together.of([model])
    for j in range(8):
        change = step * np.eye(8)[j]
        ahead = together.balance(0, nu + change[:6], tilt + change[6:])
        behind = together.balance(0, nu - change[:6], tilt - change[6:])
        assert slope[:, j] == pytest.approx((ahead - behind) / (2 * step), abs=1e-7)


def test_the_coefficient_that_pushes_over_most_is_named_first() -> None:
    model = floating(M={"u": -3.0, "u*|u|": -0.5})
    last = along(model, "X", SPEEDS, np.eye(6)[0])[0][-1]
    shares = overturning(model, "M", last, np.eye(6)[0])
    assert next(iter(shares)) == "M_u"
    assert shares["M_u"] == pytest.approx(3.0 * last.speed)
    assert sum(shares.values()) == pytest.approx(RIGHTING * np.sin(abs(last.tilt[1])), rel=1e-9)


def test_quadratic_damping_balances_a_constant_force_from_rest() -> None:
    """w = -sqrt(6 / 90) where Z = -6 N rises against Z_ww = -90 kg/m."""
    rows = {a: {f"{x}*|{x}|": -90.0} for a, x in zip("XYZKMN", "uvwpqr", strict=True)}
    model = Floating(VEHICLE, IdentifiedModel("test", rows), -6.0 * np.eye(6)[2])
    motions, end = along(model, "N", [0.0, 0.1], np.eye(6)[5])
    assert (end, len(motions)) == ("", 2)
    assert motions[0].nu[2] == pytest.approx(-np.sqrt(6.0 / 90.0), abs=1e-9)
    assert rest_tilts([model])[0] == pytest.approx(0.0, abs=1e-8)


def test_a_speed_without_balance_ends_without_a_tilt() -> None:
    undriven = floating()
    assert along(undriven, "X", [0.2], np.zeros(6)) == ([], NO_MOTION)


def test_the_end_is_bisected() -> None:
    model = floating(M={"u": -3.0})
    speeds = np.linspace(0.0, 1.0, 8)
    motions, _ = along(model, "X", speeds, np.eye(6)[0])
    limit = np.sin(TIPPED_RAD) * RIGHTING / 3.0
    assert limit - 1.0 / 7.0 / 30.0 < motions[-1].speed <= limit


def test_a_step_to_a_pitch_of_90_degrees_finds_no_balance() -> None:
    """There roll has no rate, so the balance and its slopes are no numbers."""
    model, pitched = floating(), np.array([0.0, np.pi / 2.0])
    upright = Guess(np.zeros(6), np.zeros(2), 0.0, np.zeros(8), None)
    search = _balanced(upright._replace(tilt=pitched))
    answer, other = _newton_steps(*_batch([model, model]), [next(search), upright])
    assert answer is None
    assert other is not None
    with pytest.raises(StopIteration) as end:
        search.send(answer)
    assert end.value.value is None
