"""The methods that estimate velocity and its derivative from a segment's sensors.

Equations of McCarter 2014.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.data_schemas.records.motion import CurrentRecord
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.bias import (
    accelerometer_bias,
    fit_velocity,
    inertial_acceleration,
    integrate,
)
from auvid.hydro.identification.signals.smoother import SmootherNoise, smooth_velocity
from auvid.hydro.identification.signals.splines import derivative
from auvid.stages.columns import ACCELEROMETER, VELOCITY, rms
from auvid.stages.fuse.current import current_document, drift, water_track, without_water_track
from auvid.stages.sensor_motion import (
    SensorMotion,
    VelocityLogPlacement,
    accelerometer_motion,
    depth_below_origin,
    low_pass,
    missing,
)

SWAY_WARNING_M_S = 0.1
NOISES = {
    "accel_m_s2": ("accel", 3),
    "velocity_m_s": ("velocity", 3),
    "depth_m": ("depth", 1),
    "jerk_density": ("jerk_density", 3),
    "tilt_error_rad": ("tilt_error_rad", 1),
    "tilt_time_s": ("tilt_time_s", 1),
    "bias_m_s2": ("bias", 1),
    "water_m_s": ("water", 3),
    "current_walk_m_s": ("current_walk", 1),
}
"""Key of parameter `noise` -> field of `SmootherNoise`, and its number of components."""


@dataclass(frozen=True)
class FusionResult:
    """Velocity over ground and its derivative (n, 3) by a method, and its estimates.

    `drift` (n, 3): the water's velocity in body axes, None where it is not known.
    """

    velocity: Array
    v_dot: Array
    convention: str | None = None
    accel_bias: Array | None = None
    velocity_sd: Array | None = None
    current: CurrentRecord | None = None
    drift: Array | None = None
    sway_rms: float | None = None
    warnings: tuple[str, ...] = ()


def kinematic(motion: SensorMotion) -> FusionResult:
    """Return velocity from the velocity sensor and its derivative by splines."""
    if motion.velocity is None:
        raise missing("velocity", "a body velocity (method kinematic)")
    return FusionResult(motion.velocity, derivative(motion.t_s, motion.velocity))


def thesis(
    motion: SensorMotion,
    resampled: pa.Table,
    vehicle: Vehicle,
    *,
    convention: str,
    cutoff_hz: float | None,
    as_published: bool,
) -> FusionResult:
    """Return velocity from the integrated accelerometer, McCarter (2.76)-(2.92).

    v_dot = f - b - omega x v, with the bias b and the initial velocity fitted to the
    velocity sensor; `as_published` leaves omega x v in v_dot.
    """
    if motion.velocity is None:
        raise missing(
            "velocity", "a body velocity to find the accelerometer's bias against (method thesis)"
        )
    if not (
        has_columns(resampled, ACCELEROMETER)
        and np.isfinite(raw := matrix(resampled, ACCELEROMETER)).all()
    ):
        raise missing("imu", "an accelerometer (method thesis)")
    t_s, omega, euler = motion.t_s, motion.omega, motion.euler
    accel = low_pass(t_s, raw, cutoff_hz)
    measured = with_depth_rate(motion.velocity, euler, derivative(t_s, motion.depth))
    force = inertial_acceleration(
        accel,
        convention=convention,
        euler=euler,
        omega=omega,
        omega_dot=motion.omega_dot,
        velocity=measured,
        arm=np.zeros(3) if as_published else vehicle.imu.arm_m,
        gravity=vehicle.gravity,
    )
    if as_published:
        v_dot = accel if convention == "derivative" else force
        fit = accelerometer_bias(t_s, measured, v_dot, initial=measured[0])
        bias = fit.bias
        v_dot = v_dot - bias
        velocity = integrate(t_s, v_dot, fit.initial)
        taken_for = "the rate of change of body velocity"
    else:
        corrected = fit_velocity(t_s, force, euler, t_s, measured)
        velocity, bias = corrected.velocity, corrected.bias
        v_dot = force - bias - np.cross(omega, velocity)
        taken_for = convention
    check = sway_check(velocity, measured, taken_for)
    return FusionResult(velocity, v_dot, convention, bias, **check)


def sway_check(velocity: Array, measured: Array, taken_for: str) -> dict[str, Any]:
    """Return the RMS of integrated against measured sway, and a warning if it is large.

    A large one shows that the accelerometer does not measure what it is taken for.
    """
    sway = rms(velocity[:, 1] - measured[:, 1])
    words = (
        f"Integrated and measured sway differ by {sway:.2f} m/s RMS (limit {SWAY_WARNING_M_S:g}):"
        f" the accelerometer does not measure what the method takes it for ({taken_for}), or it"
        " drifts, or the velocity sensor is not mounted as the vehicle file says."
    )
    return {"sway_rms": sway, "warnings": (words,) if sway > SWAY_WARNING_M_S else ()}


def with_depth_rate(velocity: Array, euler: Array, depth_rate: Array) -> Array:
    """Return body velocity (n, 3) with the depth rate as its vertical part.

    v = R' [x_dot, y_dot, z_dot of the depth sensor], McCarter (2.76)-(2.78).
    """
    to_ned = rotation_body_to_ned(euler)
    ned = np.einsum("nij,nj->ni", to_ned, velocity)
    ned[:, 2] = depth_rate
    return np.asarray(np.einsum("nji,nj->ni", to_ned, ned))


@dataclass(frozen=True)
class SensorSamples:
    """Samples of one segment at the sensors' own times; `water`: through the water."""

    imu: pa.Table | None
    velocity: pa.Table | None
    depth: pa.Table | None
    water: pa.Table | None = None


