"""Drag and lift of a glider as viscous terms in body axes.

With K = rho S / 2, e = alpha - alpha_0 and alpha = atan(w / u), drag K U^2 (C_D0 + C_D1 e^2)
stands against the motion and lift K U^2 a e across it. To second order in w / u and
alpha_0, u > 0:

    X = K [-(C_D0 + C_D1 alpha_0^2) u^2 + alpha_0 (2 C_D1 - a) u w + (a - C_D1 - C_D0 / 2) w^2]
    Z = K [a alpha_0 u^2 - (a + C_D) u w],  C_D that of the mean glide.
"""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.gliding.steady_glide import GliderBody, Polar

HULL_TERMS = (("X", "u*u"), ("X", "u*w"), ("X", "w*w"), ("Z", "u*u"), ("Z", "u*w"))
"""Axis and basis term of each coefficient."""


def hull_terms(polar: Polar, body: GliderBody, *, alpha_rad: float) -> Array:
    """Return the coefficients (5,) of `HULL_TERMS` [N s^2/m^2], in neutral water.

    alpha_rad: angle of attack of the mean dive.
    """
    zero, slope, induced = polar.zero_lift_rad, polar.lift_slope, polar.induced
    share = 0.5 * body.neutral_kg_m3 * body.area_m2
    return share * np.array(
        [
            -(polar.drag + induced * zero**2),
            zero * (2.0 * induced - slope),
            slope - induced - 0.5 * polar.drag,
            slope * zero,
            -(slope + float(polar.drag_coefficient(alpha_rad))),
        ]
    )
