"""Restoring force, fins, propeller and thrusters: signs, scales and limits."""

import math
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.fins import fin_force
from auvid.hydro.dynamics.actuators.propeller import level_speed, propeller_force
from auvid.hydro.dynamics.actuators.thrusters import (
    thrust_from_pwm,
    thruster_force,
    thruster_forces,
)
from auvid.hydro.dynamics.mechanics.restoring import restoring_force
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from tests.support.dynamics_oracles import advance_ratio

ROOT = Path(__file__).parents[5]
VT690 = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text()))
BLUEROV2 = vehicle_from_document(read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text()))

FACTORS = np.array(
    [
        [0, 0, 1, 0, -1, 1],
        [0, 0, -1, 0, -1, -1],
        [0, 0, -1, 0, 1, 1],
        [0, 0, 1, 0, 1, -1],
        [1, -1, 0, -1, 0, 0],
        [-1, -1, 0, -1, 0, 0],
        [1, 1, 0, -1, 0, 0],
        [-1, 1, 0, -1, 0, 0],
    ]
)
"""ArduPilot's vectored 6-DOF frame: roll, pitch, yaw, up, forward, lateral of thrusters
1 to 8.
"""


def pose(phi=0.0, theta=0.0, psi=0.0):
    return np.array([0.0, 0.0, 5.0, phi, theta, psi])


def restoring(eta, weight=100.0, buoyancy=100.0, r_G=(0.0, 0.0, 0.02), r_B=(0.0, 0.0, 0.0)):
    return restoring_force(eta, weight=weight, buoyancy=buoyancy, r_G=r_G, r_B=r_B)


def test_restoring_is_stable_with_the_weight_below_the_buoyancy():
    assert restoring(pose(phi=0.1))[3] == pytest.approx(-100.0 * 0.02 * math.sin(0.1))
    assert restoring(pose(theta=0.1))[4] == pytest.approx(-100.0 * 0.02 * math.sin(0.1))
    assert restoring(pose(phi=0.1), r_G=(0, 0, -0.02))[3] > 0.0
    np.testing.assert_allclose(restoring(pose()), 0.0, atol=1e-15)


def test_restoring_equals_forces_and_arms_in_ned():
    """(2.42)-(2.44): gravity and buoyancy turned into body axes, with their moments."""
    from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned

    eta, r_G, r_B = pose(0.4, -0.3, 2.0), np.array([0.1, -0.2, 0.3]), np.array([-0.05, 0.02, 0.01])
    down = rotation_body_to_ned(eta[3:]).T @ [0.0, 0.0, 1.0]
    force = (120.0 - 90.0) * down
    moment = np.cross(r_G, 120.0 * down) + np.cross(r_B, -90.0 * down)
    expected = np.concatenate([force, moment])
    np.testing.assert_allclose(
        restoring(eta, 120.0, 90.0, r_G, r_B), expected, rtol=1e-12, atol=1e-12
    )


def test_vt690_is_buoyant():
    assert VT690.weight - VT690.buoyancy == pytest.approx(-2.393, abs=1e-3)


@pytest.mark.parametrize("fin", range(4))
def test_every_positive_fin_rolls_to_port(fin):
    """Table B.4: a positive deflection of any one fin gives K < 0 (0.1 rad, below where
    the quadratic part matters).
    """
    delta = np.zeros(4)
    delta[fin] = 0.1
    assert fin_force(VT690.fins, [1.5, 0, 0, 0, 0, 0], delta, water_density=1000.0)[3] < 0.0


