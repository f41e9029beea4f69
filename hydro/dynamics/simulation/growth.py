"""Why a free run is lost: the motion that a model makes grow by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.jacobians import basis_jacobian, coriolis_jacobian
from auvid.hydro.dynamics.steady_motion import Floating
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel

CORIOLIS, RIGHTING = "C", "G"
"""Causes that are no coefficient: Coriolis force of the inertia, and righting moment."""


@dataclass(frozen=True)
class Growth:
    """The fastest growing motion about a state.

    rate [1/s]: of exp(rate t), not above 0 where nothing grows. axis: on which it shows
    most. cause: what adds most to the rate, a viscous coefficient as `K_v`, `C` for the
    Coriolis force (with the moment of Munk) or `G` for the righting moment; adds: how
    much [1/s]. Empty where nothing adds.
    """

    rate: float
    axis: str
    cause: str
    adds: float


def growth(
    vehicle: Vehicle,
    model: IdentifiedModel,
    nu: ArrayLike,
    tilt: ArrayLike | None = None,
    *,
    minimum_speed: float = 0.05,
) -> Growth:
    """Return the fastest growth about any of nu (n, 6) or (6,), at tilts (n, 2) [rad].

    Of M d(delta nu)/dt = (K dxi/dnu - d(C nu)/dnu) delta nu, McCarter (2.60) under
    constant actuators, with the restoring force of d(phi, theta); without tilts it has no
    part. The axis is that of the largest part of its kinetic energy. With eigenvectors x,
    and y of the transpose, the rate is the sum over coefficients k_it of
    Re (y' M^-1)_i k_it (dxi/dnu x)_t / y'x, and of what the other forces add. Terms with
    eta count at eta = 1.
    """
    states = np.atleast_2d(np.asarray(nu, dtype=np.float64))
    angles = np.zeros((len(states), 2)) if tilt is None else np.atleast_2d(tilt)
    floating = Floating(vehicle, model, np.zeros(6))
    matrices = floating.slopes(states, angles, minimum_speed=minimum_speed)
    righting = matrices[:, :6, 6:].copy()
    matrices[:, :6] = vehicle.mass_matrix_inverse @ matrices[:, :6]
    if tilt is None:
        matrices, righting = matrices[:, :6, :6], righting[..., :0]
    at = int(np.argmax(np.linalg.eigvals(matrices).real.max(axis=1)))
    slope = basis_jacobian(states[at], model.terms, ratio=np.ones(()), minimum_speed=minimum_speed)
    turning = -coriolis_jacobian(vehicle.mass_matrix, states[at])
    return _fastest(vehicle, model, matrices[at], slope, turning, righting[at])


def _fastest(
    vehicle: Vehicle,
    model: IdentifiedModel,
    matrix: Array,
    slope: Array,
    turning: Array,
    righting: Array,
) -> Growth:
    """Return the growth of a matrix (k, k) of [nu, ...], and what adds most to it.

    slope (t, 6): of the basis; turning (6, 6), righting (6, k - 6): of other forces.
    """
    values, vectors = np.linalg.eig(matrix)
    fastest = int(np.argmax(values.real))
    x = vectors[:, fastest]
    energy = np.abs(x[:6]) ** 2 * np.diag(vehicle.mass_matrix)
    turned, left = np.linalg.eig(matrix.T)
    y = left[:, int(np.argmin(np.abs(turned - values[fastest])))]
    weights = (y[:6] @ vehicle.mass_matrix_inverse) / (y @ x)
    shares = (weights[:, None] * model.matrix * (slope @ x[:6])).real
    adds = {
        f"{AXES[i]}_{term.replace('*', '')}": float(shares[i, t])
        for t, term in enumerate(model.terms)
        for i in range(6)
    }
    adds[CORIOLIS] = float((weights @ turning @ x[:6]).real)
    adds[RIGHTING] = float((weights @ righting @ x[6:]).real)
    cause = max(adds, key=adds.__getitem__)
    if adds[cause] <= 0.0:
        return Growth(float(values.real[fastest]), AXES[int(np.argmax(energy))], "", 0.0)
    return Growth(float(values.real[fastest]), AXES[int(np.argmax(energy))], cause, adds[cause])
