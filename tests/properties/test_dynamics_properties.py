"""What holds for every attitude, velocity and inertia."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from auvid.hydro.dynamics.actuators.thrusters import thruster_allocation
from auvid.hydro.dynamics.mechanics.added_mass import spheroid_added_mass
from auvid.hydro.dynamics.mechanics.kinematics import (
    eta_dot,
    euler_rate_matrix,
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
    skew,
)
from auvid.hydro.dynamics.mechanics.restoring import restoring_force
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force, rigid_body_matrix
from auvid.hydro.dynamics.viscous.basis import basis, eta_ratio
from tests.support.dynamics_oracles import body_velocity, coriolis

ANGLE = st.floats(-3.1, 3.1)
PITCH = st.floats(-1.5, 1.5)
SPEED = st.floats(-5.0, 5.0)
ATTITUDE = st.builds(lambda phi, theta, psi: np.array([phi, theta, psi]), ANGLE, PITCH, ANGLE)
VELOCITY = arrays(np.float64, 6, elements=SPEED)
SYMMETRIC = arrays(np.float64, (6, 6), elements=st.floats(-50.0, 50.0)).map(lambda a: a + a.T)

quick = settings(deadline=None, max_examples=60, derandomize=True)


@quick
@given(ATTITUDE)
def test_rotation_is_orthonormal_and_proper(attitude):
    turn = rotation_body_to_ned(attitude)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(turn) > 0.0


@quick
@given(ATTITUDE)
def test_euler_rate_matrices_are_inverse(attitude):
    np.testing.assert_allclose(
        euler_rate_matrix(attitude) @ euler_rate_matrix_inverse(attitude), np.eye(3), atol=1e-12
    )


@quick
@given(ATTITUDE, VELOCITY)
def test_body_velocity_inverts_eta_dot(attitude, nu):
    eta = np.concatenate([np.zeros(3), attitude])
    np.testing.assert_allclose(body_velocity(eta, eta_dot(eta, nu)), nu, atol=1e-11)


@quick
@given(ATTITUDE, VELOCITY)
def test_euler_rates_are_the_derivative_of_the_rotation(attitude, nu):
    """P_v' = P_v S(omega), by central difference of step 1e-6 s: error about 1e-9 times
    rate^2, near the pole more.
    """
    assume(abs(attitude[1]) < 1.2)
    rate = eta_dot(np.concatenate([np.zeros(3), attitude]), nu)[3:]
    step = 1e-6
    difference = (
        rotation_body_to_ned(attitude + step * rate) - rotation_body_to_ned(attitude - step * rate)
    ) / (2.0 * step)
    np.testing.assert_allclose(
        rotation_body_to_ned(attitude).T @ difference, skew(nu[3:]), atol=1e-6
    )


@quick
@given(SYMMETRIC, VELOCITY)
def test_coriolis_does_no_work(M, nu):
    C = coriolis(M, nu)
    np.testing.assert_array_equal(C, -C.T)
    size = np.abs(M).max() * (np.abs(nu).max() ** 2)
    np.testing.assert_allclose(C @ nu, coriolis_force(M, nu), atol=1e-13 * size * 36)
    assert abs(nu @ coriolis_force(M, nu)) <= 1e-13 * size * np.abs(nu).max() * 216


@quick
@given(SYMMETRIC, SYMMETRIC, VELOCITY)
def test_coriolis_is_linear_in_the_inertia(M, A, nu):
    np.testing.assert_allclose(
        coriolis_force(M - A, nu), coriolis_force(M, nu) - coriolis_force(A, nu), atol=1e-9
    )


@quick
@given(st.floats(1.0, 100.0), arrays(np.float64, 3, elements=st.floats(-0.5, 0.5)))
def test_kinetic_energy_is_that_of_the_centre_of_gravity(mass, r_G):
    """0.5 nu' M_RB nu = 0.5 m |v_G|^2 + 0.5 omega' I_G omega, with I_0 moved from the
    centre of gravity by Steiner.
    """
    nu = np.array([1.0, -0.5, 0.3, 0.2, -0.4, 0.7])
    I_G = np.diag([1.0, 2.0, 3.0])
    steiner = mass * (np.dot(r_G, r_G) * np.eye(3) - np.outer(r_G, r_G))
    v_G = nu[:3] + np.cross(nu[3:], r_G)
    energy = 0.5 * mass * v_G @ v_G + 0.5 * nu[3:] @ I_G @ nu[3:]
    np.testing.assert_allclose(
        0.5 * nu @ rigid_body_matrix(mass, r_G, I_G + steiner) @ nu, energy, rtol=1e-12
    )


@quick
@given(st.floats(0.01, 10.0), st.floats(1.0, 50.0))
def test_spheroid_added_mass_lies_between_its_limits(b, ratio):
    X, Y, Z, K, M, N = np.diag(spheroid_added_mass(ratio * b, b, fluid_mass=1.0))
    assert -0.5 - 1e-12 <= X < 0.0
    assert -1.0 < Y <= -0.5 + 1e-12
    assert (Y, M) == (Z, N)
    assert K == 0.0
    assert -((ratio * b) ** 2) / 5.0 < M <= 0.0


@quick
@given(ATTITUDE, ANGLE)
def test_restoring_does_not_depend_on_heading_or_place(attitude, psi):
    eta = np.concatenate([[1.0, 2.0, 3.0], attitude])
    other = np.concatenate([[-4.0, 0.0, 9.0], attitude[:2], [psi]])
    fixed = {"weight": 100.0, "buoyancy": 95.0, "r_G": (0.01, 0.02, 0.03), "r_B": (0.0, 0.0, -0.01)}
    np.testing.assert_array_equal(restoring_force(eta, **fixed), restoring_force(other, **fixed))


@quick
@given(VELOCITY, st.floats(0.1, 4.0))
def test_quadratic_terms_scale_with_the_square(nu, factor):
    assume(np.abs(nu).max() > 1e-3)
    terms = ("u*v", "w*|q|", "r*V", "|p|*Vv", "v*Vw")
    np.testing.assert_allclose(
        basis(factor * nu, None, terms), factor**2 * basis(nu, None, terms), rtol=1e-12, atol=1e-280
    )


@quick
@given(VELOCITY, st.floats(0.0, 3.0))
def test_eta_ratio_never_exceeds_its_bound(nu, level_speed):
    assert 0.0 <= eta_ratio(level_speed, nu, minimum_speed=0.1) <= level_speed / 0.1


@quick
@given(
    arrays(np.float64, (5, 3), elements=SPEED),
    arrays(np.float64, (5, 3), elements=SPEED),
    arrays(np.float64, 5, elements=SPEED),
)
def test_allocation_is_force_and_moment(position, axis, force):
    tau = thruster_allocation(position, axis) @ force
    np.testing.assert_allclose(tau[:3], (axis * force[:, None]).sum(axis=0), atol=1e-11)
    np.testing.assert_allclose(
        tau[3:], np.cross(position, axis * force[:, None]).sum(axis=0), atol=1e-10
    )
