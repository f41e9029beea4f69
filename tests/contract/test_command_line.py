"""docs/command_line.md is true: one table of exit codes, one form of JSON, and the same
code for the same kind of refusal in every command.
"""

from __future__ import annotations

import json
import re
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from auvid.pipeline import cli, output
from auvid.pipeline.output import EXIT_CODES, FAILED, WRONG_USE

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
PLAN = "campaigns/vt690_twin/plans/short.yaml"

WRONG_WORDS = [
    "fly",
    "check bluerov2_dvl --columns map.yaml",
    "run",
    "run nosuch",
    "run bluerov2_dvl --fast",
    "run bluerov2_dvl --only nosuch",
    "run bluerov2_dvl --until nosuch",
    "run bluerov2_dvl --only fuse --until fuse",
    "run bluerov2_dvl --engine nosuch",
    "run bluerov2_dvl --jobs 0",
    "report nosuch",
    "check nosuch",
    "check one.BIN --align",
    "inspect nosuch",
    "inspect bluerov2_dvl --log nosuch",
    "diff nosuch bluerov2_dvl",
    "diff bluerov2_dvl@99 bluerov2_dvl",
    "diff bluerov2_dvl@fuse.cutof_hz=1 bluerov2_dvl",
    "history nosuch",
    "history bluerov2_dvl --run 99",
    "regress nosuch",
    "regress bluerov2_dvl --update",
    f"simulate nosuch {PLAN} -o NEW",
    f"simulate vt690 {PLAN} -o NEW --seed -1",
    f"simulate vt690 {PLAN} -o NEW --format nosuch",
    f"simulate vt690 {PLAN} -o NEW --accelerometer nosuch",
    f"simulate vt690 {PLAN} -o NEW --truth nosuch",
    "reproduce nosuch",
    "reproduce bluerov2_dvl",
    "stages nosuch",
    "models nosuch",
    "schema nosuch",
    "coefficients nosuch",
    "coefficients hauv --set nosuch",
    "coefficients hauv --model nosuch",
    "export nosuch --to python",
    "export bluerov2_wu_2018 --to nosuch",
    "score nosuch",
    "score hauv_redesign",
]
"""A word of each is at fault: unknown, out of range, or excluded by another."""
AT_FAULT = [
    "check nosuch.BIN",
    "check README.md",
    "inspect nosuch.BIN",
    "inspect nosuch.rrd",
    "coefficients nosuch.yaml",
    "export nosuch.json --to python",
    "new docs",
    f"simulate vt690 {PLAN} -o docs",
    "simulate vt690 nosuch.yaml -o NEW",
]
"""The words are right; a file or a folder is at fault."""


def auvid(
    line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], new: Path
) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command in the repository."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", ["auvid", *line.replace("NEW", str(new)).split()])
    code: Any = 0
    try:
        cli.main()
    except SystemExit as end:
        code = end.code or 0
    printed = capsys.readouterr()
    return int(code), printed.out, printed.err


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def history(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No runs: `runs/` of the repository is not looked at."""
    from auvid.pipeline.campaigns.workspace import Workspace

    monkeypatch.setattr(Workspace, "runs", property(lambda self: tmp_path / "runs"))


def test_page_has_the_table_of_the_program() -> None:
    rows = dict(re.findall(r"^\| (\d+) \| (.*?) \|$", PAGE, re.MULTILINE))
    assert {int(code): words for code, words in rows.items()} == EXIT_CODES


@pytest.mark.usefixtures("history")
@pytest.mark.parametrize("line", WRONG_WORDS)
def test_wrong_words_are_2(
    line: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    code, _, err = auvid(line, monkeypatch, capsys, tmp_path / "new")
    assert code == WRONG_USE, err
    assert err
    assert "Traceback" not in err


@pytest.mark.usefixtures("history")
@pytest.mark.parametrize("line", AT_FAULT)
def test_what_is_at_fault_outside_the_words_is_1(
    line: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    code, out, err = auvid(line, monkeypatch, capsys, tmp_path / "new")
    assert code == FAILED, out + err


KEYS = {"format", "auvid", "command", "exit_code", "answer", "notes", "error"}


def test_page_names_the_keys_of_the_envelope() -> None:
    block = PAGE.partition("```json\n")[2].partition("```")[0]
    assert json.loads(block).keys() == KEYS


@pytest.mark.usefixtures("history")
@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("models linear", 0),
        ("stages fuse", 0),
        ("vehicles", 0),
        ("coefficients hauv", 0),
        ("check README.md", 1),
        ("check nosuch", 2),
        ("report bluerov2_dvl", 1),
        ("run bluerov2_dvl --fast", 2),
    ],
)
def test_json_is_one_document_in_one_form(
    line: str,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    status, out, _ = auvid(f"{line} --json", monkeypatch, capsys, tmp_path / "new")
    document = json.loads(out)
    assert document.keys() == KEYS
    assert document["format"] == output.FORMAT
    assert document["exit_code"] == status == code
    assert (document["answer"] is None) == (document["error"] is not None)
    if document["error"] and code == FAILED:
        assert {"kind", "text", "file", "row", "field", "value", "remedy"} <= set(document["error"])


def test_every_command_with_an_answer_takes_the_options_of_the_output() -> None:
    commands = cli_commands()
    commands |= commands.pop("new").commands
    fleet = commands.pop("fleet").commands
    commands |= {f"fleet {name}": command for name, command in fleet.items()}
    without = {
        name
        for name, command in commands.items()
        if not {"json", "quiet", "verbose"} <= {param.name for param in command.params}
    }
    assert without == {"code", "inspect", "schema"}


def cli_commands() -> dict[str, Any]:
    import typer

    commands: dict[str, Any] = dict(typer.main.get_command(cli.app).commands)  # type: ignore[attr-defined]
    return commands
