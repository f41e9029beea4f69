"""How a motion answers: slowly or late to commands, and turned against another record.

A command that is written too early looks like a slow vehicle, whose motion goes on to
change for seconds after it; a compass that is off turns a velocity against the position
that it makes. Nothing here decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.motion_checks import (
    WINDOW_S,
    integrals,
    track_windows,
    windows,
)
from auvid.hydro.identification.checks.robust_gains import FEWEST_WINDOWS, fitted_gains
from auvid.hydro.kept_results import kept

NORMAL_FOURTH = 3.0
"""Fourth moment of a normal distribution over the square of the second."""
LONGEST_DELAY_S = 0.6
"""Thrusters, their controllers and the record take no longer to act."""


@dataclass(frozen=True)
class SlowAnswer:
    """Shares of a motion's change that two explanations of its delay reach.

    `slow`: drag with `time_constant_s` [s], and at most 0.6 s of delay; `late`: any delay
    of `lags_s` beyond that. The time constant is infinite without drag.
    """

    slow: float
    time_constant_s: float
    late: float


@kept
def slow_answer(
    t_command: ArrayLike,
    command: ArrayLike,
    t_motion: ArrayLike,
    motion: ArrayLike,
    *,
    lags_s: ArrayLike,
) -> SlowAnswer | None:
    """Return whether motion (m,) is late behind commands (n, k), or slow to answer.

    y_dot = b u(t - lag) - y / T + c over windows of 0.5 s, at each lag [s]. None for too
    few windows.
    """
    at_u, u = np.asarray(t_command, dtype=np.float64), np.asarray(command, dtype=np.float64)
    at_y, y = np.asarray(t_motion, dtype=np.float64), np.asarray(motion, dtype=np.float64)
    width, best = 0.5 * WINDOW_S, {True: (-np.inf, 0.0), False: (-np.inf, 0.0)}
    u = u[:, np.ptp(u, axis=0) > 0.0]
    for lag in np.asarray(lags_s, dtype=np.float64):
        start, end = max(at_u[0], at_y[0] - lag), min(at_u[-1], at_y[-1] - lag)
        at = windows(start, end, at_u, at_y - lag, width_s=width)
        if at.size < FEWEST_WINDOWS:
            continue
        ends = [np.interp(side + lag, at_y, y) for side in (at, at + width)]
        design = np.hstack(
            [integrals(at_u, u, at, width), integrals(at_y, y[:, None], at + lag, width)]
        )
        gains = fitted_gains(ends[1] - ends[0], design)
        soon = bool(lag <= LONGEST_DELAY_S)
        if gains is not None and gains.explained > best[soon][0]:
            best[soon] = gains.explained, float(gains.gain[-1])
    (slow, drag), (late, _) = best[True], best[False]
    if not np.isfinite([slow, late]).all():
        return None
    return SlowAnswer(slow, -1.0 / drag if drag < 0.0 else np.inf, late)


@dataclass(frozen=True)
class PlanarTurn:
    """By how much one planar motion is turned against another, clockwise from above.

    `angle` and its standard deviation `sd` [rad]; `scale`, the ratio of their sizes;
    `explained`, the share of the variance that the turned motion explains. `bounds` of
    the scale: noise of either motion lowers or raises it, and few large changes are all
    that tells it where a vehicle is steady else, so that all windows count there as well;
    `scale_sd`, its standard deviation in parts of it, is larger the fewer they are.
    """

    angle: float
    sd: float
    scale: float
    explained: float
    bounds: tuple[float, float]
    scale_sd: float


@kept
def track_turn(
    t_position: Array,
    position: Array,
    t_attitude: Array,
    euler: Array,
    t_velocity: Array,
    velocity: Array,
) -> PlanarTurn | None:
    """Return by how much a track (n, 2) is turned against heading and velocity (m, 3).

    [dx dy] = s R(delta) integral of R(phi, theta, psi) [u v w] over windows of 2 s, a
    constant current beside: a positive delta means that the heading reads so much too
    little, or that the velocity's axes are turned so much. None for too few windows.
    """
    shared = track_windows(t_position, t_attitude, euler, t_velocity)
    if shared is None:
        return None
    at, turn, width = shared
    expected = integrals(t_velocity, np.einsum("nij,nj->ni", turn, velocity)[:, :2], at, width)
    ends = [
        np.stack([np.interp(side, t_position, column) for column in position.T[:2]], axis=1)
        for side in (at, at + width)
    ]
    return planar_turn(expected, ends[1] - ends[0])


def planar_turn(expected: Array, moved: Array) -> PlanarTurn | None:
    """Return the turn of `moved` (n, 2) against `expected` (n, 2), constants beside."""
    x, y = (side - np.median(side, axis=0) for side in (expected, moved))
    # [dx dy] = c [ex ey] + s [-ey ex], both rows with one c and s.
    design = np.stack([x, np.column_stack([-x[:, 1], x[:, 0]])], axis=2).reshape(-1, 2)
    gains = fitted_gains(y.ravel(), design)
    if gains is None or not np.isfinite(gains.sd).all():
        return None
    scale = float(np.hypot(*gains.gain))
    if not scale:
        return None
    along = (design @ gains.gain).ravel() / scale
    shared = max(float(along @ y.ravel()), 1e-12)
    low = min(scale, shared / max(float(along @ along), 1e-12))
    high = max(scale / max(gains.explained, 1e-3), float(np.sum(y**2)) / shared)
    angle, sd = float(np.arctan2(*gains.gain[::-1])), float(np.max(gains.sd)) / scale
    few = float(np.mean(along**4)) / max(float(np.mean(along**2)), 1e-6) ** 2 / NORMAL_FOURTH
    scale_sd = sd * max(few, 1.0) ** 0.5
    return PlanarTurn(angle, sd, scale, gains.explained, (low, high), scale_sd)
