"""How a velocity log and an accelerometer are installed, found from a vehicle's motion.

A Kalman filter carries depth z, body velocity v and the accelerometer's bias b from the
accelerometer's reading a, without gravity, to the velocity log and the depth sensor:

    z_dot = (R v)_3,   v_dot = a - b - omega x v,   b_dot = white noise.

It is linear, so what a wrong lever arm, angle or lag adds to the measurements passes
through it as they do. With the innovations nu_0 of the measurements, their variances s
and the innovations nu_j that one unit of each fault makes,

    nu_0 = sum_j theta_j nu_j + white noise of variance s,

and the faults theta follow from one weighted regression (generalised least squares).
Its normal equations are sums over samples: those of all legs are added. What a fault
makes is built from the mean of the filter's estimate before and after a sample: the
errors of the first go against the innovation, those of the second with it, and they
cancel. From the estimate before, scales came out .6 % low; from the sample 2 % high.
The acceleration is the filter's input and has no model of its own: with one that is
smooth (as that of `smoother.py`), transients are taken away and arms come out 2 % short.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, cross
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned, skew
from auvid.hydro.identification.signals.bias import lever_arm_velocity
from auvid.hydro.identification.signals.smoother import (
    FEWEST,
    SmootherNoise,
    estimated_noise,
    nearest_steps,
)
from auvid.hydro.identification.signals.splines import smoothing_spline
from auvid.hydro.long_series.heap import give_back_heap

FAULTS = (
    "arm_x", "arm_y", "arm_z", "angle_x", "angle_y", "angle_z", "lag", "velocity_scale",
    "depth_scale", "accelerometer_scale", "gravity", "transport",
)  # fmt: skip
"""What can be wrong, each 0 where all is right. Arm [m]: where the velocity log sits
beyond the vehicle file, and equally where the accelerometer sits short of it (their
difference is seen). Angles [rad]: small rotation of the velocity log beyond the file's,
v_body = v + angle x v. Lag [s] of the velocity log. Scales: share by which a sensor reads
too much. Gravity: 1 where the reading has gravity in it against what was assumed, -1
where it lacks it; transport: 1 where it lacks omega x v.
"""
SENSORS = ("u", "v", "w", "depth")
BLOCK_S = 5.0
"""Sums are kept for pieces of this length, longer than the innovations' memory."""
STEPS_AT_ONCE = 8192
"""Matrices of so many steps of the filter are in memory, and in the cache."""
LONG_SAMPLES = 100_000
PLACES = 9
"""The first faults are those of place and scale; the last three belong to the
accelerometer.
"""
CERTAIN = 3.0
"""Standard errors beyond which a departure counts."""
POWER = 1.645
"""Normal quantile of 95 %: how often a departure of twice the limit is seen."""
LEAST_NOISE = 0.25
"""Least share of a noise variance that is left when innovations are smaller."""
START_VARIANCES = (1.0, 0.25, 0.25, 0.25)
"""Of depth [m^2] and velocity [m^2/s^2] about their first samples."""


@dataclass(frozen=True)
class InstallationSums:
    """Sums of a leg or of several: what the estimate of the faults needs.

    gram: (blocks, 1 + k, 1 + k), innovations of measurements and faults over their
    variances; squares, samples (7,): normalised squares of each sensor's innovations,
    with the noise that splines see.
    """

    gram: Array
    squares: Array
    samples: Array

    def merge(self, other: InstallationSums) -> InstallationSums:
        """Return the sums of both."""
        return InstallationSums(
            np.concatenate([self.gram, other.gram]),
            self.squares + other.squares,
            self.samples + other.samples,
        )


@dataclass(frozen=True)
class LegSensors:
    """Sensors of a leg, body axes, each at its own times.

    At t_s (n,): acceleration (n, 3) of the origin without gravity (by the convention
    assumed), the accelerometer's reading, euler, omega, omega_dot (n, 3). velocity
    (m, 3) at t_velocity, of the velocity log at `arm_m`; depth (k,) of the origin at
    t_depth.
    """

    t_s: Array
    acceleration: Array
    reading: Array
    euler: Array
    omega: Array
    omega_dot: Array
    t_velocity: Array
    velocity: Array
    arm_m: Array
    t_depth: Array
    depth: Array


