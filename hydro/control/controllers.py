"""A controller along a trajectory, as schedules over time.

Equilibrium, regulator gains and, if wanted, a disturbance observer.

U = U_eq + Gamma d - k (chi_hat - chi_eq - Pi d), with d = 0 where there is no observer:
Al Makdah 2016 (3.22), (5.9), corrected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.control.equilibrium import Equilibrium, at_every
from auvid.hydro.control.observer import (
    C_Z,
    D,
    N,
    augmented,
    disturbance_target,
    feed_forward_gain,
    kalman_gain,
    placed_gain,
)
from auvid.hydro.control.plants import ControlledPlant
from auvid.hydro.control.riccati import (
    backward_riccati,
    closed_loop_eigenvalues,
    exponential,
    frozen_riccati,
    regulator_gain,
    require_controllable,
    stability_margins,
)

RICCATI = ("backward", "frozen")
OBSERVERS = ("kalman", "poles")
FEED_FORWARD = ("target", "pseudo_inverse")
CHECKED = 40
"""Instants at which margins and frozen gains are computed."""


@dataclass(frozen=True)
class Weights:
    """Diagonals of the weights.

    Q (12,) and R (m,) of the regulator, Q_Z (18,) and R_Z (12,) of the Kalman filter.
    """

    Q: Array
    R: Array
    Q_Z: Array
    R_Z: Array


@dataclass(frozen=True)
class Observer:
    """A disturbance observer for one tick, at the design instants.

    Z[k+1] = phi Z[k] + by_input U[k] + by_state Y[k] in deviations from the
    equilibrium, and the feed-forward `state` (d, 12, 6), `inputs` (d, m, 6) per unit of
    disturbance; `poles` (d, 18).
    """

    phi: Array
    by_input: Array
    by_state: Array
    state: Array
    inputs: Array
    poles: Array


@dataclass(frozen=True)
class Schedule:
    """Gains `k` (n, m, 12) on the equilibrium's clock, and an observer or None.

    At the design instants `design_s` (d,), `stride` samples apart: A (d, 12, 12), B (d,
    12, m), eigenvalues (d, 12) of A - B k. At some of them (c):
    `frozen_eigenvalues` (c, 12) with the gains of the algebraic equation, and `margins`
    (c, 3) of `stability_margins` with the gains in use.
    """

    equilibrium: Equilibrium
    k: Array
    observer: Observer | None
    design_s: Array
    A: Array
    B: Array
    eigenvalues: Array
    stride: int
    frozen_eigenvalues: Array
    margins: Array


def design(
    plant: ControlledPlant,
    equilibrium: Equilibrium,
    weights: Weights,
    *,
    riccati: str = "backward",
    observer: str | None = None,
    feed_forward: str = "target",
    stride: int = 5,
) -> Schedule:
    """Return the controller of an equilibrium.

    Gains every `stride` samples, linear between them.

    `riccati`, `observer`, `feed_forward`: one of RICCATI, OBSERVERS, FEED_FORWARD.
    Raises `CampaignError` for other words and weights of the wrong size,
    `PipelineError` naming the state where the linearised vehicle is not controllable.
    """
    _words(
        riccati=(riccati, RICCATI),
        observer=(observer, (None, *OBSERVERS)),
        feed_forward=(feed_forward, FEED_FORWARD),
    )
    inputs = len(plant.inputs.names)
    for name, size in (("Q", N), ("R", inputs), ("Q_Z", N + D), ("R_Z", N)):
        values = getattr(weights, name)
        if (
            values.shape != (size,)
            or (values < 0.0).any()
            or (name.startswith("R") and (values <= 0.0).any())
        ):
            rule = f"{size} numbers {'> 0' if name.startswith('R') else '>= 0'}"
            raise CampaignError(
                "weights do not fit the vehicle", field=name, value=values.tolist(), allowed=rule
            )
    few = at_every(equilibrium, stride)
    A, B = plant.linear(few.chi, few.U, mass_kg=few.mass_kg)
    for index in np.unique(np.linspace(0, len(A) - 1, 9).astype(int)):
        require_controllable(A[index], B[index], where=f"at {few.t_s[index]:.1f} s")
    Q, R = np.diag(weights.Q), np.diag(weights.R)
    P = (
        backward_riccati(A, B, Q, R, step_s=few.step_s)
        if riccati == "backward"
        else frozen_riccati(A, B, Q, R)
    )
    k = regulator_gain(B, P, R)
    poles = closed_loop_eigenvalues(A, B, k)
    some = np.unique(np.linspace(0, len(A) - 1, CHECKED).astype(int))
    margins = np.array([stability_margins(A[i], B[i], k[i], r=weights.R) for i in some])
    still = closed_loop_eigenvalues(
        A[some], B[some], regulator_gain(B[some], frozen_riccati(A[some], B[some], Q, R), R)
    )
    watch = (
        None
        if observer is None
        else _observer(few, equilibrium.step_s, A, B, poles, weights, observer, feed_forward)
    )
    return Schedule(
        equilibrium,
        _along(equilibrium.t_s, few.t_s, k),
        watch,
        few.t_s,
        A,
        B,
        poles,
        stride,
        still,
        margins,
    )


def _words(**choices: tuple[str | None, tuple[str | None, ...]]) -> None:
    for name, (value, allowed) in choices.items():
        if value not in allowed:
            raise CampaignError(
                "unknown method", field=name, value=value, allowed=tuple(map(str, allowed))
            )


def _observer(
    few: Equilibrium,
    tick_s: float,
    A: Array,
    B: Array,
    poles: Array,
    weights: Weights,
    method: str,
    feed_forward: str,
) -> Observer:
    a_z, b_z = augmented(A, B)
    kalman = method == "kalman"
    L = (
        kalman_gain(A, np.diag(weights.Q_Z), np.diag(weights.R_Z), step_s=few.step_s)
        if kalman
        else placed_gain(A, poles)
    )
    inner = a_z - L @ C_Z
    m, size = B.shape[-1], N + D
    system = np.zeros((len(A), size + m + N, size + m + N))
    system[:, :size, :size], system[:, :size, size : size + m], system[:, :size, size + m :] = (
        inner,
        b_z,
        L,
    )
    flow = exponential(system * tick_s)[:, :size]
    if feed_forward == "target":
        state, inputs = disturbance_target(
            A,
            B,
            weights=np.maximum(weights.Q[[0, 1, 2, 3, 4, 5, 9, 10, 11]], 1e-6),
            input_weights=weights.R,
        )
    else:
        state, inputs = np.zeros((len(A), N, D)), -feed_forward_gain(B)
    return Observer(
        phi=flow[..., :size],
        by_input=flow[..., size : size + m],
        by_state=flow[..., size + m :],
        state=state,
        inputs=inputs,
        poles=np.asarray(np.linalg.eigvals(inner)),
    )


def _along(t_s: Array, knots_s: Array, values: ArrayLike) -> Array:
    """Interpolate (d, ...) linearly over time; constant beyond the last knot."""
    array = np.asarray(values)
    place = np.clip(np.searchsorted(knots_s, t_s, side="right") - 1, 0, max(len(knots_s) - 2, 0))
    after = np.minimum(place + 1, len(knots_s) - 1)
    width = np.where(after > place, knots_s[after] - knots_s[place], 1.0)
    share = np.clip((t_s - knots_s[place]) / width, 0.0, 1.0).reshape(-1, *(1,) * (array.ndim - 1))
    return np.asarray(array[place] + share * (array[after] - array[place]))
