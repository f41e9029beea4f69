"""Vehicle files are read once as long as they say the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvid.pipeline.campaigns import vehicle_files
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from auvid.pipeline.campaigns.yaml_files import YamlFile, yaml_of


def test_a_file_is_read_again_only_where_it_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = []

    def counted(path: Path, content: bytes) -> YamlFile:
        count.append(path)
        return yaml_of(path, content)

    monkeypatch.setattr(vehicle_files, "yaml_of", counted)
    path = tmp_path / "mine.yaml"
    text = (SHIPPED_VEHICLES / "remus100.yaml").read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    first = load_vehicle(path)
    assert load_vehicle(path) is first
    assert count == [path]
    path.write_text(text.replace("name: remus100", "name: other"), encoding="utf-8")
    assert load_vehicle(path).vehicle.document.name == "other"
    assert count == [path, path]
