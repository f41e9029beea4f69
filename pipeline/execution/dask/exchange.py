"""Files that client and workers exchange by content, where they share no folder.

Anything that fsspec can write to serves: a folder, or an object store (s3://...). A
file lies there under its SHA-256, so that none is sent twice and none can be mistaken.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from uuid import uuid4

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.execution.task import Outcome, Task, execute
from auvid.pipeline.execution.task_inputs import Artefact, Log, Many, Source
from auvid.pipeline.store.file_hashes import hash_file


@dataclass(frozen=True)
class Exchange:
    """A place for files by content; `url` as fsspec takes it (s3://bucket/folder)."""

    url: str

    def put(self, path: Path, digest: str) -> None:
        """Copy a file there, unless its content is there already."""
        system, root = self._opened()
        target = f"{root}/{digest[:2]}/{digest}"
        if system.exists(target):
            return
        system.makedirs(f"{root}/{digest[:2]}", exist_ok=True)
        part = f"{target}.{uuid4().hex}"
        system.put_file(str(path), part)
        system.mv(part, target)

    def get(self, digest: str, path: Path) -> None:
        """Copy a file from there. Raises `PipelineError` for another content."""
        if path.is_file() and hash_file(path) == digest:
            return
        system, root = self._opened()
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}.{uuid4().hex}")
        try:
            system.get_file(f"{root}/{digest[:2]}/{digest}", str(part))
            if hash_file(part) != digest:
                raise PipelineError(
                    "a file of the exchange is not what its name says",
                    file=f"{self.url}/{digest[:2]}/{digest}",
                    remedy="Remove the file and run again.",
                )
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)

    def _opened(self) -> tuple[Any, str]:
        from fsspec.core import url_to_fs

        try:
            system, root = url_to_fs(self.url)
        except (ImportError, ValueError) as fault:
            raise PipelineError(
                f"no exchange: {fault}",
                field="--exchange",
                value=self.url,
                remedy="A folder, or a URL that fsspec knows (for s3:// install s3fs).",
            ) from fault
        return system, str(root).rstrip("/")

    def send_inputs(self, task: Task) -> None:
        """Put every file that a task reads."""
        for source in task.sources.values():
            for path, digest in _files(source):
                self.put(path, digest)

    def execute(self, task: Task, scratch: Path) -> Outcome:
        """Run a task in a folder of this worker, and put what it gives.

        Inputs are kept in the folder for the tasks to come.
        """
        folder = scratch / f"task-{uuid4().hex}"
        kept = scratch / "inputs"
        try:
            for source in task.sources.values():
                for _, digest in _files(source):
                    self.get(digest, kept / digest)
            sources = {name: _moved(source, kept) for name, source in task.sources.items()}
            outcome = execute(replace(task, sources=sources, folder=folder))
            if outcome.record is not None:
                for path, digest in _results(replace(task, folder=folder), outcome):
                    self.put(path, digest)
            return outcome
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def fetch_results(self, task: Task, outcome: Outcome) -> None:
        """Get every file that a task gave, to where the task names it."""
        for path, digest in _results(task, outcome):
            self.get(digest, path)


def _files(source: Source) -> list[tuple[Path, str]]:
    """Return the files of an input with their hashes."""
    if isinstance(source, Artefact):
        return [(source.path, source.hash)]
    if isinstance(source, Many):
        return [(entry.path, entry.hash) for entry in source.entries.values()]
    if isinstance(source, Log):
        return [(part.file.path, part.hash) for part in source.parts]
    return []


def _moved(source: Source, kept: Path) -> Source:
    """Return an input whose files lie in a folder under their hashes."""
    if isinstance(source, Artefact):
        return replace(source, path=kept / source.hash)
    if isinstance(source, Many):
        return Many(
            {name: replace(each, path=kept / each.hash) for name, each in source.entries.items()}
        )
    if isinstance(source, Log):
        parts = []
        for part in source.parts:
            path = kept / part.hash
            changed_ns = path.stat().st_mtime_ns
            parts.append(replace(part, file=replace(part.file, path=path), changed_ns=changed_ns))
        return replace(source, parts=tuple(parts))
    return source


def _results(task: Task, outcome: Outcome) -> list[tuple[Path, str]]:
    """Return the files that a task gave, with their hashes."""
    assert outcome.record is not None
    ports = {port.name: port for port in task.outputs}
    files = []
    for name, hashes in outcome.record.outputs.items():
        by_key = {None: hashes} if isinstance(hashes, str) else hashes
        files += [
            (task.folder / ports[name].path(task.item, key), digest)
            for key, digest in by_key.items()
        ]
    return files
