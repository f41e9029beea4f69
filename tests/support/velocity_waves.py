"""Velocities that excite every axis, with drag forces, for regressions without a
vehicle.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
AMPLITUDES = np.array([1.5, 0.4, 0.3, 0.3, 0.25, 0.4])
"""Of u, v, w [m/s] and p, q, r [rad/s]."""


def velocity_waves(n: int, seed: int = 5) -> tuple[Array, Array, Array]:
    """Return velocities (6, n), propulsion ratio (n,) and forces (n, 6) with noise.

    Five sines an axis at 50 Hz, surge in both directions. The force is a quadratic drag
    on each axis and 1 N (N m) of white noise.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 50.0
    nu = np.zeros((6, n))
    for axis in range(6):
        for omega in rng.uniform(0.05, 2.0, size=5):
            phase = rng.uniform(0.0, 2.0 * np.pi)
            nu[axis] += AMPLITUDES[axis] / 2.0 * np.sin(omega * t + phase)
    eta = 1.0 + 0.3 * np.sin(0.21 * t)
    drag = rng.uniform(5.0, 50.0, size=6)
    force = -(drag[:, None] * nu * np.abs(nu)).T + rng.standard_normal((n, 6))
    return nu, eta, force
