"""Completion: scripts of three shells, and names that commands take."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from auvid.export.targets import TARGETS
from auvid.hydro.dynamics.viscous.models import MODELS
from auvid.pipeline import cli, completion
from auvid.stages.registry import STAGES


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace with two campaigns, one of them run twice."""
    for name in (
        "params.yaml",
        "campaigns/dive/campaign.yaml",
        "campaigns/lake/campaign.yaml",
        "runs/dive/fuse/manifest.json",
        "runs/dive/history/000001.json",
        "runs/dive/history/000002.json",
        "runs/dive/model_file/model_file/linear.json",
        "vehicles/mine.yaml",
        "logs/dive.BIN",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def complete(*words: str) -> list[str]:
    """What bash offers for the last of these words."""
    environment = {
        "_AUVID_COMPLETE": "complete_bash",
        "COMP_WORDS": " ".join(("auvid", *words)),
        "COMP_CWORD": str(len(words)),
    }
    output = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(output):
        patch.setattr("sys.argv", ["auvid"])
        for name, value in environment.items():
            patch.setenv(name, value)
        with pytest.raises(SystemExit) as end:
            cli.main()
    assert not end.value.code
    return output.getvalue().split()


@pytest.mark.usefixtures("workspace")
def test_names_of_the_workspace() -> None:
    assert completion.campaigns("") == ["dive", "lake"]
    assert completion.campaigns("l") == ["lake"]
    assert completion.runs("") == ["dive"]
    assert completion.run_models("dive/") == ["dive/linear"]
    assert completion.run_or_model("dive@") == ["dive@1", "dive@2", "dive@linear"]
    assert completion.run_numbers("") == ["1", "2"]
    assert "mine" in completion.vehicles("")
    assert "vt690" in completion.vehicles("")


def test_names_that_a_shell_would_take_apart_are_left_out(workspace: Path) -> None:
    (workspace / "campaigns/d$(touch PWNED)").mkdir()
    (workspace / "campaigns/d$(touch PWNED)/campaign.yaml").touch()
    (workspace / "runs/dive/history/1a.json").touch()
    (workspace / "vehicles/m;y.yaml").touch()
    assert completion.campaigns("d") == ["dive"]
    assert completion.run_numbers("") == ["1", "2"]
    assert completion.run_or_model("dive@") == ["dive@1", "dive@2", "dive@linear"]
    assert completion.vehicles("m") == ["mine"]


@pytest.mark.parametrize("command", ["check", "inspect"])
@pytest.mark.parametrize("start", ["x", "logs/d", "~nouser/x"])
def test_paths_are_left_to_the_shell_which_quotes_them(
    workspace: Path, command: str, start: str
) -> None:
    (workspace / "x$(touch PWNED).BIN").touch()
    assert complete(command, start) == []


def test_names_of_auvid() -> None:
    assert completion.stages("") == sorted(stage.name for stage in STAGES)
    assert completion.models("") == sorted(model.name for model in MODELS)
    assert completion.targets("") == sorted(TARGETS)
    assert completion.shelf("sh") == ["shelf"]
    assert "campaign" in completion.documents("")


@pytest.mark.usefixtures("workspace")
@pytest.mark.parametrize(
    ("words", "names"),
    [
        (("ru",), ["run"]),
        (("run", "d"), ["dive"]),
        (("run", "dive", "--until", "res"), ["resample", "residual"]),
        (("history", "dive", "--run", ""), ["1", "2"]),
        (("export", "dive/l"), ["dive/linear"]),
        (("run", "dive", "--js"), ["--json"]),
    ],
)
def test_the_shell_is_offered_them(words: tuple[str, ...], names: list[str]) -> None:
    assert complete(*words) == names


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts_of_three_shells(shell: str) -> None:
    program = "import sys; sys.argv = ['auvid', '--show-completion', *sys.argv[1:]]; "
    program += "from auvid.pipeline.cli import main; main()"
    environment = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program, shell],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"complete_{shell}" in done.stdout
    if shell == "bash":
        assert "complete -o default" in done.stdout, "bash completes paths where auvid is silent"