def test_fin_force_is_the_sum_of_b4_and_scales_with_u_squared_only():
    delta = np.array([0.1, -0.05, 0.2, 0.03])
    tau = fin_force(VT690.fins, [2.0, 0.5, 0.3, 0, 0, 0], delta, water_density=1000.0)
    z = 0.5 * 1000.0 * 2.057**2 * 2.0**2
    linear_z = -0.00208 * 0.1 + 0.0019506 * -0.05 + -4.5858e-21 * 0.03
    quadratic_z = (
        -0.00018319 * 0.1**2 - 0.00015493 * 0.05**2 + 0.00025333 * 0.2**2 - 0.00029625 * 0.03**2
    )
    assert tau[2] == pytest.approx(z * (linear_z + quadratic_z), rel=1e-12)
    linear_n = -1.9695e-05 * 0.1 - 0.00088374 * 0.2 + 0.00097045 * 0.03
    quadratic_n = (
        -0.00015519 * 0.1**2 + 6.7519e-05 * 0.05**2 + 4.6321e-05 * 0.2**2 + 1.2038e-05 * 0.03**2
    )
    assert tau[5] == pytest.approx(z * 2.057 * (linear_n + quadratic_n), rel=1e-12)
    coefficients = VT690.fins.linear @ delta + VT690.fins.quadratic @ delta**2
    np.testing.assert_allclose(
        tau, z * np.array([1.0, 1.0, 1.0, 2.057, 2.057, 2.057]) * coefficients, rtol=1e-12
    )
    still = fin_force(VT690.fins, [0.0, 0.5, 0.3, 0, 0, 0], delta, water_density=1000.0)
    np.testing.assert_array_equal(still, 0.0)
    np.testing.assert_allclose(
        fin_force(VT690.fins, [4.0, 0, 0, 0, 0, 0], delta, water_density=1000.0),
        4.0 * tau,
        rtol=1e-12,
    )


def test_aft_fins_turn_the_vehicle_against_their_force():
    """Stern planes: starboard fin trailing edge gives Z and M of the same sign, the
    rudders Y and N of opposite sign.
    """
    nu = [1.5, 0, 0, 0, 0, 0]
    starboard = fin_force(VT690.fins, nu, [0.1, 0, 0, 0], water_density=1000.0)
    bottom = fin_force(VT690.fins, nu, [0, 0, 0.1, 0], water_density=1000.0)
    assert starboard[2] * starboard[4] > 0.0
    assert bottom[1] * bottom[5] < 0.0


def test_thrust_equals_the_open_water_polynomials():
    propeller, u, n = VT690.propeller, np.linspace(0.0, 3.0, 7), 35.0
    J = advance_ratio(propeller, u, n)
    np.testing.assert_allclose(J, 0.7 * u / (35.0 * 0.12), rtol=1e-14)
    nu = np.zeros((7, 6))
    nu[:, 0] = u
    tau = propeller_force(propeller, nu, n, water_density=1000.0)
    K_T, K_Q = np.polyval([-0.1378, 0.0483, 0.0578], J), np.polyval([-0.01174, 0.00575, 0.00419], J)
    np.testing.assert_allclose(tau[:, 0], K_T * 1000.0 * n**2 * 0.12**4, rtol=1e-12)
    np.testing.assert_allclose(tau[:, 3], K_Q * 1000.0 * n**2 * 0.12**5, rtol=1e-12)
    np.testing.assert_array_equal(tau[:, [1, 2, 4, 5]], 0.0)


def test_thrust_vanishes_at_the_published_advance_ratio():
    u = 0.8462 * 30.0 * 0.12 / 0.7
    thrust = propeller_force(VT690.propeller, [u, 0, 0, 0, 0, 0], 30.0, water_density=1000.0)[0]
    assert thrust == pytest.approx(0.0, abs=2e-3)  # N; J is quoted to four digits, dT/dJ is 35 N


def test_propeller_passes_smoothly_through_standstill():
    assert np.isnan(advance_ratio(VT690.propeller, 1.0, 0.0))
    n = np.array([-1e-9, 0.0, 1e-9])
    thrust = propeller_force(
        VT690.propeller, np.broadcast_to([1.0, 0, 0, 0, 0, 0], (3, 6)), n, water_density=1000.0
    )[:, 0]
    np.testing.assert_allclose(thrust, thrust[1], rtol=1e-6)
    astern = propeller_force(VT690.propeller, np.zeros(6), -10.0, water_density=1000.0)
    ahead = propeller_force(VT690.propeller, np.zeros(6), 10.0, water_density=1000.0)
    np.testing.assert_allclose(astern, -ahead)
    assert ahead[0] > 0.0


