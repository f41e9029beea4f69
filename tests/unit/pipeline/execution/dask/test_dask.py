"""Tasks on Dask's workers: the same files as here, and workers that are unfit."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import dask
import numpy as np
import pytest
from distributed import LocalCluster

from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.pipeline import collector
from auvid.pipeline.execution.dask import engine as dask_engine
from auvid.pipeline.execution.dask.engine import Dask
from auvid.pipeline.execution.dask.exchange import Exchange
from auvid.pipeline.execution.engines import make_engine
from auvid.pipeline.execution.task import Outcome, Task, execute
from auvid.pipeline.execution.task_inputs import Artefact, Many
from auvid.pipeline.graph import Port
from auvid.pipeline.store import artefacts
from auvid.pipeline.store.package_versions import package_versions

TOYS = str(Path(__file__).parent / "toys")
sys.path.insert(0, TOYS)
from deepen import (  # noqa: E402
    Params,
    breaks,
    dies_once,
    doubled,
    refuses,
    table,
    toy,
)


def task_of(folder: Path, run: object = doubled, item: str = "campaign") -> Task:
    """A task that reads two tables from disk."""
    stage = toy(run)
    artefacts_by_key = {}
    for key in "ab":
        path = folder / "given" / f"{key}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        content = artefacts.encode(table(np.arange(3.0) + ord(key)), "samples_depth", file=key)
        path.write_bytes(content)
        artefacts_by_key[key] = Artefact(path, "samples_depth", artefacts.hash_bytes(content))
    ports = (Port(stage, "pieces", "samples_depth", True),)
    return Task(
        stage, item, Params(), {"depth": Many(artefacts_by_key)}, ports, folder / item, "key", ""
    )


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    """Two workers in this process."""
    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    ) as workers:
        yield workers


def program_path() -> list[str]:
    """Return the search path of a program, which is not that of a test: workers have it."""
    here = {"", TOYS, str(Path(__file__).parents[5])}
    return [path for path in sys.path if path not in here]


def outcomes(engine: Dask, *tasks: Task) -> dict[str, Outcome]:
    try:
        return {outcome.item: outcome for outcome in engine.map(tasks)}
    finally:
        engine.close()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_results_are_those_of_this_process(
    cluster: LocalCluster,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(collector, "_frozen", False)
    here = task_of(tmp_path / "here")
    record = execute(here).record
    assert record is not None
    there = [task_of(tmp_path / "there", item=name) for name in ("one", "two", "three")]
    results = outcomes(Dask(1, cluster.scheduler_address), *there)
    assert "dashboard: none" in capsys.readouterr().err  # though the scheduler names an address
    assert set(results) == {"one", "two", "three"}
    for task in there:
        outcome = results[task.item]
        assert outcome.record is not None, outcome
        assert outcome.record.outputs == record.outputs
        assert contents(task.folder) == contents(here.folder)
    assert collector._frozen  # by the workers: 6 % of their time went to the collector
    gc.unfreeze()


def test_faults_come_back_in_words(cluster: LocalCluster, tmp_path: Path) -> None:
    tasks = task_of(tmp_path, refuses, "refused"), task_of(tmp_path, breaks, "broken")
    results = outcomes(Dask(1, cluster.scheduler_address), *tasks)
    assert "too short; found 3" in str(results["refused"].fault)
    assert "ZeroDivisionError" in str(results["broken"].crash)
    assert "a fault of ours" in results["broken"].trace


def test_files_go_through_an_exchange(cluster: LocalCluster, tmp_path: Path) -> None:
    """The worker reads and writes in a folder of its own; results are fetched."""
    here = task_of(tmp_path / "here")
    assert execute(here).record is not None
    task = task_of(tmp_path / "client")
    url = (tmp_path / "exchange").as_uri()
    for _ in range(2):  # the second time everything is there already
        results = outcomes(Dask(1, cluster.scheduler_address, exchange=url), task)
        assert results["campaign"].record is not None, results
        assert contents(task.folder) == contents(here.folder)
    stored = contents(tmp_path / "exchange")
    assert len(stored) == 4
    assert all(artefacts.hash_bytes(content) == name for name, content in stored.items())


def test_a_damaged_file_of_an_exchange_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"depth")
    digest = artefacts.hash_bytes(b"depth")
    exchange = Exchange(str(tmp_path / "exchange"))
    exchange.put(tmp_path / "file", digest)
    exchange.get(digest, tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == b"depth"
    (tmp_path / "exchange" / digest[:2] / digest).write_bytes(b"death")
    with pytest.raises(PipelineError, match="not what its name says"):
        exchange.get(digest, tmp_path / "other")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy", "exchange", "file"]


def test_an_exchange_that_nothing_can_open_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PipelineError, match="--exchange"):
        Exchange("nowhere://bucket").put(tmp_path / "file", "00")


def test_workers_of_another_version_are_left_out(
    cluster: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(dask_engine, "source_hash", lambda: "of another version")
        with pytest.raises(PipelineError, match=r"no worker can run .*its files differ"):
            outcomes(Dask(1, cluster.scheduler_address), task_of(tmp_path))
    monkeypatch.setattr(
        dask_engine, "package_versions", lambda: package_versions() | {"numpy": "1.0"}
    )
    with pytest.raises(PipelineError, match=r"numpy .*, and the client has 1\.0"):
        outcomes(Dask(1, cluster.scheduler_address), task_of(tmp_path))


def test_a_worker_without_the_folder_is_left_out(
    cluster: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "_marker", lambda folder: (tmp_path / "missing", "1"))
    with pytest.raises(PipelineError, match="does not share the folder"):
        outcomes(Dask(1, cluster.scheduler_address), task_of(tmp_path))


def test_a_scheduler_that_is_not_there_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "CONNECT_S", 0.2)
    with pytest.raises(UsageError, match=r"no Dask scheduler answers.*tcp://127\.0\.0\.1:1'"):
        outcomes(Dask(1, "tcp://127.0.0.1:1"), task_of(tmp_path))


@pytest.mark.timeout(60)
def test_workers_that_lack_something_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They do not find the toys, as others may not find auvid.

    Nor do they take samples of what they do: that was a tenth of their CPU.
    """
    monkeypatch.setattr(sys, "path", program_path())
    engine = Dask(1)
    try:
        with pytest.raises(PipelineError, match=r"no worker can run .*No module named 'deepen'"):
            list(engine.map([task_of(tmp_path)]))
        settings = engine._client.run(dask.config.get, "distributed")
    finally:
        engine.close()
    assert [each["worker"]["profile"]["enabled"] for each in settings.values()] == [False]
    assert [each["admin"]["tick"]["interval"] for each in settings.values()] == ["500ms"]


@pytest.mark.release
@pytest.mark.timeout(120)
def test_a_worker_that_dies_costs_nothing_but_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another worker takes its task."""
    monkeypatch.setattr(sys, "path", [*program_path(), TOYS])
    tasks = (
        task_of(tmp_path / "fine"),
        replace(task_of(tmp_path / "once", dies_once, "once"), params=Params(str(tmp_path))),
    )
    results = outcomes(Dask(2), *tasks)
    assert results["campaign"].record is not None
    assert results["once"].record is not None, results["once"]
    assert (tmp_path / "died").exists()


def test_options_of_dask_are_refused_elsewhere() -> None:
    with pytest.raises(UsageError, match="--memory"):
        make_engine("processes", memory="1GB")
    with pytest.raises(UsageError, match="--jobs"):
        make_engine("dask", 2, scheduler="tcp://127.0.0.1:8786")
    assert isinstance(make_engine(scheduler="tcp://127.0.0.1:8786"), Dask)
