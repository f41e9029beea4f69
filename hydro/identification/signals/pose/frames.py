"""Quaternions and world frames of a pose: to north-east-down, forward-right-down."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from auvid.hydro.arrays import Array

World = Literal["ned", "enu", "nwu", "nue"]
Body = Literal["frd", "flu", "fur"]
HALF = float(np.sqrt(0.5))
TO_NED: Mapping[World, tuple[float, float, float, float]] = {
    "ned": (1.0, 0.0, 0.0, 0.0),
    "enu": (0.0, HALF, HALF, 0.0),
    "nwu": (0.0, 1.0, 0.0, 0.0),
    "nue": (HALF, -HALF, 0.0, 0.0),
}
"""Quaternion (w, x, y, z) that turns vectors of a world frame into north-east-down.

nwu is any frame with z up whose x counts as north, nue any with y up.
"""
FROM_FRD: Mapping[Body, tuple[float, float, float, float]] = {
    "frd": (1.0, 0.0, 0.0, 0.0),
    "flu": (0.0, 1.0, 0.0, 0.0),
    "fur": (HALF, HALF, 0.0, 0.0),
}
"""Quaternion (w, x, y, z) that turns vectors of forward-right-down into body axes."""


def quaternion_product(a: ArrayLike, b: ArrayLike) -> Array:
    """Return a b of quaternions (..., 4), w first.

    >>> quaternion_product([0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0])
    array([0., 0., 0., 1.])
    """
    p, q = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    w = p[..., 0] * q[..., 0] - np.sum(p[..., 1:] * q[..., 1:], axis=-1)
    v = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + np.cross(p[..., 1:], q[..., 1:])
    return np.concatenate([w[..., None], v], axis=-1)


def quaternion_of_euler(euler: ArrayLike) -> Array:
    """Return unit quaternions (n, 4), w first, of roll, pitch, yaw (n, 3) [rad]."""
    half = 0.5 * np.asarray(euler, dtype=np.float64)
    (cf, ct, cp), (sf, st, sp) = np.cos(half).T, np.sin(half).T
    return np.column_stack(
        [
            cf * ct * cp + sf * st * sp,
            sf * ct * cp - cf * st * sp,
            cf * st * cp + sf * ct * sp,
            cf * ct * sp - sf * st * cp,
        ]
    )


def euler_of_quaternion(quaternion: ArrayLike) -> Array:
    """Return roll, pitch, yaw (n, 3) [rad] of quaternions (n, 4), w first.

    Of any length; NaN for one of none.

    >>> np.round(euler_of_quaternion([[1.0, 0.0, 0.0, 1.0]]), 4)
    array([[0.    , 0.    , 1.5708]])
    """
    q = np.asarray(quaternion, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return np.column_stack(
        [
            np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ]
    )


def rotated(quaternion: ArrayLike, vectors: ArrayLike) -> Array:
    """Return vectors (n, 3) turned by unit quaternions (n, 4) or (4,), w first."""
    q, v = np.asarray(quaternion, dtype=np.float64), np.asarray(vectors, dtype=np.float64)
    twice = 2.0 * np.cross(q[..., 1:], v)
    return np.asarray(v + q[..., :1] * twice + np.cross(q[..., 1:], twice))


def in_ned(vectors: ArrayLike, world: World) -> Array:
    """Return vectors (n, 3) of a world frame in north-east-down.

    >>> np.round(in_ned([[1.0, 2.0, 3.0]], "enu"), 6)
    array([[ 2.,  1., -3.]])
    """
    return rotated(TO_NED[world], vectors)


def ned_from_frd(quaternion: ArrayLike, world: World, body: Body) -> Array:
    """Return quaternions (n, 4) that turn forward-right-down into north-east-down.

    q_nb = q_nw q_wf q_fb: of those (n, 4) that turn body axes f of the file into its
    world w.
    """
    return quaternion_product(
        quaternion_product(TO_NED[world], np.asarray(quaternion, dtype=np.float64)), FROM_FRD[body]
    )


def continuous_signs(quaternion: ArrayLike) -> Array:
    """Return quaternions (n, 4) of unit length whose signs follow the last five.

    q and -q are one attitude; a single outlier does not turn those behind it.
    """
    q = np.array(quaternion, dtype=np.float64)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    for row in range(1, len(q)):
        if float(q[max(0, row - 5) : row].sum(axis=0) @ q[row]) < 0.0:
            q[row] = -q[row]
    return q
