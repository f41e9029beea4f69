"""Which axis of a vehicle answers which command, where no name tells it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array

LONGEST_ANSWER_S = 0.8
LAGS = 12
LEAST_CORRELATION = 0.4
"""Drag and other axes take their part; chance stays below 0.2 from a hundred answers on."""
LEAST_ROWS = 100
USUAL, SPIKE = 0.95, 2.0


@dataclass(frozen=True)
class Answer:
    """A command, the velocity (u v w p q r) that answers it, and their correlation."""

    command: str
    axis: str
    correlation: float


def answered_commands(
    t_s: Array, commands: Mapping[str, Array], motions: Mapping[str, Array]
) -> list[Answer]:
    """Return which axis answers which command, of signals (n,) at t_s (n,) [s].

    Each pair has its largest correlation at a lag of 0 to 0.8 s; the assignment with the
    largest sum of their moduli is taken, without pairs below LEAST_CORRELATION.
    """
    from scipy.optimize import linear_sum_assignment

    good = np.isfinite(t_s)
    for values in (*commands.values(), *motions.values()):
        good &= np.isfinite(values)
    driven = {name: values[good] for name, values in commands.items() if np.ptp(values[good]) > 0.0}
    moved = {
        name: without_spikes(values[good])
        for name, values in motions.items()
        if np.ptp(values[good]) > 0.0
    }
    at = t_s[good]
    if at.size < LEAST_ROWS or not driven or not moved:
        return []
    best = np.zeros((len(driven), len(moved)))
    for lag in np.linspace(0.0, LONGEST_ANSWER_S, LAGS):
        late = np.column_stack([np.interp(at + lag, at, values) for values in moved.values()])
        size = len(driven)
        signals = np.column_stack([*driven.values(), late])
        matrix = np.corrcoef(signals, rowvar=False)[:size, size:]
        best = np.where(np.abs(matrix) > np.abs(best), matrix, best)
    rows, columns = linear_sum_assignment(-np.abs(best))
    names, axes = list(driven), list(moved)
    return [
        Answer(names[row], axes[column], float(best[row, column]))
        for row, column in zip(rows, columns, strict=True)
        if abs(best[row, column]) >= LEAST_CORRELATION
    ]


def without_spikes(values: Array) -> Array:
    """Return values (n,) cut off at `SPIKE` times what nineteen of twenty stay within.

    A pose that jumps is a speed of metres per second for a moment, which no command gave.
    """
    middle = float(np.median(values))
    most = float(np.quantile(np.abs(values - middle), USUAL))
    return np.clip(values, middle - SPIKE * most, middle + SPIKE * most) if most > 0.0 else values
