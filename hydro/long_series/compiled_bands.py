"""Banded triangular systems of long series as compiled loops, which run in threads.

They take the steps of LAPACK's routines in the same order in a half to a fifth of the
time, and differ from them by rounding: LAPACK's bits are those of the kernel that it
chooses for a processor, which may multiply and add in one. Import this module only where a
series is long: numba takes a second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
F = TypeVar("F", bound=Callable[..., Any])


def _compiled(function: F) -> F:
    compiled: Any = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    return cast(F, compiled)


@_compiled
def factor_sum(first: Array, second: Array, weight: float, factor: Array) -> bool:
    """Write the Cholesky factor of first + weight second; False where there is none.

    Symmetric matrices of three bands as (3, n), lower form: dpbtrf.
    """
    # Squares and products of the columns before: what they take off.
    last = product = newer = older = 0.0
    for j in range(first.shape[1]):
        diagonal = first[0, j] + weight * second[0, j] - older - last
        if not diagonal > 0.0:
            return False
        root = np.sqrt(diagonal)
        inverse = 1.0 / root
        one = (first[1, j] + weight * second[1, j] - product) * inverse
        two = (first[2, j] + weight * second[2, j]) * inverse
        factor[0, j], factor[1, j], factor[2, j] = root, one, two
        last, product, older, newer = one * one, one * two, newer, two * two
    return True


@_compiled
def solve_factored(factor: Array, x: Array) -> None:
    """Put in the place of x (n,) what L L' takes to it: dpbtrs, L of `factor_sum`."""
    n = len(x)
    for j in range(n):
        x[j] /= factor[0, j]
        if j + 1 < n:
            x[j + 1] -= x[j] * factor[1, j]
        if j + 2 < n:
            x[j + 2] -= x[j] * factor[2, j]
    for j in range(n - 1, -1, -1):
        later = 0.0
        if j + 1 < n:
            later += factor[1, j] * x[j + 1]
        if j + 2 < n:
            later += factor[2, j] * x[j + 2]
        x[j] = (x[j] - later) / factor[0, j]


@_compiled
def run_recursion(driven: Array, feedback: Array, out: Array) -> None:
    """Write `recursion` of driven (n, k) and feedback (m,) to out (n, k): dtbtrs."""
    for i in range(driven.shape[0]):
        for column in range(driven.shape[1]):
            value = driven[i, column]
            for back in range(min(len(feedback), i), 0, -1):
                value -= feedback[back - 1] * out[i - back, column]
            out[i, column] = value
