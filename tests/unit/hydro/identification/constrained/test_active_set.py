"""The active set method against Clarabel and scipy, and contradictions."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.constrained.active_set import InequalityRows, minimise
from tests.support.constrained import solve


def rows_of(G, h):
    return InequalityRows(G, h, lambda i: f"row {i}")


@pytest.mark.parametrize("seed", range(8))
def test_the_minimum_is_that_of_clarabel(seed):
    import cvxpy  # here, since it takes seconds

    random = np.random.default_rng(seed)
    p, c = 12, 400
    A = random.normal(size=(60, p)) * 10.0 ** random.uniform(-3, 3, size=p)
    b = random.normal(size=60)
    G = random.normal(size=(c, p)) * np.linalg.norm(A, axis=0)
    h = random.uniform(0.0, 0.5, size=c)
    best = minimise(A, b, [rows_of(G, h)])
    scale = np.linalg.norm(A, axis=0)
    y = cvxpy.Variable(p)
    problem = cvxpy.Problem(
        cvxpy.Minimize(cvxpy.sum_squares((A / scale) @ y - b)), [(G / scale) @ y <= h]
    )
    solve(problem)
    assert best.active
    np.testing.assert_allclose(best.x * scale, y.value, atol=1e-7 * np.abs(y.value).max())
    # Stationary: the gradient is a sum of active rows with positive multipliers.
    gradient = 2.0 * A.T @ (A @ best.x - b)
    np.testing.assert_allclose(gradient / scale, -(best.multipliers @ best.rows) / scale, atol=1e-9)
    assert np.all(best.multipliers > 0.0)
    assert np.all(G @ best.x <= h + 1e-9 * np.abs(G * best.x).sum(axis=1))


@pytest.mark.parametrize("seed", range(4))
def test_bounds_give_the_minimum_of_bounded_least_squares(seed):
    random = np.random.default_rng(seed)
    A, b = random.normal(size=(80, 30)), random.normal(size=80)
    best = minimise(A, b, [rows_of(np.eye(30), np.full(30, 0.02))])
    oracle = lsq_linear(A, b, bounds=(-np.inf, 0.02), method="bvls", tol=1e-15)
    np.testing.assert_allclose(best.x, oracle.x, atol=1e-9)


def test_cuts_are_taken_until_none_remain():
    # The disc |x| <= 1 by its tangents: the minimum of |x - (3, 4)| is (.6, .8).
    def tangent(x):
        length = np.linalg.norm(x)
        rows = np.array([x / length]) if length > 1.0 + 1e-12 else np.zeros((0, 2))
        return InequalityRows(rows, np.ones(len(rows)), lambda _: "disc")

    best = minimise(np.eye(2), np.array([3.0, 4.0]), cuts=[tangent])
    np.testing.assert_allclose(best.x, [0.6, 0.8], atol=1e-7)
    assert set(best.active) == {"disc"}


def test_repeated_and_dependent_rows_do_no_harm():
    G = np.vstack([np.eye(3), np.eye(3), [[1.0, 1.0, 1.0]] * 2])
    h = np.array([0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    best = minimise(np.eye(3), np.array([2.0, 2.0, 2.0]), [rows_of(G, h)])
    np.testing.assert_allclose(best.x, [0.0, 0.5, 0.5], atol=1e-12)


def test_contradictions_are_named():
    G = np.array([[1.0, 0.0], [-1.0, 0.0]])
    with pytest.raises(DataError, match=r"contradict.*row 0"):
        minimise(np.eye(2), np.array([5.0, 1.0]), [rows_of(G, np.array([1.0, -2.0]))])
    with pytest.raises(DataError, match="cannot be met"):
        minimise(np.eye(2), np.zeros(2), [rows_of(np.zeros((1, 2)), np.array([-1.0]))])
