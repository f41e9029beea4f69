"""A towed body: two commands from a CSV to drag in newtons, and what is refused in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline import cli
from auvid.pipeline.commands.new.campaign_command import new_campaign
from auvid.pipeline.commands.new.new_command import make_workspace
from auvid.pipeline.store.model_files import read_model
from tests.support.towed_body import LINEAR, MASS_KG, QUADRATIC, K, towed_body, write_towed_body


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a workspace and stand in it."""
    make_workspace(tmp_path / "ws")
    monkeypatch.chdir(tmp_path / "ws")
    return tmp_path / "ws"


def figures(workspace: Path, name: str) -> dict[str, Any]:
    """Return the rows of the results by quantity."""
    path = workspace / f"runs/{name}/passive/results.json"
    return {row["quantity"]: row for row in json.loads(path.read_text())["rows"]}


def test_two_commands_lead_from_a_tow_to_newtons(workspace: Path) -> None:
    write_towed_body(workspace / "towed.csv", towed_body(1))
    for words in (["new", "campaign", "towed", "--from", "towed.csv"], ["run", "towed"]):
        result = CliRunner().invoke(cli.app, words)
        assert result.exit_code == 0, result.output
    rows = figures(workspace, "towed")
    truths = {
        "X_u": -LINEAR,
        "X_u|u|": -QUADRATIC,
        "apparent mass in surge": MASS_KG,
        "apparent mass in surge, by tow and coasts": MASS_KG,
    }
    for name, truth in truths.items():
        half = rows[name]["high"] - rows[name]["low"]
        assert rows[name]["low"] - half < truth < rows[name]["high"] + half, name
        assert rows[name]["verdict"] == "identified"
    assert rows["restoring over apparent inertia in roll"]["value"] == pytest.approx(K, rel=0.01)
    assert rows["restoring in roll, by the file"]["verdict"] == "from the prior"
    checked = CliRunner().invoke(cli.app, ["check", "towed"])
    assert "would stop" not in checked.output
    assert "Nothing on board drives it" in checked.output
    assert "No axis can be fitted" not in checked.output
    page = (workspace / "runs/towed/report/report_html.html").read_text()
    assert page.index("Simulated (up) against measured") < page.index("What the motions tell")
    model = read_model(workspace / "runs/towed/model_file/model_file/passive.json")
    assert model.partial is not None
    assert set(model.partial.axes) == {"X", "K"}
    assert model.partial.lacking["N"].verdict == "not observable"
    by_symbol = {item.symbol: item for item in model.coefficients}
    assert by_symbol["X_u|u|"].value == pytest.approx(-QUADRATIC, rel=0.1)
    assert by_symbol["X_u|u|"].verdict == "identified"
    assert by_symbol["K_p"].verdict == "from the prior"  # times the inertia of the file
    (inertia,) = model.fitted_inertia
    assert inertia.value == pytest.approx(MASS_KG, rel=0.1)
    assert model.use.axes is not None
    assert model.use.axes.simulation == ["X", "K"]
    for target in ("python", "json"):
        result = CliRunner().invoke(cli.app, ["export", "towed", "--to", target])
        assert result.exit_code == 0, result.output


def test_force_and_speed_of_a_carriage_give_newtons_in_two_commands(workspace: Path) -> None:
    """Nothing on board measures anything; the header is German."""
    body = towed_body(1)
    columns = {
        "Zeit_s": body["time_s"],
        "carriage_speed_mps": body["u_m_s"],
        "Zugkraft_N": body["tow_force_n"],
    }
    write_towed_body(workspace / "tank.csv", columns)
    written = CliRunner().invoke(cli.app, ["new", "campaign", "tank", "--from", "tank.csv"])
    assert written.output.splitlines() == [
        "wrote campaigns/tank",
        "  passive: 1 leg from 1 log",
        "  vehicle: vehicle.yaml (a body under tow: its masses turn drag over mass into newtons)",
        "  to check: campaign.yaml (4), columns/tank.yaml (1), vehicle.yaml (6)",
        "",
        "    auvid run tank",
        "",
    ]
    assert CliRunner().invoke(cli.app, ["run", "tank"]).exit_code == 0
    rows = figures(workspace, "tank")
    for name, truth in (("X_u", -LINEAR), ("X_u|u|", -QUADRATIC)):
        half = rows[name]["high"] - rows[name]["low"]
        assert rows[name]["low"] - half < truth < rows[name]["high"] + half, name
        assert rows[name]["verdict"] == "identified"
    model = read_model(workspace / "runs/tank/model_file/model_file/passive.json")
    assert model.partial is not None
    assert set(model.partial.axes) == {"X"}


