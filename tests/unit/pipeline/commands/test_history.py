"""What is remembered of finished runs: when, what, how many; in the terminal, as JSON,
in the report, and as a side of a diff.
"""

from __future__ import annotations

import csv
import io
import json
import os
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline import cli
from auvid.pipeline.commands.history import history_page
from auvid.pipeline.commands.history import run_history as history
from auvid.pipeline.commands.history.run_history import Entry, best, changes, read
from auvid.pipeline.store.artefacts import to_json

TABLES = {
    "training": {"linear": {"n_bar": 36, "rank": 36, "J": 1.0, "J0": 4.0, "ratio": 0.25}},
    "validation": {
        "linear": {"n_bar": 36, "rank": 36, "J": 2.0, "J0": 4.0, "ratio": 0.5},
        "coe": {"n_bar": 9, "rank": 9, "J": 3.0, "J0": 4.0, "ratio": 0.75},
    },
}
ENTRY = Entry(
    number=1,
    finished_utc="2026-01-02 03:04:05",
    parameters={"fuse": {"cutoff_hz": 2.0, "method": "kinematic"}},
    code={"fuse": "aa"},
    data={"dive logs/dive.BIN": "bb"},
    packages={"numpy": "2.0"},
    error_tables=TABLES,
    figures={
        "pendulum: I_x": {
            "value": 0.2,
            "unit": "kg m^2",
            "standard_error": 0.01,
            "verdict": "identified",
        }
    },
)


class Stub:
    """A run of which only folder and entry matter."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder


def keep(folder: Path, entry: Entry, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "_entry", lambda run, number: replace(entry, number=number))
    history.add_entry(Stub(folder))  # type: ignore[arg-type]


def test_table_has_a_row_per_run_and_a_column_per_parameter_and_figure() -> None:
    later = replace(ENTRY, number=2, parameters={"fuse": {"edge_s": 0.5}}, error_tables={})
    rows = list(csv.DictReader(io.StringIO(history_page.to_csv([ENTRY, later]).decode())))
    assert [row["number"] for row in rows] == ["1", "2"]
    assert [row["parameters.fuse.cutoff_hz"] for row in rows] == ["2.0", ""]
    assert [row["parameters.fuse.edge_s"] for row in rows] == ["", "0.5"]
    assert [row["error_tables.validation.coe.ratio"] for row in rows] == ["0.75", ""]
    assert [row["figures.pendulum: I_x.value"] for row in rows] == ["0.2", "0.2"]


def test_run_is_remembered_once_and_again_when_something_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for entry in (
        ENTRY,
        replace(ENTRY, finished_utc="2026-01-03 00:00:00"),
        replace(ENTRY, code={"fuse": "cc"}),
        ENTRY,
    ):
        keep(tmp_path, entry, monkeypatch)
    assert [(entry.number, entry.code["fuse"]) for entry in read(tmp_path)] == [
        (1, "aa"),
        (2, "cc"),
        (3, "aa"),
    ]
    assert read(tmp_path)[0] == ENTRY


def test_run_without_figures_is_not_remembered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(tmp_path, replace(ENTRY, error_tables={}, figures={}), monkeypatch)
    assert read(tmp_path) == []


def test_a_run_of_single_axes_is_remembered_and_listed_by_its_fits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    part = SimpleNamespace(held_out_percent=63.4)
    nothing = SimpleNamespace(held_out_percent=None)
    card = SimpleNamespace(partial=SimpleNamespace(axes={"N": part, "K": nothing}))
    figures = history._held_out(card)  # type: ignore[arg-type]
    assert [item["value"] for item in figures.values()] == [63.4]
    keep(tmp_path, replace(ENTRY, error_tables={}, figures=figures), monkeypatch)
    history_page._print_list(read(tmp_path))
    assert "held out: yaw 63 %" in capsys.readouterr().out
    keep(tmp_path, replace(ENTRY, error_tables={}, figures={}, recommended={"a": 1}), monkeypatch)
    assert len(read(tmp_path)) == 2


def test_oldest_are_given_up_and_numbers_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history, "KEPT", 3)
    for number in range(5):
        keep(tmp_path, replace(ENTRY, code={"fuse": str(number)}), monkeypatch)
    assert [entry.number for entry in read(tmp_path)] == [3, 4, 5]


def test_damaged_files_are_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep(tmp_path, ENTRY, monkeypatch)
    folder = tmp_path / history.FOLDER
    text = (folder / "000001.json").read_text()
    (folder / "000002.json").write_text(text[:50])
    (folder / "000003.json").write_text("[]")
    (folder / "000004.json").write_text(text.replace('"format": 2', '"format": 99'))
    (folder / "000005.json").write_text(text.replace("2026-01-02", "2026-01-03"))
    os.mkfifo(folder / "000006.json")
    assert [entry.number for entry in read(tmp_path)] == [1]
    assert [path.stem for path in history.damaged(tmp_path)] == [
        f"{number:06d}" for number in (2, 3, 4, 5, 6)
    ]
    (folder / "000002.json").write_text(
        to_json({"format": 1, **asdict(replace(ENTRY, number=2))})  # of an older version
    )
    assert [entry.number for entry in read(tmp_path)] == [1, 2]


def test_code_of_every_stage_is_one_word() -> None:
    old = replace(ENTRY, code={"fuse": "aa", "report": "aa"})
    assert changes(old, replace(ENTRY, code={"fuse": "b", "report": "b"})) == ["code: all stages"]
    assert changes(old, replace(ENTRY, code={"fuse": "aa", "report": "b"})) == ["code: report"]


def test_damaged_entry_keeps_its_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep(tmp_path, ENTRY, monkeypatch)
    (tmp_path / history.FOLDER / "000002.json").write_text("{")
    keep(tmp_path, replace(ENTRY, code={"fuse": "cc"}), monkeypatch)
    assert [entry.number for entry in read(tmp_path)] == [1, 3]


def test_changes_name_parameters_with_both_values_and_what_else_moved() -> None:
    new = replace(
        ENTRY,
        parameters={"fuse": {"cutoff_hz": 1.0, "method": "kinematic"}},
        packages={"numpy": "2.1"},
    )
    assert changes(None, ENTRY) == ["first run"]
    assert changes(ENTRY, new) == ["fuse.cutoff_hz: 2.0 -> 1.0", "packages: numpy"]
    assert changes(ENTRY, ENTRY) == ["nothing that is recorded"]


def test_best_model_is_judged_on_validation() -> None:
    assert best(ENTRY) == ("linear", 0.25, 0.5)
    assert best(replace(ENTRY, error_tables={"training": TABLES["training"]})) == (
        "linear",
        0.25,
        None,
    )
    assert best(replace(ENTRY, error_tables={})) is None
    assert best(replace(ENTRY, recommended={"model": "coe"})) == ("coe", None, 0.75)


def test_section_against_an_earlier_run_has_both_figures_and_the_change() -> None:
    table = json.loads(json.dumps(TABLES))
    table["validation"]["linear"]["ratio"] = 0.4
    section = history_page.comparison(ENTRY, replace(ENTRY, error_tables=table))
    tables = {
        block["title"]: block["rows"] for block in section["blocks"] if block["kind"] == "table"
    }
    assert tables["Validation"][0] == ["linear", 36, 36, 2.0, 2.0, 0.5, 0.4, pytest.approx(-20.0)]
    assert tables["Figures"] == [["pendulum: I_x", 0.2, 0.2, 0.0, "kg m^2"]]


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A new workspace with two remembered runs of its example, which itself has not
    been run.
    """
    folder = tmp_path / "work"
    assert CliRunner().invoke(cli.app, ["new", str(folder)]).exit_code == 0
    monkeypatch.chdir(folder)
    kept = folder / "runs" / "example" / history.FOLDER
    kept.mkdir(parents=True)
    second = replace(
        ENTRY, number=2, parameters={"fuse": {"cutoff_hz": 1.0, "method": "kinematic\x1b[31m"}}
    )
    for entry in (ENTRY, second):
        (kept / f"{entry.number:06d}.json").write_text(to_json({"format": 1, **asdict(entry)}))
    return folder


