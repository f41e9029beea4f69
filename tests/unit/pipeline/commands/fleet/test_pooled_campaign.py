"""One campaign of the dives of a vehicle."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

import auvid
from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.pipeline.commands.fleet import pooled_campaign
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder
from auvid.pipeline.commands.fleet.pooled_campaign import pool_campaign
from auvid.pipeline.commands.open_run import open_run

FILES = {"one": "a.csv", "two": "a.csv", "three": "b.csv", "four": "b.csv", "five": "c.csv"}
COLUMNS = "time: {column: t, unit: s}\nstreams: {depth: {depth_m: {column: z, unit: m}}}\n"


def row(log: str, day: int | None, **changes: Any) -> dict[str, Any]:
    start = None if day is None else f"2026-05-{day:02d}T10:00:00Z"
    plain = {"state": "done", "reason": "", "vehicle": "bluerov2_heavy", "kind": "identification"}
    return {"log": log, "same_as": "", "start_utc": start, **plain, **changes}


@pytest.fixture
def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FleetFolder:
    """Five dives; the fourth has another setting, the fifth is not done."""
    place = FleetFolder(tmp_path / "fleet")
    for log, file in FILES.items():
        folder = place.campaign(log)
        (folder / "columns").mkdir(parents=True)
        (tmp_path / log).mkdir()
        (tmp_path / log / file).write_text("t,z\n0,1\n")
        (folder / "logs").mkdir()
        (folder / "logs" / file).symlink_to(tmp_path / log / file)
        (folder / "columns" / "a.yaml").write_text(COLUMNS)
        manifest = {
            "kind": "identification",
            "title": log,
            "vehicle": "bluerov2_heavy",
            "logs": [{"id": "dive", "file": f"logs/{file}", "columns": "columns/a.yaml"}],
            "legs": [
                {"id": "train", "log": "dive", "start_s": 0, "end_s": 9, "use": "training"},
                {"id": "check", "log": "dive", "start_s": 9, "end_s": 12, "use": "validation"},
            ],
            "accept": ["low_rate"] if log == "two" else [],
            "stages": {
                "fuse": {"cutoff_hz": {"two": 2.6}.get(log, 2.0)},
                "synthesise": {"trim": log != "four"},
            },
        }
        (folder / "campaign.yaml").write_text(yaml.safe_dump(manifest))
    place.prepare()
    rows = [
        row("two", 7),
        row("one", 3),
        row("three", 9),
        row("four", 11),
        row("five", 13, state="partly", reason="it is too short"),
        row("six", 14, vehicle="other"),
    ]
    table = SimpleNamespace(to_pylist=lambda: [dict(item) for item in rows])
    monkeypatch.setattr(pooled_campaign, "read_table", lambda *_: table)
    return place


def test_dives_of_a_vehicle_become_legs_of_one_campaign(fleet: FleetFolder) -> None:
    result = pool_campaign(fleet, "bluerov2_heavy")
    assert result.dives == ("one", "two", "three")
    assert result.legs == {"training": 3, "validation": 3}
    assert result.left_out["five"] == "it is too short"
    assert "settings" in result.left_out["four"]
    campaign = open_run(str(result.folder), fleet.workspace).campaign
    manifest = yaml.safe_load((result.folder / "campaign.yaml").read_text())
    assert [leg["id"] for leg in manifest["legs"]][:3] == ["one_train", "one_check", "two_train"]
    assert manifest["stages"]["fuse"] == {"cutoff_hz": 2.6}
    accepted = {log["id"]: log.get("accept") for log in manifest["logs"]}
    assert accepted == {"one": None, "two": ["low_rate"], "three": None}
    # The files of two dives have one name, and none is copied.
    assert (result.folder / "logs" / "one" / "a.csv").resolve().parent.name == "one"
    assert (result.folder / "logs" / "two" / "a.csv").resolve().parent.name == "two"
    assert campaign.name == "bluerov2_heavy_dives"


def test_a_change_of_the_vehicle_begins_anew(fleet: FleetFolder) -> None:
    result = pool_campaign(fleet, "bluerov2_heavy", since="two", name="after")
    assert result.dives == ("two", "three")
    assert result.left_out["one"] == "before two"
    with pytest.raises(UsageError, match=r"--since.*'none'"):
        pool_campaign(fleet, "bluerov2_heavy", since="none", name="x")


def test_what_cannot_be_pooled_is_refused(fleet: FleetFolder) -> None:
    with pytest.raises(UsageError, match=r"name the vehicle.*bluerov2_heavy"):
        pool_campaign(fleet, None)
    with pytest.raises(UsageError, match="no dive of this vehicle"):
        pool_campaign(fleet, "bluerov2_heavi")
    only = fleet.campaign("six")
    only.mkdir()
    (only / "campaign.yaml").write_bytes((fleet.campaign("one") / "campaign.yaml").read_bytes())
    with pytest.raises(PipelineError, match="fewer than 2 dives of other"):
        pool_campaign(fleet, "other")
    with pytest.raises(UsageError, match="not a name"):
        pool_campaign(fleet, "bluerov2_heavy", name="a/b")
    (fleet.index).write_text("{}")
    assert auvid.fleet(fleet.root).pool("bluerov2_heavy").name == "bluerov2_heavy_dives"
    with pytest.raises(PipelineError, match="nothing is overwritten"):
        pool_campaign(fleet, "bluerov2_heavy")
