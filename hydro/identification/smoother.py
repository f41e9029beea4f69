"""Velocity by a linear time-varying Kalman filter and Rauch-Tung-Striebel smoother (filterpy), with accelerometer bias and depth.

State (13): depth z, body velocity v (3), inertial acceleration f = v_dot + omega x v (3), its rate j (3), bias b (3). Between samples

    z_dot = (R v)_3,   v_dot = f - omega x v,   f_dot = j,   j_dot = white noise of density q,   b_dot = white noise of density q_b.

With j as white-noise driven state, f is what a cubic smoothing spline with lambda = sigma^2 / q estimates; the defaults of q and of the
accelerometer's noise come from such a spline by generalised cross-validation. The bias walks slowly: the tilt error of an attitude
reference leaks gravity into the accelerometer, changes over its correlation time, and cannot be told from a bias within it.
Measurements at their own times: accelerometer f + b, velocity sensor v (lever arm and mounting taken out), depth z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from data_schemas.errors import DataError
from hydro.dynamics.arrays import Array, cross
from hydro.dynamics.kinematics import rotation_body_to_ned, skew
from hydro.identification.splines import smoothing_spline

Z, V, F, J, B = 0, slice(1, 4), slice(4, 7), slice(7, 10), slice(10, 13)
SIZE, MEASURED = 13, 7
UNSEEN = 1e10
"""Variance of a measurement that is missing at a step: it weighs nothing."""
FLOOR = {"accel": 1e-4, "velocity": 1e-4, "depth": 1e-4}
"""Smallest noise that is believed [m/s^2, m/s, m]; noise-free data would make the gains singular."""


@dataclass(frozen=True)
class SmootherNoise:
    """Noise of the sensors and of the motion, SI; None is estimated from the data.

    accel, velocity, depth: standard deviations per sample; jerk_density: q (3,) of j [m^2/s^7]; tilt_error_rad, tilt_time_s: size and
    correlation time of the attitude reference's error in roll and pitch; bias: prior standard deviation of the bias [m/s^2].
    """

    accel: Array | None = None
    velocity: Array | None = None
    depth: float | None = None
    jerk_density: Array | None = None
    tilt_error_rad: float = 1e-3
    tilt_time_s: float = 30.0
    bias: float = 0.5
    gravity: float = 9.80665

    @property
    def bias_density(self) -> float:
        """Density q_b [m^2/s^5] of the bias walk that grows to the gravity leak of the tilt error within its correlation time."""
        return (self.gravity * self.tilt_error_rad) ** 2 / self.tilt_time_s


@dataclass(frozen=True)
class SmoothedVelocity:
    """Body velocity, its rate and the bias at the smoother's steps, each (n, 3), with standard deviations, and the noise used."""

    t_s: Array
    velocity: Array
    rate: Array
    bias: Array
    velocity_sd: Array
    bias_sd: Array
    depth: Array
    noise: SmootherNoise


def estimated_noise(
    t_s: Array, accel: Array, t_velocity: Array, velocity: Array, t_depth: Array, depth: Array, noise: SmootherNoise
) -> SmootherNoise:
    """The noise with what is None estimated: sensor noise and jerk density by smoothing splines with GCV (sigma, sigma^2 / lambda)."""
    a = smoothing_spline(t_s, accel)
    sigma = np.maximum(a.sigma, FLOOR["accel"])
    return SmootherNoise(
        accel=sigma if noise.accel is None else noise.accel,
        velocity=np.maximum(smoothing_spline(t_velocity, velocity).sigma, FLOOR["velocity"]) if noise.velocity is None else noise.velocity,
        depth=float(np.maximum(smoothing_spline(t_depth, depth).sigma, FLOOR["depth"])) if noise.depth is None else noise.depth,
        jerk_density=sigma**2 / np.maximum(a.lambda_, 1e-12) if noise.jerk_density is None else noise.jerk_density,
        tilt_error_rad=noise.tilt_error_rad,
        tilt_time_s=noise.tilt_time_s,
        bias=noise.bias,
        gravity=noise.gravity,
    )


