"""Drag from coasts, and with it a check of the thrust curve.

Where nothing pushes an axis and the vehicle still moves along it, the equation of motion
has no thrust: the decay of the speed gives drag over apparent mass whatever the thrust
curve says. The powered legs give drag by the thrust curve of the vehicle file. Their
ratio is the scale of that curve, which every coefficient of the campaign goes with.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import FusionRecord, InstallationRecord, SegmentRecord
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.coasting.decay import LEAST_COASTS, fit_decay
from auvid.hydro.identification.coasting.finding import CoastRule
from auvid.hydro.identification.coasting.thrust_scale import (
    ThrustLag,
    common_scale,
    drag_and_scale,
)
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.coast.coast_records import (
    COMMANDS,
    DEGREES,
    FORCE_COLUMNS,
    SegmentTables,
    drift_shares,
    force_columns_of,
    powered_leg,
    segment_coasts,
)
from auvid.stages.coast.presentation import (
    AxisCoasts,
    coast_rows,
    coast_section,
    drag_rows,
)
from auvid.stages.columns import ACCELERATION, ATTITUDE, VELOCITY
from auvid.stages.sensor_motion import VelocityLogPlacement
from auvid.stages.steps import counted

NET_BUOYANCY = 0.02
"""Standard deviation of the net buoyancy that the vehicle file does not have, as a share
of the weight: an ROV is trimmed to a few newtons."""


@dataclass(frozen=True)
class Inputs:
    segment: Collection[SegmentRecord] = port("segment", many=True)
    fused: Collection[pa.Table] = port("fused", many=True)
    fusion: Collection[FusionRecord] = port("fusion", many=True)
    residual: Collection[pa.Table] = port("residual", many=True)
    resampled: Collection[pa.Table] = port("resampled", many=True)
    log_info: Collection[LogInfo] = port("log_info", many=True)
    vehicle: Vehicle = port("vehicle")
    samples_imu: Collection[pa.Table] | None = port("samples_imu", many=True, optional=True)
    samples_velocity: Collection[pa.Table] | None = port(
        "samples_velocity", many=True, optional=True
    )
    installation: InstallationRecord | None = port("installation", optional=True)


@dataclass(frozen=True)
class Params:
    wait_s: float = param(
        "s", 0.1, meaning="after the thrust ended, what is not taken", low=0.0, high=10.0
    )
    least_s: float = param(
        "s", 1.0, meaning="shortest coast, from the end of the thrust on", low=0.2, high=60.0
    )
    longest_s: float = param("s", 4.0, meaning="what is taken of a longer one", low=0.5, high=600.0)
    speed_m_s: float = param(
        "m/s", 0.1, meaning="least speed at the start in surge, sway, heave", low=0.001, high=5.0
    )
    rate_rad_s: float = param(
        "rad/s", 0.2, meaning="least yaw rate at the start", low=0.001, high=5.0
    )
    thrust_lag_s: float = param(
        "s", 0.1, meaning="time constant of the thrust after it was stopped", low=0.0, high=5.0
    )
    thrust_lag_sd_s: float | None = param(
        "s",
        None,
        meaning="standard deviation of thrust_lag_s where it was measured; none: the powered legs"
        " tell the lag",
        low=0.001,
        high=5.0,
    )
    releases: tuple[str, ...] = param(
        "1",
        (),
        meaning="legs that begin when something else lets go of the body: a tow, a hand, a winch",
    )


@dataclass(frozen=True)
class Outputs:
    coasts: pa.Table = port("coasts")
    coast_drag: pa.Table = port("coast_drag")
    section: Document = port("section")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Find the coasts of all segments, fit them, and compare with the powered legs."""
    vehicle = inputs.vehicle
    leg_names = {segment.leg for segment in inputs.segment.values()}
    unknown = [name for name in params.releases if name not in leg_names]
    if unknown:
        raise CampaignError(
            "no such leg",
            field="stages.coast.releases",
            value=unknown[0],
            allowed=sorted(leg_names),
        )
    rules = {
        name: CoastRule(
            params.rate_rad_s if name == "r" else params.speed_m_s,
            params.wait_s,
            params.least_s,
            params.longest_s,
        )
        for name in DEGREES
    }
    axes = _gathered(inputs, params, rules)
    sd_s = params.thrust_lag_sd_s
    stated = None if sd_s is None else ThrustLag(params.thrust_lag_s, 0.0, sd_s)
    for name, axis in axes.items():
        _fit(axis, inputs, DEGREES[name], stated)
    scaled = [axis for axis in axes.values() if axis.scale is not None]
    common = (
        common_scale(
            [axis.scale for axis in scaled if axis.scale is not None],
            [axis.mass_share for axis in scaled],
        )
        if scaled
        else None
    )
    return Outputs(
        make_table("coasts", coast_rows(axes)),
        make_table("coast_drag", drag_rows(axes)),
        coast_section(axes, common, vehicle, rules["u"].least_s),
    )


