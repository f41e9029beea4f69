"""Cruciform fins: McCarter 2014 (2.45)-(2.51)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array

FIN_NAMES = ("s", "p", "b", "t")


@dataclass(frozen=True)
class Fins:
    """Four fins, columns starboard, port, bottom, top. `linear` K'_delta and
    `quadratic` K'_delta^2 (6, 4), nondimensional, rows X to N.
    """

    length_m: float
    linear: Array
    quadratic: Array


def fin_force(
    fins: Fins, nu: ArrayLike, deflection_rad: ArrayLike, *, water_density: float
) -> Array:
    """tau_delta = K_delta delta + K_delta^2 diag(delta) delta (2.45): nu (..., 6),
    deflections (..., 4) rad -> (..., 6) [N, N m].

    Scaled with u^2 (2.48)-(2.51), not with the whole speed: force rows 0.5 rho l^2 u^2,
    moment rows 0.5 rho l^3 u^2. The angle's unit is not printed in Table B.4; radian
    follows from the magnitudes. Valid for ahead motion and fins that are not stalled.
    """
    u = np.asarray(nu, dtype=np.float64)[..., 0]
    delta = np.asarray(deflection_rad, dtype=np.float64)
    scale = 0.5 * water_density * fins.length_m ** np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
    coefficients = delta @ fins.linear.T + delta**2 @ fins.quadratic.T
    return np.square(u)[..., None] * scale * coefficients
