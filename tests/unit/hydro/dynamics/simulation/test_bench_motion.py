"""Motion of the bench experiments against energy, periods and steady speeds that are
known.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.simplified import SimplifiedModel
from auvid.hydro.dynamics.simulation.bench_motion import (
    PhysicalPendulum,
    Quadrifilar,
    drive,
    free_decay,
    swing,
)

GRAVITY = 9.80665
TRAY = Quadrifilar(
    inertia=2.1970,
    mass=9.8,
    radius_ceiling=0.47,
    radius_tray=0.47,
    line=4.23,
    damping=0.0,
    gravity=GRAVITY,
)


def surge(**changes):
    numbers = {
        "linear": np.zeros(6),
        "quadratic": np.array([-27.7411, -50.0, -60.0, -1.0, -1.0, -2.1709]),
    }
    added = np.array([-13.5778, -27.9347, -46.3258, -0.5, -0.5, -3.1023])
    return SimplifiedModel(
        mass=20.9,
        inertia=np.full(3, 0.9),
        added_mass=added,
        buoyancy=205.0,
        z_B=-0.02,
        **(numbers | changes),
    )


def test_speed_under_constant_thrust_is_the_closed_form():
    """m_u u_dot = X - c u^2 from rest: u = sqrt(X/c) tanh(t sqrt(X c) / m_u)."""
    model, thrust = surge(), 20.0
    path = drive(model, np.zeros(6), np.array([0.0]), np.array([[thrust, 0, 0, 0, 0, 0.0]]), 20.0)
    t = np.linspace(0.0, 20.0, 77)
    state, rate = path(t)
    c, mass = 27.7411, 20.9 + 13.5778
    exact = np.sqrt(thrust / c) * np.tanh(t * np.sqrt(thrust * c) / mass)
    np.testing.assert_allclose(state[:, 0], exact, atol=1e-9)  # m/s
    np.testing.assert_allclose(rate[:, 0], (thrust - c * exact**2) / mass, atol=1e-9)
    assert state[-1, 6] == pytest.approx(
        mass / c * np.log(np.cosh(20.0 * np.sqrt(thrust * c) / mass)), abs=1e-8
    )


def test_a_step_back_joins_without_a_jump_and_the_vehicle_waits_at_first():
    path = drive(
        surge(),
        np.array([0.0, 0, 3.0, 0, 0, 0]),
        np.array([0.0, 4.0]),
        np.array([[20.0, 0, 0, 0, 0, 0], [-9.0, 0, 0, 0, 0, 0]]),
        9.0,
    )
    state, rate = path(np.array([-1.0, 0.0, 4.0 - 1e-9, 4.0 + 1e-9]))
    np.testing.assert_array_equal(state[0], [*np.zeros(8), 3.0, 0, 0, 0])
    np.testing.assert_array_equal(rate[0], 0.0)
    np.testing.assert_allclose(state[2], state[3], atol=1e-7)
    assert rate[2, 0] - rate[3, 0] == pytest.approx(29.0 / (20.9 + 13.5778), abs=1e-6)


def test_the_empty_tray_has_the_period_of_the_text():
    """(54)-(56) for I_P = 2.1970: 4.157 s (20 periods 83.1 s); the tray with the tube,
    2.8590 and 12.18 kg: 4.254 s.
    """
    assert period(TRAY, 1e-3) == pytest.approx(4.1571, abs=5e-5)
    both = Quadrifilar(2.8590, 12.18, 0.47, 0.47, 4.23, 0.0, GRAVITY)
    assert period(both, 1e-3) == pytest.approx(4.2538, abs=5e-5)


def test_a_large_swing_of_the_tray_keeps_its_energy():
    state, _ = swing(TRAY, 0.5, 30.0)(np.linspace(0.0, 30.0, 301))
    psi, speed = state.T
    depth = np.sqrt(4.23**2 - 2 * 0.47**2 + 2 * 0.47**2 * np.cos(psi))
    slope = -(0.47**2) * np.sin(psi) / depth
    energy = 0.5 * (2.1970 + 9.8 * slope**2) * speed**2 - 9.8 * GRAVITY * depth
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)


def test_free_decay_without_damping_has_the_exact_period():
    pendulum = PhysicalPendulum(inertia=500.0, restoring=378.0, linear=0.0, quadratic=0.0)
    amplitude = np.radians(22.0)
    period = 4.0 * np.sqrt(500.0 / 378.0) * ellipk(np.sin(amplitude / 2.0) ** 2)
    assert period_of(free_decay(pendulum, amplitude, 30.0)) == pytest.approx(period, abs=1e-7)


def test_damping_takes_what_it_should():
    """Energy lost is the work of the damping moment, by a fine sum (error of the
    trapezoid below 1e-6).
    """
    pendulum = PhysicalPendulum(inertia=500.0, restoring=378.0, linear=-50.0, quadratic=-30.0)
    t = np.linspace(0.0, 20.0, 20001)
    state, rate = free_decay(pendulum, 0.4, 20.0)(t)
    theta, speed = state.T
    energy = 0.5 * 500.0 * speed**2 - 378.0 * np.cos(theta)
    power = -50.0 * speed**2 - 30.0 * np.abs(speed) ** 3
    np.testing.assert_allclose(energy[-1] - energy[0], np.trapezoid(power, t), rtol=1e-6)
    np.testing.assert_allclose(np.gradient(speed, t)[5:-5], rate[5:-5, 1], atol=1e-5)


def test_a_floating_pendulum_is_refused():
    with pytest.raises(DataError, match="buoyancy is above weight"):
        free_decay(PhysicalPendulum(500.0, -1.0, 0.0, 0.0), 0.4, 5.0)


def period(tray, amplitude):
    return period_of(swing(tray, amplitude, 20.0))


def period_of(path):
    """Time between two crossings of zero in the same direction."""
    from scipy.optimize import brentq

    t = np.linspace(0.0, 19.0, 400)
    angle = path(t)[0][:, 0]
    first = [
        brentq(lambda s: path(np.array([s]))[0][0, 0], t[i], t[i + 1])
        for i in np.flatnonzero(np.diff(np.sign(angle)) > 0)[:2]
    ]
    return first[1] - first[0]
