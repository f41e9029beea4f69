# ruff: noqa: E402
"""Fixtures that all tests share: campaigns run once a session, whatever the number of
workers.

Importing the package sets one BLAS thread, which counts only before numpy is loaded:
the small solves of the tests are two to three times slower with threads that wait for
one another. `TEST_BLAS_THREADS` sets another number (tools/dispatches.py).

What is imported and collected stays to the end, so that Python need not look for cycles
in it: neither meanwhile, which takes a fifth off, nor after. In what tests make it looks
once in 20,000 objects, not in 700, which takes 5 to 8 % off.
"""

from __future__ import annotations

import gc  # isort: skip

gc.disable()
import auvid.pipeline  # isort: skip

import os
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.support import campaign_runs

__all__ = ["auvid"]
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")  # thousands are caught
if "TEST_BLAS_THREADS" in os.environ:
    os.environ["OPENBLAS_NUM_THREADS"] = os.environ["TEST_BLAS_THREADS"]


def pytest_collection_finish() -> None:
    """Look for cycles in what the tests make."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


@pytest.fixture(scope="session")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the workers of a session share."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


@pytest.fixture(scope="session", autouse=True)
def compiled_once(session_folder: Path) -> Iterator[None]:
    """Let one worker compile a loop that is kept; the others wait and load it."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        yield
        return
    from numba.core.caching import NullCache
    from numba.core.dispatcher import Dispatcher
    from numba.core.targetconfig import TargetConfig

    compile_now, differ = Dispatcher.compile, TargetConfig.__eq__

    def same_options(one: Any, other: Any) -> Any:
        # What is set decides; the library compares forty options, each by three calls.
        return getattr(other, "_values", None) == one._values or differ(one, other)

    def compile_in_turn(loop: Any, signature: Any) -> Any:
        if isinstance(loop._cache, NullCache):
            return compile_now(loop, signature)
        name = f"{loop.py_func.__module__}.{loop.py_func.__qualname__}"
        with campaign_runs.locked(session_folder / name):
            return compile_now(loop, signature)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dispatcher, "compile", compile_in_turn)
        patch.setattr(TargetConfig, "__eq__", same_options)
        yield


@pytest.fixture(scope="session", autouse=True)
def commands_built_once() -> Iterator[None]:
    """Build the commands of `auvid` once a worker: each call in a test would anew.

    All of them: modules of the command line add theirs when they are imported.
    """
    import typer.main
    import typer.testing

    import_module("auvid.pipeline.cli")
    build = cache(typer.main.get_command)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", build)
        patch.setattr(typer.testing, "_get_command", build)
        yield


@pytest.fixture(scope="session")
def committed_run(session_folder: Path) -> Callable[[str], Path]:
    """Workspace in which a campaign of the repository has run: read-only."""

    def workspace(name: str) -> Path:
        return campaign_runs.made_once(session_folder / name, campaign_runs.make_committed)

    return workspace


@pytest.fixture(scope="session")
def example_workspace(session_folder: Path) -> Path:
    """Workspace of `auvid new` whose example has run: read-only."""
    return campaign_runs.made_once(session_folder / "workspace", campaign_runs.make_example)


@pytest.fixture(scope="session")
def short_template(session_folder: Path) -> Path:
    """Workspace of `auvid new` with a short example that has not run: read-only."""
    return campaign_runs.made_once(
        session_folder / "short_template", campaign_runs.write_short_example
    )


@pytest.fixture(scope="session")
def short_workspace(session_folder: Path) -> Path:
    """Workspace of `auvid new` whose example is short and has run: read-only."""
    return campaign_runs.made_once(
        session_folder / "short_workspace", campaign_runs.make_short_example
    )


@pytest.fixture(scope="session")
def shared(session_folder: Path) -> Callable[[str, Callable[[], Any]], Any]:
    """What a function gives, by name: computed once a session, each worker has a copy."""
    return lambda name, make: campaign_runs.computed_once(session_folder / name, make)
