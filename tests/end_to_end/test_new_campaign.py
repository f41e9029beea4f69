"""Two commands, no file edited: from a log to a report, of a BIN, a tlog and a CSV."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline import cli

ROOT = Path(__file__).parents[2]
CAMPAIGNS = ROOT / "campaigns"
BIN = CAMPAIGNS / "bluerov2_dvl/logs/00000029_first130s.BIN"
TLOG = CAMPAIGNS / "bluerov2_dvl_tlog/logs/dive.tlog"
CSV = ROOT / "tests/data/blueye_sea_trial/sea_trial_start.csv"
SENSORS = [
    CAMPAIGNS / f"bluerov2_dvl_csv/logs/{name}.csv"
    for name in ("imu", "attitude", "depth", "velocity", "actuators", "battery")
]


@pytest.fixture(autouse=True)
def outside_any_workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def auvid(*words: object) -> str:
    done = CliRunner().invoke(cli.app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize(
    ("logs", "kind"),
    [
        pytest.param((CSV,), "axes", id="csv"),
        pytest.param((TLOG,), "identification", id="tlog", marks=pytest.mark.release),
    ],
)
def test_two_commands_lead_to_a_report(logs: tuple[Path, ...], kind: str) -> None:
    assert "auvid run first" in auvid("new", "campaign", "first", "--from", *logs)
    assert read_yaml(Path("first/campaign.yaml").read_text())["kind"] == kind
    auvid("run", "first")
    assert Path("first/runs/first/report/report_html.html").is_file()


@pytest.mark.release
@pytest.mark.parametrize("logs", [(BIN,), SENSORS], ids=["bin", "csv_per_sensor"])
def test_two_commands_more_logs(logs: tuple[Path, ...]) -> None:
    auvid("new", "campaign", "first", "--from", *logs)
    auvid("run", "first")
    assert Path("first/runs/first/report/report_html.html").is_file()


def test_csv_files_of_one_dive_are_one_log_with_a_map_each() -> None:
    auvid("new", "campaign", "first", "--from", *SENSORS)
    (log,) = read_yaml(Path("first/campaign.yaml").read_text())["logs"]
    assert [file["file"] for file in log["files"]] == [f"logs/{path.name}" for path in SENSORS]
    velocity = read_yaml(Path("first/columns/velocity.yaml").read_text())
    assert [item.get("frame") for item in velocity["columns"]] == [None, "flu", "flu"]
    assert read_yaml(Path("first/columns/depth.yaml").read_text())["columns"][0]["sign"] == -1


def test_a_workspace_is_made_by_both_forms() -> None:
    for words in (("new", "one"), ("new", "workspace", "two")):
        auvid(*words)
    assert Path("one/campaigns/example/campaign.yaml").is_file()
    assert Path("two/campaigns/example/campaign.yaml").is_file()


def test_outputs_of_unknown_thrusters_stop_with_what_to_fill_in() -> None:
    auvid("new", "made")
    log = Path("made/campaigns/example/logs/synthetic_run.csv")
    done = CliRunner().invoke(cli.app, ["new", "campaign", "rov", "--from", str(log)])
    assert done.exit_code == 1
    assert "position and axis of each thruster" in done.output
    vehicle = Path("rov/vehicle.yaml").read_text()
    assert "fill in one [x, y, z]" in vehicle
    assert "outputs: [1, 2, 3, 4]" in vehicle
    refused = CliRunner().invoke(cli.app, ["check", "rov"])
    assert refused.exit_code == 1
    # With the vehicle that it is of, the same log runs.
    example = Path("made/vehicles/example_rov.yaml").resolve()
    auvid("new", "campaign", "known", "--from", log, "--vehicle", example)
