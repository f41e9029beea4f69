"""Motion without thrust as a fit to other stretches predicts it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.coasting.decay import LEAST_COASTS, CoastRecord, fit_decay
from auvid.hydro.identification.passive.free_swing import FreeSwing

START_SAMPLES = 3
"""A coast that is predicted begins at the mean of so many samples, at their middle."""
LONGEST_STEP_S = 0.02


def coasts_held_out(records: Sequence[CoastRecord]) -> float | None:
    """Return the fit of speed [%] of alternate coasts by a fit to the others.

    100 (1 - |error| / |departure from the mean|) over all coasts. One coast in turn where
    half are too few; None where that leaves too few, too.
    """
    count = len(records)
    pieces = 2 if count >= 2 * LEAST_COASTS else count
    if count <= LEAST_COASTS:
        return None
    pairs: list[tuple[Array, Array]] = []
    for piece in range(pieces):
        out = [record for place, record in enumerate(records) if place % pieces == piece]
        others = [record for place, record in enumerate(records) if place % pieces != piece]
        try:
            linear, quadratic = fit_decay(others).drag
        except DataError:
            return None
        for record in out:
            thin = record.thinned()
            start = float(np.mean(thin.speed[:START_SAMPLES]))
            damping = (float(linear), float(quadratic), 0.0)
            later = slice(START_SAMPLES // 2, None)
            motion = _motion(thin.t_s[later], damping, (start, 0.0))
            pairs.append((thin.speed[later], motion[:, 0]))
    return fit_percent(pairs)


def swings_held_out(
    swings: Sequence[FreeSwing], pooled: Callable[[list[FreeSwing]], Array]
) -> float | None:
    """Return the fit of the angle [%] of each swing by the others; None of one swing.

    pooled: k, D_1, D_2 (3,) of several swings.
    """
    if len(swings) < 2:
        return None
    pairs = []
    for place, swing in enumerate(swings):
        k, linear, quadratic = pooled([*swings[:place], *swings[place + 1 :]])
        angle = swing.simulated
        rate = float(angle[1] - angle[0]) / float(swing.t_s[1] - swing.t_s[0])
        start = (rate, float(angle[0]))
        damping = (float(linear), float(quadratic), float(k))
        pairs.append((swing.measured, _motion(swing.t_s, damping, start)[:, 1]))
    return fit_percent(pairs)


def fit_percent(pairs: Sequence[tuple[Array, Array]]) -> float:
    """Return 100 (1 - |y - y_hat| / |y - mean|) over pairs of y and y_hat."""
    measured, predicted = (np.concatenate(part) for part in zip(*pairs, strict=True))
    spread = float(np.linalg.norm(measured - measured.mean()))
    return 100.0 * (1.0 - float(np.linalg.norm(measured - predicted)) / spread)


def _motion(t_s: Array, damping: tuple[float, float, float], start: tuple[float, float]) -> Array:
    """Return x and y (n, 2): x' = -D_1 x - D_2 x|x| - k sin(y), y' = x."""
    from auvid.hydro.identification.bench.compiled_loops import simulate_single

    linear, quadratic, k = damping
    none = np.zeros(t_s.size - 1)
    states = simulate_single(
        np.diff(t_s),
        none,
        none,
        np.array([-linear, -quadratic, 1.0, -k, 0.0]),
        np.array(start),
        LONGEST_STEP_S,
    )
    return np.asarray(states[:, :2])
