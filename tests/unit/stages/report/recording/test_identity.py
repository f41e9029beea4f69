"""Ids and properties of recordings, and what the first tab and the path hold of a run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.stages.report import Params, collect, run
from auvid.stages.report.recording.identity import recording_id, run_properties
from auvid.stages.report.recording.path import free_paths
from auvid.stages.validate.flight import HIGH, LOW, NAMES
from tests.support.example_run import ExampleRun, example_run

RERUN = Path(sys.executable).with_name("rerun")


@pytest.fixture(scope="module")
def example() -> ExampleRun:
    return example_run({"train": 6.0, "check": 3.0})


@pytest.fixture(scope="module")
def printed(example: ExampleRun, tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("recordings") / "run.rrd"
    run(example.inputs(), Params()).recording(str(file))
    command = [str(RERUN), "rrd", "print", str(file)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout


def test_id_is_that_of_title_and_content() -> None:
    first = recording_id("A dive", {"vehicle": "aa"})
    assert first == recording_id("A dive", {"vehicle": "aa"})
    assert first != recording_id("A dive", {"vehicle": "bb"})
    assert first != recording_id("Another dive", {"vehicle": "aa"})
    assert first.startswith("a_dive-")
    assert recording_id("潜水", {}).startswith("campaign-")


def test_properties_are_typed_and_of_the_recommended_model(example: ExampleRun) -> None:
    inputs = example.inputs()
    content = collect(inputs)
    cards = dict(inputs.model_card or {})
    properties = run_properties("A dive", "rov", content.summary, cards)
    assert properties["campaign"] == "A dive"
    assert properties["vehicle"] == "rov"
    name = content.summary.recommended
    if name is None:
        assert "best_model" not in properties
        return
    assert properties["best_model"] == name
    assert isinstance(properties["ratio_training"], float)
    terms = [item for part in cards[name].axes.values() for item in part.terms]
    assert properties["count_identified"] == sum(i.verdict == "identified" for i in terms)


def test_properties_stand_in_the_recording(printed: str) -> None:
    line = next(words for words in printed.splitlines() if "/__properties/auvid" in words)
    assert "campaign" in line
    assert "vehicle" in line
    assert "version" in line


def test_first_tab_has_depth_attitude_and_uses_apart(printed: str) -> None:
    entities = {line.rpartition(") - ")[2].split(" ")[0] for line in printed.splitlines()}
    for plot in ("depth", "tilt", "yaw"):
        for use in ("training", "validation"):
            assert f"/dive/{plot}/{use}" in entities


def test_a_free_run_starts_on_the_measured_path_and_goes_with_its_own_velocity() -> None:
    t_s = np.arange(0.0, 10.05, 0.1)
    pose = np.zeros((t_s.size, 6))
    pose[:, 0] = 3.0 + 0.5 * t_s
    states = np.zeros((t_s.size, 9))
    states[:, 0], states[:, 8] = 1.0, np.pi / 2
    states[50] = np.nan
    columns = {"t_s": t_s}
    for names in (NAMES, LOW, HIGH):
        columns |= {name: states[:, i] for i, name in enumerate(names)}
    first, second = free_paths(make_table("simulated_motion", columns), t_s, pose)
    assert first[0] == pytest.approx([3.0, 0.0, 0.0])
    heading = rotation_body_to_ned(np.array([[0.0, 0.0, np.pi / 2]]))[0] @ [1.0, 0.0, 0.0]
    assert first[-1] - first[0] == pytest.approx(4.9 * heading, abs=1e-9)
    assert second[0] == pytest.approx([3.0 + 0.5 * 5.1, 0.0, 0.0])
