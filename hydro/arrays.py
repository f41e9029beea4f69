"""Array types, names of axes and velocities, and batched products of small matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Buffer = NDArray[np.uint8]

LONG = 100_000
"""Values from which a recursion is worth a compiled loop: numba takes a second."""
AXES = ("X", "Y", "Z", "K", "M", "N")
"""Forces and moments in body axes, as SNAME names them."""
VELOCITIES = ("u", "v", "w", "p", "q", "r")
"""Linear and angular velocities in body axes, as SNAME names them."""
STATES = (*VELOCITIES, "x", "y", "z", "phi", "theta", "psi")
"""The state [nu, eta] of every simulation, plant and controller: Al Makdah (3.1)."""


def read_only(values: ArrayLike) -> Array:
    """Return a float64 copy that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def components(vectors: Array) -> tuple[Array, ...]:
    """Return the components of vectors (..., n) as n arrays (...).

    On small arrays several times faster than `np.moveaxis`.
    """
    return tuple(vectors[..., i] for i in range(vectors.shape[-1]))


def numbers_or_components(*vectors: Array) -> list[tuple[Any, ...]]:
    """Return the components of vectors (..., n), of single ones as numbers of Python.

    Sums of products of those take a tenth of the time. `joined` makes a vector again.
    """
    if all(vector.ndim == 1 for vector in vectors):
        return [tuple(vector.tolist()) for vector in vectors]
    return [components(vector) for vector in vectors]


def joined(parts: Sequence[Any]) -> Array:
    """Return the vectors (..., n) of n components: numbers, or arrays of one shape."""
    return np.array(parts) if isinstance(parts[0], float) else np.stack(parts, axis=-1)


def cross(a: Array, b: Array) -> Array:
    """Return a x b of arrays (..., 3) that broadcast.

    On long batches several times faster than `np.cross`.
    """
    first, second, third = cross_components(components(a), components(b))
    out = np.empty((*first.shape, 3))
    out[..., 0], out[..., 1], out[..., 2] = first, second, third
    return out


def cross_components(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return the components of a x b: arrays of one shape, or compiled numbers."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def matrix_product(matrix: ArrayLike, vector: ArrayLike) -> Array:
    """Return matrices (m, n) or (..., m, n) times vectors (..., n): (..., m)."""
    left, right = np.asarray(matrix, dtype=np.float64), np.asarray(vector, dtype=np.float64)
    return np.asarray(right @ left.T if left.ndim == 2 else (left @ right[..., None])[..., 0])


def stack_matrix(rows: list[list[Array | float]], shape: tuple[int, ...]) -> Array:
    """Return matrices (*shape, m, n) of entries that are scalars or have `shape`."""
    out = np.empty((*shape, len(rows), len(rows[0])))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            out[..., i, j] = entry
    return out


def run_edges(mask: Mask) -> Index:
    """Return first and last + 1 (k, 2) of each unbroken run of True in a mask (n,)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]))).reshape(-1, 2)


def runs_of(mask: Mask) -> list[tuple[int, int]]:
    """Return first and last + 1 of each unbroken run of True in a mask (n,).

    >>> runs_of(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    return [(int(first), int(end)) for first, end in run_edges(mask)]


def moving_mean(values: Array, width: int) -> Array:
    """Return the mean (n,) or (n, k) of `width` samples about each of values.

    The first and the last stand for what lies beyond them. To the bit what
    `scipy.ndimage.uniform_filter1d` gives, which takes a fifth of a second to import.

    >>> moving_mean(np.array([0.0, 3.0, 6.0, 6.0]), 3).tolist()
    [1.0, 3.0, 5.0, 6.0]
    """
    before = width // 2
    first, last = values[:1].repeat(before, axis=0), values[-1:].repeat(width - 1 - before, axis=0)
    padded = np.concatenate([first, values, last])
    start = np.cumsum(padded[:width], axis=0)[-1:]
    steps = padded[width:] - padded[:-width]
    return np.asarray(np.cumsum(np.concatenate([start, steps]), axis=0) / width)


def median(values: Array) -> Array:
    """Return the median (...) of values (n, ...) along the first axis.

    That of `np.median`, in a fifth of the time for some thousand values or fewer.

    >>> float(median(np.array([4.0, 1.0, 2.0, 9.0])))
    3.0
    """
    low, high = (len(values) - 1) // 2, len(values) // 2
    if not len(values) or np.isnan(values).any():
        return np.asarray(np.median(values, axis=0))
    ordered = np.partition(values, high if low == high else (low, high), axis=0)
    return np.asarray(ordered[low] if low == high else 0.5 * (ordered[low] + ordered[high]))


def unwrapped(angles: Array) -> Array:
    """Return angles (n,) or (n, k) [rad] without their jumps by a turn.

    To the bit what `np.unwrap` gives along the first axis, in a quarter of the time or
    less.

    >>> unwrapped(np.radians([170.0, -170.0])).round(3).tolist()
    [2.967, 3.316]
    """
    steps = angles[1:] - angles[:-1]
    jumps = ~(np.abs(steps) < np.pi)  # nan spoils what follows it
    if not jumps.any():
        return angles
    step = steps[jumps]
    short = np.mod(step + np.pi, 2.0 * np.pi) - np.pi
    short[(short == -np.pi) & (step > 0.0)] = np.pi
    turns = np.zeros(angles.shape)
    turns[1:][jumps] = short - step
    return np.asarray(angles + np.cumsum(turns, axis=0))


def recursion(driven: Array, feedback: ArrayLike) -> Array:
    """Return y (n, k) with y_i = x_i - a_1 y_i-1 - a_2 y_i-2 - ..., at rest before x_0.

    driven: x (n, k); feedback: a (m,), m < n. The solution of a banded triangular system;
    `scipy.signal.lfilter` does the same, and takes half a second to import.

    >>> recursion(np.array([[1.0], [0.0], [0.0]]), [-0.5]).ravel().tolist()
    [1.0, 0.5, 0.25]
    """
    if driven.size == 0:  # LAPACK's wrapper writes where it may not for no columns
        return driven.copy()
    weights = np.asarray(feedback, dtype=np.float64)
    if driven.size > LONG:
        from auvid.hydro.long_series.compiled_bands import run_recursion

        out = np.empty(driven.shape)
        # Copies: numba compiles the loop once more for arrays that cannot be written to.
        run_recursion(np.array(driven, order="C"), np.array(weights), out)
        return out
    from scipy.linalg import lapack

    bands = np.empty((1 + len(weights), len(driven)), order="F")
    bands[0], bands[1:] = 1.0, weights[:, None]
    values, _ = lapack.dtbtrs(bands, driven, uplo="L", diag="U")
    return np.asarray(values)
