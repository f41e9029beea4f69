"""The example of a new workspace in one process, in several, through DVC, and mixed: all
leave the same artefacts. What only a release needs: the whole chain, and long mixtures.
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
CHAIN = (
    "ingest",
    "resample",
    "check_installation",
    "fuse",
    "residual",
    "synthesise",
    "validate",
)
SHORT_CHAIN = CHAIN[:5]
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


def test_report_and_tables_are_there(short_workspace: Path) -> None:
    names = set(hashes(short_workspace))
    assert {
        "report/report_html.html",
        "validate/error_table.parquet",
        "validate/error_metrics.json",
        "synthesise/model_card/fossen.json",
    } <= names
    assert {f"{stage}/manifest.json" for stage in CHAIN} <= names
    printed = campaign_runs.auvid("report", "example", folder=short_workspace)
    assert printed.strip().endswith("report_html.html")


@pytest.mark.parametrize("engine", ["processes", pytest.param("dask", marks=pytest.mark.release)])
def test_other_engines_give_the_same_artefacts(
    engine: str, short_template: Path, short_workspace: Path, tmp_path: Path
) -> None:
    """As a program: workers start anew from it."""
    folder = copy_workspace(short_template, tmp_path / "workspace")
    two = ("--engine", engine, "--jobs", "2")
    call("auvid", "run", "example", "--until", SHORT_CHAIN[-1], *two, folder=folder)
    assert hashes(folder) == hashes(short_workspace, *SHORT_CHAIN)


def mix(workspace: Path, first: str, then: str) -> None:
    """Run up to a stage by auvid, then to another by DVC, which keeps what there is and
    leaves nothing to do.
    """
    campaign_runs.auvid("run", "example", "--until", first, folder=workspace)
    (workspace / ".dvc" / "config.local").write_text("[core]\n    no_scm = true\n")
    call("dvc", "repro", f"{then}@example", folder=workspace)
    printed = campaign_runs.auvid("run", "example", "--until", then, folder=workspace)
    assert printed.startswith("nothing to do")


def test_dvc_goes_on_where_auvid_stopped(
    short_template: Path, short_workspace: Path, tmp_path: Path
) -> None:
    folder = copy_workspace(short_template, tmp_path / "workspace")
    mix(folder, "ingest", "resample")
    assert hashes(folder) == hashes(short_workspace, "ingest", "resample")


@pytest.mark.release
def test_dvc_and_auvid_mix_in_any_order(
    short_template: Path, short_workspace: Path, tmp_path: Path
) -> None:
    folder = copy_workspace(short_template, tmp_path / "workspace")
    mix(folder, "resample", "residual")
    assert hashes(folder) == hashes(short_workspace, *SHORT_CHAIN)

    other = copy_workspace(short_template, tmp_path / "other")
    for workspace in (folder, other):
        manifest = workspace / "campaigns" / "example" / "campaign.yaml"
        text = manifest.read_text().replace("fuse: {", "fuse: {edge_s: 0.6, ")
        manifest.write_text(text.replace("title: ", "title: Other "))
    printed = call("dvc", "repro", "fuse@example", folder=folder)
    assert "Running stage 'fuse@example'" in printed
    for stage in ("ingest", "resample"):  # nothing that they read has changed
        assert f"'{stage}@example' didn't change" in printed
    for workspace in (folder, other):
        campaign_runs.auvid("run", "example", "--until", "residual", folder=workspace)
    changed = hashes(folder)
    assert changed == hashes(other)
    assert changed != hashes(short_workspace, *SHORT_CHAIN)


@pytest.mark.release
def test_dvc_takes_a_stage_that_leaves_an_output_out(short_workspace: Path, tmp_path: Path) -> None:
    folder = copy_workspace(short_workspace, tmp_path / "workspace")
    (folder / ".dvc" / "config.local").write_text("[core]\n    no_scm = true\n")
    assert not (folder / "runs/example/validate/simulated_motion").exists(), "it flies no free runs"
    for words in (["code"], ["code", "example"]):
        campaign_runs.auvid(*words, folder=folder)
    printed = call("dvc", "repro", "--single-item", "validate@example", folder=folder)
    assert "Running stage 'validate@example'" in printed


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

    folder = tmp_path / "dvc"
    campaign_runs.auvid("new", str(folder), folder=tmp_path)
    call("auvid", "run", "example", "--until", "resample", folder=folder)
    call("make", "campaign", "NAME=example", folder=folder)
    assert hashes(folder) == before
    recordings = [str(root / "runs/example" / RECORDING) for root in (example_workspace, folder)]
    call("rerun", "rrd", "compare", "--unordered", *recordings, folder=folder)
    assert call("auvid", "run", "example", folder=folder).startswith("nothing to do")
