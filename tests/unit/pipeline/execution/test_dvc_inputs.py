"""The small files on which DVC depends: each changes with what its stage reads, alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from auvid.pipeline import cli
from auvid.pipeline.campaigns.workspace import find_workspace
from auvid.pipeline.execution import kept_output
from auvid.pipeline.execution.code_stamp import FILE
from auvid.pipeline.execution.dvc_inputs import inputs_unchanged
from tests.support.toy_stages import MANIFEST, STAGES

MANIFEST_FILE = "campaigns/toy/campaign.yaml"
CHANGES: dict[str, tuple[str, str, set[str]]] = {
    "title": (MANIFEST_FILE, f"title: new\n{MANIFEST}", set()),
    "leg": (MANIFEST_FILE, MANIFEST.replace("id: one", "id: first"), {"cut", "spread"}),
    "another leg": (MANIFEST_FILE, f"{MANIFEST}  - {{id: four, log: a}}\n", {"cut", "spread"}),
    "log": (MANIFEST_FILE, MANIFEST.replace("id: a, file", "reader: x, id: a, file"), {"decode"}),
    "parameter": (MANIFEST_FILE, f"{MANIFEST}stages: {{cut: {{parts: 2}}}}\n", {"cut"}),
    "default of a parameter": ("params.yaml", "spread: {floor: 2.0}\n", {"spread"}),
    "a name for DVC": ("params.yaml", "campaigns: [toy, other]\n", set()),
    "content of a log": ("campaigns/toy/b.log", "BAD", {"decode"}),
    "a file that nobody reads": ("campaigns/toy/notes.md", "mine", set()),
}


def code(folder: Path) -> dict[str, str]:
    """What stands in the files of the toy campaign after `auvid code toy`."""
    done = CliRunner().invoke(cli.app, ["code", "toy"], catch_exceptions=False)
    assert done.exit_code == 0
    lines = {path.stem: path.read_text() for path in (folder / "runs/.code/toy").glob("*.txt")}
    assert set(lines) == {stage.name for stage in STAGES}
    return lines


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_concerns_the_stages_that_read_it(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    monkeypatch.setattr(kept_output, "SETTLED_S", 0.0)
    before = code(toy_workspace)
    assert inputs_unchanged(find_workspace(toy_workspace), "toy")
    file, text, stages = CHANGES[change]
    (toy_workspace / file).write_text(text)
    after = code(toy_workspace)
    assert {name for name in before if before[name] != after[name]} == stages
    (toy_workspace / "vehicles" / "toy.yaml").unlink()
    assert not inputs_unchanged(find_workspace(toy_workspace), "toy")


def test_files_that_could_change_unseen_are_read_again(toy_workspace: Path) -> None:
    code(toy_workspace)
    assert not (toy_workspace / "runs/.code/toy" / FILE).exists()
