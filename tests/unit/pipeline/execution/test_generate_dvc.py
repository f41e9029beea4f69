"""Declarations of a workspace: what a user set in params.yaml stays."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline.execution.generate_dvc import main, params_yaml
from auvid.stages.registry import STAGES


def written(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> str:
    monkeypatch.chdir(folder)
    (folder / "params.yaml").write_text(text, encoding="utf-8")
    main(["params.yaml"])
    return (folder / "params.yaml").read_text(encoding="utf-8")


def test_values_of_the_user_stay_and_what_is_missing_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = written(
        tmp_path,
        monkeypatch,
        "campaigns: []\nfuse: {cutoff_hz: 0.7, estimate_dvl_arm: true}\nrlse: {}\n",
    )
    values = read_yaml(text)
    assert values["fuse"]["cutoff_hz"] == 0.7
    default = read_yaml(params_yaml(STAGES, []))
    assert values | {"fuse": default["fuse"]} == default
    assert "estimate_dvl_arm" not in values["fuse"]
    (line,) = [line for line in text.splitlines() if line.startswith("  cutoff_hz: 0.7")]
    assert f"(default {default['fuse']['cutoff_hz']})" in line
    output = capsys.readouterr().out
    assert "fuse.cutoff_hz stays 0.7" in output
    assert "fuse.estimate_dvl_arm is no parameter; left out, was True" in output
    assert written(tmp_path, monkeypatch, text) == text


def test_a_value_that_is_not_valid_leaves_the_file_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "campaigns: []\nfuse: {cutoff_hz: fast}\n"
    with pytest.raises(CampaignError, match="cutoff_hz"):
        written(tmp_path, monkeypatch, text)
    assert (tmp_path / "params.yaml").read_text(encoding="utf-8") == text
