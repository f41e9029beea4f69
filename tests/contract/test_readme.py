"""README.md is true: its figures are those of the golden tables, and a campaign of own
CSV files runs as its document says.
"""

from __future__ import annotations

import csv
import re
import sys
from collections import Counter
from pathlib import Path

import pytest

from auvid.pipeline import cli
from tests.support.documents import blocks, commands, documents, own_log

ROOT = Path(__file__).resolve().parents[2]
README = documents()["README.md"]
OWN_CSV = documents()["docs/howto/own_csv.md"]


def test_commands_are_found_in_the_text() -> None:
    assert {"make demo", "make test", "auvid check dive.BIN"} <= {
        command.line for command in commands("README.md")
    }


def golden_rows(name: str) -> list[dict[str, str]]:
    """The rows of a golden table of the demo."""
    path = ROOT / "tests" / "golden" / "bluerov2_dvl" / f"{name}.csv"
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_figures_of_the_demo_are_those_of_the_golden_tables() -> None:
    printed = {
        row[0]: row[1:]
        for row in re.findall(
            r"^ {4}(\w+) +(\d+) of (\d+) +(\d+\.\d{3}) +(\d+\.\d{3})$", README, re.MULTILINE
        )
    }
    # Constant forces and inertias stand in tables of their own.
    identified = Counter(
        row["of"]
        for row in golden_rows("coefficients")
        if (row["stage"], row["verdict"]) == ("synthesise", "identified")
        and not row["quantity"].endswith((" constant", "dot"))
    )
    golden: dict[str, list[float]] = {}
    for use in ("training", "validation"):
        for row in golden_rows(use):
            name = row["model"]
            figures = golden.setdefault(name, [float(identified[name]), float(row["rank"])])
            figures.append(float(row["ratio"]))
    assert printed.keys() == golden.keys()
    for name, row in printed.items():
        assert [float(figure) for figure in row] == pytest.approx(golden[name], abs=0.00051), (
            name
        )  # printed to three decimals
    assert planned_figures() == pytest.approx(golden_surge_damping(identified), abs=0.051)


def planned_figures() -> list[float]:
    """Identified coefficients, surge damping and its error by noise, as the plan of dives has
    them of the demo's training leg.
    """
    row = re.search(
        r"\| 0 to 90 s \| (\d+) \| −([\d.]+) ± ([\d.]+) \|", documents()["docs/planning.md"]
    )
    assert row is not None
    return [float(row[1]), -float(row[2]), float(row[3])]


def golden_surge_damping(identified: Counter[str]) -> list[float]:
    """The same by the golden table."""
    for row in golden_rows("coefficients"):
        if (row["stage"], row["of"], row["quantity"]) == ("synthesise", "symmetric", "X u"):
            return [float(identified["symmetric"]), float(row["value"]), float(row["scale"])]
    raise AssertionError("the golden table has no surge damping")


def test_own_csv_campaign_runs_as_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The column map of docs/howto/own_csv.md on a small log with those columns, up to the
    fused state.
    """
    folder = tmp_path / "workspace"
    assert auvid(monkeypatch, "new", str(folder)) == 0
    campaign = folder / "campaigns" / "mine"
    (campaign / "logs").mkdir(parents=True)
    (campaign / "columns").mkdir()
    (campaign / "columns" / "dive.yaml").write_text(blocks(OWN_CSV, "yaml")[0], encoding="utf-8")
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


def auvid(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Exit code of a command in this process."""
    monkeypatch.setattr(sys, "argv", ["auvid", *words])
    try:
        cli.main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0
