"""Campaigns that run once a session, whichever worker needs them first.

The workspaces are read-only: a test that changes something works on a `copy_workspace`.
"""

from __future__ import annotations

import fcntl
import pickle
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import pytest
import yaml
from typer.testing import CliRunner

from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline import cli
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.execution.engines import Serial
from auvid.pipeline.graph import select

T = TypeVar("T")
ROOT = Path(__file__).parents[2]
LAST_STAGE = {
    "bluerov2_dvl": "validate",
    "bluerov2_dvl_csv": "validate",
    "bluerov2_dvl_tlog": "validate",
    "hauv_circle": "synthesise",
    "blueye_heave": "rlse",
}
"""Campaigns of the repository that tests look at, and how far their chains go."""
NO_FREE_RUN: Mapping[str, Mapping[str, object]] = {"validate": {"free_run": False}}
FEWER = {"bluerov2_dvl_csv": NO_FREE_RUN, "bluerov2_dvl_tlog": NO_FREE_RUN}
"""What no test asks of a campaign and its run therefore leaves out."""
VALUE = "value.pickle"
SHORT_S, SHORT_HZ = 30, 10
SHORT = {
    "start_s: 0, end_s: 60": "start_s: 0, end_s: 20",
    "start_s: 60, end_s: 89": "start_s: 20, end_s: 29",
    "\nstages:": "\nstages:\n  synthesise: {models: [fossen]}\n  validate: {free_run: false}",
}
"""Texts of the example's manifest and what they are in that of the short example."""
TWIN = "twin"
TWIN_PLANS = ROOT / "campaigns/vt690_twin/plans"


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock beside `path`; other processes wait."""
    with path.with_name(f"{path.name}.lock").open("w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def made_once(folder: Path, make: Callable[[Path], None]) -> Path:
    """Return `folder`, filled by `make` in the first worker that comes; others wait."""
    done = folder.with_name(f"{folder.name}.done")
    with locked(folder):
        if not done.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            make(folder)
            done.touch()
    return folder


def run_campaign(workspace: Path, name: str, until: str | None) -> int:
    """Run a campaign of a workspace in this process; return how many items ran."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(workspace)
        run = open_run(name)
        return run.execute(select(run.graph, until=until), Serial())


def auvid(*words: str, folder: Path) -> str:
    """Return the standard output of a command called in `folder`, which ends with 0."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = CliRunner().invoke(cli.app, list(words), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def computed_once(folder: Path, make: Callable[[], T]) -> T:
    """Return what `make` gives in the first worker that comes, kept in `folder`."""
    made_once(folder, lambda place: (place / VALUE).write_bytes(pickle.dumps(make())) and None)
    value: T = pickle.loads((folder / VALUE).read_bytes())
    return value


def write_workspace(
    folder: Path, name: str, stages: Mapping[str, Mapping[str, object]] | None = None
) -> None:
    """Write a workspace with one campaign of the repository: its manifest may be changed,
    and takes the parameters of `stages` on top of its own; its other files are linked.
    """
    campaign, source = folder / "campaigns" / name, ROOT / "campaigns" / name
    campaign.mkdir(parents=True)
    for path in source.iterdir():
        if path.name == "campaign.yaml":
            manifest = read_yaml(path.read_text(encoding="utf-8"))
            for stage, params in (stages or {}).items():
                own = manifest.setdefault("stages", {})
                own[stage] = {**own.get(stage, {}), **params}
            text = path.read_text(encoding="utf-8") if not stages else yaml.safe_dump(manifest)
            (campaign / path.name).write_text(text, encoding="utf-8")
        else:
            (campaign / path.name).symlink_to(path, target_is_directory=path.is_dir())
    params = read_yaml((ROOT / "params.yaml").read_text(encoding="utf-8"))
    (folder / "params.yaml").write_text(
        yaml.safe_dump({**params, "campaigns": [name]}), encoding="utf-8"
    )


def make_committed(folder: Path) -> None:
    """Run the campaign of the repository that `folder` is named after."""
    write_workspace(folder, folder.name, FEWER.get(folder.name))
    run_campaign(folder, folder.name, LAST_STAGE[folder.name])


def make_example(folder: Path) -> None:
    """Write a new workspace and run its example, with report and recording."""
    folder.rmdir()
    auvid("new", str(folder), folder=folder.parent)
    printed = auvid("run", "example", folder=folder)
    assert "items run" in printed
    assert "runs/example/report/report_html.html" in printed


def write_short_example(folder: Path) -> None:
    """Write a new workspace whose example is short: `SHORT_S` seconds of log, one model
    and no free runs.
    """
    folder.rmdir()
    auvid("new", str(folder), folder=folder.parent)
    campaign = folder / "campaigns" / "example"
    log, manifest = campaign / "logs/synthetic_run.csv", campaign / "campaign.yaml"
    rows = log.read_text(encoding="utf-8").splitlines(keepends=True)
    log.write_text("".join(rows[: 1 + SHORT_S * SHORT_HZ]), encoding="utf-8")
    text = manifest.read_text(encoding="utf-8")
    for old, new in SHORT.items():
        assert text.count(old) == 1, f"{old!r} is not in the manifest"
        text = text.replace(old, new)
    manifest.write_text(text, encoding="utf-8")


def make_short_example(folder: Path) -> None:
    """Write the workspace of the short example and run it, with report and recording."""
    write_short_example(folder)
    assert "items run" in auvid("run", "example", folder=folder)


def write_twin(folder: Path, plan: dict[str, object], stages: Mapping[str, object]) -> None:
    """Write a workspace with campaign `TWIN`: the VT 690 flies `plan`."""
    campaign = folder / "campaigns" / TWIN
    campaign.mkdir(parents=True, exist_ok=True)
    (folder / "params.yaml").write_text(f"campaigns: [{TWIN}]\n", encoding="utf-8")
    (campaign / "plan.yaml").write_text(yaml.safe_dump(plan), encoding="utf-8")
    manifest = {
        "kind": "twin",
        "vehicle": "vt690",
        "simulate": {"plan": "plan.yaml", "seed": 11},
        "stages": dict(stages),
    }
    (campaign / "campaign.yaml").write_text(yaml.safe_dump(manifest), encoding="utf-8")


def copy_workspace(workspace: Path, folder: Path) -> Path:
    """Copy a workspace with its results, links as links; return `folder`."""
    shutil.copytree(workspace, folder, symlinks=True, dirs_exist_ok=True)
    return folder
