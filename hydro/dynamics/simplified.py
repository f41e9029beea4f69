"""The simplified model of THAUS and REMUS. Equations of Alberti 2015.

(18)-(26), with their print errors corrected.

Assumptions of the text: r_G = [0, 0, z_G], r_B = [0, 0, z_B], W = B, no products of
inertia, diagonal added mass and diagonal damping. (26) drops all inertia terms with z_G
without a word, though (21) and (22) keep them; both forms are here. Corrected against
the print: K, M and N of (26), and the sign of F_BK in (20), (26) and (63), with which
roll would be unstable for z_G below z_B. Added mass has the sign of the derivatives,
X_udot <= 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import (
    AXES,
    VELOCITIES,
    Array,
    joined,
    numbers_or_components,
    read_only,
)
from auvid.hydro.dynamics.mechanics.kinematics import eta_dot
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle


@dataclass(frozen=True)
class SimplifiedModel:
    """Numbers of (26) in SI.

    `inertia` (3,) I_x I_y I_z about the origin, `added_mass`, `linear` and `quadratic`
    (6,), all <= 0.

    `linear` and `quadratic` are X_u ... N_r and X_u|u| ... N_r|r|; `buoyancy` [N] is
    also the weight. `keep_z_G`: with the inertia terms in z_G.
    """

    mass: float
    inertia: Array
    added_mass: Array
    linear: Array
    quadratic: Array
    buoyancy: float
    z_G: float = 0.0
    z_B: float = 0.0
    keep_z_G: bool = False

    @cached_property
    def mass_matrix(self) -> Array:
        """Return M (6, 6) of (19)-(26).

        Mass and inertia less added mass, with m z_G off the diagonal where it is kept.
        """
        matrix = np.diag(np.concatenate([np.full(3, self.mass), self.inertia]) - self.added_mass)
        if self.keep_z_G:
            coupling = self.mass * self.z_G
            matrix[0, 4] = matrix[4, 0] = coupling
            matrix[1, 3] = matrix[3, 1] = -coupling
        return read_only(matrix)

    @cached_property
    def mass_matrix_inverse(self) -> Array:
        """M^-1 (6, 6)."""
        return read_only(np.linalg.inv(self.mass_matrix))


def simplified_of(
    vehicle: Vehicle, *, linear: ArrayLike, quadratic: ArrayLike, keep_z_G: bool = False
) -> SimplifiedModel:
    """Return (26) with the numbers of a vehicle and damping (6,) each.

    Buoyancy is the weight, as the text assumes.

    Raises `CampaignError` for a vehicle outside of the assumptions: centres off the z
    axis, or coupled inertia or added mass.
    """
    off = {
        "rigid_body.centre_of_gravity.value": vehicle.r_G[:2],
        "rigid_body.centre_of_buoyancy.value": vehicle.r_B[:2],
        "rigid_body.inertia.value": vehicle.inertia - np.diag(np.diag(vehicle.inertia)),
        "added_mass": vehicle.added_mass - np.diag(np.diag(vehicle.added_mass)),
    }
    for field, values in off.items():
        if np.any(values != 0.0):
            remedy = (
                "The simplified model has its centres on the z axis, and no coupling by inertia or"
                " added mass."
            )
            raise CampaignError(
                "the simplified model does not hold for this vehicle",
                field=field,
                value=values.tolist(),
                remedy=remedy,
            )
    return SimplifiedModel(
        mass=vehicle.mass_kg,
        inertia=read_only(np.diag(vehicle.inertia)),
        added_mass=read_only(np.diag(vehicle.added_mass)),
        linear=read_only(linear),
        quadratic=read_only(quadratic),
        buoyancy=vehicle.weight,
        z_G=float(vehicle.r_G[2]),
        z_B=float(vehicle.r_B[2]),
        keep_z_G=keep_z_G,
    )


def coriolis_terms(model: SimplifiedModel, nu: ArrayLike) -> Array:
    """The products of velocities in (26), C(nu) nu: (..., 6) -> (..., 6) [N, N m]."""
    ((u, v, w, p, q, r),) = numbers_or_components(np.asarray(nu, dtype=np.float64))
    m, (i_x, i_y, i_z) = model.mass, model.inertia.tolist()
    x, y, z, k, mq, n = model.added_mass.tolist()
    terms = [
        -(m - y) * v * r + (m - z) * w * q,
        -(m - z) * w * p + (m - x) * u * r,
        -(m - x) * u * q + (m - y) * v * p,
        (y - z) * v * w + (i_z - i_y - n + mq) * q * r,
        (z - x) * u * w + (i_x - i_z + n - k) * r * p,
        (x - y) * u * v + (i_y - i_x + k - mq) * p * q,
    ]
    if model.keep_z_G:
        low = m * model.z_G
        extra = [
            low * p * r,
            low * q * r,
            -low * (p**2 + q**2),
            -low * (-w * p + u * r),
            low * (-v * r + w * q),
            0.0 * r,
        ]
        terms = [term + more for term, more in zip(terms, extra, strict=True)]
    return joined(terms)


def damping_force(model: SimplifiedModel, nu: ArrayLike) -> Array:
    """Return -D(nu) nu of (25), X_u u + X_u|u| u|u| ...: (..., 6) -> (..., 6)."""
    nu = np.asarray(nu, dtype=np.float64)
    return np.asarray(model.linear * nu + model.quadratic * nu * np.abs(nu))


def restoring_terms(model: SimplifiedModel, eta: ArrayLike) -> Array:
    """Return g(eta) of (18) with W = B: (..., 6) [N, N m].

    F_BK = B (z_G - z_B) cos theta sin phi in K, F_BM = B (z_G - z_B) sin theta in M.
    """
    eta = np.asarray(eta, dtype=np.float64)
    phi, theta = eta[..., 3], eta[..., 4]
    lever = model.buoyancy * (model.z_G - model.z_B)
    force = np.zeros(eta.shape)
    force[..., 3] = lever * np.cos(theta) * np.sin(phi)
    force[..., 4] = lever * np.sin(theta)
    return force


def acceleration(model: SimplifiedModel, eta: ArrayLike, nu: ArrayLike, tau: ArrayLike) -> Array:
    """Return nu_dot (..., 6) of (18), (26) under propulsion `tau` (..., 6)."""
    total = (
        np.asarray(tau, dtype=np.float64)
        - coriolis_terms(model, nu)
        + damping_force(model, nu)
        - restoring_terms(model, eta)
    )
    return np.asarray(total @ model.mass_matrix_inverse.T)


def state_rate(model: SimplifiedModel, state: ArrayLike, tau: ArrayLike) -> Array:
    """Rate of the state [nu, eta] (..., 12) under propulsion `tau` (..., 6)."""
    state = np.asarray(state, dtype=np.float64)
    nu, eta = state[..., :6], state[..., 6:]
    return np.concatenate([acceleration(model, eta, nu, tau), eta_dot(eta, nu)], axis=-1)


DERIVATIVES = tuple(
    f"{axis}_{velocity}dot" for axis, velocity in zip(AXES, VELOCITIES, strict=True)
)
LINEAR = tuple(f"{axis}_{velocity}" for axis, velocity in zip(AXES, VELOCITIES, strict=True))
QUADRATIC = tuple(
    f"{axis}_{velocity}|{velocity}|" for axis, velocity in zip(AXES, VELOCITIES, strict=True)
)
INERTIAS = ("I_x", "I_y", "I_z")
"""Names of the numbers of (26), in the order of the axes."""
