"""`auvid score`: published sets on the dive of a run, as its document prints them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from auvid.pipeline import cli

ROOT = Path(__file__).resolve().parents[5]
PAGE = (ROOT / "docs/howto/published_sets.md").read_text(encoding="utf-8")
DIVE = "bluerov2_dvl"


@pytest.fixture
def dive(committed_run: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """Workspace in which the bundled dive has run."""
    workspace = committed_run(DIVE)
    monkeypatch.chdir(workspace)
    return workspace


def strict_json(text: str) -> list[dict[str, Any]]:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    rows: list[dict[str, Any]] = json.loads(text, parse_constant=refuse)
    return rows


def printed_rows(text: str) -> dict[str, list[float]]:
    """Return the figures of each set by its name; inf where a free run is lost."""
    cell = r"(?:[\d.e-]+|lost)"
    rows = re.findall(rf"^ *(this dive|bluerov2_\w+) +({cell}(?: +{cell})*)$", text, re.MULTILINE)
    return {name: [float(x.replace("lost", "inf")) for x in cells.split()] for name, cells in rows}


def test_document_has_what_the_command_prints(dive: Path) -> None:
    result = CliRunner().invoke(
        cli.app, ["score", DIVE, "--with", "bluerov2_*"], env={"COLUMNS": "200"}
    )
    assert result.exit_code == 0, result.output
    ours, page = printed_rows(result.output), printed_rows(PAGE)
    assert set(ours) == set(page)
    for name, cells in page.items():
        # Two figures are printed: one unit of the last.
        assert ours[name] == pytest.approx(cells, rel=0.11), name
    assert "Nearest: BlueROV2 Heavy, von Benzon et al. 2022." in result.output


def test_readme_has_the_table_of_the_document() -> None:
    readme = printed_rows((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(readme) == 9
    assert readme == printed_rows(PAGE)


def test_a_model_file_scores_as_in_the_tables_of_its_run(
    short_workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The constant is fitted anew, so nearly."""
    monkeypatch.chdir(short_workspace)
    files = short_workspace / "runs/example/model_file/model_file"
    options = [word for file in sorted(files.glob("*.json")) for word in ("--with", str(file))]
    result = CliRunner().invoke(cli.app, ["score", "example", *options, "--json"])
    assert result.exit_code == 0, result.output
    rows = {(row["set"], row["use"]): row for row in strict_json(result.output)["answer"]["sets"]}
    own = rows["this dive", "validation"]
    name = own["title"].partition(",")[0]
    other = rows[name, "validation"]
    assert other["ratio"] == pytest.approx(own["ratio"], rel=0.05)
    assert other["ratio_X"] == pytest.approx(own["ratio_X"], rel=0.05)


def test_sets_of_a_pattern_that_cannot_be_judged_are_named(dive: Path) -> None:
    words = ["score", DIVE, "--with", "vt690_[fg]*"]
    result = CliRunner().invoke(cli.app, words, env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    assert "not judged: vt690_gertler_hagen: 15 terms" in result.output
    assert re.search(r"^ *vt690_fossen ", result.output, re.MULTILINE)


@pytest.mark.parametrize("name", ["model.json", "bluerov2_wu_2018"])
def test_a_model_in_place_of_a_campaign_is_told_where_it_belongs(name: str) -> None:
    result = CliRunner().invoke(cli.app, ["score", name])
    assert f"auvid score CAMPAIGN --with {name}" in str(result.exception)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("vt690_gertler_hagen", "15 terms have the propulsion ratio"),
        ("bluerov2_wi_2018", "Did you mean 'bluerov2_wu_2018'?"),
        ("nothing.yaml", "nothing.yaml"),
        ("nothing.json", "nothing.json"),
    ],
)
def test_what_is_not_there_is_named(dive: Path, name: str, words: str) -> None:
    result = CliRunner().invoke(cli.app, ["score", DIVE, "--with", name])
    assert result.exit_code != 0
    assert words in result.output or words in str(result.exception)
