"""How far a simulator's body is from a model file: forces, terminal speeds, free decays."""

import numpy as np
from scipy.optimize import brentq

from tests.support.targets.frames import Array, Body, rotation
from tests.support.targets.motion import move

STATES = 1000


def deviation(body: Body, truth: Body, nu: Array, eta: Array) -> tuple[float, float]:
    """Return the largest deviation of forces and of inertia, in shares of their scale.

    Scale of a force: the largest of its axis over the states; of an inertia: the root of the
    product of its two diagonal entries.
    """
    right = truth.force(nu, eta)
    force = np.abs(body.force(nu, eta) - right).max(0) / np.abs(right).max(0)
    size = np.sqrt(np.diag(truth.inertia))
    inertia = np.abs(body.inertia - truth.inertia) / np.outer(size, size)
    return float(force.max()), float(inertia.max())


def terminal_speed(body: Body, axis: int, thrust: float) -> float:
    """Return the speed along an axis at which a thrust is used up, level, in deep water.

    The force at rest is taken off: net buoyancy is no drag.
    """
    eta = np.array([[0.0, 0.0, 20.0, 0.0, 0.0, 0.0]])
    still = body.force(np.zeros((1, 6)), eta)[0, axis]

    def rest(speed: float) -> float:
        nu = np.zeros((1, 6))
        nu[0, axis] = speed
        return float(body.force(nu, eta)[0, axis] - still + thrust)

    return float(brentq(rest, 0.0, 50.0, xtol=1e-12, rtol=1e-12))


def decay(body: Body, nu: Array, angles: Array) -> Array:
    """Return velocities and attitude after ten seconds left alone: (6,) and (3, 3), flat."""
    _, turn, velocity = move(body, nu, rotation(angles), 0.05, 200)
    return np.hstack([velocity, turn.ravel()])
