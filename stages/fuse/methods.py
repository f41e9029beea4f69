"""The methods that find velocity and its rate from a segment's sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
from scipy.interpolate import CubicSpline

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import cross
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.bias import (
    accelerometer_bias,
    fit_velocity,
    inertial_acceleration,
    integrate,
    lever_arm_velocity,
)
from auvid.hydro.identification.signals.installation import Installation, estimate_installation
from auvid.hydro.identification.signals.smoother import SmootherNoise, smooth_velocity
from auvid.hydro.identification.signals.splines import derivative
from auvid.stages.columns import ACCELEROMETER, VELOCITY, Array, rms
from auvid.stages.fuse.current import current_document, drift, water_track, without_water_track
from auvid.stages.fuse.motion import Found, Motion, low_pass, missing, vertical_arm

SWAY_WARNING_M_S = 0.1


def kinematic(motion: Motion) -> tuple[Array, Array, Found]:
    """Velocity and its rate (n, 3) from the velocity sensor and splines."""
    if motion.velocity is None:
        raise missing("velocity", "a body velocity (method kinematic)")
    return motion.velocity, derivative(motion.t_s, motion.velocity), Found()


def thesis(
    motion: Motion,
    resampled: pa.Table,
    vehicle: Vehicle,
    *,
    convention: str,
    cutoff_hz: float | None,
    as_published: bool,
) -> tuple[Array, Array, Found]:
    """Velocity and its rate (n, 3) from the integrated accelerometer, McCarter
    (2.76)-(2.92): biases found against the velocity sensor.
    """
    if motion.velocity is None:
        raise missing(
            "velocity", "a body velocity to find the accelerometer's bias against (method thesis)"
        )
    raw = (
        matrix(resampled, ACCELEROMETER)
        if has_columns(resampled, ACCELEROMETER)
        else np.full((1, 3), np.nan)
    )
    if not np.isfinite(raw).all():
        raise missing("imu", "an accelerometer (method thesis)")
    t_s, omega, euler = motion.t_s, motion.omega, motion.euler
    accel = low_pass(t_s, raw @ vehicle.imu.rotation.T, cutoff_hz)
    measured = with_depth_rate(motion.velocity, euler, derivative(t_s, motion.depth))
    arm = np.zeros(3) if as_published else vehicle.imu.arm_m
    force = inertial_acceleration(
        accel,
        convention=convention,
        euler=euler,
        omega=omega,
        omega_dot=motion.omega_dot,
        velocity=measured,
        arm=arm,
        gravity=vehicle.gravity,
    )
    if as_published:
        rate = accel if convention == "derivative" else force
        fit = accelerometer_bias(t_s, measured, rate, initial=measured[0])
        rate = rate - fit.bias
        velocity = integrate(t_s, rate, fit.initial)
        bias = fit.bias
    else:
        found = fit_velocity(t_s, force, euler, t_s, measured)
        velocity, bias = found.velocity, found.bias
        rate = force - bias - np.cross(omega, velocity)
    taken_for = "the rate of change of body velocity" if as_published else convention
    return velocity, rate, Found(convention, bias, **sway_check(velocity, measured, taken_for))


def sway_check(velocity: Array, measured: Array, taken_for: str) -> dict[str, Any]:
    """RMS of found against measured sway, and a warning where it shows that the
    accelerometer is not what it is taken for.
    """
    sway = rms(velocity[:, 1] - measured[:, 1])
    words = (
        f"Integrated and measured sway differ by {sway:.2f} m/s RMS (limit {SWAY_WARNING_M_S:g}):"
        f" the accelerometer does not measure what the method takes it for ({taken_for}), or it"
        " drifts, or the velocity sensor sits otherwise than the vehicle file says."
    )
    return {"sway_rms": sway, "warnings": (words,) if sway > SWAY_WARNING_M_S else ()}


def with_depth_rate(velocity: Array, euler: Array, depth_rate: Array) -> Array:
    """Body velocity (n, 3) whose vertical part is the rate of the measured depth:
    McCarter (2.76)-(2.78).
    """
    to_ned = rotation_body_to_ned(euler)
    ned = np.einsum("nij,nj->ni", to_ned, velocity)
    ned[:, 2] = depth_rate
    return np.asarray(np.einsum("nji,nj->ni", to_ned, ned))


@dataclass(frozen=True)
class SensorSamples:
    """Samples of one segment at their own times: accelerometer, velocity sensor, depth,
    velocity through the water.
    """

    imu: pa.Table | None
    velocity: pa.Table | None
    depth: pa.Table
    water: pa.Table | None = None


def smoother(
    motion: Motion,
    samples: SensorSamples,
    vehicle: Vehicle,
    *,
    convention: str,
    noise: Mapping[str, float],
    estimate_arm: bool,
    estimate_mounting: bool,
    estimate_current: bool,
) -> tuple[Array, Array, Found]:
    """Velocity over ground and its rate (n, 3) by Kalman filter and smoother over the
    samples of every sensor at its own times.

    `motion` must not be filtered. Raises `DataError` when the accelerometer or the
    velocity sensor is missing.
    """
    if samples.imu is None or not np.isfinite(matrix(samples.imu, ACCELEROMETER)).all():
        raise missing("imu", "an accelerometer (method smoother)")
    if samples.velocity is None:
        raise missing("velocity", "a body velocity (method smoother)")
    inside = (column(samples.imu, "t_s") >= motion.t_s[0]) & (
        column(samples.imu, "t_s") <= motion.t_s[-1]
    )
    t = column(samples.imu, "t_s")[inside]
    euler, omega, omega_dot = (
        CubicSpline(motion.t_s, part)(t) for part in (motion.euler, motion.omega, motion.omega_dot)
    )
    force = inertial_acceleration(
        matrix(samples.imu, ACCELEROMETER)[inside] @ vehicle.imu.rotation.T,
        convention=convention,
        euler=euler,
        omega=omega,
        omega_dot=omega_dot,
        velocity=(
            np.zeros_like(omega)
            if motion.velocity is None
            else CubicSpline(motion.t_s, motion.velocity)(t)
        ),
        arm=vehicle.imu.arm_m,
        gravity=vehicle.gravity,
    )
    times, sensed = (
        column(samples.velocity, "t_s"),
        matrix(samples.velocity, VELOCITY[:3]) @ vehicle.dvl.rotation.T,
    )
    arm, said, turn = vehicle.dvl.arm_m, None, np.zeros(3)
    if estimate_arm or estimate_mounting:
        found = estimate_installation(
            t, force, euler, omega, times, sensed, arm=estimate_arm, mounting=estimate_mounting
        )
        said = _installation_document(found)
        if estimate_arm:
            arm = np.where(found.determined_arm, found.arm_m, arm)
        if estimate_mounting:
            turn = np.where(found.determined_mounting, found.mounting_rad, 0.0)

    def at_origin(times: Array, sensed: Array) -> Array:
        rates = CubicSpline(motion.t_s, motion.omega)(np.clip(times, motion.t_s[0], motion.t_s[-1]))
        return lever_arm_velocity(
            sensed + cross(np.broadcast_to(turn, sensed.shape), sensed), rates, arm
        )

    track = water_track(samples.water, (float(t[0]), float(t[-1]))) if estimate_current else None
    depth_times = column(samples.depth, "t_s")
    attitude = CubicSpline(motion.t_s, motion.euler)(
        np.clip(depth_times, motion.t_s[0], motion.t_s[-1])
    )
    smoothed = smooth_velocity(
        t,
        force,
        euler,
        omega,
        t_velocity=times,
        velocity=at_origin(times, sensed),
        t_depth=depth_times,
        depth=column(samples.depth, "z_m") - vertical_arm(attitude, vehicle.depth_sensor.arm_m),
        noise=_noise(noise, vehicle.gravity),
        t_water=None if track is None else track[0],
        water=None if track is None else at_origin(track[0], track[1] @ vehicle.dvl.rotation.T),
    )
    on_clock = np.clip(motion.t_s, t[0], t[-1])
    velocity, rate = (
        CubicSpline(t, smoothed.velocity)(on_clock),
        CubicSpline(t, smoothed.rate)(on_clock),
    )
    spread = np.column_stack(
        [np.interp(on_clock, t, smoothed.velocity_sd[:, axis]) for axis in range(3)]
    )
    # motion.velocity rests on the arm of the vehicle file; the velocity found rests on
    # the arm and mounting that were used.
    measured = velocity
    if motion.velocity is not None:
        lever = cross(motion.omega, np.broadcast_to(vehicle.dvl.arm_m, motion.omega.shape))
        measured = at_origin(motion.t_s, motion.velocity + lever)
    check = sway_check(velocity, measured, convention)
    result = Found(
        convention, smoothed.bias.mean(axis=0), velocity_sd=spread, installation=said, **check
    )
    if track is not None:
        result = replace(
            result,
            current=current_document(smoothed),
            drift=drift(smoothed, on_clock, motion.euler),
        )
    elif estimate_current:
        result = replace(result, current=without_water_track(samples.water))
    return velocity, rate, result


def _noise(given: Mapping[str, float], gravity: float) -> SmootherNoise:
    known = {
        "accel_m_s2",
        "velocity_m_s",
        "depth_m",
        "jerk_density",
        "tilt_error_rad",
        "tilt_time_s",
        "bias_m_s2",
        "water_m_s",
        "current_walk_m_s",
    }
    for key, value in given.items():
        if key not in known:
            raise CampaignError(
                "unknown noise",
                field=f"stages.fuse.noise.{key}",
                allowed=sorted(known),
                remedy=nearest(key, known),
            )
        if not value > 0:
            raise CampaignError(
                "a noise must be positive", field=f"stages.fuse.noise.{key}", value=value
            )
    three = {
        key: np.full(3, given[key]) if key in given else None
        for key in ("accel_m_s2", "velocity_m_s", "jerk_density", "water_m_s")
    }
    return SmootherNoise(
        accel=three["accel_m_s2"],
        velocity=three["velocity_m_s"],
        depth=given.get("depth_m"),
        jerk_density=three["jerk_density"],
        tilt_error_rad=given.get("tilt_error_rad", SmootherNoise.tilt_error_rad),
        tilt_time_s=given.get("tilt_time_s", SmootherNoise.tilt_time_s),
        bias=given.get("bias_m_s2", SmootherNoise.bias),
        gravity=gravity,
        water=three["water_m_s"],
        current_walk=given.get("current_walk_m_s", SmootherNoise.current_walk),
    )


def _installation_document(found: Installation) -> dict[str, Any]:
    def numbers(values: Array) -> list[float | None]:
        return [float(value) if np.isfinite(value) else None for value in values]

    return {
        "dvl_arm_m": numbers(found.arm_m),
        "dvl_arm_sd_m": numbers(found.arm_sd_m),
        "dvl_arm_determined": list(found.determined_arm),
        "dvl_mounting_rad": numbers(found.mounting_rad),
        "dvl_mounting_sd_rad": numbers(found.mounting_sd_rad),
        "dvl_mounting_determined": list(found.determined_mounting),
    }
