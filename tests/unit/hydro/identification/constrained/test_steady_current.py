"""The current of a dive, measured on made motion over moving water."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.identification.constrained.steady_current import (
    LegOverGround,
    SteadyCurrent,
    current_scatter,
    measured_currents,
)
from auvid.hydro.identification.regression.assumed_figures import MeasuredLeg, through_water
from tests.support.motions import shipped_vehicle

STEP_S, SECONDS, USUAL = 0.2, 120.0, 0.15
VEHICLE = replace(shipped_vehicle("bluerov2_heavy"), thrusters=None)


def leg_over_ground(
    current: Array, *, log: str = "dive", seed: int = 1, turns: float = 2.0, steady: bool = False
) -> LegOverGround:
    """Return a leg through water that goes with a current (2,) towards north and east.

    Or with one (n, 3), NED, that changes.
    turns [rad]: how far the heading swings; steady: at one speed.
    """
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, SECONDS, STEP_S)
    nu, nu_dot, eta = (np.zeros((len(t_s), 6)) for _ in range(3))
    for axis, (size, period) in {0: (0.4, 17.0), 1: (0.3, 13.0), 5: (0.0, 29.0)}.items():
        size = 0.0 if steady and axis < 2 else size
        phase = 2.0 * np.pi * (t_s / period + rng.random())
        nu[:, axis], nu_dot[:, axis] = (
            size * np.sin(phase),
            size * 2 * np.pi / period * np.cos(phase),
        )
    if steady:
        nu[:, 0] = 0.5
    eta[:, 5] = turns * np.sin(2.0 * np.pi * t_s / 41.0)
    nu[:, 5] = np.gradient(eta[:, 5], STEP_S)
    still = MeasuredLeg(eta, nu, nu_dot, Control(), STEP_S)
    drag = -20.0 * nu - 60.0 * nu * np.abs(nu) + 0.5 * rng.standard_normal(nu.shape)
    flow = current if current.ndim == 2 else np.tile([*current, 0.0], (len(t_s), 1))
    ground = through_water(still, -flow)
    through, over = (
        residual_force(VEHICLE, leg.eta, leg.nu, leg.nu_dot, leg.control).tau_bar
        for leg in (still, ground)
    )
    return LegOverGround(log, ground, drag + over - through, np.zeros_like(nu))


@pytest.mark.parametrize("current", [(0.2, -0.1), (0.0, 0.0)])
def test_a_dive_that_turns_shows_its_current(current: tuple[float, float]) -> None:
    true = np.array(current)
    measured = measured_currents([leg_over_ground(true)], VEHICLE, usual_m_s=USUAL)["dive"]
    assert np.abs(measured.value - true).max() < 2.0 * measured.sd.max() < 0.03
    assert measured.shows
    assert measured.clear == bool(true.any())
    errors = measured.errors
    moment = np.outer(measured.value, measured.value) + measured.covariance
    settled = measured.established[:2]
    np.testing.assert_allclose(
        (errors.T @ errors)[:2, :2] + np.outer(settled, settled), moment, atol=1e-15
    )
    np.testing.assert_array_equal(settled, measured.value if true.any() else 0.0)


@pytest.mark.parametrize("wander", [0.0, 0.04])
def test_neighbouring_pieces_show_a_current_that_changes(wander: float) -> None:
    """Noise is independent from piece to piece; a slow change is not."""
    t_s = np.arange(0.0, SECONDS, STEP_S)
    change = wander * np.sqrt(2.0) * np.sin(2.0 * np.pi * t_s / SECONDS)
    flow = np.column_stack([0.1 + change, change[::-1] - 0.05, np.zeros_like(t_s)])
    legs = [leg_over_ground(flow, seed=seed) for seed in range(3)]
    currents = measured_currents(legs, VEHICLE, usual_m_s=USUAL)
    scatter = current_scatter(legs, VEHICLE, currents, usual_m_s=USUAL)
    assert scatter == pytest.approx(wander, abs=0.012)


def test_the_scatter_of_many_legs_takes_little_memory() -> None:
    """Each block has one current: not every block keeps those of all others (92 MB here)."""
    leg = leg_over_ground(np.array([0.1, 0.0]))
    short = replace(
        leg,
        measured=leg.measured.rows(slice(0, 200)),
        tau_bar=leg.tau_bar[:200],
        actuators=leg.actuators[:200],
    )
    legs = [short] * 30
    currents = {"dive": SteadyCurrent(np.array([0.1, 0.0]), 1e-4 * np.eye(2))}
    tracemalloc.start()
    try:
        current_scatter(legs, VEHICLE, currents, usual_m_s=USUAL)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 20e6


def test_each_dive_has_its_own_whatever_the_order_of_legs() -> None:
    legs = [
        leg_over_ground(np.array([0.2, 0.0]), log="b", seed=1),
        leg_over_ground(np.array([0.0, -0.15]), log="a", seed=2),
        leg_over_ground(np.array([0.2, 0.0]), log="b", seed=3),
    ]
    measured = measured_currents(legs, VEHICLE, usual_m_s=USUAL)
    other = measured_currents([legs[i] for i in (2, 0, 1)], VEHICLE, usual_m_s=USUAL)
    for log, true in (("a", (0.0, -0.15)), ("b", (0.2, 0.0))):
        np.testing.assert_allclose(measured[log].value, true, atol=0.01)
        np.testing.assert_allclose(other[log].value, measured[log].value, atol=1e-9)
        np.testing.assert_allclose(other[log].covariance, measured[log].covariance, rtol=1e-6)


def test_a_straight_leg_at_one_speed_leaves_what_is_usual() -> None:
    """A push along the hull and drag are one there; a short one says nothing at all."""
    straight = leg_over_ground(np.array([0.2, 0.0]), turns=0.0, steady=True)
    measured = measured_currents([straight], VEHICLE, usual_m_s=USUAL)["dive"]
    assert not measured.clear
    assert not measured.shows
    assert measured.sd.min() > 0.9 * USUAL
    short = replace(straight, measured=straight.measured.rows(slice(0, 100)))
    measured = measured_currents([short], VEHICLE, usual_m_s=USUAL)["dive"]
    np.testing.assert_array_equal(measured.covariance, USUAL**2 * np.eye(2))
