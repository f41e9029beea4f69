"""`make campaign` never leaves it to DVC to take another campaign; `make demo` says what
it waits for; the locks hold what they should.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STUB = '#!/bin/sh\necho "$@" >> called\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of what `make campaign` looks at, with a campaign more and a stub for DVC."""
    for name in ("Makefile", "params.yaml", "dvc.yaml"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("requirements-dvc.lock", "pyproject.toml", "setup.py"):
        (tmp_path / name).touch()
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "dvc").write_text(STUB)
    (programs / "dvc").chmod(0o755)
    (programs / "python").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    (programs / "python").chmod(0o755)
    (tmp_path / ".venv" / ".dvc-installed").touch()
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


def make(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    # Without what a make around the tests hands on: its level and its flags.
    settings = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    return subprocess.run(
        ["make", *(words or ("campaign", "NAME=mydive"))],
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


def test_machine_without_python_is_told_what_to_install(folder: Path) -> None:
    shutil.rmtree(folder / ".venv")
    shutil.copy(ROOT / "requirements.lock", folder)
    done = make(folder, "demo", "PYTHON=python3.99")
    assert done.returncode != 0
    assert "needs Python 3.11 or newer, and 'python3.99' is not there" in done.stdout
    assert "make demo PYTHON=" in done.stdout


def test_demo_says_what_it_waits_for(folder: Path) -> None:
    """With stubs in place of uv, or of what pip installs: no network here."""
    shutil.copy(ROOT / "requirements.lock", folder)
    (folder / ".venv" / "bin" / "uv").write_text(STUB)
    (folder / ".venv" / "bin" / "uv").chmod(0o755)
    (folder / ".venv" / "bin" / "auvid").write_text(STUB)
    (folder / ".venv" / "bin" / "auvid").chmod(0o755)
    done = make(folder, "demo")
    assert done.returncode == 0, done.stderr
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    count = sum("==" in line for line in lines)
    assert f"installing {count} packages of requirements.lock" in done.stdout
    assert "running a dive" in done.stdout
    first, second, third = (folder / "called").read_text().splitlines()
    assert "--require-hashes -r requirements.lock" in first
    assert "--compile-bytecode" in second
    assert third == "run bluerov2_dvl"
    assert "installing" not in make(folder, "demo").stdout


@pytest.mark.parametrize(
    ("lock", "has", "lacks"),
    [
        ("requirements.lock", {"rerun-sdk", "setuptools"}, {"dvc", "mypy", "ruff", "pyulog"}),
        ("requirements-dvc.lock", {"rerun-sdk", "dvc"}, {"mypy", "ruff", "pyulog", "hypothesis"}),
        ("requirements-dask.lock", {"rerun-sdk", "distributed", "s3fs"}, {"dvc", "mypy", "ruff"}),
        (
            "requirements-test.lock",
            {"rerun-sdk", "dvc", "distributed", "mypy", "ruff", "pyulog"},
            set(),
        ),
    ],
)
def test_locks_hold_their_sets_with_hashes_and_without_addresses(
    lock: str, has: set[str], lacks: set[str]
) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    names = set(re.findall(r"^([\w.-]+)==", text, re.MULTILINE))
    assert has <= names
    assert not names & lacks
    entries = re.split(r"^(?=[\w.-]+==)", text, flags=re.MULTILINE)[1:]
    assert all("--hash=sha256:" in entry for entry in entries)
    assert "://" not in text


def test_a_user_does_not_get_what_only_tests_and_extras_need() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    base = {re.split(r"[<>=]", item)[0] for item in project["dependencies"]}
    assert not base & {
        "rerun-sdk",
        "dvc",
        "distributed",
        "mypy",
        "ruff",
        "hypothesis",
        "pyulog",
        "pytest",
    }
    assert {"view", "dvc", "dask", "test"} <= set(project["optional-dependencies"])


def test_every_loop_that_is_kept_is_compiled_with_the_test_environment() -> None:
    """By tests marked `compiles`, which the Makefile runs when it makes the environment."""
    keeps = re.compile(r"\bcache=(True|not inner)\b|import _compiled\b")
    folders = ("data_schemas", "hydro", "stages", "export", "pipeline", "auvid", "tests/support")
    paths = {path for folder in folders for path in (ROOT / folder).rglob("*.py")}
    kept = {
        path.relative_to(ROOT).as_posix()
        for path in paths
        if keeps.search(path.read_text(encoding="utf-8"))
    }
    compiled = {
        name
        for path in (ROOT / "tests" / "unit").rglob("test_*.py")
        for words in re.findall(r"mark\.compiles\(([^)]*)\)", path.read_text(encoding="utf-8"))
        for name in re.findall(r'"([^"]+)"', words)
    }
    assert compiled == kept
    rule = (ROOT / "Makefile").read_text(encoding="utf-8").split("\n$(TEST): requirements")[1]
    assert "pytest -n auto -m compiles" in rule.split("\n\n")[0]
