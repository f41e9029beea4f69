"""The H-AUV: its equations written out, equilibria, current and force field, batches,
and the buoyancy engine.
"""

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.hybrid_vehicle import (
    PARAMETER_SETS,
    chi_dot,
    hybrid_vehicle,
    nu_dot,
    parameter_coefficients,
)
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import basis

ROOT = Path(__file__).parents[4]
DOCUMENT = read_yaml((ROOT / "vehicles/hauv.yaml").read_text())
HAUV = vehicle_from_document(DOCUMENT)
SIMULATED = hybrid_vehicle(HAUV, "as_simulated")


def states(seed, n):
    random = np.random.default_rng(seed)
    chi = random.normal(size=(n, 12)) * [1.5, 0.3, 0.3, 0.2, 0.2, 0.2, 5.0, 5.0, 5.0, 0.4, 0.4, 2.0]
    U = np.column_stack([random.uniform(0.0, 272.0, n), random.uniform(-0.3, 0.3, (n, 3))])
    return chi, U, random.uniform(71.5, 73.5, n)


def written_out(hybrid, chi, U, mass, rate):
    """Left minus right side of (2.59)-(2.64), errata applied, term by term: (n, 6)."""
    u, v, w, p, q, r = chi[:, :6].T
    phi, theta = chi[:, 9], chi[:, 10]
    ud, vd, wd, pd, qd, rd = rate.T
    coefficients = {}
    for item in parameter_coefficients(HAUV, hybrid.parameter_set):
        key = (
            item.name
            if item.kind in ("added_mass", "drag", "control")
            else f"{item.name}:{item.kind}"
        )
        coefficients[key] = coefficients.get(key, 0.0) + item.value
    g = coefficients.__getitem__
    Xu, Yv, Zw, Kp, Mq, Nr, Yr, Zq = (
        g(f"{n}dot") for n in ("X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r", "Y_r", "Z_q")
    )
    thrust, dr, ds_right, ds_left = U.T
    xG, zG = 0.02 * (mass - 72.5), 0.05
    W, B = mass * 9.81, 72.5 * 9.81
    Ix, Iy, Iz = 1.08, 20.75, 21.32
    s, c = np.sin, np.cos
    fin = 1025.0 * 4.188187 * 0.0257
    wing = 1025.0 * 4.832218 * 0.1275
    xf, xw, y = -0.76, -0.075, g("K_uudeltas") / -fin
    rudder = fin * (u * u * dr - u * v - xf * u * r)
    right, left = (-0.5 * fin * (u * u * d + u * w - xf * u * q) for d in (ds_right, ds_left))
    wings = -wing * (u * w - xw * u * q)
    X = (
        -(W - B) * s(theta)
        + Xu * ud
        + Zw * w * q
        + Zq * q * q
        - Yv * v * r
        - Yr * r * r
        + g("X_u|u|") * u * abs(u)
        + thrust
    )
    Y = (
        (W - B) * c(theta) * s(phi)
        + Yv * vd
        + Yr * rd
        + Xu * u * r
        - Zw * w * p
        - Zq * p * q
        + rudder
    )
    Y += g("Y_v|v|") * v * abs(v) + g("Y_r|r|") * r * abs(r) + g("Y_uv:body_lift") * u * v
    Z = (
        (W - B) * c(theta) * c(phi)
        + Zw * wd
        + Zq * qd
        - Xu * u * q
        + Yv * v * p
        + Yr * r * p
        + right
        + left
        + wings
    )
    Z += g("Z_w|w|") * w * abs(w) + g("Z_q|q|") * q * abs(q) + g("Z_uw:body_lift") * u * w
    K = (
        -zG * W * c(theta) * s(phi)
        + Kp * pd
        - (Yv - Zw) * v * w
        - (Yr + Zq) * w * r
        + (Yr + Zq) * v * q
        - (Mq - Nr) * q * r
    )
    K += g("K_p|p|") * p * abs(p) + y * (right - left)
    M = (
        -xG * W * c(theta) * c(phi)
        - zG * W * s(theta)
        + Mq * qd
        + Zq * wd
        - (Zw - Xu) * u * w
        - Yr * v * p
        + (Kp - Nr) * r * p
        - Zq * u * q
    )
    M += (
        g("M_q|q|") * q * abs(q)
        + g("M_w|w|") * w * abs(w)
        + g("M_uw:body_lift") * u * w
        - xf * (right + left)
        - xw * wings
    )
    N = (
        xG * W * c(theta) * s(phi)
        + Nr * rd
        + Yr * vd
        - (Xu - Yv) * u * v
        + Yr * u * r
        + Zq * w * p
        - (Kp - Mq) * p * q
    )
    N += (
        g("N_r|r|") * r * abs(r)
        + g("N_v|v|") * v * abs(v)
        + g("N_uv:body_lift") * u * v
        + xf * rudder
    )
    left_side = [
        mass * (ud - v * r + w * q - xG * (q * q + r * r) + zG * (p * r + qd)),
        mass * (vd - w * p + u * r + zG * (q * r - pd) + xG * (q * p + rd)),
        mass * (wd - u * q + v * p - zG * (p * p + q * q) + xG * (r * p - qd)),
        Ix * pd + (Iz - Iy) * q * r - mass * zG * (vd - w * p + u * r),
        Iy * qd
        + (Ix - Iz) * r * p
        + mass * (zG * (ud - v * r + w * q) - xG * (wd - u * q + v * p)),
        Iz * rd + (Iy - Ix) * p * q + mass * xG * (vd - w * p + u * r),
    ]
    return np.column_stack(left_side) - np.column_stack([X, Y, Z, K, M, N])


