"""Gravity and buoyancy. Equations of McCarter 2014."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array, components


def restoring_components(
    sf: Array, cf: Array, st: Array, ct: Array, net: Array, x: Array, y: Array, z: Array
) -> tuple[Array, ...]:
    """Return X to N of tau_G (2.44) from sines and cosines of phi and theta.

    net = W - B [N]; (x, y, z) = r_G W - r_B B [N m]. Arrays of one shape, or numbers in
    the compiled loop.
    """
    return (
        -net * st,
        net * ct * sf,
        net * ct * cf,
        y * ct * cf - z * ct * sf,
        -z * st - x * ct * cf,
        x * ct * sf + y * st,
    )


def restoring_force(
    eta: ArrayLike, *, weight: ArrayLike, buoyancy: ArrayLike, r_G: ArrayLike, r_B: ArrayLike
) -> Array:
    """Return tau_G (2.44): (..., 6) -> (..., 6) [N, N m], right-hand side of (2.60).

    tau_G = [-(W-B) st, (W-B) ct sf, (W-B) ct cf, (y_G W - y_B B) ct cf - (z_G W - z_B B)
    ct sf, -(z_G W - z_B B) st - (x_G W - x_B B) ct cf, (x_G W - x_B B) ct sf + (y_G W -
    y_B B) st] with s, c of phi (f) and theta (t).

    `weight` W = m g and `buoyancy` B (...) [N]; r_G, r_B (..., 3) [m] from the body
    origin. Stable in roll and pitch where z_G > z_B.

    >>> arms = {"r_G": np.array([0.0, 0.0, 0.1]), "r_B": np.zeros(3)}
    >>> eta = [0.0, 0.0, 5.0, np.pi / 2.0, 0.0, 0.0]
    >>> weight, buoyancy = np.array(100.0), np.array(90.0)
    >>> restoring_force(eta, weight=weight, buoyancy=buoyancy, **arms).round(9)[[1, 3]]
    array([ 10., -10.])
    """
    attitude = np.asarray(eta, dtype=np.float64)[..., 3:]
    (sf, st, _), (cf, ct, _) = components(np.sin(attitude)), components(np.cos(attitude))
    heavy, lift = np.asarray(weight, dtype=np.float64), np.asarray(buoyancy, dtype=np.float64)
    moment = (
        np.asarray(r_G, dtype=np.float64) * heavy[..., None]
        - np.asarray(r_B, dtype=np.float64) * lift[..., None]
    )
    tau = restoring_components(sf, cf, st, ct, heavy - lift, *components(moment))
    return np.stack(tau, axis=-1)
