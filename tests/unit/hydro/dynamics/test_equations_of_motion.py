"""Equations of motion: conservation laws, forward against inverse, and the published
terminal speeds.
"""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.equations_of_motion import (
    Control,
    actuator_force,
    forward_dynamics,
    residual_force,
    state_derivative,
)
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from tests.support.dynamics_oracles import coriolis, inverse_dynamics

ROOT = Path(__file__).parents[4]
VT690 = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text()))
BLUEROV2 = vehicle_from_document(read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text()))
IDLE = replace(VT690, propeller=None, fins=None)
"""The VT 690 without actuators: in still water without drag nothing takes energy out."""

STATE = np.array([1.5, 0.1, -0.05, 0.1, 0.05, -0.08, 0.0, 0.0, 5.0, 0.2, -0.1, 0.4])


def published(name):
    coefficients = {}
    with (ROOT / f"vehicles/vt690/coefficients/{name}.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            coefficients.setdefault(row["axis"], {})[row["term"]] = float(row["value"])
    return IdentifiedModel(name, coefficients)


def drift(vehicle, state, seconds):
    """States along a motion without drag and actuators."""
    solution = solve_ivp(
        lambda t, x: state_derivative(vehicle, x, Control(), np.zeros_like),
        (0.0, seconds),
        state,
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    )
    assert solution.success
    return solution.y.T


def energy(vehicle, states):
    """Kinetic energy of body and water plus the potential of weight and buoyancy [J]."""
    kinetic = 0.5 * np.einsum("ni,ij,nj->n", states[:, :6], vehicle.mass_matrix, states[:, :6])
    turn = rotation_body_to_ned(states[:, 9:])
    depth_G, depth_B = (
        states[:, 8] + (turn @ vehicle.r_G)[:, 2],
        states[:, 8] + (turn @ vehicle.r_B)[:, 2],
    )
    return kinetic - vehicle.weight * depth_G + vehicle.buoyancy * depth_B


@pytest.mark.parametrize(
    "vehicle", [IDLE, replace(BLUEROV2, thrusters=None)], ids=lambda vehicle: vehicle.name
)
def test_energy_is_conserved_without_drag(vehicle):
    total = energy(vehicle, drift(vehicle, STATE, 10.0))
    assert (
        np.ptp(total) < 1e-8 * 0.5 * STATE[0] ** 2 * vehicle.mass_kg
    )  # J, against the kinetic energy; integrator tolerance 1e-12


def test_momentum_is_conserved_where_no_force_acts():
    """Kirchhoff: with W = B and r_G = r_B the momentum of body and water keeps its
    components in NED.
    """
    neutral = replace(IDLE, displaced_mass_kg=IDLE.mass_kg, r_B=IDLE.r_G)
    states = drift(neutral, STATE, 10.0)
    momentum = np.einsum(
        "nij,nj->ni",
        rotation_body_to_ned(states[:, 9:]),
        (states[:, :6] @ neutral.mass_matrix)[:, :3],
    )
    np.testing.assert_allclose(
        momentum, np.broadcast_to(momentum[0], momentum.shape), rtol=0.0, atol=1e-8
    )  # kg m/s


def test_inverse_of_forward_dynamics():
    rng = np.random.default_rng(5)
    eta, nu, force = rng.uniform(-1.0, 1.0, size=(3, 4, 5, 6))
    control = Control(
        propeller_rev_s=rng.uniform(20, 45, (4, 5)), fins_rad=rng.uniform(-0.3, 0.3, (4, 5, 4))
    )
    nu_dot = forward_dynamics(VT690, eta, nu, control, force)
    assert nu_dot.shape == (4, 5, 6)
    np.testing.assert_allclose(
        inverse_dynamics(VT690, eta, nu, nu_dot, control), force, rtol=0.0, atol=1e-12
    )  # N, N m; forces up to 100


def test_residual_is_equation_4_4():
    rng = np.random.default_rng(6)
    eta, nu, nu_dot = rng.uniform(-1.0, 1.0, size=(3, 6))
    control = Control(propeller_rev_s=35.0, fins_rad=np.array([0.1, -0.1, 0.05, 0.0]))
    parts = residual_force(VT690, eta, nu, nu_dot, control)
    M = VT690.rigid_body_mass - VT690.added_mass
    C = coriolis(VT690.rigid_body_mass, nu) - coriolis(VT690.added_mass, nu)
    expected = M @ nu_dot + C @ nu - parts.restoring - parts.fins - parts.propeller
    np.testing.assert_allclose(parts.tau_bar, expected, rtol=1e-12, atol=1e-12)
    assert list(parts.components()) == [
        "rigid_body_inertia",
        "added_mass_inertia",
        "rigid_body_coriolis",
        "added_mass_coriolis",
        "restoring",
        "fins",
        "propeller",
        "tau_bar",
    ]


def test_filtered_thruster_forces_may_replace_pulses():
    pulses = np.array([[1600.0] * 8, [1450.0] * 8])
    by_pulse = actuator_force(
        BLUEROV2,
        np.zeros((2, 6)),
        Control(thruster_pwm_us=pulses, voltage_v=np.array([15.0, 16.0])),
    )
    forces = thruster_forces(BLUEROV2.thrusters, pulses, np.array([15.0, 16.0]))
    by_force = actuator_force(BLUEROV2, np.zeros((2, 6)), Control(thruster_force_N=forces))
    assert list(by_pulse) == ["thrusters"]
    np.testing.assert_array_equal(by_pulse["thrusters"], by_force["thrusters"])


@pytest.mark.parametrize(
    ("vehicle", "control", "what"),
    [
        (VT690, Control(propeller_rev_s=30.0), "fin deflections"),
        (VT690, Control(fins_rad=np.zeros(4)), "propeller speed"),
        (BLUEROV2, Control(), "thruster pulses"),
    ],
)
def test_missing_commands_are_named(vehicle, control, what):
    with pytest.raises(DataError, match=what):
        actuator_force(vehicle, np.zeros(6), control)


@pytest.mark.parametrize(
    ("model", "speeds"),
    [
        ("mcfarland", (1.528, 1.810, 1.994, 2.207)),
        ("linear", (1.070, 1.491, 1.795, 2.171)),
        ("fossen", (1.236, 1.629, 1.897, 2.214)),
    ],
)
def test_level_terminal_speeds(model, speeds):
    """Thrust against the published surge drag at 1800, 2133, 2350, 2600 rpm; 1e-3 m/s
    is the last digit quoted.
    """
    viscous = published(model)

    def surge(u, n):
        nu = np.array([u, 0, 0, 0, 0, 0])
        thrust = actuator_force(VT690, nu, Control(propeller_rev_s=n, fins_rad=np.zeros(4)))[
            "propeller"
        ][0]
        return thrust + viscous.force(nu)[0]

    terminal = [brentq(surge, 0.3, 4.0, args=(rpm / 60.0,)) for rpm in (1800, 2133, 2350, 2600)]
    assert terminal == pytest.approx(speeds, abs=1e-3)


def test_level_speed_table_is_the_balance_of_the_mcfarland_model():
    """McFarland's level drag is -4.797 u^2 alone, so u_c is proportional to n: one root
    gives the whole table (rounded to 1e-4).
    """
    table = VT690.propeller
    a = 1000.0 * 0.12**4 * np.array([-0.1378 * (0.7 / 0.12) ** 2, 0.0483 * 0.7 / 0.12, 0.0578]) + [
        -4.797,
        0.0,
        0.0,
    ]
    slope = float(max(np.roots(a)))
    np.testing.assert_allclose(table.level_speed_m_s, slope * table.level_speed_rev_s, atol=1e-4)


def test_open_water_efficiency_is_plausible():
    """0.48 to 0.59 at the operating points: K_Q, K_T and rev/s are read rightly."""
    for u, n in ((1.528, 30.0), (2.171, 43.33), (1.236, 30.0)):
        tau = actuator_force(
            VT690, [u, 0, 0, 0, 0, 0], Control(propeller_rev_s=n, fins_rad=np.zeros(4))
        )["propeller"]
        efficiency = 0.7 * u * tau[0] / (2.0 * math.pi * n * tau[3])
        assert 0.45 < efficiency < 0.62


def test_roll_moves_back_and_the_vehicle_rises_slowly():
    """Forward in time: a rolled VT 690 rolls back, and 2.39 N of net buoyancy lift it."""
    nu_dot = forward_dynamics(
        VT690,
        [0, 0, 5, 0.3, 0, 0],
        np.zeros(6),
        Control(propeller_rev_s=0.0, fins_rad=np.zeros(4)),
        np.zeros(6),
    )
    assert nu_dot[3] < 0.0
    level = forward_dynamics(
        VT690,
        [0, 0, 5, 0, 0, 0],
        np.zeros(6),
        Control(propeller_rev_s=0.0, fins_rad=np.zeros(4)),
        np.zeros(6),
    )
    assert level[2] == pytest.approx(-2.393 / (41.458 + 40.165), rel=0.05)
