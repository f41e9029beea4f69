"""How velocity log and accelerometer are installed, checked over all legs together.

Lever arm, mounting angles and lag of the velocity log, scales of velocity and depth,
and what the accelerometer's reading holds, each as a departure from the vehicle file.
The equations are those of `hydro/identification/signals/installation.py`. One vehicle
has one installation: sums of each leg are added, and one leg is in memory at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import (
    InstallationEstimate,
    InstallationFigure,
    InstallationRecord,
    SegmentRecord,
)
from auvid.data_schemas.tables import column, matrix
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.installation import (
    CERTAIN,
    SENSORS,
    InstallationFaults,
    InstallationSums,
    LegSensors,
    departure_verdict,
    installation_faults,
    installation_sums,
)
from auvid.hydro.identification.signals.smoother import SmootherNoise
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.check_installation.presentation import installation_section
from auvid.stages.columns import VELOCITY
from auvid.stages.sensor_motion import (
    VelocityLogPlacement,
    accelerometer_motion,
    depth_below_origin,
    sensor_motion,
)
from auvid.stages.steps import counted

ARM, ANGLES = ("arm_x", "arm_y", "arm_z"), ("angle_x", "angle_y", "angle_z")
SCALES = ("velocity_scale", "depth_scale")
FIGURES = (*ARM, *ANGLES, "lag", *SCALES)
UNITS = {**dict.fromkeys(ARM, "m"), **dict.fromkeys(ANGLES, "rad"), "lag": "s"}
SPREAD = {**dict.fromkeys(ARM, 0.3), **dict.fromkeys(ANGLES, 0.035), "lag": 0.1} | dict.fromkeys(
    SCALES, 0.05
)
"""How far from the truth a vehicle file's figure may be (standard deviations [m, rad, s,
1]): half a metre, four degrees and .2 s are within two.
"""
CONVENTIONS = {"specific_force": (1.0, 1.0), "inertial": (1.0, 0.0), "derivative": (0.0, 0.0)}
"""Convention -> share of omega x v, and of gravity, that the reading holds."""
CERTAIN_SCALE = 6.0
"""That of a scale: set when its standard error was half of its error; of 42 clean twins
none is now beyond 1.8 (0025).
"""
ANOTHER_CONVENTION = 0.5
"""A share of gravity or omega x v that is off by more is that of another convention."""


@dataclass(frozen=True)
class Inputs:
    resampled: Collection[pa.Table] = port("resampled", many=True)
    segment: Collection[SegmentRecord] = port("segment", many=True)
    log_info: Collection[LogInfo] = port("log_info", many=True)
    vehicle: Vehicle = port("vehicle")
    samples_imu: Collection[pa.Table] | None = port("samples_imu", many=True, optional=True)
    samples_velocity: Collection[pa.Table] | None = port(
        "samples_velocity", many=True, optional=True
    )
    samples_depth: Collection[pa.Table] | None = port("samples_depth", many=True, optional=True)


@dataclass(frozen=True)
class Params:
    """A departure is a finding beyond three standard errors and these sizes."""

    arm_m: float = param("m", 0.05, meaning="departure of the arm that counts", low=0.001)
    angle_deg: float = param("deg", 0.5, meaning="departure of an angle that counts", low=0.01)
    lag_s: float = param("s", 0.025, meaning="departure of the lag that counts", low=0.001)
    scale: float = param("1", 0.03, meaning="departure of a scale that counts", low=0.001)


@dataclass(frozen=True)
class Outputs:
    installation: InstallationRecord = port("installation")
    section: Document = port("section")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return the installation that all legs together show."""
    sums: InstallationSums | None = None
    legs: list[str] = []
    left_out: dict[str, str] = {}
    conventions: set[str] = set()
    for key, segment in counted("leg", list(inputs.segment.items())):
        convention = inputs.log_info[str(segment.log)].accelerometer or inputs.vehicle.accelerometer
        try:
            leg = _leg(inputs, key, convention)
            item = installation_sums(leg, SmootherNoise(gravity=inputs.vehicle.gravity))
        except DataError as lack:
            left_out[key] = lack.message
            continue
        sums = item if sums is None else sums.merge(item)
        legs.append(key)
        conventions.add(convention)
    common = conventions.pop() if len(conventions) == 1 else None
    record = _record(sums, inputs.vehicle, params, common, legs, left_out)
    return Outputs(record, installation_section(record))


