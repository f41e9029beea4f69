"""Bias-corrected state and its derivative at the body origin, from a segment's sensors.

Method `kinematic`: velocity from the velocity sensor, rates from the gyro, depth from
the pressure sensor, derivatives from splines. Method `thesis`: McCarter section 2.5,
velocity from the integrated accelerometer; with `as_published` the transport term omega
x v stays in, as the thesis has it; otherwise it is removed and the initial velocity is
fitted (corrections: accelerometer kinematics, bias inside the integral). Method
`smoother`: Kalman filter and smoother over velocity, acceleration and accelerometer
bias, each sensor at its own times; with velocity through the water (water track) also
the current. The state's u v w are then those through the water, which the forces see;
pose and its rate stay those over ground.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import (
    FusionRecord,
    InstallationRecord,
    SegmentRecord,
)
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import Array, Mask, cross
from auvid.hydro.dynamics.mechanics.kinematics import eta_dot, rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.bias import integrate
from auvid.hydro.identification.signals.filters import edge_zone_s
from auvid.stages.base import Document, Stage, param, port
from auvid.stages.columns import ACCELERATION, POSE, POSE_RATE, VELOCITY, VELOCITY_SD, named
from auvid.stages.fuse.methods import (
    NOISES,
    FusionResult,
    SensorSamples,
    in_stated_current,
    kinematic,
    smoother,
    thesis,
)
from auvid.stages.fuse.presentation import fuse_section, fuse_views, fusion_document
from auvid.stages.sensor_motion import (
    SensorMotion,
    VelocityLogPlacement,
    low_pass,
    sensor_motion,
)

LEAST_EDGE_S = 0.5


@dataclass(frozen=True)
class Inputs:
    segment: SegmentRecord = port("segment")
    resampled: pa.Table = port("resampled")
    vehicle: Vehicle = port("vehicle")
    log_info: LogInfo = port("log_info")
    samples_imu: pa.Table | None = port("samples_imu", optional=True)
    samples_velocity: pa.Table | None = port("samples_velocity", optional=True)
    samples_depth: pa.Table | None = port("samples_depth", optional=True)
    samples_water: pa.Table | None = port("samples_water", optional=True)
    installation: InstallationRecord | None = port("installation", optional=True)


@dataclass(frozen=True)
class Params:
    method: str = param(
        "1",
        "kinematic",
        meaning="how velocity is found",
        allowed=("kinematic", "thesis", "smoother"),
    )
    cutoff_hz: float | None = param(
        "Hz",
        3.0,
        meaning="zero-phase low-pass on all channels alike; null for none",
        low=0.05,
        high=100.0,
    )
    as_published: bool = param(
        "1",
        False,
        meaning="thesis method only: take the accelerometer for v_dot, as McCarter 2.5 does",
    )
    accelerometer: str | None = param(
        "1",
        None,
        meaning="what the accelerometer measures; null takes the log's or the vehicle's word",
        allowed=("specific_force", "inertial", "derivative"),
    )
    fit_gyro_bias: bool = param(
        "1", True, meaning="take a constant gyro bias off, found from the attitude"
    )
    noise: Mapping[str, float] = param(
        "SI",
        {},
        meaning=(
            "smoother only, else from the data: accel_m_s2 velocity_m_s depth_m jerk_density"
            " tilt_error_rad tilt_time_s bias_m_s2 water_m_s current_walk_m_s"
        ),
        names=tuple(NOISES),
    )
    installation: str = param(
        "1",
        "vehicle_file",
        meaning=(
            "where the velocity log sits: as the vehicle file says, or as check_installation finds"
            " it from all legs together"
        ),
        allowed=("vehicle_file", "estimate"),
        replaces=("estimate_dvl_arm", "estimate_dvl_mounting"),
        instead="installation: estimate",
    )
    estimate_current: bool = param(
        "1",
        False,
        meaning=(
            "smoother only: find the water current from velocity through the water (water track)"
        ),
    )
    current_m_s: Mapping[str, list[float]] = param(
        "m/s",
        {},
        meaning=(
            "log -> steady water current, north and east, to take off a velocity over ground, as"
            " synthesise finds it in the forces"
        ),
    )
    edge_s: float | None = param(
        "s",
        None,
        meaning=(
            "width cut off at an end of the data, counted from the leg's margin; null: what the"
            " low-pass needs, at least 0.5 s"
        ),
        low=0.0,
        high=60.0,
    )


@dataclass(frozen=True)
class Outputs:
    fused: pa.Table = port("fused")
    fusion: FusionRecord = port("fusion")
    section: Document = port("section")
    views: Document = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return state and derivative of one segment.

    Raises `CampaignError` for parameters of another method, `DataError` where a sensor
    that the method needs is missing, or the segment is shorter than its edges.
    """
    for key, method in (("estimate_current", "smoother"), ("as_published", "thesis")):
        if getattr(params, key) and params.method != method:
            raise CampaignError(
                f"belongs to method {method}",
                field=f"stages.fuse.{key}",
                value=f"method {params.method}",
                remedy=f"Set method: {method}, or leave {key} out.",
            )

    rate_hz = inputs.segment.rate_hz
    if params.cutoff_hz is not None and params.cutoff_hz >= 0.5 * rate_hz:
        raise CampaignError(
            "the cutoff of the low-pass must lie below half the sample rate",
            field="stages.fuse.cutoff_hz",
            value=params.cutoff_hz,
            allowed=f"below {0.5 * rate_hz:g} Hz",
            remedy="Lower it, set null for no low-pass, or raise stages.resample.rate_hz.",
        )

    stated = _stated_current(inputs.segment.log, params)
    placement = _placement(inputs, params)
    motion = sensor_motion(
        inputs.resampled,
        inputs.vehicle,
        cutoff_hz=None if params.method == "smoother" else params.cutoff_hz,
        fit_gyro_bias=params.fit_gyro_bias,
        placement=None if params.as_published else placement,
    )
    result = _fuse(inputs, params, motion, placement)
    if stated is not None:
        result = in_stated_current(result, motion, stated)
    pose = _pose(motion, result.velocity)
    over_ground = np.hstack([result.velocity, motion.omega])
    nu_dot = np.hstack([result.v_dot, motion.omega_dot])
    drift = np.zeros_like(over_ground)
    if result.drift is not None:
        # A steady current: nu_r = nu - R' c, and R' c turns against the body.
        drift[:, :3] = result.drift
        nu_dot[:, :3] = result.v_dot + cross(motion.omega, result.drift)
    if params.method == "smoother":
        pose, over_ground, drift, nu_dot = (
            low_pass(motion.t_s, part, params.cutoff_hz)
            for part in (pose, over_ground, drift, nu_dot)
        )
    edge_s = default_edge_s(params.cutoff_hz) if params.edge_s is None else params.edge_s
    keep = _inside_edges(motion.t_s, edge_s, inputs.segment)
    fused = make_table(
        "fused",
        {
            "t_s": motion.t_s[keep],
            **named(POSE, pose[keep]),
            **named(VELOCITY, (over_ground - drift)[keep]),
            **named(POSE_RATE, eta_dot(pose[keep], over_ground[keep])),
            **named(ACCELERATION, nu_dot[keep]),
            **_standard_deviations(result, inputs.segment, keep, params.method),
        },
    )
    gyro_bias = motion.gyro_bias
    del motion, drift, nu_dot  # a leg of hours has no place for them beside what is drawn
    settings = {
        "method": params.method,
        "as_published": params.as_published,
        "cutoff_hz": params.cutoff_hz,
        "edge_s": edge_s,
        "installation": params.installation,
    }
    state = named(POSE, pose) | named(VELOCITY, over_ground)
    fusion = fusion_document(
        inputs.segment, settings, gyro_bias, result, inputs.resampled, state, keep
    )
    return Outputs(
        fused=fused,
        fusion=fusion,
        section=fuse_section(inputs.segment, fusion, inputs.resampled, state, keep),
        views=fuse_views(fused),
    )


