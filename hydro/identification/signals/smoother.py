"""Velocity, accelerometer bias and depth by a Kalman smoother (filterpy).

The filter is linear and time-varying, the smoother that of Rauch, Tung and Striebel.

State (13): depth z, body velocity v (3), inertial acceleration f = v_dot + omega x v
(3), its rate j (3), bias b (3). Between samples

    z_dot = (R v)_3,   v_dot = f - omega x v,   f_dot = j,
    j_dot = white noise of density q,   b_dot = white noise of density q_b.

With j as white-noise driven state, f is what a cubic smoothing spline with lambda =
sigma^2 / q estimates; the defaults of q and of the accelerometer's noise come from such
a spline by generalised cross-validation. The bias walks slowly: the tilt error of an
attitude reference leaks gravity into the accelerometer, changes over its correlation
time, and cannot be told from a bias within it. Measurements at their own times:
accelerometer f + b, velocity sensor v (lever arm and mounting taken out), depth z.

With a second velocity, through the water, the state has the current c (3) in NED behind
it (16): c_dot = white noise, measured is v - R' c. Without one, no measurement above
holds c: accelerometer, bottom track and depth all speak of motion over ground. Forces
do depend on it, but there a steady current cannot be told from damping and constant
forces, which are what is looked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, cross
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned, skew
from auvid.hydro.identification.signals.splines import SmoothingSpline, smoothing_spline

Z, V, F, J, B, C = 0, slice(1, 4), slice(4, 7), slice(7, 10), slice(10, 13), slice(13, 16)
SIZE, MEASURED = 13, 7
CURRENT = 3
CURRENT_PRIOR = 1.0
"""Standard deviation [m/s] of a current before anything is measured."""
PRIOR_VARIANCES = {"depth": 1.0, "velocity": 0.25, "acceleration": 1.0, "jerk": 10.0}
"""Variances [m^2, m^2/s^2, m^2/s^4, m^2/s^6] about the first samples: (1 m)^2,
(0.5 m/s)^2, (1 m/s^2)^2 and (3 m/s^3)^2, wider than any sensor or vehicle here, so that
the first measurements outweigh them within a step.
"""
FEWEST = 5
UNSEEN = 1e10
"""Variance of a measurement that is missing at a step: it weighs nothing."""
FLOOR = {"accel": 1e-4, "velocity": 1e-4, "depth": 1e-4}
"""Smallest noise that is believed [m/s^2, m/s, m]; noise-free data would make the gains
singular.
"""


@dataclass(frozen=True)
class SmootherNoise:
    """Noise of sensors and motion, SI; what is None is estimated from the data.

    accel, velocity, depth: standard deviations per sample; jerk_density: q (3,) of j
    [m^2/s^7]; tilt_error_rad, tilt_time_s: size and correlation time of the attitude
    reference's error in roll and pitch; bias: prior standard deviation of the bias
    [m/s^2]; water: that of the velocity through the water; current_walk: how much the
    current walks within a second [m/s], 0 for a constant one.
    """

    accel: Array | None = None
    velocity: Array | None = None
    depth: float | None = None
    jerk_density: Array | None = None
    tilt_error_rad: float = 1e-3
    tilt_time_s: float = 30.0
    bias: float = 0.5
    gravity: float = STANDARD_GRAVITY
    water: Array | None = None
    current_walk: float = 0.0

    @property
    def bias_density(self) -> float:
        """Return the density q_b [m^2/s^5] of the bias walk: (g tilt)^2 / time.

        It grows to the gravity leak of the tilt error within its correlation time.
        """
        return (self.gravity * self.tilt_error_rad) ** 2 / self.tilt_time_s


@dataclass(frozen=True)
class SmoothedVelocity:
    """Body velocity, its rate and the bias at the smoother's steps, each (n, 3).

    With standard deviations, and the noise used.
    """

    t_s: Array
    velocity: Array
    rate: Array
    bias: Array
    velocity_sd: Array
    bias_sd: Array
    depth: Array
    noise: SmootherNoise
    current: Array | None = None
    current_sd: Array | None = None


def estimated_noise(
    t_s: Array,
    accel: Array,
    t_velocity: Array,
    velocity: Array,
    t_depth: Array,
    depth: Array,
    noise: SmootherNoise,
    *,
    accel_spline: SmoothingSpline | None = None,
) -> SmootherNoise:
    """Return the noise with what is None estimated by smoothing splines with GCV.

    Sensor noise is sigma, jerk density sigma^2 / lambda. accel_spline: that of `accel`,
    where it is there already.
    """
    a = accel_spline or smoothing_spline(t_s, accel)
    sigma = np.maximum(a.sigma, FLOOR["accel"])
    return replace(
        noise,
        accel=sigma if noise.accel is None else noise.accel,
        velocity=(
            np.maximum(smoothing_spline(t_velocity, velocity).sigma, FLOOR["velocity"])
            if noise.velocity is None
            else noise.velocity
        ),
        depth=(
            float(np.maximum(smoothing_spline(t_depth, depth).sigma, FLOOR["depth"]))
            if noise.depth is None
            else noise.depth
        ),
        jerk_density=(
            sigma**2 / np.maximum(a.lambda_, 1e-12)
            if noise.jerk_density is None
            else noise.jerk_density
        ),
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
    t_water: ArrayLike | None = None,
    water: ArrayLike | None = None,
) -> SmoothedVelocity:
    """Return the smoothed velocity of the body origin at times t_s (n,) [s].

    accel (n, 3): inertial acceleration with bias, gravity and lever arm taken out
    (`inertial_acceleration`); euler, omega (n, 3) there. velocity (m, 3) at t_velocity
    (m,): of the body origin (`lever_arm_velocity`); depth (k,) at t_depth (k,): of the
    body origin. Each is used at the nearest step, carried there along the acceleration.
    water (w, 3) at t_water (w,): velocity of the body origin through the water in body
    axes; with it the current is found too. Raises `DataError` for values that are not
    finite or too few samples.
    """
    t, a = np.asarray(t_s, dtype=np.float64), np.asarray(accel, dtype=np.float64)
    angles, w = np.asarray(euler, dtype=np.float64), np.asarray(omega, dtype=np.float64)
    tv, v = _inside(t, t_velocity, velocity)
    tz, z = _inside(t, t_depth, depth)
    tw, through = (
        _inside(t, [], np.zeros((0, 3)))
        if t_water is None or water is None
        else _inside(t, t_water, water)
    )
    if not all(np.isfinite(values).all() for values in (a, angles, w, v, z, through)):
        raise DataError(
            "a value to smooth is not finite", remedy="Split the leg at its gaps first."
        )
    with_current = t_water is not None
    if min(len(t), len(tv), len(tz), len(tw) if with_current else FEWEST) < FEWEST:
        raise DataError(
            "too few samples to smooth a velocity",
            value=(len(t), len(tv), len(tz), len(tw)),
            allowed="5 or more of each sensor",
        )
    used = estimated_noise(t, a, tv, v, tz, z, noise or SmootherNoise())
    if with_current and used.water is None:
        used = replace(
            used, water=np.maximum(smoothing_spline(tw, through).sigma, FLOOR["velocity"])
        )
    size, measured = (SIZE + CURRENT, MEASURED + CURRENT) if with_current else (SIZE, MEASURED)
    transitions, processes = process_model(t, angles, w, used, size)
    zs, Rs = _measurements(
        t,
        a,
        w,
        [(tv, v, used.velocity), (tw, through, used.water)][: 1 + with_current],
        tz,
        z,
        used,
    )
    from filterpy.kalman import KalmanFilter  # a second to import, and only this method needs it

    kalman = KalmanFilter(dim_x=size, dim_z=measured)
    kalman.x = np.concatenate([z[:1], v[0], a[0], np.zeros(size - 7)])[:, None]
    variances = np.repeat(
        [*PRIOR_VARIANCES.values(), used.bias**2, CURRENT_PRIOR**2], [1, 3, 3, 3, 3, size - SIZE]
    )
    kalman.P = np.diag(variances)
    H = _sensitivity(angles, size, measured)
    means, covariances, _, _ = kalman.batch_filter(
        zs, Fs=list(transitions), Qs=list(processes), Rs=list(Rs), Hs=list(H)
    )
    means, covariances, _, _ = kalman.rts_smoother(
        means, covariances, Fs=list(transitions), Qs=list(processes)
    )
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
        current=x[:, C] if with_current else None,
        current_sd=np.sqrt(variance[:, C]) if with_current else None,
    )


def _sensitivity(euler: Array, size: int, measured: int) -> Array:
    """Return the measurement matrices (n, measured, size) at attitudes (n, 3)."""
    H = np.zeros((len(euler), measured, size))
    H[:, :3, F] = H[:, :3, B] = H[:, 3:6, V] = np.eye(3)
    H[:, 6, Z] = 1.0
    if measured > MEASURED:
        H[:, MEASURED:, V] = np.eye(3)
        H[:, MEASURED:, C] = -np.swapaxes(rotation_body_to_ned(euler), 1, 2)
    return H


def _inside(t: Array, times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    stamp, value = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    keep = (stamp >= t[0]) & (stamp <= t[-1])
    return stamp[keep], value[keep]


def process_model(
    t: Array, euler: Array, omega: Array, noise: SmootherNoise, size: int
) -> tuple[Array, Array]:
    """Return transitions and process noise (n, size, size) from step k - 1 to k.

    The first transition is the identity, without noise.
    """
    n, dt = len(t), np.diff(t, prepend=t[0])
    # Rates and attitude in the middle of the step; row 0 has no step (dt = 0).
    middle = 0.5 * (omega + np.roll(omega, 1, axis=0))
    down = rotation_body_to_ned(euler)[:, 2, :]
    # x_dot = A x: z_dot = (R v)_3, v_dot = f - omega x v, f_dot = j.
    A = np.zeros((n, size, size))
    A[:, Z, V] = 0.5 * (down + np.roll(down, 1, axis=0))
    A[:, V, V] = -skew(middle)
    A[:, V, F] = A[:, F, J] = np.eye(3)
    # exp(A dt) by its series to fourth order, exact but for the turn of the body.
    step = A * dt[:, None, None]
    transition = np.eye(size) + step
    power = step
    for order in (2, 3, 4):
        power = power @ step / order
        transition = transition + power
    Q = np.zeros((n, size, size))
    assert noise.jerk_density is not None
    place = np.arange(3)
    # White noise q on j_dot over a step: Q = q integral of s^a / a! s^b / b! ds, where j
    # is reached by a = 0 integrations, f by 1 and v by 2.
    blocks = [
        (J, J, dt),
        (F, F, dt**3 / 3),
        (V, V, dt**5 / 20),
        (F, J, dt**2 / 2),
        (V, F, dt**4 / 8),
        (V, J, dt**3 / 6),
    ]
    for row, column, factor in blocks:
        block = factor[:, None] * noise.jerk_density
        Q[:, row.start + place, column.start + place] = block
        Q[:, column.start + place, row.start + place] = block
    Q[:, B.start + place, B.start + place] = dt[:, None] * noise.bias_density
    if size > SIZE:
        Q[:, C.start + place, C.start + place] = dt[:, None] * noise.current_walk**2
    return transition, Q


def _measurements(
    t: Array,
    accel: Array,
    omega: Array,
    velocities: Sequence[tuple[Array, Array, Array | None]],
    tz: Array,
    z: Array,
    noise: SmootherNoise,
) -> tuple[Array, Array]:
    """Return measurement columns (n, m, 1) and their covariances (n, m, m).

    A measurement that is missing at a step has the variance `UNSEEN`. velocities:
    times, values and noise of the velocity over ground and, where there is one, through
    the water. v' = f - omega x v holds for both while the current is steady.
    """
    assert noise.accel is not None
    n, measured = len(t), 4 + 3 * len(velocities)
    values, variance = np.zeros((n, measured)), np.full((n, measured), UNSEEN)
    values[:, :3], variance[:, :3] = accel, noise.accel**2
    for first, (times, v, sd) in zip((3, MEASURED), velocities, strict=False):
        assert sd is not None
        at = nearest_steps(t, times)
        # v_dot = f - omega x v carries the sample over up to half a step.
        rate = accel[at] - cross(omega[at], v)
        values[at, first : first + 3], variance[at, first : first + 3] = (
            v + (t[at] - times)[:, None] * rate,
            sd**2,
        )
    at = nearest_steps(t, tz)
    values[at, 6], variance[at, 6] = z, cast(float, noise.depth) ** 2
    covariance = np.zeros((n, measured, measured))
    covariance[:, np.arange(measured), np.arange(measured)] = variance
    return values[:, :, None], covariance


def nearest_steps(t: Array, times: Array) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the index of the step of t (n,) nearest to each time."""
    right = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    return cast(
        "np.ndarray[tuple[int], np.dtype[np.intp]]",
        np.where(times - t[right - 1] < t[right] - times, right - 1, right),
    )