def smoother(
    motion: SensorMotion,
    samples: SensorSamples,
    vehicle: Vehicle,
    *,
    convention: str,
    placement: VelocityLogPlacement,
    noise: Mapping[str, float],
    estimate_current: bool,
) -> FusionResult:
    """Return velocity by Kalman filter and smoother over every sensor at its own times.

    `motion` must not be filtered. Raises `DataError` when the accelerometer, the depth
    or the velocity sensor is missing.
    """
    from scipy.interpolate import CubicSpline

    if samples.depth is None:
        raise missing("depth", "the samples of the depth sensor (method smoother)")
    if samples.velocity is None or motion.velocity is None:
        raise missing("velocity", "a body velocity (method smoother)")
    accelerometer = accelerometer_motion(motion, samples.imu, vehicle, convention=convention)
    if accelerometer is None:
        raise missing("imu", "an accelerometer (method smoother)")
    t = accelerometer.t_s

    def at_origin(times: Array, sensed: Array) -> Array:
        return placement.at_origin(sensed, motion.at(motion.omega, times))

    times = column(samples.velocity, "t_s") - placement.lag_s
    sensed = matrix(samples.velocity, VELOCITY[:3])
    track = water_track(samples.water, (float(t[0]), float(t[-1]))) if estimate_current else None
    t_depth = column(samples.depth, "t_s")
    below = depth_below_origin(motion.at(motion.euler, t_depth), vehicle.depth_sensor.arm_m)
    smoothed = smooth_velocity(
        t,
        accelerometer.acceleration,
        accelerometer.euler,
        accelerometer.omega,
        t_velocity=times,
        velocity=at_origin(times, sensed),
        t_depth=t_depth,
        depth=column(samples.depth, "z_m") - below,
        noise=_noise(noise, vehicle.gravity),
        t_water=None if track is None else track[0],
        water=None if track is None else at_origin(*track),
    )

    # Back to the segment's clock.
    on_clock = np.clip(motion.t_s, t[0], t[-1])
    velocity = CubicSpline(t, smoothed.velocity)(on_clock)
    velocity_sd = np.column_stack(
        [np.interp(on_clock, t, smoothed.velocity_sd[:, axis]) for axis in range(3)]
    )
    result = FusionResult(
        velocity,
        CubicSpline(t, smoothed.rate)(on_clock),
        convention,
        smoothed.bias.mean(axis=0),
        velocity_sd,
        **sway_check(velocity, motion.velocity, convention),
    )
    if not estimate_current:
        return result
    if track is None:
        return replace(result, current=without_water_track(samples.water))
    return replace(
        result,
        current=current_document(smoothed),
        drift=drift(smoothed, on_clock, motion.euler),
    )


def in_stated_current(
    result: FusionResult, motion: SensorMotion, current_m_s: Sequence[float]
) -> FusionResult:
    """Return a result with a stated current towards north and east (2,)."""
    ned = np.array([*current_m_s, 0.0])
    drift = np.einsum("nji,j->ni", rotation_body_to_ned(motion.euler), ned)
    current = CurrentRecord(
        verdict="stated",
        reason="the campaign states it (stages.fuse.current_m_s)",
        ned_m_s=ned.tolist(),
        sd_m_s=None,
    )
    return replace(result, drift=drift, current=current)


def _noise(values: Mapping[str, float], gravity: float) -> SmootherNoise:
    fields: dict[str, Any] = {"gravity": gravity}
    for key, value in values.items():
        if key not in NOISES:
            raise CampaignError(
                "unknown noise",
                field=f"stages.fuse.noise.{key}",
                allowed=sorted(NOISES),
                remedy=nearest(key, NOISES),
            )
        if not value > 0:
            raise CampaignError(
                "a noise must be positive", field=f"stages.fuse.noise.{key}", value=value
            )
        name, size = NOISES[key]
        fields[name] = value if size == 1 else np.full(size, value)
    return SmootherNoise(**fields)
