"""Propeller thrust and torque from open-water polynomials: McCarter 2014 (2.52)-(2.56),
Table B.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array


@dataclass(frozen=True)
class Propeller:
    """`thrust` and `torque` (3,) are the polynomials K_T(J), K_Q(J), highest power
    first.

    `level_speed_rev_s` and `level_speed_m_s` (k,) tabulate u_c(n), the forward speed in
    steady level running; both ascend.
    """

    diameter_m: float
    wake_fraction: float
    thrust: Array
    torque: Array
    level_speed_rev_s: Array
    level_speed_m_s: Array


def advance_ratio(propeller: Propeller, u: ArrayLike, propeller_rev_s: ArrayLike) -> Array:
    """J = V_A / (n D) (2.53), V_A = u (1 - w_f); u [m/s], n [rev/s]; nan where n = 0."""
    n = np.asarray(propeller_rev_s, dtype=np.float64)
    advance = (
        np.asarray(u, dtype=np.float64) * (1.0 - propeller.wake_fraction) / propeller.diameter_m
    )
    return np.asarray(advance / np.where(n == 0.0, np.nan, n))


def propeller_force(
    propeller: Propeller, nu: ArrayLike, propeller_rev_s: ArrayLike, *, water_density: float
) -> Array:
    """tau_P = [T, 0, 0, Q, 0, 0] (2.56): nu (..., 6), n (...) rev/s -> (..., 6) [N, N
    m].

    T = K_T(J) rho n^2 D^4 is evaluated as rho D^4 (k2 a^2 + k1 a n + k0 n^2) with a =
    V_A / D, which needs no division and holds at n = 0; Q likewise with D^5. Known
    limits: the polynomials are measured for ahead running at moderate J; a standing
    propeller (J -> inf) and astern rotation are extrapolations. For n < 0 the even
    powers of n keep the sign of n (n|n|, |n| a), as in Fossen's four-quadrant form, so
    that thrust passes smoothly through zero speed of rotation.
    """
    u = np.asarray(nu, dtype=np.float64)[..., 0]
    n = np.asarray(propeller_rev_s, dtype=np.float64)
    a = u * (1.0 - propeller.wake_fraction) / propeller.diameter_m
    terms = np.stack(np.broadcast_arrays(a * a, a * np.abs(n), n * np.abs(n)), axis=-1)
    tau = np.zeros((*terms.shape[:-1], 6))
    tau[..., 0] = water_density * propeller.diameter_m**4 * (terms @ propeller.thrust)
    tau[..., 3] = water_density * propeller.diameter_m**5 * (terms @ propeller.torque)
    return tau


def level_speed(propeller: Propeller, propeller_rev_s: ArrayLike) -> Array:
    """u_c(n) [m/s] (C.12), linear between the table's points, nan outside the table; n
    (...) rev/s, as commanded (not filtered).
    """
    n = np.asarray(propeller_rev_s, dtype=np.float64)
    return np.asarray(
        np.interp(
            n, propeller.level_speed_rev_s, propeller.level_speed_m_s, left=np.nan, right=np.nan
        )
    )
