"""One work item: artefacts are written as they come, and taken back after a fault."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import make_table
from auvid.pipeline.execution.task import Task, execute
from auvid.pipeline.execution.task_inputs import ColumnsOnDisk, artefacts_of
from auvid.pipeline.graph import Graph
from auvid.pipeline.store.atomic_files import SYSTEM_REFUSALS
from auvid.pipeline.store.manifest import Manifest
from auvid.stages.base import Collection, Stage, port


@dataclass(frozen=True)
class Inputs:
    pass


@dataclass(frozen=True)
class Params:
    pass


@dataclass(frozen=True)
class Outputs:
    pieces: Collection[pa.Table] = port("samples_depth", many=True)


def task_of(folder: Path, make: Callable[[str], pa.Table]) -> Task:
    """A task whose pieces a, b and c are made when they are needed."""
    pieces = Collection({key: partial(make, key) for key in "abc"})
    stage: Stage[Inputs, Params, Outputs] = Stage(
        name="cut",
        summary="Cut",
        maps_over="campaign",
        inputs=Inputs,
        params=Params,
        outputs=Outputs,
        run=lambda inputs, params: Outputs(pieces),
        no_views="a toy",
    )
    ports = tuple(Graph((stage,)).outputs)
    return Task(stage, "campaign", Params(), {}, ports, folder, "key", "code")


def files(folder: Path) -> list[str]:
    return sorted(path.stem for path in folder.rglob("*") if path.is_file())


def table() -> pa.Table:
    return make_table("samples_depth", {"t_s": np.arange(3.0), "z_m": np.zeros(3)})


def test_each_artefact_is_on_disk_before_the_next_is_made(tmp_path: Path) -> None:
    before: dict[str, list[str]] = {}

    def make(key: str) -> pa.Table:
        before[key] = files(tmp_path)
        return table()

    record = execute(task_of(tmp_path, make)).record
    assert before == {"a": [], "b": ["a"], "c": ["a", "b"]}
    assert record is not None
    assert list(record.outputs["pieces"]) == ["a", "b", "c"]


def test_fault_in_the_middle_leaves_nothing(tmp_path: Path) -> None:
    def make(key: str) -> Any:
        if key == "c":
            raise DataError("no piece")
        return table()

    outcome = execute(task_of(tmp_path, make))
    assert outcome.record is None
    assert "no piece" in str(outcome.fault)
    assert files(tmp_path) == []
    broken = execute(task_of(tmp_path, lambda key: b"" if key == "b" else table()))
    assert "not a table" in str(broken.fault)
    assert files(tmp_path) == []


def test_keys_that_are_no_file_names_are_refused(tmp_path: Path) -> None:
    task = task_of(tmp_path, lambda key: table())
    stage = replace(task.stage, run=lambda inputs, params: Outputs({"../a": table()}))
    assert "cannot be file names" in str(execute(replace(task, stage=stage)).crash)
    assert files(tmp_path) == []


def test_asking_for_a_key_loads_nothing() -> None:
    def load() -> str:
        raise AssertionError("loaded")

    pieces = Collection({"a": load})
    assert "a" in pieces
    assert "b" not in pieces


def test_memory_that_runs_out_is_no_fault_of_auvid(tmp_path: Path) -> None:
    def make(key: str) -> Any:
        raise MemoryError("Unable to allocate 8.21 MiB")

    before = len(SYSTEM_REFUSALS)
    outcome = execute(task_of(tmp_path, make))
    assert [fault.errno for fault in SYSTEM_REFUSALS[before:]] == [errno.ENOMEM]
    assert outcome.crash is None
    assert "8.21 MiB. Raise its limit (ulimit -v), cut long legs" in str(outcome.fault)
    assert files(tmp_path) == []


def test_of_a_table_on_disk_the_columns_of_a_port_are_loaded(tmp_path: Path) -> None:
    """With its clock, and what it lacks is not missed; its content counts as a whole."""
    task = task_of(tmp_path, lambda _: table())
    record = execute(task).record
    assert record is not None
    manifest = Manifest(tmp_path)
    manifest.write({"campaign": record}, ["campaign"])
    artefact = artefacts_of(manifest, task.outputs[0], "campaign")["a"]
    assert artefact.load().column_names == ["t_s", "z_m"]
    part = ColumnsOnDisk(artefact, ("w_m_s",))
    assert part.load().column_names == ["t_s"]
    assert part.fingerprint == artefact.fingerprint
