"""`auvid fleet run`: every log of a disk, from its bytes to a model."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.records.fleet import FleetRun, LogSurvey
from auvid.pipeline.commands.fleet.discovery import Discovery, FleetLog, discover
from auvid.pipeline.commands.fleet.dive_reports import draw_reports
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder
from auvid.pipeline.commands.fleet.fleet_tables import FleetMemory, FleetRow, GrowingTables
from auvid.pipeline.commands.fleet.log_work import (
    MARK,
    SURVEY,
    code_hash,
    document_path,
    failed,
    one_line,
    run_task,
    survey_task,
    unfinished,
)
from auvid.pipeline.commands.fleet.surveys.csv_dives import grouping
from auvid.pipeline.commands.fleet.surveys.same_dives import (
    Compared,
    SameDive,
    refusals,
    same_dives,
    with_clocks,
)
from auvid.pipeline.commands.open_run import show_progress
from auvid.pipeline.execution.engines import Engine, make_engine
from auvid.pipeline.execution.lock import locked
from auvid.pipeline.execution.progress import Progress
from auvid.pipeline.execution.task import Outcome, Task, execute
from auvid.pipeline.output import FAILED, FINE, LOSSES, OUTPUT, answer, note
from auvid.pipeline.store.artefacts import encode
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.pipeline.store.file_hashes import HASHES, FileHashes, hash_value
from auvid.pipeline.terminal import path_from_here, plain, table
from auvid.stages.ingest.health.finding import counted

STATES = ("done", "partly", "refused")
DIED = (
    "the process that worked on it died twice, the second time with no other log beside it,"
    " perhaps for lack of memory; the next auvid fleet run tries it again"
)
LISTED = 20
COMPARED = ".compared.json"
"""File of a fleet: keys of the surveys compared, and in words which agree."""


@dataclass(frozen=True)
class FleetOutcome:
    """What a call of `auvid fleet run` did, and the state of each log."""

    rows: tuple[FleetRow, ...]
    surveyed: int
    ran: int
    others: Mapping[str, int]


def run_fleet(
    target: Path,
    out: Path,
    *,
    vehicles: Sequence[str] = (),
    engine: Engine | None = None,
    reports: bool = False,
    force: bool = False,
) -> FleetOutcome:
    """Bring the fleet in folder `out` up to date with the logs of a disk.

    `engine`: closed at the end; None works here, one log after another. `reports`: draw
    page and recording of each dive too. Raises `PipelineError` for what concerns the call
    itself; whatever a log does ends as the state of that log.
    """
    engine = engine or make_engine()
    try:
        outcome = _run_fleet(target, out, vehicles, engine, force=force)
        if reports:
            for fault in draw_reports(FleetFolder(out.expanduser().resolve()), None, engine):
                note(fault)
        return outcome
    finally:
        engine.close()


def _run_fleet(
    target: Path, out: Path, vehicles: Sequence[str], engine: Engine, *, force: bool
) -> FleetOutcome:
    fleet = FleetFolder(out.expanduser().resolve())
    hashes = FileHashes(fleet.root / HASHES)
    disk = discover(target, fleet, vehicles, hashes, grouping(engine, fleet))
    with locked(fleet.root):
        fleet.prepare()
        hashes.save()
        logs = {log.id: log for log in disk.logs}
        unique = [log for log in disk.logs if not log.copy_of]
        tasks = {log.id: survey_task(log, fleet) for log in unique}
        memory = FleetMemory(fleet, hashes, code_hash())
        surveyed = _bring("survey", tasks, logs, engine, memory, force=force)
        surveys = {log: memory.read(LogSurvey, document_path(task)) for log, task in tasks.items()}
        names = {log.id: log.paths[0] for log in disk.logs}
        reasons = {item.id: item.reason for item in surveys.values() if item.reason}
        same = _same_dives(fleet, list(surveys.values()))
        reasons |= refusals(same, names)
        surveys = with_clocks(surveys, same)
        runs = {log.id: run_task(log, fleet, hashes) for log in unique if log.id not in reasons}
        ran = _bring("run", runs, logs, engine, memory, force=force)
        better = {pair.other: pair.better for pair in same}
        rows = []
        tables = GrowingTables(fleet, memory)
        for log in disk.logs:
            first = log.copy_of or log.id
            survey, run = surveys[first], runs.get(log.id)
            if log.copy_of:
                reason = f"the same content as {logs[log.copy_of].paths[0]}"
            else:
                reason = reasons.get(log.id, "")
            used = log.copy_of or better.get(log.id, "")
            documents = [tasks[first], *([] if run is None else [run])]
            document_hashes = [memory.hash_of(document_path(task)) for task in documents]
            made_of = hash_value([log.paths, used, reason, survey.start_utc, document_hashes])
            kept_outcome = tables.take(log.id, made_of)
            outcome = kept_outcome or _outcome_of_run(log, run, reason, memory)
            row = FleetRow(log.id, log.paths, used, survey, outcome)
            if kept_outcome is None:
                tables.add(row, made_of)
            rows.append(row.outline)
        _write_index(fleet, target, disk, rows)
        tables.write()
        hashes.save()
    return FleetOutcome(tuple(rows), surveyed, ran, disk.others)


def _outcome_of_run(log: FleetLog, run: Task | None, reason: str, memory: FleetMemory) -> FleetRun:
    """Return what the run of a log came to; `reason`: why it has none."""
    if run is None:
        return unfinished(log.id, "", one_line(reason))
    return memory.read(FleetRun, document_path(run))


def _same_dives(fleet: FleetFolder, surveys: Sequence[LogSurvey]) -> list[SameDive]:
    """Return the pairs of logs of one dive; those of an earlier call are remembered."""
    memory = fleet.root / COMPARED
    try:
        document = json.loads(memory.read_bytes())
    except (OSError, ValueError):
        document = {"keys": [], "words": []}
    compared = Compared(set(document["keys"]), {(a, b): text for a, b, text in document["words"]})
    pairs = same_dives(surveys, compared)
    words = [[*keys, text] for keys, text in sorted(compared.words.items())]
    after = {"keys": sorted(compared.keys), "words": words}
    if after != document:
        write_atomically(memory, json.dumps(after).encode())
    return pairs


def _bring(
    name: str,
    tasks: Mapping[str, Task],
    logs: Mapping[str, FleetLog],
    engine: Engine,
    memory: FleetMemory,
    *,
    force: bool,
) -> int:
    """Make the documents of tasks that are not there, and return how many those were.

    A document is fresh that bears the key of its task. It is written by the process
    that made it, so that nothing of it is lost with this one, nor stays in it.
    """
    stale = [task for task in tasks.values() if force or not _is_fresh(task, memory)]
    with show_progress() as progress:
        progress.stage(name, todo=len(stale), total=len(tasks), level="log")
        suspected = {task.item for task in stale if _mark(task).exists()}
        try:
            _make(stale, engine, logs, progress)
        except (KeyboardInterrupt, PipelineError):
            engine.close()
            for task in stale:
                if task.item not in suspected:  # the user ended its process, or the cluster went
                    _mark(task).unlink(missing_ok=True)
            raise
        progress.finish(failed=0)
    return len(stale)


def _is_fresh(task: Task, memory: FleetMemory) -> bool:
    """Return whether a task has its document, and no process died on it since."""
    path, survey = document_path(task), task.stage is SURVEY
    key = memory.key_of(LogSurvey, path) if survey else memory.key_of(FleetRun, path)
    return key == task.key and not _mark(task).exists()


def _make(
    tasks: Sequence[Task], engine: Engine, logs: Mapping[str, FleetLog], progress: Progress
) -> None:
    """Run tasks until each has its document.

    Where a process dies, the logs that it held run alone, the others go on.
    """
    by_item = {task.item: task for task in tasks}
    suspects = [task for task in tasks if _mark(task).exists()]  # an earlier call died on them
    suspected = {task.item for task in suspects}
    waiting = [task for task in tasks if task.item not in suspected]
    while waiting:
        lost = []
        for outcome in engine.map(waiting):
            task = by_item[outcome.item]
            if outcome.crash is not None and not outcome.trace:
                lost.append(task)
                continue
            _settle(task, outcome, logs[task.item])
            progress.item(task.item)
        suspects += [task for task in lost if _mark(task).exists()]
        again = [task for task in lost if not _mark(task).exists()]
        if len(again) == len(waiting):  # no process stays alive, not even one without a log
            suspects, again = [*suspects, *again], []
        waiting = again
    for task in suspects:
        _settle(task, _run_alone(task), logs[task.item])
        progress.item(task.item)


def _mark(task: Task) -> Path:
    return task.folder / task.item / MARK


def _run_alone(task: Task) -> Outcome:
    """Run a task in a process of its own, which may die."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        try:
            return pool.submit(execute, task).result()
        except BrokenProcessPool:
            return Outcome(task.item, crash=DIED)


