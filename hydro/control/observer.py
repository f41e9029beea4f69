"""Disturbance observer. Equations of Al Makdah 2016.

(5.1)-(5.9), dimensions and signs corrected (errata M30-M32).

The state chi (12,) is augmented by the unknown acceleration Delta d (6,) on the rows of
nu: Z = [chi; Delta d], A_Z = [A, E; 0, 0], E = [I_6; 0], C_Z = [I_12, 0]. Everything of
chi is measured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.arrays import Array
from auvid.hydro.control.riccati import algebraic_riccati, forward_riccati

N, D = 12, 6
FASTER = 5.0
"""How much faster than the controller the placed poles are (5.1)."""
C_Z = np.hstack([np.eye(N), np.zeros((N, D))])
E = np.vstack([np.eye(D), np.zeros((N - D, D))])


def augmented(A: ArrayLike, B: ArrayLike) -> tuple[Array, Array]:
    """Return A_Z (..., 18, 18) and B_Z (..., 18, m) of (5.3), corrected.

    A_Z = [[A, E], [0, 0]], B_Z = [B; 0], E = [I; 0]: a disturbance (6,) that stays acts
    on the rate of nu. A (..., 12, 12), B (..., 12, m).
    """
    a, b = np.asarray(A, dtype=np.float64), np.asarray(B, dtype=np.float64)
    a_z, b_z = (
        np.zeros((*a.shape[:-2], N + D, N + D)),
        np.zeros((*b.shape[:-2], N + D, b.shape[-1])),
    )
    a_z[..., :N, :N], a_z[..., :N, N:], b_z[..., :N, :] = a, E, b
    return a_z, b_z


def kalman_gain(
    A: ArrayLike, Q_Z: ArrayLike, R_Z: ArrayLike, *, step_s: float | None = None
) -> Array:
    """Return L (t, 18, 12) = P_Z C_Z' R_Z^-1 (5.7) along A (t, 12, 12).

    With Q_Z (18, 18) and R_Z (12, 12).

    With `step_s` P_Z follows (5.8) forward in time from its algebraic solution at the
    start; without, it is algebraic at every instant.
    """
    a = np.asarray(A, dtype=np.float64)
    a_z, _ = augmented(a, np.zeros((*a.shape[:-1], 1)))
    if step_s is None:
        P = np.stack([algebraic_riccati(one.T, C_Z.T, Q_Z, R_Z) for one in a_z])
    else:
        P = forward_riccati(a_z, C_Z, Q_Z, R_Z, step_s=step_s)
    return np.asarray(np.linalg.solve(np.asarray(R_Z, dtype=np.float64), C_Z @ P).swapaxes(-1, -2))


def placed_gain(A: ArrayLike, controller_eigenvalues: ArrayLike) -> Array:
    """Return L (t, 18, 12) that places all 18 poles of A_Z - L C_Z.

    `FASTER` times as far left as the fastest pole of the controller.

    Since all of chi is measured, L = [A + diag(g); H] makes the error of each velocity
    and its disturbance s^2 + 2 l s + l^2 and that of each pose s + l, exactly and at
    every instant. `controller_eigenvalues` (t, 12) or (12,). Raises `PipelineError` if
    the controller is unstable.
    """
    a = np.asarray(A, dtype=np.float64)
    real = np.real(np.asarray(controller_eigenvalues))
    if real.max() >= 0.0:
        raise PipelineError(
            "the observer's poles refer to a controller that does not stabilise",
            value=float(real.max()),
        )
    rate = FASTER * np.abs(real).max(axis=-1)
    rate = np.broadcast_to(rate, a.shape[:1])[:, None]
    out = np.zeros((len(a), N + D, N))
    out[:, :N] = a
    place = np.arange(N)
    out[:, place, place] += np.where(place < D, 2.0 * rate, rate)
    velocity = np.arange(D)
    out[:, N + velocity, velocity] = rate**2
    return out


def feed_forward_gain(B: ArrayLike) -> Array:
    """Return k_d (..., m, 6) = B^+ E.

    The inputs that cancel the disturbance best in the sense of least squares.

    U = U_eq - k (chi - chi_eq) - k_d Delta d takes the place of (5.9): a Riccati
    equation of the augmented pair has no stabilising solution.
    """
    return np.asarray(np.linalg.pinv(np.asarray(B, dtype=np.float64)) @ E)


def disturbance_target(
    A: ArrayLike, B: ArrayLike, *, weights: ArrayLike, input_weights: ArrayLike
) -> tuple[Array, Array]:
    """Return Pi (..., 12, 6) and Gamma (..., m, 6).

    The offset of state and inputs per unit of disturbance at which the vehicle stays on
    its path.

    Among all solutions of 0 = A x + B U + E d with the position held (x, y, z rows of x
    are 0) the one that is least in the weighted sense (weights (9,) of velocities and
    attitude, (m,) of inputs). An underactuated vehicle meets a side force by crabbing,
    which B^+ E cannot give. Then U = U_eq + Gamma d - k (chi - chi_eq - Pi d), that is
    k_d = -(Gamma + k Pi).
    """
    a, b = np.asarray(A, dtype=np.float64), np.asarray(B, dtype=np.float64)
    free = [0, 1, 2, 3, 4, 5, 9, 10, 11]
    scale = 1.0 / np.sqrt(
        np.concatenate(
            [np.asarray(weights, dtype=np.float64), np.asarray(input_weights, dtype=np.float64)]
        )
    )
    system = np.concatenate([a[..., free], b], axis=-1) * scale
    solution = -scale[:, None] * (np.linalg.pinv(system, rcond=1e-10) @ E)
    state = np.zeros((*a.shape[:-2], N, D))
    state[..., free, :] = solution[..., :9, :]
    return state, np.asarray(solution[..., 9:, :])
