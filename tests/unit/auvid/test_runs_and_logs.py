"""Runs and logs in Python are those of the commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import auvid

LOG = "campaigns/example/logs/synthetic_run.csv"
COLUMNS = "campaigns/example/columns/synthetic_run.yaml"


@pytest.fixture(scope="module")
def results(short_workspace: Path) -> auvid.RunResults:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(short_workspace)
        return auvid.open_run("example")


def test_a_table_comes_with_its_units(results: auvid.RunResults, short_workspace: Path) -> None:
    fused = results["fuse/train/fused"]
    raw = pd.read_parquet(short_workspace / "runs/example/fuse/train/fused.parquet")
    pd.testing.assert_frame_equal(fused, raw)
    assert fused.attrs["units"]["u_dot_m_s2"] == "m/s^2"
    assert fused.attrs["frames"]["u_m_s"] == "body FRD"
    assert results.table("validate/error_table").attrs["units"]["j0"] == "N or N m"


def test_other_artefacts_come_by_name(results: auvid.RunResults, short_workspace: Path) -> None:
    assert "validate/ranking" in results
    assert results["validate/ranking"].models[0].name == "fossen"
    assert results.report == short_workspace / "runs/example/report/report_html.html"
    assert results.answer == results["report/answer"].decode()
    assert set(results.models) == {"fossen"}
    assert results.model.name == "fossen"


def test_what_the_run_lacks_is_an_error_in_words(results: auvid.RunResults) -> None:
    with pytest.raises(auvid.PipelineError, match=r"no such artefact.*Did you mean"):
        results["validate/error_tabel"]
    with pytest.raises(auvid.PipelineError, match="not a table; found 'document'"):
        results.table("validate/ranking")


def test_a_run_is_up_to_date_after_the_command(
    results: auvid.RunResults,
    short_workspace: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(short_workspace)
    before = {name: results[name] for name in ("report/answer",)}
    again = auvid.run("example", until="fuse", progress=False)
    assert capfd.readouterr() == ("", "")
    assert again["report/answer"] == before["report/answer"]
    with pytest.raises(auvid.PipelineError, match="no such stage"):
        auvid.run("example", only="fues", progress=False)


def test_a_log_is_read_into_streams(short_workspace: Path) -> None:
    log = auvid.read_log(short_workspace / LOG, columns=short_workspace / COLUMNS)
    assert {"imu", "attitude", "depth", "velocity", "actuators"} <= set(log.streams)
    assert log.streams["velocity"].attrs["units"]["u_m_s"] == "m/s"
    assert list(np.unique(np.diff(log.streams["velocity"]["time_us"]))) == [100_000]
    assert "force model" in log.findings.attrs["verdicts"][log.name]
    pd.testing.assert_frame_equal(
        log.findings, auvid.check(short_workspace / LOG, columns=short_workspace / COLUMNS)
    )


def test_a_file_that_is_no_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "dive.BIN"
    path.write_bytes(b"nothing of a log" * 50)
    with pytest.raises(auvid.PipelineError):
        auvid.read_log(path)
    (row,) = auvid.check(path).to_dict("records")
    assert (row["id"], row["severity"]) == ("refused", "error")
    with pytest.raises(auvid.PipelineError, match="no such campaign"):
        auvid.open_run("exampel_of_nobody")