def _leg(inputs: Inputs, key: str, convention: str) -> LegSensors:
    """Return the sensors of a segment; raises `DataError` where one is missing."""
    for stream, samples in (
        ("velocity log", inputs.samples_velocity),
        ("accelerometer", inputs.samples_imu),
        ("depth sensor", inputs.samples_depth),
    ):
        if samples is None or key not in samples:
            raise DataError(f"no {stream}")
    assert inputs.samples_imu is not None
    assert inputs.samples_velocity is not None
    assert inputs.samples_depth is not None
    vehicle = inputs.vehicle
    placement = VelocityLogPlacement.of(vehicle, None)
    motion = sensor_motion(
        inputs.resampled[key], vehicle, cutoff_hz=None, fit_gyro_bias=True, placement=placement
    )
    accelerometer = accelerometer_motion(
        motion, inputs.samples_imu[key], vehicle, convention=convention
    )
    if accelerometer is None:
        raise DataError("no accelerometer")
    velocity, depth = inputs.samples_velocity[key], inputs.samples_depth[key]
    t_depth, z = column(depth, "t_s"), column(depth, "z_m")
    below = depth_below_origin(motion.at(motion.euler, t_depth), vehicle.depth_sensor.arm_m)
    return LegSensors(
        accelerometer.t_s,
        accelerometer.acceleration,
        accelerometer.reading,
        accelerometer.euler,
        accelerometer.omega,
        motion.at(motion.omega_dot, accelerometer.t_s),
        column(velocity, "t_s"),
        matrix(velocity, VELOCITY[:3]),
        placement.arm_m,
        t_depth,
        z - below,
    )


def _record(
    sums: InstallationSums | None,
    vehicle: Vehicle,
    params: Params,
    convention: str | None,
    legs: list[str],
    left_out: Mapping[str, str],
) -> InstallationRecord:
    if sums is None:
        unseen = InstallationFaults(FIGURES, np.zeros(len(FIGURES)), np.full(len(FIGURES), np.inf))
        figures = _figures(unseen, vehicle, params)
        return InstallationRecord(
            figures=figures,
            estimate=None,
            convention=convention,
            convention_found=None,
            innovations={},
            legs=legs,
            left_out=dict(left_out),
        )
    another = _other_convention(sums, convention)
    free = installation_faults(sums, FIGURES)
    weighed = installation_faults(sums, FIGURES, [SPREAD[name] for name in FIGURES]).value
    estimate = InstallationEstimate(
        arm_m=(vehicle.dvl.arm_m + weighed[:3]).tolist(),
        angles_rad=weighed[3:6].tolist(),
        lag_s=float(weighed[6]),
    )
    return InstallationRecord(
        figures=[] if another else _figures(free, vehicle, params),
        estimate=None if another else estimate,
        convention=convention,
        convention_found=another,
        innovations=dict(zip(SENSORS, (sums.squares / sums.samples).tolist(), strict=True)),
        legs=legs,
        left_out=dict(left_out),
    )


def _other_convention(sums: InstallationSums, convention: str | None) -> str | None:
    """Return the convention of the accelerometer's readings, if it is another."""
    if convention is None:
        return None
    estimate = installation_faults(sums, (*FIGURES, "gravity", "transport"))
    gravity, transport = estimate.value[-2:]
    off = np.abs([gravity, transport])
    if not np.any((off > ANOTHER_CONVENTION) & (off > CERTAIN * estimate.sd[-2:])):
        return None
    share = np.add(CONVENTIONS[convention], [-transport, gravity])
    distances = {name: float(np.hypot(*(share - part))) for name, part in CONVENTIONS.items()}
    best = min(distances, key=distances.__getitem__)
    return None if best == convention else best


def _figures(
    faults: InstallationFaults, vehicle: Vehicle, params: Params
) -> list[InstallationFigure]:
    limits = {
        **dict.fromkeys(ARM, params.arm_m),
        **dict.fromkeys(ANGLES, float(np.radians(params.angle_deg))),
        "lag": params.lag_s,
        **dict.fromkeys(SCALES, params.scale),
    }
    file_values: dict[str, float] = {
        **dict(zip(ARM, vehicle.dvl.arm_m.tolist(), strict=True)),
        "lag": vehicle.dvl.lag_s,
    }
    figures = []
    for name, value, sd in zip(faults.names, faults.value, faults.sd, strict=True):
        limit, written = limits[name], file_values.get(name)
        certain = CERTAIN_SCALE if name in SCALES else CERTAIN
        verdict = departure_verdict(float(value), float(sd), limit, certain=certain)
        departs = verdict == "departs"
        figures.append(
            InstallationFigure(
                name=name.replace("_", " "),
                unit=UNITS.get(name, "1"),
                departure=float(value),
                standard_error=float(sd) if np.isfinite(sd) else None,
                limit=limit,
                verdict=verdict,
                file_value=written,
                corrected=None if written is None or not departs else written + float(value),
            )
        )
    return figures


STAGE = Stage(
    "check_installation",
    "Check how velocity log and accelerometer are installed, over all legs together",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
    no_views="one figure a campaign is no signal: they stand in its table",
)