def smooth_velocity(
    t_s: ArrayLike,
    accel: ArrayLike,
    euler: ArrayLike,
    omega: ArrayLike,
    *,
    t_velocity: ArrayLike,
    velocity: ArrayLike,
    t_depth: ArrayLike,
    depth: ArrayLike,
    noise: SmootherNoise | None = None,
) -> SmoothedVelocity:
    """Smoothed velocity of the body origin at the accelerometer's times t_s (n,) [s].

    accel (n, 3): inertial acceleration with bias, gravity and lever arm taken out (`inertial_acceleration`); euler, omega (n, 3) there.
    velocity (m, 3) at t_velocity (m,): of the body origin (`lever_arm_velocity`); depth (k,) at t_depth (k,): of the body origin. Each
    is used at the nearest step, carried there along the acceleration. Raises `DataError` for values that are not finite or too few samples.
    """
    t, a = np.asarray(t_s, dtype=np.float64), np.asarray(accel, dtype=np.float64)
    angles, w = np.asarray(euler, dtype=np.float64), np.asarray(omega, dtype=np.float64)
    tv, v = _inside(t, t_velocity, velocity)
    tz, z = _inside(t, t_depth, depth)
    if not (np.isfinite(a).all() and np.isfinite(angles).all() and np.isfinite(w).all() and np.isfinite(v).all() and np.isfinite(z).all()):
        raise DataError("a value to smooth is not finite", remedy="Split the leg at its gaps first.")
    if min(len(t), len(tv), len(tz)) < 5:
        raise DataError("too few samples to smooth a velocity", value=(len(t), len(tv), len(tz)), allowed="5 or more of each sensor")
    used = estimated_noise(t, a, tv, v, tz, z, noise or SmootherNoise())
    transitions, processes = _transitions(t, angles, w, used)
    zs, Rs = _measurements(t, a, w, tv, v, tz, z, used)
    H = np.zeros((MEASURED, SIZE))
    H[:3, F] = H[:3, B] = H[3:6, V] = np.eye(3)
    H[6, Z] = 1.0
    from filterpy.kalman import KalmanFilter  # a second to import, and only this method needs it

    kalman = KalmanFilter(dim_x=SIZE, dim_z=MEASURED)
    kalman.x = np.concatenate([z[:1], v[0], a[0], np.zeros(6)])[:, None]
    kalman.P = np.diag([1.0] + [0.25] * 3 + [1.0] * 3 + [10.0] * 3 + [used.bias**2] * 3)
    kalman.H = H
    means, covariances, _, _ = kalman.batch_filter(zs, Fs=list(transitions), Qs=list(processes), Rs=list(Rs))
    means, covariances, _, _ = kalman.rts_smoother(means, covariances, Fs=list(transitions), Qs=list(processes))
    x, variance = means[:, :, 0], np.maximum(np.einsum("nii->ni", covariances), 0.0)
    return SmoothedVelocity(
        t_s=t,
        velocity=x[:, V],
        rate=x[:, F] - cross(w, x[:, V]),
        bias=x[:, B],
        velocity_sd=np.sqrt(variance[:, V]),
        bias_sd=np.sqrt(variance[:, B]),
        depth=x[:, Z],
        noise=used,
    )


def _inside(t: Array, times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    stamp, value = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    keep = (stamp >= t[0]) & (stamp <= t[-1])
    return stamp[keep], value[keep]


def _transitions(t: Array, euler: Array, omega: Array, noise: SmootherNoise) -> tuple[Array, Array]:
    """Transition matrices (n, 13, 13) and process noise from step k - 1 to k; the first is the identity without noise."""
    n, dt = len(t), np.diff(t, prepend=t[0])
    middle = 0.5 * (omega + np.roll(omega, 1, axis=0))
    down = rotation_body_to_ned(euler)[:, 2, :]
    A = np.zeros((n, SIZE, SIZE))
    A[:, Z, V] = 0.5 * (down + np.roll(down, 1, axis=0))
    A[:, V, V] = -skew(middle)
    A[:, V, F] = A[:, F, J] = np.eye(3)
    step = A * dt[:, None, None]
    transition = np.eye(SIZE) + step
    power = step
    for order in (2, 3, 4):
        power = power @ step / order
        transition = transition + power
    Q = np.zeros((n, SIZE, SIZE))
    assert noise.jerk_density is not None
    place = np.arange(3)
    blocks = [
        (J, J, dt),
        (F, F, dt**3 / 3),
        (V, V, dt**5 / 20),
        (F, J, dt**2 / 2),
        (J, F, dt**2 / 2),
        (V, F, dt**4 / 8),
        (F, V, dt**4 / 8),
        (V, J, dt**3 / 6),
        (J, V, dt**3 / 6),
    ]
    for row, column, size in blocks:
        Q[:, row.start + place, column.start + place] = size[:, None] * noise.jerk_density
    Q[:, B.start + place, B.start + place] = dt[:, None] * noise.bias_density
    return transition, Q


def _measurements(
    t: Array, accel: Array, omega: Array, tv: Array, v: Array, tz: Array, z: Array, noise: SmootherNoise
) -> tuple[Array, Array]:
    """Measurement columns (n, 7, 1) and their covariances (n, 7, 7); what is missing at a step has the variance `UNSEEN`."""
    assert noise.accel is not None
    assert noise.velocity is not None
    n = len(t)
    values, variance = np.zeros((n, MEASURED)), np.full((n, MEASURED), UNSEEN)
    values[:, :3], variance[:, :3] = accel, noise.accel**2
    at = _nearest(t, tv)
    rate = accel[at] - cross(omega[at], v)
    values[at, 3:6], variance[at, 3:6] = v + (t[at] - tv)[:, None] * rate, noise.velocity**2
    at = _nearest(t, tz)
    values[at, 6], variance[at, 6] = z, cast(float, noise.depth) ** 2
    covariance = np.zeros((n, MEASURED, MEASURED))
    covariance[:, np.arange(MEASURED), np.arange(MEASURED)] = variance
    return values[:, :, None], covariance


def _nearest(t: Array, times: Array) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    right = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    return cast("np.ndarray[tuple[int], np.dtype[np.intp]]", np.where(times - t[right - 1] < t[right] - times, right - 1, right))
