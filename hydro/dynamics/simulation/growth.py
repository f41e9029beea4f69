"""Why a free run is lost: the motion that a model makes grow by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.jacobians import basis_jacobian, coriolis_jacobian
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel


@dataclass(frozen=True)
class Growth:
    """The fastest growing motion about a state.

    rate [1/s]: of exp(rate t), not above 0 where nothing grows. axis: on which it shows
    most. cause: the viscous coefficient that adds most to the rate, as `K_v`, and what
    it adds [1/s]; empty where none adds.
    """

    rate: float
    axis: str
    cause: str
    adds: float


def growth(vehicle: Vehicle, model: IdentifiedModel, nu: ArrayLike) -> Growth:
    """Return the fastest growth of velocities about nu (6,) [m/s, rad/s].

    Of d(delta nu)/dt = M^-1 (K dxi/dnu - d(C nu)/dnu) delta nu, McCarter (2.60) without
    restoring force and actuators. The axis is that of the largest part of its kinetic
    energy. With eigenvectors x, and y of the transpose, the rate is the sum over
    coefficients k_it of Re (y' M^-1)_i k_it (dxi/dnu x)_t / y'x, and of what the
    Coriolis force adds. Terms with eta count at eta = 1.
    """
    state = np.asarray(nu, dtype=np.float64)
    slope = basis_jacobian(state, model.terms, ratio=np.ones(()))
    inverse = vehicle.mass_matrix_inverse
    matrix = inverse @ (model.matrix @ slope - coriolis_jacobian(vehicle.mass_matrix, state))
    values, vectors = np.linalg.eig(matrix)
    fastest = int(np.argmax(values.real))
    x = vectors[:, fastest]
    energy = np.abs(x) ** 2 * np.diag(vehicle.mass_matrix)
    turned, left = np.linalg.eig(matrix.T)
    y = left[:, int(np.argmin(np.abs(turned - values[fastest])))]
    shares = (((y @ inverse)[:, None] * model.matrix * (slope @ x)) / (y @ x)).real
    cause, adds = "", 0.0
    if shares.size and shares.max() > 0.0:
        i, t = np.unravel_index(int(np.argmax(shares)), shares.shape)
        cause, adds = f"{AXES[i]}_{model.terms[t].replace('*', '')}", float(shares[i, t])
    return Growth(float(values.real[fastest]), AXES[int(np.argmax(energy))], cause, adds)
