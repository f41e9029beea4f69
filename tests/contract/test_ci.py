"""What continuous integration says of programs that tests want and the machine lacks."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.support import browser

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ("bash", "dirname", "mktemp", "tee", "grep", "tail", "rm", "id")
NEEDED = ("xvfb-run", "xauth", "octave-cli")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def run(folder: Path, *programs: str) -> str:
    """Return what `.ci/run` prints on a machine with these programs and no more."""
    for name in TOOLS:
        (folder / name).symlink_to(str(shutil.which(name)))
    for name in ("make", *programs):
        (folder / name).write_text("#!/bin/sh\necho '3 passed in 0.1s'\n")
        (folder / name).chmod(0o755)
    command = [str(folder / "bash"), str(ROOT / ".ci" / "run")]
    environment = {"PATH": str(folder), "TMPDIR": os.environ.get("TMPDIR", "/tmp")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.parametrize("name", BROWSERS)
def test_any_browser_that_the_tests_take_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    assert " no " not in f" {run(tmp_path, name, *NEEDED)}"
    monkeypatch.setenv("PATH", str(tmp_path))
    assert browser.chromium() == str(tmp_path / name)


@pytest.mark.parametrize(
    ("missing", "words"),
    [("chromium", "no Chromium"), ("xauth", "no xvfb or xauth"), ("octave-cli", "no GNU Octave")],
)
def test_what_is_missing_is_said(tmp_path: Path, missing: str, words: str) -> None:
    programs = {"chromium", *NEEDED} - {missing}
    lines = run(tmp_path, *programs).splitlines()
    assert [line for line in lines if line.startswith("no ")] == [lines[0]]
    assert lines[0].startswith(words)
    assert lines[-1] == "3 passed in 0.1s"
