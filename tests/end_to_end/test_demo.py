"""The real dive through the chain: what it tells of the vehicle, what it cannot tell,
and the same from CSV files.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.hydro.arrays import AXES
from auvid.stages import synthesise
from auvid.stages.base import Collection, collection
from auvid.stages.validate.ranking import RESTS
from tests.support.motions import shipped_vehicle

RESTING = {("K", "p"), ("M", "q")}
"""Coefficients that the vehicle file publishes, and that the dive leaves to the prior."""
CAMPAIGNS = ("bluerov2_dvl", "bluerov2_dvl_csv")


@pytest.fixture(scope="module")
def runs(committed_run: Callable[[str], Path]) -> dict[str, Path]:
    """Results of both campaigns, up to validation."""
    return {name: committed_run(name) / "runs" / name for name in CAMPAIGNS}


def document(runs: dict[str, Path], path: str, campaign: str = CAMPAIGNS[0]) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((runs[campaign] / path).read_text(encoding="utf-8"))
    return content


def table(runs: dict[str, Path], path: str, campaign: str = CAMPAIGNS[0]) -> pa.Table:
    return pq.ParquetFile(runs[campaign] / path).read()


def cards(runs: dict[str, Path], campaign: str = CAMPAIGNS[0]) -> dict[str, dict[str, Any]]:
    folder = runs[campaign] / "synthesise/model_card"
    return {
        path.stem: json.loads(path.read_text(encoding="utf-8"))
        for path in sorted(folder.glob("*.json"))
    }


def coefficient(card: dict[str, Any], axis: str, term: str) -> dict[str, Any]:
    row: dict[str, Any] = next(item for item in card["axes"][axis]["terms"] if item["term"] == term)
    return row


def symmetric_card(runs: dict[str, Path], parts: dict[str, slice]) -> ModelCard:
    """The symmetric model of parts of the legs, all of them training."""
    run = runs[CAMPAIGNS[0]]

    def tables(name: str) -> Collection[pa.Table]:
        return collection(
            {
                leg: pq.ParquetFile(run / name.format(leg=leg)).read()[rows]
                for leg, rows in parts.items()
            }
        )

    segments, fusions = (
        {leg: (run / name.format(leg=leg)).read_text(encoding="utf-8") for leg in parts}
        for name in ("resample/{leg}/segment.json", "fuse/{leg}/fusion.json")
    )
    trained = {
        leg: SegmentRecord.model_validate_json(text).model_copy(update={"use": "training"})
        for leg, text in segments.items()
    }
    inputs = synthesise.Inputs(
        tables("residual/{leg}/residual.parquet"),
        collection(trained),
        shipped_vehicle("bluerov2_heavy"),
        tables("fuse/{leg}/fused.parquet"),
        collection({leg: FusionRecord.model_validate_json(text) for leg, text in fusions.items()}),
        tables("residual/{leg}/controls.parquet"),
    )
    params = synthesise.Params(
        models=("symmetric",), trim=True, prior="vehicle", inertia=("N_rdot",)
    )
    return synthesise.run(inputs, params).model_card["symmetric"]


def verdict_of(card: ModelCard, axis: str, term: str) -> str:
    return next(item.verdict for item in card.axes[axis].terms if item.term == term)


def remarks(runs: dict[str, Path], path: str, level: str) -> list[str]:
    return [
        block["text"]
        for block in document(runs, path)["blocks"]
        if block["kind"] == "remark" and block["level"] == level
    ]


def test_surge_damping_is_negative_and_of_the_order_of_tens(runs: dict[str, Path]) -> None:
    surge = coefficient(cards(runs)["linear"], "X", "u")
    assert surge["verdict"] == "identified"
    assert -100.0 < surge["value"] < -20.0  # N s/m, at the scale of the assumed thrust curve
    assert surge["standard_error"] < 5.0


def test_linear_model_holds_in_surge_on_validation(runs: dict[str, Path]) -> None:
    validation = document(runs, "validate/error_metrics.json")["validation"]
    assert validation["linear"]["X"] < 0.6
    assert validation["linear"]["ratio"] < 0.7


def test_roll_and_pitch_are_not_excited(runs: dict[str, Path]) -> None:
    by_model = cards(runs)
    assert len(by_model) == 11
    for card in by_model.values():
        assert card["axes"]["K"]["excitation"] == card["axes"]["M"]["excitation"] == "not excited"
        for axis, part in card["axes"].items():
            for item in part["terms"]:
                if (axis, item["term"]) in RESTING and card.get("method") == "within limits":
                    assert item["verdict"] == "from the prior"
                elif item["verdict"] == "at its bound":
                    assert item["value"] == 0.0, "physics holds it, not the data"
                elif {"p", "q"} & set(item["term"].replace("|", "").split("*")):
                    assert item["verdict"] == "not excited"
                    assert item["value"] is None
                    assert item["standard_error"] is None


def test_own_damping_is_identified_once_the_dive_moves_and_stays(runs: dict[str, Path]) -> None:
    """The first 45 s hover. With the turns of 90 to 130 s damping changes by less than 20 %.

    One turn of the 90 s of the demo carries the damping of yaw, and sway drifts by 2 cm/s, which
    drag that grows with the way ahead explains as well, as it does a third of that of heave: they
    are weak. In the turns the force error of heave, 1.9 N, is as large as its drag and moves it.
    """
    hover = symmetric_card(runs, {"train": slice(0, 45 * 50)})
    longer = symmetric_card(runs, {"train": slice(None), "check": slice(None)})
    demo = cards(runs)["symmetric"]
    for axis, term in (("X", "u"), ("Y", "v")):
        assert verdict_of(hover, axis, term) in ("not excited", "weak")
    for axis, term in (("X", "u"), ("Y", "v"), ("Z", "w"), ("N", "r")):
        verdict = coefficient(demo, axis, term)["verdict"]
        assert verdict == ("identified" if axis == "X" else "weak")
        assert verdict_of(longer, axis, term) == ("weak" if axis in "YZ" else "identified")
        value = coefficient(demo, axis, term)["value"]
        assert value == pytest.approx(longer.predictor[axis][term], rel=0.2)


def test_no_number_rests_on_motion_that_was_not_there(runs: dict[str, Path]) -> None:
    """In the training leg u, v, w and r move by more than their errors, and only u by
    enough for products, ahead: no other coefficient than those of these, and the
    constant, has a number that rests on the data.
    """
    for card in cards(runs).values():
        for part in card["axes"].values():
            terms = {
                item["term"]
                for item in part["terms"]
                if item["value"] is not None and item["verdict"] not in RESTS
            }
            assert terms <= {"u", "v", "w", "r", "|u|", "u*u", "u*|u|", "constant"}
    surge = cards(runs)["uncoupled"]["axes"]["X"]
    assert [item["weights"].keys() for item in surge["combinations"]] == [
        {"u", "|u|"},
        {"u*u", "u*|u|"},
    ]
    assert coefficient(cards(runs)["fossen"], "X", "u*|u|")["verdict"] == "inseparable"


def test_the_symmetric_model_predicts_forces_and_holds_in_every_free_run(
    runs: dict[str, Path],
) -> None:
    metrics = document(runs, "validate/error_metrics.json")
    assert metrics["training"]["symmetric"]["ratio"] < 0.15
    assert metrics["validation"]["symmetric"]["ratio"] < 0.48
    rows = {
        (row["model"], row["horizon_s"]): row
        for row in table(runs, "validate/free_run.parquet").to_pylist()
        if not row["as_measured"]
    }
    for horizon_s in (5.0, 10.0, 30.0):
        assert rows["symmetric", horizon_s]["starts"] >= 2
        assert rows["symmetric", horizon_s]["diverged"] == 0
    at_10_s, kept = rows["symmetric", 10.0], rows["persistence", 10.0]
    limits = {"u_rms_m_s": 0.04, "v_rms_m_s": 0.03, "w_rms_m_s": 0.03, "r_rms_rad_s": 0.12}
    for name, most in limits.items():
        assert at_10_s[name] < most
        assert at_10_s[name] < kept[name]


def test_yaw_inertia_is_several_times_the_assumed_one(runs: dict[str, Path]) -> None:
    (yaw,) = cards(runs)["symmetric"]["inertia"]
    assert yaw["name"] == "N_rdot"
    assert yaw["in_vehicle_file"] == pytest.approx(0.5915)
    assert 2.5 < yaw["value"] < 3.6
    assert abs(yaw["correlation"]) < 0.9, "the thrust lag is another parameter"


def test_net_buoyancy_is_a_few_newtons_up(runs: dict[str, Path]) -> None:
    trim = coefficient(cards(runs)["linear"], "Z", "constant")
    assert trim["verdict"] == "identified"
    assert -8.0 < trim["value"] < -2.0  # N, z is down


def test_a_model_that_fails_is_shown_to_fail(runs: dict[str, Path]) -> None:
    metrics = document(runs, "validate/error_metrics.json")
    warnings = remarks(runs, "validate/section.json", "warning")
    (failing,) = (words for words in warnings if "fail in some axes on validation" in words)
    for model, title in (
        ("mcfarland", "McFarland & Whitcomb"),
        ("gertler_hagen", "Gertler & Hagen"),
        ("coe", "Coe"),
    ):
        assert metrics["training"][model]["ratio"] < 0.2
        assert metrics["validation"][model]["ratio"] > 3.0 * metrics["training"][model]["ratio"]
        assert metrics["validation"][model]["ratio"] > 1.0
        assert f"{title} (X " in failing
    assert "Diagonal (K)" in failing, "roll answers to sway, which Diagonal leaves out"
    assert "Linear (" not in failing
    assert "Symmetric (" not in failing
    assert any(
        "leave the range of the training legs" in words and "yaw (" in words for words in warnings
    )


def test_linear_model_is_put_beside_a_constant(runs: dict[str, Path]) -> None:
    """Heave is the net buoyancy: the report says that Linear adds nothing to a constant
    there.
    """
    assert any(
        words.startswith("Linear predicts no better than a constant force alone in Z")
        for words in remarks(runs, "validate/section.json", "note")
    )
    assert (runs[CAMPAIGNS[0]] / "validate/tables_text.txt").read_text(encoding="utf-8").count(
        "constant alone"
    ) == 2


def test_terms_of_the_propeller_do_not_apply(runs: dict[str, Path]) -> None:
    card = cards(runs)["gertler_hagen"]
    assert (card["n_bar"], card["n_bar_declared"], len(card["not_applicable"])) == (73, 88, 15)
    assert "eta_ratio" not in table(runs, "residual/train/residual.parquet").column_names


def test_what_is_assumed_is_said(runs: dict[str, Path]) -> None:
    assumed = cards(runs)["linear"]["assumed"]
    assert any("rigid_body.mass = 13.5 kg" in words for words in assumed)
    notes = [
        block["text"]
        for block in document(runs, "synthesise/section.json")["blocks"]
        if block["kind"] == "text"
    ]
    assert any("By assumed figures: how far each, within its 95 %" in note for note in notes)
    surge = next(
        term for term in cards(runs)["linear"]["axes"]["X"]["terms"] if term["term"] == "u"
    )
    # A thrust 20 % off moves surge damping by 20 %: far more than noise does (4.5 times).
    assert surge["assumed_shifts"]["thrust"] == pytest.approx(0.2 * abs(surge["value"]), rel=0.1)
    assert surge["assumed_shifts"]["thrust"] > 4.0 * surge["standard_error"]


def test_battery_is_used_and_directions_have_a_source(runs: dict[str, Path]) -> None:
    words = [
        block["text"]
        for block in document(runs, "residual/train/section.json")["blocks"]
        if block["kind"] == "remark"
    ]
    assert any("Motor directions" in text for text in words)
    assert not any("battery voltage" in text.lower() for text in words)


def test_thrust_balances_residual_in_slow_motion(runs: dict[str, Path]) -> None:
    """At 0.1 m/s inertia and Coriolis forces are small: tau_bar is nearly minus the
    thrust.
    """
    residual = table(runs, "residual/train/residual.parquet")
    for axis, share in zip(("X_N", "Y_N", "Z_N"), (0.1, 0.3, 0.15), strict=True):
        left = residual[f"tau_bar_{axis}"].to_numpy() + residual[f"thrusters_{axis}"].to_numpy()
        assert np.sqrt(np.mean(left**2)) < share * np.sqrt(
            np.mean(residual[f"thrusters_{axis}"].to_numpy() ** 2)
        )


def test_csv_files_give_the_same_tables(runs: dict[str, Path]) -> None:
    ours, theirs = (table(runs, "validate/error_table.parquet", name) for name in CAMPAIGNS)
    assert ours.column_names == theirs.column_names
    assert ours.num_rows == 2 * 2 * 11 * 7
    for name in ours.column_names:
        one, other = ours[name].to_pylist(), theirs[name].to_pylist()
        if isinstance(one[0], str):
            assert one == other
        else:
            np.testing.assert_allclose(other, one, rtol=1e-6, atol=0.0, err_msg=name)
    for model, card in cards(runs).items():
        other_card = cards(runs, CAMPAIGNS[1])[model]
        for axis in AXES:
            verdicts = [
                [item["verdict"] for item in one_card["axes"][axis]["terms"]]
                for one_card in (card, other_card)
            ]
            assert verdicts[0] == verdicts[1]