def _stated_current(log: str, params: Params) -> list[float] | None:
    """Return the current of a log by the campaign; None for none.

    Raises `CampaignError` for one that is no pair, or that sensors are to find, too.
    """
    field = f"stages.fuse.current_m_s.{log}"
    current = params.current_m_s.get(log)
    if current is None:
        return None
    if len(current) != 2:
        raise CampaignError(
            "a current has two components",
            field=field,
            value=current,
            allowed="[north, east] in m/s, towards where the water goes",
        )
    if params.estimate_current:
        raise CampaignError(
            "the current is stated, and to be found from velocity through the water, too",
            field=field,
            value=current,
            remedy="Leave out one of current_m_s and estimate_current.",
        )
    return current


def _placement(inputs: Inputs, params: Params) -> VelocityLogPlacement:
    """Return where the velocity log sits.

    Raises `CampaignError` where an estimate is wanted and there is none.
    """
    if params.installation == "vehicle_file":
        return VelocityLogPlacement.of(inputs.vehicle, None)
    if params.as_published or inputs.installation is None or inputs.installation.estimate is None:
        raise CampaignError(
            "there is no estimate of how the velocity log is installed"
            if not params.as_published
            else "the method as published takes no lever arm",
            field="stages.fuse.installation",
            value=params.installation,
            allowed="vehicle_file",
            remedy="It needs legs with a velocity log, an accelerometer and depth.",
        )
    return VelocityLogPlacement.of(inputs.vehicle, inputs.installation)


