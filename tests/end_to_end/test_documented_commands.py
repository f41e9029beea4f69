"""Commands of README and docs/ run as they stand there, in a workspace with the bundled
dive; those that do not are listed with the reason.
"""

from __future__ import annotations

import io
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
import typer

from auvid.pipeline import cli
from tests.support.campaign_runs import FEWER, LAST_STAGE, auvid, copy_workspace, made_once
from tests.support.documents import ROOT, blocks, commands, documents, own_log

DIVE = "bluerov2_dvl"
SYNTAX = " [OPTIONS]"
"""In a line that shows what a command takes."""
LEFT_OUT = {
    r"auvid check .* --align": "of two logs (test_check_logs.py)",
    r"auvid regress .* --update": "writes the golden tables (test_regress.py)",
    r"auvid score \S+ --with '": "a pattern of names (test_score.py)",
    r"auvid inspect (?!.*--save)": "opens a window or needs a display (test_inspect.py)",
    r"auvid (run|reproduce) (vt690|hauv|thaus|remus|bluerov2_twin)": (
        "takes minutes (test_twin_short.py, test_bench_twins.py, test_hauv_control.py)"
    ),
    r"auvid run campaigns/my_twin": "takes a minute (test_twin_short.py)",
    r"auvid simulate": "takes a minute (test_reproduce.py)",
    r"auvid (run|report) mybench": "its files run in test_bench_readme.py",
    r"auvid diff .*@\w+\.\w+=": "runs the chain again (test_look_back.py)",
    r"auvid new campaign (tank|lake|harbour --from dive_1)": "other logs (test_new_campaign.py)",
    r"auvid report bluerov2_dvl bluerov2_dvl_csv": "needs another run (test_runs_page.py)",
    r"auvid report .*--compare": "needs an earlier run (test_look_back.py)",
    r"auvid report .*--history": "needs an earlier run (test_runs_page.py)",
    r"auvid (new campaign towfish|run towfish)": "other logs (test_passive.py)",
    r"auvid run mydive ": "needs workers (test_dask.py)",
    r"auvid (fleet|catalog) ": "runs dives (test_fleet_run.py, test_expression.py, test_cli.py)",
    r"auvid --(install|show)-completion": "is of the shell (test_completion.py)",
    r"\. \.venv/bin/activate": "changes the shell",
    r"make campaign NAME=example": "through DVC (test_engines.py)",
}
"""Pattern of a command -> why it is not run here, and which test runs its like."""
SHORTER = {
    r"auvid run (harbour|example|myglider)$": " --until ingest",
    r"auvid export .* --to draws": " --draws 20",
}
"""Pattern -> words that make a command short."""
EXIT_CODES = {r"auvid diff \S+@\w+ \S+@": 1, r"auvid check dive.csv$": 1}
"""Pattern -> exit code that is right where it is not 0: models differ, a map is missing."""


CONTEXT = r"cd |auvid new \w+$|mkdir "
"""Commands that later ones of the same document stand on."""


@pytest.fixture(scope="module")
def workspace(committed_run: Callable[[str], Path], session_folder: Path) -> Path:
    """A workspace as the repository is one, with the dive run to its report."""

    def make(folder: Path) -> None:
        copy_workspace(committed_run(DIVE), folder)
        auvid("run", DIVE, folder=folder)
        for path in (ROOT / "campaigns").iterdir():
            if not (folder / "campaigns" / path.name).exists():
                (folder / "campaigns" / path.name).symlink_to(path, target_is_directory=True)
        (folder / "tests").symlink_to(ROOT / "tests", target_is_directory=True)
        shutil.copytree(folder / "runs" / DIVE, folder / "runs/older")
        give_logs(folder)
        call(["new", "made"], folder)
        shutil.move(folder / "made/campaigns/example", folder / "campaigns")
        shutil.move(folder / "made/vehicles", folder)
        shutil.rmtree(folder / "made")

    return made_once(session_folder / "documents", make)


