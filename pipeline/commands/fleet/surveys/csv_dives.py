"""Which CSV files of a folder are of one dive: folders are work items of the engine."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder
from auvid.pipeline.commands.new.log_survey import files_of_dives
from auvid.pipeline.commands.open_run import show_progress
from auvid.pipeline.execution.engines import Engine
from auvid.pipeline.execution.task import Task
from auvid.pipeline.execution.task_inputs import Value
from auvid.pipeline.store.atomic_files import writable, write_atomically
from auvid.pipeline.store.file_hashes import hash_value
from auvid.stages.base import Stage

Files = tuple[Path, ...]
Grouping = Callable[[Sequence[Files]], list[list[Files] | None]]
"""Files of folders -> those of each dive of each folder; None where nothing could tell."""
RESULTS = ".csv_dives"
"""Folder of a fleet, while folders of CSV files are looked at."""


@dataclass(frozen=True)
class Inputs:
    """The CSV files of a folder, and the file that the answer goes to."""

    files: Files
    result: Path


@dataclass(frozen=True)
class Params:
    """Nothing: columns decide."""


@dataclass(frozen=True)
class Outputs:
    """Nothing: the answer is a file that is read once."""


def _run(inputs: Inputs, _: Params) -> Outputs:
    dives = [[path.name for path in files] for files in files_of_dives(inputs.files)]
    write_atomically(inputs.result, json.dumps(dives).encode())
    return Outputs()


GROUP: Stage[Inputs, Params, Any] = Stage(
    "group", "find the CSV files of each dive", "campaign", Inputs, Params, Outputs, _run
)


def grouping(engine: Engine, fleet: FleetFolder) -> Grouping:
    """Return what finds the files of each dive with the workers of an engine."""

    def group(folders: Sequence[Files]) -> list[list[Files] | None]:
        scratch = fleet.root / RESULTS
        with writable(scratch):
            shutil.rmtree(scratch, ignore_errors=True)
            scratch.mkdir(parents=True)
        try:
            tasks = [_task(files, scratch) for files in folders]
            with show_progress() as progress:
                progress.stage("group", todo=len(tasks), total=len(tasks), level="folder")
                for outcome in engine.map(tasks):
                    progress.item(outcome.item)
                progress.finish(failed=0)
            return [
                _dives(files, scratch / task.item)
                for files, task in zip(folders, tasks, strict=True)
            ]
        finally:
            shutil.rmtree(scratch, ignore_errors=True)

    return group


def _task(files: Files, scratch: Path) -> Task:
    key = hash_value([str(path) for path in files])
    result = scratch / key
    sources = {"files": Value(files, key), "result": Value(result, str(result))}
    return Task(GROUP, key, Params(), sources, (), scratch, key, "")


def _dives(files: Files, result: Path) -> list[Files] | None:
    """Return the files of each dive; None where the work on them ended in a fault."""
    try:
        dives = json.loads(result.read_bytes())
    except OSError:
        return None
    folder = files[0].parent
    return [tuple(folder / name for name in names) for names in dives]
