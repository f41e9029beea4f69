"""Partial derivatives of the parts of the equations of motion.

They serve to linearise about a motion.

They are analytic because the moduli in drag make complex steps wrong; at the kink of a
modulus the derivative is that of its middle, 0. All functions take leading batch
dimensions.

Equations of McCarter 2014.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import VELOCITIES, Array, cross
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix, rotation_body_to_ned, skew
from auvid.hydro.dynamics.viscous.basis import MODULI, PROPULSION, product_plan

BLOCK = 512
"""Samples of the basis that are differentiated at once: they stay in the cache."""


def coriolis_jacobian(M: ArrayLike, nu: ArrayLike) -> Array:
    """d(C(nu) nu)/d(nu) of (2.23): M (..., 6, 6), nu (..., 6) -> (..., 6, 6)."""
    nu, M = np.asarray(nu, dtype=np.float64), np.asarray(M, dtype=np.float64)
    momentum = (M @ nu[..., None])[..., 0]
    linear, angular = skew(momentum[..., :3]), skew(momentum[..., 3:])
    velocity, rate = skew(nu[..., :3]), skew(nu[..., 3:])
    out = np.empty((*np.broadcast_shapes(nu.shape[:-1], M.shape[:-2]), 6, 6))
    out[..., :3, :] = rate @ M[..., :3, :]
    out[..., 3:, :] = velocity @ M[..., :3, :] + rate @ M[..., 3:, :]
    out[..., :3, 3:] -= linear
    out[..., 3:, :3] -= linear
    out[..., 3:, 3:] -= angular
    return out


def restoring_jacobian(
    eta: ArrayLike, *, weight: ArrayLike, buoyancy: ArrayLike, r_G: ArrayLike, r_B: ArrayLike
) -> Array:
    """Return d(tau_G)/d(eta) of (2.44): (..., 6) -> (..., 6, 6).

    Only the columns of phi and theta are not 0.
    """
    attitude = np.asarray(eta, dtype=np.float64)[..., 3:]
    heavy, lift = np.asarray(weight, dtype=np.float64), np.asarray(buoyancy, dtype=np.float64)
    net = heavy - lift
    moment = (
        np.asarray(r_G, dtype=np.float64) * heavy[..., None]
        - np.asarray(r_B, dtype=np.float64) * lift[..., None]
    )
    x, y, z = moment[..., 0], moment[..., 1], moment[..., 2]
    sf, cf = np.sin(attitude[..., 0]), np.cos(attitude[..., 0])
    st, ct = np.sin(attitude[..., 1]), np.cos(attitude[..., 1])
    out = np.zeros((*np.broadcast_shapes(sf.shape, net.shape), 6, 6))
    by_roll = (
        np.zeros_like(sf),
        net * ct * cf,
        -net * ct * sf,
        -y * ct * sf - z * ct * cf,
        x * ct * sf,
        x * ct * cf,
    )
    by_pitch = (
        -net * ct,
        -net * st * sf,
        -net * st * cf,
        -y * st * cf + z * st * sf,
        -z * ct + x * st * cf,
        -x * st * sf + y * ct,
    )
    for row in range(6):
        out[..., row, 3], out[..., row, 4] = by_roll[row], by_pitch[row]
    return out


def kinematics_jacobians(eta: ArrayLike, nu: ArrayLike) -> tuple[Array, Array]:
    """Return d(eta_dot)/d(nu) and d(eta_dot)/d(eta) of (2.11).

    (..., 6), (..., 6) -> (..., 6, 6) each. nan at singular pitch.
    """
    eta, nu = np.asarray(eta, dtype=np.float64), np.asarray(nu, dtype=np.float64)
    attitude, v = eta[..., 3:], nu[..., :3]
    turn = rotation_body_to_ned(attitude)
    by_nu = np.zeros((*eta.shape[:-1], 6, 6))
    by_eta = np.zeros_like(by_nu)
    by_nu[..., :3, :3] = turn
    by_nu[..., 3:, 3:], by_eta[..., 3:, 3:] = euler_rate_jacobians(attitude, nu[..., 3:])
    sf, cf = np.sin(attitude[..., 0]), np.cos(attitude[..., 0])
    zero, one = np.zeros_like(sf), np.ones_like(sf)
    pitch_axis = np.stack([zero, cf, -sf], axis=-1)
    roll_axis = np.stack([one, zero, zero], axis=-1)
    for column, axis in ((3, roll_axis), (4, pitch_axis)):
        by_eta[..., :3, column] = (turn @ cross(axis, v)[..., None])[..., 0]
    ground = (turn @ v[..., None])[..., 0]
    by_eta[..., 0, 5], by_eta[..., 1, 5] = -ground[..., 1], ground[..., 0]
    return by_nu, by_eta


def euler_rate_jacobians(attitude: ArrayLike, omega: ArrayLike) -> tuple[Array, Array]:
    """Return P_omega (2.7), and d(P_omega omega) by the Euler angles.

    (..., 3), (..., 3) -> (..., 3, 3) each. nan at singular pitch.
    """
    angles, omega = np.asarray(attitude, dtype=np.float64), np.asarray(omega, dtype=np.float64)
    phi, theta = angles[..., 0], angles[..., 1]
    sf, cf, ct, tt = np.sin(phi), np.cos(phi), np.cos(theta), np.tan(theta)
    q, r = omega[..., 1], omega[..., 2]
    across, along = cf * q - sf * r, sf * q + cf * r
    slope = np.zeros((*angles.shape[:-1], 3, 3))
    slope[..., 0, 0], slope[..., 1, 0], slope[..., 2, 0] = tt * across, -along, across / ct
    slope[..., 0, 1], slope[..., 2, 1] = along / ct**2, along * tt / ct
    return euler_rate_matrix(angles), slope


def basis_jacobian(
    nu: ArrayLike,
    terms: Sequence[str],
    *,
    ratio: ArrayLike | None = None,
    minimum_speed: float = 0.05,
) -> Array:
    """d(xi)/d(nu) of the basis terms: nu (..., 6) -> (..., n_terms, 6).

    `ratio` (...) is the propulsion ratio eta = u_c / U of `viscous_basis.eta_ratio`,
    which falls with U above `minimum_speed`.
    """
    velocity = np.asarray(nu, dtype=np.float64)
    batch = velocity.shape[:-1]
    flat = velocity.reshape(-1, 6)
    eta = None if ratio is None else np.broadcast_to(np.asarray(ratio, float), batch).reshape(-1)
    names, places = product_plan(tuple(terms))
    out = np.empty((len(flat), len(terms), 6))
    for start in range(0, len(flat), BLOCK):
        rows = slice(start, start + BLOCK)
        value, slope = _factors(flat[rows], None if eta is None else eta[rows], minimum_speed)
        # A factor that a term does not have: 1, without a slope.
        values = np.array([*(value[name] for name in names), np.ones(len(flat[rows]))])
        slopes = np.array([*(slope[name] for name in names), np.zeros((len(flat[rows]), 6))])
        total = np.zeros((len(terms), len(flat[rows]), 6))
        for k, own in enumerate(places):
            others = np.ones(total.shape[:2])
            for other in (*places[:k], *places[k + 1 :]):
                others = others * values[other]
            total += slopes[own] * others[..., None]
        out[rows] = total.transpose(1, 0, 2)
    return out.reshape(*batch, len(terms), 6)


def _factors(
    nu: Array, ratio: ArrayLike | None, minimum_speed: float
) -> tuple[dict[str, Array], dict[str, Array]]:
    value: dict[str, Array] = {}
    slope: dict[str, Array] = {}
    for index, (name, modulus) in enumerate(zip(VELOCITIES, MODULI, strict=True)):
        unit = np.zeros(6)
        unit[index] = 1.0
        value[name], slope[name] = nu[..., index], np.broadcast_to(unit, nu.shape)
        value[modulus], slope[modulus] = (
            np.abs(nu[..., index]),
            np.sign(nu[..., index])[..., None] * unit,
        )
    across = np.hypot(nu[..., 1], nu[..., 2])
    slope_V = np.zeros(nu.shape)
    slope_V[..., 1:3] = nu[..., 1:3] / np.where(across > 0.0, across, 1.0)[..., None]
    value["V"], slope["V"] = across, slope_V
    for name, index in (("Vv", 1), ("Vw", 2)):
        sign = np.sign(nu[..., index])
        value[name], slope[name] = across * sign, slope_V * sign[..., None]
    if ratio is not None:
        eta = np.asarray(ratio, dtype=np.float64)
        square = np.sum(nu[..., :3] ** 2, axis=-1)
        falls = np.where(
            square > minimum_speed**2, -eta / np.maximum(square, minimum_speed**2), 0.0
        )
        by_nu = np.zeros(nu.shape)
        by_nu[..., :3] = falls[..., None] * nu[..., :3]
        value[PROPULSION], slope[PROPULSION] = eta - 1.0, by_nu
    return value, slope
