"""Actuators that follow their commands late, on a uniform clock."""

from __future__ import annotations

import numpy as np

from auvid.hydro.arrays import Array, recursion


def first_order_lag(values: Array, *, lag_s: float, step_s: float) -> Array:
    """Return y (n, ...) with T dy/dt = u - y, at rest with the first value before it.

    Exact for inputs u (n, ...) linear between samples: y_k+1 = e y_k + b u_k + c u_k+1,
    e = exp(-h / T), c = 1 - (1 - e) T / h, b = (1 - e) T / h - e.

    >>> ramp = np.arange(0.0, 5.0, 0.5)
    >>> late = first_order_lag(ramp, lag_s=0.25, step_s=0.5)  # in the end 0.25 s behind
    >>> round(float(ramp[-1] - late[-1]), 6)
    0.25
    """
    if lag_s <= 0.0 or values.size == 0:
        return values
    share = lag_s / step_s
    e = np.exp(-1.0 / share)
    away = (values - values[:1]).reshape(len(values), -1)
    driven = (1.0 - (1.0 - e) * share) * away
    driven[1:] += ((1.0 - e) * share - e) * away[:-1]
    return recursion(driven, [-e]).reshape(values.shape) + values[:1]
