"""Campaigns against their golden tables and figures: they hold, with other processor
kernels too; a change is named with the stage where it began; DVC shows the same.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from auvid.data_schemas.errors import DataError
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.regress import golden_figures as figures
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.commands.regress import regress_command as regress
from auvid.pipeline.commands.regress.golden_tables import Tables
from auvid.pipeline.execution.engines import Serial
from auvid.pipeline.output import OUTPUT
from tests.support.campaign_runs import (
    FEWER,
    LAST_STAGE,
    NO_FREE_RUN,
    ROOT,
    copy_workspace,
    run_campaign,
    write_workspace,
)

NAME = "bluerov2_dvl"
GOLDEN = ROOT / "tests" / "golden" / NAME
ALL = [path.name for path in sorted((ROOT / "tests" / "golden").iterdir())]
FIGURES = ("J", "J0", "ratio", *"XYZKMN")


def add_golden_tables(folder: Path) -> None:
    """Add the golden tables of the dive and the declarations of DVC to a workspace."""
    (folder / "tests" / "golden").mkdir(parents=True)
    (folder / "tests" / "golden" / NAME).symlink_to(GOLDEN, target_is_directory=True)
    (folder / "dvc.yaml").write_bytes((ROOT / "dvc.yaml").read_bytes())
    (folder / ".dvc").mkdir()
    (folder / ".dvc" / "config").write_text(
        "[core]\n    no_scm = true\n    analytics = false\n    check_update = false\n"
    )


@pytest.fixture(scope="module")
def workspace(
    committed_run: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Path]:
    """Workspace of the dive, run up to validation."""
    folder = copy_workspace(committed_run(NAME), tmp_path_factory.mktemp("golden"))
    add_golden_tables(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


@pytest.fixture(scope="module")
def tables(workspace: Path) -> Tables:
    return regress.open_setting(NAME, None).tables


def test_results_that_are_missing_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_workspace(tmp_path, NAME)
    add_golden_tables(tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=rf"stage ingest has not been run\. auvid run {NAME}"):
        regress.open_setting(NAME, None)


def test_the_dive_holds_its_golden_tables(
    workspace: Path, tables: Tables, capsys: pytest.CaptureFixture[str]
) -> None:
    setting = regress.open_setting(NAME, None)
    assert setting.folder.resolve() == GOLDEN
    assert regress.check(setting), capsys.readouterr().out
    cells = int(capsys.readouterr().out.removeprefix(f"{NAME}: all ").partition(" cells hold")[0])
    assert cells > 2 * 10 * 11 + 1000


@pytest.mark.parametrize("name", sorted(LAST_STAGE))
def test_stages_that_have_run_hold_their_golden_figures(
    committed_run: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Every number and verdict of the stages that tests run of a campaign."""
    monkeypatch.chdir(committed_run(name))
    run = open_run(name)
    rest = [stage.name for stage in run.graph.stages if not run.manifests[stage.name].records]
    new = figures.figures_of(run)
    files = [file for file in figures.FILES if file != "free_run" or name not in FEWER]
    golden_figures = figures.without(figures.read_figures(ROOT / "tests" / "golden" / name), rest)
    old = {file: golden_figures[file] for file in files}
    within, departures = figures.compare(old, {file: new[file] for file in files})
    assert departures == [], figures.first_change(departures)
    assert within >= 50


@pytest.mark.release
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", ALL)
def test_every_campaign_holds_its_golden_tables_and_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    write_workspace(tmp_path, name)
    monkeypatch.chdir(tmp_path)
    run = open_run(name)
    run.execute(figures.stages_of(run), Serial())
    baseline = ROOT / "tests" / "golden" / name
    assert regress.check(regress.open_setting(name, baseline))


def test_metrics_are_the_error_table(workspace: Path, tables: Tables) -> None:
    """Every figure of error_metrics.json, to its six digits, is the one of
    error_table.parquet.
    """
    metrics = json.loads(
        (workspace / "runs" / NAME / "validate" / "error_metrics.json").read_text(encoding="utf-8")
    )
    assert set(metrics) == set(tables)
    for use, models in tables.items():
        assert metrics[use] == {
            model: {name: row[name] for name in FIGURES if name != "J0"}
            for model, row in models.items()
        }