@pytest.mark.parametrize("parameter_set", PARAMETER_SETS)
def test_the_common_equations_are_those_of_the_thesis_written_out(parameter_set):
    hybrid = hybrid_vehicle(HAUV, parameter_set)
    chi, U, mass = states(3, 50)
    rate = nu_dot(hybrid, chi, U, mass_kg=mass)
    residual = written_out(hybrid, chi, U, mass, rate)
    assert (
        np.abs(residual).max() < 2e-3
    )  # N and N m of some 1000: the lift slopes above have seven digits


def equilibrium(mass, thrust, guess):
    def rest(x):
        chi = np.zeros(12)
        chi[0], chi[2], chi[10] = x
        return nu_dot(SIMULATED, chi, np.array([thrust, 0.0, 0.0, 0.0]), mass_kg=mass)[[0, 2, 4]]

    return fsolve(rest, guess, xtol=1e-13)


def test_glide_and_thrust_equilibria_of_the_simulations():
    assert equilibrium(73.5, 0.0, [0.2, 0.04, -0.28]) == pytest.approx(
        [0.2004, 0.0404, -0.2808], abs=1e-4
    )
    assert equilibrium(71.5, 0.0, [0.2, -0.04, 0.28]) == pytest.approx(
        [0.2, -0.0402, 0.2796], abs=2e-3
    )
    assert equilibrium(72.5, 150.0, [1.5, 0.0, 0.0]) == pytest.approx([1.5, 0.0, 0.0], abs=0.012)


def test_every_member_of_a_batch_is_what_it_is_alone():
    chi, U, mass = states(5, 4)
    push, current = np.array([1.0, 225.0, -3.0]), np.array([0.1, -0.2, 0.05])
    together = chi_dot(SIMULATED, chi, U, mass_kg=mass, force_ned_N=push, current_ned_m_s=current)
    for i in range(4):
        single = chi_dot(
            SIMULATED, chi[i], U[i], mass_kg=mass[i], force_ned_N=push, current_ned_m_s=current
        )
        np.testing.assert_allclose(together[i], single, rtol=1e-10, atol=1e-12)
    assert chi_dot(
        SIMULATED, chi.reshape(2, 2, 12), U.reshape(2, 2, 4), mass_kg=mass.reshape(2, 2)
    ).shape == (2, 2, 12)


def test_parameters_may_differ_from_member_to_member():
    chi, U, _ = states(6, 3)
    scale = np.array([1.0, 1.1, 0.9])[:, None, None]
    varied = replace(
        SIMULATED, viscous=scale * SIMULATED.viscous, added_mass=scale * SIMULATED.added_mass
    )
    together = nu_dot(varied, chi, U)
    np.testing.assert_allclose(together[0], nu_dot(SIMULATED, chi[0], U[0]), rtol=1e-10)
    single = replace(
        SIMULATED, viscous=1.1 * SIMULATED.viscous, added_mass=1.1 * SIMULATED.added_mass
    )
    np.testing.assert_allclose(together[1], nu_dot(single, chi[1], U[1]), rtol=1e-10)


def test_a_steady_current_carries_the_vehicle_and_changes_nothing_else():
    """Galileo: in a steady current the motion through the water is that in still water."""
    chi, U, mass = states(7, 20)
    current = np.array([0.3, -0.2, 0.1])
    still = nu_dot(SIMULATED, chi, U, mass_kg=mass)
    rotation = rotation_body_to_ned(chi[:, 9:])
    drift = np.einsum("nji,j->ni", rotation, current)
    over_ground = chi.copy()
    over_ground[:, :3] += drift
    moved = nu_dot(SIMULATED, over_ground, U, mass_kg=mass, current_ned_m_s=current)
    turning = -np.cross(chi[:, 3:6], drift)
    np.testing.assert_allclose(moved[:, :3] - turning, still[:, :3], atol=1e-10)
    np.testing.assert_allclose(moved[:, 3:], still[:, 3:], atol=1e-10)


