"""Resampling to a uniform clock without extrapolation; long gaps stay nan.

Attitude is interpolated as a rotation. Euler angles are [phi, theta, psi] in rad, ZYX,
body to NED.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.splines import lambda_from_cutoff, smoothing_spline

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class SmoothAttitude:
    """Smoothed Euler angles (m, 3) [rad], body rates p q r [rad/s] and their rates.

    Yaw is continuous. `lambda_` is the smoothing parameter used, `sigma_rad` the
    standard deviation of the noise about one axis.
    """

    euler: Array
    omega: Array
    omega_dot: Array
    lambda_: float
    sigma_rad: float


def gaps(t_s: ArrayLike, max_gap_s: float) -> list[tuple[int, int]]:
    """Return unbroken segments as index pairs [start, end) of t_s (n,).

    In a segment no step is longer than `max_gap_s` [s].
    """
    t = np.asarray(t_s, dtype=np.float64)
    if not len(t):
        return []
    edges = [0, *(int(i) + 1 for i in np.flatnonzero(np.diff(t) > max_gap_s)), len(t)]
    return list(pairwise(edges))


def uniform_clock(start_s: float, end_s: float, rate_hz: float) -> Array:
    """Return times (m,) [s] from start_s on at `rate_hz`, none later than end_s.

    Raises `DataError` for an empty span or a rate that is not positive.
    """
    if not (rate_hz > 0 and end_s >= start_s):
        raise DataError(
            "a uniform clock needs a positive rate and an end after its start",
            value=(start_s, end_s, rate_hz),
        )
    # A thousandth of a step is forgiven so that rounding does not lose the last sample.
    return start_s + np.arange(int(np.floor((end_s - start_s) * rate_hz + 1e-3)) + 1) / rate_hz


def unwrap_angles(angles: ArrayLike) -> Array:
    """Return angles (n,) or (n, k) [rad] without jumps of 2 pi along time."""
    return np.unwrap(np.asarray(angles, dtype=np.float64), axis=0)


def linear(t_s: ArrayLike, y: ArrayLike, t_new: ArrayLike, *, max_gap_s: float = np.inf) -> Array:
    """Interpolate y (n,) or (n, k) linearly at t_new (m,).

    nan outside the samples and inside gaps longer than `max_gap_s`. t_s must increase
    strictly. A sample exactly at a gap's edge is given. Raises
    `DataError` otherwise.
    """
    t, values, new = (
        _series(t_s, y),
        np.asarray(y, dtype=np.float64),
        np.asarray(t_new, dtype=np.float64),
    )
    left, share, inside = _locate(t, new, max_gap_s)
    share = share.reshape((-1,) + (1,) * (values.ndim - 1))
    right = np.minimum(left + 1, len(t) - 1)
    # Where the time is a sample's own, its neighbour must not count, be it nan.
    out = np.where(share > 0, values[left] + share * (values[right] - values[left]), values[left])
    out[~inside] = np.nan
    return out


def hold(t_s: ArrayLike, y: ArrayLike, t_new: ArrayLike, *, max_gap_s: float = np.inf) -> Array:
    """Return the previous sample of y (n,) or (n, k) at t_new (m,), for commands.

    nan before the first sample, and later than the last one. A sample is held for at
    most `max_gap_s` [s]. Errors as `linear`.
    """
    t, values, new = (
        _series(t_s, y),
        np.asarray(y, dtype=np.float64),
        np.asarray(t_new, dtype=np.float64),
    )
    left = np.clip(np.searchsorted(t, new, side="right") - 1, 0, len(t) - 1)
    out = values[left].copy()
    out[(new < t[0]) | (new > t[-1]) | (new - t[left] > max_gap_s)] = np.nan
    return out


def interpolate_rotation(
    t_s: ArrayLike, euler: ArrayLike, t_new: ArrayLike, *, max_gap_s: float = np.inf
) -> Array:
    """Return attitude (m, 3) at t_new along the shortest rotation between samples.

    From attitude (n, 3); yaw is continuous; nan outside and inside gaps. Neighbouring
    samples must be less than half a turn apart. Errors as `linear`.
    """
    from scipy.spatial.transform import Slerp

    t, new = _series(t_s, euler), np.asarray(t_new, dtype=np.float64)
    angles = np.asarray(euler, dtype=np.float64)
    if not np.isfinite(angles).all():
        raise DataError("an attitude is not finite")
    _, _, inside = _locate(t, new, max_gap_s)
    out = np.full((len(new), 3), np.nan)
    if not inside.any():
        return out
    if len(t) == 1:
        out[inside] = angles[0]
        return out
    out[inside] = _continuous(_to_euler(Slerp(t, _rotation(angles))(new[inside])), angles[0, 2])
    return out


def smooth_attitude(
    t_s: ArrayLike,
    euler: ArrayLike,
    t_new: ArrayLike,
    *,
    lam: float | None = None,
    cutoff_hz: float | None = None,
) -> SmoothAttitude:
    """Return smoothed attitude and body rates at t_new (m,) from attitude (n, 3).

    nan outside the samples. A smoothing spline of the four components of the unit
    quaternion (signs made continuous), scaled back to unit length, with one lambda for
    all: given, or from a half-amplitude frequency `cutoff_hz`, or by GCV. This has no
    singular attitude and does not depend on the choice of axes: turning the inertial or
    the body frame turns the result. Body rates are exact derivatives of the smoothed
    rotation. Valid while the attitude turns little within a smoothing period (the
    smoothed quaternion must not shrink towards zero).
    """
    from scipy.spatial.transform import Rotation

    t, new = _series(t_s, euler), np.asarray(t_new, dtype=np.float64)
    angles = np.asarray(euler, dtype=np.float64)
    q = _rotation(angles).as_quat()
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))
    q[1:] *= flips[:, None]
    if cutoff_hz is not None:
        lam = lambda_from_cutoff(cutoff_hz, float(t[-1] - t[0]) / (len(t) - 1))
    spline = smoothing_spline(t, q, lam=lam, shared=True)
    s, s1, s2 = (spline.evaluate(new, order) for order in range(3))
    square = np.sum(s**2, axis=1, keepdims=True)
    omega = 2.0 * _conjugate_times(s, s1) / square
    omega_dot = (
        2.0 * _conjugate_times(s, s2) / square
        - 2.0 * omega * np.sum(s * s1, axis=1, keepdims=True) / square
    )
    inside = np.isfinite(square[:, 0])
    out = np.full((len(new), 3), np.nan)
    if inside.any():
        out[inside] = _continuous(_to_euler(Rotation.from_quat(s[inside])), angles[0, 2])
    # A small turn changes the quaternion by half its angle, spread over three of the
    # four components.
    sigma = 2.0 * float(np.sqrt(np.sum(spline.sigma**2) / 3.0))
    return SmoothAttitude(out, omega, omega_dot, float(spline.lambda_[0]), sigma)


def _conjugate_times(a: Array, b: Array) -> Array:
    """Return the vector part of conj(a) * b for quaternions (x, y, z, w)."""
    return a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])


def _rotation(euler: Array) -> Rotation:
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("ZYX", euler[:, ::-1])


def _to_euler(rotation: Rotation) -> Array:
    return np.asarray(rotation.as_euler("ZYX")[:, ::-1], dtype=np.float64)


def _continuous(euler: Array, yaw_start: float) -> Array:
    """Return unwrapped angles with the turn count of the first measured yaw."""
    out = np.unwrap(euler, axis=0)
    out[:, 2] += 2.0 * np.pi * np.round((yaw_start - out[0, 2]) / (2.0 * np.pi))
    return out


def _series(t_s: ArrayLike, y: ArrayLike) -> Array:
    t = np.asarray(t_s, dtype=np.float64)
    if t.ndim != 1 or not len(t) or len(np.asarray(y)) != len(t):
        raise DataError(
            "times and values differ in length, or there are none", value=(t.shape, np.shape(y))
        )
    if not np.all(np.diff(t) > 0):
        raise DataError(
            "times must increase strictly",
            row=int(np.argmin(np.diff(t))) + 1,
            field="t_s",
            remedy="Clean the clock first.",
        )
    return t


def _locate(
    t: Array, new: Array, max_gap_s: float
) -> tuple[NDArray[np.intp], Array, NDArray[np.bool_]]:
    """Return left neighbour, share of the way to the right one, and whether inside.

    Inside: at or between samples that belong together.
    """
    left = np.clip(np.searchsorted(t, new, side="right") - 1, 0, max(len(t) - 2, 0))
    right = np.minimum(left + 1, len(t) - 1)
    width = np.where(right > left, t[right] - t[left], 1.0)
    share = (new - t[left]) / width
    at_end = share == 1.0
    left, share = np.where(at_end, right, left), np.where(at_end, 0.0, share)
    inside = (new >= t[0]) & (new <= t[-1]) & ((width <= max_gap_s) | (share == 0.0))
    return left, share, inside
