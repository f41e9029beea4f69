"""Logs on a disk: folders of folders, copies, lists, files that are none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.pipeline.commands.fleet.discovery import FOLDER, Discovery, discover
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder
from auvid.pipeline.commands.fleet.surveys.csv_dives import GROUP, grouping
from auvid.pipeline.execution.engines import Serial
from auvid.pipeline.execution.task import Outcome, Task, execute
from auvid.pipeline.store.file_hashes import FileHashes


def search(target: Path, fleet: Path, *vehicles: str) -> Discovery:
    folder = FleetFolder(fleet)
    return discover(target, folder, vehicles, FileHashes(), grouping(Serial(), folder))


@pytest.fixture
def disk(tmp_path: Path) -> Path:
    disk = tmp_path / "disk"
    for name, content in {
        "a/one.BIN": b"first",
        "a/deep/er/two.tlog": b"second",
        "b/copy.BIN": b"first",
        "README.md": b"# words",
        ".hidden/three.BIN": b"third",
        "fleet/runs/four.BIN": b"fourth",
    }.items():
        path = disk / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return disk


def test_logs_of_folders_of_folders_and_copies(disk: Path) -> None:
    result = search(disk, disk / "fleet")
    names = {log.files[0].name: log for log in result.logs}
    assert sorted(names) == ["copy.BIN", "one.BIN", "two.tlog"]
    assert names["copy.BIN"].copy_of == names["one.BIN"].id
    assert names["one.BIN"].copy_of == ""
    assert result.others == {".md": 1}
    assert len({log.id for log in result.logs}) == 3


def test_a_log_that_grows_is_noticed(disk: Path) -> None:
    log = next(log for log in search(disk, disk / "fleet").logs if "one" in log.files[0].name)
    assert log.unchanged
    log.files[0].write_bytes(b"first and more")
    assert not log.unchanged


def test_a_list_of_paths(disk: Path, tmp_path: Path) -> None:
    listing = tmp_path / "list.txt"
    listing.write_text("# dives\ndisk/a/one.BIN\n\ndisk/nosuch.BIN\ndisk/far.BIN\n")
    (disk / "far.BIN").symlink_to("/media/other/far.BIN")
    logs = {log.files[0].name: log for log in search(listing, tmp_path / "fleet").logs}
    assert sorted(logs) == ["far.BIN", "nosuch.BIN", "one.BIN"]
    assert "cannot be read" in logs["nosuch.BIN"].fault
    assert "a link to /media/other/far.BIN, which is not there" in logs["far.BIN"].fault
    assert logs["one.BIN"].fault == ""
    noise = tmp_path / "list.dat"
    noise.write_bytes(b"\xff\xfe\xfd")
    with pytest.raises(PipelineError, match="no list of logs"):
        search(noise, tmp_path / "fleet")


def test_a_list_of_another_system_and_a_folder_in_it(disk: Path, tmp_path: Path) -> None:
    name = "disk/tr\u00e4ge\u2028 1.BIN"
    (tmp_path / name).write_bytes(b"fifth")
    listing = tmp_path / "list.txt"
    listing.write_bytes(f"\ufeffdisk/a/one.BIN\r\n{name}\r\ndisk/b\r\n".encode())
    logs = {log.files[0].name: log for log in search(listing, tmp_path / "fleet").logs}
    assert {item: log.fault for item, log in logs.items()} == {
        "one.BIN": "",
        Path(name).name: "",
        "b": FOLDER,
    }


def test_a_log_in_place_of_the_list_is_one_log(tmp_path: Path) -> None:
    table = tmp_path / "dive.csv"
    table.write_text("time_s,depth_m\n0,1\n1,2\n")
    (log,) = search(table, tmp_path / "fleet").logs
    assert log.files == (table,)


def test_a_folder_without_a_log_leaves_the_fleet_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "mount").mkdir()
    (tmp_path / "mount/README.md").write_text("words")
    with pytest.raises(PipelineError, match=r"there is no log here; found '1 \.md'"):
        search(tmp_path / "mount", tmp_path / "fleet")


def test_logs_of_another_fleet_below_the_folder_are_links(disk: Path, tmp_path: Path) -> None:
    for name in ("index.json", "tables/runs.parquet", "campaigns/one/logs/one.BIN"):
        path = disk / "a" / "old fleet" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"first")
    names = sorted(log.files[0].name for log in search(disk, disk / "fleet").logs)
    assert names == ["copy.BIN", "one.BIN", "two.tlog"]
    with pytest.raises(UsageError, match="--out"):
        search(disk, disk)


def test_vehicles_by_pattern_keep_two_vehicles_apart(disk: Path) -> None:
    result = search(disk, disk / "fleet", "a/deep/*=bluerov2_heavy", "bluerov2")
    vehicles = {log.files[0].name: Path(str(log.vehicle)).stem for log in result.logs}
    assert vehicles == {
        "one.BIN": "bluerov2",
        "copy.BIN": "bluerov2",
        "two.tlog": "bluerov2_heavy",
    }
    with pytest.raises(UsageError, match=r"fits no log; found 'c/\*'"):
        search(disk, disk / "fleet", "c/*=bluerov2", "bluerov2_heavy")
    with pytest.raises(UsageError, match="no such vehicle"):
        search(disk, disk / "fleet", "nosuch")


def test_tables_of_one_kind_are_dives_of_their_own(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / "disk").mkdir(exist_ok=True)
        (tmp_path / f"disk/{name}.csv").write_text(f"time_s,depth_m\n0,{len(name)}\n{name}\n")
    assert [len(log.files) for log in search(tmp_path / "disk", tmp_path / "fleet").logs] == [1, 1]


class Counting(Serial):
    """An engine that counts the folders it is given, and may lose them all."""

    def __init__(self, *, lose: bool = False) -> None:
        self.lose, self.folders = lose, 0

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        self.folders += len(tasks)
        assert {task.stage for task in tasks} <= {GROUP}
        return iter(
            Outcome(task.item, crash="died") if self.lose else execute(task) for task in tasks
        )


def test_workers_find_the_csv_files_of_one_dive_once(tmp_path: Path) -> None:
    for day in ("monday", "tuesday"):
        (tmp_path / "disk" / day).mkdir(parents=True)
        for name, column in (("depth", "depth_m"), ("battery", "voltage_v")):
            rows = "".join(f"{0.1 * row:.1f},{10 + row % 7}\n" for row in range(300))
            path = tmp_path / "disk" / day / f"{name}.csv"
            path.write_text(f"time_s,{column}\n{rows}")
    folder = FleetFolder(tmp_path / "fleet")

    def files(engine: Counting) -> list[int]:
        found_logs = discover(
            tmp_path / "disk", folder, (), FileHashes(), grouping(engine, folder)
        ).logs
        return [len(log.files) for log in found_logs]

    lost, first, second = Counting(lose=True), Counting(), Counting()
    assert files(lost) == [1, 1, 1, 1]
    assert files(first) == [2, 2], "what was lost is not remembered"
    assert files(second) == [2, 2]
    assert (lost.folders, first.folders, second.folders) == (2, 2, 0)
    assert [path.name for path in folder.root.iterdir()] == [".csv_files.json"]
