"""The engine that gives tasks to a Dask cluster: one of this machine, or any other.

Scheduling, lost workers, memory limits and the dashboard are Dask's.
"""

from __future__ import annotations

import logging
import sys
import tempfile
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any
from urllib.request import urlopen
from uuid import uuid4

from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.pipeline.execution.code_stamp import source_hash
from auvid.pipeline.execution.dask import pickled
from auvid.pipeline.execution.dask.exchange import Exchange
from auvid.pipeline.execution.dask.worker import Terms, Unfit
from auvid.pipeline.execution.task import Outcome, Task
from auvid.pipeline.output import OUTPUT
from auvid.pipeline.store.package_versions import package_versions

CONNECT_S = 10.0
"""A scheduler that does not answer for so long is not there."""
ANSWER_S = 3.0
WATCHING = {
    "worker.profile.enabled": False,
    "admin.tick.interval": "500ms",
    "admin.tick.cycle": "10s",
    "admin.system-monitor.interval": "2s",
    "worker.memory.monitor-interval": "500ms",
}
"""How often workers of this machine look at themselves (names within `distributed`): as Dask
comes, a worker of long tasks takes 19 % of CPU for that, and its scheduler 15 %.
"""
LEAST_BYTES = 200e6
"""A process with its libraries takes more."""
DEATHS = 3
"""A task is given up when so many workers died on it: it may be what kills them."""


