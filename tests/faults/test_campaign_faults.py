"""Faults in what a user writes: manifest, parameters, column map, vehicle, logs. Each
message must name file, line, field and remedy.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.campaigns.campaign import load_campaign
from auvid.pipeline.campaigns.stage_settings import load_defaults, stage_params
from auvid.pipeline.campaigns.workspace import Workspace, find_workspace, workspace_of
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.execution.engines import Serial
from auvid.stages import registry
from auvid.stages.base import make_params
from tests.support.toy_stages import KINDS, MANIFEST, STAGES, VEHICLES, open_run, write_campaign

LEG = "  - {id: one, log: a, use: training}"
LOG = "  - {id: a, file: a.log}"

MANIFEST_FAULTS = {
    "KEY_MISSPELT": (
        MANIFEST.replace("legs:", "leggs:"),
        ["unknown key", "'leggs'", "Did you mean 'legs'?"],
    ),
    "KEY_TWICE": (MANIFEST + "vehicle: toy\n", ["row 10", "'vehicle'", "stands twice"]),
    "KEY_TWICE_INSIDE": (
        MANIFEST.replace("{id: a,", "{id: a, id: b,"),
        ["row 4", "'logs[0].id'", "stands twice"],
    ),
    "NOT_YAML": (MANIFEST + "legs: [\n", ["not valid YAML", "row"]),
    "TABULATOR": (MANIFEST.replace("  - {id: a", "\t- {id: a"), ["row 4", "not valid YAML"]),
    "EMPTY_FILE": (" ", ["missing key", "'vehicle'", "'logs'"]),
    "A_LIST": ("- kind: identification\n", ["not a mapping"]),
    "KIND_UNKNOWN": (
        MANIFEST.replace("identification", "identfication"),
        ["row 1", "'kind'", "Did you mean 'identification'?"],
    ),
    "LOG_UNKNOWN": (
        MANIFEST.replace(LEG, LEG.replace("log: a", "log: aa")),
        ["row 7", "'legs[0].log'", "no such log", "'aa'", "allowed: a, b"],
    ),
    "LOG_TWICE": (
        MANIFEST.replace(LOG, LOG + "\n" + LOG),
        ["row 5", "'logs[1].id'", "the same name as logs[0]"],
    ),
    "LEG_TWICE_BUT_FOR_CASE": (
        MANIFEST.replace("id: two", "id: ONE"),
        ["row 8", "the same name as legs[0]"],
    ),
    "LEG_WITH_DOT": (MANIFEST.replace("id: two", "id: one.1"), ["row 8", "not a name", "'one.1'"]),
    "LEG_IS_A_PATH": (MANIFEST.replace("id: two", "id: ../two"), ["not a name"]),
    "LEG_BACKWARDS": (
        MANIFEST.replace(LEG, "  - {id: one, log: a, start_s: 9, end_s: 3, use: training}"),
        ["row 7", "'legs[0].end_s'", "ends before it starts", "found 3", "more than start_s = 9"],
    ),
    "LEG_OF_NO_LENGTH": (
        MANIFEST.replace(LEG, "  - {id: one, log: a, end_s: 0, use: training}"),
        ["ends before it starts"],
    ),
    "LEG_STARTS_BELOW_ZERO": (
        MANIFEST.replace(LEG, "  - {id: one, log: a, start_s: -1, use: training}"),
        ["out of range", "-1"],
    ),
    "USE_UNKNOWN": (
        MANIFEST.replace("use: validation", "use: validate"),
        ["row 9", "Did you mean 'validation'?"],
    ),
    "NO_LEGS": (
        MANIFEST[: MANIFEST.index("legs:")] + "legs: []\n",
        ["'legs'", "the list is empty"],
    ),
    "LOG_WITHOUT_FILE": (
        MANIFEST.replace(", file: a.log", ""),
        ["row 4", "either file or files", "neither"],
    ),
    "LOG_WITH_FILE_AND_FILES": (
        MANIFEST.replace("file: a.log", "file: a.log, files: [{file: b.log}]"),
        ["either file or files", "both"],
    ),
    "PATH_LEAVES_FOLDER": (
        MANIFEST.replace("file: a.log", "file: ../a.log"),
        ["row 4", "'logs[0].file'", "leaves the campaign folder"],
    ),
    "STAGE_UNKNOWN": (
        MANIFEST + "stages: {spraed: {floor: 1}}\n",
        ["row 10", "unknown stage", "Did you mean 'spread'?"],
    ),
    "VEHICLE_UNKNOWN": (
        MANIFEST.replace("vehicle: toy", "vehicle: tow"),
        ["row 2", "no such vehicle", "Did you mean 'toy'?"],
    ),
    "VEHICLE_FILE_MISSING": (
        MANIFEST.replace("vehicle: toy", "vehicle: my/rov.yaml"),
        ["campaign.yaml", "vehicle is not there", "rov.yaml"],
    ),
}

NINE_OF_NINE = ", ".join(
    ["&a0 [l, l, l]", *(f"&a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 9))]
)
MANIFEST_FAULTS |= {
    "ALIASES_THAT_MULTIPLY": (
        MANIFEST + f"title: [{NINE_OF_NINE}]\n",
        ["row 10", "aliases repeat too much"],
    ),
    "ALIAS_OF_ITSELF": (MANIFEST + "stages: &s {spread: *s}\n", ["row 10", "stands in what it"]),
    "NUMBER_OF_400_DIGITS": (
        MANIFEST.replace(LEG, LEG.replace("log: a", f"log: a, end_s: {'9' * 400}")),
        ["row 7", "'legs[0].end_s'", "too long"],
    ),
    "NUL_IN_A_FILE_NAME": (
        MANIFEST.replace("file: a.log", 'file: "a\\0.log"'),
        ["row 4", "'logs[0].file'", "character"],
    ),
    "SURROGATE_IN_A_FILE_NAME": (
        MANIFEST.replace("file: a.log", 'file: "\\ud800.log"'),
        ["row 4", "character"],  # the compiled parser refuses it, the other hands it on
    ),
    "LEG_OF_300_LETTERS": (
        MANIFEST.replace("id: two", f"id: {'t' * 300}"),
        ["row 8", "not a name", "at most 100"],
    ),
    "TITLE_IS_A_LONG_LIST": (
        MANIFEST + f"title: {list(range(5000))}\n",
        ["row 10", "'title'", "wrong type", "..."],
    ),
}


@pytest.mark.parametrize("name", MANIFEST_FAULTS)
def test_manifest_fault(name: str, tmp_path: Path) -> None:
    text, pieces = MANIFEST_FAULTS[name]
    folder = write_campaign(tmp_path / "toy", text)
    with pytest.raises(PipelineError) as caught:
        load_campaign(folder, kinds=KINDS, vehicles=VEHICLES)
    assert str(folder / "campaign.yaml") in str(caught.value)
    assert len(str(caught.value)) < 2000
    assert [piece for piece in pieces if piece not in str(caught.value)] == [], str(caught.value)


def test_all_faults_of_a_manifest_come_together(tmp_path: Path) -> None:
    text = MANIFEST.replace("log: a, use", "log: x, use").replace("id: two", "id: t.o")
    with pytest.raises(
        PipelineError, match=r"(?s)2 faults.*no such log.*row 7|2 faults.*row 8.*not a name"
    ):
        load_campaign(write_campaign(tmp_path / "toy", text), kinds=KINDS, vehicles=VEHICLES)


def test_absolute_path_may_leave_the_folder(tmp_path: Path) -> None:
    (tmp_path / "elsewhere.log").write_bytes(b"abc")
    folder = write_campaign(
        tmp_path / "toy", MANIFEST.replace("file: a.log", f"file: {tmp_path}/elsewhere.log")
    )
    campaign = load_campaign(folder, kinds=KINDS, vehicles=VEHICLES)
    assert campaign.log_files("a")[0].path.read_bytes() == b"abc"


def test_symbolic_link_to_a_log_elsewhere_is_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere.log").write_bytes(b"abc")
    folder = write_campaign(tmp_path / "toy")
    (folder / "a.log").unlink()
    (folder / "a.log").symlink_to(tmp_path / "elsewhere.log")
    assert (
        load_campaign(folder, kinds=KINDS, vehicles=VEHICLES).log_files("a")[0].path.read_bytes()
        == b"abc"
    )


def test_names_and_items_of_nested_parameters_are_those_that_there_are() -> None:
    for stage, values, pieces in (
        ("fuse", {"method": "kinematic", "noise": {"accel": 1.0}}, ["noise.accel", "accel_m_s2"]),
        ("rlse", {"constant_force": ["heaf"]}, ["constant_force[0]", "Did you mean 'heave'?"]),
        ("synthesise", {"models": [["linear"], 5]}, ["models[0]", "models[1]", "text"]),
        ("synthesise", {"structures": {"own": {"X": [3]}}}, ["structures.own.X[0]", "text"]),
    ):
        kind = next(item.params for item in registry.STAGES if item.name == stage)
        with pytest.raises(PipelineError) as caught:
            make_params(kind, values, stage=stage)
        assert [piece for piece in pieces if piece not in str(caught.value)] == []


@pytest.mark.parametrize("what", ["log", "column map", "vehicle"])
def test_pipe_in_place_of_a_file_is_refused_by_name(what: str, tmp_path: Path) -> None:
    folder = write_campaign(
        tmp_path / "toy",
        MANIFEST.replace("vehicle: toy", "vehicle: v.yaml").replace(
            "file: a.log", "file: a.log, columns: c.yaml"
        ),
    )
    (folder / "v.yaml").write_text(VEHICLES["toy"].read_text())
    (folder / "c.yaml").write_text(
        "time: {column: t, unit: s}\n"
        "columns: [{column: z, stream: depth, field: depth_m, unit: m}]\n"
    )
    name = {"log": "a.log", "column map": "c.yaml", "vehicle": "v.yaml"}[what]
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(PipelineError, match=rf"{what}.* is no regular file; found '.*{name}'"):
        _decode(folder, tmp_path / "runs")


def _decode(folder: Path, runs: Path) -> None:
    run = open_run(folder, runs)
    run.execute(run.graph.stages[:1], Serial())


@pytest.mark.parametrize("fault", ["LOG_MISSING", "LOG_IS_A_FOLDER", "LOG_WITHOUT_PERMISSION"])
def test_log_that_cannot_be_read_names_manifest_and_log(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_campaign(tmp_path / "toy")
    log = folder / "a.log"
    words = {
        "LOG_MISSING": "is not there",
        "LOG_IS_A_FOLDER": "is a folder",
        "LOG_WITHOUT_PERMISSION": "cannot be read: no permission",
    }[fault]
    if fault == "LOG_WITHOUT_PERMISSION":
        true = Path.open

        def refuse(path: Path, *arguments: object, **named: object) -> object:
            if path == log:
                raise PermissionError(13, "Permission denied")
            return true(path, *arguments, **named)  # type: ignore[call-overload]

        monkeypatch.setattr(
            Path, "open", refuse
        )  # root reads everything, so that modes alone would not show it
    else:
        log.unlink()
        if fault == "LOG_IS_A_FOLDER":
            log.mkdir()
    run = open_run(folder, tmp_path / "runs")
    with pytest.raises(PipelineError) as caught:
        run.execute(run.graph.stages, Serial())
    for piece in (f"file of log 'a' {words}", str(folder / "campaign.yaml"), "a.log"):
        assert piece in str(caught.value)


def test_column_map_faults_name_the_map(tmp_path: Path) -> None:
    folder = write_campaign(
        tmp_path / "toy", MANIFEST.replace("file: a.log", "file: a.log, columns: a.yaml")
    )
    (folder / "a.yaml").write_text(
        "time: {column: t, unit: s}\ncolumns:\n  - {column: x, straem: depth, field: depth_m, unit:"
        " m}\n"
    )
    campaign = load_campaign(folder, kinds=KINDS, vehicles=VEHICLES)
    with pytest.raises(PipelineError, match=r"a.yaml.*straem.*Did you mean 'stream'\?"):
        campaign.log_files("a")
    (folder / "a.yaml").unlink()
    with pytest.raises(PipelineError, match=r"campaign.yaml: column map of log 'a' is not there"):
        campaign.log_files("a")


def test_vehicle_faults_name_the_vehicle_file(tmp_path: Path) -> None:
    folder = write_campaign(tmp_path / "toy", MANIFEST.replace("vehicle: toy", "vehicle: rov.yaml"))
    (folder / "rov.yaml").write_text("name: rov\ntitel: ROV\n")
    with pytest.raises(PipelineError, match=r"(?s)rov.yaml.*unknown key.*Did you mean 'title'\?"):
        load_campaign(folder, kinds=KINDS, vehicles=VEHICLES)


PARAMS_FAULTS = {
    "SECTION_UNKNOWN": (
        "spraed: {floor: 1}\n",
        ["row 1", "unknown stage", "Did you mean 'spread'?"],
    ),
    "PARAMETER_UNKNOWN": (
        "spread: {flor: 1}\n",
        ["unknown parameter", "stages.spread.flor", "Did you mean 'floor'?"],
    ),
    "WRONG_TYPE": ("spread: {floor: deep}\n", ["stages.spread.floor", "wrong type", "'deep'"]),
    "OUT_OF_RANGE": ("decode: {scale: 11}\n", ["out of range", "11", "0.1 to 10.0 m"]),
    "NOT_A_NUMBER": ("decode: {scale: .nan}\n", ["out of range"]),
    "NESTED_TEXT_FOR_A_NUMBER": (
        "spread: {plan: {x: deep}}\n",
        ["row 1", "stages.spread.plan.x", "wrong type", "'deep'", "a number"],
    ),
    "NESTED_LIST_FOR_A_NUMBER": ("spread: {plan: {x: [1]}}\n", ["stages.spread.plan.x", "[1]"]),
    "NESTED_INFINITY": ("spread: {plan: {x: .inf}}\n", ["stages.spread.plan.x", "inf"]),
    "NESTED_KEY_NO_TEXT": ("spread: {plan: {1: 1}}\n", ["stages.spread.plan", "no text"]),
    "SECTION_IS_A_LIST": ("decode: [1]\n", ["not a mapping of parameters"]),
    "FILE_IS_A_LIST": ("[1]\n", ["one section per stage"]),
}


@pytest.mark.parametrize("name", PARAMS_FAULTS)
def test_params_fault(name: str, tmp_path: Path) -> None:
    text, pieces = PARAMS_FAULTS[name]
    (tmp_path / "params.yaml").write_text(text)
    with pytest.raises(PipelineError) as caught:
        load_defaults(Workspace(tmp_path), STAGES)
    assert [
        piece
        for piece in [str(tmp_path / "params.yaml"), *pieces]
        if piece not in str(caught.value)
    ] == [], str(caught.value)


def test_campaign_sets_what_differs_from_params(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text("campaigns: [toy]\nspread: {floor: 2.0, plan: {x: 1}}\n")
    folder = write_campaign(
        tmp_path / "campaigns" / "toy", MANIFEST + "stages: {spread: {floor: 5}}\n"
    )
    campaign = load_campaign(folder, kinds=KINDS, vehicles=VEHICLES)
    defaults = load_defaults(Workspace(tmp_path), STAGES)
    params = stage_params(STAGES[2], defaults, campaign)
    assert (params.floor, params.plan) == (5.0, {"x": 1})
    assert stage_params(STAGES[0], defaults, campaign).scale == 1.0


def test_campaign_parameter_fault_names_the_line(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text("{}")
    folder = write_campaign(tmp_path / "toy", MANIFEST + "stages:\n  spread:\n    floor: -1\n")
    campaign = load_campaign(folder, kinds=KINDS, vehicles=VEHICLES)
    with pytest.raises(
        PipelineError, match=r"campaign.yaml, row 12, field 'stages.spread.floor': out of range"
    ):
        stage_params(STAGES[2], load_defaults(Workspace(tmp_path), STAGES), campaign)


def test_workspace_is_found_from_below_and_missed_in_words(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text("{}")
    below = tmp_path / "campaigns" / "toy"
    below.mkdir(parents=True)
    assert find_workspace(below).root == tmp_path.resolve()
    (tmp_path / "params.yaml").unlink()
    with pytest.raises(PipelineError, match=r"no params.yaml here or above.*auvid new DIR"):
        find_workspace(below)


def test_campaign_by_name_folder_or_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_campaign(tmp_path / "campaigns" / "toy").resolve()
    workspace = Workspace(tmp_path)
    monkeypatch.chdir(tmp_path)
    spellings = (
        "toy",
        "campaigns/toy",
        "campaigns/toy/",
        "campaigns/toy/campaign.yaml",
        str(folder),
    )
    assert [workspace.campaign_folder(name).resolve() for name in spellings] == [folder] * len(
        spellings
    )
    with pytest.raises(
        PipelineError, match=r"no such campaign; found 'toi'; allowed: toy. Did you mean 'toy'\?"
    ):
        workspace.campaign_folder("toi")


def test_merge_keys_and_anchors_are_plain_yaml(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("base: &b {x: 1}\nmore: {<<: *b, y: 2}\n")
    assert load_yaml(path).value["more"] == {"x": 1, "y": 2}


def test_a_campaign_outside_any_workspace_is_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "alone"
    folder.mkdir()
    (folder / "campaign.yaml").write_text("kind: identification\n")
    monkeypatch.chdir(tmp_path)
    workspace = workspace_of(str(folder))
    assert workspace.root == folder
    assert load_defaults(workspace, STAGES).value == {}
    with pytest.raises(PipelineError, match=r"params\.yaml"):
        workspace_of("alone_but_not_there")
