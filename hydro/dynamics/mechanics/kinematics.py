"""Kinematics of a body in NED: McCarter 2014 (2.5)-(2.15) and (A.7). Attitude theta =
[phi, theta, psi] in rad, ZYX Euler angles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, stack_matrix

SINGULAR_COSINE = 1e-6
"""Below this |cos(theta)| the Euler rates are undefined: pitch within 1e-6 rad of 90
degrees.
"""


def skew(a: ArrayLike) -> Array:
    """S(a) with S(a) b = a x b (A.7); (..., 3) -> (..., 3, 3)."""
    a = np.asarray(a, dtype=np.float64)
    a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2]
    return stack_matrix([[0.0, -a3, a2], [a3, 0.0, -a1], [-a2, a1, 0.0]], a.shape[:-1])


def rotation_body_to_ned(attitude: ArrayLike) -> Array:
    """P_v (2.5): turns body components (FRD) into NED; (..., 3) rad -> (..., 3, 3). Its
    inverse is its transpose (2.13, corrected).
    """
    attitude = np.asarray(attitude, dtype=np.float64)
    (cf, ct, cp), (sf, st, sp) = _components(np.cos(attitude)), _components(np.sin(attitude))
    rows: list[list[Array | float]] = [
        [cp * ct, -sp * cf + cp * st * sf, sp * sf + cp * cf * st],
        [sp * ct, cp * cf + sf * st * sp, -cp * sf + st * sp * cf],
        [-st, ct * sf, ct * cf],
    ]
    return stack_matrix(rows, attitude.shape[:-1])


def euler_rate_matrix(attitude: ArrayLike) -> Array:
    """P_omega (2.7): turns [p q r] into Euler angle rates; (..., 3) rad -> (..., 3, 3).

    Singular at a pitch of +-90 degrees: where |cos(theta)| < SINGULAR_COSINE the
    columns of q and r are nan.
    """
    attitude = np.asarray(attitude, dtype=np.float64)
    (cf, ct, _), (sf, st, _) = _components(np.cos(attitude)), _components(np.sin(attitude))
    ct = np.where(np.abs(ct) < SINGULAR_COSINE, np.nan, ct)
    tt = st / ct
    # 0 * nan keeps nan: at the singularity the whole column is undefined, also its
    # entry cos(phi).
    guard = 0.0 * ct
    rows: list[list[Array | float]] = [
        [1.0, sf * tt, cf * tt],
        [0.0, cf + guard, -sf + guard],
        [0.0, sf / ct, cf / ct],
    ]
    return stack_matrix(rows, attitude.shape[:-1])


def euler_rate_matrix_inverse(attitude: ArrayLike) -> Array:
    """P_omega^-1 (2.14): turns Euler angle rates into [p q r]; defined at every
    attitude; (..., 3) rad -> (..., 3, 3).
    """
    attitude = np.asarray(attitude, dtype=np.float64)
    (cf, ct, _), (sf, st, _) = _components(np.cos(attitude)), _components(np.sin(attitude))
    return stack_matrix(
        [[1.0, 0.0, -st], [0.0, cf, ct * sf], [0.0, -sf, ct * cf]], attitude.shape[:-1]
    )


def eta_dot(eta: ArrayLike, nu: ArrayLike) -> Array:
    """Rate of the pose, diag(P_v, P_omega) nu (2.11); (..., 6) and (..., 6) -> (...,
    6). nan at singular pitch (`euler_rate_matrix`).
    """
    eta, nu = np.asarray(eta, dtype=np.float64), np.asarray(nu, dtype=np.float64)
    return _block_product(rotation_body_to_ned(eta[..., 3:]), euler_rate_matrix(eta[..., 3:]), nu)


def body_velocity(eta: ArrayLike, rate: ArrayLike) -> Array:
    """nu from the rate of the pose (2.15), the inverse of `eta_dot`; (..., 6) and (...,
    6) -> (..., 6).
    """
    eta, rate = np.asarray(eta, dtype=np.float64), np.asarray(rate, dtype=np.float64)
    to_body = np.swapaxes(rotation_body_to_ned(eta[..., 3:]), -1, -2)
    return _block_product(to_body, euler_rate_matrix_inverse(eta[..., 3:]), rate)


def _block_product(linear: Array, angular: Array, vector: Array) -> Array:
    upper = np.einsum("...ij,...j->...i", linear, vector[..., :3])
    lower = np.einsum("...ij,...j->...i", angular, vector[..., 3:])
    return np.concatenate([upper, lower], axis=-1)


def _components(vector: Array) -> tuple[Array, Array, Array]:
    return vector[..., 0], vector[..., 1], vector[..., 2]
