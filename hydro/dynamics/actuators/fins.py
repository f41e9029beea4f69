"""Cruciform fins. Equations of McCarter 2014."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, components


@dataclass(frozen=True)
class Fins:
    """Four fins, columns starboard, port, bottom, top.

    `linear` K'_delta and `quadratic` K'_delta^2 (6, 4), nondimensional, rows X to N.
    """

    length_m: float
    linear: Array
    quadratic: Array

    def coefficients(self, water_density: float) -> Array:
        """Return [K_delta, K_delta^2] (6, 8) (2.48)-(2.51), per u^2 and rad or rad^2.

        Force rows 0.5 rho l^2 K', moment rows 0.5 rho l^3 K'.
        """
        scale = 0.5 * water_density * self.length_m ** np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
        return np.asarray(scale[:, None] * np.hstack([self.linear, self.quadratic]))


def fin_terms(u: Array, s: Array, p: Array, b: Array, t: Array) -> tuple[Array, ...]:
    """Return u^2 [delta, delta^2] (2.45), what `Fins.coefficients` multiplies.

    Arrays of one shape, or numbers in the compiled loop.
    """
    square = u * u
    return (
        square * s, square * p, square * b, square * t,
        square * s * s, square * p * p, square * b * b, square * t * t,
    )  # fmt: skip


def fin_force(
    fins: Fins, nu: ArrayLike, deflection_rad: ArrayLike, *, water_density: float
) -> Array:
    """Return tau_delta (2.45): nu (..., 6), deflections (..., 4) -> (..., 6) [N, N m].

    tau_delta = u^2 (K_delta delta + K_delta^2 diag(delta) delta)

    Scaled with u^2 (2.48)-(2.51), not with the whole speed. The angle's unit is not
    printed in Table B.4; radian follows from the magnitudes. Valid for ahead motion and
    fins that are not stalled.

    >>> fins = Fins(2.0, np.eye(6, 4), np.zeros((6, 4)))
    >>> fin_force(fins, [1.5, 0, 0, 0, 0, 0], [0.1, 0, 0, 0], water_density=1000.0)[0]
    np.float64(450.0)
    """
    u = np.asarray(nu, dtype=np.float64)[..., 0]
    angles = components(np.asarray(deflection_rad, dtype=np.float64))
    terms = np.stack(fin_terms(u, *angles), axis=-1)
    return np.asarray(terms @ fins.coefficients(water_density).T)


def fin_derivatives(
    fins: Fins, nu: ArrayLike, deflection_rad: ArrayLike, *, water_density: float
) -> tuple[Array, Array]:
    """Return d(tau_delta)/du (..., 6), d(tau_delta)/d(delta) (..., 6, 4) of (2.45)."""
    u = np.asarray(nu, dtype=np.float64)[..., :1]
    delta = np.asarray(deflection_rad, dtype=np.float64)
    table = fins.coefficients(water_density)
    by_u = 2.0 * u * (np.concatenate([delta, delta**2], axis=-1) @ table.T)
    slope = table[:, :4] + 2.0 * table[:, 4:] * delta[..., None, :]
    return by_u, np.square(u)[..., None] * slope
