"""A workspace of toy stages."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvid.pipeline.commands import open_run
from tests.support import toy_stages


@pytest.fixture
def toy_workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace whose stages are the toys."""
    (tmp_path / "params.yaml").write_text("campaigns: [toy]\n")
    toy_stages.write_campaign(tmp_path / "campaigns" / "toy")
    (tmp_path / "vehicles").mkdir()
    (tmp_path / "vehicles" / "toy.yaml").write_text(toy_stages.VEHICLES["toy"].read_text())
    monkeypatch.setattr(open_run, "STAGES", toy_stages.STAGES)
    monkeypatch.setattr(open_run, "KINDS", toy_stages.KINDS)
    monkeypatch.chdir(tmp_path)
    return tmp_path