def give_logs(folder: Path) -> None:
    """Put the logs that the documents name into a folder."""
    log = next((ROOT / "campaigns" / DIVE / "logs").glob("*.BIN"))
    shutil.copy(log, folder / "dive.BIN")
    shutil.copy(ROOT / "campaigns/slocum_glide/logs/dive.csv", folder / "glider.csv")
    card = folder / "runs" / DIVE / "model_file/model_file/linear.json"
    if card.exists():
        shutil.copy(card, folder)
    (folder / "dive.csv").write_text(own_log(), encoding="utf-8")
    (folder / "columns").mkdir()
    column_map = blocks(documents()["docs/howto/own_csv.md"], "yaml")[0]
    (folder / "columns/dive.yaml").write_text(column_map, encoding="utf-8")


def left_out(line: str) -> str | None:
    """Return why a command is not run; None where it is."""
    return next((why for pattern, why in LEFT_OUT.items() if re.match(pattern, line)), None)


def execute(line: str, folder: Path) -> tuple[Path, int, str]:
    """Run one command in a folder; return the folder after it, exit code and output."""
    words, _, file = line.replace("~/", f"{folder}/").partition(" > ")
    program, *arguments = shlex.split(words)
    if program == "cd":
        return folder / arguments[0], 0, ""
    if program == "make":
        done = subprocess.run(
            ["make", "--dry-run", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
        )
        return folder, done.returncode, done.stderr
    if program != "auvid":
        done = subprocess.run(shlex.split(words), cwd=folder, capture_output=True, check=False)
        return folder, done.returncode, str(done.stderr)
    code, output = call(arguments, folder)
    if file:
        (folder / file).write_text(output, encoding="utf-8")
    if len(arguments) == 2 and arguments[0] == "new":
        give_logs(folder / arguments[1])
    return folder, code, output


def call(arguments: list[str], folder: Path) -> tuple[int, str]:
    """Call the program in this process; return exit code and output."""
    output, before = io.StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("sys.argv", ["auvid", *arguments])
            patch.setattr(typer, "launch", lambda address: None)
            with redirect_stdout(output), redirect_stderr(output):
                cli.main()
        return 0, output.getvalue()
    except SystemExit as end:
        return int(end.code or 0), output.getvalue()
    finally:
        os.chdir(before)


def to_run() -> dict[str, list[str]]:
    """Return the commands to run by document: each once, and always what others stand on."""
    lines: dict[str, list[str]] = {}
    listed: set[str] = set()
    for name in documents():
        for command in commands(name):
            line = command.line
            if SYNTAX in line:
                continue
            if left_out(line) is None and (line not in listed or re.match(CONTEXT, line)):
                lines.setdefault(name, []).append(line)
                listed.add(line)
    return lines


def put_results(name: str, run: Path, folder: Path) -> None:
    """Give a workspace the stages of a campaign that have run for other tests."""
    (folder / "campaigns" / name).unlink()
    shutil.copytree(run / "campaigns" / name, folder / "campaigns" / name, symlinks=True)
    shutil.copytree(run / "runs" / name, folder / "runs" / name)


@pytest.mark.parametrize("document", to_run())
def test_commands_run_as_written(
    document: str, workspace: Path, tmp_path: Path, committed_run: Callable[[str], Path]
) -> None:
    """Of a campaign that other tests have run, what they left out runs."""
    folder = copy_workspace(workspace, tmp_path / "workspace")
    for line in to_run()[document]:
        name = line.removeprefix("auvid run ")
        if name in LAST_STAGE and name not in FEWER and not (folder / "runs" / name).exists():
            put_results(name, committed_run(name), folder)
        short = next((more for text, more in SHORTER.items() if re.match(text, line)), "")
        folder, code, output = execute(line + short, folder)
        right = next((code for text, code in EXIT_CODES.items() if re.match(text, line)), 0)
        assert code == right, f"{line}\n{output}"


def test_reasons_are_those_of_commands_that_stand_in_a_document() -> None:
    lines = [command.line for name in documents() for command in commands(name)]
    for pattern in [*LEFT_OUT, *SHORTER, *EXIT_CODES]:
        assert any(re.match(pattern, line) for line in lines), pattern


def test_tests_that_run_the_others_exist() -> None:
    names = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
    assert set(re.findall(r"test_\w+\.py", " ".join(LEFT_OUT.values()))) <= names


def test_a_command_that_fails_is_noticed(workspace: Path) -> None:
    assert execute("auvid run nothing", workspace)[1] != 0
    assert execute("make nothing", workspace)[1] != 0
