"""`auvid fleet run` on a small disk: states, what runs again, workers that die, page."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

import auvid
from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.commands.fleet import fleet_run, log_work
from auvid.pipeline.commands.fleet.dive_reports import draw_reports
from auvid.pipeline.commands.fleet.fleet_folder import TABLES, FleetFolder, open_fleet
from auvid.pipeline.commands.fleet.fleet_run import FleetOutcome, run_fleet
from auvid.pipeline.commands.fleet.fleet_tables import FleetMemory
from auvid.pipeline.commands.fleet.queries.find_command import find
from auvid.pipeline.commands.fleet.report.fleet_page import write_page
from auvid.pipeline.commands.new import log_survey
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.run.run_command import discard_stale_report, report_file
from auvid.pipeline.execution.engines import Serial
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.execution.task import Outcome, Task, execute
from auvid.pipeline.store.atomic_files import readable, writable
from tests.support.small_logs import DATA

LARGEST_PAGE = 5_000_000
CSV = DATA / "blueye_sea_trial" / "sea_trial_start.csv"


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    disk: Path = tmp_path_factory.mktemp("fleet") / "disk"
    (disk / "rov").mkdir(parents=True)
    shutil.copy(CSV, disk / "rov" / "dive.csv")
    shutil.copy(CSV, disk / "again.csv")
    (disk / "noise.BIN").write_bytes(bytes(range(256)) * 40)
    (disk / "empty.tlog").write_bytes(b"")
    return disk


@pytest.fixture(scope="module")
def first(disk: Path) -> FleetOutcome:
    return run_fleet(disk, disk.parent / "fleet")


def states(outcome: FleetOutcome) -> dict[str, str]:
    return {Path(row.files[0]).name: row.state for row in outcome.rows}


def test_every_log_ends_in_a_state_with_its_reason(first: FleetOutcome) -> None:
    by_name = {Path(row.files[0]).name: row.result for row in first.rows}
    assert by_name["again.csv"].state in ("done", "partly")
    assert by_name["dive.csv"].state == "refused"
    assert "the same content" in by_name["dive.csv"].reason
    assert "empty" in by_name["empty.tlog"].reason
    assert "no reader recognises" in by_name["noise.BIN"].reason
    assert all("\n" not in result.reason for result in by_name.values())


def test_only_what_is_new_or_changed_is_read_and_runs_again(
    disk: Path, first: FleetOutcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tables that take rows of the last call are those of a full build, to the byte."""
    fleet = FleetFolder(disk.parent / "fleet")
    read: list[str] = []
    plain_read = FleetMemory.read

    def noted(memory: FleetMemory, kind: Any, path: Path) -> Any:
        read.append(path.name)
        return plain_read(memory, kind, path)

    monkeypatch.setattr(FleetMemory, "read", noted)
    tables = [fleet.table(name) for name in TABLES]
    second = run_fleet(disk, fleet.root)
    assert (second.surveyed, second.ran) == (0, 0)
    assert second.rows == first.rows
    assert set(read) == {"survey.json"}
    (disk / "new.BIN").write_bytes(b"\xa3\x95 nothing")
    try:
        third = run_fleet(disk, fleet.root)
        assert (third.surveyed, third.ran) == (1, 0)
        assert "result.json" not in read
        grown = [path.read_bytes() for path in tables]
        tables[0].write_bytes(b"damaged")
        assert run_fleet(disk, fleet.root).surveyed == 0
        assert "result.json" in read
        assert [path.read_bytes() for path in tables] == grown
        (row,) = (row for row in third.rows if row.result.report)
        result = fleet.logs / row.log / "result.json"
        result.write_bytes(result.read_bytes()[:-9])
        assert run_fleet(disk, fleet.root).ran == 1
        assert [path.read_bytes() for path in tables] == grown
    finally:
        (disk / "new.BIN").unlink()
        run_fleet(disk, fleet.root)


def test_nothing_is_written_beside_the_logs(disk: Path, first: FleetOutcome) -> None:
    files = {str(path.relative_to(disk)) for path in disk.rglob("*") if path.is_file()}
    assert files == {"rov/dive.csv", "again.csv", "noise.BIN", "empty.tlog"}


