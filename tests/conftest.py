"""Fixtures that all tests share: campaigns run once a session, whatever the number of
workers.

Importing the package sets one BLAS thread, which counts only before numpy is loaded:
the small solves of the tests are two to three times slower with threads that wait for
one another. `TEST_BLAS_THREADS` sets another number (tools/dispatches.py).
"""

from __future__ import annotations

import auvid.pipeline  # isort: skip

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support import campaign_runs

__all__ = ["auvid"]
if "TEST_BLAS_THREADS" in os.environ:
    os.environ["OPENBLAS_NUM_THREADS"] = os.environ["TEST_BLAS_THREADS"]


@pytest.fixture(scope="session")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the workers of a session share."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


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
