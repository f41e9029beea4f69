"""How far a simulator's body is from a model file: forces, terminal speeds, free decays."""

import re

import numpy as np
from scipy.optimize import brentq

from auvid.data_schemas.records.model_file import ModelFile
from tests.support.targets.frames import Array, Body, coriolis, rotation, shift
from tests.support.targets.models import changed
from tests.support.targets.motion import move
from tests.support.targets.reference import reference

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
    """Return velocities and attitude after four seconds left alone: (6,) and (3, 3), flat."""
    _, turn, velocity = move(body, nu, rotation(angles), 0.05, 80)
    return np.hstack([velocity, turn.ravel()])


def moved(body: Body, arm: Array) -> Body:
    """Return a body about the model's origin; `arm` leads from there to its own origin."""
    to_own = shift(arm)

    def force(nu: Array, eta: Array) -> Array:
        return body.force(nu @ to_own.T, eta) @ to_own

    return Body(to_own.T @ body.inertia @ to_own, force)


def loss(
    body: Body, model: ModelFile, *, neutral: bool = False, upright: tuple[int, ...] = (2,)
) -> Array:
    """Return the RMS force (6,) that a body lacks of a model over its flown range.

    As export/losses.py states it: C(nu) nu and viscous force, and the lost inertia times
    the acceleration M^-1 tau_viscous; 4096 velocities evenly spread by seed 0. Weight and
    buoyancy do not count, but constant forces in them do where the body is level: on the
    axes `upright`. `neutral` bodies have none by construction.
    """
    ranges = [model.validity[name] for name in "uvwpqr"]
    low, high = [r.low for r in ranges], [r.high for r in ranges]
    nu = np.random.default_rng(0).uniform(low, high, (4096, 6))
    eta = np.broadcast_to([0.0, 0.0, 20.0, 0.0, 0.0, 0.0], nu.shape)
    truth = reference(changed(model, weight_N=0.0, buoyancy_N=0.0))
    exact = truth.force(nu, eta)
    acceleration = (exact + coriolis(truth.inertia, nu)) @ np.linalg.inv(truth.inertia).T
    still = body.force(np.zeros((1, 6)), eta[:1])
    here = body.force(nu, eta) - still
    if not neutral:
        bare = reference(model.model_copy(update={"coefficients": []}))
        level = bare.force(np.zeros((1, 6)), eta[:1])
        here[:, upright] += (still - level)[0, upright]
    error = exact - here - acceleration @ (truth.inertia - body.inertia).T
    return np.sqrt((error**2).mean(0))


def printed_loss(readme: str) -> Array:
    """Return the RMS force (6,) that a README prints as lost, all together; zeros for none."""
    row = re.search(r"^\| \*\*all together\*\* \|(.*)\|$", readme, re.MULTILINE)
    return np.array([float(cell) for cell in row[1].split("|")[1:]] if row else [0.0] * 6)
