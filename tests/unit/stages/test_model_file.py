"""The stage that writes model files: what a file says of a model, and reads back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import auvid
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.model_file import ModelFile, ValidationEntry
from auvid.data_schemas.records.models import InertiaCard
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.model_file import forces, inertia, vehicle_of
from auvid.pipeline.store.model_files import read_model, write_model
from auvid.stages import model_file
from auvid.stages.base import collection
from auvid.stages.free_run import FIT
from auvid.stages.model_file import contents
from auvid.stages.model_file.contents import RMS
from auvid.stages.validate import Predictor
from tests.support.example_run import ExampleRun, example_run

TERMS = ("u", "v", "w", "u*|v|")
INERTIA = {
    "name": "N_rdot",
    "unit": "kg*m^2",
    "value": 3.1,
    "standard_error": 0.9,
    "in_vehicle_file": 0.6,
    "change": -2.5,
    "beside_lag": -2.4,
    "beside_lag_error": 1.0,
    "lag_s": 0.05,
    "lag_error_s": 0.1,
    "correlation": 0.4,
    "verdict": "weak",
}


@pytest.fixture(scope="module")
def run() -> ExampleRun:
    run = example_run({"train": 4.0, "check": 2.0})
    for name, card in run.cards.items():
        row = {term: -1.0 - i for i, term in enumerate(TERMS)} | {"constant": 0.25}
        run.cards[name] = card.model_copy(
            update={
                "predictor": dict.fromkeys(AXES, row),
                "inertia": [InertiaCard.model_validate(INERTIA)] if name == "linear" else [],
                "axes": {
                    axis: part.model_copy(
                        update={
                            "terms": [
                                *part.terms,
                                part.terms[0].model_copy(
                                    update={"term": "constant", "unit": part.unit}
                                ),
                            ]
                        }
                    )
                    for axis, part in card.axes.items()
                },
            }
        )
    return run


def files_of(run: ExampleRun, choice: str | None = "linear") -> dict[str, ModelFile]:
    return dict(outputs_of(run, choice).model_file)


def outputs_of(
    run: ExampleRun, choice: str | None = "linear", logs: Mapping[str, LogInfo] | None = None
) -> model_file.Outputs:
    run_inputs = run.inputs()
    rows: list[dict[str, Any]] = [
        {"segment": "check", "model": "linear", "as_measured": put_in, "horizon_s": 5.0}
        | {
            "starts": 4,
            "diverged": 4,
            "first_divergence_s": 1.0,
            **dict.fromkeys([*RMS.values(), *FIT]),
        }
        for put_in in ("", "p q")
    ]
    names = list(rows[0])
    inputs = model_file.Inputs(
        campaign=run_inputs.campaign,
        vehicle=run_inputs.vehicle,
        provenance=run_inputs.provenance,
        model_card=collection(run.cards),
        ranking=run.ranking(choice),
        free_run=make_table("free_run", {key: [row[key] for row in rows] for key in names}),
        log_info=None if logs is None else collection(logs),
    )
    return model_file.run(inputs, model_file.Params())


@pytest.mark.parametrize(("second", "warns"), [(-1.0, False), (1.0, True), (None, True)])
def test_logs_whose_motors_turn_differently_are_named(
    run: ExampleRun, second: float | None, warns: bool
) -> None:
    """The last log would win; one that records nothing has those of the vehicle file."""
    log, thrusters = run.logs["dive"], run.vehicle.thrusters
    assert thrusters is not None
    outputs = thrusters.outputs

    def turned(name: str, direction: float | None) -> LogInfo:
        parameters = {f"MOT_{n}_DIRECTION": direction for n in outputs}
        return log.model_copy(update={"log": name, "parameters": parameters})

    logs = {name: turned(name, way) for name, way in (("first", -1.0), ("second", second))}
    section = outputs_of(run, logs=logs).section
    words = [block["text"] for block in section["blocks"] if block["kind"] == "remark"]
    assert len(words) == warns
    if warns:
        assert "Motor directions differ" in words[0]
        assert ("those of first [-1" if second else "those of second [-1, -1, 1") in words[0]


@pytest.fixture(scope="module")
def linear(run: ExampleRun) -> ModelFile:
    return files_of(run)["linear"]


@pytest.mark.parametrize(
    ("shifts", "total"),
    [({}, None), ({"thrust": 4.0}, [-1.0 - 5 * NORMAL_95, -1.0 + 5 * NORMAL_95])],
)
def test_a_total_interval_needs_assumed_figures(
    run: ExampleRun, shifts: dict[str, float], total: list[float] | None
) -> None:
    """Noise of 3 and a shift of 4 are 5 together; noise alone is no total."""
    card = run.cards["linear"]
    update = {"value": -1.0, "standard_error": 3.0, "assumed_shifts": shifts}
    item = card.axes["X"].terms[0].model_copy(update=update)
    entry = contents._coefficient("X", item, card)
    assert entry.interval_95 == pytest.approx([-1.0 - 3 * NORMAL_95, -1.0 + 3 * NORMAL_95])
    assert entry.interval_95_total == (total and pytest.approx(total))
    file = files_of(run)["linear"].model_copy(update={"coefficients": [entry]})
    row = auvid.Model(file).coefficients.iloc[0]
    assert np.isnan(row["low_total"]) == np.isnan(row["high_total"]) == (total is None)


def test_a_file_comes_back_bit_for_bit(run: ExampleRun, tmp_path: Path) -> None:
    for name, file in files_of(run).items():
        first, second = tmp_path / f"{name}.json", tmp_path / "again.json"
        write_model(file, first)
        write_model(read_model(first), second)
        assert second.read_bytes() == first.read_bytes()


def test_no_flipped_bit_of_a_file_is_read_as_another_model(
    linear: ModelFile, tmp_path: Path
) -> None:
    path = tmp_path / "m.json"
    write_model(linear, path)
    content = path.read_bytes()
    for bit in np.random.default_rng(1).choice(8 * len(content), 60, replace=False).tolist():
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            model = read_model(path)
        except PipelineError:
            continue
        assert model == linear  # a character between the fields


def test_a_file_that_was_changed_by_hand_is_read_without_its_hash(
    linear: ModelFile, tmp_path: Path
) -> None:
    path = tmp_path / "m.json"
    write_model(linear, path)
    text = json.loads(path.read_text())
    text["coefficients"][0]["predictor"] += 0.25
    path.write_text(json.dumps(text))
    with pytest.raises(PipelineError, match="delete the line content_sha256"):
        read_model(path)
    del text["content_sha256"]
    path.write_text(json.dumps(text))
    changed = linear.coefficients[0].predictor + 0.25
    assert read_model(path).coefficients[0].predictor == changed


class LaterValidation(ValidationEntry):
    """A part of a later version, with a field more."""

    added: str = ""


class LaterFile(ModelFile):
    """The model file of a later version of the same format, with fields more."""

    validation: LaterValidation | None
    counted: int = 0


def test_a_field_that_a_later_version_adds_spoils_no_earlier_file(linear: ModelFile) -> None:
    written = linear.sealed().model_dump(mode="json")
    later = LaterFile.model_validate(written)
    assert later.validation is not None
    assert later.content_hash() == linear.sealed().content_sha256
    assert later.model_copy(update={"counted": 1}).content_hash() != later.content_sha256


def test_the_file_gives_mass_and_forces_of_the_judged_model(
    run: ExampleRun, linear: ModelFile
) -> None:
    """M and the force of a file are those that validate computed with."""
    judged = Predictor.of(run.cards["linear"])
    vehicle = judged.vehicle(run.vehicle)
    np.testing.assert_array_equal(inertia(linear), vehicle.mass_matrix)
    assert inertia(linear)[5, 5] == pytest.approx(run.vehicle.mass_matrix[5, 5] + 2.5)
    nu = np.random.default_rng(1).normal(size=(20, 6))
    parts = forces(linear, nu, np.zeros((20, 6)))
    np.testing.assert_allclose(parts.viscous, judged.viscous.force(nu) + judged.trim, rtol=1e-14)
    # C(nu) nu takes no energy; level and neutral there is nothing to restore.
    power = np.sum(nu * parts.coriolis, axis=1)
    np.testing.assert_allclose(power, 0.0, atol=1e-12 * np.abs(parts.coriolis).max())
    np.testing.assert_allclose(parts.restoring, 0.0, atol=1e-12)


def test_a_tool_computes_the_same_from_the_text_alone(linear: ModelFile) -> None:
    """Follow the field descriptions in plain Python: one velocity, one pose."""
    text = json.loads(linear.model_dump_json())
    nu, eta = [0.3, -0.2, 0.1, 0.05, -0.04, 0.2], [0.0, 0.0, 3.0, 0.1, -0.2, 0.5]
    value = dict(zip("uvwpqr", nu, strict=True))
    value |= {f"|{name}|": abs(x) for name, x in value.items()}
    tau = dict.fromkeys(AXES, 0.0)
    for item in text["coefficients"]:
        product = item["predictor"]
        for factor in item["factors"]:
            product *= value[factor]
        tau[item["axis"]] += product
    d = text["dynamics"]
    r_g, r_b = d["centre_of_gravity_m"], d["centre_of_buoyancy_m"]
    a, b, c = (g * d["weight_N"] - h * d["buoyancy_N"] for g, h in zip(r_g, r_b, strict=True))
    net, (sf, cf), (st, ct) = (
        d["weight_N"] - d["buoyancy_N"],
        *((np.sin(x), np.cos(x)) for x in eta[3:5]),
    )
    restoring = [-net * st, net * ct * sf, net * ct * cf, b * ct * cf - c * ct * sf,
                 -c * st - a * ct * cf, a * ct * sf + b * st]  # fmt: skip
    momentum = np.array(d["mass"]) @ nu
    v, omega = nu[:3], nu[3:]
    coriolis = [
        *np.cross(omega, momentum[:3]),
        *(np.cross(v, momentum[:3]) + np.cross(omega, momentum[3:])),
    ]
    parts = forces(linear, [nu], [eta])
    np.testing.assert_allclose(parts.viscous[0], list(tau.values()), rtol=1e-12)
    np.testing.assert_allclose(parts.restoring[0], restoring, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(parts.coriolis[0], coriolis, rtol=1e-12, atol=1e-12)


def test_what_the_run_did_not_determine_is_marked(linear: ModelFile) -> None:
    of = {item.symbol: item for item in linear.coefficients}
    assert of["X_u"].determined
    assert of["X_u"].interval_95 == pytest.approx([-3.5 - 1.96 * 0.4, -3.5 + 1.96 * 0.4], rel=1e-4)
    blind = of["X_w"]
    assert (blind.verdict, blind.determined, blind.value) == ("not excited", False, None)
    assert blind.interval_95 is None
    assert blind.predictor == -3.0
    assert of["X_constant"].factors == []


def test_one_file_is_the_one_to_take_and_says_what_for(run: ExampleRun) -> None:
    files = files_of(run)
    assert [name for name, file in files.items() if file.use.recommended] == ["linear"]
    assert files["linear"].use.sentence.startswith("Linear: use it to predict forces")
    assert "take linear instead" in files["coe"].use.sentence
    (free,) = files["linear"].validation.free_runs  # type: ignore[union-attr]
    assert (free.lost, free.rms["u"]) == (4, None)


def test_a_model_for_nothing_says_so(run: ExampleRun) -> None:
    worse = replace(run, errors=[{**row, "ratio": 1.4} for row in run.errors])
    for file in files_of(worse, choice=None).values():
        assert not file.use.recommended
        assert file.use.axes is not None
        assert (file.use.axes.forces, file.use.axes.simulation) == ([], [])
        assert file.use.sentence.endswith("use it for nothing")
    training_only = replace(run, errors=[row for row in run.errors if row["use"] == "training"])
    assert "nothing judges it" in files_of(training_only)["linear"].use.sentence


def test_numbers_of_the_vehicle_are_in_si(run: ExampleRun) -> None:
    document = run.vehicle.document
    mass = document.rigid_body.mass.model_copy(update={"value": 13500.0, "unit": "g"})
    body = document.rigid_body.model_copy(update={"mass": mass})
    grams = replace(run.vehicle, document=document.model_copy(update={"rigid_body": body}))
    file = files_of(replace(run, vehicle=grams))["linear"]
    assert (file.vehicle.rigid_body.mass.value, file.vehicle.rigid_body.mass.unit) == (13.5, "kg")
    assert vehicle_of(file).mass_kg == 13.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 3}, "a model file of another format; found 3; allowed: 1, 2"),
        ({"format": 0}, "run its campaign again"),
        ({"kind": "something"}, "not a model file"),
        ({"coefficients": [{"axis": "X"}]}, "field 'coefficients[0].verdict': missing key"),
        ({"weight": 3.0}, "unknown key"),
        ({"validity": {"u": {"rms": float("nan"), "low": 0.0, "high": 1.0}}}, "not finite"),
    ],
)
def test_another_document_is_refused_in_words(
    linear: ModelFile, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    path = tmp_path / "model.json"
    path.write_text(json.dumps(json.loads(linear.model_dump_json()) | change))
    with pytest.raises(PipelineError) as caught:
        read_model(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "cut off"),
        ('{"format" 1, "kind": "auvid model"}', "not JSON"),
        ("[1]", "not a model file"),
    ],
)
def test_what_is_no_document_is_refused(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "model.json"
    path.write_text(content)
    with pytest.raises(PipelineError, match=message):
        read_model(path)


def test_dynamics_that_someone_edited_are_refused(linear: ModelFile) -> None:
    heavier = linear.dynamics.model_copy(update={"mass_kg": 20.0})
    with pytest.raises(PipelineError, match="do not follow from its vehicle"):
        vehicle_of(linear.model_copy(update={"dynamics": heavier}))


def test_a_verdict_that_is_none_is_named_with_those_that_are(
    linear: ModelFile, tmp_path: Path
) -> None:
    path = tmp_path / "m.json"
    write_model(linear, path)
    text = json.loads(path.read_text())
    text["coefficients"][0]["verdict"] = "identifed"
    path.write_text(json.dumps(text))
    with pytest.raises(PipelineError, match=r"coefficients\[0\]\.verdict.*identifed.*published"):
        read_model(path)
