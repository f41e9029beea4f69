"""Regulators and observers against scipy's algebraic solution and against their
defining equations.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.control.observer import (
    augmented,
    disturbance_target,
    feed_forward_gain,
    kalman_gain,
    placed_gain,
)
from auvid.hydro.control.riccati import (
    algebraic_riccati,
    backward_riccati,
    closed_loop_eigenvalues,
    frozen_riccati,
    regulator_gain,
    require_controllable,
    stability_margins,
    uncontrollable_states,
)
from tests.support.dynamics_oracles import observer_eigenvalues

RANDOM = np.random.default_rng(3)
A = RANDOM.normal(size=(12, 12))
B = RANDOM.normal(size=(12, 4))
Q, R = np.diag(RANDOM.uniform(0.5, 2.0, 12)), np.diag([1.0, 2.0, 0.5, 1.0])
P = solve_continuous_are(A, B, Q, R)


def still(matrix: np.ndarray, samples: int) -> np.ndarray:
    return np.broadcast_to(matrix, (samples, *matrix.shape))


def test_backward_riccati_of_a_time_invariant_system_is_the_algebraic_solution() -> None:
    size = np.abs(P).max()
    assert (
        np.abs(backward_riccati(still(A, 30), still(B, 30), Q, R, step_s=0.05) - P).max() / size
        < 1e-8
    )
    assert np.abs(frozen_riccati(still(A, 2), still(B, 2), Q, R) - P).max() / size < 1e-8
    from_zero = backward_riccati(
        still(A, 400), still(B, 400), Q, R, step_s=0.05, end=np.zeros((12, 12))
    )
    assert np.abs(from_zero[0] - P).max() / size < 1e-8


def test_backward_riccati_satisfies_its_equation_where_the_system_varies() -> None:
    t = np.linspace(0.0, 2.0, 801)
    varying = A[None] * (1.0 + 0.3 * np.sin(3.0 * t))[:, None, None]
    solution = backward_riccati(varying, still(B, len(t)), Q, R, step_s=t[1])
    slope = (solution[2:] - solution[:-2]) / (2.0 * t[1])
    a, p = varying[1:-1], solution[1:-1]
    right = np.swapaxes(a, 1, 2) @ p + p @ a + Q - p @ B @ np.linalg.solve(R, B.T) @ p
    assert np.abs(slope + right).max() / np.abs(Q).max() < 1e-2  # central difference over 2.5 ms


def test_margins_of_a_regulator_with_diagonal_weights() -> None:
    """Also where inputs have units of their own, as newtons and radians."""
    for weights in (np.ones(4), np.array([1e-4, 10.0, 1.0, 300.0])):
        gain = regulator_gain(B, algebraic_riccati(A, B, Q, np.diag(weights)), np.diag(weights))
        low, high, phase = stability_margins(A, B, gain, r=weights)
        assert low == pytest.approx(0.5, abs=1e-3)
        assert high > 100.0
        assert phase >= np.radians(59.9)


def test_states_out_of_reach_are_named() -> None:
    a, b = A.copy(), B.copy()
    a[3], b[3] = 0.0, 0.0
    a[3, 3] = 0.5
    assert uncontrollable_states(A, B) == []
    assert uncontrollable_states(a, b) == ["p"]
    with pytest.raises(PipelineError, match=r"not controllable at 3 s.*'p'"):
        require_controllable(a, b, where="at 3 s")
    with pytest.raises(PipelineError, match="no stabilising solution"):
        algebraic_riccati(a, b, Q, R)


def test_filter_gain_stays_at_its_algebraic_value_and_is_stable() -> None:
    along = kalman_gain(still(A, 20), np.eye(18), np.eye(12), step_s=0.05)
    at_once = kalman_gain(still(A, 1), np.eye(18), np.eye(12))
    assert np.abs(along - at_once[0]).max() < 1e-8
    assert observer_eigenvalues(still(A, 1), at_once).real.max() < 0.0


def test_placed_poles_are_five_times_faster_than_the_controller() -> None:
    poles = closed_loop_eigenvalues(A, B, regulator_gain(B, P, R))
    gain = placed_gain(still(A, 2), poles)
    placed = observer_eigenvalues(still(A, 2), gain)
    expected = -5.0 * np.abs(poles.real).max()
    assert np.allclose(
        placed.real, expected, rtol=1e-4
    )  # double poles: eigenvalues split by the root of rounding
    with pytest.raises(PipelineError, match="does not stabilise"):
        placed_gain(still(A, 2), -poles)


def test_augmented_matrices_have_the_corrected_shapes() -> None:
    a_z, b_z = augmented(A, B)
    assert a_z.shape == (18, 18)
    assert b_z.shape == (18, 4)
    assert np.array_equal(a_z[:6, 12:], np.eye(6))
    assert not a_z[12:].any()


def test_a_disturbance_inside_the_reach_of_the_inputs_is_cancelled() -> None:
    reachable = np.zeros((12, 4))
    reachable[:4] = np.diag([1.0, 2.0, 3.0, 4.0])
    push = np.array([1.0, -2.0, 3.0, 0.5, 0.0, 0.0])
    assert np.allclose(
        reachable @ (feed_forward_gain(reachable) @ push), np.concatenate([push, np.zeros(6)])
    )


def test_the_target_of_a_disturbance_is_at_rest_and_on_the_path() -> None:
    a = A.copy()
    a[6:9, 9:] = np.eye(3)
    state, inputs = disturbance_target(a, B, weights=np.ones(9), input_weights=np.ones(4))
    rest = a @ state + B @ inputs + np.vstack([np.eye(6), np.zeros((6, 6))])
    assert np.abs(rest).max() < 1e-9
    assert not state[6:9].any()
