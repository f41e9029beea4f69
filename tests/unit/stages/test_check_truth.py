"""Stage trust: errors of known size come out as such, bounds are held in words, and a
truth that is missing is named.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, make_table
from auvid.hydro.arrays import Array
from auvid.stages import check_truth
from auvid.stages.base import Collection, collection
from auvid.stages.columns import (
    ACCELERATION,
    POSE,
    POSE_RATE,
    VELOCITY,
    force_columns,
    named,
)
from tests.support.motions import fusion_document, shipped_vehicle

VEHICLE = shipped_vehicle("vt690")
START_S = 2.0
T = np.arange(0.0, 4.0, 0.02)
OFFSET = {"u_m_s": 0.03, "psi_rad": 0.01, "tau_bar_Y_N": 2.0}
"""What the estimate has too much."""


def motion(t_s: Array, names: tuple[str, ...]) -> Array:
    """Straight lines, so that interpolation is exact; the force of every axis has slope
    and value of its own.
    """
    return np.column_stack([0.1 * (index + 1) * (1.0 + t_s) for index, _ in enumerate(names)])


def truth() -> Any:
    t_s = np.arange(0.0, 8.0, 0.05)
    zero = {
        name: np.zeros_like(t_s) for part in ("viscous", "unsteady") for name in force_columns(part)
    }
    zero |= {
        name: np.zeros_like(t_s)
        for name in (
            "propeller_rev_s",
            "fin_s_rad",
            "fin_p_rad",
            "fin_b_rad",
            "fin_t_rad",
            *ACCELERATION,
        )
    }
    columns = {"time_us": np.rint(t_s * 1e6).astype(np.int64), "t_s": t_s, **zero}
    for names in (POSE, VELOCITY, force_columns("tau_bar")):
        columns |= named(names, motion(t_s, names))
    return make_table("truth", columns)


def shifted(names: tuple[str, ...], turn: float = 0.0) -> dict[str, Array]:
    values = named(names, motion(T + START_S, names))
    return {
        name: value + OFFSET.get(name, 0.0) + (turn if name == "psi_rad" else 0.0)
        for name, value in values.items()
    }


def inputs(
    *,
    turn: float = 0.0,
    truths: dict[str, Any] | None = None,
    accel_bias: list[float] | None = None,
) -> check_truth.Inputs:
    rates = {name: np.zeros_like(T) for name in (*POSE_RATE, *ACCELERATION)}
    fused = make_table("fused", {"t_s": T, **shifted(POSE, turn), **shifted(VELOCITY), **rates})
    residual = make_table(
        "residual", {"t_s": T, **shifted(VELOCITY), **shifted(force_columns("tau_bar"))}
    )
    model = {"segment": ["leg"] * len(T), "model": ["linear"] * len(T), "t_s": T}
    force = motion(T + START_S, force_columns("tau"))
    predictions = make_table("predictions", {**model, **named(force_columns("tau"), 0.9 * force)})
    row = {name: [0.0] for name in ("sse", "mae", "mse", "rms", "mad", "j0")}
    counts = {"n_bar": [36], "rank": [36], "samples": [len(T)], "ratio": [0.1], **row}
    table = make_table(
        "error_table",
        {"use": ["validation"], "leg": ["all"], "model": ["linear"], "axis": ["all"], **counts},
    )
    fusion = fusion_document(gyro_bias_rad_s=[0.002, 0.0, 0.0], accel_bias_m_s2=accel_bias)
    biases = {"gyro_rad_s": [0.001, 0.0, 0.0], "accel_m_s2": [0.1, 0.0, 0.0]}

    def one(item: Any) -> Collection[Any]:
        return collection({"leg": item})

    return check_truth.Inputs(
        vehicle=VEHICLE,
        simulation={"legs": [{"id": "dive", "biases": biases}]},
        truth=collection({"dive": truth()} if truths is None else truths),
        segment=one(
            SegmentRecord.model_construct(
                id="leg", log="dive", use="validation", leg_start_s=START_S
            )
        ),
        fused=one(fused),
        fusion=one(fusion),
        residual=one(residual),
        predictions=one(predictions),
        error_table=table,
        model_card=collection(
            {
                "linear": ModelCard.model_construct(
                    title="Linear", predictor={"X": {"u": -1.0, "v": 0.0}, "Y": {"v": -2.0}}
                )
            }
        ),
    )


def errors(
    outputs: check_truth.Outputs, use: str = "all", segment: str = "all"
) -> dict[tuple[str, str], dict[str, Any]]:
    rows = outputs.truth_errors.to_pylist()
    return {
        (row["quantity"], row["axis"]): row
        for row in rows
        if (row["use"], row["segment"]) == (use, segment)
    }


@pytest.mark.parametrize("turn", [0.0, 2.0 * np.pi, -4.0 * np.pi])
def test_errors_are_those_put_in(turn: float) -> None:
    """Offsets of one velocity, the heading (whole turns aside), one force and one bias;
    all else agrees.
    """
    outputs = check_truth.run(inputs(turn=turn), check_truth.Params())
    by_figure = errors(outputs)
    put_in = {
        ("velocity", "u"): 0.03,
        ("attitude", "psi"): 0.01,
        ("force", "Y"): 2.0,
        ("gyro bias", "x"): 0.001,
    }
    for key, row in by_figure.items():
        if not key[0].startswith("model") and key[1] != "all":
            assert row["rms_error"] == pytest.approx(put_in.get(key, 0.0), abs=1e-9), key
            assert row["mean_error"] == pytest.approx(put_in.get(key, 0.0), abs=1e-9), key
            assert row["largest_error"] == pytest.approx(put_in.get(key, 0.0), abs=1e-9), key
    assert by_figure[("force, all axes", "all")]["rms_error"] == pytest.approx(2.0 / np.sqrt(6.0))
    assert by_figure[("force, all axes", "all")]["mean_error"] is None
    assert ("accelerometer bias", "x") not in by_figure
    assert errors(outputs, "validation", "leg") == {
        key: row | {"use": "validation", "segment": "leg"} for key, row in by_figure.items()
    }


def test_models_are_judged_on_the_true_force() -> None:
    """A prediction of nine tenths of the true force has J/J0 = 0.1 on every axis,
    whatever the residual force says.
    """
    by_figure = errors(check_truth.run(inputs(), check_truth.Params()), "validation")
    for axis in ("X", "Y", "Z", "K", "M", "N", "all"):
        row = by_figure[("model linear", axis)]
        assert row["rms_error"] / row["rms_true"] == pytest.approx(0.1)
    blocks = check_truth.run(inputs(), check_truth.Params()).section["blocks"]
    table = next(block for block in blocks if block.get("title") == "Models against the true force")
    assert table["rows"][0][:2] == ["Linear", "validation"]
    assert table["rows"][0][3:] == pytest.approx([0.1] * 7)


def test_true_motion_is_on_the_clock_of_the_segment() -> None:
    outputs = check_truth.run(inputs(turn=2.0 * np.pi), check_truth.Params()).true_motion["leg"]
    np.testing.assert_allclose(column(outputs, "t_s"), T)
    np.testing.assert_allclose(column(outputs, "u_m_s"), 0.1 * (1.0 + T + START_S), atol=1e-12)
    np.testing.assert_allclose(
        column(outputs, "psi_rad"), 0.6 * (1.0 + T + START_S) + 2.0 * np.pi, atol=1e-12
    )


def test_bounds_met_and_missed() -> None:
    """RMS error of u, v, w is 0.03 / sqrt 3 = 0.0173 m/s, of the gyro bias 0.001 / sqrt
    3 rad/s.
    """
    outputs = check_truth.run(
        inputs(),
        check_truth.Params(
            velocity_error_m_s=0.017, gyro_bias_rad_s=6e-4, force_error=0.9, ratio={"linear": 0.2}
        ),
    )
    met = {row["figure"]: row["met"] for row in outputs.trust_checks.to_pylist()}
    assert met == {
        "RMS error of the residual force, six axes": True,
        "RMS error of u, v, w": False,
        "RMS error of the gyro bias": True,
        "J/J0 of linear, validation": True,
    }
    warned = [
        block["text"]
        for block in outputs.section["blocks"]
        if block["kind"] == "remark" and block["level"] == "warning"
    ]
    assert warned == [
        "Against the truth of the twin: RMS error of u, v, w: 0.0173 m/s, required at most 0.017."
    ]


@pytest.mark.parametrize(
    ("flown", "evidence"),
    [
        (None, "method"),
        ({"X": {"u": -3.0}, "Y": {"v": -1.0}, "N": {}}, "construction"),
        ({"X": {"u": -3.0, "u*|u|": 0.0}}, "construction"),
        ({"X": {"u": -3.0, "u*|u|": -1.0}}, "method"),
        ({"N": {"r": -3.0}}, "method"),
    ],
)
def test_a_model_of_the_form_that_flew_is_no_test(flown: Any, evidence: str) -> None:
    """J/J0 of a model that has every term of the truth is the noise of the sensors."""
    truth_inputs = inputs()
    truth_inputs = replace(
        truth_inputs, simulation={**truth_inputs.simulation, "coefficients": flown}
    )
    outputs = check_truth.run(
        truth_inputs, check_truth.Params(force_error=0.9, ratio={"linear": 0.2})
    )
    kinds = {row["figure"]: row["evidence"] for row in outputs.trust_checks.to_pylist()}
    assert kinds == {
        "RMS error of the residual force, six axes": "method",
        "J/J0 of linear, validation": evidence,
    }


def test_without_bounds_nothing_is_checked() -> None:
    outputs = check_truth.run(inputs(), check_truth.Params())
    assert outputs.trust_checks.num_rows == 0
    assert not [block for block in outputs.section["blocks"] if block["kind"] == "remark"]


@pytest.mark.parametrize(
    ("params", "words"),
    [
        (check_truth.Params(accel_bias_m_s2=0.006), "no accelerometer bias was found"),
        (check_truth.Params(ratio={"linaer": 0.2}), "Did you mean 'linear'?"),
        (check_truth.Params(ratio={"linear": -1.0}), "must be a positive number"),
    ],
)
def test_bounds_on_what_is_not_measured_are_refused(params: check_truth.Params, words: str) -> None:
    with pytest.raises(CampaignError, match=words.replace("?", r"\?")):
        check_truth.run(inputs(), params)


@pytest.mark.parametrize(
    ("truths", "words"),
    [({}, "no truth of log 'dive'"), ({"dive": truth().slice(0, 60)}, "does not cover")],
)
def test_truth_that_is_missing_or_short_is_named(truths: dict[str, Any], words: str) -> None:
    with pytest.raises(DataError, match=words):
        check_truth.run(inputs(truths=truths), check_truth.Params())
