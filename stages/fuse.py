"""Bias-corrected state and state derivative of the body origin, from one segment's sensors.

Method `kinematic`: velocity from the velocity sensor, rates from the gyro, depth from the pressure sensor, derivatives from splines.
Method `thesis`: McCarter section 2.5, velocity from the integrated accelerometer; with `as_published` the transport term omega x v stays
in, as the thesis has it; otherwise it is removed and the initial velocity is fitted (corrections: accelerometer kinematics, bias inside
the integral).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from data_schemas.errors import CampaignError, DataError
from data_schemas.streams import supply_text
from data_schemas.tables import column, has_columns, make_table, matrix
from hydro.dynamics.kinematics import eta_dot, rotation_body_to_ned
from hydro.dynamics.vehicle import Vehicle, vehicle_from_document
from hydro.identification.bias import accelerometer_bias, fit_velocity, gyro_bias, inertial_acceleration, integrate, lever_arm_velocity
from hydro.identification.filters import zero_phase_lowpass
from hydro.identification.splines import derivative
from stages.base import Document, Stage, param, port
from stages.sections import panel, plot, remark, section, series, table
from stages.signals import ACCELERATION, ACCELEROMETER, ATTITUDE, POSE, POSE_RATE, VELOCITY, Array, clock, named, rms

SWAY_WARNING_M_S = 0.1
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Inputs:
    segment: Document = port("segment")
    resampled: pa.Table = port("resampled")
    vehicle: Document = port("vehicle")
    log_info: Document = port("log_info")


@dataclass(frozen=True)
class Params:
    method: str = param("1", "kinematic", meaning="how velocity is found", allowed=("kinematic", "thesis"))
    cutoff_hz: float | None = param("Hz", 3.0, meaning="zero-phase low-pass on all channels alike; null for none", low=0.05, high=100.0)
    as_published: bool = param("1", False, meaning="thesis method only: take the accelerometer for v_dot, as McCarter 2.5 does")
    accelerometer: str | None = param(
        "1",
        None,
        meaning="what the accelerometer measures; null takes the log's or the vehicle's word",
        allowed=("specific_force", "inertial", "derivative"),
    )
    fit_gyro_bias: bool = param("1", True, meaning="take a constant gyro bias off, found from the attitude")
    edge_s: float = param("s", 0.5, meaning="width cut off at either end after filtering", low=0.0, high=60.0)


@dataclass(frozen=True)
class Outputs:
    fused: pa.Table = port("fused")
    fusion: Document = port("fusion")
    section: Document = port("section")
    views: Document = port("views")


@dataclass(frozen=True)
class Found:
    """What a method found on the way."""

    convention: str | None = None
    accel_bias: Array | None = None
    sway_rms: float | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Motion:
    """Filtered sensor signals at the body origin (n, 3) on the segment's clock (n,)."""

    t_s: Array
    depth: Array
    euler: Array
    omega: Array
    omega_dot: Array
    velocity: Array | None
    gyro_bias: Array


def run(inputs: Inputs, params: Params) -> Outputs:
    if params.as_published and params.method != "thesis":
        remedy = "Set method: thesis, or leave as_published out."
        raise CampaignError("belongs to method thesis", field="stages.fuse.as_published", value=f"method {params.method}", remedy=remedy)
    vehicle = vehicle_from_document(inputs.vehicle)
    sensed = sensed_motion(inputs.resampled, vehicle, has_gyro="p_rad_s" in inputs.segment["smoothing"])
    motion = sensor_motion(inputs.resampled, sensed, vehicle, params)
    if params.method == "kinematic":
        velocity, velocity_rate, found = kinematic(motion)
    else:
        velocity, velocity_rate, found = thesis(motion, inputs, vehicle, params)
    nu = np.hstack([velocity, motion.omega])
    nu_dot = np.hstack([velocity_rate, motion.omega_dot])
    pose = _pose(motion, velocity)
    keep = _inside_edges(motion.t_s, params.edge_s, inputs.segment)
    columns = {
        "t_s": motion.t_s,
        **named(POSE, pose),
        **named(VELOCITY, nu),
        **named(POSE_RATE, eta_dot(pose, nu)),
        **named(ACCELERATION, nu_dot),
    }
    fused = make_table("fused", {name: values[keep] for name, values in columns.items()})
    fusion = _fusion_document(inputs, params, motion, sensed, nu, keep, found)
    return Outputs(fused=fused, fusion=fusion, section=_section(inputs, motion, sensed, nu, pose, keep, fusion), views=_views())


def sensed_motion(resampled: pa.Table, vehicle: Vehicle, *, has_gyro: bool) -> dict[str, Array]:
    """What the sensors say of u v w p q r, turned into body axes, by column name: (n,) each, velocities only where there is a sensor.

    Without a gyro the rates come from the attitude and are in body axes already.
    """
    if not has_columns(resampled, VELOCITY[3:]):
        raise _missing("imu", "angular rates")
    rates = matrix(resampled, VELOCITY[3:])
    sensed = named(VELOCITY[3:], rates @ vehicle.imu.rotation.T if has_gyro else rates)
    if has_columns(resampled, VELOCITY[:3]):
        sensed |= named(VELOCITY[:3], matrix(resampled, VELOCITY[:3]) @ vehicle.dvl.rotation.T)
    return sensed