def test_a_dive_is_drawn_when_it_is_asked_for(
    disk: Path, first: FleetOutcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet = open_fleet(disk.parent / "fleet")
    monkeypatch.chdir(fleet.root)
    (row,) = (row for row in first.rows if row.result.report)
    page, run = fleet.root / row.result.report, open_run(str(fleet.campaign(row.log)))
    assert row.result.headline
    results = auvid.open_run(fleet.campaign(row.log))
    words = results.answer
    with pytest.raises(auvid.PipelineError, match=f"auvid report {row.log}"):
        print(results.report)
    assert not page.exists()
    recording = fleet.root / row.result.recording
    assert report_file(str(fleet.campaign(row.log))) == page
    answer = page.with_name("answer.txt").read_text(encoding="utf-8")
    assert answer == words
    assert answer.partition("\n")[0] == row.result.headline
    assert draw_reports(fleet, None, Serial()) == []  # nothing is left to draw
    page.write_text("an older page")
    discard_stale_report(open_run(str(fleet.campaign(row.log))))
    assert not page.exists()
    assert not recording.exists()
    assert draw_reports(fleet, [row.log], Serial()) == []
    assert page.is_file()
    run.manifests["report"].path.unlink()
    page.unlink()
    next(run.folder.glob("ingest/*.json")).unlink()
    (words,) = draw_reports(fleet, None, Serial())
    assert row.log in words
    assert "auvid fleet run" in words


def test_tables_page_and_python_agree(disk: Path, first: FleetOutcome) -> None:
    fleet = open_fleet(disk.parent / "fleet")
    write_page(fleet)
    page = fleet.page.read_bytes()
    assert len(page) < LARGEST_PAGE
    assert b"again.csv" in page
    tables = auvid.fleet(fleet.root)
    assert len(tables.runs) == len(first.rows)
    for name in TABLES:
        assert pq.read_table(fleet.table(name)).num_rows == len(getattr(tables, name))
    refused = [row["log"] for row in find(fleet, "state = refused")]
    assert refused == list(tables.find("state = refused")["log"])
    assert len(refused) == sum(state == "refused" for state in states(first).values())


def test_a_folder_without_a_fleet_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PipelineError, match="no fleet in this folder"):
        open_fleet(tmp_path)


class Dying(Serial):
    """An engine whose first call loses one log to a worker that dies, and all after it."""

    def __init__(self, victim: str) -> None:
        self.victim, self.calls = victim, 0

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        self.calls += 1
        dead = False
        for task in tasks:
            if self.calls == 1 and self.victim in task.item:
                mark = task.folder / task.item / log_work.MARK
                mark.parent.mkdir(parents=True, exist_ok=True)
                mark.touch()
                dead = True
            yield Outcome(task.item, crash="a worker died") if dead else execute(task)


def test_a_worker_that_dies_costs_no_other_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / f"{name}.BIN").write_bytes(name.encode() * 1000)
    lonely: list[str] = []

    def run_lonely(task: Task) -> Outcome:
        lonely.append(task.item)
        return Outcome(task.item, crash=fleet_run.DIED)

    monkeypatch.setattr(fleet_run, "_run_alone", run_lonely)
    outcome = run_fleet(tmp_path, tmp_path / "fleet", engine=Dying("b-"))
    reasons = {Path(row.files[0]).name: row.result.reason for row in outcome.rows}
    assert [name.partition("-")[0] for name in lonely] == ["b"]
    assert reasons["b.BIN"] == fleet_run.DIED
    assert "no reader recognises" in reasons["a.BIN"]
    assert "no reader recognises" in reasons["c.BIN"]


def test_a_fault_of_auvid_is_named_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.BIN").write_bytes(b"a" * 1000)

    def faulty(*_: object) -> None:
        raise KeyError("nosuch")

    with monkeypatch.context() as patch:
        patch.setattr(log_work, "survey", faulty)
        outcome = run_fleet(tmp_path, tmp_path / "fleet")
    assert outcome.rows[0].result.reason.startswith("a fault of auvid: KeyError")
    again = run_fleet(tmp_path, tmp_path / "fleet")
    assert again.surveyed == 1
    assert "no reader recognises" in again.rows[0].result.reason


def test_a_log_that_grows_while_it_is_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.BIN"
    path.write_bytes(b"a" * 1000)
    survey = log_work.survey

    def growing(paths: Sequence[Path]) -> object:
        with path.open("ab") as file:
            file.write(b"more")
        os.utime(path)
        return survey(paths)

    monkeypatch.setattr(log_work, "survey", growing)
    outcome = run_fleet(tmp_path, tmp_path / "fleet")
    assert outcome.rows[0].result.reason.startswith("still growing")


def test_a_full_disk_is_no_result_to_keep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "disk").mkdir()
    shutil.copy(CSV, tmp_path / "disk" / "dive.csv")

    def full(run: Run, stages: object, *, quiet: bool) -> None:
        with writable(run.folder / "ingest"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(log_work, "execute", full)
        (row,) = run_fleet(tmp_path / "disk", tmp_path / "fleet").rows
    assert "No space left" in row.result.reason
    again = run_fleet(tmp_path / "disk", tmp_path / "fleet")
    assert (again.surveyed, again.ran) == (0, 1)
    assert "No space left" not in again.rows[0].result.reason


def test_a_log_that_cannot_be_read_is_read_by_the_next_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "disk").mkdir()
    shutil.copy(CSV, tmp_path / "disk" / "dive.csv")

    def refusing(*_: object, **__: object) -> None:
        with readable(CSV, file=CSV, what="log"):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    with monkeypatch.context() as patch:
        patch.setattr(log_survey, "contents", refusing)
        (row,) = run_fleet(tmp_path / "disk", tmp_path / "fleet").rows
    assert "no permission" in row.result.reason
    assert run_fleet(tmp_path / "disk", tmp_path / "fleet").surveyed == 1


