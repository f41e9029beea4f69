"""The array type of this package and small batched helpers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

AXES = ("X", "Y", "Z", "K", "M", "N")
VELOCITIES = ("u", "v", "w", "p", "q", "r")


def read_only(values: ArrayLike) -> Array:
    """A float64 copy that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def cross(a: Array, b: Array) -> Array:
    """a x b for (..., 3) arrays that broadcast; several times faster than `np.cross` on
    long batches.
    """
    a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2]
    b1, b2, b3 = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1], axis=-1)


def matrix_product(matrix: ArrayLike, vector: ArrayLike) -> Array:
    """Matrices (m, n), or one for each member (..., m, n), times vectors (..., n) ->
    (..., m).
    """
    left, right = np.asarray(matrix, dtype=np.float64), np.asarray(vector, dtype=np.float64)
    return np.asarray(right @ left.T if left.ndim == 2 else (left @ right[..., None])[..., 0])


def stack_matrix(rows: list[list[Array | float]], shape: tuple[int, ...]) -> Array:
    """Matrices (*shape, m, n) from their entries, each a scalar or an array of `shape`."""
    out = np.empty((*shape, len(rows), len(rows[0])))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            out[..., i, j] = entry
    return out