def sensor_motion(resampled: pa.Table, sensed: Mapping[str, Array], vehicle: Vehicle, params: Params) -> Motion:
    """Signals at the body origin: lever arms taken out, gyro bias off, all channels filtered alike."""
    t_s = clock(resampled)

    def smooth(values: Array) -> Array:
        return values if params.cutoff_hz is None else zero_phase_lowpass(t_s, values, cutoff_hz=params.cutoff_hz)

    euler = smooth(matrix(resampled, ATTITUDE))
    omega = smooth(np.column_stack([sensed[name] for name in VELOCITY[3:]]))
    bias = gyro_bias(t_s, euler, omega).bias if params.fit_gyro_bias else np.zeros(3)
    omega = omega - bias
    velocity = None
    if VELOCITY[0] in sensed:
        velocity = smooth(np.column_stack([sensed[name] for name in VELOCITY[:3]]))
        if not params.as_published:
            velocity = lever_arm_velocity(velocity, omega, vehicle.dvl.arm_m)
    depth = smooth(column(resampled, "z_m")) - vertical_arm(euler, vehicle.depth_sensor.arm_m)
    return Motion(t_s, depth, euler, omega, derivative(t_s, omega), velocity, bias)


def vertical_arm(euler: Array, arm_m: Array) -> Array:
    """How much deeper than the body origin a point at `arm_m` (3,) is, for attitudes (n, 3): (n,) m."""
    return np.asarray(rotation_body_to_ned(euler)[:, 2, :] @ arm_m)


def kinematic(motion: Motion) -> tuple[Array, Array, Found]:
    """Velocity and its rate (n, 3) from the velocity sensor and splines."""
    if motion.velocity is None:
        raise _missing("velocity", "a body velocity (method kinematic)")
    return motion.velocity, derivative(motion.t_s, motion.velocity), Found()


def thesis(motion: Motion, inputs: Inputs, vehicle: Vehicle, params: Params) -> tuple[Array, Array, Found]:
    """Velocity and its rate (n, 3) from the integrated accelerometer, McCarter (2.76)-(2.92): biases found against the velocity sensor."""
    if motion.velocity is None:
        raise _missing("velocity", "a body velocity to find the accelerometer's bias against (method thesis)")
    raw = matrix(inputs.resampled, ACCELEROMETER) if has_columns(inputs.resampled, ACCELEROMETER) else np.full((1, 3), np.nan)
    if not np.isfinite(raw).all():
        raise _missing("imu", "an accelerometer (method thesis)")
    t_s, omega, euler = motion.t_s, motion.omega, motion.euler
    accel = raw @ vehicle.imu.rotation.T
    if params.cutoff_hz is not None:
        accel = zero_phase_lowpass(t_s, accel, cutoff_hz=params.cutoff_hz)
    measured = with_depth_rate(motion.velocity, euler, derivative(t_s, motion.depth))
    convention = params.accelerometer or inputs.log_info.get("accelerometer") or vehicle.accelerometer
    arm = np.zeros(3) if params.as_published else vehicle.imu.arm_m
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
    if params.as_published:
        rate = accel if convention == "derivative" else force
        fit = accelerometer_bias(t_s, measured, rate, initial=measured[0])
        rate = rate - fit.bias
        velocity = integrate(t_s, rate, fit.initial)
        bias = fit.bias
    else:
        found = fit_velocity(t_s, force, euler, t_s, measured)
        velocity, bias = found.velocity, found.bias
        rate = force - bias - np.cross(omega, velocity)
    sway = rms(velocity[:, 1] - measured[:, 1])
    warnings = []
    if sway > SWAY_WARNING_M_S:
        taken_for = "the rate of change of body velocity" if params.as_published else convention
        warnings.append(
            f"Integrated and measured sway differ by {sway:.2f} m/s RMS (limit {SWAY_WARNING_M_S:g}): the accelerometer does not measure "
            f"what the method takes it for ({taken_for}), or it drifts."
        )
    return velocity, rate, Found(convention, bias, sway, tuple(warnings))


def with_depth_rate(velocity: Array, euler: Array, depth_rate: Array) -> Array:
    """Body velocity (n, 3) whose vertical part is the rate of the measured depth: McCarter (2.76)-(2.78)."""
    to_ned = rotation_body_to_ned(euler)
    ned = np.einsum("nij,nj->ni", to_ned, velocity)
    ned[:, 2] = depth_rate
    return np.asarray(np.einsum("nji,nj->ni", to_ned, ned))


def _missing(stream: str, what: str) -> DataError:
    return DataError(f"stage fuse needs {what}: the stream '{stream}' is missing", remedy=f"It can come from: {supply_text(stream)}.")


