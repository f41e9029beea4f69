"""`make campaign` never leaves it to DVC to take another campaign."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STUB = '#!/bin/sh\necho "$@" >> called\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of what `make campaign` looks at, with a campaign more and a stub for DVC."""
    for name in ("Makefile", "params.yaml", "dvc.yaml"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("requirements.lock", "pyproject.toml", "setup.py"):
        (tmp_path / name).touch()
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "dvc").write_text(STUB)
    (programs / "dvc").chmod(0o755)
    (programs / "python").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    (programs / "python").chmod(0o755)
    (tmp_path / ".venv" / ".run-installed").touch()
    (tmp_path / ".dvc").mkdir()
    (tmp_path / ".dvc" / "config.local").touch()
    for path in ROOT.glob("campaigns/*/campaign.yaml"):
        (tmp_path / "campaigns" / path.parent.name).mkdir(parents=True)
        shutil.copy(path, tmp_path / "campaigns" / path.parent.name)
    shutil.copytree(tmp_path / "campaigns" / "blueye_heave", tmp_path / "campaigns" / "mydive")
    report = tmp_path / "runs" / "mydive" / "report"
    report.mkdir(parents=True)
    (report / "report_html.html").touch()
    return tmp_path


def make(folder: Path) -> subprocess.CompletedProcess[str]:
    # Without what a make around the tests hands on: its level and its flags.
    settings = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    return subprocess.run(
        ["make", "campaign", "NAME=mydive"],
        cwd=folder,
        env=settings,
        capture_output=True,
        text=True,
        check=False,
    )


def test_campaign_that_dvc_yaml_lacks_is_declared_first(folder: Path) -> None:
    params = folder / "params.yaml"
    params.write_text(params.read_text().replace("campaigns:", "campaigns:\n  - mydive\n #", 1))
    before = params.read_text()
    done = make(folder)
    assert done.returncode == 0, done.stderr
    assert (folder / "called").read_text() == "repro --glob report*@mydive\n"
    assert "blueye_heave, mydive]" in (folder / "dvc.yaml").read_text()
    assert params.read_text() == before
    assert done.stdout.splitlines()[-1] == str(folder / "runs/mydive/report/report_html.html")


def test_campaign_outside_params_is_refused(folder: Path) -> None:
    done = make(folder)
    assert done.returncode != 0
    assert "mydive is not in the list 'campaigns:'" in done.stdout
    assert not (folder / "called").exists()
