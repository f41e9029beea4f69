"""What a run prints that has nothing to do: kept, and dropped after any change."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from auvid.pipeline import cli
from auvid.pipeline.commands.run import run_command
from auvid.pipeline.execution import code_stamp, kept_output
from auvid.pipeline.execution.kept_output import Beginning, printed_before

NOTHING = "nothing to do: everything is up to date"


def run(*words: str) -> str:
    done = CliRunner().invoke(cli.app, ["run", *words], catch_exceptions=False)
    assert done.exit_code == 0
    return done.stdout


@pytest.fixture
def finished(toy_workspace: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace whose campaign has run, and whose output was kept."""
    monkeypatch.setattr(kept_output, "SETTLED_S", 0.0)
    monkeypatch.setattr(kept_output, "FILES_READ", set())
    monkeypatch.setattr("auvid.pipeline.store.atomic_files.FILES_READ", kept_output.FILES_READ)
    assert run("toy").startswith("9 items run")
    return toy_workspace


def edit(path: Path) -> None:
    """Change the last byte of a file; its size and time stay."""
    status, content = path.stat(), path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    os.utime(path, ns=(status.st_mtime_ns, status.st_mtime_ns))


CHANGES: dict[str, Callable[[Path], object]] = {
    "manifest edited": lambda top: edit(top / "campaigns/toy/campaign.yaml"),
    "log edited": lambda top: edit(top / "campaigns/toy/b.log"),
    "log removed": lambda top: (top / "campaigns/toy/a.log").unlink(),
    "parameters edited": lambda top: edit(top / "params.yaml"),
    "vehicle edited": lambda top: edit(top / "vehicles/toy.yaml"),
    "vehicle added": lambda top: (top / "vehicles/other.yaml").touch(),
    "coefficients added": lambda top: [
        (top / "vehicles/toy/coefficients").mkdir(parents=True),
        (top / "vehicles/toy/coefficients/prestero.csv").touch(),
    ],
    "artefact edited": lambda top: edit(top / "runs/toy/total/tables_text.txt"),
    "artefact removed": lambda top: (top / "runs/toy/decode/a/depth.parquet").unlink(),
    "artefact added": lambda top: (top / "runs/toy/decode/a/other.parquet").touch(),
    "record edited": lambda top: edit(top / "runs/toy/cut/manifest.json"),
    "output damaged": lambda top: edit(top / "runs/toy" / kept_output.FILE),
}


def test_second_run_prints_what_a_look_at_everything_would(finished: Path) -> None:
    printed = printed_before("toy", strict=False)
    assert printed is not None
    assert printed.text.startswith(NOTHING)
    assert run("toy") == printed.text
    (finished / "runs/toy" / kept_output.FILE).unlink()
    assert run("toy") == printed.text
    assert printed_before("campaigns/toy", strict=False) == printed


@pytest.mark.parametrize("change", CHANGES)
def test_any_change_of_a_file_is_noticed(finished: Path, change: str) -> None:
    assert printed_before("toy", strict=False) is not None
    CHANGES[change](finished)
    assert printed_before("toy", strict=False) is None


SETTINGS: dict[str, Callable[[pytest.MonkeyPatch], None]] = {
    "terminal": lambda patch: patch.setenv("NO_COLOR", "1"),
    "folder": lambda patch: patch.chdir("campaigns"),
    "package": lambda patch: patch.setattr(kept_output, "package_versions", dict),
    "source": lambda patch: patch.setattr(code_stamp, "ROOT", code_stamp.ROOT / "docs"),
}


@pytest.mark.parametrize("change", SETTINGS)
def test_any_change_of_the_setting_is_noticed(
    finished: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    SETTINGS[change](monkeypatch)
    assert printed_before("toy", strict=False) is None


def test_options_are_not_mixed_up(finished: Path) -> None:
    assert printed_before("toy", strict=True) is None
    assert run("toy", "--strict").startswith(NOTHING)
    assert printed_before("toy", strict=False) is None
    assert run("toy", "--until", "cut").startswith(NOTHING)
    assert printed_before("toy", strict=True) is not None


def test_file_changed_while_a_run_went_on_keeps_nothing(
    finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_output, "SETTLED_S", 3600.0)
    (finished / "runs/toy" / kept_output.FILE).unlink()
    run("toy")
    assert printed_before("toy", strict=False) is None


def test_a_clock_set_back_while_a_run_goes_on_keeps_nothing(
    finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file edited after that looks older than the run."""
    (finished / "runs/toy" / kept_output.FILE).unlink()

    def an_hour_ahead() -> Beginning:
        return Beginning(time.time() + 3600.0, time.monotonic())

    monkeypatch.setattr(run_command, "Beginning", an_hour_ahead)
    run("toy")
    assert printed_before("toy", strict=False) is None


def test_a_pipe_in_place_of_what_was_kept_is_not_waited_for(finished: Path) -> None:
    (finished / "runs/toy" / kept_output.FILE).unlink()
    os.mkfifo(finished / "runs/toy" / kept_output.FILE)
    assert printed_before("toy", strict=False) is None


def test_nothing_heavy_is_loaded_where_nothing_is_to_do(finished: Path) -> None:
    assert printed_before("toy", strict=False) is not None
    program = "import sys; sys.argv = ['auvid', 'run', 'toy']\nfrom auvid.pipeline import cli\n"
    program += "try: cli.main()\nexcept SystemExit: pass\nprint('modules', *sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=finished,
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
    )
    assert done.stdout.startswith(NOTHING)
    loaded = set(done.stdout.splitlines()[-1].split())
    heavy = {"numpy", "scipy", "pandas", "pyarrow", "yaml", "rerun", "numba"}
    assert not loaded & heavy


def test_a_source_edited_while_a_run_goes_on_keeps_nothing(
    toy_workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its results are those of the older code."""
    source = tmp_path / "edited.py"
    source.touch()
    os.utime(source, (2e9, 2e9))
    monkeypatch.setattr(kept_output, "FILES_READ", set())
    monkeypatch.setattr(kept_output, "source_files", lambda floors: [source])
    run("toy")
    assert not (toy_workspace / "runs/toy" / kept_output.FILE).exists()


def test_other_commands_ask_whether_all_is_as_the_last_run_left_it(finished: Path) -> None:
    """Whatever the terminal and --strict."""
    assert kept_output.is_as_last_run("toy")
    assert printed_before("toy", strict=True) is None
    edit(finished / "params.yaml")
    assert not kept_output.is_as_last_run("toy")
