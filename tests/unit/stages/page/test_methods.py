"""The methods text: what the run did, with its own numbers and the references it needs."""

from __future__ import annotations

from auvid.data_schemas.records.models import ModelCard
from auvid.stages.page.methods import methods_section
from auvid.stages.report import collect
from tests.support.example_run import example_run


def test_methods_have_the_numbers_of_the_run_and_only_the_references_they_name() -> None:
    run = example_run({"train": 6.0, "check": 3.0})
    inputs = run.inputs()
    (block,) = methods_section(
        inputs.provenance, run.vehicle, run.segments, run.cards, collect(inputs).summary
    )["blocks"]
    words = block["text"]
    assert "6 s in 1 leg for training and 3 s in 1 leg for validation" in words
    assert "one zero-phase low-pass of 1 Hz" in words
    assert "numpy 2.4.6" in words
    assert "MacKinnon, J. G." in words
    assert "Rauch" not in words, "the velocity did not come from the smoother"


def test_every_model_has_its_own_method_and_a_twin_is_simulated() -> None:
    run = example_run({"train": 6.0, "check": 3.0})
    inputs = run.inputs()
    summary = collect(inputs).summary
    linear, fossen = run.cards["linear"], run.cards["fossen"]
    cards = {"linear": linear, "fossen": fossen.model_copy(update={"method": "filter error"})}

    def words(stages: dict[str, object], cards: dict[str, ModelCard]) -> str:
        provenance = {**inputs.provenance, "stages": stages}
        section = methods_section(provenance, run.vehicle, run.segments, cards, summary)
        return str(section["blocks"][0]["text"])

    measured = inputs.provenance["stages"]
    both = words(measured, cards)
    assert f"We fitted 1 model by least squares: {linear.title} (" in both
    assert "We fitted 1 model by the filter error method" in both
    assert "MacKinnon" in both
    assert "simulated" not in both
    of_filter = words({"simulate": {"parameters": {}}, **measured}, {"fossen": cards["fossen"]})
    assert "least squares" not in of_filter
    assert "MacKinnon" not in of_filter
    assert "From 1 simulated log we used" in of_filter


def test_without_models_there_is_no_word_of_them() -> None:
    run = example_run({"train": 6.0, "check": 3.0})
    inputs = run.inputs()
    (block,) = methods_section(
        inputs.provenance, run.vehicle, run.segments, {}, collect(inputs).summary
    )["blocks"]
    assert "models" not in block["text"]
