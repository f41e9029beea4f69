"""One work item: load inputs, run the stage, check and write its results.

Runs in any process and never raises.
"""

from __future__ import annotations

import errno
import hashlib
import os
import traceback
import warnings
from collections import Counter
from collections.abc import Generator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.long_series.long_arrays import laid_down_in, let_go
from auvid.pipeline.execution.memory import give_back, use_one_heap
from auvid.pipeline.execution.task_inputs import Log, Source
from auvid.pipeline.graph import AnyStage, Port
from auvid.pipeline.store.array_file import ArrayFile
from auvid.pipeline.store.artefacts import in_pieces
from auvid.pipeline.store.atomic_files import (
    REMEDIES,
    SYSTEM_REFUSALS,
    refusal,
    write_atomically,
)
from auvid.pipeline.store.fingerprints import as_document
from auvid.pipeline.store.manifest import Hashes, Record
from auvid.pipeline.store.package_versions import package_versions

TOO_LONG = "the memory that this process may take is not enough"
SHORTER = (
    "Raise its limit (ulimit -v), cut long legs (start_s, end_s), or lower rate_hz of resample."
)


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
    """Result of a task: a record, a user's fault, or the trace of a fault of auvid."""

    item: str
    record: Record | None = None
    fault: PipelineError | None = None
    crash: str | None = None
    trace: str = ""


def execute(task: Task) -> Outcome:
    """Run one item to its end; all but interruptions is an outcome."""
    use_one_heap()
    try:
        with laid_down_in(ArrayFile(task.folder) if os.name == "posix" else None):
            return Outcome(task.item, record=_run(task))
    except PipelineError as fault:
        return Outcome(task.item, fault=fault)
    except MemoryError as fault:
        SYSTEM_REFUSALS.append(OSError(errno.ENOMEM, TOO_LONG))
        return Outcome(task.item, fault=PipelineError(f"{TOO_LONG}: {fault}", remedy=SHORTER))
    except Exception as crash:
        if isinstance(crash, OSError) and crash.errno in REMEDIES:
            return Outcome(task.item, fault=refusal(crash, "the system refused a file"))
        return Outcome(
            task.item, crash=f"{type(crash).__name__}: {crash}", trace=traceback.format_exc()
        )
    finally:
        give_back()


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
    give_back()
    written: list[Path] = []
    try:
        outputs = {port.name: _write(task, port, results, written) for port in task.outputs}
    except BaseException:
        for path in written:
            with suppress(OSError):  # the fault that counts is the one before
                path.unlink(missing_ok=True)
        raise
    return Record(
        key=task.key,
        code=task.code,
        params=as_document(task.params),
        inputs={name: source.fingerprint for name, source in task.sources.items()},
        outputs={name: hashes for name, hashes in outputs.items() if hashes is not None},
        packages=package_versions(),
        warnings=dict(
            sorted(Counter(f"{item.category.__name__}: {item.message}" for item in caught).items())
        ),
    )


def _check_unchanged(task: Task) -> None:
    for source in task.sources.values():
        if isinstance(source, Log):
            source.check_unchanged()


def _write(task: Task, port: Port, results: Any, written: list[Path]) -> Hashes | None:
    """Write the artefacts of a port as they come, and return their hashes.

    Those of many items are made, checked and written one at a time; their paths are
    added to `written`.
    """
    result, where = getattr(results, port.name), f"output '{port.name}'"

    def put(artefact: Any, key: str | None, name: str) -> str:
        digest = hashlib.sha256()

        def hashed_pieces() -> Generator[bytes]:
            with closing(in_pieces(artefact, port.schema, file=name)) as pieces:
                for piece in pieces:
                    digest.update(piece)
                    let_go()
                    yield piece

        written.append(task.folder / port.path(task.item, key))
        write_atomically(written[-1], hashed_pieces())
        return digest.hexdigest()

    if not port.many:
        return None if result is None else put(result, None, where)
    keys = list(result or ())
    if any("/" in key or key.startswith(".") or not key for key in keys):
        raise ValueError(f"{where} has keys that cannot be file names: {keys}")
    return {key: put(result[key], key, f"{where} of '{key}'") for key in keys}
