"""Newton's method for the angle of attack of many glides, as a compiled loop.

Import this module only where glides are solved: numba takes a second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from auvid.hydro.arrays import Array, Index

F = TypeVar("F", bound=Callable[..., Any])
ITERATIONS = 30
SETTLED_RAD = 1e-12
SOLVED_RAD = 1e-6


def _compiled(function: F) -> F:
    compiled: Any = numba.njit(cache=True, error_model="numpy")(function)
    return cast(F, compiled)


@_compiled
def angles_beyond_zero_lift(
    lean: Array, lift_slope: float, drag: float, induced: float, stall_rad: float
) -> Array:
    """Return beta = alpha - alpha_0 (n,) [rad]; nan where no steady glide has it.

    a beta tan(lean - beta) + C_D0 + C_D1 beta^2 = 0, lean = theta - alpha_0, from beta = 0
    (Merckelbach 2010 (8)).
    """
    out = np.empty(lean.size)
    for i in range(lean.size):
        beyond, step = 0.0, 1.0
        for _ in range(ITERATIONS):
            tangent = np.tan(lean[i] - beyond)
            value = lift_slope * beyond * tangent + drag + induced * beyond**2
            slope = lift_slope * (tangent - beyond * (1.0 + tangent**2)) + 2.0 * induced * beyond
            step = value / slope if abs(slope) >= 1e-9 else np.nan
            beyond -= step
            if not abs(step) >= SETTLED_RAD:
                break
        glides = (
            abs(step) < SOLVED_RAD
            and abs(beyond) < stall_rad
            and np.sign(lean[i] - beyond) == np.sign(lean[i])
        )
        out[i] = beyond if glides else np.nan
    return out


@_compiled
def lagging(t_s: Array, part: Index, steady: Array, lag_s: Array) -> Array:
    """Return means (n,) of a speed that lags behind steady ones, first order.

    dU/dt = (U_s - U) / tau over rows with mean U_s (n,) and tau (n,) [s], centred at
    t_s (n,) [s]; a part (n,) begins as if U_s had changed before as it does in its first rows.
    """
    out = np.empty(steady.size)
    speed = 0.0
    for i in range(steady.size):
        first = i == 0 or part[i] != part[i - 1]
        last = i + 1 == steady.size or part[i + 1] != part[i]
        if first and last:
            out[i] = steady[i]
            continue
        length = t_s[i] - t_s[i - 1] if last else t_s[i + 1] - t_s[i]
        tau = max(lag_s[i], 1e-9)
        if first:
            slope = (steady[i + 1] - steady[i]) / length
            speed = steady[i] - slope * (tau + 0.5 * length)
        left = np.exp(-length / tau)
        out[i] = steady[i] + (speed - steady[i]) * tau / length * (1.0 - left)
        speed = steady[i] + (speed - steady[i]) * left
    return out