def _pose(motion: Motion, velocity: Array) -> Array:
    """Pose (n, 6): attitude and depth as measured, x and y from integrated velocity (McCarter 2.91-2.92)."""
    ned = np.einsum("nij,nj->ni", rotation_body_to_ned(motion.euler), velocity)
    track = integrate(motion.t_s, ned[:, :2], np.zeros(2))
    return np.column_stack([track, motion.depth, motion.euler])


def _inside_edges(t_s: Array, edge_s: float, segment: Document) -> Mask:
    keep: Mask = (t_s >= t_s[0] + edge_s - 1e-9) & (t_s <= t_s[-1] - edge_s + 1e-9)
    if keep.sum() < 10:
        raise DataError(
            f"segment '{segment['id']}' of {t_s[-1] - t_s[0]:.1f} s is too short for its edges",
            field="stages.fuse.edge_s",
            value=edge_s,
            remedy="Choose a longer leg or a smaller edge_s.",
        )
    return keep


def _fusion_document(
    inputs: Inputs, params: Params, motion: Motion, sensed: Mapping[str, Array], nu: Array, keep: Mask, found: Found
) -> dict[str, Any]:
    spread = {name: rms((sensed[name] - nu[:, index])[keep]) for index, name in enumerate(VELOCITY) if name in sensed}
    return {
        "segment": inputs.segment["id"],
        "method": params.method,
        "as_published": params.as_published,
        "accelerometer": found.convention,
        "gyro_bias_rad_s": [float(value) for value in motion.gyro_bias],
        "accel_bias_m_s2": None if found.accel_bias is None else [float(value) for value in found.accel_bias],
        "cutoff_hz": params.cutoff_hz,
        "edge_s": params.edge_s,
        "integrated_sway_rms_m_s": found.sway_rms,
        "rms": spread,
        "warnings": list(found.warnings),
    }


def _section(
    inputs: Inputs, motion: Motion, sensed: Mapping[str, Array], nu: Array, pose: Array, keep: Mask, fusion: Document
) -> dict[str, Any]:
    start = float(inputs.segment["leg_start_s"])
    t = motion.t_s + start
    raw = inputs.resampled
    panels = []
    for index, (name, label, unit) in enumerate(zip(VELOCITY, "uvwpqr", ["m/s"] * 3 + ["rad/s"] * 3, strict=True)):
        lines = [series("raw", t, sensed[name], "raw")] if name in sensed else []
        panels.append(panel(label, unit, [*lines, series("fused", t[keep], nu[keep, index], "fused")]))
    attitude = [
        panel(label, "rad", [series("raw", t, matrix(raw, (column,))[:, 0], "raw"), series("fused", t[keep], pose[keep, index], "fused")])
        for index, label, column in ((3, "phi", "phi_rad"), (4, "theta", "theta_rad"), (5, "psi", "psi_rad"), (2, "z", "z_m"))
    ]
    for item in attitude[3:]:
        item["unit"] = "m"
    rows = [[name.split("_")[0], value, "m/s" if name in VELOCITY[:3] else "rad/s"] for name, value in fusion["rms"].items()]
    biases = [["gyro " + axis, value, "rad/s"] for axis, value in zip("xyz", fusion["gyro_bias_rad_s"] or [], strict=False)]
    biases += [["accelerometer " + axis, value, "m/s^2"] for axis, value in zip("xyz", fusion["accel_bias_m_s2"] or [], strict=False)]
    blocks = [remark(words, "warning") for words in fusion["warnings"]]
    blocks += [
        plot(
            "Velocity of the body origin, raw against fused",
            panels,
            group="time",
            look_for="The fused line follows the raw one without lag; what it leaves out looks like noise.",
        ),
        plot("Attitude and depth", attitude, group="time"),
        table("Biases", ["channel", "value", "unit"], biases),
        table("RMS of raw minus fused", ["channel", "RMS", "unit"], rows, note="It holds the lever arm and the bias too."),
    ]
    return section(f"State of {inputs.segment['id']} ({fusion['method']})", blocks, order=30)


def _views() -> dict[str, Any]:
    groups = []
    for entity, names, unit in (
        ("state/velocity", VELOCITY[:3], "m/s"),
        ("state/rates", VELOCITY[3:], "rad/s"),
        ("state/attitude", ATTITUDE, "rad"),
    ):
        symbols = [name.split("_")[0] for name in names]
        for table_name, role in (("resampled", "raw"), ("fused", "fused")):
            groups.append(
                {
                    "entity": f"{entity}/{role}",
                    "table": table_name,
                    "columns": list(names),
                    "names": [f"{symbol} {role}" for symbol in symbols],
                    "roles": [role] * 3,
                    "tab": "State",
                    "unit": unit,
                }
            )
    return {"groups": groups}


STAGE = Stage("fuse", "Bias-corrected state and its derivative, per segment", "segment", Inputs, Params, Outputs, run)
