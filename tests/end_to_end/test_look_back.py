"""A campaign run twice with another parameter: remembered, listed, compared in the
report, and held against a variant.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from auvid.pipeline import cli
from auvid.pipeline.commands.history import run_history as history
from auvid.pipeline.commands.look.inspect import rerun_viewer
from tests.support.campaign_runs import copy_workspace
from tests.support.pictures import assert_pictured


def auvid(*words: str) -> Result:
    return CliRunner().invoke(cli.app, list(words), env={"COLUMNS": "200"})


def test_second_run_is_remembered_and_equals_the_variant_of_the_first(
    short_workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copy_workspace(short_workspace, tmp_path / "work")
    monkeypatch.chdir(folder)
    manifest = folder / "campaigns" / "example" / "campaign.yaml"
    manifest.write_text(manifest.read_text().replace("cutoff_hz: 2.0", "cutoff_hz: 1.0"))
    assert auvid("run", "example").exit_code == 0
    assert auvid("run", "example").exit_code == 0
    rerun_viewer.verify(folder / "runs" / "example" / "report" / "recording.rrd")
    assert [entry.number for entry in history.read(folder / "runs" / "example")] == [1, 2]
    assert "fuse.cutoff_hz: 2.0 -> 1.0" in auvid("history", "example").output
    assert auvid("report", "example", "--compare").exit_code == 0
    page = (folder / "runs" / "example" / "compared.html").read_text(encoding="utf-8")
    assert "Against run 1" in page
    assert "fuse.cutoff_hz: 2.0 -&gt; 1.0" in page
    same = auvid("diff", "example", "example@fuse.cutoff_hz=1.0")
    assert (same.exit_code, "equal within tolerance" in same.output) == (0, True), same.output


@pytest.mark.release
def test_recording_of_an_identification_opens_with_a_picture(short_workspace: Path) -> None:
    assert_pictured(
        short_workspace / "runs" / "example" / "report" / "recording.rrd", "identification"
    )
