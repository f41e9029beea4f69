"""One work item: load inputs, run the stage, check and write its results.

Runs in any process and never raises.
"""

from __future__ import annotations

import traceback
import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.execution.task_inputs import Log, Source
from auvid.pipeline.graph import AnyStage, Port
from auvid.pipeline.store.artefacts import encode
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.pipeline.store.fingerprints import as_document, hash_bytes, package_versions
from auvid.pipeline.store.manifest import Hashes, Record


@dataclass(frozen=True)
class Task:
    """What is needed to run one item.

    `folder` is that of the stage; `key` stands for all that the result depends on.
    """

    stage: AnyStage
    item: str
    params: Any
    sources: Mapping[str, Source]
    outputs: tuple[Port, ...]
    folder: Path
    key: str
    code: str


@dataclass(frozen=True)
class Outcome:
    """The result of a task: a record, a user's fault, or the trace of a fault of auvid."""

    item: str
    record: Record | None = None
    fault: PipelineError | None = None
    crash: str | None = None
    trace: str = ""


def execute(task: Task) -> Outcome:
    """Run one item to its end; all but interruptions is an outcome."""
    try:
        return Outcome(task.item, record=_run(task))
    except PipelineError as fault:
        return Outcome(task.item, fault=fault)
    except Exception as crash:
        return Outcome(
            task.item, crash=f"{type(crash).__name__}: {crash}", trace=traceback.format_exc()
        )


def _run(task: Task) -> Record:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            inputs = task.stage.inputs(
                **{name: source.load() for name, source in task.sources.items()}
            )
            results = task.stage.run(inputs, task.params)
        except PipelineError:
            _check_unchanged(task)  # half a file gives strange faults
            raise
    _check_unchanged(task)
    contents = {port.name: _contents(port, getattr(results, port.name)) for port in task.outputs}
    return Record(
        key=task.key,
        code=task.code,
        params=as_document(task.params),
        inputs={name: source.fingerprint for name, source in task.sources.items()},
        outputs={
            name: hashes
            for port in task.outputs
            if (hashes := _write(port, contents[name := port.name], task)) is not None
        },
        packages=package_versions(),
        warnings=dict(
            sorted(Counter(f"{item.category.__name__}: {item.message}" for item in caught).items())
        ),
    )


def _check_unchanged(task: Task) -> None:
    for source in task.sources.values():
        if isinstance(source, Log):
            source.check_unchanged()


def _contents(port: Port, result: Any) -> dict[str | None, bytes]:
    """Return the bytes of a port's artefacts by key, None for a single one.

    All are made and checked before the first is written.
    """
    where = f"output '{port.name}'"
    if result is None:
        return {}
    if not port.many:
        return {None: encode(result, port.schema, file=where)}
    if any("/" in key or key.startswith(".") or not key for key in result):
        raise ValueError(f"{where} has keys that cannot be file names: {list(result)}")
    return {
        key: encode(artefact, port.schema, file=f"{where} of '{key}'")
        for key, artefact in result.items()
    }


def _write(port: Port, contents: Mapping[str | None, bytes], task: Task) -> Hashes | None:
    hashes: dict[str, str] = {}
    for key, content in contents.items():
        write_atomically(task.folder / port.path(task.item, key), content)
        hashes[key or ""] = hash_bytes(content)
    if port.many:
        return hashes
    return hashes.get("")