def test_dvc_shows_the_same_figures(workspace: Path, tables: Tables) -> None:
    settings = {
        "DVC_NO_ANALYTICS": "1",
        "DVC_SITE_CACHE_DIR": str(workspace / ".dvc" / "tmp" / "site"),
    }
    command = [str(Path(sys.executable).parent / "dvc"), "metrics", "show", "--json"]
    done = subprocess.run(
        command,
        cwd=workspace,
        env=os.environ | settings,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    dvc_metrics = json.loads(done.stdout)[""]["data"][f"runs/{NAME}/validate/error_metrics.json"]
    for use, models in tables.items():
        for model, row in models.items():
            assert dvc_metrics["data"][use][model] == {
                name: row[name] for name in FIGURES if name != "J0"
            }


def run_on_other_kernels(name: str, folder: Path) -> None:
    """Run a campaign up to validation as a program on the oldest BLAS kernels and numpy
    without its wide instructions, as on another machine.
    """
    program_text = "from numpy._core import _multiarray_umath as m; print(*m.__cpu_dispatch__)"
    wide = subprocess.run(
        [sys.executable, "-c", program_text], capture_output=True, text=True, check=True
    ).stdout.strip()
    program = (
        "import sys; from auvid.pipeline.cli import main; sys.argv = ['auvid', *sys.argv[1:]];"
        " main()"
    )
    command = [sys.executable, "-c", program, "run", name, "--until", "validate"]
    other = os.environ | {
        "OPENBLAS_CORETYPE": "Nehalem",
        "NPY_DISABLE_CPU_FEATURES": wide,
        "PYTHONPATH": str(ROOT),
    }
    done = subprocess.run(
        command, cwd=folder, env=other, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def assert_same_tables(ours: Path, theirs: Path) -> None:
    """Compare the error tables of two runs.

    Measured: 2e-10 of the figure at most; the smallest tolerance is 1e-3. So 1e-7
    leaves room on both sides.
    """
    here, there = (
        pq.ParquetFile(runs / "validate" / "error_table.parquet").read() for runs in (ours, theirs)
    )
    for name in ("use", "leg", "model", "axis", "n_bar", "rank", "samples"):
        assert there[name].to_pylist() == here[name].to_pylist()
    for name in ("rms", "j0", "ratio"):
        np.testing.assert_allclose(
            there[name].to_numpy(), here[name].to_numpy(), rtol=1e-7, atol=0.0, err_msg=name
        )


def test_other_processor_kernels_give_the_tables_of_the_example(
    short_template: Path, short_workspace: Path, tmp_path: Path
) -> None:
    copy_workspace(short_template, tmp_path)
    run_on_other_kernels("example", tmp_path)
    assert_same_tables(short_workspace / "runs/example", tmp_path / "runs/example")


@pytest.mark.release
def test_other_processor_kernels_give_the_tables_of_the_dive(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_workspace(tmp_path, NAME, NO_FREE_RUN)
    run_on_other_kernels(NAME, tmp_path)
    assert_same_tables(workspace / "runs" / NAME, tmp_path / "runs" / NAME)
    monkeypatch.chdir(tmp_path)
    old, new = figures.read_figures(GOLDEN), figures.figures_of(open_run(NAME))
    for file in ("stages", "coefficients", "results"):
        _, departures = figures.compare({file: old[file]}, {file: new[file]})
        # The run ends before the shelf is judged, and nothing up to there needs the coasts.
        departures = [item for item in departures if item.stage not in {"score_shelf", "coast"}]
        assert departures == [], figures.first_change(departures)


def test_a_change_of_method_is_named_and_stale_results_are_refused(
    workspace: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Three per cent more cutoff frequency moves the models that extrapolate, not what
    the measured force is.
    """
    copy_workspace(workspace, tmp_path)
    monkeypatch.chdir(tmp_path)
    shutil.rmtree(tmp_path / "campaigns")
    write_workspace(tmp_path, NAME, {"fuse": {"cutoff_hz": 1.03}, **NO_FREE_RUN})
    with pytest.raises(
        DataError, match=rf"the results of stage fuse are not up to date\. auvid run {NAME}"
    ):
        regress.open_setting(NAME, None)
    run_campaign(tmp_path, NAME, "validate")
    old, new = golden.read_tables(GOLDEN), regress.open_setting(NAME, None)
    assert not regress.check(new)
    document = OUTPUT.answer
    assert document["first_change"].startswith("stage fuse (fused: ")
    assert {item["stage"] for item in document["figures"]}.isdisjoint({"ingest", "resample"})
    departures = document["departures"]
    sizes = [item["times_tolerance"] for item in departures]
    assert sizes == sorted(sizes, reverse=True)
    for item in departures:
        place = (item["use"], item["model"], item["column"])
        assert item["reference"] == old[place[0]][place[1]][place[2]]
        assert item["value"] == new.tables[place[0]][place[1]][place[2]]
        assert abs(item["change"]) > item["allowed"] > 0.0
    assert {item["column"] for item in departures} <= {"J", "ratio", *"XYZKMN"}
    assert ("validation", "mcfarland", "X") in {
        (item["use"], item["model"], item["axis"]) for item in departures
    }
