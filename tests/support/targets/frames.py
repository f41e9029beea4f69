"""Frames, rigid bodies and Coriolis terms as the evaluators of simulator targets need them.

Body frames FRD (forward, right, down) and FLU (forward, left, up); worlds NED and ENU.
Everything is written from Fossen, Handbook of Marine Craft Hydrodynamics and Motion
Control, 2nd ed. (2021), with arrays of shape (n, 6) for states and forces.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FLIP = np.diag([1.0, -1.0, -1.0])
"""FLU from FRD and back: y and z change sign."""

FLIP6 = np.kron(np.eye(2), FLIP)
"""The same for velocities and forces, shape (6, 6)."""

STANDARD_GRAVITY = 9.80665


def readme_of(folder: Path) -> str:
    """Return the page beside exported files."""
    (page,) = folder.glob("README_*.md")
    return page.read_text(encoding="utf-8")


@dataclass(frozen=True)
class Body:
    """A vehicle as a simulator moves it: inertia @ nu_dot = force(nu, eta) + tau.

    Body FRD and NED, SNAME order, about the model file's origin, SI.
    """

    inertia: Array
    force: Callable[[Array, Array], Array]

    def derivative(self, nu: Array, eta: Array, tau: Array | float = 0.0) -> Array:
        """Return the acceleration nu_dot (n, 6) of states nu, eta under the force tau."""
        return np.linalg.solve(self.inertia, (self.force(nu, eta) + tau).T).T


def skew(r: Array) -> Array:
    """Return S(r) with S(r) @ x = r x x: Fossen (2.9); r (..., 3), result (..., 3, 3)."""
    zero = np.zeros_like(r[..., 0])
    x, y, z = r[..., 0], r[..., 1], r[..., 2]
    return _matrix([[zero, -z, y], [z, zero, -x], [-y, x, zero]])


def _matrix(rows: list[list[Array]]) -> Array:
    out = np.empty((*np.shape(rows[0][0]), 3, 3))
    for i, row in enumerate(rows):
        for j, values in enumerate(row):
            out[..., i, j] = values
    return out


def cross(a: Array, b: Array) -> Array:
    """Return a x b of arrays (..., 3); of few rows `np.cross` takes several times as long."""
    out = np.empty(np.broadcast(a, b).shape)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


def rotation(angles: Array) -> Array:
    """Return R_z(psi) R_y(theta) R_x(phi), body to world: Fossen (2.31); angles (..., 3)."""
    sines, cosines = np.sin(angles), np.cos(angles)
    (sf, st, sp), (cf, ct, cp) = ([f[..., i] for i in range(3)] for f in (sines, cosines))
    rows = [
        [cp * ct, cp * st * sf - sp * cf, sp * sf + cp * cf * st],
        [sp * ct, cp * cf + sf * st * sp, st * sp * cf - cp * sf],
        [-st, ct * sf, ct * cf],
    ]
    return _matrix(rows)


def rigid_body(mass: float, centre: Array, inertia: Array) -> Array:
    """Return M_RB (6, 6) about the origin: Fossen (3.51); inertia (3, 3) about the centre."""
    s = skew(np.asarray(centre, float))
    return np.block([[mass * np.eye(3), -mass * s], [mass * s, np.asarray(inertia) - mass * s @ s]])


def coriolis(mass: Array, nu: Array) -> Array:
    """Return C(nu) nu (n, 6) of an inertia matrix (6, 6): Fossen (3.46).

    C = [0, -S(a1); -S(a1), -S(a2)] with a = M nu: force w x a1, moment v x a1 + w x a2.
    """
    a = nu @ mass.T
    linear = cross(nu[:, 3:], a[:, :3])
    angular = cross(nu[:, :3], a[:, :3]) + cross(nu[:, 3:], a[:, 3:])
    return np.hstack([linear, angular])


def shift(arm: Array) -> Array:
    """Return H(r) (6, 6), velocity at r from velocity at the origin: Fossen (C.1).

    v_r = v + w x r = v - S(r) w. A force at r acts at the origin as H(r).T @ force.
    """
    h = np.eye(6)
    h[:3, 3:] = -skew(np.asarray(arm, float))
    return h


def push(point: Array, force: Array) -> Array:
    """Return the wrench (n, 6) about the origin of forces (n, 3) that act at a point (3,)."""
    return np.hstack([force, cross(np.broadcast_to(point, force.shape), force)])


def down(eta: Array) -> Array:
    """Return the unit vector down in body FRD (n, 3) of poses eta (n, 6)."""
    return rotation(eta[:, 3:])[:, 2, :]
