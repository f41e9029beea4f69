"""The notebooks of docs/notebooks run as they are, cell by cell."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support.campaign_runs import ROOT, copy_workspace

FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = sorted(path.stem for path in FOLDER.glob("*.ipynb"))


@pytest.fixture(scope="module")
def workspace(
    committed_run: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A workspace as the repository is one, with the dive judged already."""
    folder = copy_workspace(committed_run("bluerov2_dvl"), tmp_path_factory.mktemp("notebooks"))
    name = "campaigns/bluerov2_dvl_csv"
    (folder / name).symlink_to(ROOT / name, target_is_directory=True)
    (folder / "docs/notebooks").mkdir(parents=True)
    return folder


def cells(name: str) -> list[str]:
    """Return the code cells of a notebook."""
    book = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]


def executed(name: str, workspace: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run the code cells of a notebook in its folder and return what they define."""
    monkeypatch.chdir(workspace / "docs/notebooks")
    names: dict[str, Any] = {}
    for number, source in enumerate(cells(name)):
        exec(compile(source, f"{name}, cell {number}", "exec"), names)
    return names


def test_a_dive_in_ten_lines(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert sum(map(len, map(str.splitlines, cells("dive")))) <= 14, "ten lines and four blank ones"
    names = executed("dive", workspace, monkeypatch)
    assert {"X_u", "Z_constant"} <= set(names["known"].index)
    assert names["score"]["J/J0"]["all"] < 0.5


def test_own_csv_gives_the_damping_of_the_campaign(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within the interval of each other, from other clocks and splines."""
    names = executed("own_csv", workspace, monkeypatch)
    row = names["model"].coefficients.loc["X_u"]
    assert row["verdict"] == "identified"
    assert row["value"] == pytest.approx(-57.9, abs=1.5)
    assert (workspace / "docs/notebooks/my_rov.json").is_file()


def test_the_identified_vehicle_is_simulated(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = executed("simulate", workspace, monkeypatch)
    assert names["flight"].notna().to_numpy().all()
    # RMS over 10 s; the report's free runs have .035 m/s at their ends.
    assert (names["error"][:, :3] ** 2).mean(axis=0) ** 0.5 == pytest.approx([0, 0, 0], abs=0.05)


def test_every_notebook_is_named_on_the_page_and_run_here() -> None:
    page = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"notebooks/(\w+)\.ipynb", page)) == NOTEBOOKS
    assert NOTEBOOKS == ["dive", "own_csv", "simulate"]
