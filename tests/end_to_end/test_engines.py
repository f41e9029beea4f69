"""A new workspace's example through every way of running it: one process, several, DVC,
and mixed. All must leave the same artefacts.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

BIN = Path(sys.executable).parent
RECORDING = "report/recording.rrd"
"""The one artefact that is not the same bytes twice: it is compared by `rerun rrd
compare`, and the report's manifest holds its hash.
"""


def run(*command: str, folder: Path) -> str:
    """Standard output of a command in a folder."""
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


def hashes(workspace: Path) -> dict[str, str]:
    """Hash of every artefact and manifest of the example, without the recording, the
    manifest that names its hash, and the history.
    """
    folder = workspace / "runs" / "example"
    found = {
        str(path.relative_to(folder)): path
        for path in folder.rglob("*")
        if path.is_file() and path.name[0] != "."
    }
    found = {
        name: path for name, path in found.items() if not name.startswith("history/")
    }  # says when a run finished, and how far
    for name in (RECORDING, "report/manifest.json"):
        found.pop(name, None)
    return {
        name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in sorted(found.items())
    }


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace whose example ran in one process."""
    folder = tmp_path_factory.mktemp("serial") / "workspace"
    run("auvid", "new", str(folder), folder=folder.parent)
    said = run("auvid", "run", "example", folder=folder)
    assert "items run" in said
    assert "runs/example/report/report_html.html" in said
    return folder


def test_report_and_tables_are_there(serial: Path) -> None:
    names = set(hashes(serial))
    assert {
        "report/report_html.html",
        "validate/error_table.parquet",
        "validate/error_metrics.json",
        "synthesise/model_card/fossen.json",
    } <= names
    assert {
        f"{stage}/manifest.json"
        for stage in ("ingest", "resample", "fuse", "residual", "synthesise", "validate")
    } <= names
    assert run("auvid", "report", "example", folder=serial).strip().endswith("report_html.html")


def test_processes_give_the_same_artefacts(serial: Path) -> None:
    before = hashes(serial)
    run("auvid", "run", "example", "--force", "--engine", "processes", "--jobs", "2", folder=serial)
    assert hashes(serial) == before


def test_dvc_and_auvid_mix_in_any_order(serial: Path, tmp_path: Path) -> None:
    folder = tmp_path / "workspace"
    run("auvid", "new", str(folder), folder=tmp_path)
    run("auvid", "run", "example", "--until", "resample", folder=folder)
    run("make", "campaign", "NAME=example", folder=folder)
    assert hashes(folder) == hashes(serial)
    run(
        "rerun",
        "rrd",
        "compare",
        "--unordered",
        str(serial / "runs/example" / RECORDING),
        str(folder / "runs/example" / RECORDING),
        folder=folder,
    )
    assert run("auvid", "run", "example", folder=folder).startswith("nothing to do")

    params = folder / "params.yaml"
    params.write_text(params.read_text().replace("edge_s: null", "edge_s: 0.6"))
    run("dvc", "repro", "fuse@example", folder=folder)
    run("auvid", "run", "example", "--until", "validate", folder=folder)
    (serial / "params.yaml").write_text(params.read_text())
    run("auvid", "run", "example", "--until", "validate", folder=serial)
    changed = {
        name: value for name, value in hashes(folder).items() if not name.startswith("report/")
    }
    assert changed == {
        name: value for name, value in hashes(serial).items() if not name.startswith("report/")
    }
