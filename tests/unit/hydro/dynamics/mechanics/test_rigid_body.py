"""Kinematics, rigid body and added mass against the component forms and limits of their
sources.
"""

import math

import numpy as np
import pytest

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.dynamics.mechanics.added_mass import spheroid_added_mass
from auvid.hydro.dynamics.mechanics.kinematics import (
    eta_dot,
    euler_rate_matrix,
    rotation_body_to_ned,
    skew,
)
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force, rigid_body_matrix
from tests.support.dynamics_oracles import body_velocity, coriolis, equal_volume_semi_axes

ROUNDING = 1e-12
"""Relative; a few hundred operations in double precision."""


def component_form(mass, r_G, inertia, nu, nu_dot):
    """McCarter (2.25)-(2.30), as printed."""
    x_G, y_G, z_G = r_G
    I_x, I_y, I_z = np.diag(inertia)
    I_xy, I_xz, I_yz = -inertia[0, 1], -inertia[0, 2], -inertia[1, 2]
    u, v, w, p, q, r = nu
    du, dv, dw, dp, dq, dr = nu_dot
    surge, sway, heave = du - v * r + w * q, dv - w * p + u * r, dw - u * q + v * p
    return np.array(
        [
            mass * (surge - x_G * (q**2 + r**2) + y_G * (p * q - dr) + z_G * (p * r + dq)),
            mass * (sway - y_G * (r**2 + p**2) + z_G * (q * r - dp) + x_G * (q * p + dr)),
            mass * (heave - z_G * (p**2 + q**2) + x_G * (r * p - dq) + y_G * (r * q + dp)),
            I_x * dp
            + (I_z - I_y) * q * r
            - (dr + p * q) * I_xz
            + (r**2 - q**2) * I_yz
            + (p * r - dq) * I_xy
            + mass * (y_G * heave - z_G * sway),
            I_y * dq
            + (I_x - I_z) * r * p
            - (dp + q * r) * I_xy
            + (p**2 - r**2) * I_xz
            + (q * p - dr) * I_yz
            + mass * (z_G * surge - x_G * heave),
            I_z * dr
            + (I_y - I_x) * p * q
            - (dq + r * p) * I_yz
            + (q**2 - p**2) * I_xy
            + (r * q - dp) * I_xz
            + mass * (x_G * sway - y_G * surge),
        ]
    )


def added_mass_component_form(m, nu, nu_dot):
    """Al Makdah (2.30) with the M row completed; xy- and xz-symmetry, McCarter's sign
    convention.
    """
    u, v, w, p, q, r = nu
    du, dv, dw, dp, dq, dr = nu_dot
    return np.array(
        [
            m["Xu"] * du + m["Zw"] * w * q + m["Zq"] * q**2 - m["Yv"] * v * r - m["Yr"] * r**2,
            m["Yv"] * dv + m["Yr"] * dr + m["Xu"] * u * r - m["Zw"] * w * p - m["Zq"] * p * q,
            m["Zw"] * dw + m["Zq"] * dq - m["Xu"] * u * q + m["Yv"] * v * p + m["Yr"] * r * p,
            m["Kp"] * dp
            - (m["Yv"] - m["Zw"]) * v * w
            - (m["Yr"] + m["Zq"]) * w * r
            + (m["Yr"] + m["Zq"]) * v * q
            - (m["Mq"] - m["Nr"]) * q * r,
            m["Mq"] * dq
            + m["Zq"] * dw
            - (m["Zw"] - m["Xu"]) * u * w
            - m["Yr"] * v * p
            + (m["Kp"] - m["Nr"]) * r * p
            - m["Zq"] * u * q,
            m["Nr"] * dr
            + m["Yr"] * dv
            - (m["Xu"] - m["Yv"]) * u * v
            + m["Yr"] * u * r
            + m["Zq"] * w * p
            - (m["Kp"] - m["Mq"]) * p * q,
        ]
    )


def test_rigid_body_force_equals_component_form():
    rng = np.random.default_rng(1)
    r_G = np.array([-0.3, 0.2, 0.1])
    inertia = np.array([[2.0, -0.3, 0.4], [-0.3, 5.0, 0.1], [0.4, 0.1, 6.0]])
    M = rigid_body_matrix(41.0, r_G, inertia)
    for nu, nu_dot in rng.normal(size=(20, 2, 6)):
        force = M @ nu_dot + coriolis(M, nu) @ nu
        np.testing.assert_allclose(
            force, component_form(41.0, r_G, inertia, nu, nu_dot), rtol=ROUNDING, atol=1e-11
        )


def test_added_mass_force_equals_component_form():
    rng = np.random.default_rng(2)
    m = {
        "Xu": -1.0,
        "Yv": -40.0,
        "Zw": -35.0,
        "Kp": -0.5,
        "Mq": -9.0,
        "Nr": -8.0,
        "Yr": 2.5,
        "Zq": -3.5,
    }
    M_A = np.diag([m["Xu"], m["Yv"], m["Zw"], m["Kp"], m["Mq"], m["Nr"]])
    M_A[1, 5] = M_A[5, 1] = m["Yr"]
    M_A[2, 4] = M_A[4, 2] = m["Zq"]
    for nu, nu_dot in rng.normal(size=(20, 2, 6)):
        force = M_A @ nu_dot + coriolis_force(M_A, nu)
        np.testing.assert_allclose(
            force, added_mass_component_form(m, nu, nu_dot), rtol=ROUNDING, atol=1e-11
        )


