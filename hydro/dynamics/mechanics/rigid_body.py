"""Rigid-body inertia and Coriolis forces. Equations of McCarter 2014."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, joined, matrix_product, numbers_or_components
from auvid.hydro.dynamics.mechanics.kinematics import skew


def rigid_body_matrix(mass: ArrayLike, r_G: ArrayLike, inertia: ArrayLike) -> Array:
    """Return M_RB (2.20), (..., 6, 6).

    M_RB = [[m I, -m S(r_G)], [m S(r_G), I_0]]

    Mass (...) [kg], centre of gravity r_G (..., 3) [m], inertia I_0 (3, 3) [kg m^2]
    about the body origin, its off-diagonals minus the products of inertia (2.18).

    >>> rigid_body_matrix(2.0, [0.0, 0.0, 0.1], np.eye(3))[0, [0, 4]].tolist()
    [2.0, 0.2]
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


def coriolis_components(nu: tuple[Array, ...], momentum: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return X to N of C(nu) nu (2.23) from the components of nu and of M nu.

    With M nu = [a; b]: force omega x a, moment v x a + omega x b. Arrays of one shape,
    or numbers in the compiled loop.
    """
    u, v, w, p, q, r = nu
    a1, a2, a3, b1, b2, b3 = momentum
    return (
        q * a3 - r * a2,
        r * a1 - p * a3,
        p * a2 - q * a1,
        v * a3 - w * a2 + (q * b3 - r * b2),
        w * a1 - u * a3 + (r * b1 - p * b3),
        u * a2 - v * a1 + (p * b2 - q * b1),
    )


def coriolis_force(M: ArrayLike, nu: ArrayLike) -> Array:
    """Return C(nu) nu (2.23): symmetric M (..., 6, 6), nu (..., 6) -> (..., 6) [N, Nm].

    C(nu) = [[0, -S(a)], [-S(a), -S(b)]], [a; b] = M nu, so that nu' C nu = 0. M = M_RB
    gives C_RB nu; M = M_A (McCarter's convention, <= 0) gives C_A nu. (2.24) is another
    matrix with the same product.

    >>> coriolis_force(np.diag([2.0, 3.0, 3.0, 1.0, 1.0, 1.0]), [1, 1, 0, 0, 0, 0])[5]
    np.float64(1.0)
    """
    nu = np.asarray(nu, dtype=np.float64)
    momentum = matrix_product(M, nu)
    return joined(coriolis_components(*numbers_or_components(nu, momentum)))
