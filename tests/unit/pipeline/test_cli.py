"""The command line: help, refusals, exit codes, and what a user sees when something
goes wrong.
"""

from __future__ import annotations

import errno
import gc
import io
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.viscous.models import MODELS
from auvid.hydro.long_series import threads
from auvid.pipeline import cli, output
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.pipeline.collector import NEW_OBJECTS, kept_for_good
from auvid.pipeline.commands import open_run
from auvid.pipeline.commands.new.new_example import example_log
from auvid.pipeline.commands.open_run import show_progress
from auvid.pipeline.commands.run import run_command, run_summary
from auvid.pipeline.commands.run.staleness import stale_words
from auvid.stages.base import ports
from auvid.stages.registry import KINDS, STAGES
from tests.support import toy_stages

LOOKING = ("inspect", "diff", "history")
COMMANDS = (
    "coefficients",
    "schema",
    "fleet",
    "catalog",
    "run",
    "report",
    *LOOKING,
    "check",
    "regress",
    "simulate",
    "reproduce",
    "stages",
    "models",
    "vehicles",
    "export",
    "score",
    "new",
)
TEMPLATES = Path(cli.__file__).parent / "templates"


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def auvid(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str
) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command in this process."""
    monkeypatch.setattr(sys, "argv", ["auvid", *words])
    code: Any = 0
    try:
        cli.main()
    except SystemExit as end:
        code = end.code or 0
    captured = capsys.readouterr()
    return int(code), captured.out, captured.err


@pytest.mark.parametrize(
    ("number", "end"), [(signal.SIGTERM, SystemExit), (signal.SIGINT, KeyboardInterrupt)]
)
def test_a_signal_ends_what_threads_work_on(
    monkeypatch: pytest.MonkeyPatch, number: int, end: type[BaseException]
) -> None:
    monkeypatch.setattr(threads, "THREADS", 2)
    finished: list[bool] = []

    def long_work() -> None:
        for _ in range(300):
            time.sleep(0.01)
        finished.append(True)

    before = signal.signal(number, cli._end)
    try:
        with pytest.raises(end):
            threads.together(partial(signal.raise_signal, number), long_work)
    finally:
        signal.signal(number, before)
    assert not finished


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command: str) -> None:
    help_text = CliRunner().invoke(cli.app, [command, "--help"], env={"COLUMNS": "120"}).output
    assert re.search(rf"Example: auvid {command}\b", help_text)


def test_commands_are_those_that_are_tested() -> None:
    names = {
        str(command.name or getattr(getattr(command, "callback", None), "__name__", ""))
        for command in (*cli.app.registered_commands, *cli.app.registered_groups)
        if not command.hidden
    }
    assert names == set(COMMANDS)


def test_help_loads_nothing_heavy() -> None:
    program = "import sys; sys.argv = ['auvid', '--help']\nfrom auvid.pipeline import cli\n"
    program += "try: cli.main()\nexcept SystemExit: pass\nprint(*sys.modules)"
    loaded = set(
        subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True
        ).stdout.split()
    )
    assert not loaded & {"numpy", "scipy", "pandas", "pyarrow", "rerun", "dvc", "numba", "rich"}


def test_blas_threads_and_memory_of_libraries_are_set_before_they_are_loaded() -> None:
    program = (
        "import auvid.pipeline, sys, os; print('numpy' in sys.modules,"
        " os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'],"
        " os.environ['MIMALLOC_PURGE_DELAY']);"
        "import pyarrow; print(pyarrow.default_memory_pool().backend_name)"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={"OMP_NUM_THREADS": "8"},
    ).stdout
    assert answer.split() == ["False", "1", "1", "0", "system"]


@pytest.mark.parametrize(
    "words", [("run",), ("run", "toy", "--fast"), ("fly",), ("run", "toy", "--jobs", "many")]
)
def test_wrong_use_is_2(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert auvid(monkeypatch, capsys, *words)[0] == 2


def test_run_says_what_ran_and_then_that_nothing_is_to_do(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = auvid(monkeypatch, capsys, "run", "toy")
    assert (code, out.splitlines()[0]) == (0, "9 items run")
    assert "tables as text: runs/toy/total/tables_text.txt" in out
    assert "spread: done (" in err
    assert re.search(
        r"spread: segment three \(\d+\.\d s\)",
        auvid(monkeypatch, capsys, "run", "toy", "--force", "--verbose")[2],
    )
    code, out, err = auvid(monkeypatch, capsys, "run", "campaigns/toy")
    assert (code, out.splitlines()[0]) == (0, "nothing to do: everything is up to date")
    assert err.splitlines() == [
        f"{name}: up to date" for name in ("decode", "cut", "spread", "total")
    ]
    codes = toy_workspace / "runs" / ".code"
    assert not codes.exists()  # only DVC depends on them, and asks for them each time
    assert auvid(monkeypatch, capsys, "code")[0] == 0
    assert (codes / "decode.txt").read_text().startswith("decode ")


def test_results_of_a_leg_that_has_another_name_are_of_an_earlier_run(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    auvid(monkeypatch, capsys, "run", "toy")
    manifest = toy_workspace / "campaigns" / "toy" / "campaign.yaml"
    manifest.write_text(manifest.read_text().replace("id: three", "id: four"))
    code, out, _ = auvid(monkeypatch, capsys, "run", "toy", "--until", "decode")
    assert code == 0
    assert "not printed: results from stage cut on, of an earlier run" in out
    auvid(monkeypatch, capsys, "run", "toy")
    assert stale_words("toy") == ""
    total = toy_workspace / "runs" / "toy" / "total" / "manifest.json"
    total.write_text(total.read_text().replace('"code": "', '"code": "1'))
    assert "results of toy from stage total on are not up to date" in stale_words("toy")


def test_quiet_leaves_the_answer(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (toy_workspace / "campaigns" / "toy" / "a.log").write_bytes(b"WARN")
    code, out, err = auvid(monkeypatch, capsys, "run", "toy", "--quiet")
    assert (code, err) == (0, "")
    assert out.split() == ["tables", "as", "text:", "runs/toy/total/tables_text.txt"]
    assert "toy warning" in auvid(monkeypatch, capsys, "run", "toy")[1]


def test_verbose_cuts_no_list(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(run_summary, "losses", lambda run: [str(index) for index in range(30)])
    assert "... and 10 more" in auvid(monkeypatch, capsys, "run", "toy")[1]
    assert "  29\n" in auvid(monkeypatch, capsys, "run", "toy", "--verbose")[1]


def test_json_of_a_run_is_its_summary(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = auvid(monkeypatch, capsys, "run", "toy", "--json")
    document = json.loads(out)
    assert (code, document["exit_code"], document["command"]) == (0, 0, "run")
    assert document["answer"]["items_run"] == 9
    assert document["answer"]["files"] == {
        "tables as text": str(toy_workspace / "runs/toy/total/tables_text.txt")
    }
    assert document["answer"]["verdict"] is None
    assert "total: done" in err
    (toy_workspace / "campaigns" / "toy" / "a.log").write_bytes(b"BAD")
    code, out, _ = auvid(monkeypatch, capsys, "run", "toy", "--json")
    document = json.loads(out)
    assert (code, document["exit_code"], document["answer"]) == (1, 1, None)
    assert document["error"]["text"] == "decode, log 'a': a.log: not a toy log"


def test_help_has_commands_by_task_and_no_types_of_flags() -> None:
    help_text = CliRunner().invoke(cli.app, ["--help"], env={"COLUMNS": "120"}).output
    places = [help_text.index(f"\n{panel}:\n") for panel in output.PANELS]
    assert places == sorted(places)
    for name in COMMANDS:
        help_text = CliRunner().invoke(cli.app, [name, "--help"], env={"COLUMNS": "120"}).output
        assert "<bool>" not in help_text


@pytest.mark.parametrize("words", [(), ("new",), ("fleet",)])
def test_no_command_prints_the_commands_and_is_2(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = auvid(monkeypatch, capsys, *words)
    assert code == 2
    assert " ".join(["Usage: auvid", *words, "[OPTIONS] COMMAND [ARGS]..."]) in out
    assert "run" in out or "campaign" in out


@pytest.mark.parametrize(
    ("command", "usage"),
    [
        ("new campaign", "NAME --from LOG..."),
        ("report", "CAMPAIGN..."),
        ("check", "LOG... | CAMPAIGN"),
        ("stages", "[STAGE]"),
    ],
)
def test_usage_has_the_words_as_they_are_typed(command: str, usage: str) -> None:
    help_text = CliRunner().invoke(cli.app, [*command.split(), "--help"]).output
    assert f"auvid {command} [OPTIONS] {usage} \n" in re.sub(r" +", " ", help_text)


def test_user_fault_is_one_line_and_1(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (toy_workspace / "campaigns" / "toy" / "a.log").write_bytes(b"BAD")
    code, _, err = auvid(monkeypatch, capsys, "run", "toy")
    assert code == 1
    assert err.splitlines()[-1] == "error: decode, log 'a': a.log: not a toy log"
    assert "Traceback" not in err


def test_internal_fault_is_short_unless_the_traceback_is_wanted(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (toy_workspace / "campaigns" / "toy" / "a.log").write_bytes(b"CRASH")
    code, _, err = auvid(monkeypatch, capsys, "run", "toy")
    assert code == 1
    assert "internal fault: decode, log 'a': ZeroDivisionError: toy crash" in err
    assert "AUVID_TRACEBACK=1" in err
    assert "Traceback" not in err
    assert "Traceback" in auvid(monkeypatch, capsys, "run", "toy", "--verbose")[2]
    monkeypatch.setenv("AUVID_TRACEBACK", "1")
    assert re.search(
        r"(?s)Traceback.*toy_stages.py.*ZeroDivisionError",
        auvid(monkeypatch, capsys, "run", "toy")[2],
    )


def test_interrupt_says_so(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(inputs: Any, params: Any) -> Any:
        raise KeyboardInterrupt

    stages = (
        *toy_stages.STAGES[:2],
        replace(toy_stages.STAGES[2], run=interrupt),
        toy_stages.STAGES[3],
    )
    monkeypatch.setattr(open_run, "STAGES", stages)
    code, _, err = auvid(monkeypatch, capsys, "run", "toy")
    assert (code, err.splitlines()[-1]) == (130, "interrupted: what was finished is kept")


def test_full_output_is_named_and_is_no_internal_fault(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Full(io.StringIO):
        def flush(self) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(cli, "_close_output", lambda: None)
    monkeypatch.setattr(sys, "stdout", Full())
    code, _, err = auvid(monkeypatch, capsys, "vehicles")
    assert code == 1
    assert "nothing more can be printed: No space left on device" in err


def test_what_the_system_refuses_is_in_the_envelope(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(campaign: str, **options: object) -> int:
        raise OSError(errno.EFBIG, "File too large", f"{campaign}.BIN")

    monkeypatch.setattr(run_command, "run_campaign", refuse)
    code, out, err = auvid(monkeypatch, capsys, "run", "toy", "--force", "--json")
    document = json.loads(out)
    assert (code, document["exit_code"], document["answer"]) == (1, 1, None)
    assert "toy.BIN: the system refused it: File too large" in document["error"]["text"]
    assert document["error"]["text"] in err


def test_a_campaign_for_which_memory_is_short_is_refused_only_where_it_has_to_run(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_command, "health_of", lambda run: {})
    monkeypatch.setattr(run_command, "shortage", lambda *words: DataError("too long"))
    run = open_run.open_run("toy")
    stages = run.graph.stages

    def refused(*, force: bool = False) -> bool:
        at_50_hz = replace(run, params={**run.params, "resample": SimpleNamespace(rate_hz=50.0)})
        try:
            run_command._stop_at_shortage(at_50_hz, stages, 1, force=force)
        except DataError:
            return True
        return False

    assert refused(), "nothing has been run yet"
    run_command.execute(run, stages, quiet=True)
    assert not refused()
    assert refused(force=True)
    (toy_workspace / "runs/toy/total/tables_text.txt").write_text("changed")
    assert refused()


def test_terminal_without_our_signs_gets_question_marks(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    content = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(content, encoding="latin-1"))
    code, _, err = auvid(monkeypatch, capsys, "models", "linear")
    assert (code, err) == (0, "")
    print("─── Ω")  # as the page of `auvid check`
    sys.stdout.flush()
    assert content.getvalue().endswith(b"??? ?\n")


def test_closed_output_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    assert auvid(monkeypatch, capsys, "vehicles")[0] == 0


def test_losses_are_named_and_3_when_strict(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert auvid(monkeypatch, capsys, "run", "toy", "--strict")[0] == 0
    for module in (run_command, run_summary):
        monkeypatch.setattr(module, "losses", lambda run: ["log 'a': 3 rejected (depth: NaN)"])
    code, out, _ = auvid(monkeypatch, capsys, "run", "toy", "--strict")
    assert code == 3
    assert "lost (1):\n  log 'a': 3 rejected (depth: NaN)" in out


def test_report_that_is_not_there_says_how_to_get_it(
    toy_workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = auvid(monkeypatch, capsys, "report", "toy")
    assert (code, err.strip()) == (1, "error: there is no report yet; found 'toy'. auvid run toy")
    assert auvid(monkeypatch, capsys, "run", "toy", "--until", "decode")[0] == 0
    _, _, err = auvid(monkeypatch, capsys, "report", "toy")
    assert "its run has ended behind stage decode" in err
    assert "auvid check toy has all findings" in err


def test_stages_are_printed_from_their_declarations(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "240")
    _, out, _ = auvid(monkeypatch, capsys, "stages")
    for stage in STAGES:
        assert f"{stage.name}  {stage.summary}" in out
        for port in (*ports(stage.inputs), *ports(stage.outputs)):
            assert re.search(rf"^ +{port}\b", out, re.MULTILINE)
    code, one, _ = auvid(monkeypatch, capsys, "stages", "resample")
    assert code == 0
    assert re.search(r"rate_hz +Hz +50.0 +0.1 to 10000 ", one)
    assert "fuse" not in one.split()
    code, _, err = auvid(monkeypatch, capsys, "stages", "resampel")
    assert code == 2
    assert "Did you mean 'resample'?" in err


def test_models_and_vehicles_are_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "240")
    _, out, _ = auvid(monkeypatch, capsys, "models")
    for model in MODELS:
        assert re.search(rf"{model.name} .* {model.n_bar} ", out)
    assert "u*|u|" in auvid(monkeypatch, capsys, "models", "fossen")[1]
    assert re.search(r"vt690 .*vt690.yaml", auvid(monkeypatch, capsys, "vehicles")[1])


def test_new_refuses_to_overwrite(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "ws"
    code, out, _ = auvid(monkeypatch, capsys, "new", str(target))
    assert code == 0
    assert "auvid run example" in out
    log = (target / "campaigns" / "example" / "logs" / "synthetic_run.csv").read_bytes()
    assert log == example_log(load_vehicle(TEMPLATES / "vehicles" / "example_rov.yaml").vehicle)
    (target / "params.yaml").write_text("mine")
    code, _, err = auvid(monkeypatch, capsys, "new", str(target))
    assert code == 1
    assert "nothing is overwritten" in err
    assert (target / "params.yaml").read_text() == "mine"


def test_bars_are_for_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    from auvid.pipeline.execution.progress import Bars, ProgressLines

    with show_progress() as plain:
        assert isinstance(plain, ProgressLines)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with show_progress() as bars:
        assert isinstance(bars, Bars)
        bars.stage("decode", todo=1, total=2, level="log")
        bars.item("a")
        bars.finish(failed=1)
        assert bars._bars.tasks[-1].completed == 2


def loaded_by(statements: str) -> set[str]:
    """Return the modules that a fresh Python has after some statements."""
    program = f"{statements}; import sys; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


def test_declarations_of_stages_load_nothing_heavy() -> None:
    """Ports and parameters are read without what only the work needs."""
    loaded = loaded_by("from auvid.stages.registry import STAGES; list(STAGES)")
    assert {stage.run.__module__ for stage in STAGES} <= loaded
    assert not loaded & {"scipy", "pandas", "numba", "rerun", "latex2mathml"}


def test_a_run_loads_the_stages_of_its_kind_alone() -> None:
    loaded = loaded_by(
        "from auvid.pipeline.commands.run import run_command; from auvid.pipeline.graph import"
        " stages_of_kind; from auvid.stages.registry import KINDS, STAGES;"
        " stages_of_kind(STAGES, KINDS, 'identification')"
    )
    others = set(STAGES.names) - set(KINDS["identification"])
    assert {f"auvid.stages.{name}" for name in KINDS["identification"]} <= loaded
    assert not loaded & {f"auvid.stages.{name}" for name in others}


def test_the_page_of_a_fleet_and_its_search_load_no_stage() -> None:
    loaded = loaded_by(
        "import auvid.pipeline.commands.fleet.report.fleet_page,"
        " auvid.pipeline.commands.fleet.queries.find_command"
    )
    assert not loaded & {stage.run.__module__ for stage in STAGES}
    assert not loaded & {"auvid.stages.registry", "scipy", "pandas"}


def test_the_garbage_collector_passes_over_imports_of_a_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gc.unfreeze()
    monkeypatch.setattr("auvid.pipeline.collector._frozen", False)
    with kept_for_good():
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0
    assert gc.get_threshold()[0] == NEW_OBJECTS
    gc.unfreeze()