def test_munk_moment_turns_the_bow_away_from_the_flow():
    M_A = np.diag([-0.7, -40.0, -40.0, 0.0, -8.0, -8.0])
    moment = coriolis_force(M_A, [2.0, 0.1, 0.0, 0.0, 0.0, 0.0])[5]
    assert moment == pytest.approx(-(40.0 - 0.7) * 2.0 * 0.1)


def test_batches_equal_single_samples():
    rng = np.random.default_rng(3)
    eta, nu = rng.uniform(-1.2, 1.2, size=(2, 3, 4, 6))
    M = rigid_body_matrix(10.0, [0.1, 0.0, 0.2], np.diag([1.0, 2.0, 3.0]))
    for function in (eta_dot, body_velocity):
        assert function(eta, nu).shape == (3, 4, 6)
        np.testing.assert_array_equal(function(eta, nu)[1, 2], function(eta[1, 2], nu[1, 2]))
    assert coriolis(M, nu).shape == (3, 4, 6, 6)
    np.testing.assert_allclose(
        coriolis_force(M, nu)[2, 3], coriolis(M, nu[2, 3]) @ nu[2, 3], rtol=ROUNDING, atol=1e-13
    )


def test_attitude_turns_axes_the_right_way():
    assert rotation_body_to_ned([0.0, 0.0, math.pi / 2]) @ [1.0, 0.0, 0.0] == pytest.approx(
        [0.0, 1.0, 0.0]
    )
    assert rotation_body_to_ned([0.0, math.pi / 2, 0.0]) @ [1.0, 0.0, 0.0] == pytest.approx(
        [0.0, 0.0, -1.0]
    )
    assert rotation_body_to_ned([math.pi / 2, 0.0, 0.0]) @ [0.0, 1.0, 0.0] == pytest.approx(
        [0.0, 0.0, 1.0]
    )


def test_singular_pitch_gives_nan_without_warning():
    matrix = euler_rate_matrix([[0.3, math.pi / 2, 0.0], [0.3, 0.2, 0.0]])
    assert np.isnan(matrix[0, :, 1:]).all()
    assert np.isfinite(matrix[1]).all()
    rate = eta_dot([0, 0, 0, 0.3, math.pi / 2, 0], [1.0, 0, 0, 0, 0.1, 0.2])
    assert np.isfinite(rate[:3]).all()
    assert np.isnan(rate[3:]).all()


def test_skew_is_the_cross_product():
    a, b = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.7, -1.1])
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), rtol=ROUNDING)


def test_sphere_has_half_its_displaced_mass():
    m_f = 4.0 / 3.0 * math.pi * 1000.0 * 0.2**3
    np.testing.assert_allclose(
        np.diag(spheroid_added_mass(0.2, 0.2)), [-m_f / 2] * 3 + [0.0] * 3, rtol=1e-14
    )
    nearly = spheroid_added_mass(0.2 * (1 + 1e-6), 0.2)
    assert nearly[0, 0] == pytest.approx(-m_f / 2, rel=1e-5)
    assert abs(nearly[4, 4]) < 1e-9 * m_f


def test_series_and_closed_form_meet():
    """At the eccentricity where the formula changes the two must agree: step below the
    slope's change over 2e-6 of b.
    """
    b = 0.1
    a = b / math.sqrt(1.0 - 0.1**2)
    below, above = (
        spheroid_added_mass(a * (1 - 1e-9), b, fluid_mass=1.0),
        spheroid_added_mass(a * (1 + 1e-9), b, fluid_mass=1.0),
    )
    np.testing.assert_allclose(below, above, rtol=1e-6)


def test_slender_body_limit():
    added = np.diag(spheroid_added_mass(100.0, 0.1, fluid_mass=1.0))
    assert added[1] == pytest.approx(-1.0, abs=1e-4)
    assert added[0] == pytest.approx(0.0, abs=1e-4)
    assert added[4] == pytest.approx(-(100.0**2) / 5.0, rel=1e-3)


def test_table_b3_in_its_true_reading():
    """Table B.3 = X, Y from the dry mass and the hull's aspect ratio; M, N with
    semi-axes l/2, d/2 (0.004 kg m^2: l and d are rounded).
    """
    length, diameter, dry_mass = 2.057, 0.1753, 41.458
    a, b = equal_volume_semi_axes(length, diameter, dry_mass / 1000.0)
    assert a / b == pytest.approx(length / diameter)
    assert 4.0 / 3.0 * math.pi * 1000.0 * a * b**2 == pytest.approx(dry_mass)
    equal_volume = np.diag(spheroid_added_mass(a, b))
    assert equal_volume[0] == pytest.approx(-0.6673, abs=5e-5)
    assert equal_volume[1] == pytest.approx(-40.1654, abs=5e-4)
    assert equal_volume[4] == pytest.approx(-9.3239, abs=5e-4)
    hull = np.diag(spheroid_added_mass(length / 2, diameter / 2, fluid_mass=dry_mass))
    assert hull[5] == pytest.approx(-8.0212, abs=4e-3)


@pytest.mark.parametrize(("a", "b"), [(0.1, 0.2), (0.1, 0.0), (0.1, -0.1), (math.nan, 0.1)])
def test_spheroid_refuses_what_is_not_prolate(a, b):
    with pytest.raises(PipelineError, match="prolate"):
        spheroid_added_mass(a, b)