def installation_sums(leg: LegSensors, noise: SmootherNoise | None = None) -> InstallationSums:
    """Return the sums of one leg: innovations of a filter, and what each fault adds.

    The filter carries depth, velocity and the accelerometer's bias along the leg. Its
    innovations are linear in small faults, so that sums of their products over their
    variances are all that the estimate needs. noise: None estimates it. Raises
    `DataError` for fewer than five samples of a sensor within the leg.
    """
    t = leg.t_s
    at_v = (leg.t_velocity >= t[0]) & (leg.t_velocity <= t[-1])
    at_z = (leg.t_depth >= t[0]) & (leg.t_depth <= t[-1])
    tv, sensed, tz, z = leg.t_velocity[at_v], leg.velocity[at_v], leg.t_depth[at_z], leg.depth[at_z]
    if min(len(t), len(tv), len(tz)) < FEWEST:
        raise DataError(
            "too few samples to check how the sensors are installed",
            value=(len(t), len(tv), len(tz)),
            allowed="5 or more of each sensor",
        )
    step_v, step_z = nearest_steps(t, tv), nearest_steps(t, tz)
    omega = leg.omega[step_v]
    velocity = lever_arm_velocity(sensed, omega, leg.arm_m)
    spline = smoothing_spline(t, leg.acceleration)
    used = estimated_noise(
        t, leg.acceleration, tv, velocity, tz, z, noise or SmootherNoise(), accel_spline=spline
    )
    assert used.velocity is not None
    assert used.depth is not None
    smooth = np.asarray(spline.evaluate(tv))
    # v_dot = f - omega x v carries a sample to its step.
    carried = velocity + (t[step_v] - tv)[:, None] * (smooth - cross(omega, velocity))
    order = np.argsort(np.concatenate([np.repeat(step_v, 3), step_z]), kind="stable")
    steps = np.concatenate([np.repeat(step_v, 3), step_z])[order].astype(np.int64)
    sensor = np.concatenate([np.tile([0, 1, 2], len(tv)), np.full(len(tz), 3)])[order]
    variance = np.concatenate([used.velocity, [used.depth]]) ** 2
    blocks = ((t - t[0]) / BLOCK_S).astype(np.int64)
    start = np.concatenate([z[:1], velocity[0], np.zeros(3)])
    prior = np.array([*START_VARIANCES, *np.full(3, used.bias**2)])

    # Imported here, since numba takes a second.
    from auvid.hydro.identification.signals.compiled_filter import run_filter

    def filtered(
        inputs: Callable[[slice], Array], ordered: Array, variance: Array
    ) -> tuple[Array, Array, Array]:
        columns = ordered.shape[1]
        x, P = np.zeros((7, columns)), np.diag(prior)
        x[:, 0] = start
        innovations, scaled = np.empty((len(steps), columns)), np.empty(len(steps))
        for begin in range(0, len(t), STEPS_AT_ONCE):
            # With the last step of the piece before, from which the first one goes on.
            part = slice(max(begin - 1, 0), begin + STEPS_AT_ONCE)
            low, high = np.searchsorted(steps, (begin, begin + STEPS_AT_ONCE))
            run_filter(
                *_process(t[part], leg.euler[part], leg.omega[part], used),
                np.ascontiguousarray(inputs(part)), x, P, steps[low:high] - part.start,
                sensor[low:high], ordered[low:high], variance, innovations[low:high],
                scaled[low:high],
            )  # fmt: skip
        return innovations, scaled, x[4:, 0]

    # Faults are made of what the filter expects, halfway to what it makes of the sample.
    measured = np.concatenate([carried.ravel(), z])
    first, first_scaled, bias = filtered(
        lambda part: leg.acceleration[part, :, None], measured[order, None], variance
    )
    halfway = 0.5 * (1.0 - variance[sensor] / first_scaled)
    expected = np.empty(len(measured))
    expected[order] = measured[order] - (1.0 - halfway) * first[:, 0]
    v, depth = expected[: 3 * len(tv)].reshape(-1, 3), expected[3 * len(tv) :]
    arm = np.broadcast_to(leg.arm_m, omega.shape)
    reading = v + cross(omega, arm)
    rate = smooth - bias - cross(omega, v) + cross(leg.omega_dot[step_v], arm)
    del spline
    if len(t) > LONG_SAMPLES:
        give_back_heap()  # the products below are large, and find no place between what is left

    k = len(FAULTS)
    values = np.zeros((len(measured), 1 + k))
    on_velocity, on_depth = values[: 3 * len(tv)].reshape(-1, 3, 1 + k), values[3 * len(tv) :]
    for axis, unit in enumerate(np.eye(3)):
        on_velocity[:, :, 1 + axis] = cross(omega, np.broadcast_to(unit, omega.shape))
        on_velocity[:, :, 4 + axis] = cross(reading, np.broadcast_to(unit, reading.shape))
    speed = np.column_stack([np.interp(t, tv, v[:, axis]) for axis in range(3)])
    for name, where, column in (
        ("lag", on_velocity, -rate),
        ("velocity_scale", on_velocity, reading),
        ("depth_scale", on_depth, depth - depth.mean()),
    ):
        where[..., 1 + FAULTS.index(name)] = column
    on_velocity[:, :, 0], on_depth[:, 0] = carried, z

    def on_accel(part: slice) -> Array:
        down = rotation_body_to_ned(leg.euler[part])[:, 2, :]
        out = np.zeros((len(down), 3, 1 + k))
        out[..., 0] = leg.acceleration[part]
        out[..., 1 + FAULTS.index("accelerometer_scale")] = leg.reading[part]
        out[..., 1 + FAULTS.index("gravity")] = -used.gravity * down
        out[..., 1 + FAULTS.index("transport")] = -cross(leg.omega[part], speed[part])
        return out

    del on_velocity, on_depth
    values = values[order]
    innovations, scaled, _ = filtered(on_accel, values, variance)

    # Once more with the noise that the innovations show, less what the faults explain.
    weighted = innovations[:, : 1 + PLACES] / np.sqrt(scaled)[:, None]
    place = weighted[:, 1:]
    explained = np.linalg.lstsq(place, weighted[:, 0], rcond=1e-9)[0]
    left = innovations[:, 0] - innovations[:, 1 : 1 + PLACES] @ explained
    del place, weighted
    counts = np.bincount(sensor, minlength=len(SENSORS))
    excess = np.bincount(sensor, left**2 - scaled, minlength=len(SENSORS)) / counts
    variance = np.clip(variance + excess, LEAST_NOISE * variance, None)
    del innovations
    innovations, scaled, _ = filtered(on_accel, values, variance)
    weighted = innovations / np.sqrt(scaled)[:, None]
    gram = np.zeros((int(blocks[-1]) + 1, 1 + k, 1 + k))
    edges = np.searchsorted(blocks[steps], np.arange(len(gram) + 1))
    for block, (low, high) in enumerate(pairwise(edges)):
        rows = weighted[low:high]
        gram[block] = rows.T @ rows
    squares = np.bincount(sensor, (first[:, 0] ** 2) / first_scaled, minlength=len(SENSORS))
    as_floats = np.asarray(squares, dtype=np.float64), np.asarray(counts, dtype=np.float64)
    return InstallationSums(gram, *as_floats)


