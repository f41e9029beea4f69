"""The recording: on one timeline, named and coloured as in the report, verified and compared by Rerun's own tool."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from hydro.dynamics.kinematics import rotation_body_to_ned
from stages.report import Params, run
from stages.report.blueprint import _range
from stages.report.recording import _quaternions, find_table, make_clock, markdown
from stages.report.summary import summarise
from tests.support.example_run import ExampleRun, example_run

RERUN = Path(sys.executable).with_name("rerun")


@pytest.fixture(scope="module")
def made() -> ExampleRun:
    return example_run({"train": 6.0, "check": 3.0})


@pytest.fixture(scope="module")
def recordings(made: ExampleRun, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    files = [tmp_path_factory.mktemp("recordings") / f"{name}.rrd" for name in ("one", "two")]
    for file in files:
        file.write_bytes(run(made.inputs(), Params()).recording)
    return files


def rerun_rrd(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(RERUN), "rrd", *map(str, words)], capture_output=True, text=True, timeout=60, check=False)


def test_rerun_accepts_the_recording(recordings: list[Path]) -> None:
    result = rerun_rrd("verify", recordings[0])
    assert result.returncode == 0, result.stderr


def test_two_recordings_of_one_run_compare_equal(recordings: list[Path]) -> None:
    result = rerun_rrd("compare", *recordings)
    assert result.returncode == 0, result.stderr[:2000]


def test_recording_holds_every_group_once_per_segment_and_no_wall_clock(recordings: list[Path]) -> None:
    printed = rerun_rrd("print", recordings[0]).stdout
    chunks = [line for line in printed.splitlines() if line.startswith("Chunk")]
    assert sum("/state/velocity/fused - " in line and "Scalars" in line for line in chunks) == 2
    assert sum("/residual/X/models - " in line and "Scalars" in line for line in chunks) == 2, "models share the clock and so the entity"
    assert sum("/path/vehicle - " in line for line in chunks) == 2
    assert any("with 121 rows" in line and "/residual/X/models" in line for line in chunks), "120 samples and the end of the line"
    assert any("/log/events" in line for line in chunks)
    assert "log_time" not in printed
    assert "log_tick" not in printed


def test_segments_stand_at_their_place_and_logs_one_after_the_other(made: ExampleRun) -> None:
    logs = {"dive": made.logs["dive"], "next": {**made.logs["dive"], "start_us": 5_000_000, "end_us": 8_000_000}}
    segments = {**made.segments, "later": {**made.segments["train"], "log": "next", "leg_start_s": 1.0}}
    clock = make_clock(segments, logs)
    assert clock.segments == {"train": 0.0, "check": 6.0, "later": pytest.approx(9.0 + 10.0 + 1.0)}
    events = made.tables["ingest/dive/events"]
    times = clock.seconds("ingest/next/events", events)
    assert times is not None
    assert times[0] == pytest.approx(61.0 - 5.0 + 19.0)
    assert clock.seconds("ingest/unknown/events", events) is None


@pytest.mark.parametrize(
    ("owner", "wanted", "found"),
    [
        ("fuse/train", "fused", "fuse/train/fused"),
        ("fuse/check", "resampled", "resample/check/resampled"),
        ("validate", "predictions/train", "validate/predictions/train"),
        ("validate", "fuse/train/fused", "fuse/train/fused"),
        ("validate", "resampled", None),
        ("fuse/train", "absent", None),
    ],
)
def test_view_finds_its_table(made: ExampleRun, owner: str, wanted: str, found: str | None) -> None:
    assert find_table(made.tables, owner, wanted) == found


def test_quaternions_turn_as_the_euler_angles_do() -> None:
    euler = np.array([[0.1, -0.4, 2.0], [0.0, 0.0, np.pi / 2], [-3.0, 1.2, -0.7]])
    for angles, (x, y, z, w) in zip(euler, _quaternions(euler), strict=True):
        expected = rotation_body_to_ned(angles)
        turned = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        np.testing.assert_allclose(turned, expected, atol=1e-12)  # rounding of products of sines


def test_text_beside_the_plots_names_the_model_and_what_fails(made: ExampleRun) -> None:
    summary = summarise(made.cards, made.error_table(), made.segments, made.logs, made.sections, made.vehicle)
    words = markdown("A dive \x1b[31m", summary, made.segments, make_clock(made.segments, made.logs))
    assert summary.headline in words
    assert "| Linear | 0.62 |" in words
    assert "**1." in words
    assert "\x1b" not in words
    assert "- check: validation, 6.0 to 9.0 s (log dive)" in words


def test_recording_leaves_no_global_stream_behind(made: ExampleRun) -> None:
    run(made.inputs(), Params())
    assert rr.get_global_data_recording() is None


def test_names_that_are_no_plain_words_are_recorded(tmp_path: Path) -> None:
    made = example_run({"train.1": 4.0, "ä b\x1b[31m": 2.0})
    made.campaign["title"] = "<b>|\n\x07"
    file = tmp_path / "odd.rrd"
    file.write_bytes(run(made.inputs(), Params()).recording)
    assert rerun_rrd("verify", file).returncode == 0
    printed = rerun_rrd("print", file).stdout
    assert "/path/train.1 - " in printed
    assert printed.count("/path/vehicle - ") == 2
    assert "\x1b[31m" not in printed


def test_depth_is_shown_in_its_own_range() -> None:
    assert _range("raw/depth", {"raw/depth": (13.0, 14.0), "raw/other": (0.0, 99.0)}) == pytest.approx((12.94, 14.06))
    assert _range("residual/X", {"residual/X": (-1.0, 0.0), "residual/X/models": (0.0, 3.0)}) == pytest.approx((-1.24, 3.24))
    assert _range("raw/depth", {}) == (0.0 - 0.06, 1.0 + 0.06)
    assert _range("a", {"a": (2.0, 2.0)}) == pytest.approx((1.8, 2.2))
