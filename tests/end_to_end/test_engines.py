"""The example of a new workspace in one process, in several, through DVC, and mixed: all
leave the same artefacts.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import campaign_runs
from tests.support.campaign_runs import copy_workspace

BIN = Path(sys.executable).parent
RECORDING = "report/recording.rrd"
"""The one artefact that is not the same bytes twice: it is compared by `rerun rrd
compare`, and the report's manifest holds its hash.
"""
CHAIN = ("ingest", "resample", "fuse", "residual", "synthesise", "validate")
SHORT_CHAIN = CHAIN[:4]
"""Runs by log and by leg, with results that feed the next stage: enough to compare ways."""


def call(*command: str, folder: Path) -> str:
    """Return standard output of a program called in `folder`."""
    settings = {
        "PATH": f"{BIN}:{os.environ['PATH']}",
        "DVC_NO_ANALYTICS": "1",
        "DVC_SITE_CACHE_DIR": str(folder / ".dvc" / "tmp" / "site"),
    }
    done = subprocess.run(
        command, cwd=folder, env=os.environ | settings, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def hashes(workspace: Path, *stages: str) -> dict[str, str]:
    """Return the hash of every artefact and manifest of the example, or of some stages.

    Left out: the recording, the manifest that names its hash, and the history, which
    says when a run finished.
    """
    folder = workspace / "runs" / "example"
    files = {
        str(path.relative_to(folder)): path
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name[0] != "."
    }
    return {
        name: hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in files.items()
        if name not in (RECORDING, "report/manifest.json")
        and not name.startswith("history/")
        and (not stages or name.partition("/")[0] in stages)
    }


def new_workspace(folder: Path) -> Path:
    """Write a workspace with the example; return it."""
    campaign_runs.auvid("new", str(folder), folder=folder.parent)
    return folder


def test_report_and_tables_are_there(example_workspace: Path) -> None:
    names = set(hashes(example_workspace))
    assert {
        "report/report_html.html",
        "validate/error_table.parquet",
        "validate/error_metrics.json",
        "synthesise/model_card/fossen.json",
    } <= names
    assert {f"{stage}/manifest.json" for stage in CHAIN} <= names
    printed = campaign_runs.auvid("report", "example", folder=example_workspace)
    assert printed.strip().endswith("report_html.html")


def test_processes_give_the_same_artefacts(example_workspace: Path, tmp_path: Path) -> None:
    """As a program: workers start anew from it."""
    folder = new_workspace(tmp_path / "workspace")
    processes = ("--engine", "processes", "--jobs", "2")
    call("auvid", "run", "example", "--until", SHORT_CHAIN[-1], *processes, folder=folder)
    assert hashes(folder) == hashes(example_workspace, *SHORT_CHAIN)


def test_dvc_and_auvid_mix_in_any_order(example_workspace: Path, tmp_path: Path) -> None:
    folder = new_workspace(tmp_path / "workspace")
    campaign_runs.auvid("run", "example", "--until", "resample", folder=folder)
    (folder / ".dvc" / "config.local").write_text("[core]\n    no_scm = true\n")
    call("dvc", "repro", "residual@example", folder=folder)
    assert hashes(folder) == hashes(example_workspace, *SHORT_CHAIN)
    printed = campaign_runs.auvid("run", "example", "--until", "residual", folder=folder)
    assert printed.startswith("nothing to do")

    other = new_workspace(tmp_path / "other")
    for workspace in (folder, other):
        params = workspace / "params.yaml"
        params.write_text(params.read_text().replace("edge_s: null", "edge_s: 0.6"))
    call("dvc", "repro", "fuse@example", folder=folder)
    for workspace in (folder, other):
        campaign_runs.auvid("run", "example", "--until", "residual", folder=workspace)
    changed = hashes(folder)
    assert changed == hashes(other)
    assert changed != hashes(example_workspace, *SHORT_CHAIN)


@pytest.mark.release
@pytest.mark.timeout(600)
def test_whole_chain_is_the_same_by_processes_and_by_dvc(
    example_workspace: Path, tmp_path: Path
) -> None:
    before = hashes(example_workspace)
    folder = copy_workspace(example_workspace, tmp_path / "processes")
    call(
        "auvid", "run", "example", "--force", "--engine", "processes", "--jobs", "2", folder=folder
    )
    assert hashes(folder) == before

    folder = new_workspace(tmp_path / "dvc")
    call("auvid", "run", "example", "--until", "resample", folder=folder)
    call("make", "campaign", "NAME=example", folder=folder)
    assert hashes(folder) == before
    recordings = [str(root / "runs/example" / RECORDING) for root in (example_workspace, folder)]
    call("rerun", "rrd", "compare", "--unordered", *recordings, folder=folder)
    assert call("auvid", "run", "example", folder=folder).startswith("nothing to do")
