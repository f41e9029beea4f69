"""Viscous terms of a glider against drag and lift themselves."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.dynamics.gliding.hull_terms import HULL_TERMS, hull_terms
from auvid.hydro.dynamics.gliding.steady_glide import GliderBody, Polar
from auvid.hydro.dynamics.viscous.basis import basis

BODY = GliderBody(mass_kg=70.0, area_m2=0.1, gravity=9.81, neutral_kg_m3=1006.0)


@pytest.mark.parametrize("zero_lift_deg", [0.0, -1.0, 1.5])
def test_the_terms_are_drag_and_lift_of_usual_glides(zero_lift_deg: float) -> None:
    """To 1 % of the lift across the path and of the drag along it, to 4 degrees."""
    polar = Polar(0.15, 10.5, 7.5, float(np.radians(zero_lift_deg)))
    alpha = np.radians(np.array([-4.0, -3.0, -2.0, 2.0, 3.0, 4.0]))
    speed = 0.35
    nu = np.zeros((alpha.size, 6))
    nu[:, 0], nu[:, 2] = speed * np.cos(alpha), speed * np.sin(alpha)
    values = hull_terms(polar, BODY, alpha_rad=float(np.radians(3.5)))
    force = {
        axis: sum(
            value * basis(nu, terms=[term])[:, 0]
            for value, (own, term) in zip(values, HULL_TERMS, strict=True)
            if own == axis
        )
        for axis in "XZ"
    }
    dynamic = 0.5 * 1006.0 * 0.1 * speed**2
    drag = dynamic * polar.drag_coefficient(alpha)
    lift = dynamic * polar.lift_slope * (alpha - polar.zero_lift_rad)
    X = -drag * np.cos(alpha) + lift * np.sin(alpha)
    Z = -drag * np.sin(alpha) - lift * np.cos(alpha)
    assert force["X"] == pytest.approx(X, abs=0.01 * float(np.max(drag)))
    assert force["Z"] == pytest.approx(Z, abs=0.01 * float(np.max(np.abs(lift))))
