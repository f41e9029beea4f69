"""The growth that a model's own coefficients give a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.dynamics.simulation.growth import growth
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from tests.support.motions import shipped_vehicle

VEHICLE = shipped_vehicle("bluerov2_heavy")
DAMPED = {axis: {x: -4.0} for axis, x in zip("XYZKMN", "uvwpqr", strict=True)}


def test_positive_roll_damping_grows_at_its_rate_and_is_named() -> None:
    model = IdentifiedModel("wild", {**DAMPED, "K": {"p": 2.9, "p*|p|": -1.0}})
    rates = growth(VEHICLE, model, np.zeros(6))
    # One equation about rest: (I_x - K_pdot) p_dot = 2.9 p.
    assert rates.rate == pytest.approx(2.9 / VEHICLE.mass_matrix[3, 3], rel=1e-12)
    assert (rates.axis, rates.cause) == ("K", "K_p")
    assert rates.adds == pytest.approx(rates.rate, rel=1e-12), "nothing else adds"


def test_growth_of_a_quadratic_term_follows_the_speed() -> None:
    model = IdentifiedModel("wild", {**DAMPED, "X": {"u": -4.0, "u*|u|": 30.0}})
    slow, fast = (growth(VEHICLE, model, [u, 0, 0, 0, 0, 0]) for u in (0.01, 0.5))
    assert slow.rate < 0.0
    assert fast.rate == pytest.approx((-4.0 + 60.0 * 0.5) / VEHICLE.mass_matrix[0, 0], rel=1e-9)
    assert (fast.axis, fast.cause) == ("X", "X_u|u|")
    assert fast.adds == pytest.approx(60.0 * 0.5 / VEHICLE.mass_matrix[0, 0], rel=1e-9)


def test_a_coupling_that_feeds_the_growth_is_named_with_what_it_adds() -> None:
    """Sway and roll that push each other: a small change of a coefficient moves the rate
    by what it adds, per its own size.
    """
    coefficients = {**DAMPED, "K": {"p": -1.0, "v": 40.0}, "Y": {"v": -4.0, "p": 5.0}}
    rates = growth(VEHICLE, IdentifiedModel("coupled", coefficients), np.zeros(6))
    assert rates.rate > 0.0
    axis, term = rates.cause.split("_")
    assert {axis, term} in ({"K", "v"}, {"Y", "p"})
    step = 1e-6
    changed = {a: dict(row) for a, row in coefficients.items()}
    changed[axis][term] *= 1.0 + step
    moved = growth(VEHICLE, IdentifiedModel("coupled", changed), np.zeros(6)).rate
    assert (moved - rates.rate) / step == pytest.approx(rates.adds, rel=1e-4)


def test_sway_and_yaw_at_speed_are_named_with_the_coriolis_force_that_feeds_them() -> None:
    """The moment of Munk turns a hull broadside; at rest, where a run starts, nothing grows."""
    rows = {**DAMPED, "Y": {"v": -4.0}, "M": {"q": -1.0}, "N": {"r": -0.05}}
    model = IdentifiedModel("long", rows)
    surge = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    level = np.zeros(2)
    assert growth(VEHICLE, model, 0.0 * surge, level).rate < 0.0
    speeds = [0.0, 0.4, 1.0, 0.2]
    rates = growth(VEHICLE, model, np.outer(speeds, surge), np.outer(speeds, level))
    assert rates == growth(VEHICLE, model, surge, level)
    assert rates.rate > 0.4
    assert rates.axis in ("Y", "N")
    assert rates.cause == "C"
    # Without it, nothing grows: what it adds is more than all that grows.
    assert rates.adds > rates.rate
    # Pitch does the same as yaw, but for the righting moment that holds it.
    assert growth(VEHICLE, model, surge).axis in ("Z", "M")


def test_a_vehicle_that_is_heavy_above_is_named_by_its_righting_moment() -> None:
    lifted = replace(VEHICLE, r_G=-VEHICLE.r_G, r_B=-VEHICLE.r_B)
    rates = growth(lifted, IdentifiedModel("capsizes", DAMPED), np.zeros(6), np.zeros(2))
    assert rates.rate > 0.0
    assert rates.axis in ("K", "M")
    assert rates.cause == "G"