def test_port_and_starboard_are_alike():
    """The motion seen in a mirror is a motion: v, p, r, y, phi, psi and the rudder
    change sign, the stern fins change places.
    """
    chi, U, mass = states(8, 30)
    flip = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    mirrored = nu_dot(
        SIMULATED, chi * np.tile(flip, 2), U[:, [0, 1, 3, 2]] * [1.0, -1.0, 1.0, 1.0], mass_kg=mass
    )
    np.testing.assert_allclose(
        mirrored, flip * nu_dot(SIMULATED, chi, U, mass_kg=mass), rtol=1e-9, atol=1e-10
    )


def test_drag_and_lift_of_the_corrected_set_take_energy_out():
    """Moving along or about one axis at a time, the viscous force of the corrected set
    opposes the motion.
    """
    hybrid = hybrid_vehicle(HAUV, "corrected")
    for axis in range(6):
        for speed in (-0.7, 0.7):
            nu = np.zeros(6)
            nu[axis] = speed
            assert nu @ hybrid.viscous @ basis(nu, None, hybrid.terms) < 0.0


def test_the_force_field_acts_at_the_centre_of_gravity():
    chi, U, mass = np.zeros(12), np.zeros(4), 73.5
    M = SIMULATED.mass_matrix(mass, 0.02)
    extra = M @ (
        nu_dot(SIMULATED, chi, U, mass_kg=mass, force_ned_N=[0.0, 225.0, 0.0])
        - nu_dot(SIMULATED, chi, U, mass_kg=mass)
    )
    np.testing.assert_allclose(
        extra, [0.0, 225.0, 0.0, -0.05 * 225.0, 0.0, 0.02 * 225.0], atol=1e-9
    )


def test_the_propeller_rolls_the_vehicle_only_while_it_pushes():
    document = copy.deepcopy(DOCUMENT)
    document["propulsion"]["roll_moment"]["value"] = 2.0
    turning = hybrid_vehicle(vehicle_from_document(document))
    M = turning.mass_matrix(72.5, 0.0)
    for thrust, moment in ((150.0, 2.0), (0.0, 0.0)):
        U = np.array([thrust, 0.0, 0.0, 0.0])
        extra = M @ (nu_dot(turning, np.zeros(12), U) - nu_dot(SIMULATED, np.zeros(12), U))
        np.testing.assert_allclose(extra, [0.0, 0.0, 0.0, moment, 0.0, 0.0], atol=1e-12)


def test_the_engine_moves_mass_and_centre_of_gravity_together():
    engine = SIMULATED.engine
    np.testing.assert_allclose(engine.x_G([71.5, 72.5, 73.5]), [-0.02, 0.0, 0.02], atol=1e-12)
    glide = engine.glide_mass([-0.3, 0.0, 0.3], epsilon_rad=0.02)
    np.testing.assert_allclose(glide, [73.5, 72.5, 71.5], atol=1e-9)
    assert engine.check(72.0) == 72.0
    with pytest.raises(CampaignError, match=r"71.5 .empty. to 73.5 kg"):
        engine.check([72.0, 74.0], field="open_loop.dive.mass")
    with pytest.raises(CampaignError, match="positive angle"):
        engine.glide_mass(0.1, epsilon_rad=0.0)


def test_an_identified_model_takes_the_place_of_strip_theory():
    linear = SIMULATED.with_viscous({"X": {"u": -50.0}}, name="identified")
    chi = np.zeros(12)
    chi[0] = 1.0
    force = linear.mass_matrix(72.5, 0.0) @ nu_dot(linear, chi, np.zeros(4))
    assert force[0] == pytest.approx(-50.0)


def test_documents_that_cannot_be_are_refused():
    with pytest.raises(CampaignError, match=r"unknown parameter set.*corrected"):
        hybrid_vehicle(HAUV, "correct")
    for key, message in (
        ("buoyancy_engine", "needs buoyancy_engine"),
        ("propulsion", "needs propulsion"),
    ):
        broken = copy.deepcopy(DOCUMENT)
        del broken[key]
        with pytest.raises(CampaignError, match=message):
            hybrid_vehicle(vehicle_from_document(broken))
    heavy = copy.deepcopy(DOCUMENT)
    heavy["rigid_body"]["mass"]["value"] = 80.0
    with pytest.raises(CampaignError, match=r"rigid_body.mass.*71.5 .empty. to 73.5 kg"):
        hybrid_vehicle(vehicle_from_document(heavy))
    swapped = copy.deepcopy(DOCUMENT)
    swapped["buoyancy_engine"]["mass_full"]["value"] = 70.0
    with pytest.raises(CampaignError, match="do not ascend"):
        vehicle_from_document(swapped)