def _process(
    t: Array, euler: Array, omega: Array, noise: SmootherNoise
) -> tuple[Array, Array, Array]:
    """Return transitions (n, 7, 7), input gains (n, 7, 3), noise (n, 7, 7) of z, v, b.

    z_dot = (R v)_3, v_dot = a - b - omega x v from step k - 1 to k, with the mean
    reading of both ends as a.
    """
    n, dt = len(t), np.diff(t, prepend=t[0])[:, None, None]
    middle = 0.5 * (omega + np.roll(omega, 1, axis=0))
    down = rotation_body_to_ned(euler)[:, 2, :]
    # Blocks of A dt: z by v, v by v, and v by b, which is -dt; so have its powers.
    z1, v1 = 0.5 * (down + np.roll(down, 1, axis=0))[:, None, :] * dt, -skew(middle) * dt
    z2, v2 = z1 @ v1, v1 @ v1
    # Integral of exp(A s) over the step, on v.
    gain = np.zeros((n, 7, 3))
    gain[:, :1] = (z1 / 2.0 + z2 / 6.0) * dt
    gain[:, 1:4] = (np.eye(3) + v1 / 2.0 + v2 / 6.0) * dt
    transition = np.zeros((n, 7, 7))
    transition[:, [0, 4, 5, 6], [0, 4, 5, 6]] = 1.0
    transition[:, :1, 1:4] = z1 + z2 / 2.0 + z1 @ v2 / 6.0
    transition[:, 1:4, 1:4] = np.eye(3) + v1 + v2 / 2.0 + v1 @ v2 / 6.0
    transition[:, :4, 4:] = -gain[:, :4]
    assert noise.accel is not None
    Q = np.zeros((n, 7, 7))
    place = np.arange(3)
    Q[:, 1 + place, 1 + place] = dt[:, 0] ** 2 * noise.accel**2
    Q[:, 4 + place, 4 + place] = dt[:, 0] * noise.bias_density
    return transition, gain, Q


