"""README.md is true: its commands exist, its documents pass their schemas and run, its
figures are those of the golden tables.
"""

from __future__ import annotations

import csv
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from auvid.pipeline import cli
from auvid.pipeline.campaigns.yaml_files import load_yaml

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SHELL = re.findall(r"^ {4}((?:auvid|make|\.) .*?)(?:  +#.*)?$", README, re.MULTILINE) + re.findall(
    r"`((?:auvid|make) [^`]+)`", README
)
YAML = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)


def yaml_block(first: str) -> str:
    return next(block for block in YAML if first in block)


def test_commands_are_found_in_the_text() -> None:
    assert {
        "make demo",
        "make test",
        "make bench",
        "auvid run example",
        "auvid check dive.BIN",
    } <= set(SHELL)


@pytest.mark.parametrize("line", sorted({line for line in SHELL if line.startswith("make ")}))
def test_make_targets_exist(line: str) -> None:
    target = line.split()[1]
    assert re.search(rf"^{re.escape(target)}:", (ROOT / "Makefile").read_text(), re.MULTILINE), (
        target
    )


@pytest.mark.parametrize("line", sorted({line for line in SHELL if line.startswith("auvid ")}))
def test_commands_and_options_exist(line: str) -> None:
    _, command, *words = line.split()
    result = CliRunner().invoke(cli.app, [command, "--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0, line
    for option in (word for word in words if word.startswith("--")):
        assert option in result.output, line


@pytest.mark.parametrize("option", ["--until", "--engine", "--strict"])
def test_options_of_run_in_the_text_exist(option: str) -> None:
    assert option in README
    assert option in CliRunner().invoke(cli.app, ["run", "--help"], env={"COLUMNS": "200"}).output


def test_links_lead_somewhere() -> None:
    local = [
        target for target in re.findall(r"\]\(([^)]+)\)", README) if not target.startswith("http")
    ]
    assert local
    assert [target for target in local if not (ROOT / target).exists()] == []


DOCUMENTS = [
    ("kind: identification", "campaign"),
    ("stream: attitude", "column_map"),
    ("kind: bench", "campaign"),
    ("radius_ceiling", "apparatus"),
]


@pytest.mark.parametrize(("first", "schema"), DOCUMENTS)
def test_documents_pass_their_schemas(first: str, schema: str, tmp_path: Path) -> None:
    path = tmp_path / "document.yaml"
    path.write_text(yaml_block(first), encoding="utf-8")
    load_yaml(path).check(schema)


def test_figures_of_the_demo_are_those_of_the_golden_tables() -> None:
    printed = {
        row[0]: row[1:]
        for row in re.findall(
            r"^ {4}(\w+) +\d+ of (\d+) +(\d+\.\d{3}) +(\d+\.\d{3})$", README, re.MULTILINE
        )
    }
    golden: dict[str, list[float]] = {}
    for use in ("training", "validation"):
        with (ROOT / "tests" / "golden" / "bluerov2_dvl" / f"{use}.csv").open(
            encoding="utf-8"
        ) as file:
            for row in csv.DictReader(file):
                golden.setdefault(row["model"], [float(row["rank"])]).append(float(row["ratio"]))
    assert printed.keys() == golden.keys()
    for name, row in printed.items():
        assert [float(figure) for figure in row] == pytest.approx(golden[name], abs=0.00051), (
            name
        )  # printed to three decimals


def test_own_csv_campaign_runs_as_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The column map of README on a small log with those columns, in a new workspace,
    up to the fused state.
    """
    folder = tmp_path / "workspace"
    assert auvid(monkeypatch, "new", str(folder)) == 0
    campaign = folder / "campaigns" / "mine"
    (campaign / "logs").mkdir(parents=True)
    (campaign / "columns").mkdir()
    (campaign / "columns" / "dive.yaml").write_text(
        yaml_block("stream: attitude"), encoding="utf-8"
    )
    (campaign / "logs" / "dive.csv").write_text(own_log(), encoding="utf-8")
    manifest = (
        "kind: identification\nvehicle: example_rov\nlogs:\n  - {id: dive, file: logs/dive.csv,"
        " columns: columns/dive.yaml}\n"
    )
    manifest += (
        "legs:\n  - {id: train, log: dive, end_s: 20, use: training}\n  - {id: check, log: dive,"
        " start_s: 20, use: validation}\n"
    )
    (campaign / "campaign.yaml").write_text(manifest, encoding="utf-8")
    monkeypatch.chdir(folder)
    assert auvid(monkeypatch, "run", "mine", "--until", "fuse") == 0, capsys.readouterr().err
    assert (folder / "runs" / "mine" / "fuse" / "train" / "fused.parquet").is_file()
    assert auvid(monkeypatch, "run", "mine", "--until", "fuse") == 0
    assert "nothing to do" in capsys.readouterr().out


def own_log() -> str:
    """40 s at 10 Hz in the columns, units and frames of README's column map."""
    t = np.arange(400) / 10.0
    yaw = 20.0 * np.sin(0.3 * t)
    columns = {
        "t": 1000.0 * t,
        "roll": 0.0 * t,
        "pitch": 0.0 * t,
        "heading": yaw,
        "p": 0.0 * t,
        "q": 0.0 * t,
        "r": 6.0 * np.cos(0.3 * t),
        "pressure_depth": 5.0 + 0.1 * np.sin(0.2 * t),
        "forward": 0.5 + 0.2 * np.sin(0.4 * t),
        "left": 0.05 * np.cos(0.4 * t),
        "up": -0.02 * np.cos(0.2 * t),
        "m1": 1600.0 + 50.0 * np.sin(0.4 * t),
        "battery": 16.0 + 0.0 * t,
    }
    rows = [
        ",".join(f"{value:.4f}" for value in row) for row in np.column_stack(list(columns.values()))
    ]
    rows[100] = rows[100].rpartition(",")[0] + ",n/a"
    return "\n".join([",".join(columns), *rows]) + "\n"


def auvid(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Exit code of a command in this process."""
    monkeypatch.setattr(sys, "argv", ["auvid", *words])
    try:
        cli.main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0
