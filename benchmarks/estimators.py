"""Estimators against SciPy, HiGHS, Clarabel, statsmodels and pysindy: the same problem.

    python -m benchmarks.estimators

Each row: seconds of both, their ratio, and how far the two answers are apart, as the
largest difference of a coefficient in parts of the largest one (each in units of its
column's length). Both sides take turns, the best of three turns counts. Output error is
minimised by `scipy.optimize.least_squares` over the same compiled motion with the
differences that SciPy takes of it; there the difference is in standard errors, and the
gain of log-likelihood stands beside it. One thread.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import json
import time
import warnings
from collections.abc import Callable
from typing import Any

import cvxpy
import numpy as np
import statsmodels.api as sm  # type: ignore[import-untyped]
from pysindy import FROLS  # type: ignore[import-untyped]
from scipy.optimize import least_squares as scipy_least_squares
from scipy.optimize import linprog

from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, basis_rows, needs_propeller_speed
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.dynamics.viscous.structures import symmetric
from auvid.hydro.identification.constrained.equations import ForceEquations, viscous_equations
from auvid.hydro.identification.constrained.fit import fit_within
from auvid.hydro.identification.constrained.limits import damping, dissipation, envelope
from auvid.hydro.identification.maximum_likelihood.likelihood import (
    BIASES,
    Likelihood,
    NoiseModel,
)
from auvid.hydro.identification.maximum_likelihood.output_error import WINDOW_S, fit_output_error
from auvid.hydro.identification.maximum_likelihood.parameters import UnknownParameters
from auvid.hydro.identification.maximum_likelihood.windows import cut_windows
from auvid.hydro.identification.regression.error_functions import (
    HUBER_THRESHOLD,
    huber,
    least_moduli,
)
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.regression.standard_errors import hac_covariance
from auvid.hydro.identification.selection.axis_terms import pursue
from benchmarks.coverage import recorded_legs, twin
from benchmarks.synthesis import rich_motion

TERMS = tuple(term for term in BASIS_TERMS if not needs_propeller_speed(term))
TURNS, SAMPLES, LAGS = 3, 5000, 50
CANDIDATES = ("u", "v", "w", "p", "q", "r", "v*|v|", "r*|r|", "u*r", "p*q")
SPARSE = ("v", "v*|v|", "r")
PUSH = 40.0
"""Damping of the wrong sign in roll and pitch [N m s/rad]."""
LEG, SEED = "depth_2600", 1
Answer = Callable[[], Array]
Row = dict[str, float]


def row(ours: Answer, theirs: Answer, scale: Array) -> Row:
    """Return seconds of both and their difference; scale (k,): lengths of columns."""
    times, answers = [np.inf, np.inf], [np.empty(0), np.empty(0)]
    for _ in range(TURNS):
        for place, run in enumerate((ours, theirs)):
            begin = time.perf_counter()
            answers[place] = run()
            times[place] = min(times[place], time.perf_counter() - begin)
    own, other = answers
    difference = np.max(np.abs(own - other) * scale) / np.max(np.abs(other) * scale)
    return {
        "auvid_s": times[0],
        "other_s": times[1],
        "ratio": times[1] / times[0],
        "difference": float(difference),
    }


def error_functions(columns: Array, force: Array) -> dict[str, Row]:
    """Return sum of moduli, Huber and the covariance of correlated errors, one axis."""
    design = columns.T
    length = np.linalg.norm(design, axis=0)
    n, k = design.shape

    def by_highs() -> Array:
        # min sum(p + m), A x + p - m = b, as it is written down.
        from scipy.sparse import csc_matrix, eye, hstack

        equal = hstack([csc_matrix(design / length), eye(n), -eye(n)]).tocsc()
        cost = np.concatenate([np.zeros(k), np.ones(2 * n)])
        spans = [(None, None)] * k + [(0.0, None)] * (2 * n)
        answer = linprog(cost, A_eq=equal, b_eq=force, bounds=spans, method="highs")
        return np.asarray(answer.x[:k] / length)

    def by_statsmodels() -> Array:
        model = sm.RLM(force, design, M=sm.robust.norms.HuberT(t=HUBER_THRESHOLD))
        return np.asarray(model.fit(tol=1e-12, maxiter=500, conv="coefs").params)

    fit = sm.OLS(force, design).fit()
    scores, bread = design * fit.resid[:, None], np.linalg.inv(design.T @ design)

    def covariance_by_statsmodels() -> Array:
        robust = fit.get_robustcov_results("HAC", maxlags=LAGS, use_correction=True)
        return np.asarray(robust.cov_params()).ravel()

    return {
        "sum_of_moduli_highs": row(lambda: least_moduli(columns, force), by_highs, length),
        "huber_statsmodels": row(
            lambda: huber(columns, force).coefficients, by_statsmodels, length
        ),
        "hac_covariance_statsmodels": row(
            lambda: hac_covariance(scores, bread, lags=LAGS).ravel(),
            covariance_by_statsmodels,
            np.outer(length, length).ravel(),
        ),
    }


def within_limits(nu: Array, force: Array) -> dict[str, Row]:
    """Return fits of a symmetric model by bounds and by power, from samples on.

    Roll and pitch get a push along their own velocity, so that limits hold them back.
    """
    force = force.copy()
    force[:, 3:5] += PUSH * nu[3:5].T
    columns = basis_rows(nu, None, TERMS)
    equations = viscous_equations(symmetric(quadratic=True), trim=True)
    unknowns = equations.unknowns
    signs, power = damping(unknowns), dissipation(unknowns, envelope(nu.min(1), nu.max(1)))
    noise = fit_within(TriangularFactor.empty(TERMS).update(columns, force), equations).noise
    A, b = _dense(columns, force, equations)
    weight = np.repeat(1.0 / noise, nu.shape[1])
    A, b = A * weight[:, None], b * weight
    length = np.linalg.norm(A, axis=0)

    def by_clarabel(G: Array) -> Answer:
        def solve() -> Array:
            Q, R = np.linalg.qr(A / length)
            y = cvxpy.Variable(len(length))
            problem = cvxpy.Problem(
                cvxpy.Minimize(cvxpy.sum_squares(R @ y - Q.T @ b)), [(G / length) @ y <= 0.0]
            )
            gap = {"tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12, "tol_feas": 1e-12}
            problem.solve(solver=cvxpy.CLARABEL, max_iter=500, **gap)
            return np.asarray(y.value / length)

        return solve

    def by_factor(limits: object) -> Answer:
        def solve() -> Array:
            factor = TriangularFactor.empty(TERMS).update(columns, force)
            return fit_within(factor, equations, limits=[limits]).values  # type: ignore[list-item]

        return solve

    return {
        "bounds_clarabel": row(by_factor(signs), by_clarabel(signs.rows), length),
        "power_clarabel": row(by_factor(power), by_clarabel(power.rows), length),
    }


def _dense(columns: Array, force: Array, equations: ForceEquations) -> tuple[Array, Array]:
    """Return all samples of all axes as one problem: A (6 n, p), b (6 n,)."""
    place = dict(zip(TERMS, columns, strict=True))
    place["constant"] = np.ones(columns.shape[1])
    blocks = []
    for axis in AXES:
        names = equations.columns_of(axis)
        blocks.append(np.array([place[n] for n in names]).T @ equations.weights(axis, names))
    return np.vstack(blocks), force.T.ravel()


def sparse(nu: Array, force: Array) -> dict[str, Row]:
    """Return the pursuit of three terms out of ten."""
    columns = basis_rows(nu, None, CANDIDATES)
    truth = np.array([-30.0, -60.0, 8.0]) @ basis_rows(nu, None, SPARSE)
    sway = force.copy()
    sway[:, 1] = truth + 0.01 * force[:, 1]

    def ours() -> Array:
        factor = TriangularFactor.empty(CANDIDATES).update(columns, sway)
        chosen = pursue(factor, "Y", CANDIDATES, always=(), most=len(SPARSE)).order
        values = dict(zip(chosen, solve_axis(factor, "Y", chosen).solution, strict=True))
        return np.array([values.get(term, 0.0) for term in CANDIDATES])

    def by_pysindy() -> Array:
        forward = FROLS(normalize_columns=True, max_iter=len(SPARSE))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.asarray(forward.fit(columns.T, sway[:, 1:2]).coef_[0])

    return {"sparse_pysindy": row(ours, by_pysindy, np.linalg.norm(columns, axis=1))}


def output_error() -> dict[str, Row]:
    """Return output error on a leg of the VT 690 twin, sensor noise known, from 5 % off.

    Unknowns: the linear damping of all axes, six biases, ten of the start a window.
    """
    plan, simulated = twin("default", "linear")
    recorded, noise, _ = recorded_legs(plan, simulated, SEED)
    legs = [leg for leg in recorded if leg.name == LEG]
    model = simulated.truth
    assert isinstance(model, IdentifiedModel)
    own = dict(zip(AXES, "uvwpqr", strict=True))
    terms = {axis: (own[axis],) for axis in AXES}
    fixed = {
        axis: {t: v for t, v in row.items() if t != own[axis]}
        for axis, row in model.coefficients.items()
    }
    parameters = UnknownParameters(simulated.vehicle, terms, fixed=fixed)
    start = np.array([0.95 * model.coefficients[axis][own[axis]] for axis in AXES])
    sensor_noise = NoiseModel(noise.sensor_sd)
    windows, _ = cut_windows(legs, length_s=WINDOW_S)
    likelihood = Likelihood(legs, windows, parameters, False, np.ones(10))
    size = likelihood.unknowns
    first = np.zeros((len(legs), BIASES))
    starts = likelihood.first_starts(first)

    def errors(values: Array) -> Array:
        runs = likelihood.run(
            values[:size], values[size:].reshape(starts.shape), sensor_noise, sensitive=False
        )
        return np.concatenate([run.errors / np.sqrt(run.variances) for run in runs])

    def ours() -> Array:
        fit = fit_output_error(
            legs, parameters, start, sensor_sd=sensor_noise.sensor_sd, tolerance=1e-6
        )
        white = np.sqrt(np.diag(fit.information_covariance))
        reached[:] = [-fit.log_likelihood[-1], white]
        return fit.theta

    def by_scipy() -> Array:
        begin = np.concatenate([start, first.ravel(), starts.ravel()])
        solution = scipy_least_squares(errors, begin, x_scale="jac", method="lm", xtol=1e-12)
        inverse = np.linalg.inv(solution.jac.T @ solution.jac)[: len(start), : len(start)]
        other[:] = [0.5 * float(solution.fun @ solution.fun), np.sqrt(np.diag(inverse))]
        return np.asarray(solution.x[: len(start)])

    reached: list[Any] = []
    other: list[Any] = []
    own_values = ours()  # compiles
    figures = row(ours, by_scipy, 1.0 / reached[1])
    del figures["difference"]
    differences = np.abs(own_values - by_scipy()) / other[1]
    constants = likelihood.evaluate(
        np.concatenate([start, first.ravel()]), starts, sensor_noise, sensitive=False
    )[1]
    sure = 0.5 * sum(float(np.sum(np.log(2.0 * np.pi * run.variances))) for run in constants)
    return {
        "output_error_scipy": {
            **figures,
            "unknowns": float(size + starts.size),
            "largest_difference_in_standard_errors": float(differences.max()),
            "largest_ratio_of_standard_errors": float((reached[1] / other[1]).max()),
            "log_likelihood_above_scipy": other[0] + sure - reached[0],
        }
    }


def main() -> None:
    """Print the rows."""
    nu, _, force = rich_motion(SAMPLES)
    columns = basis_rows(nu, None, ("v", "v*|v|", "u*v", "u*r", "r", "v*|r|"))
    rows = {
        **error_functions(columns, force[:, 1]),
        **within_limits(nu, force),
        **sparse(nu, force),
        **output_error(),
    }
    digits = {name: {k: float(f"{v:.4g}") for k, v in r.items()} for name, r in rows.items()}
    print(json.dumps(digits, indent=2))


if __name__ == "__main__":
    main()