def _gathered(
    inputs: Inputs, params: Params, rules: Mapping[str, CoastRule]
) -> dict[str, AxisCoasts]:
    """Return the coasts of all segments by velocity."""
    vehicle, logs = inputs.vehicle, _logs(inputs)
    axes = {name: AxisCoasts() for name in DEGREES}
    for key, segment in counted("segment", list(inputs.segment.items())):
        fusion = inputs.fusion[key]
        tables = SegmentTables(
            segment,
            fusion,
            inputs.log_info[str(segment.log)],
            inputs.fused.part(key, (*ATTITUDE, *VELOCITY, *ACCELERATION)),
            inputs.residual.part(key, FORCE_COLUMNS),
            inputs.resampled.part(key, COMMANDS),
            None if inputs.samples_imu is None else inputs.samples_imu.get(key),
            None if inputs.samples_velocity is None else inputs.samples_velocity.get(key),
        )
        estimated = inputs.installation if fusion.installation == "estimate" else None
        place = VelocityLogPlacement.of(vehicle, estimated)
        released = segment.leg in params.releases and key in (segment.leg, f"{segment.leg}.1")
        parts = segment_coasts(
            tables,
            vehicle,
            place,
            rules,
            lag_s=params.thrust_lag_s,
            released=released,
            logs=logs,
        )
        for name, part in parts.items():
            axes[name].add(key, float(segment.leg_start_s), part.search, part.records)
    return axes


def _logs(inputs: Inputs) -> list[str]:
    return sorted({str(segment.log) for segment in inputs.segment.values()})


def _fit(axis: AxisCoasts, inputs: Inputs, place: int, stated: ThrustLag | None) -> None:
    """Fit the coasts on one axis, and the scale of the thrust where it is driven.

    Only the powered legs of one axis that has coasts are in memory.
    """
    vehicle = inputs.vehicle
    axis.mass_share = mass_share(vehicle, place)
    if len(axis.records) < LEAST_COASTS:  # which the section says
        return
    mass = float(vehicle.mass_matrix[place, place])
    prior_sd = (NET_BUOYANCY,) if place < 3 else ()
    legs = []
    for key, segment in inputs.segment.items():
        fused = inputs.fused.part(key, (*ATTITUDE, VELOCITY[place]))
        drift = drift_shares(fused, segment, inputs.fusion[key], place, _logs(inputs))
        residual = inputs.residual.part(key, force_columns_of(place))
        legs.append(powered_leg(fused, residual, vehicle, place, drift))
    with suppress(DataError):  # too few of the coasts are sound
        if any(np.any(leg.thrust != 0.0) for leg in legs):
            axis.decay, axis.scale = drag_and_scale(
                axis.records, legs, mass=mass, prior_sd=prior_sd, stated=stated
            )
        else:
            axis.decay = fit_decay(axis.records, prior_sd=prior_sd)


def mass_share(vehicle: Vehicle, place: int) -> float:
    """Return the standard deviation of an apparent mass as a share of it.

    By the spreads of the vehicle file of mass, inertia and added mass; 0 without any.
    """
    spreads = vehicle.spreads
    body = float(vehicle.inertia[place - 3, place - 3]) if place > 2 else 1.0
    own = spreads.get("inertia" if place > 2 else "mass", 0.0) * body
    added = spreads.get("added_mass", 0.0) * float(vehicle.added_mass[place, place])
    return float(np.hypot(own, added) / vehicle.mass_matrix[place, place])


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="coast",
    summary="Drag from coasts without thrust, and the scale of the thrust curve by it",
    maps_over="campaign",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
    no_views="fuse shows the velocities in which it finds coasts",
)
