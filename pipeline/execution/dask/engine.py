"""The engine that gives tasks to a Dask cluster: one of this machine, or any other.

Scheduling, lost workers, memory limits and the dashboard are Dask's.
"""

from __future__ import annotations

import logging
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.pipeline.execution.dask import pickled
from auvid.pipeline.execution.dask.exchange import Exchange
from auvid.pipeline.execution.dask.worker import Terms, Unfit
from auvid.pipeline.execution.task import Outcome, Task
from auvid.pipeline.output import OUTPUT
from auvid.pipeline.store.package_versions import package_versions

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_S = 10.0
"""A scheduler that does not answer for so long is not there."""
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
        self._client: Client | None = None
        self._cluster: Any = None
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._unfit: dict[str, str] = {}

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        if not tasks:
            return
        from distributed import as_completed

        client = self._connected()
        marker = None if self._exchange else _marker(tasks[0].folder)
        terms = Terms(package_versions(), marker, self._exchange)
        try:
            waiting = {self._submitted(client, task, terms): task for task in tasks}
            completed = as_completed(list(waiting))
            for future in completed:
                task = waiting.pop(future)
                result = self._result(client, future, task)
                future.release()
                if isinstance(result, Unfit):
                    self._leave_out(client, result)
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

    def _submitted(self, client: Client, task: Task, terms: Terms) -> Future:
        import cloudpickle

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
        work = cloudpickle.dumps((task, terms))
        return client.submit(pickled.run_pickled, work, key=name, pure=False, workers=fit)

    def _result(self, client: Client, future: Future, task: Task) -> Outcome | Unfit:
        from distributed import CancelledError, KilledWorker

        try:
            result = future.result()
            return result if isinstance(result, Outcome | Unfit) else Unfit(*result)
        except KilledWorker:
            return Outcome(
                task.item,
                crash=f"{DEATHS} workers died on it, perhaps for lack of memory (--memory)",
            )
        except (CancelledError, OSError) as fault:
            raise PipelineError(
                "the scheduler has gone away",
                value=self._scheduler or "of this machine",
                remedy="What was finished is kept: start the scheduler and run again.",
            ) from fault
        except Exception as crash:
            return Outcome(task.item, crash=f"{type(crash).__name__}: {crash}")

    def _leave_out(self, client: Client, unfit: Unfit) -> None:
        if unfit.worker not in self._unfit:
            self._unfit[unfit.worker] = unfit.reason
            _say(f"worker {unfit.worker} is left out: {unfit.reason}")

    def _connected(self) -> Client:
        if self._client is not None:
            return self._client
        try:
            import cloudpickle
            import dask
            from distributed import Client, LocalCluster
        except ImportError as fault:
            raise UsageError(
                "Dask is not installed",
                field="--engine",
                value="dask",
                remedy="pip install 'auvid[dask]'",
            ) from fault
        settings = {
            "distributed.comm.timeouts.connect": CONNECT_S,
            "distributed.scheduler.allowed-failures": DEATHS,
        }
        dask.config.set(settings)
        cloudpickle.register_pickle_by_value(pickled)
        for name in logging.root.manager.loggerDict:
            if name.partition(".")[0] == "distributed":
                logging.getLogger(name).setLevel(logging.CRITICAL)
        if self._scheduler is None:
            self._scratch = tempfile.TemporaryDirectory(prefix="auvid-dask-")
            self._cluster = LocalCluster(
                n_workers=self.workers,
                threads_per_worker=1,
                memory_limit=self._memory or "auto",
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                local_directory=self._scratch.name,
                silence_logs=logging.CRITICAL,
            )
        try:
            self._client = Client(self._cluster or self._scheduler, timeout=CONNECT_S)
        except (OSError, ValueError) as fault:
            raise UsageError(
                "no Dask scheduler answers",
                field="--scheduler",
                value=self._scheduler,
                allowed="an address as tcp://HOST:8786",
                remedy="dask scheduler starts one, dask worker ADDRESS a worker of it.",
            ) from fault
        number = len(self._client.scheduler_info(-1)["workers"])
        if not number:
            _say(
                f"the scheduler {self._scheduler} has no worker yet: dask worker {self._scheduler}"
            )
        _say(f"Dask: {number} workers, dashboard {self._client.dashboard_link}")
        return self._client

    def close(self) -> None:
        """Leave the cluster, and end it if it was started here."""
        for part in (self._client, self._cluster):
            if part is not None:
                part.close()
        if self._scratch is not None:
            self._scratch.cleanup()
        self._client = self._cluster = self._scratch = None


def _marker(folder: Path) -> tuple[Path, str]:
    """Write a file that only a worker of the same file system finds."""
    folder.mkdir(parents=True, exist_ok=True)
    path, content = folder / f".shared-{uuid4().hex}", uuid4().hex
    path.write_text(content, encoding="utf-8")
    return path, content


def _say(line: str) -> None:
    if not OUTPUT.quiet:
        print(line, file=sys.stderr)
