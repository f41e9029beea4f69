"""From a prescribed rich motion of the VT 690 the chain gets the true force back, and
the coefficients of every model in its span.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.documents import check_document
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.models import MODELS, IdentifiedModel, model_named
from auvid.stages import residual, synthesise, validate
from auvid.stages.base import collection
from auvid.stages.columns import forces
from tests.support.motions import (
    driven_by,
    fused_table,
    fusion_document,
    log_document,
    published,
    ratio_of,
    resampled_table,
    rich_motion,
    segment_document,
    shipped_vehicle,
)

RANK = {
    "mcfarland": 216,
    "pitch_yaw": 100,
    "gertler_hagen": 88,
    "linear": 36,
    "coe": 33,
    "prestero": 30,
    "uncoupled": 22,
    "fossen": 12,
}
"""Published complexities; Uncoupled has 24 terms of which ahead motion determines 22."""
SECONDS = {"one": 30.0, "two": 25.0, "check": 12.0}


def residuals(truth: IdentifiedModel) -> dict[str, pa.Table]:
    """The residual stage on three motions whose accelerations this model's force gives."""
    tables = {}
    for seed, (name, seconds) in enumerate(SECONDS.items(), start=1):
        motion = rich_motion(seconds, seed=seed)
        force = truth.force(motion.nu, ratio_of(motion))
        motion = driven_by(motion, force)
        inputs = residual.Inputs(
            segment_document(name),
            fused_table(motion),
            fusion_document(),
            resampled_table(motion),
            shipped_vehicle("vt690"),
            log_document(),
        )
        tables[name] = residual.run(inputs, residual.Params()).residual
        np.testing.assert_allclose(
            forces(tables[name], "tau_bar"), force, rtol=0.0, atol=1e-9
        )  # N, N m; forces up to 300
    return tables


def fit(
    tables: dict[str, pa.Table], *models: str, **params: Any
) -> tuple[synthesise.Outputs, validate.Outputs]:
    segments = {
        name: segment_document(name, "validation" if name == "check" else "training")
        for name in tables
    }
    inputs = synthesise.Inputs(collection(tables), collection(segments), shipped_vehicle("vt690"))
    fitted = synthesise.run(inputs, synthesise.Params(models=models, **params))
    judged = validate.run(
        validate.Inputs(
            collection(dict(fitted.model_card)), collection(tables), collection(segments)
        ),
        validate.Params(),
    )
    return fitted, judged


@pytest.fixture(scope="module")
def of_mcfarland() -> tuple[synthesise.Outputs, validate.Outputs]:
    """All eight models fitted to a truth that only one of them spans."""
    return fit(residuals(published("mcfarland")), *(model.name for model in MODELS))


@pytest.mark.parametrize("name", RANK)
def test_coefficients_in_the_span_come_back(name: str) -> None:
    truth = published(name)
    fitted, judged = fit(residuals(truth), name)
    card = fitted.model_card[name]
    check_document(card, "model_card")
    assert card.rank == RANK[name]
    for axis in AXES:
        largest = max(
            (abs(value) for value in truth.coefficients.get(axis, {}).values()), default=0.0
        )
        if name == "uncoupled" and axis == "X":
            continue
        for term in model_named(name).terms[axis]:
            # relative to the axis's largest coefficient: the smallest are rounding of
            # the published tables, 1e-20
            assert card.predictor[axis][term] == pytest.approx(
                truth.coefficients[axis][term], rel=1e-6, abs=1e-9 * largest
            )
    assert judged.error_metrics["validation"][name]["ratio"] < 1e-9
    assert judged.error_metrics["training"][name]["ratio"] < 1e-9


def test_uncoupled_names_the_pairs_that_ahead_motion_cannot_separate() -> None:
    fitted, _ = fit(residuals(published("uncoupled")), "uncoupled")
    card = fitted.model_card["uncoupled"]
    assert (card.n_bar, card.rank) == (24, 22)
    surge = {item.term: item for item in card.axes["X"].terms}
    assert {term: item.inseparable_from for term, item in surge.items()} == {
        "u": ["|u|"],
        "|u|": ["u"],
        "u*u": ["u*|u|"],
        "u*|u|": ["u*u"],
    }
    assert all(item.value is None and item.standard_error is None for item in surge.values())
    sums = {frozenset(item.weights): item for item in card.axes["X"].combinations}
    assert sums[frozenset({"u", "|u|"})].value == pytest.approx(
        -7.690, rel=1e-6
    )  # Table E.10, X_|u| = Fossen's X_u
    assert sums[frozenset({"u*u", "u*|u|"})].value == pytest.approx(-1.288, rel=1e-6)
    assert all(
        weight == pytest.approx(1.0, rel=1e-9)
        for item in sums.values()
        for weight in item.weights.values()
    )
    tables_shown = [
        block for block in fitted.section["blocks"] if "inseparable terms" in block.get("title", "")
    ]
    assert len(tables_shown[0]["rows"]) == 2
    assert all(len(card.axes[axis].terms) == card.axes[axis].rank for axis in "YZKMN")


def test_ranks_of_all_models_on_one_motion(
    of_mcfarland: tuple[synthesise.Outputs, validate.Outputs],
) -> None:
    fitted, _ = of_mcfarland
    assert {name: card.rank for name, card in fitted.model_card.items()} == RANK
    assert {name: card.n_bar for name, card in fitted.model_card.items()} == RANK | {
        "uncoupled": 24
    }
    assert not any(card.not_applicable for card in fitted.model_card.values())


def test_models_that_do_not_span_the_truth_rank_as_they_should(
    of_mcfarland: tuple[synthesise.Outputs, validate.Outputs],
) -> None:
    ratio = {
        name: metrics["ratio"]
        for name, metrics in of_mcfarland[1].error_metrics["training"].items()
    }
    assert ratio["mcfarland"] < 1e-9
    assert 0.01 < ratio["gertler_hagen"] < ratio["fossen"] < 1.0
    assert ratio["uncoupled"] <= ratio["fossen"]  # it contains Fossen's terms


def test_trim_is_found_beside_the_model() -> None:
    tables = residuals(published("prestero"))
    trim = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
    for name, table in tables.items():
        for index, column in enumerate(
            column for column in table.column_names if column.startswith("tau_bar")
        ):
            place = table.column_names.index(column)
            table = table.set_column(
                place, table.schema.field(column), pa.array(table[column].to_numpy() + trim[index])
            )
        tables[name] = table
    fitted, judged = fit(tables, "prestero", trim=True)
    card = fitted.model_card["prestero"]
    assert [card.predictor[axis]["constant"] for axis in AXES] == pytest.approx(trim, rel=1e-6)
    assert (card.rank, card.n_bar, card.trim) == (30, 30, True)
    assert judged.error_metrics["validation"]["prestero"]["ratio"] < 1e-9
