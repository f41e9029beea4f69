"""Check of the chain against the truth of a twin: results on its legs, and bounds.

Velocity, rates, attitude, depth, residual force, sensor biases, and the force that each
model predicts; and the bounds that a campaign sets for them, as report section, tables
and warnings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.tables import make_table, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.check_truth.bounds import FIGURES, checks, same_form
from auvid.stages.check_truth.errors import Errors, Sums
from auvid.stages.check_truth.presentation import comparison_plots, trust_section, trust_views
from auvid.stages.columns import AXIS_UNITS, POSE, VELOCITY, clock, force_columns, forces, named
from auvid.stages.presentation import Block
from auvid.stages.truth_lookup import BIASES, bias_errors, drawn_biases, true_values, truth_of

TAU_BAR = force_columns("tau_bar")


@dataclass(frozen=True)
class Inputs:
    vehicle: Vehicle = port("vehicle")
    simulation: Document = port("simulation")
    truth: Collection[pa.Table] = port("truth", many=True)
    segment: Collection[SegmentRecord] = port("segment", many=True)
    fused: Collection[pa.Table] = port("fused", many=True)
    fusion: Collection[FusionRecord] = port("fusion", many=True)
    residual: Collection[pa.Table] = port("residual", many=True)
    predictions: Collection[pa.Table] = port("predictions", many=True)
    error_table: pa.Table = port("error_table")
    model_card: Collection[ModelCard] = port("model_card", many=True)


@dataclass(frozen=True)
class Params:
    """Bounds; null sets none. A run whose bounds are missed ends with status 1."""

    force_error: float | None = param(
        "N, N m",
        None,
        meaning="bound of the RMS error of the residual force over six axes",
        low=0.0,
    )
    velocity_error_m_s: float | None = param(
        "m/s", None, meaning="bound of the RMS error of u v w", low=0.0
    )
    gyro_bias_rad_s: float | None = param(
        "rad/s", None, meaning="bound of the RMS error of the gyro bias", low=0.0
    )
    accel_bias_m_s2: float | None = param(
        "m/s^2", None, meaning="bound of the RMS error of the accelerometer bias", low=0.0
    )
    ratio: Mapping[str, float] = param("1", {}, meaning="bounds of J/J0 on validation, by model")


@dataclass(frozen=True)
class Outputs:
    truth_errors: pa.Table = port("truth_errors")
    trust_checks: pa.Table = port("trust_checks")
    true_motion: Mapping[str, pa.Table] = port("true_motion", many=True)
    section: Document = port("section")
    views: Document = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Compare estimates with the truth of all legs.

    Raises `DataError` where a segment has no truth, and `CampaignError` for a bound on
    what was not measured.
    """
    errors, moved = Sums(), {}
    plots: list[Block] = []
    rotation, drawn = (
        inputs.vehicle.imu.rotation,
        drawn_biases(inputs.simulation),
    )
    judged = any(item.use == "validation" for item in inputs.segment.values())
    for key, fused in inputs.fused.items():
        segment, residual = inputs.segment[key], inputs.residual[key]
        place = (str(segment.use), key)
        true, estimate = _compared(inputs.truth, segment, fused, residual)
        moved[key] = make_table(
            "true_motion", {"t_s": clock(fused), **named((*POSE[2:], *VELOCITY, *TAU_BAR), true)}
        )
        for (quantity, unit), (axes, columns) in QUANTITIES.items():
            errors.add(place, quantity, axes, unit, estimate[:, columns], true[:, columns])
        errors.add(
            place,
            "force, all axes",
            ("all",),
            "N, N m",
            estimate[:, 10:].reshape(-1, 1),
            true[:, 10:].reshape(-1, 1),
        )
        for name, (error, true_bias) in bias_errors(
            inputs.fusion[key], drawn[str(segment.log)], rotation
        ).items():
            quantity, unit = BIAS_NAMES[name]
            errors.add(
                place, quantity, ("x", "y", "z"), unit, (error + true_bias)[None], true_bias[None]
            )
        _add_models(errors, place, inputs.predictions[key], true[:, 10:])
        if segment.use == "validation" or not judged:
            plots += comparison_plots(segment, clock(fused), estimate[:, 4:], true[:, 4:])
    truth_errors: Errors = errors.errors()
    check_results = checks(
        {name: getattr(params, name) for name in FIGURES},
        params.ratio,
        truth_errors,
        inputs.error_table.to_pylist(),
        same_form(
            inputs.simulation, {name: card.predictor for name, card in inputs.model_card.items()}
        ),
    )
    return Outputs(
        truth_errors=make_table("truth_errors", truth_errors.columns()),
        trust_checks=make_table(
            "trust_checks",
            {
                "figure": [check.quantity for check in check_results],
                "unit": [check.unit for check in check_results],
                "bound": [check.high for check in check_results],
                "value": [check.value for check in check_results],
                "met": [check.met for check in check_results],
                "evidence": [check.evidence for check in check_results],
                "reason": [check.evidence_reason for check in check_results],
            },
        ),
        true_motion=moved,
        section=trust_section(
            truth_errors,
            check_results,
            plots,
            {name: str(card.title) for name, card in inputs.model_card.items()},
        ),
        views=trust_views(inputs.segment),
    )


QUANTITIES: Mapping[tuple[str, str], tuple[tuple[str, ...], slice]] = {
    ("depth", "m"): (("z",), slice(0, 1)),
    ("attitude", "rad"): (("phi", "theta", "psi"), slice(1, 4)),
    ("velocity", "m/s"): (("u", "v", "w"), slice(4, 7)),
    ("rate", "rad/s"): (("p", "q", "r"), slice(7, 10)),
    ("force", "N"): (AXES[:3], slice(10, 13)),
    ("moment", "N m"): (AXES[3:], slice(13, 16)),
}
BIAS_NAMES = dict(
    zip(BIASES, (("gyro bias", "rad/s"), ("accelerometer bias", "m/s^2")), strict=True)
)


def _compared(
    truths: Mapping[str, pa.Table], segment: SegmentRecord, fused: pa.Table, residual: pa.Table
) -> tuple[Array, Array]:
    """Return true and estimated values (n, 16) on the clock of the fused table.

    Columns: z, attitude, velocity, rates and residual force.

    Heading may differ by whole turns, which the truth follows.
    """
    at = clock(fused) + float(segment.leg_start_s)
    truth = truth_of(truths, segment, at)
    estimate = np.hstack([matrix(fused, (*POSE[2:], *VELOCITY)), forces(residual, "tau_bar")])
    true = true_values(truth, (*POSE[2:], *VELOCITY, *TAU_BAR), at)
    true[:, 3] += 2.0 * np.pi * np.rint((estimate[:, 3] - true[:, 3]) / (2.0 * np.pi))
    return true, estimate


def _add_models(errors: Sums, place: tuple[str, str], predictions: pa.Table, true: Array) -> None:
    names = predictions.column("model")
    for model in pc.unique(names).to_pylist():
        force = matrix(predictions.filter(pc.equal(names, model)), force_columns("tau"))
        for index, axis in enumerate(AXES):
            errors.add(
                place,
                f"model {model}",
                (axis,),
                AXIS_UNITS[axis],
                force[:, [index]],
                true[:, [index]],
            )
        errors.add(
            place, f"model {model}", ("all",), "N, N m", force.reshape(-1, 1), true.reshape(-1, 1)
        )


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="check_truth",
    summary="Hold what the chain found on a twin against the truth that the twin flew",
    maps_over="campaign",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
)
