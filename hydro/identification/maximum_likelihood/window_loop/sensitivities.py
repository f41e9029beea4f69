"""Derivatives of states and predictions by the parameters."""

from __future__ import annotations

from auvid.hydro.arrays import Array
from auvid.hydro.identification.maximum_likelihood.window_loop.compiling import compiled
from auvid.hydro.identification.maximum_likelihood.window_loop.layout import MOTION
from auvid.hydro.identification.maximum_likelihood.window_loop.transition import write_product


@compiled
def carry_sensitivities(
    S: Array,
    Phi: Array,
    fade: Array,
    push: Array,
    a0: Array,
    a1: Array,
    T: Array,
) -> None:
    """Replace S (n, m) by Phi S and what the parameters' accelerations add."""
    n, m = S.shape
    parameters = a0.shape[1]
    write_product(Phi, S, T)
    for i in range(MOTION):
        for k in range(6):
            early, late = push[0, i, k], push[1, i, k]
            for p in range(parameters):
                T[i, p] += early * a0[k, p] + late * a1[k, p]
    for i in range(n):
        for j in range(m):
            S[i, j] = T[i, j] if i < MOTION else fade[i] * S[i, j]


@compiled
def write_row_product(row: Array, matrix: Array, out: Array) -> None:
    """Write row . matrix, zeros of the row left out."""
    for j in range(len(out)):
        out[j] = 0.0
    for i in range(len(row)):
        part = row[i]
        if part != 0.0:
            for j in range(len(out)):
                out[j] += part * matrix[i, j]


@compiled
def add_turned_slopes(lever: Array, pull: Array, shift: Array, out: Array) -> None:
    """Add the parameters' change of an accelerometer's slopes times a state shift."""
    for p in range(len(pull)):
        for row in range(6):
            for j in range(len(shift)):
                out[p] += lever[row] * pull[p, row, j] * shift[j]
