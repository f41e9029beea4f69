"""What runs on a worker: a task, if the worker is fit for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from auvid.pipeline.collector import pass_over_imports
from auvid.pipeline.execution.code_stamp import source_hash
from auvid.pipeline.execution.dask.exchange import Exchange
from auvid.pipeline.execution.task import Outcome, Task, execute
from auvid.pipeline.store.package_versions import package_versions


@dataclass(frozen=True)
class Terms:
    """What a worker must agree in with the client, and how they share files.

    `sources`: hash of auvid's own files. `marker`: a file of the client that a worker must
    find, with its content; None with an exchange.
    """

    packages: dict[str, str]
    sources: str
    marker: tuple[Path, str] | None
    exchange: Exchange | None


@dataclass(frozen=True)
class Unfit:
    """A worker that cannot run the tasks of this client, and why."""

    worker: str
    reason: str


def run_task(task: Task, terms: Terms) -> Outcome | Unfit:
    """Run a task on this worker, or return why the worker is unfit for it."""
    from distributed import get_worker

    worker = get_worker()
    pass_over_imports()
    reason = _unfit(terms)
    if reason:
        return Unfit(worker.address, reason)
    if terms.exchange is None:
        return execute(task)
    return terms.exchange.execute(task, Path(worker.local_directory) / "auvid-tasks")


def _unfit(terms: Terms) -> str:
    here = package_versions()
    for name, version in terms.packages.items():
        if here[name] != version:
            return f"{name} {here[name]}, and the client has {version}"
    if _sources() != terms.sources:
        return "another version of auvid: its files differ from the client's"
    if terms.marker is not None:
        path, content = terms.marker
        try:
            if path.read_text(encoding="utf-8") == content:
                return ""
        except OSError:
            pass
        return f"it does not share the folder {path.parent} (--exchange URL needs none)"
    return ""


@cache
def _sources() -> str:
    return source_hash()
