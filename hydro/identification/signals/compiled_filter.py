"""Kalman filter over many columns at once as a compiled loop.

Import this module only where a filter runs: numba takes a second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from auvid.hydro.arrays import Array, Ints

F = TypeVar("F", bound=Callable[..., Any])


def _compiled(function: F) -> F:
    compiled: Any = numba.njit(cache=True, error_model="numpy")(function)
    return cast(F, compiled)


@_compiled
def run_filter(
    transitions: Array,
    gains: Array,
    processes: Array,
    inputs: Array,
    x: Array,
    P: Array,
    steps: Ints,
    sensor: Ints,
    values: Array,
    variance: Array,
    innovations: Array,
    scaled: Array,
) -> None:
    """Run the filter from x (7, k), P (7, 7), one scalar measurement at a time.

    x = F x + G (u + u_before) / 2, P = F P F' + Q by step: `transitions` and `processes`
    (n, 7, 7), `gains` (n, 7, 3), `inputs` (n, 3, k). Measurements at `steps` (m,): entry
    1 to 3 of x for `sensor` 0 to 2, else entry 0; `values` (m, k). Written: x, P,
    `innovations` (m, k) and their variances `scaled` (m,).
    """
    # Plain loops: products of matrices by @ take numba a quarter of a minute to compile.
    size, columns, acting = x.shape[0], x.shape[1], inputs.shape[1]
    row, gain, turned, moved = 0, np.zeros(size), np.zeros((size, size)), np.zeros((size, columns))
    for step in range(len(transitions)):
        if step > 0:
            F, G, Q = transitions[step], gains[step], processes[step]
            for i in range(size):
                for c in range(columns):
                    total = 0.0
                    for j in range(size):
                        total += F[i, j] * x[j, c]
                    for j in range(acting):
                        total += G[i, j] * 0.5 * (inputs[step, j, c] + inputs[step - 1, j, c])
                    moved[i, c] = total
                for j in range(size):
                    total = 0.0
                    for k in range(size):
                        total += F[i, k] * P[k, j]
                    turned[i, j] = total
            for i in range(size):
                for c in range(columns):
                    x[i, c] = moved[i, c]
                for j in range(size):
                    total = Q[i, j]
                    for k in range(size):
                        total += turned[i, k] * F[j, k]
                    P[i, j] = total
        while row < len(steps) and steps[row] == step:
            entry = sensor[row] + 1 if sensor[row] < 3 else 0  # velocity v, depth z
            s = variance[sensor[row]] + P[entry, entry]
            scaled[row] = s
            for c in range(columns):
                innovations[row, c] = values[row, c] - x[entry, c]
            for i in range(size):
                gain[i] = P[i, entry] / s
            for i in range(size):
                for c in range(columns):
                    x[i, c] += gain[i] * innovations[row, c]
                for j in range(size):
                    P[i, j] -= gain[i] * gain[j] * s
            row += 1
