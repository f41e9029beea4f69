"""Several runs on one page: what differs, what is set side by side, what is refused."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import DataError
from auvid.pipeline import cli
from auvid.pipeline.commands.history import runs_page as pages
from auvid.pipeline.commands.history.run_history import Entry
from auvid.pipeline.commands.history.runs_page import RunColumn, runs_page

COEFFICIENT = {
    "unit": "N s/m",
    "value": -50.0,
    "standard_error": 1.0,
    "with_assumed": 5.0,
    "verdict": "identified",
}
WEAK = {**COEFFICIENT, "value": 3.0, "verdict": "weak"}
AXES = dict.fromkeys("XYZKMN", 0.4)
ROW = {"n_bar": 18, "rank": 18, "J": 2.0, "J0": 4.0, "ratio": 0.5, **AXES}
FIRST = Entry(
    number=1,
    finished_utc="2026-01-02 03:04:05",
    parameters={"fuse": {"cutoff_hz": 2.0, "method": "kinematic"}},
    code={"fuse": "aa"},
    data={"dive logs/dive.BIN": "bb", "vehicle": "cc"},
    packages={"numpy": "2.0"},
    error_tables={"validation": {"symmetric": ROW}},
    figures={},
    recommended={
        "model": "symmetric",
        "title": "Symmetric",
        "vehicle": "rov",
        "coefficients": {"X u": COEFFICIENT, "Y v": WEAK},
        "free_run": dict.fromkeys("XYZKMN", 0.8),
        "free_run_horizon_s": 10.0,
        "free_runs": 7,
        "free_runs_lost": 0,
    },
)
SECOND = replace(
    FIRST,
    number=2,
    parameters={"fuse": {"cutoff_hz": 1.0, "method": "kinematic"}},
    error_tables={"validation": {"symmetric": {**ROW, "ratio": 0.31}}},
)


def words_of(*columns: RunColumn) -> str:
    page = runs_page("Runs", "", columns).decode()
    page = re.sub(r"<(style|script).*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))


def test_page_sets_what_differs_and_what_was_found_side_by_side() -> None:
    words = words_of(RunColumn("one", FIRST), RunColumn("two", SECOND))
    assert "fuse.cutoff_hz 2.0 1.0" in words
    assert "fuse.method" not in words
    assert "symmetric 0.500 0.310" in words
    assert "0.31 in two" in words
    assert "2 runs side by side: the one figure that they share agrees within noise" in words
    assert "−50.0 ± 9.8" in words
    assert "weak" in words
    assert "0 of 7" in words
    assert "cannot be compared" not in words


def test_coefficients_that_differ_by_more_than_noise_are_counted() -> None:
    """Both runs rest on the same vehicle file, so its figures move both alike."""
    far = {**COEFFICIENT, "value": -53.0}
    moved = {**FIRST.recommended, "coefficients": {"X u": far, "Z w": COEFFICIENT}}
    first = {**FIRST.recommended, "coefficients": {"X u": COEFFICIENT, "Z w": COEFFICIENT}}
    columns = [
        RunColumn(name, replace(FIRST, recommended=part))
        for name, part in (("one", first), ("two", moved))
    ]
    assert "1 of 2 figures differ by more than noise" in words_of(*columns)
    assert "0.50 in all of them" in words_of(*columns)


def test_a_coefficient_has_whiskers_per_run_thick_by_noise() -> None:
    page = runs_page("Runs", "", [RunColumn("one", FIRST), RunColumn("two", SECOND)]).decode()
    assert page.count('class="whisker thick"') == 2
    assert page.count('class="dot"') == 2
    assert "X_u in N s/m; one: −50 ± 9.8; two: −50 ± 9.8" in page.replace("−9.8", "-9.8")


def test_boxes_of_figures_begin_with_the_quantity_and_coefficients_keep_their_name() -> None:
    figure = {"value": 1.0, "unit": "kg", "standard_error": 0.1, "verdict": "identified"}
    entry = replace(FIRST, figures={"heave of leg dive: Z_w|w|": figure})
    labels = [box.label for box in pages._boxes([RunColumn("one", entry)])]
    assert labels == ["X_u", "Z_w|w|, heave of leg dive"]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"data": {**FIRST.data, "dive logs/dive.BIN": "dd"}}, "other logs"),
        ({"data": {**FIRST.data, "vehicle": "dd"}}, "other figures in its vehicle file"),
        ({"recommended": {**FIRST.recommended, "vehicle": "auv"}}, "another vehicle, auv"),
        ({"recommended": {}}, "no recommended model in its entry"),
        (
            {"error_tables": {}, "recommended": {}, "figures": {"a": {"value": 1.0, "unit": "1"}}},
            "errors of forces cannot be compared with one: it has none",
        ),
    ],
)
def test_a_run_that_cannot_be_compared_says_why(change: dict[str, object], reason: str) -> None:
    other = replace(SECOND, **change)  # type: ignore[arg-type]
    assert reason in words_of(RunColumn("one", FIRST), RunColumn("two", other))


def test_a_campaign_that_was_not_run_is_named() -> None:
    columns = RunColumn("one", FIRST), RunColumn("three", None), RunColumn("two", SECOND)
    assert "three – – – no results: auvid run three" in words_of(*columns)


class Stub:
    """A run of which only its name and folder matter."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.campaign = type("Campaign", (), {"name": folder.name})


def test_history_and_several_campaigns_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pages, "open_run", lambda name: Stub(tmp_path / name))
    monkeypatch.setattr(pages, "read", lambda folder: [FIRST, SECOND])
    monkeypatch.setattr(pages, "entry_of", lambda run, number: (FIRST, SECOND)[number - 1])
    monkeypatch.setattr(pages, "entry_now", lambda run: SECOND)
    runner = CliRunner()
    result = runner.invoke(cli.app, ["report", "dive", "--history"])
    assert result.exit_code == 0, result.output
    assert "run 2" in (tmp_path / "dive" / "history.html").read_text()
    result = runner.invoke(cli.app, ["report", "dive", "dive@1"])
    assert result.exit_code == 0, result.output
    assert "dive@1" in (tmp_path / "dive+dive@1.html").read_text()
    monkeypatch.setattr(pages, "read", lambda folder: [FIRST])
    with pytest.raises(DataError, match="fewer than two"):
        pages.write_runs_page(["dive"], whole_history=True)
    monkeypatch.setattr(pages, "_now", lambda run: None)
    with pytest.raises(DataError, match="no finished run of dive"):
        pages.write_runs_page(["dive"])
    with pytest.raises(DataError, match="no number"):
        pages.write_runs_page(["dive", "dive@linear"])


def test_entries_without_a_recommended_model_are_read() -> None:
    old = json.loads(json.dumps({k: v for k, v in vars(FIRST).items() if k != "recommended"}))
    assert Entry(**old).recommended == {}
