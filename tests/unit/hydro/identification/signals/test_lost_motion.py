"""What a low-pass does to coefficients, against fits of a motion that it passed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.identification.regression.assumed_figures import MeasuredLeg
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.hydro.identification.signals.lost_motion import (
    PIECE,
    SMOOTHED_SHARE,
    lost_by_spline,
    lost_motion,
)
from tests.support.motions import shipped_vehicle

HEAVY = shipped_vehicle("bluerov2_heavy")
STEP_S = 0.02
TERMS = ("u", "q", "u*|u|", "q*|q|")
TRUTH = {"X": np.array([-30.0, -60.0]), "M": np.array([-2.0, -1.5])}
OWN = {"X": ("u", "u*|u|"), "M": ("q", "q*|q|")}
BAND_HZ = 0.6
"""Below it lies 95 % of the power of `flown`."""


def flown(length_s: float = 160.0) -> MeasuredLeg:
    """Surge and pitch rate of orders that change each second, as no low-pass passed them."""
    count = round(length_s / STEP_S)
    random = np.random.default_rng(3)
    nu = np.zeros((count, 6))
    for column, size in ((0, 0.6), (4, 0.5)):
        orders = np.repeat(size * random.standard_normal(count // 50), 50)
        nu[:, column] = first_order_lag(orders[:, None], lag_s=0.3, step_s=STEP_S)[:, 0]
    rate = np.asarray(np.gradient(nu, STEP_S, axis=0))
    still = Control(thruster_force_N=np.zeros((count, 8)))
    return MeasuredLeg(np.zeros_like(nu), nu, rate, still, STEP_S)


def known_force(leg: MeasuredLeg) -> Array:
    return residual_force(HEAVY, leg.eta, leg.nu, leg.nu_dot, leg.control).tau_bar


def lean(cutoff_hz: float) -> dict[str, tuple[Array, Array]]:
    """Return axis -> what a low-pass moves a fit by, and what it is expected to."""
    leg = flown()
    t_s = np.arange(len(leg.nu)) * STEP_S
    force = np.zeros_like(leg.nu)
    for axis, column in (("X", 0), ("M", 4)):
        force[:, column] = TRUTH[axis] @ basis_rows(leg.nu.T, None, OWN[axis])

    def passed(values: Array) -> Array:
        return zero_phase_lowpass(t_s, values, cutoff_hz=cutoff_hz)

    after = replace(leg, eta=passed(leg.eta), nu=passed(leg.nu), nu_dot=passed(leg.nu_dot))
    measured = passed(force - known_force(leg)) + known_force(after)
    change = lost_motion(after, HEAVY, TERMS, ratio=None, cutoff_hz=cutoff_hz)
    factor = TriangularFactor.empty(TERMS).update(basis_rows(after.nu.T, None, TERMS), measured)
    fits = {axis: solve_axis(factor, axis, OWN[axis]) for axis in OWN}
    return {axis: (fit.solution - TRUTH[axis], change.shift(fit)) for axis, fit in fits.items()}


@pytest.mark.parametrize("share", [0.7, 1.0, 1.5])
def test_a_low_pass_that_is_too_low_leans_as_expected(share: float) -> None:
    for moved, expected in lean(share * BAND_HZ).values():
        assert np.abs(moved[1]) > 0.01
        np.testing.assert_array_equal(np.sign(expected), np.sign(moved))
        assert (np.abs(expected) > 0.4 * np.abs(moved)).all()
        assert (np.abs(expected) < 2.0 * np.abs(moved)).all()


def test_one_far_above_the_motion_leans_nothing() -> None:
    for axis, (moved, expected) in lean(6.0 * BAND_HZ).items():
        assert (np.abs(moved) < 4e-3 * np.abs(TRUTH[axis])).all()
        assert (np.abs(expected) < 8e-3 * np.abs(TRUTH[axis])).all()


def test_pieces_add_up_and_a_short_leg_says_nothing() -> None:
    """A leg of two pieces has twice the sums of one that repeats; edges are left out."""
    leg, cutoff_hz = flown(), 6.0
    assert 2 * len(leg.nu) > PIECE
    once = lost_motion(leg, HEAVY, TERMS, ratio=None, cutoff_hz=cutoff_hz)
    twice = MeasuredLeg(
        np.concatenate([leg.eta, leg.eta]),
        np.concatenate([leg.nu, leg.nu[::-1]]),
        np.concatenate([leg.nu_dot, -leg.nu_dot[::-1]]),
        Control(thruster_force_N=np.zeros((2 * len(leg.nu), 8))),
        STEP_S,
    )
    twofold = lost_motion(twice, HEAVY, TERMS, ratio=None, cutoff_hz=cutoff_hz)
    np.testing.assert_allclose(twofold.moment, 2.0 * once.moment, rtol=0.05, atol=1e-6)
    short = lost_motion(leg.rows(slice(0, 40)), HEAVY, TERMS, ratio=None, cutoff_hz=1.0)
    assert not short.moment.any()
    assert not short.target.any()


def test_a_spline_takes_from_velocity_and_acceleration_of_its_channel() -> None:
    """At its cutoff it leaves half. An accelerometer has w x v in it, which is u q of heave."""
    t_s = np.arange(0.0, 60.0, STEP_S)
    wave = 2.0 * np.pi * t_s
    nu, nu_dot = np.zeros((2, len(t_s), 6))
    nu[:, 0], nu[:, 4], nu_dot[:, 4] = 2.0, np.sin(wave), 2.0 * np.pi * np.cos(wave)
    still = Control(thruster_force_N=np.zeros((len(t_s), 8)))
    leg = MeasuredLeg(np.zeros_like(nu), nu, nu_dot, still, STEP_S)
    half, inner = 0.5 * SMOOTHED_SHARE, slice(100, -100)

    def taken(index: int, *, accelerometer: bool) -> tuple[Array, Array]:
        return lost_by_spline(leg, HEAVY, index, 1.0, accelerometer=accelerometer, stride=5)

    d_force, d_nu = taken(4, accelerometer=False)
    assert d_nu[inner, 4] == pytest.approx(-half * nu[::5][inner, 4], abs=0.01)
    after = replace(leg.every(5), nu=nu[::5] + d_nu, nu_dot=(nu_dot - half * nu_dot)[::5])
    lost = known_force(after) - known_force(leg.every(5))
    assert d_force[inner, 4] == pytest.approx(lost[inner, 4], abs=0.05)
    _, d_nu = taken(2, accelerometer=True)
    heave = half * 2.0 * np.cos(wave) / (2.0 * np.pi)
    assert d_nu[inner, 2] == pytest.approx(-heave[::5][inner], abs=0.02)
    assert not taken(2, accelerometer=False)[0].any(), "heave itself does not move"
