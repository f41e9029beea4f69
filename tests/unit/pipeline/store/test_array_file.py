"""Long arrays of a task lie in files without a name, and go with them."""

from __future__ import annotations

import errno
import gc
import os
import resource
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.tables import make_table
from auvid.hydro.long_series.long_arrays import (
    LONG_BYTES,
    copied_file,
    is_mapped,
    laid_down,
    laid_down_in,
    let_go,
)
from auvid.pipeline.execution.task import Task, execute
from auvid.pipeline.store.array_file import ArrayFile
from auvid.pipeline.store.artefacts import encode, load
from auvid.pipeline.store.atomic_files import contents

LONG = np.random.default_rng(3).normal(size=(LONG_BYTES // 12, 3))


def resident_kb() -> int:
    """Return what of mapped files is in memory; those of a disk in memory count apart."""
    rows = Path("/proc/self/status").read_text().splitlines()
    return sum(int(row.split()[1]) for row in rows if row.startswith(("RssFile", "RssShmem")))


def test_a_long_array_is_the_same_outside_of_memory(tmp_path: Path) -> None:
    with laid_down_in(ArrayFile(tmp_path)):
        outside = laid_down(LONG[:, ::2])
        assert is_mapped(outside)
        assert not outside.flags.writeable
        np.testing.assert_array_equal(outside, LONG[:, ::2])
        assert laid_down(outside) is outside
        assert laid_down(LONG[:9]).base is LONG
        assert list(tmp_path.iterdir()) == [], "its file has no name"
    assert laid_down(LONG) is LONG


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="/proc is Linux's")
def test_what_was_read_is_let_go_and_read_again(tmp_path: Path) -> None:
    with laid_down_in(ArrayFile(tmp_path)):
        outside = laid_down(np.tile(LONG, (8, 1)))
        total = outside.sum()
        before = resident_kb()
        let_go()
        assert resident_kb() < before - 0.9 * outside.nbytes / 1024
        assert outside.sum() == total


def test_the_file_goes_with_the_array(tmp_path: Path) -> None:
    place = ArrayFile(tmp_path)
    with laid_down_in(place):
        outside = laid_down(LONG)
        assert len(place._maps) == 1
        del outside
        gc.collect()
        assert len(place._maps) == 0


def test_a_log_that_is_cut_short_while_it_is_read_ends_no_process(tmp_path: Path) -> None:
    log, content = tmp_path / "log", np.arange(LONG_BYTES // 8 + 1, dtype=np.int64).view(np.uint8)
    content.tofile(log)
    with laid_down_in(ArrayFile(tmp_path / "runs")):
        read = contents(log, file=log, what="log")
        os.truncate(log, 0)
        np.testing.assert_array_equal(read, content)
    assert copied_file(str(log), 2 * LONG_BYTES) is None


def test_a_file_that_may_not_grow_is_named(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LONG_BYTES // 2, limits[1]))
    try:
        with (
            laid_down_in(ArrayFile(tmp_path)),
            pytest.raises(PipelineError, match=rf"{tmp_path.name}: .*File too large.*ulimit"),
        ):
            laid_down(LONG)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_arrays_stay_in_memory_where_no_more_files_can_be_open(tmp_path: Path) -> None:
    """Each has one; of 85 legs with twelve arrays the last could not be opened."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, limits[1]))
    try:
        with laid_down_in(ArrayFile(tmp_path)):
            parts = [laid_down(np.full(3, float(number)), 1) for number in range(300)]
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert [is_mapped(part) for part in parts] == [True] * 128 + [False] * 172
    np.testing.assert_array_equal(np.array(parts)[:, 0], np.arange(300.0))


def test_arrays_stay_in_memory_where_no_file_can_be_mapped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object, **__: object) -> None:
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    log = tmp_path / "log"
    LONG.tofile(log)
    monkeypatch.setattr("auvid.pipeline.store.array_file.mmap.mmap", none)
    with laid_down_in(ArrayFile(tmp_path)):
        assert laid_down(LONG) is LONG
        np.testing.assert_array_equal(contents(log, file=log, what="log"), LONG.view(np.uint8).flat)


def test_threads_lay_down_and_let_go_at_once(tmp_path: Path) -> None:
    """Checks of a long log do; the set of maps changed while it was walked."""

    def work(_: int) -> None:
        kept = []
        for _ in range(60):
            kept.append(laid_down(np.ones(3), 1))
            let_go()

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with laid_down_in(ArrayFile(tmp_path)), ThreadPoolExecutor(3) as pool:
            list(pool.map(work, range(3)))
    finally:
        sys.setswitchinterval(before)


def test_a_task_lays_long_arrays_down_beside_its_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mapped: list[bool] = []
    monkeypatch.setattr(
        "auvid.pipeline.execution.task._run", lambda _: mapped.append(is_mapped(laid_down(LONG)))
    )
    execute(cast(Task, SimpleNamespace(item="log", folder=tmp_path)))
    assert mapped == [True]
    assert not is_mapped(laid_down(LONG))


def test_a_long_table_is_read_column_by_column_into_files(tmp_path: Path) -> None:
    count = LONG_BYTES // 8
    table = make_table(
        "depth",
        {"time_us": np.arange(count), "depth_m": np.linspace(0.0, 9.0, count)},
    )
    path = tmp_path / "depth.parquet"
    path.write_bytes(encode(table, "depth", file=path))
    place = ArrayFile(tmp_path / "runs")
    with laid_down_in(place):
        laid = load(path, "depth")
    assert len(place._maps) == 2, "clock and depth"
    assert laid.equals(table)
    assert laid.schema.equals(table.schema, check_metadata=True)
