"""Motions of a body by the classical Runge-Kutta method, attitude as a rotation matrix."""

from collections.abc import Callable

import numpy as np

from tests.support.targets.frames import Array, Body, skew


def euler(turn: Array) -> Array:
    """Return phi, theta, psi of a rotation matrix (3, 3), body to NED: Fossen (2.41)."""
    return np.array(
        [
            np.arctan2(turn[2, 1], turn[2, 2]),
            -np.arcsin(np.clip(turn[2, 0], -1, 1)),
            np.arctan2(turn[1, 0], turn[0, 0]),
        ]
    )


def move(
    body: Body,
    nu: Array,
    turn: Array,
    step_s: float,
    steps: int,
    push: Callable[[float, Array], Array] = lambda t, turn: np.zeros(6),
) -> tuple[Array, Array, Array]:
    """Return position (3,), rotation (3, 3) and velocity (6,) after steps of step_s seconds.

    push(t_s, rotation) is the force (6,) in body axes besides that of the body.
    """
    state = np.hstack([np.zeros(3), turn.ravel(), nu])

    def rate(t: float, y: Array) -> Array:
        r, v = y[3:12].reshape(3, 3), y[12:]
        eta = np.hstack([y[:3], euler(r)])
        acceleration = body.derivative(v[None], eta[None], push(t, r))[0]
        return np.hstack([r @ v[:3], (r @ skew(v[3:])).ravel(), acceleration])

    for k in range(steps):
        t = k * step_s
        k1 = rate(t, state)
        k2 = rate(t + step_s / 2, state + step_s / 2 * k1)
        k3 = rate(t + step_s / 2, state + step_s / 2 * k2)
        k4 = rate(t + step_s, state + step_s * k3)
        state = state + step_s / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state[:3], state[3:12].reshape(3, 3), state[12:]
