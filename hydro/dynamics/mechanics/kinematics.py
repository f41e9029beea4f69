"""Kinematics of a body in NED. Equations of McCarter 2014.

Attitude Theta = [phi, theta, psi] in rad, Euler angles of the order z, y, x.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, components, joined, numbers_or_components, stack_matrix

SINGULAR_COSINE = 1e-6
"""Pitch within 1e-6 rad of 90 degrees: below this |cos(theta)| Euler rates are nan."""

Rows = tuple[tuple[Array | float, ...], ...]
"""Entries of a matrix, row by row; numbers in the compiled loop."""


def skew(a: ArrayLike) -> Array:
    """Return S(a) with S(a) b = a x b (A.7): (..., 3) -> (..., 3, 3).

    S(a) = [[0, -a3, a2], [a3, 0, -a1], [-a2, a1, 0]]

    >>> skew([1.0, 2.0, 3.0])[0].tolist()
    [0.0, -3.0, 2.0]
    """
    a = np.asarray(a, dtype=np.float64)
    a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2]
    return stack_matrix([[0.0, -a3, a2], [a3, 0.0, -a1], [-a2, a1, 0.0]], a.shape[:-1])


def rotation_entries(sf: Array, cf: Array, st: Array, ct: Array, sp: Array, cp: Array) -> Rows:
    """Return the rows of P_v (2.5) from sines and cosines of phi, theta, psi."""
    return (
        (cp * ct, cp * st * sf - sp * cf, sp * sf + cp * cf * st),
        (sp * ct, cp * cf + sf * st * sp, st * sp * cf - cp * sf),
        (-st, ct * sf, ct * cf),
    )


def euler_rate_entries(sf: Array, cf: Array, st: Array, ct: Array) -> Rows:
    """Return the rows of P_omega (2.7) from sines and cosines of phi and theta.

    [[1, sin(phi) tan(theta), cos(phi) tan(theta)],
     [0, cos(phi), -sin(phi)],
     [0, sin(phi) / cos(theta), cos(phi) / cos(theta)]]

    A cosine `ct` of nan makes the columns of q and r nan.
    """
    tt, guard = st / ct, 0.0 * ct  # 0 * nan stays nan, so that cos(phi) becomes nan too
    return (
        (1.0, sf * tt, cf * tt),
        (0.0, cf + guard, -sf + guard),
        (0.0, sf / ct, cf / ct),
    )


def rotation_body_to_ned(attitude: ArrayLike) -> Array:
    """Return P_v (2.5), body FRD to NED: (..., 3) rad -> (..., 3, 3).

    [xdot ydot zdot]' = P_v [u v w]'. Its inverse is its transpose (2.13, corrected).

    >>> rotation_body_to_ned([0.0, 0.0, np.pi / 2.0]).round(12)[:2, 0].tolist()
    [0.0, 1.0]
    """
    angles = np.asarray(attitude, dtype=np.float64)
    (sf, st, sp), (cf, ct, cp) = components(np.sin(angles)), components(np.cos(angles))
    return _matrix(rotation_entries(sf, cf, st, ct, sp, cp), angles.shape[:-1])


def euler_rate_matrix(attitude: ArrayLike) -> Array:
    """Return P_omega (2.7), [p q r] to Euler angle rates: (..., 3) rad -> (..., 3, 3).

    Singular at a pitch of +-90 degrees: where |cos(theta)| < SINGULAR_COSINE the
    columns of q and r are nan.

    >>> euler_rate_matrix([0.0, np.pi / 4.0, 0.0]).round(12)[0].tolist()
    [1.0, 0.0, 1.0]
    """
    angles = np.asarray(attitude, dtype=np.float64)
    (sf, st, _), (cf, ct, _) = components(np.sin(angles)), components(np.cos(angles))
    ct = np.where(np.abs(ct) < SINGULAR_COSINE, np.nan, ct)
    return _matrix(euler_rate_entries(sf, cf, st, ct), angles.shape[:-1])


def euler_rate_matrix_inverse(attitude: ArrayLike) -> Array:
    """Return P_omega^-1 (2.14), Euler angle rates to [p q r]: (..., 3) -> (..., 3, 3).

    [[1, 0, -sin(theta)], [0, cos(phi), cos(theta) sin(phi)],
     [0, -sin(phi), cos(theta) cos(phi)]], defined at every attitude. With P_v' it gives
    nu from the pose's derivative (2.15).
    """
    angles = np.asarray(attitude, dtype=np.float64)
    (sf, st, _), (cf, ct, _) = components(np.sin(angles)), components(np.cos(angles))
    rows = ((1.0, 0.0, -st), (0.0, cf, ct * sf), (0.0, -sf, ct * cf))
    return _matrix(rows, angles.shape[:-1])


def eta_dot(eta: ArrayLike, nu: ArrayLike) -> Array:
    """Return the pose's derivative (2.11): (..., 6), (..., 6) -> (..., 6) [m/s, rad/s].

    eta_dot = diag(P_v, P_omega) nu; nan at singular pitch (`euler_rate_matrix`).

    >>> eta_dot([0, 0, 5, 0, 0, np.pi], [1.5, 0, 0, 0, 0, 0.1]).round(12).tolist()
    [-1.5, 0.0, 0.0, 0.0, 0.0, 0.1]
    """
    pose, nu = np.asarray(eta, dtype=np.float64), np.asarray(nu, dtype=np.float64)
    if pose.shape != nu.shape:
        pose, nu = np.broadcast_arrays(pose, nu)
    angles = pose[..., 3:]
    (sf, st, sp), (cf, ct, cp), (u, v, w, p, q, r) = numbers_or_components(
        np.sin(angles), np.cos(angles), nu
    )
    regular: Any = np.where(np.abs(ct) < SINGULAR_COSINE, np.nan, ct)
    regular = float(regular) if regular.ndim == 0 else regular
    # The sums stand here: they add in a fixed order, a product by BLAS does not.
    upper = [x * u + y * v + z * w for x, y, z in rotation_entries(sf, cf, st, ct, sp, cp)]
    lower = [x * p + y * q + z * r for x, y, z in euler_rate_entries(sf, cf, st, regular)]
    return joined([*upper, *lower])


def _matrix(rows: Rows, shape: tuple[int, ...]) -> Array:
    return stack_matrix([list(row) for row in rows], shape)