DepartureVerdict = Literal["agrees", "departs", "not observable"]


def departure_verdict(
    value: float, sd: float, limit: float, *, certain: float = CERTAIN
) -> DepartureVerdict:
    """Return whether a figure departs from the vehicle file by what counts.

    Not observable: a departure of twice the limit would not be seen for certain.

    >>> departure_verdict(0.10, 0.02, 0.05), departure_verdict(0.01, 0.03, 0.05)
    ('departs', 'not observable')
    """
    if abs(value) > max(certain * sd, limit):
        return "departs"
    return "agrees" if (certain + POWER) * sd <= 2.0 * limit else "not observable"


@dataclass(frozen=True)
class InstallationFaults:
    """Faults by name, in the units of `FAULTS`, with standard errors; inf: not seen."""

    names: tuple[str, ...]
    value: Array
    sd: Array


def installation_faults(
    sums: InstallationSums, names: Sequence[str], prior_sd: ArrayLike | None = None
) -> InstallationFaults:
    """Return the estimate of the named faults from the sums of all legs.

    theta = (A + P^-1)^-1 b with A = sum nu_j nu_k / s and b = sum nu_j nu_0 / s. The
    standard error is the larger of two: from A and the innovations' size, and from the
    scatter of the scores of pieces of 5 s. `prior_sd`: P = diag(prior_sd^2) about 0.
    """
    at = np.array([1 + FAULTS.index(name) for name in names])
    A = sums.gram[:, at[:, None], at]
    b = sums.gram[:, at, 0]
    prior = np.zeros(len(at)) if prior_sd is None else np.asarray(prior_sd, dtype=np.float64) ** -2
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A.sum(axis=0)), 1e-300))
    information = (A.sum(axis=0) + np.diag(prior)) * scale[:, None] * scale
    inverse = np.linalg.pinv(information, rcond=1e-9, hermitian=True) * scale[:, None] * scale
    value = inverse @ b.sum(axis=0)
    scores = b - A @ value
    blocks = len(scores)
    left = max(1.0, np.sum(sums.samples) - len(at))
    squares = np.sum(sums.gram[:, 0, 0]) - value @ (2.0 * b.sum(axis=0) - A.sum(axis=0) @ value)
    data = inverse @ A.sum(axis=0) @ inverse
    plain = np.diag(inverse - data) + np.diag(data) * max(1.0, squares / left)
    spread = np.diag(inverse - data) + np.diag(inverse @ (scores.T @ scores) @ inverse) * (
        blocks / max(1, blocks - 1)
    )
    observed = np.diag(A.sum(axis=0)) + prior > 0.0
    sd = np.where(observed, np.sqrt(np.maximum(plain, spread)), np.inf)
    return InstallationFaults(tuple(names), value, sd)
