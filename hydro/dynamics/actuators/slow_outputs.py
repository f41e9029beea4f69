"""Outputs that are logged slowly, rebuilt between their samples from what made them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from auvid.hydro.arrays import Array

Index = npt.NDArray[np.intp]

LEAST_SAMPLES = 40
"""Samples of a mode below which nothing is regressed in it."""
RIDGE = 1e-6
"""Of the mean square of the regressors: outputs of a mixer are often dependent."""


@dataclass(frozen=True)
class RebuiltOutputs:
    """Outputs (m, k) on a clock, and how well two ways give samples left out.

    `rebuilt`, `interpolated` (k,): share of the variance of left-out samples that is
    explained; `used` (k,): whether the rebuilt output is the one in `values`.
    """

    values: Array
    rebuilt: Array
    interpolated: Array
    used: npt.NDArray[np.bool_]


def rebuild_outputs(
    t_s: Array,
    outputs: Array,
    causes: Array,
    mode: Index,
    *,
    clock_s: Array,
    clock_causes: Array,
    clock_mode: Index,
    remainders: bool = False,
) -> RebuiltOutputs:
    """Return outputs (n, k) at t_s on a faster clock (m,), by regression on causes.

    causes: sticks, gyro ... at t_s (n, c) and on the clock (m, c); mode: a number for the
    autopilot's mode at both. In each mode each output is y = g0 + g . causes by least
    squares. remainders: what remains at the samples is added between them, by lines; where
    it is error of their stamps that holds the output. Whether that is better than
    interpolation alone is judged on every other sample, left out of both: over twice the
    log's pauses, in favour of causes, which fly yaw better than a judgement over its own
    pauses does (decision 0029).
    """
    smooth = _along(t_s, outputs, clock_s)
    values = _rebuilt(t_s, outputs, causes, mode, clock_s, clock_causes, clock_mode, remainders)
    fitted, left = slice(0, None, 2), slice(1, None, 2)
    at, measured = t_s[left], outputs[left]
    guess = _rebuilt(
        t_s[fitted], outputs[fitted], causes[fitted], mode[fitted], at, causes[left], mode[left],
        remainders,
    )  # fmt: skip
    rebuilt = _explained(measured, guess)
    interpolated = _explained(measured, _along(t_s[fitted], outputs[fitted], at))
    used = rebuilt > interpolated
    return RebuiltOutputs(np.where(used, values, smooth), rebuilt, interpolated, used)


def _rebuilt(
    t_s: Array,
    outputs: Array,
    causes: Array,
    mode: Index,
    clock_s: Array,
    clock_causes: Array,
    clock_mode: Index,
    remainders: bool,
) -> Array:
    values = _along(t_s, outputs, clock_s)
    for number in np.unique(mode):
        rows, later = mode == number, clock_mode == number
        if np.count_nonzero(rows) < LEAST_SAMPLES:
            continue
        x = np.column_stack([np.ones(np.count_nonzero(rows)), causes[rows]])
        moment = x.T @ x
        moment += RIDGE * np.trace(moment) / len(moment) * np.eye(len(moment))
        gain = np.linalg.solve(moment, x.T @ outputs[rows])
        more = np.column_stack([np.ones(np.count_nonzero(later)), clock_causes[later]])
        values[later] = more @ gain
        if remainders:
            values[later] += _along(t_s[rows], outputs[rows] - x @ gain, clock_s[later])
    return values


def _along(t_s: Array, values: Array, clock_s: Array) -> Array:
    return np.stack([np.interp(clock_s, t_s, column) for column in values.T], axis=1)


def _explained(measured: Array, guess: Array) -> Array:
    """Return the share of the variance (k,) that a guess explains; 0 of a constant."""
    total = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
    error = np.sum((measured - guess) ** 2, axis=0)
    return np.asarray(1.0 - np.divide(error, total, out=np.ones_like(total), where=total > 0.0))
