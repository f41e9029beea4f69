"""Every file operation of a run killed, torn or refused; then the run is repeated.

    python -m tests.faults.disk_faults [--every N] [--example] [--record FILE] [--seconds N]

A run of the toy stages (or, with `--example`, of the short example of a new workspace)
replaces the results of an older one. Each operation under `runs/` is a place. At each
N-th place, in a process of its own, each fault of `FAULTS` strikes; afterwards

- a refusal has been named in words of the system, and is no fault of auvid,
- no manifest vouches for a file that is not as it says,
- a second run without fault leaves the files of a clean run, and no others.

With `--record` the cases tried are kept in a file, and a campaign that `--seconds`
stopped goes on.
"""

from __future__ import annotations

import argparse
import builtins
import errno
import hashlib
import io
import json
import os
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.run.run_command import execute
from auvid.pipeline.execution import runner
from auvid.pipeline.execution.engines import Serial
from auvid.pipeline.graph import select
from auvid.pipeline.store.manifest import Manifest
from tests.support import toy_stages

REFUSALS = ("ENOSPC", "EIO", "EACCES", "EDQUOT")
FAULTS = ("kill", "torn", *REFUSALS, "ENOSPC for good")
OF_A_PATH = ("mkdir", "rmdir", "unlink", "replace", "scandir", "open")
OF_A_HANDLE = ("fsync", "ftruncate", "pwrite", "fchmod")
OURS = {".lock", ".hashes.json", ".stamp"}
"""Files of a run folder that need not be the same after each run."""
UNFAULTED = -1


class Faults:
    """Counts the file operations under a folder, and lets a fault strike at one."""

    def __init__(self, folder: Path, place: int, fault: str) -> None:
        self.folder, self.place, self.fault = str(folder), place, fault
        self.count = 0

    def strike(self, name: object, torn: Callable[[], object] | None = None) -> None:
        """Count an operation; at its place, die or refuse. `torn` does half of it."""
        self.count += 1
        later = self.fault.endswith("for good") and self.count > self.place >= 0
        if self.count != self.place and not later:
            return
        if torn is not None and self.fault != "kill":
            torn()
        if self.fault in ("kill", "torn"):
            os.kill(os.getpid(), signal.SIGKILL)
        number = getattr(errno, self.fault.partition(" ")[0])
        raise OSError(number, os.strerror(number), str(name))

    def concerns(self, name: object) -> bool:
        """Return whether a path lies under the folder."""
        return isinstance(name, str | os.PathLike) and str(name).startswith(self.folder)


