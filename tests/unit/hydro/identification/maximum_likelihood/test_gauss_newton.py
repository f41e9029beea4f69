"""Gauss-Newton: local unknowns, bounds and damping against dense and bounded solvers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.maximum_likelihood.gauss_newton import (
    Evaluation,
    NormalEquations,
    bounded_step,
    maximise,
    solve_each,
    solve_scaled,
    with_secants,
)


def system(seed: int) -> tuple[np.ndarray, np.ndarray, NormalEquations]:
    """A linear least-squares problem with 4 common unknowns and 2 windows of 3 local ones."""
    random = np.random.default_rng(seed)
    design, target = np.zeros((60, 10)), random.standard_normal(60)
    design[:, :4] = random.standard_normal((60, 4)) * [1.0, 1e3, 1e-4, 1.0]
    design[:30, 4:7], design[30:, 7:] = random.standard_normal((2, 30, 3))
    N, b = design.T @ design, design.T @ target
    parts = (slice(4, 7), slice(7, 10))
    equations = NormalEquations(
        N[:4, :4],
        b[:4],
        tuple(N[p, p] for p in parts),
        tuple(N[p, :4] for p in parts),
        tuple(b[p] for p in parts),
    )
    return design, target, equations


def test_local_unknowns_are_taken_out_exactly() -> None:
    design, target, equations = system(1)
    dense = np.linalg.lstsq(design, target, rcond=None)[0]
    matrix, vector = equations.reduced()
    step = solve_scaled(matrix, vector)
    np.testing.assert_allclose(step, dense[:4], rtol=1e-9)
    np.testing.assert_allclose(equations.local_steps(step).ravel(), dense[4:], rtol=1e-9)


@pytest.mark.parametrize("rows_there", [4, 2])
def test_many_systems_are_solved_as_one(rows_there: int) -> None:
    """Also those of which one has a direction without information."""
    random = np.random.default_rng(2)
    rows = random.standard_normal((3, 6, 4)) * [1.0, 1e3, 1e-3, 1.0]
    rows[1, rows_there:] = 0.0
    matrices, rights = rows.swapaxes(1, 2) @ rows, random.standard_normal((3, 4, 2))
    one_by_one = [solve_scaled(*each) for each in zip(matrices, rights, strict=True)]
    np.testing.assert_allclose(solve_each(matrices, rights), one_by_one, rtol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_bounds_hold_as_in_bounded_least_squares(seed: int) -> None:
    design, target, equations = system(seed)
    free = np.linalg.lstsq(design, target, rcond=None)[0]
    upper = np.full(10, np.inf)
    upper[0] = free[0] - 0.1  # one bound that bites
    oracle = lsq_linear(design, target, (-np.inf, upper), method="bvls", tol=1e-14).x
    low = np.full(4, -np.inf)
    step, fixed, _ = bounded_step(equations, np.zeros(4), low, upper[:4], 0.0)
    np.testing.assert_allclose(step, oracle[:4], rtol=1e-7)
    assert fixed.tolist() == [True, False, False, False]


def test_it_descends_a_curved_valley_and_says_that_it_converged() -> None:
    def rosenbrock(x: np.ndarray, local: np.ndarray, sensitive: bool) -> Evaluation:
        e = -np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
        J = np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])
        return Evaluation(0.5 * float(e @ e), NormalEquations(J.T @ J, J.T @ e))

    none = np.full(2, np.inf)
    start = np.array([-1.2, 1.0])
    optimum = maximise(
        rosenbrock, start, np.zeros((0, 1)), lower=-none, upper=none, most_steps=60, tolerance=1e-9
    )
    assert optimum.word == "converged"
    np.testing.assert_allclose(optimum.common, [1.0, 1.0], atol=1e-6)
    few = maximise(rosenbrock, start, np.zeros((0, 1)), lower=-none, upper=none, most_steps=2)
    assert few.word == "no convergence"


def test_secants_give_a_parabola_its_curvature() -> None:
    random = np.random.default_rng(3)
    root = random.standard_normal((4, 4))
    curvature = root @ root.T + np.eye(4)
    steps = list(np.eye(4))
    matrix = with_secants(3.0 * np.eye(4), [(s, curvature @ s) for s in steps])
    np.testing.assert_allclose(matrix @ steps[-1], curvature @ steps[-1], rtol=1e-12)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
    bent = with_secants(matrix, [(steps[0], -curvature @ steps[0])])
    assert np.linalg.eigvalsh(bent).min() > 0.0


def test_no_step_is_longer_than_its_reach() -> None:
    points = []

    def evaluate(x: np.ndarray, local: np.ndarray, sensitive: bool) -> Evaluation:
        points.append(x[0])
        return Evaluation(0.5 * x[0] ** 2, NormalEquations(np.eye(1), -x))

    none = np.full(1, np.inf)
    optimum = maximise(
        evaluate,
        np.array([5.0]),
        np.zeros((0, 1)),
        lower=-none,
        upper=none,
        most_steps=20,
        reach=(np.full(1, -2.0), np.full(1, 2.0)),
    )
    assert optimum.word == "converged"
    assert not optimum.at_bound.any()
    assert np.abs(np.diff(points)).max() <= 2.0


def test_a_step_that_promises_too_little_is_not_taken() -> None:
    def evaluate(x: np.ndarray, local: np.ndarray, sensitive: bool) -> Evaluation:
        return Evaluation(0.5 * x[0] ** 2, NormalEquations(np.eye(1), -x))

    none = np.full(1, np.inf)
    for start, steps in ((0.3, 0), (0.4, 1)):  # a gain of .045 and of .08
        optimum = maximise(
            evaluate, np.array([start]), np.zeros((0, 1)), lower=-none, upper=none,
            most_steps=5, least_gain=0.05,
        )  # fmt: skip
        assert optimum.word == "converged"
        assert len(optimum.objectives) == 1 + steps


def test_a_step_moves_unknowns_by_its_own_map() -> None:
    # Steps of exp(x): from 0 to the optimum at 1 in one, where x itself would take several.
    def evaluate(x: np.ndarray, local: np.ndarray, sensitive: bool) -> Evaluation:
        off = np.exp(x[0]) - np.e
        return Evaluation(0.5 * off**2, NormalEquations(np.eye(1), np.array([-off])))

    none = np.full(1, np.inf)
    optimum = maximise(
        evaluate, np.zeros(1), np.zeros((0, 1)), lower=-none, upper=none, most_steps=5,
        move=lambda x, step: np.log(np.exp(x) + step),
    )  # fmt: skip
    assert optimum.objectives[1] < 1e-6


def test_a_start_that_diverges_is_refused() -> None:
    none = np.full(1, np.inf)
    with pytest.raises(DataError, match="diverges at the starting values"):
        maximise(
            lambda x, y, s: Evaluation(np.inf, None), np.zeros(1), np.zeros((0, 1)),
            lower=-none, upper=none, most_steps=3,
        )  # fmt: skip


def test_a_long_way_to_a_bound_is_not_the_end() -> None:
    """A full step that a bound stops, and that loses, is shortened: -9 is no optimum of y^4."""

    def evaluate(x: np.ndarray, local: np.ndarray, sensitive: bool) -> Evaluation:
        # The equations promise too much: of a curvature 100 times too small.
        return Evaluation(
            0.5 * (x[0] + 5.0) ** 2 + 1e3 * (x[0] > -1.0),
            NormalEquations(np.full((1, 1), 1e-2), -(x + 5.0)),
        )

    optimum = maximise(
        evaluate, np.array([-9.0]), np.zeros((0, 1)), lower=np.full(1, -np.inf),
        upper=np.zeros(1), most_steps=60,
    )  # fmt: skip
    assert optimum.common[0] == pytest.approx(-5.0, abs=0.5)


def test_local_unknowns_count_in_what_a_step_promises() -> None:
    """y = x + z, z - x near 0 twice: the common part of the step alone promises a loss."""
    design = np.array([[1.0, 1.0], [0.1, 1.0]])
    target = np.array([1.0, 2.0])

    def evaluate(x: np.ndarray, local: np.ndarray, sensitive: bool) -> Evaluation:
        e = target - design @ np.array([x[0], local[0, 0]])
        N, b = design.T @ design, design.T @ e
        return Evaluation(
            0.5 * float(e @ e),
            NormalEquations(N[:1, :1], b[:1], (N[1:, 1:],), (N[1:, :1],), (b[1:],)),
        )

    none = np.full(1, np.inf)
    optimum = maximise(
        evaluate, np.zeros(1), np.zeros((1, 1)), lower=-none, upper=none, most_steps=30,
        tolerance=1e-6,
    )  # fmt: skip
    assert [optimum.common[0], optimum.local[0, 0]] == pytest.approx(
        np.linalg.solve(design, target).tolist(), rel=1e-3
    )
