"""Rigid body inertia and Coriolis forces: McCarter 2014 (2.17)-(2.24)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro.dynamics.arrays import Array, cross
from hydro.dynamics.kinematics import skew


def rigid_body_matrix(mass: float, r_G: ArrayLike, inertia: ArrayLike) -> Array:
    """M_RB (2.20), (6, 6), from mass [kg], centre of gravity r_G [m] (3,) and inertia matrix I_0 [kg m^2] (3, 3) about the body origin.

    The off-diagonals of I_0 are minus the products of inertia (2.18).
    """
    coupling = mass * skew(r_G)
    return np.block([[mass * np.eye(3), -coupling], [coupling, np.asarray(inertia, dtype=np.float64)]])


def coriolis(M: ArrayLike, nu: ArrayLike) -> Array:
    """C(nu) of a symmetric inertia matrix M (6, 6), (2.23): (..., 6) -> (..., 6, 6). Skew-symmetric, so nu' C nu = 0.

    M = M_RB gives C_RB; M = M_A (McCarter's convention, <= 0) gives C_A. (2.24) is another matrix with the same product C nu.
    """
    linear, angular = _momentum(M, nu)
    matrix = np.zeros((*linear.shape[:-1], 6, 6))
    upper = -skew(linear)
    matrix[..., :3, 3:] = upper
    matrix[..., 3:, :3] = upper
    matrix[..., 3:, 3:] = -skew(angular)
    return matrix


def coriolis_force(M: ArrayLike, nu: ArrayLike) -> Array:
    """The product C(nu) nu of (2.23) without forming C: (..., 6) -> (..., 6) [N, N m]."""
    nu = np.asarray(nu, dtype=np.float64)
    linear, angular = _momentum(M, nu)
    velocity, rate = nu[..., :3], nu[..., 3:]
    return np.concatenate([cross(rate, linear), cross(velocity, linear) + cross(rate, angular)], axis=-1)


def _momentum(M: ArrayLike, nu: ArrayLike) -> tuple[Array, Array]:
    momentum = np.asarray(nu, dtype=np.float64) @ np.asarray(M, dtype=np.float64).T
    return momentum[..., :3], momentum[..., 3:]
