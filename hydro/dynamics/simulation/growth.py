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
    most. term: the viscous term that feeds it most there, empty for none.
    """

    rate: float
    axis: str
    term: str


def growth(vehicle: Vehicle, model: IdentifiedModel, nu: ArrayLike) -> Growth:
    """Return the fastest growth of velocities about nu (6,) [m/s, rad/s].

    Of d(delta nu)/dt = M^-1 (K dxi/dnu - d(C nu)/dnu) delta nu, McCarter (2.60) without
    restoring force and actuators. The axis is that of the largest part of its kinetic
    energy. Terms with eta count at eta = 1.
    """
    state = np.asarray(nu, dtype=np.float64)
    slope = basis_jacobian(state, model.terms, ratio=np.ones(()))
    matrix = vehicle.mass_matrix_inverse @ (
        model.matrix @ slope - coriolis_jacobian(vehicle.mass_matrix, state)
    )
    values, vectors = np.linalg.eig(matrix)
    fastest = int(np.argmax(values.real))
    energy = np.abs(vectors[:, fastest]) ** 2 * np.diag(vehicle.mass_matrix)
    axis = int(np.argmax(energy))
    feeds = model.matrix[axis] * slope[:, axis]
    place = int(np.argmax(feeds)) if len(feeds) else -1
    term = model.terms[place] if place >= 0 and feeds[place] > 0.0 else ""
    return Growth(float(values.real[fastest]), AXES[axis], term)
