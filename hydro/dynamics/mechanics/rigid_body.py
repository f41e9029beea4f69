"""Rigid body inertia and Coriolis forces: McCarter 2014 (2.17)-(2.24)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, cross, matrix_product
from auvid.hydro.dynamics.mechanics.kinematics import skew


def rigid_body_matrix(mass: ArrayLike, r_G: ArrayLike, inertia: ArrayLike) -> Array:
    """M_RB (2.20), (..., 6, 6), from mass (...) [kg], centre of gravity r_G (..., 3)
    [m] and inertia I_0 (3, 3) about the body origin.

    The off-diagonals of I_0 [kg m^2] are minus the products of inertia (2.18).
    """
    mass, arm = np.asarray(mass, dtype=np.float64), np.asarray(r_G, dtype=np.float64)
    moment = mass[..., None] * arm
    coupling = skew(moment)
    matrix = np.empty((*moment.shape[:-1], 6, 6))
    matrix[..., :3, :3] = mass[..., None, None] * np.eye(3)
    matrix[..., :3, 3:] = -coupling
    matrix[..., 3:, :3] = coupling
    matrix[..., 3:, 3:] = np.asarray(inertia, dtype=np.float64)
    return matrix


def coriolis(M: ArrayLike, nu: ArrayLike) -> Array:
    """C(nu) of a symmetric inertia matrix M (6, 6), (2.23): (..., 6) -> (..., 6, 6).
    Skew-symmetric, so nu' C nu = 0.

    M = M_RB gives C_RB; M = M_A (McCarter's convention, <= 0) gives C_A. (2.24) is
    another matrix with the same product C nu.
    """
    linear, angular = _momentum(M, nu)
    matrix = np.zeros((*linear.shape[:-1], 6, 6))
    upper = -skew(linear)
    matrix[..., :3, 3:] = upper
    matrix[..., 3:, :3] = upper
    matrix[..., 3:, 3:] = -skew(angular)
    return matrix


def coriolis_force(M: ArrayLike, nu: ArrayLike) -> Array:
    """The product C(nu) nu of (2.23) without forming C: M (..., 6, 6), nu (..., 6) ->
    (..., 6) [N, N m].
    """
    nu = np.asarray(nu, dtype=np.float64)
    linear, angular = _momentum(M, nu)
    velocity, rate = nu[..., :3], nu[..., 3:]
    return np.concatenate(
        [cross(rate, linear), cross(velocity, linear) + cross(rate, angular)], axis=-1
    )


def _momentum(M: ArrayLike, nu: ArrayLike) -> tuple[Array, Array]:
    momentum = matrix_product(M, nu)
    return momentum[..., :3], momentum[..., 3:]
