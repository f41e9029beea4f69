"""Estimates moved within limits, their statuses, and draws from them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from auvid.hydro.identification.constrained.draws import draw_within, normal_draws
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.estimates import estimate_statuses, nearest_within
from auvid.hydro.identification.constrained.limits import damping, linear_dissipation

PLANE = tuple(Unknown(axis, term) for axis in "XM" for term in "uq")
"""X_u, X_q, M_u, M_q: dissipative where X_u M_q >= ((X_q + M_u) / 2)^2 and X_u <= 0."""


def random_covariance(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(4, 6))
    return root @ root.T


@pytest.mark.parametrize("seed", range(5))
def test_the_nearest_point_is_that_of_a_general_optimiser(seed: int) -> None:
    covariance = random_covariance(seed)
    values = np.array([-2.0, 6.0, 3.0, -1.0]) + np.random.default_rng(seed).normal(size=4)
    moved = nearest_within(PLANE, values, covariance, [damping(PLANE)], [linear_dissipation(PLANE)])
    metric = np.linalg.inv(covariance)

    def cost(x: np.ndarray) -> float:
        return 0.5 * float((x - values) @ metric @ (x - values))

    inside = [
        {"type": "ineq", "fun": lambda x: x[0] * x[3] - 0.25 * (x[1] + x[2]) ** 2},
        {"type": "ineq", "fun": lambda x: -x[0]},
        {"type": "ineq", "fun": lambda x: -x[3]},
    ]
    options = {"ftol": 1e-14, "maxiter": 1000}
    best = min(
        minimize(cost, start, method="SLSQP", constraints=inside, options=options).fun
        for start in ([-3.0, 0.0, 0.0, -3.0], [-10.0, 5.0, 5.0, -10.0])
    )
    assert moved.cost == pytest.approx(best, rel=1e-5)
    assert cost(moved.values) == pytest.approx(moved.cost, rel=1e-6)
    K = moved.values.reshape(2, 2)
    assert np.linalg.eigvalsh(K + K.T).max() < 1e-8


def test_a_value_without_a_variance_stays() -> None:
    covariance = random_covariance(1)
    covariance[0] = covariance[:, 0] = np.nan
    values = np.array([-2.0, 6.0, 3.0, -1.0])
    moved = nearest_within(PLANE, values, covariance, [], [linear_dissipation(PLANE)])
    assert moved.values[0] == pytest.approx(-2.0, abs=1e-6)
    assert moved.active
    within = nearest_within(PLANE, -np.abs(values) * [1, 0, 0, 1], covariance, [], [])
    assert within.active == ()
    assert within.cost == 0.0


def test_statuses_say_what_a_number_rests_on() -> None:
    errors = np.array([1.0, 1.0, 1.0, 1.0, np.nan])
    covariance = np.diag(np.append(errors[:4] ** 2, np.nan))
    prior = np.zeros((5, 5))
    prior[2, 2] = 0.6
    status = estimate_statuses(
        np.array([4.5, 3.5, 4.5, 9.0, 0.0]),
        errors,
        covariance,
        prior,
        np.array([False, False, False, False, True]),
        {3: "not excited"},
    )
    assert [item.status for item in status] == [
        "identified",
        "weak",
        "from the prior",
        "not excited",
        "at its bound",
    ]


def test_draws_stay_within_limits_and_keep_their_spread() -> None:
    covariance = 0.01 * random_covariance(3)
    values = np.array([-20.0, 1.0, 2.0, -15.0])
    free = draw_within(PLANE, values, covariance, [], [], count=4000, seed=5)
    assert free.moved == 0
    np.testing.assert_allclose(np.cov(free.values.T), covariance, atol=0.06 * covariance.max())
    cuts = [linear_dissipation(PLANE)]
    near = np.array([-1.0, 1.0, 1.0, -1.0])  # on the edge of what dissipates
    drawn = draw_within(PLANE, near, covariance, [damping(PLANE)], cuts, count=200, seed=5)
    assert 50 < drawn.moved < 200
    assert drawn.moved <= sum(drawn.outside.values())
    symmetric = drawn.values.reshape(-1, 2, 2) + drawn.values.reshape(-1, 2, 2).swapaxes(1, 2)
    assert np.linalg.eigvalsh(symmetric).max() < 1e-8
    again = draw_within(PLANE, near, covariance, [damping(PLANE)], cuts, count=200, seed=5)
    assert np.array_equal(again.values, drawn.values)


def test_a_draw_is_the_nearest_point_to_that_of_the_plain_normal() -> None:
    """No farther from it, and the factors that all draws share change none of them."""
    covariance = random_covariance(4)
    values = np.array([-0.4, 0.3, -0.1, -0.2])
    cuts = [linear_dissipation(PLANE)]
    plain = normal_draws(values, covariance, count=40, seed=2)
    drawn = draw_within(PLANE, values, covariance, [damping(PLANE)], cuts, count=40, seed=2)
    for one, point in zip(drawn.values, plain, strict=True):
        nearest = nearest_within(PLANE, point, covariance, [damping(PLANE)], cuts)
        # One by one, planes end where an eigenvalue is -1e-11: a tangent moves by its root.
        np.testing.assert_allclose(one, nearest.values, atol=1e-5)
        here, there = one - point, nearest.values - point
        distance = here @ np.linalg.solve(covariance, here)
        assert distance <= there @ np.linalg.solve(covariance, there) + 1e-9
        assert np.linalg.eigvalsh(one.reshape(2, 2) + one.reshape(2, 2).T).max() < 1e-9
