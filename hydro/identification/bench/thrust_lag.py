"""First-order lag of thrust behind its command, from a single-channel run.

A propeller takes a tenth of a second to a second to come to speed. Left out, the lag is
taken for mass: an added mass comes out too large by about damping times lag. It is told
from mass by the bend with which the velocity sets out after a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.identification.bench.output_error import SingleRun

TRIED_S = (0.1, 0.3, 0.8)
SHORTEST_S, LONGEST_S = 0.02, 3.0
CLEAR_GAIN = 16.0
"""How much twice the log-likelihood must grow: four standard errors for white noise."""
CLEAR_LAG = 3.0
STEPS_PER_LAG, FINEST_S = 5.0, 0.01


@dataclass(frozen=True)
class Lag:
    """Time constant [s] of the force, with its standard error."""

    value_s: float
    standard_error_s: float


def lagged(run: SingleRun, lag_s: float, *, from_rest: bool = False) -> SingleRun:
    """Return the run with its force F replaced by y of lag_s * y_dot + y = F.

    y is exact at the nodes of a finer grid. y is steady at first, or 0 from rest.
    Between the nodes the force is linear; five steps per lag keep it within 0.5 % of
    its jump.
    """
    width = np.diff(run.grid_s)
    parts = np.maximum(np.ceil(width / max(lag_s / STEPS_PER_LAG, FINEST_S)), 1.0).astype(np.intp)
    step = np.repeat(np.arange(width.size), parts)
    number = np.arange(step.size) - np.repeat(np.cumsum(parts) - parts, parts)
    share = number / parts[step]
    slope = (run.force_right - run.force_left) / width
    grid = np.append(run.grid_s[step] + share * width[step], run.grid_s[-1])
    grid[np.append(number == 0, True)] = run.grid_s
    left, h = run.force_left[step] + slope[step] * (grid[:-1] - run.grid_s[step]), np.diff(grid)
    # Over a step of slope s from l: y = l + s (h - lag) + (y_0 - l + s lag) exp(-h /
    # lag).
    fade = np.exp(-h / lag_s)
    gain = left + slope[step] * (h - lag_s) + (slope[step] * lag_s - left) * fade
    force = [0.0 if from_rest else float(run.force_left[0])]
    for keep, add in zip(fade.tolist(), gain.tolist(), strict=True):
        force.append(keep * force[-1] + add)
    y: Array = np.array(force)
    at = np.searchsorted(grid, run.grid_s)
    return SingleRun(
        grid, y[:-1], y[1:], at[run.rate_at], run.rate, at[run.position_at], run.position
    )


def find_lag(cost: Callable[[float], float], samples: int) -> Lag | None:
    """Return the lag with the smallest sum of squares cost(lag_s), or None.

    None where no lag is clearly better than none. samples: how many errors there are.
    The standard error is that of white noise, with all else fitted anew.
    """
    from scipy.optimize import minimize_scalar

    tiny = np.finfo(float).tiny
    none = cost(0.0) + tiny
    costs = [cost(lag) + tiny for lag in TRIED_S]
    best = int(np.argmin(costs))
    if samples * np.log(none / costs[best]) < CLEAR_GAIN:
        return None
    edges = np.log([SHORTEST_S, *TRIED_S, LONGEST_S])
    result = minimize_scalar(
        lambda x: cost(float(np.exp(x))),
        bounds=(edges[best], edges[best + 2]),
        method="bounded",
        options={"xatol": 3e-3},
    )
    value, least = float(np.exp(result.x)), float(result.fun)
    away = 0.1 * value
    bend = (cost(value + away) - 2.0 * least + cost(value - away)) / away**2
    error = float(np.sqrt(2.0 * least / samples / bend)) if bend > 0.0 else np.inf
    return Lag(value, error) if value > CLEAR_LAG * error and value > 1.1 * SHORTEST_S else None
