"""The simplified model (18)-(26) of Alberti 2015: signs against the defining equations,
and against the full equations of motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.simplified import (
    SimplifiedModel,
    acceleration,
    coriolis_terms,
    damping_force,
    restoring_terms,
    simplified_of,
    state_rate,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from tests.support.dynamics_oracles import propulsion

THAUS = vehicle_from_document(
    read_yaml((SHIPPED_VEHICLES / "thaus.yaml").read_text(encoding="utf-8"))
)
LINEAR = np.array([-20.0, -30.0, -85.9259, -1.0, -2.0, -0.5])
QUADRATIC = np.array([-132.2436, -357.8624, -40.0, -3.0, -4.0, -5.8274])


def low_vehicle():
    """THAUS with the origin above its centre of gravity and all inertias added, so that
    every term of (26) counts.
    """
    added = np.diag([-91.7507, -205.0403, -194.9859, -0.7, -1.9, -2.4765])
    return replace(
        THAUS, r_G=np.array([0.0, 0.0, 0.03]), r_B=np.array([0.0, 0.0, -0.01]), added_mass=added
    )


def motions(n=200):
    random = np.random.default_rng(5)
    eta = random.uniform(-1.0, 1.0, (n, 6))
    return eta, random.normal(size=(n, 6)), random.normal(size=(n, 6))


def test_with_z_g_terms_it_is_the_full_equation_of_motion():
    """X_prop of (26) is the force that equations_of_motion needs beyond the viscous
    one, to rounding (forces of some 1000 N).
    """
    vehicle = low_vehicle()
    model = simplified_of(vehicle, linear=LINEAR, quadratic=QUADRATIC, keep_z_G=True)
    eta, nu, nu_dot = motions()
    still = Control(thruster_pwm_us=np.full((len(eta), 5), 1500.0))
    full = residual_force(vehicle, eta, nu, nu_dot, still).tau_bar - damping_force(model, nu)
    np.testing.assert_allclose(propulsion(model, eta, nu, nu_dot), full, atol=1e-9)


def test_the_dropped_terms_are_those_of_the_text():
    model = simplified_of(low_vehicle(), linear=LINEAR, quadratic=QUADRATIC)
    kept = replace(model, keep_z_G=True)
    eta, nu, nu_dot = motions()
    (u, v, w, p, q, r), (u_dot, v_dot, _, p_dot, q_dot, _) = nu.T, nu_dot.T
    low = model.mass * model.z_G
    terms = [
        q_dot + p * r,
        q * r - p_dot,
        -(p**2 + q**2),
        -(v_dot - w * p + u * r),
        u_dot - v * r + w * q,
        0.0 * r,
    ]
    more = propulsion(kept, eta, nu, nu_dot) - propulsion(model, eta, nu, nu_dot)
    np.testing.assert_allclose(more, low * np.stack(terms, axis=-1), atol=1e-9)


@pytest.mark.parametrize("keep", [False, True])
def test_products_of_velocities_do_no_work(keep):
    """nu' C(nu) nu = 0: with K, M and N of (26) as printed (errata A12) it is not."""
    model = simplified_of(low_vehicle(), linear=LINEAR, quadratic=QUADRATIC, keep_z_G=keep)
    _, nu, _ = motions()
    np.testing.assert_allclose(np.sum(nu * coriolis_terms(model, nu), axis=-1), 0.0, atol=1e-9)
    _, _, _, p, q, r = nu.T
    i_x, i_y, i_z = model.inertia
    k, m, n = model.added_mass[3:]
    printed = (
        p * (i_z - i_y + n + m) * q * r
        + q * (i_y - i_x + n - k) * r * p
        + r * (i_y - i_x + k - m) * r * p
    )
    assert np.abs(printed).max() > 0.1


@pytest.mark.parametrize("keep", [False, True])
def test_acceleration_undoes_propulsion(keep):
    model = simplified_of(low_vehicle(), linear=LINEAR, quadratic=QUADRATIC, keep_z_G=keep)
    eta, nu, nu_dot = motions()
    np.testing.assert_allclose(
        acceleration(model, eta, nu, propulsion(model, eta, nu, nu_dot)),
        nu_dot,
        rtol=1e-9,
        atol=1e-9,
    )


def test_damping_takes_energy_and_the_vehicle_rights_itself():
    """With z_G below z_B a heel is righted; F_BK as printed (errata A8) would overturn."""
    model = simplified_of(THAUS, linear=LINEAR, quadratic=QUADRATIC)
    _, nu, _ = motions()
    assert np.all(np.sum(nu * damping_force(model, nu), axis=-1) < 0.0)
    for index in (3, 4):
        eta = np.zeros(6)
        eta[index] = 0.1
        assert acceleration(model, eta, np.zeros(6), np.zeros(6))[index] < 0.0
        assert restoring_terms(model, eta)[index] == pytest.approx(
            38.10 * 9.80665 * 0.02 * np.sin(0.1)
        )


def test_single_channel_is_the_equation_of_the_text():
    """(61): u_dot = (X_u u + X_u|u| u|u| + X_prop) / (m - X_udot)."""
    model = simplified_of(THAUS, linear=LINEAR, quadratic=QUADRATIC)
    state = np.zeros(12)
    state[0] = -0.4
    rate = state_rate(model, state, np.array([10.0, 0, 0, 0, 0, 0]))
    assert rate[0] == pytest.approx((20.0 * 0.4 + 132.2436 * 0.16 + 10.0) / (38.10 + 91.7507))
    assert rate[6] == pytest.approx(-0.4)
    np.testing.assert_array_equal(np.delete(rate, [0, 6]), 0.0)


def test_pitch_answers_to_surge_and_heave():
    """(64) corrected: q_dot takes -(Z_wdot - X_udot) u w and -F_BM (errata A13)."""
    model = simplified_of(THAUS, linear=LINEAR, quadratic=QUADRATIC)
    nu = np.array([0.5, 0.0, 0.2, 0.0, 0.0, 0.0])
    eta = np.array([0.0, 0.0, 0.0, 0.0, 0.05, 0.0])
    lever = 38.10 * 9.80665 * 0.02 * np.sin(0.05)
    expected = (-(-194.9859 + 91.7507) * 0.5 * 0.2 - lever) / 2.2278
    assert acceleration(model, eta, nu, np.zeros(6))[4] == pytest.approx(expected)


def test_a_vehicle_outside_of_the_assumptions_is_refused():
    for changed in (
        {"r_G": np.array([0.1, 0.0, 0.0])},
        {"added_mass": THAUS.added_mass + np.eye(6, k=4) + np.eye(6, k=-4)},
    ):
        with pytest.raises(CampaignError, match="simplified model does not hold"):
            simplified_of(replace(THAUS, **changed), linear=LINEAR, quadratic=QUADRATIC)


def test_numbers_are_read_only():
    model = simplified_of(THAUS, linear=LINEAR, quadratic=QUADRATIC)
    assert isinstance(model, SimplifiedModel)
    with pytest.raises(ValueError, match="read-only"):
        model.mass_matrix[0, 0] = 1.0
