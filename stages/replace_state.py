"""True state of a twin in place of the fused one: the chain without sensor errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.tables import column, make_table, matrix
from auvid.hydro.dynamics.mechanics.kinematics import eta_dot
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.columns import ACCELERATION, POSE, POSE_RATE, VELOCITY, clock, named
from auvid.stages.presentation import section, text
from auvid.stages.truth_lookup import truth_of


@dataclass(frozen=True)
class Inputs:
    segment: SegmentRecord = port("segment")
    resampled: pa.Table = port("resampled")
    truth: Collection[pa.Table] = port("truth", many=True)


@dataclass(frozen=True)
class Params:
    edge_s: float = param("s", 0.5, meaning="width left out at either end", low=0.0, high=60.0)


@dataclass(frozen=True)
class Outputs:
    fused: pa.Table = port("fused")
    fusion: FusionRecord = port("fusion")
    section: Document = port("section")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Interpolate the truth by cubic splines at the times of the segment's clock.

    The unsteady force changes within a tick of the autopilot, which leaves an error of
    0.1 N where its standard deviation is 3 N. Raises `DataError` where the truth of the
    segment's log is missing or does not cover it.
    """
    from scipy.interpolate import CubicSpline

    segment, t_s = inputs.segment, clock(inputs.resampled)
    first = max(0.0, t_s[0] + params.edge_s)
    t_s = t_s[(t_s >= first) & (t_s <= min(segment.duration_s, t_s[-1] - params.edge_s))]
    at = t_s + float(segment.leg_start_s)
    truth = truth_of(inputs.truth, segment, at)
    eta, nu, nu_dot = (
        np.asarray(CubicSpline(clock(truth), matrix(truth, names))(at))
        for names in (POSE, VELOCITY, ACCELERATION)
    )
    columns = {
        "t_s": t_s,
        **named(POSE, eta),
        **named(VELOCITY, nu),
        **named(POSE_RATE, eta_dot(eta, nu)),
        **named(ACCELERATION, nu_dot),
    }
    sensed = inputs.resampled
    rows = np.searchsorted(clock(sensed), t_s - 1e-9)
    sensor_rms = {
        name: float(np.sqrt(np.mean((column(sensed, name)[rows] - nu[:, index]) ** 2)))
        for index, name in enumerate(VELOCITY)
        if name in sensed.column_names
    }
    fusion = FusionRecord(
        segment=segment.id,
        method="truth",
        as_published=False,
        accelerometer=None,
        gyro_bias_rad_s=None,
        accel_bias_m_s2=None,
        cutoff_hz=None,
        edge_s=params.edge_s,
        integrated_sway_rms_m_s=None,
        rms=sensor_rms,
        warnings=[],
    )
    note = text("The state is the truth of the twin, not a measurement of its sensors.")
    own_section = section(f"State of {segment.id} (truth)", [note], order=30)
    return Outputs(make_table("fused", columns), fusion, own_section)


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="replace_state",
    summary="The true state of a twin in place of the fused one",
    maps_over="segment",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
    no_views="its curves are those of the truth",
)
