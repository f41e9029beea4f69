"""Engines that run work items: one after another here, over processes, or by Dask."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Protocol

from auvid.data_schemas.errors import PipelineError, UsageError, nearest
from auvid.pipeline.collector import pass_over_imports
from auvid.pipeline.execution.task import Outcome, Task, execute
from auvid.stages.registry import STAGES

ENGINES = ("serial", "processes", "dask")
WORK = ("auvid.pipeline.execution.task", *STAGES.modules)
"""Modules that workers of a run need."""
LOGS = (
    "auvid.pipeline.commands.fleet.log_work",
    "auvid.hydro.identification.signals.compiled_filter",
    "auvid.hydro.dynamics.simulation.compiled_free_run",
    "scipy.interpolate",
    "scipy.optimize",
    "scipy.spatial.transform",
)
"""Modules that the workers of a fleet need, imported once for all of them."""


class Engine(Protocol):
    """A way to run tasks; yields their outcomes as they finish.

    `workers`: how many are under way at a time.
    """

    workers: int

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]: ...

    def close(self) -> None: ...


class Serial:
    """One item after the other."""

    workers = 1

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        return map(execute, tasks)

    def close(self) -> None:
        """Nothing to close."""


class Processes:
    """A pool of processes, started by the first stage with several items.

    They come from a fresh interpreter, not from this one, so that a worker has one BLAS
    thread and no state of the parent.
    """

    def __init__(self, jobs: int, preload: Sequence[str] = ()) -> None:
        self.workers = jobs
        if preload and jobs > 1:
            _start_server(preload)
        self._pool: ProcessPoolExecutor | None = None
        self._waiting: dict[Future[Outcome], str] = {}

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        if self.workers < 2 or len(tasks) < 2:
            yield from map(execute, tasks)
            return
        with _starting():
            if self._pool is None:
                self._pool = ProcessPoolExecutor(
                    self.workers,
                    mp_context=_context(),
                    initializer=_begin_worker,
                    initargs=(self.workers,),
                )
            self._waiting = {self._pool.submit(execute, task): task.item for task in tasks}
        for future in as_completed(tuple(self._waiting)):
            item = self._waiting.pop(future)
            try:
                yield future.result()
            except BrokenProcessPool:
                self._pool = None
                yield Outcome(
                    item, crash="a worker process died, perhaps for lack of memory (try --jobs 1)"
                )

    def close(self) -> None:
        """Stop the workers, at once if items are unfinished: no manifest has those."""
        if self._pool is None:
            return
        if self._waiting:
            for worker in (self._pool._processes or {}).values():
                worker.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool, self._waiting = None, {}


def _context(preload: Sequence[str] = WORK) -> multiprocessing.context.BaseContext:
    """Return what starts workers: a server that imports modules first, or each anew."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(preload))  # of no effect once the server runs
    return context


def _start_server(preload: Sequence[str]) -> None:
    """Start the server of workers now: it imports while this process does its own."""
    if _context(preload).get_start_method() == "forkserver":
        from multiprocessing.forkserver import ensure_running

        with _starting():
            ensure_running()


def _begin_worker(workers: int) -> None:
    from auvid.hydro.long_series.threads import share_among

    share_among(workers)
    pass_over_imports()
    _end_with_parent()


def _end_with_parent() -> None:
    """Let this worker end at once when its parent has gone, whatever it is doing."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _starting() -> Iterator[None]:
    """Hold Ctrl-C back while workers start: it is left to the parent.

    Raises `PipelineError` where the system lets none start.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    except (OSError, ImportError) as fault:
        raise PipelineError(
            f"no worker process can be started: {getattr(fault, 'strerror', None) or fault}",
            remedy="Workers need /dev/shm and a folder for temporary files (TMPDIR): see that"
            " both can be written to, or run with --jobs 1.",
        ) from fault
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def make_engine(
    name: str | None = None,
    jobs: int | None = None,
    *,
    scheduler: str | None = None,
    memory: str | None = None,
    exchange: str | None = None,
    preload: Sequence[str] = (),
) -> Engine:
    """Return the engine of a name, with `jobs` workers or one per core.

    More than one job means processes, named or not. Of Dask alone: the address of a
    `scheduler`, `memory` of a worker started here, `exchange` (URL) of its files. `preload`:
    modules that processes begin to import now; none are imported before they are needed.
    """
    of_dask = {"--scheduler": scheduler, "--memory": memory, "--exchange": exchange}
    if name is None:
        several = jobs is not None and jobs > 1
        name = "dask" if any(of_dask.values()) else "processes" if several else "serial"
    if name not in ENGINES:
        raise UsageError(
            "unknown engine", value=name, allowed=ENGINES, remedy=nearest(name, ENGINES)
        )
    if name != "dask":
        for option, value in of_dask.items():
            if value is not None:
                raise UsageError(
                    "is an option of --engine dask",
                    field=option,
                    value=value,
                    allowed="--engine dask",
                )
    if jobs is not None and (jobs < 1 or (name == "serial" and jobs > 1)):
        raise UsageError(
            "does not fit the engine",
            field="--jobs",
            value=jobs,
            allowed="1" if name == "serial" else "1 or more",
        )
    if scheduler and (jobs or memory):
        raise UsageError(
            "the workers of a scheduler are started with their own number and memory",
            field="--jobs" if jobs else "--memory",
            value=jobs or memory,
            remedy="dask worker ADDRESS --nworkers N --nthreads 1 --memory-limit SIZE",
        )
    workers = jobs if jobs is not None else (os.cpu_count() or 1)
    if name == "serial":
        return Serial()
    if name == "processes":
        return Processes(workers, preload)
    from auvid.pipeline.execution.dask.engine import Dask

    return Dask(workers, scheduler, memory, exchange)
