"""Added mass of a prolate spheroid after Imlay: McCarter 2014 (2.36)-(2.41).

Convention of McCarter throughout: M_A = [X_udot ...] <= 0, tau_A = M_A nu_dot + C_A(nu)
nu, M = M_RB - M_A.
"""

from __future__ import annotations

import math

import numpy as np

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.arrays import Array

SERIES_ECCENTRICITY = 0.1
"""Below this the closed form of alpha_0 loses digits by cancellation; the series is
then exact to rounding.
"""


def spheroid_added_mass(
    a: float, b: float, *, fluid_mass: float | None = None, water_density: float = 1000.0
) -> Array:
    """Return M_A (6, 6), <= 0, of a prolate spheroid about its centre.

    Semi-axes a >= b [m]; x is the axis of revolution.

    `fluid_mass` m_f [kg] is the mass of displaced water, by default 4/3 pi rho a b^2.
    Table B.3 of McCarter follows from the dry mass of the vehicle in its place: X, Y, Z
    with the equal-volume semi-axes, M and N with length / 2 and diameter / 2. Limits:
    sphere -m_f / 2; slender body Y_vdot -> -m_f, X_udot -> 0, M_qdot -> -m_f a^2 / 5.
    Raises `PipelineError` unless a >= b > 0.
    """
    if not (a >= b > 0.0):
        raise PipelineError("a prolate spheroid needs semi-axes a >= b > 0", value=(a, b))
    m_f = 4.0 / 3.0 * math.pi * water_density * a * b**2 if fluid_mass is None else fluid_mass
    alpha = _alpha_0(math.sqrt(1.0 - (b / a) ** 2))
    beta = 1.0 - 0.5 * alpha
    x_udot = -alpha / (2.0 - alpha) * m_f
    y_vdot = -beta / (2.0 - beta) * m_f
    m_qdot = 0.0
    if a > b:
        below = 2.0 * (b**2 - a**2) + (b**2 + a**2) * (beta - alpha)
        m_qdot = -0.2 * (b**2 - a**2) ** 2 * (alpha - beta) / below * m_f
    return np.diag([x_udot, y_vdot, y_vdot, 0.0, m_qdot, m_qdot])


def _alpha_0(e: float) -> float:
    # beta_0 follows from the identity alpha_0 + 2 beta_0 = 2.
    if e < SERIES_ECCENTRICITY:
        return 2.0 * (1.0 - e**2) * sum(e ** (2 * k) / (2 * k + 3) for k in range(12))
    return 2.0 * (1.0 - e**2) / e**3 * (math.atanh(e) - e)
