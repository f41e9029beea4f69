"""Restoring and damping over inertia from a swing that nothing drives.

    y'' = -k sin(y) - D_1 y' - D_2 y'|y'|

y: roll or pitch about its rest [rad], or depth about it in units of `DEPTH_UNIT_M`;
k = restoring over inertia [1/s^2]. As in the free decays of a bench (Alberti 2015, 70),
by output error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.bench.free_decay import Decay, estimate_decay
from auvid.hydro.identification.bench.output_error import SingleRun
from auvid.hydro.identification.bench.swing import GONE, fit_swing
from auvid.hydro.identification.signals.splines import smoothing_spline

DEPTH_UNIT_M = 20.0
"""So large that the sine of a depth in it is that depth."""
FEWEST_SWINGS = 1.5
LEFT, HELD_FOR = 0.1, 0.8
"""Share of the first amplitude by which a body that is let go has left it, and how long a held
one stays there, in times from then to its rest: a cosine takes .4 of that."""
STILL = 0.1
"""Share of the first amplitude below which it does not swing any more."""
WORST_RESIDUAL = 0.35
"""Of the first amplitude; beyond this the motion is no decay of one frequency."""


@dataclass(frozen=True)
class FreeSwing:
    """k [1/s^2], D_1 [1/s], D_2 [1/rad, 1/m] `values` (3,) with covariance (3, 3).

    `start_s`, `swings`, `amplitude` [rad, m], `rms` [rad, m] of simulated minus measured.
    """

    values: Array
    covariance: Array
    start_s: float
    swings: float
    amplitude: float
    rms: float
    damping: str
    t_s: Array
    measured: Array
    simulated: Array

    @property
    def frequency(self) -> tuple[float, float]:
        """Return the undamped frequency [rad/s] and its standard error."""
        root = float(np.sqrt(self.values[0]))
        return root, float(np.sqrt(self.covariance[0, 0])) / (2.0 * root)


def _held_for(share: Array) -> int:
    """Return how many samples a body is held at its first deflection, 0 for none.

    share (n,): deflection over the first one, the largest.
    """
    left, crossed = share < 1.0 - LEFT, share <= 0.0
    if not crossed.any():
        return 0
    goes, rests = int(np.argmax(left)), int(np.argmax(crossed))
    return goes if goes > HELD_FOR * max(rests - goes, 1) else 0


def fit_free_swing(t_s: Array, values: Array, *, is_depth: bool = False) -> FreeSwing:
    """Fit the decay that begins at the largest swing; t_s (n,) uniform, values (n,).

    Raises `DataError` where there is no decay: too few swings, or another motion.
    """
    unit = DEPTH_UNIT_M if is_depth else 1.0
    t_s, y = t_s[np.isfinite(values)], values[np.isfinite(values)] / unit
    tail = max(y.size // 5, 3)
    y = y - float(np.median(y[-tail:]))
    begin = int(np.argmax(np.abs(y)))
    begin += _held_for(y[begin:] / y[begin])
    spline = smoothing_spline(t_s[begin:], y[begin:])
    rate = spline.evaluate(t_s[begin:], 1)
    size = np.abs(y[begin:])
    # The stillness after it would hide a short swing in its spectrum.
    lasts = int(np.flatnonzero(size > STILL * size[0])[-1]) + 1
    swing = fit_swing(t_s[begin : begin + lasts], rate[:lasts], fewest=FEWEST_SWINGS)
    if swing.residual > WORST_RESIDUAL:
        raise DataError(
            "no decay of one frequency",
            value=f"{swing.residual:.0%} of the first swing is left over",
            allowed=f"{WORST_RESIDUAL:.0%}",
        )
    frequency = 2.0 * np.pi / swing.period_s
    lasting = -np.log(GONE) / max(swing.decay_rate, 1e-9)
    keep = slice(begin, int(np.searchsorted(t_s, t_s[begin] + lasting, side="right")))
    time, angle = t_s[keep] - t_s[begin], y[keep]
    none = np.zeros(time.size - 1)
    empty = np.zeros(0, dtype=np.int64)
    run = SingleRun(time, none, none, empty, np.zeros(0), np.arange(time.size), angle)
    decay = Decay(run, np.array([float(rate[0]), float(angle[0])]), frequency)
    fitted = estimate_decay(decay)
    chosen = fitted.output_error[fitted.chosen]
    # D_1 and D_2 of the bench are those of the force, negative; here drag is positive.
    scale = np.array([1.0, -1.0, -1.0 / unit])
    return FreeSwing(
        scale * chosen.values,
        chosen.covariance * np.outer(scale, scale),
        float(t_s[begin]),
        swing.swings,
        float(np.max(np.abs(angle))) * unit,
        chosen.rmse_rad * unit,
        fitted.chosen,
        time + float(t_s[begin]),
        fitted.measured * unit,
        fitted.simulated[fitted.chosen] * unit,
    )
