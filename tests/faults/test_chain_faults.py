"""Bad input through the command line, on the short example of a new workspace: exit
code, words, no traceback, nothing half-written.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from auvid.pipeline import cli
from auvid.pipeline.store.atomic_files import TEMPORARY
from tests.support.campaign_runs import copy_workspace

Edit = Callable[[Path], None]
EXAMPLE = Path("campaigns/example")
MANIFEST, MAP, LOG = (
    EXAMPLE / "campaign.yaml",
    EXAMPLE / "columns/synthetic_run.yaml",
    EXAMPLE / "logs/synthetic_run.csv",
)
VEHICLE = Path("vehicles/example_rov.yaml")


@pytest.fixture
def workspace(short_template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = copy_workspace(short_template, tmp_path / "workspace")
    monkeypatch.chdir(folder)
    return folder


def auvid(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str
) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command in this process."""
    monkeypatch.setattr(sys, "argv", ["auvid", *words])
    monkeypatch.setattr(cli.signal, "signal", lambda *_: None)
    code: Any = 0
    try:
        cli.main()
    except SystemExit as end:
        code = end.code or 0
    printed = capsys.readouterr()
    return int(code), printed.out, printed.err


def replaced(file: Path, old: str, new: str) -> Edit:
    """Replace one text in a file of the workspace; the text must be there."""

    def edit(root: Path) -> None:
        text = (root / file).read_text(encoding="utf-8")
        assert old in text, f"{old!r} is not in {file}"
        (root / file).write_text(text.replace(old, new), encoding="utf-8")

    return edit


def lines(change: Callable[[list[str]], list[str]]) -> Edit:
    """Change the rows of the log (header first)."""

    def edit(root: Path) -> None:
        rows = (root / LOG).read_text(encoding="utf-8").splitlines()
        (root / LOG).write_text("\n".join(change(rows)) + "\n", encoding="utf-8")

    return edit


def without_columns(*names: str) -> Edit:
    """Leave columns out of the column map."""

    def edit(root: Path) -> None:
        kept = [
            row
            for row in (root / MAP).read_text(encoding="utf-8").splitlines()
            if not any(f"column: {name}," in row for name in names)
        ]
        (root / MAP).write_text("\n".join(kept) + "\n", encoding="utf-8")

    return edit


def cells(rows: list[str], column: str, value: str, *, every: int = 1) -> list[str]:
    """The rows with a column set to a value in every so many of them."""
    index = rows[0].split(",").index(column)
    split = [row.split(",") for row in rows]
    for row in split[1::every]:
        row[index] = value
    return [",".join(row) for row in split]


def neutral(rows: list[str]) -> list[str]:
    for number in range(1, 5):
        rows = cells(rows, f"pulse_{number}", "1500")
    return rows


def edited_vehicle(pattern: str, new: str) -> Edit:
    def edit(root: Path) -> None:
        text = (root / VEHICLE).read_text(encoding="utf-8")
        changed, count = re.subn(pattern, new, text, count=1, flags=re.DOTALL)
        assert count == 1, f"{pattern!r} is not in the vehicle file"
        (root / VEHICLE).write_text(changed, encoding="utf-8")

    return edit


