"""`auvid export`: which model it takes, what it prints and what it refuses."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import CampaignError, DataError, PipelineError
from auvid.pipeline import cli
from auvid.pipeline.commands.model import export_command
from auvid.pipeline.commands.model.export_command import model_path
from auvid.pipeline.store.model_files import write_model
from tests.support.model_files import DAMPED, model_file

LOSSY = {**DAMPED, "X": {"u": -6.0, "constant": 1.0}}


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace with a campaign that has two models, the second one recommended."""
    (tmp_path / "params.yaml").write_text("{}\n", encoding="utf-8")
    for name in ("dive", "later"):
        folder = tmp_path / "campaigns" / name
        folder.mkdir(parents=True)
        (folder / "campaign.yaml").write_text("{}\n", encoding="utf-8")
    files = tmp_path / "runs/dive/model_file/model_file"
    files.mkdir(parents=True)
    model = model_file(LOSSY)
    other = model.use.model_copy(update={"recommended": False})
    write_model(model.model_copy(update={"use": other}), files / "fossen.json")
    write_model(model, files / "linear.json")
    monkeypatch.chdir(tmp_path)
    return files


def test_a_model_is_a_path_a_campaign_or_one_of_its_models(workspace: Path) -> None:
    assert model_path("dive") == workspace / "linear.json"
    assert model_path("dive/fossen") == workspace / "fossen.json"
    assert model_path(str(workspace / "fossen.json")) == workspace / "fossen.json"
    assert model_path("campaigns/dive") == workspace / "linear.json"


def test_unknown_models_are_refused_by_name(workspace: Path) -> None:
    with pytest.raises(CampaignError, match="Did you mean 'dive'"):
        model_path("dives")
    with pytest.raises(CampaignError, match="Did you mean 'linear'"):
        model_path("dive/linaer")
    with pytest.raises(CampaignError, match="no such model file"):
        model_path("gone.json")
    with pytest.raises(DataError, match="auvid run later"):
        model_path("later")
    (workspace / "linear.json").unlink()
    with pytest.raises(DataError, match="dive/fossen"):
        model_path("dive")


def test_losses_and_files_are_printed(workspace: Path) -> None:
    words = ["export", "dive", "--to", "gazebo", "--name", "rov", "-o", "sim", "--lossy"]
    output = CliRunner().invoke(cli.app, words, catch_exceptions=False)
    assert output.exit_code == 0
    assert "X_constant" in output.output
    assert "share of the viscous force" in output.output
    assert "sim/rov.sdf" in output.output
    assert Path("sim/README.md").is_file()


def test_results_that_are_not_up_to_date_are_warned_of(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of a run, by what `auvid regress` refuses; a file stands for itself."""

    def stale(run: SimpleNamespace, stages: object) -> None:
        assert (Path(run.name).name, stages) == ("dive", "until model_file")
        raise DataError("the results of stage fuse are not up to date", remedy="auvid run dive")

    def warned(name: str) -> bool:
        words = ["export", name, "--to", "python", "--force", "-o", "sim"]
        output = CliRunner().invoke(cli.app, words, catch_exceptions=False).output
        assert "written:" in output
        return "may be out of date" in output and "fuse" in output

    monkeypatch.setattr(
        export_command, "open_run", lambda name: SimpleNamespace(name=name, graph=None)
    )
    monkeypatch.setattr(export_command, "select", lambda graph, until: f"until {until}")
    monkeypatch.setattr(export_command, "check_fresh", stale)
    assert warned("dive")
    assert warned("dive/fossen")
    assert warned("campaigns/dive")
    assert not warned(str(workspace / "fossen.json"))
    monkeypatch.setattr(export_command, "check_fresh", lambda run, stages: None)
    assert not warned("dive")


def test_a_loss_is_refused_without_lossy_and_writes_nothing(workspace: Path) -> None:
    words = ["export", "dive", "--to", "gazebo", "-o", "sim"]
    with pytest.raises(PipelineError, match="--lossy"):
        CliRunner().invoke(cli.app, words, catch_exceptions=False)
    assert not Path("sim").exists()


def test_help_has_targets_and_examples() -> None:
    output = CliRunner().invoke(cli.app, ["export", "--help"])
    for word in ("gazebo", "draws", "--lossy", "--force", "auvid export"):
        assert word in output.output
