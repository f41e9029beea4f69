"""The recording of a raw log: streams by unit, gaps, spans, findings, path; thinning
and rounding of what is sent.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from auvid.stages.report.recording.log_recording import last_before, log_text, record_log
from auvid.stages.report.recording.rerun_stream import broken, rounded, thinned
from tests.support.golden_recording import GOLDEN, HEALTH, INFO, recording, tables

RERUN = Path(sys.executable).with_name("rerun")


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("log") / "log.rrd"
    file.write_bytes(recording())
    assert (
        subprocess.run(
            [str(RERUN), "rrd", "verify", str(file)], capture_output=True, check=False
        ).returncode
        == 0
    )
    return subprocess.run(
        [str(RERUN), "rrd", "print", "-vvv", str(file)], capture_output=True, text=True, check=True
    ).stdout


def test_every_stream_is_there_by_unit_and_spans_messages_and_path(printed: str) -> None:
    streams = ("raw/attitude/deg", "raw/velocity/m_s", "raw/depth/m", "raw/actuators/us")
    spans = ("spans/mode", "spans/armed", "spans/legs/train\\ 1", "spans/pauses/velocity")
    for entity in (
        *streams,
        *spans,
        "log/findings",
        "log/events",
        "log/pauses/velocity",
        "path/vehicle",
        "path/line",
        "answer/text",
    ):
        assert f"/{entity} - " in printed, entity
    assert "velocity pauses for 20." in printed
    assert "path from velocity and attitude, reckoned" in printed


def test_text_says_what_the_log_is_for() -> None:
    words = log_text("dive", INFO, HEALTH)
    for line in (
        "**A force model can be fitted in surge.**",
        "- ! Hardly any motion in roll.",
        "- synthesise roll: hardly any motion",
        "- a note",
    ):
        assert line in words.splitlines()
    assert "| depth | BARO\\|x | 600 | 10 | 0.1 s |" in words


def test_recording_is_the_golden_one(tmp_path: Path) -> None:
    file = tmp_path / "log.rrd"
    file.write_bytes(recording())
    done = subprocess.run(
        [str(RERUN), "rrd", "compare", str(GOLDEN), str(file)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, (
        f"if this is meant: python -m tests.support.golden_recording\n{done.stderr[:2000]}"
    )


def test_hostile_texts_cannot_act_on_a_terminal(printed: str) -> None:
    assert "\x1b" not in printed
    assert "\u202e" not in printed
    assert "owned" in printed


def test_log_without_any_number_is_recorded(tmp_path: Path) -> None:
    file = tmp_path / "bare.rrd"
    file.write_bytes(
        record_log("bare", {"events": tables()["events"]}, INFO, {**HEALTH, "findings": []})
    )
    assert (
        subprocess.run(
            [str(RERUN), "rrd", "verify", str(file)], capture_output=True, check=False
        ).returncode
        == 0
    )


def test_values_keep_21_bits_and_gaps_stay() -> None:
    values = np.array([np.pi, -1e-300, 0.0, 1e300, np.nan, np.inf, 1500.0, -np.finfo(float).max])
    near = rounded(values)
    np.testing.assert_allclose(near, values, rtol=2.0**-21)
    assert near[6] == 1500.0
    np.testing.assert_array_equal(near.view(np.uint64)[[0, 3]] & np.uint64(0xFFFFFFFF), 0)


def test_line_breaks_at_a_pause_and_nowhere_else() -> None:
    times, values = broken(np.array([0.0, 1.0, 9.0, 10.0]), np.arange(8.0).reshape(4, 2), 2.0)
    np.testing.assert_array_equal(times, [0.0, 1.0, 1.001, 9.0, 10.0])
    np.testing.assert_array_equal(np.isnan(values[:, 0]), [False, False, True, False, False])


def test_thinning_keeps_every_peak_in_its_bin_and_in_order() -> None:
    rng = np.random.default_rng(3)
    times, values = np.arange(10_000.0), rng.standard_normal((10_000, 3))
    values[5_003] = [90.0, -90.0, 0.0]
    values[2_000:2_200] = np.nan
    some, kept = thinned(times, values.T, 100)
    assert some.size == 200
    assert np.all(np.diff(some) > 0)
    np.testing.assert_array_equal(np.nanmax(kept, axis=0), np.nanmax(values, axis=0))
    np.testing.assert_array_equal(np.nanmin(kept, axis=0), np.nanmin(values, axis=0))
    peak = some[np.nanargmax(kept[:, 0])]
    assert abs(peak - 5_003) <= 100  # a bin
    assert np.isnan(kept[(some >= 2_000) & (some < 2_200)]).all()
    short, same = thinned(times[:150], values[:150].T, 100)
    assert (short.size, same.shape) == (150, (150, 3))


def test_thinning_of_an_odd_length_loses_nothing_at_the_end() -> None:
    values = np.zeros((1_003, 1))
    values[-1] = 7.0
    times, kept = thinned(np.arange(1_003.0), values.T, 100)
    assert kept.max() == 7.0
    assert times[-1] <= 1_002.0


def test_held_is_the_last_sample_before() -> None:
    last = last_before(
        np.array([-1.0, 0.5, 2.0, 9.0]), np.array([0.0, 1.0, 2.0]), np.array([10.0, 11.0, 12.0])
    )
    np.testing.assert_array_equal(last, [10.0, 10.0, 12.0, 12.0])


def test_finding_stands_at_its_time_and_others_at_the_start(tmp_path: Path) -> None:
    item = {**HEALTH["findings"][0], "text": "1 gap.", "at_s": 7.5}
    file = tmp_path / "log.rrd"
    file.write_bytes(
        record_log(
            "dive",
            tables(),
            INFO,
            {**HEALTH, "findings": [item, {**item, "text": "Whole log.", "at_s": None}]},
        )
    )
    result = subprocess.run(
        [str(RERUN), "rrd", "print", "-vvv", str(file)], capture_output=True, text=True, check=True
    ).stdout
    chunk = result[result.index("/log/findings - ") :]
    lines = [line for line in chunk.splitlines() if "1 gap." in line or "Whole log." in line][:2]
    assert "Whole log." in lines[0]
    assert "P0D" in lines[0]
    assert "PT7.5" in lines[1]
