"""Known truth for single-channel runs: a body under a stepped force, integrated by
another method than the estimators use.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

Array = npt.NDArray[np.float64]


def stepped_run(
    levels: Sequence[float] | Array,
    hold_s: float,
    rate_hz: float,
    slope: Callable[[float, float, float], float],
) -> tuple[Array, Array, Array, Array]:
    """Times (n,), velocity (n,), position (n,) and held force (n-1,) under levels of
    force held for `hold_s` each.

    `slope(x, s, force)` is x_dot; the run starts at rest. DOP853 over each hold, so
    that no step of the force lies inside a step.
    """
    per = round(hold_s * rate_hz)
    t, states = [0.0], [np.zeros(2)]
    for level in levels:
        times = t[-1] + np.arange(1, per + 1) / rate_hz
        solution = solve_ivp(
            lambda _, y, f=level: [slope(y[0], y[1], f), y[0]],
            (t[-1], times[-1]),
            states[-1],
            method="DOP853",
            t_eval=times,
            rtol=1e-12,
            atol=1e-13,
        )
        t.extend(times)
        states.extend(solution.y.T)
    out = np.array(states)
    return np.array(t), out[:, 0], out[:, 1], np.repeat(np.asarray(levels, dtype=np.float64), per)
