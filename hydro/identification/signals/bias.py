"""Sensor biases and velocity from an accelerometer. Equations of McCarter 2014.

One constant bias per leg; (2.84)-(2.92), corrected. The corrections: biases stand
inside the integrals, angular rates pass through P_omega, and an accelerometer measures
the acceleration of a point in inertial space, so its body components hold omega x v
beside the rate of change of the body velocity. Body frame FRD, NED, SI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError, PipelineError
from auvid.hydro.arrays import Array, cross
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix, rotation_body_to_ned
from auvid.hydro.identification.regression.standard_errors import hac_covariance
from auvid.hydro.identification.signals.resampling import interpolate_rotation, unwrap_angles

WALK_SAMPLES = 16
"""Fewer samples give no estimate of a random walk."""
CONVENTIONS = ("specific_force", "inertial", "derivative")


@dataclass(frozen=True)
class BiasFit:
    """Constant bias and initial value of an integrated signal, with standard errors.

    bias = measured rate minus true rate. All (k,); initial_std is nan where the initial
    value was given. residual_rms: of measured minus integrated signal, in the unit of
    the signal. Standard errors allow for coloured residuals and for the random walk
    that integrated sensor noise makes, whose strength is estimated from the residual;
    good to a factor of two or so.
    """

    bias: Array
    initial: Array
    bias_std: Array
    initial_std: Array
    residual_rms: Array


@dataclass(frozen=True)
class VelocityFit:
    """Velocity (n, 3) [m/s] from the accelerometer, and its bias [m/s^2].

    In body axes, with standard errors.
    """

    velocity: Array
    bias: Array
    initial: Array
    bias_std: Array
    initial_std: Array
    residual_rms: Array


def integrate(t_s: ArrayLike, y: ArrayLike, y0: ArrayLike = 0.0) -> Array:
    """Return y0 + integral of y (n,) or (n, k) from the start on: (2.88), (2.92).

    It is the exact integral of the interpolating cubic spline, at the samples. Raises
    `DataError` for fewer than two samples, times that do not increase or values that
    are not finite.

    >>> integrate([0.0, 1.0, 2.0], [0.0, 1.0, 4.0])
    array([0.        , 0.33333333, 2.66666667])
    """
    from scipy.interpolate import CubicSpline

    t, values = _checked(t_s, y)
    columns = values.reshape(len(t), -1)
    path = np.empty_like(columns)
    for column, own in enumerate(columns.T):  # the coefficients of all take nine times the samples
        path[:, column] = CubicSpline(t, own).antiderivative()(t)
    return np.asarray(y0, dtype=np.float64) + path.reshape(values.shape)


def fit_bias_linear(
    t_s: ArrayLike, rate: ArrayLike, measured: ArrayLike, *, initial: ArrayLike | None = None
) -> BiasFit:
    """Fit constant bias b and initial value y0 of an integrated rate (2.85, corrected).

    They minimise || measured - (integral (rate - b) dt + y0) ||, column by column.
    rate, measured: (n,) or (n, k); nan in `measured` counts as missing. initial: y0
    given, as McCarter (2.85) takes it from the measurement; None fits it. Raises
    `DataError` when less than three values are measured.
    """
    t, values = _checked(t_s, rate)
    target = np.asarray(measured, dtype=np.float64).reshape(len(t), -1)
    path = integrate(t, values).reshape(len(t), -1)
    fixed = (
        None
        if initial is None
        else np.broadcast_to(np.asarray(initial, dtype=np.float64), target.shape[1:])
    )
    parts = []
    for column in range(target.shape[1]):
        keep = np.isfinite(target[:, column])
        design = (
            -(t - t[0])[keep, None]
            if fixed is not None
            else np.column_stack([t[0] - t, np.ones_like(t)])[keep]
        )
        y = target[keep, column] - path[keep, column] - (0.0 if fixed is None else fixed[column])
        parts.append(_regress(t[keep], design[:, None, :], y[:, None]))
    bias, std = np.array([p[0][0] for p in parts]), np.array([p[1][0] for p in parts])
    start = np.array([p[0][1] for p in parts]) if fixed is None else np.array(fixed)
    start_std = np.array([p[1][1] for p in parts]) if fixed is None else np.full(len(parts), np.nan)
    return BiasFit(bias, start, std, start_std, np.array([p[2][0] for p in parts]))


def gyro_bias(t_s: ArrayLike, euler: ArrayLike, omega: ArrayLike) -> BiasFit:
    """Fit gyro bias b and initial attitude (2.86-2.87, corrected).

    They minimise || theta - (integral P_omega(theta) (omega - b) dt + theta_0) ||.
    euler (n, 3) [rad], unwrapped here; omega (n, 3) [rad/s]. Linear in b, because
    P_omega is taken at the measured attitude. Raises `DataError` near vertical pitch,
    where Euler angles are undefined.
    """
    t, rates = _checked(t_s, omega)
    angles = unwrap_angles(euler)
    matrices = euler_rate_matrix(angles)
    if not np.isfinite(matrices).all() or np.abs(np.cos(angles[:, 1])).min() < 0.05:
        raise DataError(
            "the gyro bias cannot be found from Euler angles near vertical pitch",
            field="theta_rad",
            remedy="Take the gyro as it is.",
        )
    path = integrate(t, np.einsum("nij,nj->ni", matrices, rates))
    design = np.empty((len(t), 3, 6))
    np.negative(integrate(t, matrices.reshape(len(t), 9)).reshape(-1, 3, 3), out=design[:, :, :3])
    design[:, :, 3:] = np.eye(3)
    del matrices
    value, std, rms = _regress(t, design, angles - path)
    return BiasFit(value[:3], value[3:], std[:3], std[3:], rms)


def accelerometer_bias(
    t_s: ArrayLike, v_dvl: ArrayLike, v_dot: ArrayLike, *, initial: ArrayLike | None = None
) -> BiasFit:
    """Fit the bias of v_dot (n, 3) [m/s^2] to DVL velocity (n, 3): (2.84)-(2.85).

    The velocity [m/s] is nan where there is none. As the thesis does it: body
    components are integrated by themselves, which is right when v_dot is the rate of
    change of body velocity. initial: v(t0) given (thesis: the first DVL velocity); None
    fits it. For an accelerometer use `fit_velocity`.
    """
    return fit_bias_linear(t_s, v_dot, v_dvl, initial=initial)


def fit_velocity(
    t_s: ArrayLike, acceleration: ArrayLike, euler: ArrayLike, t_dvl: ArrayLike, v_dvl: ArrayLike
) -> VelocityFit:
    """Fit velocity of the body origin to inertial acceleration and DVL velocity.

    f = v_dot + omega x v (`inertial_acceleration`). In NED d(R v)/dt = R (f - b), so
    v(t) = R'(t) [integral R f dt - (integral R dt) b + R_0 v_0] is linear in the bias b
    and the initial velocity v_0; both are fitted to the DVL at its own times t_dvl
    (m,), v_dvl (m, 3) at the body origin (`lever_arm_velocity`), nan where a component
    is missing. acceleration, euler (n, 3). DVL samples outside t_s do not count. Raises
    `DataError` when fewer than six DVL values lie inside.
    """
    from scipy.interpolate import CubicSpline

    t, f = _checked(t_s, acceleration)
    R = rotation_body_to_ned(euler)
    ned = integrate(t, np.einsum("nij,nj->ni", R, f))
    gain = integrate(t, R.reshape(len(t), 9))
    times, measured = np.asarray(t_dvl, dtype=np.float64), np.asarray(v_dvl, dtype=np.float64)
    inside = (times >= t[0]) & (times <= t[-1]) & np.isfinite(measured).any(axis=1)
    times, measured = times[inside], measured[inside]
    if np.isfinite(measured).sum() < 6:
        raise DataError(
            "too few velocity measurements inside the leg to find the accelerometer's bias",
            value=int(np.isfinite(measured).sum()),
        )
    to_body = np.swapaxes(rotation_body_to_ned(interpolate_rotation(t, euler, times)), 1, 2)
    gain_there = CubicSpline(t, gain)(times).reshape(-1, 3, 3)
    start = R[0]
    design = np.concatenate([-to_body @ gain_there, to_body @ start], axis=2)
    free = np.einsum("mij,mj->mi", to_body, CubicSpline(t, ned)(times))
    value, std, rms = _regress(times, design, measured - free)
    bias, initial = value[:3], value[3:]
    velocity = np.einsum("nji,nj->ni", R, ned - gain.reshape(-1, 3, 3) @ bias + start @ initial)
    return VelocityFit(velocity, bias, initial, std[:3], std[3:], rms)


def inertial_acceleration(
    accel: ArrayLike,
    *,
    convention: str,
    euler: ArrayLike,
    omega: ArrayLike,
    omega_dot: ArrayLike,
    velocity: ArrayLike,
    arm: ArrayLike = (0.0, 0.0, 0.0),
    gravity: float = STANDARD_GRAVITY,
) -> Array:
    """Return f = v_dot + omega x v (n, 3) [m/s^2] of the body origin.

    From the reading of an accelerometer at `arm` (3,) [m]; all series (n, 3).
    specific_force: a = f + omega_dot x arm + omega x (omega x arm) - R' g e3; inertial:
    the same with gravity removed; derivative: a = v_dot already at the origin. Raises
    `PipelineError` for another convention.
    """
    a, w = np.asarray(accel, dtype=np.float64), np.asarray(omega, dtype=np.float64)
    if convention not in CONVENTIONS:
        raise PipelineError(
            "unknown accelerometer convention", value=convention, allowed=CONVENTIONS
        )
    if convention == "derivative":
        return a + cross(w, np.asarray(velocity, dtype=np.float64))
    r = np.asarray(arm, dtype=np.float64)
    f = (
        a
        - cross(np.asarray(omega_dot, dtype=np.float64), np.broadcast_to(r, a.shape))
        - cross(w, cross(w, np.broadcast_to(r, a.shape)))
    )
    if convention == "specific_force":
        f = f + gravity * rotation_body_to_ned(euler)[..., 2, :]
    return f


def lever_arm_velocity(v_sensor: ArrayLike, omega: ArrayLike, arm: ArrayLike) -> Array:
    """Return the velocity of the body origin from that of a sensor at `arm` (3,) [m].

    v = v_sensor - omega x arm, series (n, 3) in body axes.

    >>> lever_arm_velocity([[1.0, 0.0, 0.0]], [[0.0, 0.0, 0.5]], [0.2, 0.1, 0.0])
    array([[ 1.05, -0.1 ,  0.  ]])
    """
    v, w = np.asarray(v_sensor, dtype=np.float64), np.asarray(omega, dtype=np.float64)
    return v - cross(w, np.broadcast_to(np.asarray(arm, dtype=np.float64), w.shape))


def _checked(t_s: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return times and values as arrays, refusing what cannot be integrated."""
    t, values = np.asarray(t_s, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if t.ndim != 1 or len(t) < 2 or len(values) != len(t) or not np.all(np.diff(t) > 0):
        raise DataError(
            "integration needs two or more samples at strictly increasing times",
            value=(t.shape, values.shape),
        )
    if not np.isfinite(values).all():
        raise DataError(
            "a value to integrate is not finite", remedy="Split the signal at its gaps first."
        )
    return t, values


def _regress(t: Array, design: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return value and standard errors (k,), residual RMS (c,) of least squares.

    y (m, c) on design (m, c, k) at times t (m,); nan is missing.
    """
    present = np.isfinite(y)
    k = design.shape[2]
    rows = design.reshape(-1, k) if present.all() else design[present]
    if len(rows) <= k:
        raise DataError("too few measurements to find a bias", value=len(rows))
    value, _, rank, _ = np.linalg.lstsq(rows, y[present], rcond=None)
    if rank < k:
        raise DataError("the measurements do not determine the bias", value=f"rank {rank} of {k}")
    residual = np.where(present, y - design @ value, np.nan)
    bread = np.linalg.pinv(rows.T @ rows, hermitian=True)
    scores = np.einsum("mc,mck->mk", np.nan_to_num(residual), design)
    covariance = hac_covariance(scores, bread) if len(scores) > k else np.full((k, k), np.nan)
    for channel in range(y.shape[1]):
        keep = present[:, channel]
        covariance = (
            covariance
            + bread @ _walk_moment(t[keep], design[keep, channel], residual[keep, channel]) @ bread
        )
    rms = np.sqrt(np.sum(np.nan_to_num(residual) ** 2, axis=0) / np.maximum(present.sum(axis=0), 1))
    return (
        np.asarray(value, dtype=np.float64),
        np.asarray(np.sqrt(np.diag(covariance))),
        np.asarray(rms),
    )


def _walk_moment(t: Array, x: Array, residual: Array) -> Array:
    """Return X' S X (k, k) for the random walk in a residual (m,).

    S_ij = q min(t_i, t_j), with q the growth of its structure function. Integrated
    sensor noise is a random walk: as long correlated as the leg, so that no kernel
    estimate of its covariance sees it.
    """
    if len(t) < WALK_SAMPLES:
        return np.zeros((x.shape[1], x.shape[1]))
    lags = np.unique(np.linspace(len(t) // 40 + 1, len(t) // 8 + 2, 8).astype(int))
    growth = np.array([np.mean((residual[lag:] - residual[:-lag]) ** 2) for lag in lags])
    spans = np.array([np.mean(t[lag:] - t[:-lag]) for lag in lags])
    spans_centred = spans - spans.mean()
    q = max(0.0, float(spans_centred @ growth / (spans_centred @ spans_centred)))
    tail = np.cumsum(x[::-1], axis=0)[::-1][1:]
    return np.asarray(q * (tail * np.diff(t)[:, None]).T @ tail)
