"""Gravity and buoyancy: McCarter 2014 (2.42)-(2.44)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array


def restoring_force(
    eta: ArrayLike, *, weight: ArrayLike, buoyancy: ArrayLike, r_G: ArrayLike, r_B: ArrayLike
) -> Array:
    """tau_G (2.44): (..., 6) -> (..., 6) [N, N m]; a force on the vehicle, on the
    right-hand side of (2.60).

    `weight` W = m g and `buoyancy` B (...) [N]; r_G, r_B (..., 3) [m] from the body
    origin. The centre of gravity below that of buoyancy (z_G > z_B) is stable in roll
    and pitch.
    """
    attitude = np.asarray(eta, dtype=np.float64)[..., 3:]
    sf, cf = np.sin(attitude[..., 0]), np.cos(attitude[..., 0])
    st, ct = np.sin(attitude[..., 1]), np.cos(attitude[..., 1])
    heavy, lift = np.asarray(weight, dtype=np.float64), np.asarray(buoyancy, dtype=np.float64)
    net = heavy - lift
    moment = (
        np.asarray(r_G, dtype=np.float64) * heavy[..., None]
        - np.asarray(r_B, dtype=np.float64) * lift[..., None]
    )
    x, y, z = moment[..., 0], moment[..., 1], moment[..., 2]
    components = [
        -net * st,
        net * ct * sf,
        net * ct * cf,
        y * ct * cf - z * ct * sf,
        -z * st - x * ct * cf,
        x * ct * sf + y * st,
    ]
    return np.stack(components, axis=-1)
