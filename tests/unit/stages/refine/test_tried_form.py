"""Output error by itself: taken where its windows agree, else least squares stays."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.tables import make_table
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.simulation.rov.sensors import START_US
from auvid.hydro.dynamics.simulation.simulation import SimulatedVehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.maximum_likelihood.agreement import Agreement
from auvid.hydro.identification.maximum_likelihood.estimate import LikelihoodEstimate
from auvid.hydro.identification.maximum_likelihood.output_error import fit_output_error
from auvid.stages import fuse, refine, resample, residual, synthesise
from auvid.stages.base import Collection, collection
from auvid.stages.refine import fitting, tried_form
from auvid.stages.simulate.flights import fly_leg
from auvid.stages.simulate.plans import plan_from_document
from auvid.stages.simulate.sensing import record
from tests.support.motions import ROOT, log_document, shipped_vehicle

VT690 = shipped_vehicle("vt690")
TRUTH = {
    "X": {"u": -9.5, "w": -4.8, "q": 2.0},
    "Y": {"v": -111.0, "p": -0.4, "r": 41.6},
    "Z": {"u": -0.3, "w": -110.0, "q": -44.6},
    "K": {"v": -0.46, "p": -0.81, "r": 0.33},
    "M": {"u": 0.095, "w": -42.0, "q": -57.0},
    "N": {"v": 40.7, "p": 0.3, "r": -53.6},
}
"""Linear, port and starboard alike: the form `symmetric` has it."""
LEGS = ("depth_2600", "yaw_2600")
SECONDS = 25.0
SHIFT = "assumed_shifts"


@pytest.fixture(scope="module")
def twin() -> refine.Inputs:
    """Two legs of the twin of the VT 690 whose truth is `symmetric`, fitted by two forms."""
    path = ROOT / "campaigns/vt690_twin/plans/default.yaml"
    plan = plan_from_document(read_yaml(path.read_text(encoding="utf-8")), VT690)
    simulated = SimulatedVehicle(VT690, IdentifiedModel("truth", TRUTH))
    tables: dict[str, dict[str, Any]] = {}
    for leg in plan.legs:
        if leg.id not in LEGS:
            continue
        leg = replace(leg, duration_s=SECONDS)
        flown = fly_leg(plan, leg, simulated, seed=1)
        streams = {
            name: make_table(name, values)
            for name, values in record(flown, plan, seed=1, text="").streams.items()
        }
        end_us = START_US + round(flown.log_end_s * 1e6)
        log = log_document(
            log=leg.id, start_us=START_US, end_us=end_us, accelerometer="specific_force"
        )
        entry = {"id": leg.id, "log": leg.id, "start_s": flown.start_s, "end_s": flown.end_s}
        cut = resample.run(
            resample.Inputs(LegEntry(**entry, use="training"), log, VT690, **streams),
            resample.Params(),
        )
        (key,) = cut.segment
        samples = {
            name: getattr(cut, name)[key]
            for name in ("samples_imu", "samples_velocity", "samples_depth")
        }
        motion = fuse.run(
            fuse.Inputs(cut.segment[key], cut.resampled[key], VT690, log, **samples),
            fuse.Params(method="smoother"),
        )
        force = residual.run(
            residual.Inputs(
                cut.segment[key], motion.fused, motion.fusion, cut.resampled[key], VT690, log
            ),
            residual.Params(),
        )
        parts = {
            "segment": cut.segment[key],
            "fused": motion.fused,
            "fusion": motion.fusion,
            "residual": force.residual,
            "controls": force.controls,
            "resampled": cut.resampled[key],
            "samples_attitude": cut.samples_attitude[key],
            "log_info": log,
            **samples,
        }
        for name, part in parts.items():
            tables.setdefault(name, {})[leg.id if name == "log_info" else key] = part
    inputs = {name: collection(parts) for name, parts in tables.items()}
    controls = inputs.pop("controls")
    fitted = synthesise.run(
        synthesise.Inputs(
            inputs["residual"],
            inputs["segment"],
            VT690,
            inputs["fused"],
            inputs["fusion"],
            controls,
        ),
        synthesise.Params(models=("diagonal", "symmetric"), current_m_s=0.0),
    )
    return refine.Inputs(model_card=collection(fitted.model_card), vehicle=VT690, **inputs)


@pytest.fixture(scope="module")
def answer(twin: refine.Inputs) -> tuple[refine.Outputs, LikelihoodEstimate]:
    """What a run answers by itself, and the fit behind it."""
    fits = []

    def kept(*arguments: Any, **options: Any) -> LikelihoodEstimate:
        fits.append(fit_output_error(*arguments, **options))
        return fits[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitting, "fit_output_error", kept)
        outputs = refine.run(twin, refine.Params())
    return outputs, fits[-1]


def notes(outputs: refine.Outputs) -> list[str]:
    assert outputs.section is not None
    return [block["text"] for block in outputs.section["blocks"] if block["kind"] == "remark"]


def identified(card: ModelCard) -> int:
    return sum(item.verdict == "identified" for part in card.axes.values() for item in part.terms)


@pytest.mark.compiles("hydro/identification/maximum_likelihood/window_loop/loop.py")
def test_output_error_answers_by_itself_where_the_form_has_the_truth(
    twin: refine.Inputs, answer: tuple[refine.Outputs, LikelihoodEstimate]
) -> None:
    outputs, _ = answer
    (card,) = outputs.model_card.values()
    assert card.name == "symmetric_output_error"
    assert card.likelihood is not None
    assert card.likelihood.windows_agree
    assert notes(outputs) == []
    start = twin.model_card["symmetric"]
    assert identified(card) > identified(start)
    for axis, part in card.axes.items():
        for item in part.terms:
            assert item.value is not None
            assert item.standard_error is not None
            assert abs(item.value - TRUTH[axis][item.term]) < 4.0 * item.standard_error


def test_a_form_that_lacks_something_stays_with_least_squares(twin: refine.Inputs) -> None:
    only = replace(twin, model_card=collection({"diagonal": twin.model_card["diagonal"]}))
    outputs = refine.run(only, refine.Params())
    assert outputs.model_card == {}
    (note,) = notes(outputs)
    assert "Diagonal keeps the coefficients of least squares" in note
    assert "its free runs miss the samples by" in note
    named = refine.run(twin, refine.Params(models=("diagonal",)))
    assert notes(named) == [note]


def test_where_an_unsteady_force_pushes_no_sample_is_read(twin: refine.Inputs) -> None:
    card = twin.model_card["symmetric"]
    assert tried_form.pushed(card) == ""
    sway = card.axes["Y"]
    terms = [
        item.model_copy(
            update={SHIFT: item.assumed_shifts | {"unsteady": 3.1 * item.standard_error}}
        )
        if item.term == "v" and item.standard_error
        else item
        for item in sway.terms
    ]
    pushed = card.model_copy(
        update={"axes": card.axes | {"Y": sway.model_copy(update={"terms": terms})}}
    )
    unread: Collection[Any] = Collection(dict.fromkeys(twin.resampled, pytest.fail))
    outputs = refine.run(
        replace(twin, model_card=collection({"symmetric": pushed}), resampled=unread),
        refine.Params(),
    )
    assert outputs.model_card == {}
    (note,) = notes(outputs)
    assert "(it leans Y_v by 3.1 standard errors)" in note


def test_what_takes_too_long_or_lacks_a_leg_or_a_sensor_stays(
    twin: refine.Inputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = next(iter(twin.segment))
    single = refine.run(
        replace(twin, segment=collection({key: twin.segment[key]})), refine.Params()
    )
    assert single.model_card == {}
    assert "one training leg does not show" in notes(single)[0]
    deaf = refine.run(replace(twin, samples_velocity=None), refine.Params())
    assert deaf.model_card == {}
    assert "lacks a body velocity" in notes(deaf)[0]
    monkeypatch.setattr(tried_form, "MOST_WORK", 1e5)
    long = refine.run(twin, refine.Params())
    assert long.model_card == {}
    assert "would take more than a minute" in notes(long)[0]


@pytest.mark.parametrize(
    ("stream", "words"), [("samples_depth", ""), ("samples_velocity", "has no sample of velocity")]
)
def test_a_sensor_without_a_sample_on_a_leg_is_none(
    twin: refine.Inputs, stream: str, words: str
) -> None:
    empty = collection({key: table.slice(0, 0) for key, table in getattr(twin, stream).items()})
    legs, left_out, _ = refine._legs(replace(twin, **{stream: empty}))
    assert all("depth" not in leg.sensors for leg in legs)
    assert all(leg.span_s()[1] > SECONDS - 1.0 for leg in legs)
    assert all(words in reason for reason in left_out)
    assert len(left_out) == (len(LEGS) if words else 0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"word": "no convergence"}, "the iteration did not converge in"),
        ({"agreement": Agreement(4.2, 60, 0.0)}, "its windows differ by 4.2 times"),
        ({"agreement": Agreement(1.0, 3, 1.0)}, "too little in common"),
    ],
)
def test_a_fit_that_shows_no_agreement_is_no_answer(
    twin: refine.Inputs,
    answer: tuple[refine.Outputs, LikelihoodEstimate],
    monkeypatch: pytest.MonkeyPatch,
    changes: dict[str, Any],
    words: str,
) -> None:
    changed = replace(answer[1], **changes)
    monkeypatch.setattr(fitting, "fit_output_error", lambda *_, **__: changed)
    outputs = refine.run(twin, refine.Params())
    assert outputs.model_card == {}
    assert words in notes(outputs)[0]


def test_windows_with_little_in_common_make_no_form_complete(
    twin: refine.Inputs,
    answer: tuple[refine.Outputs, LikelihoodEstimate],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    few = replace(answer[1], agreement=Agreement(1.0, 3, 1.0))
    monkeypatch.setattr(fitting, "fit_output_error", lambda *_, **__: few)
    params = refine.Params(models=("symmetric",), estimator="output_error")
    (card,) = refine.run(twin, params).model_card.values()
    assert card.likelihood is not None
    assert card.likelihood.windows_agree is None


@pytest.mark.parametrize("fault", [DataError("a limit cannot be met"), np.linalg.LinAlgError()])
def test_what_fails_behind_a_tried_fit_stops_no_run(
    twin: refine.Inputs,
    answer: tuple[refine.Outputs, LikelihoodEstimate],
    monkeypatch: pytest.MonkeyPatch,
    fault: Exception,
) -> None:
    def fail(*_: object) -> None:
        raise fault

    monkeypatch.setattr(fitting, "fit_output_error", lambda *_, **__: answer[1])
    monkeypatch.setattr(refine, "_held_out", fail)
    outputs = refine.run(twin, refine.Params())
    assert outputs.model_card == {}
    assert "keeps the coefficients of least squares" in notes(outputs)[0]


@pytest.mark.parametrize("estimator", ["least_squares", "filter_error", "output_error"])
def test_another_estimator_tries_nothing_by_itself(twin: refine.Inputs, estimator: str) -> None:
    assert refine.run(twin, refine.Params(estimator=estimator)) == refine.Outputs({}, None)
