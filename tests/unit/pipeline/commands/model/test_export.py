"""`auvid export`: which model it takes, what it prints and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import CampaignError, DataError, PipelineError, UsageError
from auvid.pipeline import cli
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from auvid.pipeline.commands.model import export_command
from auvid.pipeline.commands.model.named_model import named_model
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
    taken = {"dive": "dive", "campaigns/dive": "campaigns/dive"}
    others = {"dive/fossen": "dive", str(workspace / "fossen.json"): None}
    for name, campaign in (taken | others).items():
        each = named_model(name)
        assert each.campaign == campaign
        assert each.model.use.recommended == (name in taken)


def test_unknown_models_are_refused_by_name(workspace: Path) -> None:
    with pytest.raises(UsageError, match="Did you mean 'dive'"):
        named_model("dives")
    with pytest.raises(UsageError, match="Did you mean 'linear'"):
        named_model("dive/linaer")
    with pytest.raises(CampaignError, match="no such model file"):
        named_model("gone.json")
    with pytest.raises(DataError, match="auvid run later"):
        named_model("later")
    (workspace / "linear.json").unlink()
    with pytest.raises(DataError, match="dive/fossen"):
        named_model("dive")


def test_losses_and_files_are_printed(workspace: Path) -> None:
    words = ["export", "dive", "--to", "gazebo", "--name", "rov", "-o", "sim", "--lossy"]
    output = CliRunner().invoke(cli.app, words, catch_exceptions=False)
    assert output.exit_code == 0
    assert "X_constant" in output.output
    assert "share of the viscous force" in output.output
    assert "written into sim:" in output.output
    assert "rov.sdf" in output.output
    assert Path("sim/README_rov_gazebo.md").is_file()


def test_a_guessed_vehicle_gives_no_name_to_what_is_exported(workspace: Path) -> None:
    model = named_model("dive").model
    name = model.name
    guess = {"guessed": "the log names no glider"}
    model = model.model_copy(update={"vehicle": model.vehicle.model_copy(update=guess)})
    write_model(model, workspace / "linear.json")
    output = CliRunner().invoke(cli.app, ["export", "dive", "--to", "python"])
    assert output.exit_code == 0
    assert "of a guess (" in output.output
    text = Path(f"exported/dive_{name}_python/dive_{name}.py").read_text(encoding="utf-8")
    assert "The vehicle is a guess, the log names no glider: so are its masses" in text
    file = str(workspace / "linear.json")
    assert CliRunner().invoke(cli.app, ["export", file, "--to", "python"]).exit_code == 0
    assert Path(f"exported/vehicle_{name}_python/vehicle_{name}.py").is_file()


def test_results_that_are_not_up_to_date_are_warned_of(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of a run, by what `auvid regress` refuses; a file stands for itself."""

    asked_for: list[tuple[str, str | None]] = []

    def stale(campaign: str, *, until: str | None) -> str:
        asked_for.append((Path(campaign).name, until))
        return "results of dive from stage fuse on are not up to date"

    def warned(name: str) -> bool:
        words = ["export", name, "--to", "python", "--force", "-o", "sim"]
        output = CliRunner().invoke(cli.app, words, catch_exceptions=False).output
        assert "written into" in output
        return "of an earlier run" in output and "from stage fuse on" in output

    monkeypatch.setattr(export_command, "stale_words", stale)
    assert warned("dive")
    assert warned("dive/fossen")
    assert warned("campaigns/dive")
    assert set(asked_for) == {("dive", "model_file")}
    assert not warned(str(workspace / "fossen.json"))
    monkeypatch.setattr(export_command, "stale_words", lambda campaign, until: "")
    assert not warned("dive")


def test_exports_go_into_one_folder_of_the_workspace(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From wherever in it; the current folder is not littered."""
    deep = workspace.parent
    monkeypatch.chdir(deep)
    before = set(deep.iterdir())
    words = ["export", "dive", "--to", "python", "--name", "rov"]
    output = CliRunner().invoke(cli.app, words, catch_exceptions=False).output
    assert set(deep.iterdir()) == before
    root = workspace.parents[3]
    assert {path.name for path in (root / "exported/rov_python").iterdir()} == {
        "rov.py",
        "README_rov_python.md",
    }
    assert "exported/rov_python" in output


def test_a_published_set_is_exported_in_an_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No workspace is needed; what the set has not is said."""
    monkeypatch.chdir(tmp_path)
    words = ["export", "bluerov2_wu_2018", "--to", "gazebo"]
    output = CliRunner().invoke(cli.app, words, catch_exceptions=False)
    assert output.exit_code == 0
    folder = tmp_path / "exported/bluerov2_wu_2018_gazebo"
    lacking = "it has no intervals, no range of validity, no actuators"
    page = (folder / "README_bluerov2_wu_2018_gazebo.md").read_text(encoding="utf-8")
    for text in (output.output, page, (folder / "bluerov2_wu_2018.sdf").read_text("utf-8")):
        assert lacking in " ".join(text.split())
    assert "licence of its numbers: numbers only" in page
    assert "campaign" not in page.partition("## Where it comes from")[2].partition("remarks")[0]
    with pytest.raises(UsageError, match="Did you mean 'bluerov2_wu_2018'"):
        named_model("bluerov2_wu_2008")
    with pytest.raises(UsageError, match=r"Campaigns here: none\. Published sets: bluerov2_"):
        named_model("zzz")


def test_a_vehicle_file_is_a_model_where_it_publishes_damping() -> None:
    file = named_model(str(SHIPPED_VEHICLES / "shelf/lauv.yaml")).model
    assert file.model_dump() == named_model("lauv").model.model_dump()
    with pytest.raises(DataError, match="publishes no damping, so it is no model"):
        named_model(str(SHIPPED_VEHICLES / "remus100.yaml"))


def test_a_campaign_comes_before_a_published_set_of_its_name(workspace: Path) -> None:
    for path in ("campaigns", "runs"):
        (workspace.parents[3] / path / "dive").rename(workspace.parents[3] / path / "lauv")
    assert named_model("lauv").campaign == "lauv"


def test_a_loss_is_refused_without_lossy_and_writes_nothing(workspace: Path) -> None:
    words = ["export", "dive", "--to", "gazebo", "-o", "sim"]
    with pytest.raises(PipelineError, match="--lossy"):
        CliRunner().invoke(cli.app, words, catch_exceptions=False)
    assert not Path("sim").exists()


def test_help_has_targets_and_examples() -> None:
    output = CliRunner().invoke(cli.app, ["export", "--help"])
    for word in ("gazebo", "draws", "--lossy", "--force", "auvid export"):
        assert word in output.output
