"""Propeller thrust and torque. Equations of McCarter 2014, polynomials of Table B.5."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array


@dataclass(frozen=True)
class Propeller:
    """A propeller with its open-water polynomials and its table of level speeds.

    `thrust` and `torque` (3,) are K_T(J), K_Q(J), highest power first.
    `level_speed_rev_s` and `level_speed_m_s` (k,) tabulate u_c(n), the forward speed in
    steady level running; both ascend.
    """

    diameter_m: float
    wake_fraction: float
    thrust: Array
    torque: Array
    level_speed_rev_s: Array
    level_speed_m_s: Array

    @property
    def inflow_per_u(self) -> float:
        """V_A / (D u) = (1 - w_f) / D [1/m] (2.53)."""
        return (1.0 - self.wake_fraction) / self.diameter_m

    def coefficients(self, water_density: float) -> Array:
        """Return rho D^4 K_T and rho D^5 K_Q (2, 3), factors of `propeller_terms`."""
        scale = water_density * self.diameter_m ** np.array([4.0, 5.0])
        return np.asarray(scale[:, None] * np.stack([self.thrust, self.torque]))


def propeller_terms(u: Array, n: Array, inflow_per_u: Array | float) -> tuple[Array, ...]:
    """Return n|n| [J^2, J, 1] (2.52)-(2.53) as [a^2, a |n|, n |n|], a = J n = V_A / D.

    Arrays of one shape, or numbers in the compiled loop.
    """
    a, spin = u * inflow_per_u, np.abs(n)
    return a * a, a * spin, n * spin


def propeller_force(
    propeller: Propeller, nu: ArrayLike, propeller_rev_s: ArrayLike, *, water_density: float
) -> Array:
    """Return tau_P (2.56): nu (..., 6), n (...) [rev/s] -> (..., 6) [N, N m].

    tau_P = [T, 0, 0, Q, 0, 0], T = rho n^2 D^4 K_T(J), Q = rho n^2 D^5 K_Q(J),
    J = V_A / (n D), V_A = u (1 - w_f) (2.52)-(2.55)

    T is evaluated as rho D^4 (k2 a^2 + k1 a |n| + k0 n |n|) with a = V_A / D, which
    needs no division and holds at n = 0. Known limits: the polynomials are measured for
    ahead running at moderate J; a standing propeller (J -> inf) and astern rotation are
    extrapolations. For n < 0 the even powers of n keep the sign of n, as in Fossen's
    four-quadrant form, so that thrust passes smoothly through zero speed of rotation.

    >>> one = np.ones(1)
    >>> screw = Propeller(0.2, 0.1, np.array([0.0, -0.4, 0.5]), np.zeros(3), one, one)
    >>> float(propeller_force(screw, [1.0, 0, 0, 0, 0, 0], 10.0, water_density=1000.0)[0].round(9))
    51.2
    """
    u = np.asarray(nu, dtype=np.float64)[..., 0]
    n = np.asarray(propeller_rev_s, dtype=np.float64)
    terms = np.stack(np.broadcast_arrays(*propeller_terms(u, n, propeller.inflow_per_u)), axis=-1)
    tau = np.zeros((*terms.shape[:-1], 6))
    tau[..., [0, 3]] = terms @ propeller.coefficients(water_density).T
    return tau


def propeller_derivatives(
    propeller: Propeller, nu: ArrayLike, propeller_rev_s: ArrayLike, *, water_density: float
) -> tuple[Array, Array]:
    """Return d(tau_P)/du and d(tau_P)/dn of (2.56), (..., 6) each."""
    u = np.asarray(nu, dtype=np.float64)[..., 0]
    n = np.asarray(propeller_rev_s, dtype=np.float64)
    inflow, zero = propeller.inflow_per_u, 0.0 * (u + n)
    by_u = (2.0 * u * inflow**2 + zero, np.abs(n) * inflow + zero, zero)
    by_n = (zero, u * inflow * np.sign(n), 2.0 * np.abs(n) + zero)
    out = np.zeros((2, *zero.shape, 6))
    table = propeller.coefficients(water_density)
    for tau, terms in zip(out, (by_u, by_n), strict=True):
        tau[..., [0, 3]] = np.stack(terms, axis=-1) @ table.T
    return out[0], out[1]


def level_speed(propeller: Propeller, propeller_rev_s: ArrayLike) -> Array:
    """Return u_c(n) [m/s] (C.12), linear between the table's points, nan outside.

    n (...) [rev/s] as commanded, not filtered.
    """
    n = np.asarray(propeller_rev_s, dtype=np.float64)
    return np.asarray(
        np.interp(
            n, propeller.level_speed_rev_s, propeller.level_speed_m_s, left=np.nan, right=np.nan
        )
    )


def level_speed_slope(propeller: Propeller, propeller_rev_s: ArrayLike) -> Array:
    """Return d(u_c)/dn (...) [m] of (C.12), that of the piece at or above each n."""
    rev_s, speed = propeller.level_speed_rev_s, propeller.level_speed_m_s
    piece = np.searchsorted(rev_s, np.asarray(propeller_rev_s, dtype=np.float64), side="right") - 1
    return np.asarray((np.diff(speed) / np.diff(rev_s))[np.clip(piece, 0, len(rev_s) - 2)])