class Writing:
    """A file open for writing whose operations count."""

    def __init__(self, file: Any, faults: Faults) -> None:
        self._file, self._faults = file, faults

    def write(self, content: bytes) -> int:
        def half() -> None:
            self._file.write(content[: len(content) // 2])
            self._file.flush()

        self._faults.strike(self._file.name, half)
        return int(self._file.write(content))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> Writing:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


@contextmanager
def faulty(faults: Faults) -> Iterator[None]:
    """Let every file operation of this process under the folder pass through `faults`."""
    true_open = io.open

    def opened(name: Any, mode: str = "r", *more: Any, **named: Any) -> Any:
        if not faults.concerns(name):
            return true_open(name, mode, *more, **named)
        faults.strike(name)
        file = true_open(name, mode, *more, **named)
        return Writing(file, faults) if "w" in mode else file

    def counted(name: str) -> Callable[..., Any]:
        true = getattr(os, name)

        def call(first: Any, *more: Any, **named: Any) -> Any:
            if name in OF_A_HANDLE or faults.concerns(first):
                faults.strike(first)
            return true(first, *more, **named)

        return call

    with mock.patch.object(io, "open", opened), mock.patch.object(builtins, "open", opened):
        names = (*OF_A_PATH, *OF_A_HANDLE)
        with mock.patch.multiple(os, **{name: counted(name) for name in names}):
            yield


@dataclass(frozen=True)
class Case:
    """A workspace with results of an older run, and what runs in it."""

    workspace: Path
    run: Callable[[Path], object]


def run_toys(workspace: Path) -> None:
    runs = workspace / "runs"
    runner.write_code_files(toy_stages.STAGES, runs / ".code")
    run = toy_stages.open_run(workspace / "toy", runs, decode={"scale": 2.0})
    run.execute(run.graph.stages, Serial())


def toy_case(folder: Path) -> Case:
    """Two logs, three legs; since the older run a leg was taken out and a parameter changed."""
    campaign = toy_stages.write_campaign(folder / "toy")
    run = toy_stages.open_run(campaign, folder / "runs")
    run.execute(run.graph.stages, Serial())
    left_out = "  - {id: three, log: b, use: validation}\n"
    (campaign / "campaign.yaml").write_text(toy_stages.MANIFEST.replace(left_out, ""))
    return Case(folder, run_toys)


def run_example(workspace: Path) -> None:
    os.chdir(workspace)
    run = open_run("example")
    execute(run, select(run.graph))


def example_case(folder: Path) -> Case:
    """The short example with report and history; since the older run a parameter changed."""
    from tests.support.campaign_runs import write_short_example

    folder.mkdir()
    write_short_example(folder)
    run_example(folder)
    manifest = folder / "campaigns/example/campaign.yaml"
    manifest.write_text(manifest.read_text().replace("cutoff_hz: 2.0", "cutoff_hz: 1.0"))
    return Case(folder, run_example)


def in_a_process(work: Callable[[], str]) -> str:
    """Return what `work` says in a process of its own; "killed" if it did not end."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        try:
            words = work()
        except BaseException:
            words = f"internal: {traceback.format_exc()}"
        os.write(writer, words.encode()[-60_000:])
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        outcome = pipe.read().decode()
    os.waitpid(child, 0)
    return outcome or "killed"


def attempt(case: Case, workspace: Path, faults: Faults) -> str:
    """Run the case in a workspace under faults; return how it ended in a word or words."""

    def work() -> str:
        sys.stdout = sys.stderr = io.StringIO()
        try:
            with faulty(faults):
                case.run(workspace)
        except PipelineError as fault:
            return f"refused: {fault}"
        except OSError as fault:
            if faults.fault in ("kill", "torn"):
                raise
            return f"refused: {fault}"  # the command line words these: test_cli
        return f"fine: {faults.count}"

    return in_a_process(work)


def files(workspace: Path) -> dict[str, str]:
    """Return the hash of every file under runs/, by path."""
    return {
        str(path.relative_to(workspace)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((workspace / "runs").rglob("*"))
        if path.is_file() and path.name not in OURS
    }


def comparable(contents: dict[str, str]) -> dict[str, str]:
    """Return files without what differs from run to run: the recording, and the history."""
    return {
        name: "" if "/recording.rrd" in name or "report/manifest" in name or "/history/" in name
        else content
        for name, content in contents.items()
    }  # fmt: skip


def falsely_vouched(workspace: Path) -> list[str]:
    """Return artefacts that a manifest names and that are not as it says."""
    wrong = []
    for path in (workspace / "runs").glob("*/*/manifest.json"):
        hashes_there = {
            hashlib.sha256(file.read_bytes()).hexdigest()
            for file in path.parent.rglob("*")
            if file.is_file()
        }
        for item, record in Manifest(path.parent).records.items():
            for port, hashes in record.outputs.items():
                named = {hashes} if isinstance(hashes, str) else set(hashes.values())
                if not named <= hashes_there:
                    wrong.append(f"{path.parent.name}, {item}: {port}")
    return wrong


def strike(case: Case, clean: dict[str, str], folder: Path, place: int, fault: str) -> str | None:
    """Let a fault strike at a place; return what is wrong afterwards, or None."""
    workspace = folder / f"{place}_{fault.replace(' ', '_')}"
    shutil.copytree(case.workspace, workspace, symlinks=True)
    runs = workspace / "runs"
    outcome = attempt(case, workspace, Faults(runs, place, fault))
    wrong = []
    # How many pieces a recording comes in differs, so a late place may not be reached.
    is_reached = not outcome.startswith("fine") or int(outcome.split()[1]) >= place
    struck = (outcome == "killed") == (fault in ("kill", "torn"))
    if outcome.startswith("internal") or (is_reached and not struck):
        wrong.append(outcome)
    named = [os.strerror(getattr(errno, name)) for name in REFUSALS]
    if outcome.startswith("refused") and not any(
        words in outcome for words in (*named, "no permission")
    ):
        wrong.append(f"not named: {outcome}")
    if vouched := falsely_vouched(workspace):
        wrong.append(f"vouched for: {vouched}")
    again = attempt(case, workspace, Faults(runs, UNFAULTED, fault))
    if not again.startswith("fine"):
        wrong.append(f"the second run: {again}")
    left, expected = comparable(files(workspace)), comparable(clean)
    names = sorted({name for name in {*left, *expected} if left.get(name) != expected.get(name)})
    if names:
        wrong.append(f"other files: {names}")
    shutil.rmtree(workspace)
    return f"place {place}, {fault}: {'; '.join(wrong)}" if wrong else None


def cases(places: int, every: int, first: int) -> Iterator[tuple[int, str]]:
    """Yield places and faults: each N-th place is tried.

    Faults take turns: where not every place is tried, each place has one of them.
    """
    for turn, place in enumerate(range(first, places + 1, every)):
        for fault in FAULTS if every == 1 else (FAULTS[turn % len(FAULTS)],):
            yield place, fault


def campaign(case: Case, folder: Path, options: argparse.Namespace) -> dict[str, object]:
    """Return places of a case, faults tried and left, and what went wrong."""
    work = folder / "clean"
    shutil.copytree(case.workspace, work, symlinks=True)
    outcome = attempt(case, work, Faults(work / "runs", UNFAULTED, "none"))
    assert outcome.startswith("fine"), outcome
    places, clean = int(outcome.split()[1]), files(work)
    record: Path | None = options.record
    lines = record.read_text().splitlines() if record and record.is_file() else []
    tried: dict[tuple[int, str], str | None] = {
        (place, fault): wrong for place, fault, wrong in map(json.loads, lines)
    }
    left, end = 0, time.monotonic() + options.seconds
    for place, fault in cases(places, options.every, options.first):
        if (place, fault) in tried:
            continue
        if time.monotonic() > end:
            left += 1
            continue
        tried[place, fault] = wrong = strike(case, clean, folder, place, fault)
        if record:
            with record.open("a") as file:
                file.write(json.dumps([place, fault, wrong]) + "\n")
    faults = [wrong for wrong in tried.values() if wrong is not None]
    return {"places": places, "tried": len(tried), "left": left, "wrong": faults}


def main() -> None:
    """Run the campaign of the command line and print its result as JSON."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--every", type=int, default=1)
    options.add_argument("--first", type=int, default=1)
    options.add_argument("--example", action="store_true")
    options.add_argument("--record", type=Path, help="file of the cases tried; those are left out")
    options.add_argument("--seconds", type=float, default=float("inf"), help="stop after these")
    chosen = options.parse_args()
    chosen.record = chosen.record and chosen.record.absolute()  # runs change the folder
    with tempfile.TemporaryDirectory(prefix="auvid_disk_") as name:
        folder = Path(name)
        make = example_case if chosen.example else toy_case
        result = campaign(make(folder / "base"), folder, chosen)
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