def _fuse(
    inputs: Inputs, params: Params, motion: SensorMotion, placement: VelocityLogPlacement
) -> FusionResult:
    if params.method == "kinematic":
        return kinematic(motion)
    convention = (
        params.accelerometer or inputs.log_info.accelerometer or inputs.vehicle.accelerometer
    )
    if params.method == "thesis":
        return thesis(
            motion,
            inputs.resampled,
            inputs.vehicle,
            convention=convention,
            cutoff_hz=params.cutoff_hz,
            as_published=params.as_published,
        )
    samples = SensorSamples(
        inputs.samples_imu, inputs.samples_velocity, inputs.samples_depth, inputs.samples_water
    )
    return smoother(
        motion,
        samples,
        inputs.vehicle,
        convention=convention,
        placement=placement,
        noise=params.noise,
        estimate_current=params.estimate_current,
    )


def _standard_deviations(
    result: FusionResult, segment: SegmentRecord, keep: Mask, method: str
) -> dict[str, Array]:
    """Return the standard deviations that are known of the rows kept, as columns.

    Those of velocity from the smoother, else the sensor's noise within its spline's
    bandwidth. None for the velocity of method `thesis`, whose integrated errors grow
    along the leg.
    """
    if result.velocity_sd is None and method != "kinematic":
        return {}
    columns = {}
    if result.velocity_sd is not None:
        columns = named(VELOCITY_SD[:3], result.velocity_sd[keep])
    for name, column in zip(VELOCITY, VELOCITY_SD, strict=True):
        item = segment.smoothing.get(name)
        if column not in columns and item and item.cutoff_hz and item.noise_sd is not None:
            share = min(1.0, 2.0 * item.cutoff_hz / item.sample_hz)
            columns[column] = np.full(np.count_nonzero(keep), item.noise_sd * np.sqrt(share))
    return columns


def _pose(motion: SensorMotion, velocity: Array) -> Array:
    """Return the pose (n, 6): x and y from integrated velocity (McCarter 2.91-2.92)."""
    ned = np.einsum("nij,nj->ni", rotation_body_to_ned(motion.euler), velocity)
    track = integrate(motion.t_s, ned[:, :2], np.zeros(2))
    return np.column_stack([track, motion.depth, motion.euler])


def default_edge_s(cutoff_hz: float | None) -> float:
    """Return the width [s] cut off at either end: the edge zone of the low-pass.

    At least `LEAST_EDGE_S`, for what the splines bend at the ends.
    """
    return LEAST_EDGE_S if cutoff_hz is None else max(LEAST_EDGE_S, edge_zone_s(cutoff_hz))


def _inside_edges(t_s: Array, edge_s: float, segment: SegmentRecord) -> Mask:
    """Return the rows of the leg that lie an edge or more inside the data."""
    first, last = max(0.0, t_s[0] + edge_s), min(segment.duration_s, t_s[-1] - edge_s)
    keep: Mask = (t_s >= first - 1e-9) & (t_s <= last + 1e-9)
    if keep.sum() < 10:
        raise DataError(
            f"segment '{segment.id}' of {t_s[-1] - t_s[0]:.1f} s is too short for its edges",
            field="stages.fuse.edge_s",
            value=edge_s,
            remedy="Choose a longer leg or a smaller edge_s.",
        )
    return keep


STAGE = Stage(
    "fuse",
    "Bias-corrected state and its derivative, per segment",
    "segment",
    Inputs,
    Params,
    Outputs,
    run,
)
