"""Linear quadratic regulators along a trajectory. Equations of Al Makdah 2016.

(3.22)-(3.25), signs corrected (errata M28).

U = U_eq - k (chi - chi_eq), k = R^-1 B' P, -P_dot = A' P + P A + Q - P B R^-1 B' P,
backward in time from the algebraic solution at the end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.arrays import STATES, Array

CONTROLLABLE = 1e-9
"""Smallest singular value of [A - lambda I, B] over the largest, below which a mode
counts as out of the inputs' reach.
"""
FREQUENCIES = 400
"""At which the least return difference is looked for."""
LONGEST_SHARE = 4.0
"""A step of the Riccati equation is halved until the fastest eigenvalue of its
Hamiltonian times the step is below this (exp(2 x 4) of the 16 digits are lost).
"""


def exponential(matrices: ArrayLike) -> Array:
    """Return exp of a batch (..., n, n).

    Taylor to order 16 after halving the largest 1-norm below 0.5, then squaring.

    For hundreds of small matrices at once; relative error of the order 1e-15 times 2 to
    the number of squarings, `scipy.linalg.expm` to rounding but twenty times faster.
    """
    stack = np.asarray(matrices, dtype=np.float64)
    size = float(np.abs(stack).sum(axis=-2).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(max(size, 1e-300) / 0.5))))
    x = stack / 2.0**squarings
    unit = np.eye(stack.shape[-1])
    out = unit + x / 16.0
    for order in range(15, 0, -1):
        out = unit + x @ out / order
    for _ in range(squarings):
        out = out @ out
    return np.asarray(out)


def algebraic_riccati(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike) -> Array:
    """P >= 0 (n, n) of A' P + P A + Q - P B R^-1 B' P = 0.

    Raises `PipelineError` where there is no stabilising solution.
    """
    from scipy.linalg import solve_continuous_are

    a, b, q, r = (np.asarray(matrix, dtype=np.float64) for matrix in (A, B, Q, R))
    try:
        P = solve_continuous_are(a, b, q, r)
    except (np.linalg.LinAlgError, ValueError) as fault:
        raise PipelineError(
            "the Riccati equation has no stabilising solution",
            remedy=(
                "The inputs do not reach a mode that must be held, or Q does not weigh it; R must"
                " be positive definite."
            ),
        ) from fault
    return np.asarray(0.5 * (P + P.T))


def frozen_riccati(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike) -> Array:
    """Return P (t, n, n), the algebraic solution at every instant.

    As if A (t, n, n) and B (t, n, m) stood still.
    """
    return np.stack(
        [algebraic_riccati(a, b, Q, R) for a, b in zip(np.asarray(A), np.asarray(B), strict=True)]
    )


def backward_riccati(
    A: ArrayLike,
    B: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    *,
    step_s: float,
    end: ArrayLike | None = None,
) -> Array:
    """Return P (t, n, n) of (3.25) backward in time on a uniform clock.

    From `end` (default: the algebraic solution at the last instant).

    Over each step A and B are the means of both ends and the solution is exact: [X; Y]
    = exp(H h) [I; P], P = Y X^-1 with the Hamiltonian H = [-A, G; Q, A'] of reversed
    time, G = B R^-1 B'. On a time-invariant system the algebraic solution stays as it
    is.
    """
    a, b = np.asarray(A, dtype=np.float64), np.asarray(B, dtype=np.float64)
    n = a.shape[-1]
    P: Array = (
        algebraic_riccati(a[-1], b[-1], Q, R) if end is None else np.asarray(end, dtype=np.float64)
    )
    mean_a, mean_b = 0.5 * (a[1:] + a[:-1]), 0.5 * (b[1:] + b[:-1])
    G = mean_b @ np.linalg.solve(np.asarray(R, dtype=np.float64), np.swapaxes(mean_b, -1, -2))
    H = np.empty((len(mean_a), 2 * n, 2 * n))
    H[:, :n, :n], H[:, :n, n:] = -mean_a, G
    H[:, n:, :n], H[:, n:, n:] = np.asarray(Q, dtype=np.float64), np.swapaxes(mean_a, -1, -2)
    size = np.abs(np.linalg.eigvals(H[:: max(1, len(H) // 50)])).max() if len(H) else 0.0
    halvings = max(0, int(np.ceil(np.log2(max(size * step_s / LONGEST_SHARE, 1e-12)))))
    flow = exponential(H * (step_s / 2**halvings))
    out = np.empty((len(a), n, n))
    out[-1] = P
    for i in range(len(mean_a) - 1, -1, -1):
        for _ in range(2**halvings):
            X, Y = flow[i, :n, :n] + flow[i, :n, n:] @ P, flow[i, n:, :n] + flow[i, n:, n:] @ P
            P = np.asarray(np.linalg.solve(X.T, Y.T).T, dtype=np.float64)
            P = 0.5 * (P + P.T)
        out[i] = P
    return out


def forward_riccati(
    A: ArrayLike, C: ArrayLike, Q: ArrayLike, R: ArrayLike, *, step_s: float
) -> Array:
    """Return P (t, n, n) of the filter (5.8) forward in time.

    P_dot = A P + P A' + Q - P C' R^-1 C P, from the algebraic solution at the start.

    The dual of `backward_riccati` in reversed time; `C` (m, n) is constant.
    """
    reverse = np.swapaxes(np.asarray(A, dtype=np.float64), -1, -2)[::-1]
    columns = np.broadcast_to(
        np.asarray(C, dtype=np.float64).T, (len(reverse), reverse.shape[-1], np.asarray(C).shape[0])
    )
    return backward_riccati(reverse, columns, Q, R, step_s=step_s)[::-1].copy()


def regulator_gain(B: ArrayLike, P: ArrayLike, R: ArrayLike) -> Array:
    """k (..., m, n) = R^-1 B' P (3.24, corrected sign)."""
    product = np.swapaxes(np.asarray(B, dtype=np.float64), -1, -2) @ np.asarray(P, dtype=np.float64)
    return np.asarray(np.linalg.solve(np.asarray(R, dtype=np.float64), product))


def closed_loop_eigenvalues(A: ArrayLike, B: ArrayLike, k: ArrayLike) -> Array:
    """Eigenvalues (..., n), complex, of A - B k."""
    return np.asarray(np.linalg.eigvals(np.asarray(A) - np.asarray(B) @ np.asarray(k)))


def uncontrollable_states(A: ArrayLike, B: ArrayLike) -> list[str]:
    """Return the states that the inputs cannot move.

    By the test of Popov, Belevitch and Hautus on scaled A (n, n), B (n, m).

    For each eigenvalue lambda, [A - lambda I, B] must have full rank; where it has not,
    the state with the largest part in the left null vector is named.
    """
    a, b = np.asarray(A, dtype=np.float64), np.asarray(B, dtype=np.float64)
    scale = np.abs(b).max(axis=0)
    b = b / np.where(scale > 0.0, scale, 1.0)
    names_of_states: dict[str, None] = {}
    for value in np.linalg.eigvals(a):
        left, singular, _ = np.linalg.svd(np.hstack([a - value * np.eye(len(a)), b]))
        for column in np.flatnonzero(singular < CONTROLLABLE * max(singular[0], 1.0)):
            names_of_states[STATES[int(np.argmax(np.abs(left[:, column])))]] = None
    return list(names_of_states)


def require_controllable(A: ArrayLike, B: ArrayLike, *, where: str) -> None:
    """Raises `PipelineError` naming the states out of reach."""
    lost = uncontrollable_states(A, B)
    if lost:
        raise PipelineError(
            f"the linearised vehicle is not controllable {where}",
            field="state",
            value=", ".join(lost),
            remedy=(
                "Fins have no effect without speed ahead; give a faster trajectory or an actuator"
                " that moves this state."
            ),
        )


def stability_margins(
    A: ArrayLike, B: ArrayLike, k: ArrayLike, *, r: ArrayLike
) -> tuple[float, float, float]:
    """Return gain margins (lower, upper as factors) and phase margin [rad].

    Of all inputs at once, from the least return difference.

    With a = min over frequency of the smallest singular value of I + W k (j omega -
    A)^-1 B W^-1 at the plant input, W = sqrt(R), the factors are 1/(1 + a) and 1/(1 - a)
    (infinite for a >= 1), the phase 2 asin(a / 2): guaranteed for changes in every channel
    together (Lehtomaki 1981), which a diagonal W leaves as they are; without it newtons
    and radians would be one unit. `r`: the diagonal of R. Gains of the algebraic equation
    have a >= 1.
    """
    a, b, gain = (np.asarray(matrix, dtype=np.float64) for matrix in (A, B, k))
    poles = np.abs(np.linalg.eigvals(a - b @ gain))
    band = np.geomspace(max(poles.min(), 1e-4) / 30.0, poles.max() * 30.0, FREQUENCIES)
    root = np.sqrt(np.asarray(r, dtype=np.float64))
    b, gain = b / root, root[:, None] * gain
    loop = gain @ np.linalg.solve(
        1j * band[:, None, None] * np.eye(len(a)) - a, np.broadcast_to(b, (FREQUENCIES, *b.shape))
    )
    least = float(np.linalg.svd(np.eye(b.shape[1]) + loop, compute_uv=False)[:, -1].min())
    upper = float("inf") if least >= 1.0 else 1.0 / (1.0 - least)
    return 1.0 / (1.0 + least), upper, 2.0 * float(np.arcsin(min(least, 2.0) / 2.0))
