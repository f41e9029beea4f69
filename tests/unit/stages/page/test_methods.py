"""The methods text: what the run did, with its own numbers and the references it needs."""

from __future__ import annotations

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
    assert "Newey, W. K." in words
    assert "Rauch" not in words, "the velocity did not come from the smoother"


def test_without_models_there_is_no_word_of_them() -> None:
    run = example_run({"train": 6.0, "check": 3.0})
    inputs = run.inputs()
    (block,) = methods_section(
        inputs.provenance, run.vehicle, run.segments, {}, collect(inputs).summary
    )["blocks"]
    assert "models" not in block["text"]
