"""What a leg measures of its motion, on a uniform clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.records.logs import LogInfo
from auvid.hydro.arrays import VELOCITIES, Array, Mask
from auvid.hydro.dynamics.mechanics.kinematics import (
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
)
from auvid.hydro.identification.checks.attitude.rate_agreement import attitude_jumps, rate_agreement
from auvid.hydro.identification.signals.resampling import interpolate_rotation, linear
from auvid.stages.columns import ATTITUDE, Samples
from auvid.stages.leg_streams import Streams

NEAR_JUMP_S = 1.0
MIN_SAMPLES = 20
PAUSE_STEPS = 4.0
"""A coarse clock leaves out single samples; so many steps are a pause."""
OVERSAMPLED = 1.5
"""A sensor faster than this many times the clock is averaged between its times."""
SELDOM_S = 0.75
"""Step of a depth from which the lines between its samples count as a smoother."""
VELOCITY_LOG, POSES, FIXES, DEPTH = "velocity log", "poses", "position fixes", "depth"
GYRO_RATES = "gyro"
"""What measures u, v, w: a sensor, or the slope of places."""
LETTER = dict(zip(VELOCITIES, "XYZKMN", strict=True))


@dataclass(frozen=True)
class LegMotion:
    """Motion of a leg on a clock (n,), as in `AxisRecord`, and where attitude jumps.

    `by`: axis letter -> what measures it. `depth_m` None without a depth.
    """

    rate: Mapping[str, Array]
    depth_m: Array | None
    attitude_rad: Array
    by: Mapping[str, str]
    jumps: Mask
    notes: tuple[str, ...]


def step_s(samples: Samples) -> float:
    """Return the usual step of a stream [s]."""
    return float(np.median(np.diff(samples.t_s)))


def pause_s(samples: Samples, max_gap_s: float) -> float:
    """Return the longest step of a stream that is bridged [s]."""
    return max(max_gap_s, PAUSE_STEPS * step_s(samples))


def on_clock(samples: Samples, t_s: Array, max_gap_s: float) -> Array:
    """Return samples (n, k) on a uniform clock (m, k), nan where they pause.

    Between samples linear; the mean over a step of the clock of a faster sensor.
    """
    values = linear(samples.t_s, samples.values, t_s, max_gap_s=pause_s(samples, max_gap_s))
    step = float(t_s[1] - t_s[0])
    if step_s(samples) * OVERSAMPLED < step:
        t, y = samples.t_s, samples.values
        area = np.concatenate(
            [
                np.zeros((1, y.shape[1])),
                np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(t)[:, None], axis=0),
            ]
        )
        ends = [linear(t, area, np.clip(t_s + side * step / 2, t[0], t[-1])) for side in (-1, 1)]
        mean = (ends[1] - ends[0]) / step
        inside = (t_s - step / 2 >= t[0]) & (t_s + step / 2 <= t[-1])
        values = np.where(np.isfinite(values) & inside[:, None], mean, values)
    return np.asarray(values)


def smoothed_s(measured_by: Mapping[str, str], info: LogInfo) -> dict[str, float]:
    """Return axis -> time [s] over which its measurement is smoothed, where long.

    Of fixes as their smoother says. Lines between samples h apart are a mean over a triangle
    whose variance is h^2 / 6.
    """
    velocity, depth = (info.streams.get(name) for name in ("velocity", "depth"))
    out = {}
    for axis, sensor in measured_by.items():
        if sensor == FIXES and velocity is not None and velocity.smoothed_s is not None:
            out[axis] = velocity.smoothed_s
        elif sensor == DEPTH and depth is not None and depth.rate_hz is not None:
            step = 1.0 / depth.rate_hz
            if step > SELDOM_S:
                out[axis] = step / float(np.sqrt(6.0))
    return out


def enough(samples: Samples | None) -> Samples | None:
    """Return samples of increasing times, None for fewer than MIN_SAMPLES."""
    if samples is None or samples.t_s.size < MIN_SAMPLES:
        return None
    new = np.append(True, np.diff(samples.t_s) > 0.0)
    return Samples(samples.t_s[new], samples.values[new])


def motion_of(streams: Streams, t_s: Array, max_gap_s: float) -> LegMotion:
    """Return the motion of a leg on a uniform clock (n,) [s]."""
    vehicle, notes = streams.vehicle, list[str]()
    nothing = np.full(t_s.size, np.nan)
    rate: dict[str, Array] = dict.fromkeys(VELOCITIES, nothing)
    by: dict[str, str] = {}
    jumps = np.zeros(t_s.size, dtype=bool)
    euler = enough(streams.samples("attitude", ATTITUDE, vehicle.imu.lag_s))
    gyro = enough(streams.gyro())
    if gyro is not None and np.all(np.ptp(gyro.values, axis=0) == 0.0):
        gyro = None
    attitude = np.zeros((t_s.size, 3))
    if euler is None:
        notes.append("No attitude is logged: the vehicle is taken as level.")
    else:
        attitude = interpolate_rotation(
            euler.t_s, euler.values, t_s, max_gap_s=pause_s(euler, max_gap_s)
        )
    if gyro is not None:
        bias = np.zeros(3)
        if euler is not None:
            both = (euler.t_s, euler.values, gyro.t_s, gyro.values)
            agreement = rate_agreement(*both)
            bias = bias if agreement is None else agreement.bias
            begins, ends, _ = attitude_jumps(*both)
            for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
                jumps |= (t_s >= begin - NEAR_JUMP_S) & (t_s <= end + NEAR_JUMP_S)
        turn = on_clock(Samples(gyro.t_s, gyro.values - bias), t_s, max_gap_s)
        source = GYRO_RATES
    elif euler is not None:
        turn = _turn(euler, t_s, max_gap_s)
        source = "slope of the attitude"
        notes.append("No gyro is logged: angular rates are slopes of the attitude.")
    else:
        turn = np.full((t_s.size, 3), np.nan)
        source = ""
    for at, axis in enumerate("pqr"):
        if np.isfinite(turn[:, at]).any() and np.nanmax(np.abs(turn[:, at])) > 0.0:
            rate[axis], by[LETTER[axis]] = turn[:, at], source
    velocity = enough(streams.velocity())
    if velocity is not None:
        body = on_clock(velocity, t_s, max_gap_s)
        for at, axis in enumerate("uvw"):
            rate[axis], by[LETTER[axis]] = body[:, at], VELOCITY_LOG
    depth = enough(streams.samples("depth", ("depth_m",), vehicle.depth_sensor.lag_s))
    depth_m = None
    if depth is not None:
        down = rotation_body_to_ned(np.nan_to_num(attitude))[:, 2, :]
        depth_m = on_clock(depth, t_s, max_gap_s)[:, 0] - down @ vehicle.depth_sensor.arm_m
        by.setdefault("Z", DEPTH)
    return LegMotion(rate, depth_m, attitude, by, jumps, tuple(notes))


def _turn(euler: Samples, t_s: Array, max_gap_s: float) -> Array:
    """Return body rates (n, 3) from slopes of Euler angles: P_omega^-1 theta_dot."""
    angles = np.unwrap(euler.values, axis=0)
    slope = np.gradient(angles, euler.t_s, axis=0)
    rates = np.einsum("nij,nj->ni", euler_rate_matrix_inverse(angles), slope)
    return on_clock(Samples(euler.t_s, rates), t_s, max_gap_s)
