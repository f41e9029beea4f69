"""The growth that a model's own coefficients give a motion."""

from __future__ import annotations

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