def test_without_a_tow_force_a_file_without_actuators_opens_the_route(workspace: Path) -> None:
    columns = towed_body(2)
    columns.pop("tow_force_n")
    log = write_towed_body(workspace / "free.csv", columns)
    with pytest.raises(PipelineError, match="add --vehicle passive_body"):
        new_campaign("free", [log])
    assert new_campaign("named", [log], vehicle="passive_body").kind == "passive"
    one_axis = {"time_s": columns["time_s"], "surge_speed_m_s": columns["u_m_s"]}
    with pytest.raises(PipelineError, match="add them as columns of zeros"):
        new_campaign("one", [write_towed_body(workspace / "one.csv", one_axis)])
    new_campaign("towed", [write_towed_body(workspace / "towed.csv", towed_body(2))])
    body = workspace / "campaigns/towed/vehicle.yaml"
    assert new_campaign("free", [log], vehicle=str(body)).kind == "passive"
    manifest = workspace / "campaigns/free/campaign.yaml"
    text = manifest.read_text()
    legs = text.rindex("  - {id: ")
    named = [
        f"  - {{id: let_go_{n}, log: dive, start_s: {25 + 33 * n}, end_s: {33 + 33 * n},"
        " role: coast, channel: surge}"
        for n in range(4)
    ]
    manifest.write_text(text[:legs] + "\n".join(named) + "\n")
    assert CliRunner().invoke(cli.app, ["run", "free"]).exit_code == 0
    rows = figures(workspace, "free")
    (name,) = (item for item in rows if item.startswith("drag over apparent mass in surge at"))
    speed = float(name.split()[-2])
    truth = (LINEAR + QUADRATIC * speed) / MASS_KG
    half = rows[name]["high"] - rows[name]["low"]
    assert rows[name]["low"] - half < truth < rows[name]["high"] + half
    assert not any(row["unit"] == "kg" for row in rows.values())
    model = read_model(workspace / "runs/free/model_file/model_file/passive.json")
    assert model.partial is not None
    assert model.partial.unit_of_mass == "X"
    at_speed = sum(
        item.predictor * (1.0 if item.term == "u" else speed)
        for item in model.coefficients
        if item.axis == "X"
    )
    assert at_speed == pytest.approx(-rows[name]["value"], rel=0.02)  # the speed is printed to cm/s


@pytest.mark.parametrize("pulse_us", [1500.0, 0.0])
def test_an_autopilot_under_tow_whose_outputs_rest_is_a_passive_body(
    workspace: Path, pulse_us: float
) -> None:
    """Its force is in kgf, too."""
    columns = towed_body(1)
    columns["tow_force_kgf"] = columns.pop("tow_force_n") / 9.80665
    columns |= {f"pwm_{n}_us": pulse_us + 0.0 * columns["time_s"] for n in range(1, 7)}
    log = write_towed_body(workspace / "resting.csv", columns)
    assert new_campaign("resting", [log]).kind == "passive"
    maps = (workspace / "campaigns/resting").rglob("*.yaml")
    assert any("kgf" in path.read_text() for path in maps)


def test_a_body_that_does_nothing_and_an_unknown_role_are_refused(workspace: Path) -> None:
    columns = {key: 0.0 * item for key, item in towed_body(3).items()}
    columns["time_s"] = towed_body(3)["time_s"]
    with pytest.raises(PipelineError, match="Log a tow of 30 s") as refusal:
        new_campaign("still", [write_towed_body(workspace / "still.csv", columns)])
    assert "\n" not in str(refusal.value)
    new_campaign("towed", [write_towed_body(workspace / "towed.csv", towed_body(2))])
    manifest = workspace / "campaigns/towed/campaign.yaml"
    manifest.write_text(manifest.read_text().replace("use: training", "role: dragged"))
    result = CliRunner().invoke(cli.app, ["run", "towed"])
    assert result.exit_code == 1
    assert "no such role" in str(result.exception)