def test_level_speed_is_not_extrapolated():
    speed = level_speed(VT690.propeller, np.array([30.0, 15.0, 49.0, 51.0, -1.0]))
    assert speed[:2] == pytest.approx([1.5277, 1.5277 / 2])
    assert 2.2067 < speed[2] < 2.5461
    assert np.isnan(speed[3:]).all()


def test_thrust_curve_keeps_table_dead_band_and_ends():
    curve = BLUEROV2.thrusters.curve
    pwm = np.array(
        [1472.0, 1500.0, 1528.0, 1100.0, 1900.0, 1000.0, 2000.0, 0.0, 799.0, 1560.0, np.nan]
    )
    force = thrust_from_pwm(pwm, None, curve)
    np.testing.assert_array_equal(force[:3], 0.0)
    np.testing.assert_array_equal(force[3:9], [-39.91, 51.44, -39.91, 51.44, 0.0, 0.0])
    assert force[9] == pytest.approx((0.756 + 3.914) / 2)
    assert np.isnan(force[10])


def test_thrust_scales_with_voltage():
    curve = BLUEROV2.thrusters.curve
    assert thrust_from_pwm(1700.0, 14.0, curve) == pytest.approx(17.88 * (14.0 / 16.0) ** 1.1)
    assert thrust_from_pwm(1700.0, 16.0, curve) == pytest.approx(17.88)


def test_allocation_has_the_signs_of_the_autopilot():
    """Each nonzero factor has the sign of the geometry; where the factor is 0 so is the
    geometry, except the roll and pitch of the horizontal thrusters, which sit 0.085 m
    below the origin and which the autopilot's mixer leaves to its feedback.
    """
    allocation = BLUEROV2.thrusters.allocation
    assert allocation.shape == (6, 8)
    roll, pitch, yaw, up, forward, lateral = FACTORS.T
    mixer = np.stack([forward, lateral, -up, roll, pitch, yaw])
    geometric = np.where(np.abs(allocation) > 1e-9, np.sign(allocation), 0.0)
    np.testing.assert_array_equal(geometric[mixer != 0], mixer[mixer != 0])
    surplus = (mixer == 0) & (geometric != 0)
    assert set(zip(*np.nonzero(surplus), strict=True)) == {
        (axis, thruster) for axis in (3, 4) for thruster in range(4)
    }
    np.testing.assert_allclose(np.abs(allocation[surplus]), 0.085 / math.sqrt(2.0), rtol=1e-7)


@pytest.mark.parametrize(
    ("column", "axis", "sign"), [(0, 3, 1), (1, 4, 1), (2, 5, 1), (3, 2, -1), (4, 0, 1), (5, 1, 1)]
)
def test_a_command_of_the_autopilot_moves_its_own_axis(column, axis, sign):
    """Pulses as the mixer writes them, 1500 + 150 direction factor, push along the
    commanded axis.
    """
    pulses = 1500.0 + 150.0 * BLUEROV2.thrusters.direction * FACTORS[:, column]
    tau = thruster_force(BLUEROV2.thrusters, thruster_forces(BLUEROV2.thrusters, pulses))
    assert sign * tau[axis] > 0.0
    moved = BLUEROV2.thrusters.allocation[axis]
    assert (
        abs(tau[axis]) > 0.9 * np.abs(moved[FACTORS[:, column] != 0]).sum() * 9.0
    )  # N; the weaker direction gives 9.2 N here


def test_direction_mirrors_the_pulse_and_keeps_the_strong_direction():
    pulses = np.full(8, 1500.0) + 200.0 * BLUEROV2.thrusters.direction
    np.testing.assert_allclose(thruster_forces(BLUEROV2.thrusters, pulses), 17.88)
    np.testing.assert_array_equal(thruster_forces(BLUEROV2.thrusters, np.zeros(8)), 0.0)
    by_voltage = thruster_forces(
        BLUEROV2.thrusters, np.stack([pulses, pulses]), np.array([16.0, 14.0])
    )
    assert by_voltage.shape == (2, 8)
    np.testing.assert_allclose(by_voltage[1] / by_voltage[0], (14.0 / 16.0) ** 1.1)
