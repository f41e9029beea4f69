"""The viscous force from flow physics: symmetry, signs, stability, and the derivatives
and speeds that it was sized for.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.propeller import propeller_force
from auvid.hydro.dynamics.simulation.physical_viscous import PhysicalViscous, physical_viscous
from auvid.hydro.dynamics.simulation.simulation import SimulatedVehicle, constant_actuation
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.models import MODELS
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis

ROOT = Path(__file__).parents[5]


def vehicle(name: str = "vt690") -> Vehicle:
    return vehicle_from_document(
        read_yaml((ROOT / f"vehicles/{name}.yaml").read_text(encoding="utf-8"))
    )


VT690 = vehicle()
FORCE = physical_viscous(VT690)


def slope(axis: int, velocity: int, u: float = 2.0) -> float:
    """d force / d velocity over u, by central difference."""
    step = np.zeros(6)
    step[velocity] = 1e-4
    ahead = np.array([u, 0.0, 0.0, 0.0, 0.0, 0.0])
    return float((FORCE.force(ahead + step) - FORCE.force(ahead - step))[axis] / 2e-4 / u)


@pytest.mark.parametrize(
    ("axis", "velocity", "expected"),
    [(1, 1, -50.0), (1, 5, 20.0), (5, 1, 22.0), (5, 5, -27.0)],
    ids=["Y_v", "Y_r", "N_v", "N_r"],
)
def test_effective_derivatives_at_2_m_s(axis: int, velocity: int, expected: float) -> None:
    """Per m/s of u; the twin's vehicle was to have about these, and a fifth of them is
    about.
    """
    assert slope(axis, velocity) == pytest.approx(expected, abs=0.25 * abs(expected))


def test_roll_and_pitch_are_damped() -> None:
    assert slope(3, 3) < 0.0
    assert slope(4, 4) < 0.0


def test_no_motion_no_force() -> None:
    assert np.array_equal(FORCE.force(np.zeros(6)), np.zeros(6))


def test_mirror_image_has_the_mirrored_force() -> None:
    """Without asymmetry and mast the hull is the same seen in a mirror through the x-z
    plane.
    """
    plain = replace(FORCE, asymmetry=np.zeros(6), surfaces=FORCE.surfaces[:4])
    mirror = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    nu = np.random.default_rng(1).normal(size=(50, 6))
    assert np.allclose(plain.force(nu * mirror), plain.force(nu) * mirror, rtol=0.0, atol=1e-12)


def test_motion_through_still_water_loses_energy() -> None:
    """Without the constant asymmetries the power nu . tau is never positive, stalled or
    not, ahead or astern.
    """
    plain = replace(FORCE, asymmetry=np.zeros(6))
    nu = np.random.default_rng(2).normal(size=(4000, 6)) * np.array([1.5, 0.5, 0.5, 1.0, 0.5, 0.5])
    assert np.max(np.einsum("ij,ij->i", nu, plain.force(nu))) < 0.0


def test_terminal_speeds() -> None:
    """Thrust and drag balance between 1.4 and 2.3 m/s at 1800 to 2600 rpm, within 4 %
    of the table of level speeds.
    """
    assert VT690.propeller is not None

    def surplus(u: float, rev_s: float) -> float:
        nu = np.array([u, 0.0, 0.0, 0.0, 0.0, 0.0])
        assert VT690.propeller is not None
        return float(
            FORCE.force(nu)[0]
            + propeller_force(VT690.propeller, nu, rev_s, water_density=1000.0)[0]
        )

    for rpm, speed in ((1800, 1.528), (2133, 1.810), (2350, 1.994), (2600, 2.207)):
        assert brentq(surplus, 0.5, 4.0, args=(rpm / 60.0,)) == pytest.approx(speed, rel=0.04)


def test_open_loop_is_stable_at_every_speed_of_the_campaign() -> None:
    """Eigenvalues of the linearised motion at steady running: none to the right but the
    free directions (x, y, z, psi).
    """
    plant = SimulatedVehicle(VT690, FORCE)
    for rev_s, u in ((30.0, 1.48), (43.3, 2.19)):
        trim = plant.start([0.0, 0.0, 5.0, 0.0, 0.0, 0.0], [u, 0.0, 0.0, 0.0, 0.0, 0.0])
        inputs = constant_actuation(np.full(22, rev_s), np.zeros((22, 4)), knots=1)
        points = np.repeat(trim[None], 22, axis=0)
        for index, state in enumerate((0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11)):
            points[2 * index, state] += 1e-5
            points[2 * index + 1, state] -= 1e-5
        here = replace(
            inputs,
            propeller_rev_s=inputs.propeller_rev_s[:, 0],
            fins_rad=inputs.fins_rad[:, 0],
            force=inputs.force[:, 0],
        )
        rates = plant.derivative(points, here)
        fast = [0, 1, 2, 3, 4, 5, 9, 10]
        columns = {
            state: (rates[2 * i] - rates[2 * i + 1]) / 2e-5
            for i, state in enumerate((0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11))
        }
        matrix = np.array([[columns[to][of] for to in fast] for of in fast])
        assert np.linalg.eigvals(matrix).real.max() < 0.0


def test_it_is_outside_the_span_of_every_model() -> None:
    """Large motions: no model of the eight explains it to better than 0.4 % of its
    size.
    """
    random = np.random.default_rng(3)
    nu = random.normal(size=(4000, 6)) * np.array([0.3, 0.25, 0.15, 0.2, 0.15, 0.35])
    nu[:, 0] += 1.8
    ratio = 2.0 / np.linalg.norm(nu[:, :3], axis=1)
    tau = FORCE.force(nu)
    for model in MODELS:
        factor = TriangularFactor.empty(model.distinct_terms).update(
            basis_rows(nu.T, ratio, model.distinct_terms), tau
        )
        fits = [solve_axis(factor, axis, terms) for axis, terms in model.terms.items() if terms]
        assert np.sqrt(sum(fit.sse for fit in fits) / np.sum(tau**2)) > 0.004, model.name


def test_batch_is_the_same_as_one_at_a_time() -> None:
    nu = np.random.default_rng(4).normal(size=(2, 3, 6))
    assert np.allclose(FORCE.force(nu)[1, 2], FORCE.force(nu[1, 2]), rtol=0.0, atol=1e-13)
    assert isinstance(FORCE, PhysicalViscous)


def test_a_vehicle_without_fins_is_refused() -> None:
    with pytest.raises(CampaignError, match="torpedo with fins"):
        physical_viscous(vehicle("bluerov2_heavy"))
