"""Recursive least squares for one degree of freedom: Alberti 2015, chapter III.

The dynamic system x_dot = f_0 + Phi Theta (42) becomes the static one z = Phi_0 + Phi_f
Theta (48) by the stable filter (43)-(50), so that no measurement is differentiated. The
estimator (39), (41) is solved exactly for signals that are held between samples: over a
step h

    Gamma_next^-1 = Gamma^-1 + h Phi' Phi,   Theta_next = Theta + Gamma_next Phi' h (z - Phi Theta),

which is the covariance form with measurement weight h; it is carried as a square root
of Gamma, so that Gamma stays positive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array


@dataclass(frozen=True)
class StaticRegression:
    """The static form (48)-(49): z (n,) = regressor (n, k) Theta at times t_s (n,).

    `rate` [1/s] is that of the filter it came through.
    """

    t_s: Array
    z: Array
    regressor: Array
    rate: float


@dataclass(frozen=True)
class RecursiveEstimate:
    """Theta (n, k) and the diagonal of Gamma over time; Gamma (k, k) at the end.

    `spread` is the diagonal, at times `t_s` (n,). `error` (n,): z - Phi Theta before
    each update; `residual` (n,): the same with the last Theta.
    """

    t_s: Array
    theta: Array
    spread: Array
    gamma: Array
    error: Array
    residual: Array


def static_form(
    t_s: ArrayLike,
    x: ArrayLike,
    regressor: ArrayLike,
    *,
    rate: float,
    forcing: ArrayLike | None = None,
    regressor_after: ArrayLike | None = None,
    samples: ArrayLike | None = None,
) -> StaticRegression:
    """Return the filtered static form of x_dot = f_0 + Phi Theta on a grid: (44)-(50).

    x_f_dot = a (x - x_f), Phi_f_dot = -a Phi_f + Phi, z = x - x_f - Phi_0 = Phi_f
    Theta: (44), (45), (49), (50). The grid t_s (n,) [s] need not be uniform. x (n,):
    the state; regressor (n, k): Phi at the nodes; forcing (n,): f_0. All are taken as
    linear between nodes (first-order hold), for which the filter is exact. A column
    that jumps at the nodes (a force that is held) gets its value after each node, up to
    the next, in `regressor_after` (n-1, k) at both ends of the step; nan there means
    linear. samples: nodes to return, default all but the first. Error of the hold:
    about (h / time constant)^2 / 12 of x. Raises `DataError` for a rate that is not
    positive or a clock that does not increase.
    """
    from auvid.hydro.identification.bench.compiled_loops import filter_first_order

    t, state = np.asarray(t_s, dtype=np.float64), np.asarray(x, dtype=np.float64)
    phi = np.asarray(regressor, dtype=np.float64)
    step = np.diff(t)
    if not (rate > 0 and t.size > 1 and step.min() > 0):
        raise DataError(
            "the regression filter needs a positive rate and times that increase",
            field="filter_rate_rad_s",
            value=rate,
        )
    left, right = phi[:-1].copy(), phi[1:].copy()
    if regressor_after is not None:
        after = np.asarray(regressor_after, dtype=np.float64)
        left, right = (
            np.where(np.isnan(after), left, after),
            np.where(np.isnan(after), right, after),
        )
    f0 = np.zeros_like(state) if forcing is None else np.asarray(forcing, dtype=np.float64)
    extra = np.column_stack([rate * state, f0])
    start = np.concatenate([np.zeros(phi.shape[1]), [state[0], 0.0]])
    filtered = filter_first_order(
        step, float(rate), np.hstack([left, extra[:-1]]), np.hstack([right, extra[1:]]), start
    )
    keep = np.arange(1, t.size) if samples is None else np.asarray(samples, dtype=np.intp)
    z = state - filtered[:, -2] - filtered[:, -1]
    return StaticRegression(
        t[keep], z[keep], np.ascontiguousarray(filtered[keep, :-2]), float(rate)
    )


def recursive_least_squares(
    form: StaticRegression,
    *,
    prior_spread: ArrayLike = 1e6,
    start: ArrayLike | None = None,
    memory_s: float | None = None,
    lowest_trace: float = 0.0,
    highest_trace: float = np.inf,
) -> RecursiveEstimate:
    """Run the estimator (39), (41) over a static form (n samples, k coefficients).

    Gamma_dot = -Gamma Phi Phi' Gamma, Theta_dot = Gamma Phi (z - Phi' Theta).
    prior_spread: Gamma(0), a number gamma_0 for gamma_0 I or its diagonal (k,); start
    (k,): Theta(0), default 0; memory_s: time constant of exponential forgetting, None
    for none. Limits of the trace of Gamma: forgetting stops at `highest_trace`, and
    Gamma is scaled up to `lowest_trace`, which keeps the estimator alive. Without
    forgetting and limits the end equals batch least squares with the same prior. Raises
    `DataError` for a prior that is not positive.
    """
    from auvid.hydro.identification.bench.compiled_loops import recursive_estimate

    n, k = form.regressor.shape
    diagonal = np.broadcast_to(np.asarray(prior_spread, dtype=np.float64), (k,))
    if not (np.all(diagonal > 0) and np.all(np.isfinite(diagonal))):
        raise DataError(
            "the initial covariance must be positive", field="prior_spread", value=diagonal.tolist()
        )
    step = _weights(form.t_s)
    keep = np.ones(n) if memory_s is None else np.exp(-step / memory_s)
    theta = np.zeros(k) if start is None else np.array(start, dtype=np.float64)
    root = np.diag(np.sqrt(diagonal))
    history, spread = np.empty((n, k)), np.empty((n, k))
    # Copies: numba compiles the loop once more for arrays of another layout.
    error = recursive_estimate(
        np.array(form.regressor, order="C"),
        np.array(form.z),
        step,
        keep,
        theta,
        root,
        float(lowest_trace),
        float(highest_trace),
        history,
        spread,
    )
    return RecursiveEstimate(
        form.t_s, history, spread, root @ root.T, error, form.z - form.regressor @ theta
    )


def batch_least_squares(
    form: StaticRegression, *, prior_spread: ArrayLike = 1e6, start: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Return Theta (k,) and Gamma (k, k) of (30) in one piece, by QR.

    Theta = (Phi' Phi)^-1 Phi' z with the prior and weights of
    `recursive_least_squares`.
    """
    k = form.regressor.shape[1]
    weight = np.sqrt(_weights(form.t_s))
    prior = np.diag(
        1.0 / np.sqrt(np.broadcast_to(np.asarray(prior_spread, dtype=np.float64), (k,)))
    )
    first = np.zeros(k) if start is None else np.asarray(start, dtype=np.float64)
    rows = np.vstack([prior, form.regressor * weight[:, None]])
    right = np.concatenate([prior @ first, form.z * weight])
    scale = np.linalg.norm(rows, axis=0)
    q, r = np.linalg.qr(rows / scale)
    inverse = np.linalg.inv(r) / scale[:, None]
    return np.asarray(inverse @ (q.T @ right)), np.asarray(inverse @ inverse.T)


def _weights(t: Array) -> Array:
    """Return the step that ends at each sample [s]; the first has the second's."""
    step = np.diff(t, prepend=t[0])
    step[0] = step[1] if step.size > 1 else 1.0
    return step
