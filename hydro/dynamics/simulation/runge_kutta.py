"""One step of the classical Runge-Kutta method of fourth order for arrays."""

from __future__ import annotations

from collections.abc import Callable

from auvid.hydro.arrays import Array

Derivative = Callable[[Array, float], Array]
"""(state, share of the step passed: 0, 0.5 or 1) -> d(state)/dt."""


def runge_kutta_4(derivative: Derivative, state: Array, step_s: float) -> Array:
    """Return the state one step later; error of a step O(step^5).

    x + h/6 (k1 + 2 k2 + 2 k3 + k4)

    >>> import numpy as np
    >>> float(runge_kutta_4(lambda x, share: x, np.array(1.0), 0.1).round(9))
    1.105170833
    """
    k1 = derivative(state, 0.0)
    k2 = derivative(state + 0.5 * step_s * k1, 0.5)
    k3 = derivative(state + 0.5 * step_s * k2, 0.5)
    k4 = derivative(state + step_s * k3, 1.0)
    return state + step_s / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