@pytest.mark.usefixtures("workspace")
def test_command_lists_runs_shows_one_and_prints_json() -> None:
    listed = CliRunner().invoke(cli.app, ["history", "example"], env={"COLUMNS": "160"}).output
    assert "fuse.cutoff_hz: 2.0 -> 1.0" in listed
    assert "linear" in listed
    assert "\x1b" not in listed
    output = CliRunner().invoke(cli.app, ["history", "example", "--run", "1"]).output
    assert "fuse.cutoff_hz: 2.0" in output
    assert "linear,36,36,2,4,0.5" in output
    document = json.loads(CliRunner().invoke(cli.app, ["history", "example", "--json"]).output)
    assert [entry["number"] for entry in document["answer"]["runs"]] == [1, 2]
    refused = CliRunner().invoke(cli.app, ["history", "example", "--run", "7"]).exception
    assert isinstance(refused, PipelineError)
    assert "allowed: 1 to 2" in str(refused)


@pytest.mark.usefixtures("workspace")
def test_two_remembered_runs_are_compared() -> None:
    done = CliRunner().invoke(cli.app, ["diff", "example@1", "example@2"])
    assert done.exit_code == 0, done.output
    assert "equal within tolerance" in done.output


def test_figures_come_back_as_results_and_are_counted() -> None:
    figures = {
        "surge of leg a: X_udot": {
            "of": "surge of leg a",
            "value": -1.0,
            "unit": "kg",
            "verdict": "identified",
            "headline": True,
        },
        "surge of leg a: X_u": {
            "of": "surge of leg a",
            "value": None,
            "unit": "kg/s",
            "verdict": "weak",
            "headline": True,
        },
        "surge of leg a: X_u (linear)": {
            "of": "surge of leg a",
            "value": 3.0,
            "unit": "kg/s",
            "verdict": "weak",
            "headline": False,
        },
    }
    entry = replace(ENTRY, figures=figures)
    assert [row["quantity"] for row in history.results_of(entry)["surge of leg a"]["rows"]] == [
        "X_udot",
        "X_u",
        "X_u (linear)",
    ]
    assert history.judged(entry) == (1, 2)