def test_a_log_that_kills_its_process_is_tried_again_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "b.BIN").write_bytes(b"b" * 1000)

    def die(task: Task) -> Outcome:
        return Outcome(task.item, crash=fleet_run.DIED)

    with monkeypatch.context() as patch:
        patch.setattr(fleet_run, "_run_alone", die)
        run_fleet(tmp_path, tmp_path / "fleet", engine=Dying("b-"))
    monkeypatch.setattr(fleet_run, "_run_alone", execute)
    again = run_fleet(tmp_path, tmp_path / "fleet", engine=Dying("nothing"))
    assert again.surveyed == 1
    assert "no reader recognises" in again.rows[0].result.reason


def test_states_of_another_code_are_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.BIN").write_bytes(b"a" * 1000)
    run_fleet(tmp_path, tmp_path / "fleet")
    monkeypatch.setattr(log_work, "code_hash", lambda: "another")
    assert run_fleet(tmp_path, tmp_path / "fleet").surveyed == 1


def test_edits_outlive_a_survey_that_dies(tmp_path: Path) -> None:
    folder = tmp_path / "campaigns" / "dive"
    with log_work._new_campaign(folder) as fresh:
        (fresh / "vehicle.yaml").write_text("name: a")
        (fresh / "campaign.yaml").write_text("kind: axes")
    (folder / "vehicle.yaml").write_text("name: b")
    (folder / "notes.txt").write_text("calm sea")
    folder.rename(folder.with_name(".dive.before"))  # where a process died
    with log_work._new_campaign(folder) as fresh:
        (fresh / "vehicle.yaml").write_text("name: c")
        (fresh / "campaign.yaml").write_text("kind: bench")
    assert (folder / "vehicle.yaml").read_text() == "name: b"
    assert (folder / "campaign.yaml").read_text() == "kind: bench"
    assert (folder / "notes.txt").read_text() == "calm sea"
    assert [path.name for path in folder.parent.iterdir()] == ["dive"]


def test_edits_of_a_campaign_outlive_a_survey(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    shutil.copy(CSV, tmp_path / "disk" / "dive.csv")
    fleet = FleetFolder(tmp_path / "fleet")
    (row,) = run_fleet(tmp_path / "disk", fleet.root).rows
    vehicle, campaign = (
        fleet.campaign(row.log) / f"{name}.yaml" for name in ("vehicle", "campaign")
    )
    edited, written = vehicle.read_text() + "# measured on 3 May\n", campaign.read_text()
    vehicle.write_text(edited)
    assert run_fleet(tmp_path / "disk", fleet.root, force=True).surveyed == 1
    assert vehicle.read_text() == edited
    assert campaign.read_text() == written


def test_one_disk_by_another_path_is_up_to_date(
    disk: Path, first: FleetOutcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(disk.parent)
    second = run_fleet(Path("disk"), Path("fleet"))
    assert (second.surveyed, second.ran) == (0, 0)


def test_a_name_that_is_no_utf8_costs_no_other_log(tmp_path: Path) -> None:
    (tmp_path / "a.BIN").write_bytes(b"a" * 1000)
    with open(os.fsencode(tmp_path) + b"/b\xff.BIN", "wb") as file:
        file.write(b"b" * 1000)
    with open(os.fsencode(tmp_path) + b"/c.\xff", "wb") as file:
        file.write(b"c" * 1000)
    outcome = run_fleet(tmp_path, tmp_path / "fleet")
    reasons = {Path(row.files[0]).name: row.result.reason for row in outcome.rows}
    assert "not UTF-8" in reasons["b\ufffd.BIN"]
    assert "no reader recognises" in reasons["a.BIN"]
    assert len(auvid.fleet(tmp_path / "fleet").runs) == 2
    assert outcome.others == {".\ufffd": 1}


def test_the_fleet_is_a_workspace(disk: Path, first: FleetOutcome) -> None:
    fleet = FleetFolder(disk.parent / "fleet")
    assert (fleet.root / "params.yaml").is_file()
    for row in first.rows:
        if row.survey.kind and not row.same_as:
            assert (fleet.campaign(row.log) / "campaign.yaml").is_file()


class Interrupted(Serial):
    """An engine whose user presses Ctrl-C while a worker is at a log."""

    def __init__(self, end: BaseException) -> None:
        self.end = end

    def map(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        yield execute(tasks[0])
        mark = tasks[1].folder / tasks[1].item / log_work.MARK
        mark.parent.mkdir(parents=True)
        mark.touch()
        raise self.end


@pytest.mark.parametrize("end", [KeyboardInterrupt(), PipelineError("the scheduler has gone away")])
def test_ctrl_c_and_a_lost_scheduler_keep_what_was_finished_and_suspect_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: BaseException
) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.BIN").write_bytes(name.encode() * 1000)
    with pytest.raises(type(end)):
        run_fleet(tmp_path, tmp_path / "fleet", engine=Interrupted(end))
    assert not list(tmp_path.rglob(log_work.MARK))
    monkeypatch.setattr(fleet_run, "_run_alone", lambda task: pytest.fail("it was no crash"))
    assert run_fleet(tmp_path, tmp_path / "fleet").surveyed == 1