def _settle(task: Task, outcome: Outcome, log: FleetLog) -> None:
    """Write the document of a task that failed in the place of its own.

    It is tried again by the next call: nothing of the log itself ends a task so.
    """
    if outcome.record is not None:
        return
    reason = str(outcome.fault) if outcome.crash is None else outcome.crash
    if outcome.trace:
        reason = f"a fault of auvid: {outcome.crash}"
    (port,) = task.outputs
    document = failed(task, log, reason)
    write_atomically(document_path(task), encode(document, port.schema, file=log.id))


def _write_index(
    fleet: FleetFolder, target: Path, disk: Discovery, rows: Sequence[FleetRow]
) -> None:
    document = {
        "disk": str(target.expanduser().absolute()),
        "others": dict(disk.others),
        "logs": [
            {"log": row.log, "files": list(row.files), "same_as": row.same_as} for row in rows
        ],
    }
    write_atomically(fleet.index, json.dumps(document, indent=1).encode())


def print_fleet_run(
    target: Path,
    out: Path,
    *,
    vehicles: Sequence[str] = (),
    engine: Engine | None = None,
    reports: bool = False,
    force: bool = False,
) -> int:
    """Bring a fleet up to date, print the states, and return the exit code.

    The code is 0 where every log is done, 3 where some are not, 1 where none is.
    """
    outcome = run_fleet(target, out, vehicles=vehicles, engine=engine, reports=reports, force=force)
    counts = Counter(row.state for row in outcome.rows)
    answer(
        {
            "folder": out,
            "states": {state: counts[state] for state in STATES},
            "surveyed": outcome.surveyed,
            "ran": outcome.ran,
            "other_files": dict(outcome.others),
            "logs": [
                {
                    "log": row.log,
                    "files": list(row.files),
                    "state": row.state,
                    "reason": row.result.reason,
                    "vehicle": row.survey.vehicle,
                    "kind": row.survey.kind,
                    "model": row.result.model,
                }
                for row in outcome.rows
            ],
        }
    )
    words = ", ".join(f"{counts[state]} {state}" for state in STATES)
    logs = counted(len(outcome.rows), "log")
    print(f"{logs}: {words} ({outcome.surveyed} read, {outcome.ran} run now)")
    rest = [row for row in outcome.rows if row.state != "done"]
    printed = rest if OUTPUT.verbose else rest[:LISTED]
    rows = []
    for row in printed:
        rows.append((row.state, Path(row.files[0]).name, plain(row.result.reason)))
        rows += [("", "", plain(words)) for words in row.survey.routes if OUTPUT.verbose]
    if rows:
        print()
    table(("state", "log", "why"), rows)
    if len(rest) > len(printed):
        print(f"... and {len(rest) - len(printed)} more: --verbose")
    if outcome.others:
        others = ", ".join(f"{count} {suffix}" for suffix, count in sorted(outcome.others.items()))
        print(f"\nno logs: {others}")
    print(f"\n    auvid fleet report {path_from_here(out.expanduser().resolve())} --open\n")
    if not counts["done"]:
        return FAILED
    return FINE if counts["done"] == len(outcome.rows) else LOSSES