REFUSED: dict[str, tuple[Edit, str, tuple[str, ...]]] = {
    "FILE_MISSING": (
        lambda root: (root / LOG).unlink(),
        "ingest",
        ("synthetic_run.csv", "campaign.yaml", "log 'run'"),
    ),
    "KEY_UNKNOWN": (
        replaced(MANIFEST, "kind:", "kinds: x\nkind:"),
        "ingest",
        ("campaign.yaml", "'kinds'", "Did you mean 'kind'?"),
    ),
    "PARAMETER_UNKNOWN": (
        replaced(MANIFEST, "method: kinematic", "methd: kinematic"),
        "ingest",
        ("stages.fuse.methd", "unknown parameter", "Did you mean 'method'?"),
    ),
    "PARAMETER_REPLACED": (
        replaced(MANIFEST, "method: kinematic", "estimate_dvl_arm: true"),
        "ingest",
        ("stages.fuse.estimate_dvl_arm", "unknown parameter", "write 'installation: estimate'"),
    ),
    "UNIT_WRONG": (
        replaced(MAP, "field: depth_m, unit: m", "field: depth_m, unit: kg"),
        "ingest",
        ("synthetic_run.csv", "columns[10].unit", "wrong unit", "'kg'", "a unit of m"),
    ),
    "VEHICLE_UNIT_WRONG": (
        edited_vehicle(r"(mass: \{value: [\d.]+, unit:) kg", r"\1 m"),
        "residual",
        ("rigid_body.mass", "unit", "kg"),
    ),
    "VELOCITY_MISSING": (
        without_columns("u", "v", "w"),
        "fuse",
        ("cannot feed stage fuse", "log 'run': no velocity", "heave and yaw only", "kind bench"),
    ),
    "ATTITUDE_MISSING": (
        without_columns("roll_deg", "pitch_deg", "yaw_deg"),
        "resample",
        ("cannot feed stage resample", "log 'run': no attitude", "column map"),
    ),
    "DEPTH_MISSING": (
        without_columns("depth_m"),
        "resample",
        ("cannot feed stage resample", "log 'run': no depth", "column map"),
    ),
    "PULSES_MISSING": (
        without_columns("pulse_1", "pulse_3"),
        "residual",
        (
            "cannot feed stage residual",
            "no pwm_1_us and pwm_3_us among the actuators",
            "--until fuse",
        ),
    ),
    "LEG_OUTSIDE_LOG": (
        replaced(MANIFEST, "start_s: 20, end_s: 29", "start_s: 600, end_s: 640"),
        "resample",
        ("legs that lie outside the log", "leg 'check': start_s is 600, log 'run' has 29.9 s"),
    ),
    "INERTIA_SINGULAR": (
        edited_vehicle(
            r"\[0\.25, 0\.0, 0\.0\]\n( *- )\[0\.0, 0\.25, 0\.0\]",
            r"[0.25, 0.25, 0.0]\n\1[0.25, 0.25, 0.0]",
        ),
        "resample",
        ("rigid_body.inertia", "not positive definite", "body origin"),
    ),
    "NO_ACTUATORS": (
        edited_vehicle(r"\nactuators:.*\Z", "\nactuators: {}\n"),
        "residual",
        ("the vehicle file names no actuator", "allow_no_actuation"),
    ),
    "NO_ACTUATOR_ACTIVITY": (
        lines(neutral),
        "residual",
        ("log 'run': no actuator acts", "allow_no_actuation"),
    ),
    "ALL_CELLS_NAN": (lines(lambda rows: cells(rows, "u", "nan")), "fuse", ("velocity",)),
    "MODEL_UNKNOWN": (
        replaced(MANIFEST, "models: [fossen]", "models: [fosen]"),
        "synthesise",
        ("stages.synthesise.models", "Did you mean 'fossen'?"),
    ),
    "NO_TRAINING_LEG": (
        replaced(MANIFEST, "use: training", "use: validation"),
        "synthesise",
        ("campaign.yaml, field 'legs': the campaign has no training leg", "use: training"),
    ),
    "CUTOFF_BEYOND_RATE": (
        replaced(MANIFEST, "cutoff_hz: 2.0", "cutoff_hz: 60"),
        "fuse",
        ("cutoff_hz", "half the sample rate"),
    ),
    "EDGES_LONGER_THAN_LEG": (
        replaced(MANIFEST, "cutoff_hz: 2.0", "cutoff_hz: 2.0, edge_s: 40"),
        "fuse",
        ("edge_s", "too short"),
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(
    name: str, workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    edit, stage, pieces = REFUSED[name]
    edit(workspace)
    code, _, err = auvid(monkeypatch, capsys, "run", "example", "--until", "validate")
    assert code == 1
    assert "Traceback" not in err
    assert "internal fault" not in err
    for piece in pieces:
        assert piece in err, f"{piece!r} is not in:\n{err}"
    folder = workspace / "runs/example"
    assert not list(folder.rglob(f"*{TEMPORARY}*"))
    assert not (folder / "validate/error_table.parquet").exists()
    failed = folder / stage
    vouched = (
        json.loads((failed / "manifest.json").read_text())["items"]
        if (failed / "manifest.json").is_file()
        else {}
    )
    written = (
        [path for path in failed.rglob("*") if path.is_file() and path.name != "manifest.json"]
        if failed.is_dir()
        else []
    )
    assert not written or vouched, f"{stage} left files that no manifest vouches for"


def test_wrong_use_exits_with_2(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (("run",), ("run", "example", "--bogus"), ("runn", "example")):
        code, _, err = auvid(monkeypatch, capsys, *words)
        assert code == 2
        assert "Traceback" not in err


def run_fine(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str
) -> str:
    code, out, err = auvid(monkeypatch, capsys, "run", "example", "--until", "validate", *words)
    assert code == 0, err
    return out


def ratio(root: Path, model: str = "fossen", use: str = "training") -> float:
    metrics: dict[str, Any] = json.loads(
        (root / "runs/example/validate/error_metrics.json").read_text()
    )
    return float(metrics[use][model]["ratio"])


def dropped(root: Path) -> dict[str, int]:
    rows = pq.ParquetFile(root / "runs/example/ingest/run/dropped.parquet").read().to_pylist()
    return {f"{row['stream']}: {row['reason']}": row["count"] for row in rows}


def test_no_validation_leg_is_a_warning(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    replaced(MANIFEST, "  - {id: check, log: run, start_s: 20, end_s: 29, use: validation}\n", "")(
        workspace
    )
    out = run_fine(monkeypatch, capsys)
    assert "There is no validation leg" in out
    assert "warnings (1)" in out
    text = (workspace / "runs/example/validate/tables_text.txt").read_text()
    assert "Training (McCarter Table 5.2)" in text
    assert "Validation" not in text


def repeat_and_shuffle(rows: list[str]) -> list[str]:
    """Row 51 twice, and rows 101 and 102 exchanged."""
    return [*rows[:51], rows[50], *rows[51:100], rows[101], rows[100], *rows[102:]]


def test_repeated_and_backward_times_are_counted(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_fine(monkeypatch, capsys)
    clean = ratio(workspace)
    lines(repeat_and_shuffle)(workspace)
    out = run_fine(monkeypatch, capsys)
    assert "lost" in out
    assert "2 " in out
    counts = dropped(workspace)
    assert set(counts.values()) == {1}
    assert {key.split(": ")[0] for key in counts} == {
        "actuators",
        "attitude",
        "imu",
        "depth",
        "velocity",
    }
    assert ratio(workspace) == pytest.approx(clean, rel=0.05)
    assert auvid(monkeypatch, capsys, "run", "example", "--until", "validate", "--strict")[0] == 3


def test_nan_cells_are_counted_and_bridged_or_split(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Single NaN cells are bridged by the spline; a pause of 3 s in the velocity splits
    the leg.
    """

    def spoil(rows: list[str]) -> list[str]:
        rows = cells(rows, "gyro_x", "nan", every=50)
        return [*rows[:80], *cells([rows[0], *rows[80:110]], "u", "")[1:], *rows[110:]]

    lines(spoil)(workspace)
    run_fine(monkeypatch, capsys)
    segments = sorted(
        path.parent.name for path in (workspace / "runs/example/resample").glob("*/segment.json")
    )
    assert segments == ["check", "train.1", "train.2"]
    counts = {key.split(": ")[0]: number for key, number in dropped(workspace).items()}
    assert counts == {"imu": 6, "velocity": 30}
    fused = pq.ParquetFile(workspace / "runs/example/fuse/train.1/fused.parquet").read()
    assert all(np.isfinite(fused[name].to_numpy()).all() for name in fused.column_names)


def test_fault_in_one_leg_names_it_and_leaves_the_other(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pulses are neutral in the validation leg only: its item fails, the other is kept,
    and the next run starts from there.
    """
    lines(lambda rows: [*rows[:200], *neutral([rows[0], *rows[200:]])[1:]])(workspace)
    code, _, err = auvid(monkeypatch, capsys, "run", "example", "--until", "validate")
    assert code == 1
    assert "residual, segment 'check'" in err
    assert (workspace / "runs/example/residual/train/residual.parquet").is_file()
    assert not (workspace / "runs/example/residual/check/residual.parquet").exists()
    replaced(MANIFEST, "stages:", "stages:\n  residual: {allow_no_actuation: true}")(workspace)
    run_fine(monkeypatch, capsys)


def test_log_folder_that_cannot_be_written(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (workspace / "runs").mkdir()
    (workspace / "runs/example").write_text("a file where a folder should be")
    code, _, err = auvid(monkeypatch, capsys, "run", "example")
    assert (code, "Traceback" in err) == (1, False)
    assert os.fspath(Path("runs/example")) in err
