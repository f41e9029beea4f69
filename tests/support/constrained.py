"""Data with a known truth for fits within limits, and CVXPY's answer to the same."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, basis_rows, needs_propeller_speed
from auvid.hydro.identification.constrained.draws import joint_covariance
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    ACTUATOR_RATES,
    Unknown,
    extra_rows,
)
from auvid.hydro.identification.regression.assumed_figures import FORM, UNSTEADY, total_error
from auvid.hydro.identification.regression.least_squares import TriangularFactor
from auvid.stages.card_errors import axis_errors

TERMS = tuple(term for term in BASIS_TERMS if not needs_propeller_speed(term))
STEP_S = 0.02
DAMPING = np.diag([-57.0, -107.0, -70.0, 1.0, 0.5, -4.6])
DAMPING[1, 5], DAMPING[5, 1], DAMPING[3, 1], DAMPING[4, 0] = 2.0, 3.0, 17.0, -6.6
TRIM = np.array([0.2, -0.1, -4.5, 0.1, -0.4, 0.2])


class Dive:
    """Smooth motion with a linear truth whose roll and pitch damping is positive.

    Its added mass differs from the file's by `change` (6, 6), its actuators lag `lag_s`
    behind the command.
    """

    def __init__(self, n=1500, *, seed=0, noise=0.5, change=None, lag_s=0.0, size=None):
        random = np.random.default_rng(seed)
        t = STEP_S * np.arange(n)
        waves = random.normal(size=(6, 6))
        rates = random.uniform(0.3, 2.0, size=(6, 6))
        phases = random.uniform(0.0, 6.28, size=(6, 6))
        angle = rates[..., None] * t + phases[..., None]
        size = np.array([0.2, 0.1, 0.1, 0.05, 0.05, 0.2]) if size is None else size
        self.nu = (np.sum(waves[..., None] * np.sin(angle), axis=1) * size[:, None]).T
        self.nu_dot = (
            np.sum(waves[..., None] * rates[..., None] * np.cos(angle), axis=1) * size[:, None]
        ).T
        commands = 3.0 * np.sin(2.0 * np.pi * random.uniform(0.05, 0.5, size=6) * t[:, None])
        self.actuators = commands
        M = np.zeros((6, 6)) if change is None else change
        self.force = self.nu @ DAMPING.T + self.nu_dot @ M.T + coriolis_force(M, self.nu)
        self.force -= lag_s * np.gradient(commands, STEP_S, axis=0)
        self.force += noise * random.normal(size=(n, 6)) + np.array(
            [0.2, -0.1, -4.5, 0.1, -0.4, 0.2]
        )

    def factor(self, rows=slice(None)):
        columns = np.vstack(
            [
                basis_rows(self.nu.T, None, TERMS),
                extra_rows(self.nu_dot, self.actuators, step_s=STEP_S),
            ]
        )
        empty = TriangularFactor.empty((*TERMS, *ACCELERATIONS, *ACTUATOR_RATES))
        return empty.update(columns[:, rows], self.force[rows])


def design(dive, equations):
    """Return the dense problem of all samples: A (6 n, p), b (6 n,)."""
    rows = basis_rows(dive.nu.T, None, TERMS)
    extra = extra_rows(dive.nu_dot, dive.actuators, step_s=STEP_S)
    column = dict(zip((*TERMS, *ACCELERATIONS, *ACTUATOR_RATES), [*rows, *extra], strict=True))
    column["constant"] = np.ones(len(dive.nu))
    blocks = []
    for axis in AXES:
        names = equations.columns_of(axis)
        blocks.append(np.array([column[name] for name in names]).T @ equations.weights(axis, names))
    return np.vstack(blocks), dive.force.T.ravel()


def oracle(dive, equations, noise, constrain=lambda x: [], prior=None, tolerance=1e-12):
    """Return CVXPY's minimum with Clarabel, in units of each column's length."""
    import cvxpy  # here, since it takes seconds

    A, b = design(dive, equations)
    weight = np.repeat(1.0 / np.asarray(noise), len(dive.nu))
    A, b = A * weight[:, None], b * weight
    if prior is not None:
        A, b = np.vstack([A, prior[:, :-1]]), np.append(b, prior[:, -1])
    scale = np.linalg.norm(A, axis=0)
    Q, R = np.linalg.qr(A / scale)
    y = cvxpy.Variable(len(scale))
    x = cvxpy.multiply(1.0 / scale, y)
    problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(R @ y - Q.T @ b)), constrain(x))
    solve(problem, tolerance)
    return np.asarray(y.value) / scale, scale


def solve(problem, tolerance=1e-12):
    """Solve by Clarabel to its gap and feasibility of `tolerance`."""
    import cvxpy  # here, since it takes seconds

    problem.solve(
        solver=cvxpy.CLARABEL,
        tol_gap_abs=tolerance,
        tol_gap_rel=tolerance,
        tol_feas=tolerance,
        max_iter=500,
    )
    assert problem.status == cvxpy.OPTIMAL


def index(unknowns, axis, term):
    return [str(u) for u in unknowns].index(f"{axis}_{term}")


__all__ = ["AXES", "VELOCITIES", "Dive", "design", "index", "oracle", "solve"]


def drawn_as_printed(card: ModelCard) -> int:
    """Assert that draws of each free coefficient have its printed error; return how many.

    That is of noise and assumed figures, not of what the form lacks (decision 0083) or an
    unsteady force leans (0093); a number without an error is not drawn from data.
    """
    unknowns = [Unknown(a, term) for a, part in card.axes.items() for term in part.covariance.terms]
    items = {Unknown(a, item.term): item for a, part in card.axes.items() for item in part.terms}
    covariance = joint_covariance(axis_errors(card, unknowns), len(unknowns))
    assert np.linalg.eigvalsh(covariance).min(initial=0.0) >= -1e-9 * np.trace(covariance)
    count = 0
    for item, variance in zip((items[u] for u in unknowns), np.diag(covariance), strict=True):
        if item.value is not None and item.standard_error:
            drawn = {
                name: x for name, x in item.assumed_shifts.items() if name not in (FORM, UNSTEADY)
            }
            total = total_error(item.standard_error, drawn)
            assert np.sqrt(variance) == pytest.approx(total, rel=1e-6), item
            count += 1
    return count
