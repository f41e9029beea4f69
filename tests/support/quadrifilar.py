"""The quadrifilar pendulum forwards: its period from an inertia."""

from __future__ import annotations

import numpy as np

from auvid.hydro.identification.bench.quadrifilar import QuadrifilarGeometry


def swing_period(geometry: QuadrifilarGeometry, mass: float, inertia: float) -> float:
    """Return T = 2 pi sqrt(I_eq h / (m g R_1 R_2)) [s], Alberti (54)-(55)."""
    product = geometry.radius_ceiling * geometry.radius_tray
    stiffness = mass * geometry.gravity * product / geometry.drop
    return float(2.0 * np.pi * np.sqrt(inertia / stiffness))
