"""Without the extra `view`, a run ends well and says what is missing and how to get it."""

from __future__ import annotations

import sys

import pytest
from typer.testing import CliRunner

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline import cli
from auvid.pipeline.commands.look.inspect import rerun_viewer
from auvid.stages.report import Params, run
from tests.support.example_run import example_run

INSTALL = r"pip install 'auvid\[view\]'"


@pytest.fixture(autouse=True)
def _without_rerun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)


def test_the_report_is_written_without_a_recording() -> None:
    with pytest.warns(UserWarning, match=INSTALL):
        outputs = run(example_run({"train": 4.0, "check": 2.0}).inputs(), Params())
    assert outputs.recording is None
    assert outputs.report_html.startswith(b"<!")
    assert outputs.answer


def test_a_viewer_that_is_not_there_says_how_to_get_it() -> None:
    with pytest.raises(PipelineError, match=INSTALL):
        rerun_viewer.require_rerun()
    refused = CliRunner().invoke(cli.app, ["inspect", "dive.BIN", "--save", "dive.rrd"])
    assert "rerun-sdk is not installed" in str(refused.exception)
