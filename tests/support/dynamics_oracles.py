"""Second forms of equations, which tests hold the product to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, matrix_product
from auvid.hydro.control.observer import C_Z, augmented
from auvid.hydro.dynamics.actuators.propeller import Propeller
from auvid.hydro.dynamics.equations_of_motion import Control, inertia_force, residual_force
from auvid.hydro.dynamics.mechanics.kinematics import (
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
    skew,
)
from auvid.hydro.dynamics.simplified import (
    SimplifiedModel,
    coriolis_terms,
    damping_force,
    restoring_terms,
)
from auvid.hydro.dynamics.simulation.runge_kutta import runge_kutta_4
from auvid.hydro.dynamics.simulation.simulation import Actuation, SimulatedVehicle
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import Coefficients, IdentifiedModel


def coriolis(M: ArrayLike, nu: ArrayLike) -> Array:
    """Return C(nu) (..., 6, 6) of (2.23) as a matrix, M (6, 6) symmetric."""
    momentum = matrix_product(M, nu)
    matrix = np.zeros((*momentum.shape[:-1], 6, 6))
    matrix[..., :3, 3:] = matrix[..., 3:, :3] = -skew(momentum[..., :3])
    matrix[..., 3:, 3:] = -skew(momentum[..., 3:])
    return matrix


def body_velocity(eta: ArrayLike, pose_derivative: ArrayLike) -> Array:
    """Return nu from the pose's derivative (2.15), the inverse of `eta_dot`."""
    attitude = np.asarray(eta, dtype=np.float64)[..., 3:]
    turned = np.asarray(pose_derivative, dtype=np.float64)
    to_body = np.swapaxes(rotation_body_to_ned(attitude), -1, -2)
    upper = matrix_product(to_body, turned[..., :3])
    lower = matrix_product(euler_rate_matrix_inverse(attitude), turned[..., 3:])
    return np.concatenate([upper, lower], axis=-1)


def equal_volume_semi_axes(length: float, diameter: float, volume: float) -> tuple[float, float]:
    """Return semi-axes (a, b) [m] of the spheroid of a hull's aspect ratio and volume."""
    ratio = length / diameter
    b = float((3.0 * volume / (4.0 * np.pi * ratio)) ** (1.0 / 3.0))
    return ratio * b, b


def advance_ratio(propeller: Propeller, u: ArrayLike, propeller_rev_s: ArrayLike) -> Array:
    """Return J = V_A / (n D) (2.53); nan where n = 0."""
    n = np.asarray(propeller_rev_s, dtype=np.float64)
    advance = np.asarray(u, dtype=np.float64) * propeller.inflow_per_u
    return np.asarray(advance / np.where(n == 0.0, np.nan, n))


def inverse_dynamics(
    vehicle: Vehicle, eta: ArrayLike, nu: ArrayLike, nu_dot: ArrayLike, control: Control
) -> Array:
    """Return tau_bar (..., 6) of (4.4), the inverse of `forward_dynamics`."""
    return residual_force(vehicle, eta, nu, nu_dot, control).tau_bar


def model_force(
    model_terms: Mapping[str, tuple[str, ...]],
    coefficients: Coefficients,
    nu: ArrayLike,
    eta_ratio: ArrayLike | None = None,
) -> Array:
    """Return tau_nu = K xi(nu) (3.12); only coefficients of `model_terms` count."""
    chosen = {
        axis: {term: coefficients.get(axis, {}).get(term, 0.0) for term in terms}
        for axis, terms in model_terms.items()
    }
    return IdentifiedModel("chosen", chosen).force(nu, eta_ratio)


def propulsion(model: SimplifiedModel, eta: ArrayLike, nu: ArrayLike, nu_dot: ArrayLike) -> Array:
    """Return X_prop ... N_prop of Alberti (26) that a motion needs, (..., 6)."""
    return np.asarray(
        inertia_force(model.mass_matrix, nu_dot)
        + coriolis_terms(model, nu)
        - damping_force(model, nu)
        + restoring_terms(model, eta)
    )


def observer_eigenvalues(A: ArrayLike, L: ArrayLike) -> Array:
    """Return eigenvalues (t, 18) of A_Z - L C_Z, Al Makdah (5.6)."""
    a = np.asarray(A, dtype=np.float64)
    a_z, _ = augmented(a, np.zeros((*a.shape[:-1], 1)))
    return np.asarray(np.linalg.eigvals(a_z - np.asarray(L) @ C_Z))


def integrate_numpy(
    simulated: SimulatedVehicle,
    start: Array,
    actuation: Actuation,
    *,
    step_s: float,
    steps_per_knot: int,
) -> Array:
    """Return the states of `integrate_open_loop` by the array functions."""
    knots = Actuation(
        *(np.moveaxis(values, start.ndim - 1, 0) for values in vars(actuation).values())
    )
    rows = [start]
    for step in range((len(knots.propeller_rev_s) - 1) * steps_per_knot):

        def derivative(x: Array, share: float, step: int = step) -> Array:
            here = knots.between(np.array([(step + share) / steps_per_knot]))
            return simulated.derivative(x, Actuation(*(item[0] for item in vars(here).values())))

        rows.append(runge_kutta_4(derivative, rows[-1], step_s))
    return np.stack(rows, axis=-2)