class Dask:
    """Workers of a Dask cluster, started or connected to by the first tasks.

    `scheduler`: address of a scheduler; None starts `jobs` workers on this machine, of
    `memory` (as "1.2GB") each. `exchange`: where files go if workers share no folder with
    this machine.
    """

    def __init__(
        self,
        jobs: int,
        scheduler: str | None = None,
        memory: str | None = None,
        exchange: str | None = None,
    ) -> None:
        self.workers = 1 if scheduler else jobs
        self._scheduler, self._memory = scheduler, memory
        self._exchange = Exchange(exchange) if exchange else None
        self._client: Any = None
        self._cluster: Any = None
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._unfit: dict[str, str] = {}

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        if not tasks:
            return
        client = self._connected()
        marker = None if self._exchange else _marker(tasks[0].folder)
        terms = Terms(package_versions(), source_hash(), marker, self._exchange)
        try:
            waiting = {self._submitted(client, task, terms): task for task in tasks}
            completed = distributed().as_completed(list(waiting))
            for future in completed:
                task = waiting.pop(future)
                result = self._result(future, task)
                future.release()
                if isinstance(result, Unfit):
                    self._leave_out(result)
                    again = self._submitted(client, task, terms)
                    waiting[again] = task
                    completed.add(again)
                    continue
                if self._exchange is not None and result.record is not None:
                    self._exchange.fetch_results(task, result)
                yield result
        finally:
            if marker is not None:
                marker[0].unlink(missing_ok=True)

    def _submitted(self, client: Any, task: Task, terms: Terms) -> Any:
        if self._exchange is not None:
            self._exchange.send_inputs(task)
        fit = None
        if self._unfit:
            fit = [name for name in client.scheduler_info(-1)["workers"] if name not in self._unfit]
            if not fit:
                raise PipelineError(
                    "no worker can run these tasks: "
                    + "; ".join(sorted(set(self._unfit.values()))),
                    remedy="Install the same auvid on the workers as here.",
                )
        name = f"{task.stage.name} {task.item} {uuid4().hex}"
        work = import_module("cloudpickle").dumps((task, terms))
        return client.submit(pickled.run_pickled, work, key=name, pure=False, workers=fit)

    def _result(self, future: Any, task: Task) -> Outcome | Unfit:
        dask = distributed()
        try:
            result = future.result()
            return result if isinstance(result, Outcome | Unfit) else Unfit(*result)
        except dask.KilledWorker:
            return Outcome(
                task.item,
                crash=f"{DEATHS} workers died on it, perhaps for lack of memory (--memory)",
            )
        except (dask.CancelledError, OSError) as fault:
            raise PipelineError(
                "the scheduler has gone away",
                value=self._scheduler or "of this machine",
                remedy="What was finished is kept: start the scheduler and run again.",
            ) from fault
        except Exception as crash:
            return Outcome(task.item, crash=f"{type(crash).__name__}: {crash}")

    def _leave_out(self, unfit: Unfit) -> None:
        if unfit.worker not in self._unfit:
            self._unfit[unfit.worker] = unfit.reason
            _say(f"worker {unfit.worker} is left out: {unfit.reason}")

    def _connected(self) -> Any:
        if self._client is not None:
            return self._client
        dask = distributed()
        settings = {
            "distributed.comm.timeouts.connect": CONNECT_S,
            "distributed.scheduler.allowed-failures": DEATHS,
            **{f"distributed.{name}": value for name, value in WATCHING.items()},
        }
        import_module("dask.config").set(settings)
        import_module("cloudpickle").register_pickle_by_value(pickled)
        for name in logging.root.manager.loggerDict:
            if name.partition(".")[0] == "distributed":
                logging.getLogger(name).setLevel(logging.CRITICAL)
        if self._scheduler is None:
            from auvid.hydro.long_series.threads import THREADS

            self._scratch = tempfile.TemporaryDirectory(prefix="auvid-dask-")
            self._cluster = dask.LocalCluster(
                n_workers=self.workers,
                threads_per_worker=1,
                env={"NUMBA_NUM_THREADS": str(max(1, THREADS // self.workers))},
                memory_limit=_bytes(self._memory),
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                local_directory=self._scratch.name,
                silence_logs=logging.CRITICAL,
            )
        try:
            self._client = dask.Client(self._cluster or self._scheduler, timeout=CONNECT_S)
        except (OSError, ValueError) as fault:
            raise UsageError(
                "no Dask scheduler answers",
                field="--scheduler",
                value=self._scheduler,
                allowed="an address as tcp://HOST:8786",
                remedy="dask scheduler starts one, dask worker ADDRESS a worker of it.",
            ) from fault
        cluster = self._client.scheduler_info(-1)
        number = len(cluster["workers"])
        dashboard = self._client.dashboard_link if "dashboard" in cluster["services"] else ""
        where = dashboard if dashboard and _answers(dashboard) else "none"
        _say(f"Dask: {number} worker{'s' * (number != 1)}, dashboard: {where}")
        if not number:
            _say(f"it waits for a worker: dask worker {self._scheduler} --nthreads 1")
        return self._client

    def close(self) -> None:
        """Leave the cluster, and end it if it was started here."""
        for part in (self._client, self._cluster):
            if part is not None:
                part.close()
        if self._scratch is not None:
            self._scratch.cleanup()
        self._client = self._cluster = self._scratch = None


def _answers(address: str) -> bool:
    """Return whether a page answers: schedulers without one name an address too."""
    if OUTPUT.quiet:
        return False
    try:
        with urlopen(address, timeout=ANSWER_S):
            return True
    except (OSError, ValueError):
        return False


def distributed() -> Any:
    """Return the module of Dask's workers. Raises `UsageError` without it."""
    try:
        return import_module("distributed")
    except ImportError as fault:
        raise UsageError(
            "Dask is not installed",
            field="--engine",
            value="dask",
            remedy="pip install 'auvid[dask]'",
        ) from fault


def _bytes(memory: str | None) -> Any:
    """Return a memory limit as Dask takes it; None leaves each worker its share."""
    if memory is None:
        return "auto"
    try:
        limit = import_module("dask.utils").parse_bytes(memory)
    except ValueError:
        limit = 0
    if limit < LEAST_BYTES:
        raise UsageError(
            "no memory of a worker", field="--memory", value=memory, allowed="a size as 1.2GB"
        )
    return limit


def _marker(folder: Path) -> tuple[Path, str]:
    """Write a file that only a worker of the same file system finds."""
    folder.mkdir(parents=True, exist_ok=True)
    path, content = folder / f".shared-{uuid4().hex}", uuid4().hex
    path.write_text(content, encoding="utf-8")
    return path, content


def _say(line: str) -> None:
    if not OUTPUT.quiet:
        print(line, file=sys.stderr)
