"""The runner: what runs again, what does not, and what an interrupted or failed run
leaves behind. On toy stages.
"""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from multiprocessing.synchronize import SemLock
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from auvid.data_schemas.errors import CampaignError, PipelineError
from auvid.hydro.long_series.threads import THREADS
from auvid.pipeline.collector import NEW_OBJECTS
from auvid.pipeline.commands.run.run_summary import warnings
from auvid.pipeline.execution import runner
from auvid.pipeline.execution.engines import Processes, Serial, make_engine
from auvid.pipeline.execution.lock import FILE as LOCK
from auvid.pipeline.execution.lock import locked
from auvid.pipeline.execution.runner import InternalFault, Run, StageFault
from auvid.pipeline.graph import Graph, WiringError, select
from auvid.pipeline.store import atomic_files as files
from auvid.pipeline.store import fingerprints
from auvid.pipeline.store.atomic_files import TEMPORARY
from auvid.pipeline.store.manifest import Manifest
from auvid.stages.base import Collection, Stage, make_params, port
from tests.support import toy_stages
from tests.support.toy_stages import MANIFEST, STAGES, TotalParams, open_run, write_campaign

ROOT = Path(__file__).parents[4]


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    return write_campaign(tmp_path / "campaigns" / "toy")


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    return tmp_path / "runs"


def run_all(run: Run, **options: Any) -> int:
    return run.execute(run.graph.stages, Serial(), **options)


def ran(run: Run) -> dict[str, list[str]]:
    """Run everything and say which items of which stages ran."""
    items_by_stage: dict[str, list[str]] = {stage.name: [] for stage in run.graph.stages}

    class Watch:
        now = ""

        def stage(self, name: str, *, todo: int, total: int, level: str) -> None:
            self.now = name

        def part(self, words: str, share: float) -> None:
            pass

        def item(self, name: str) -> None:
            items_by_stage[self.now].append(name)

        def finish(self, *, failed: int) -> None:
            pass

    run.execute(run.graph.stages, Serial(), Watch())
    return {name: items for name, items in items_by_stage.items() if items}


def contents(folder: Path) -> dict[str, bytes]:
    """All artefacts and manifests of a run, by path."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name[0] != "."
    }


def written(folder: Path) -> dict[Path, int]:
    """When each artefact and manifest was written."""
    return {
        path: path.stat().st_mtime_ns
        for path in folder.rglob("*")
        if path.is_file() and path.name[0] != "."
    }


def test_second_run_does_nothing(campaign: Path, runs: Path) -> None:
    assert ran(open_run(campaign, runs)) == {
        "decode": ["a", "b"],
        "cut": ["one", "two", "three"],
        "spread": ["one", "two", "three"],
        "total": ["campaign"],
    }
    before = written(runs)
    assert ran(open_run(campaign, runs)) == {}
    assert written(runs) == before


def test_changed_parameter_reruns_what_depends_on_it(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    assert sorted(ran(open_run(campaign, runs, spread={"floor": 3.0}))) == ["spread", "total"]


def test_same_result_again_makes_nothing_after_it_stale(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    below_every_distance = 0.25
    assert sorted(ran(open_run(campaign, runs, spread={"floor": below_every_distance}))) == [
        "spread"
    ]


def test_changed_log_reruns_its_items_only(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    (campaign / "a.log").write_bytes(bytes(range(50, 90)))
    assert ran(open_run(campaign, runs)) == {
        "decode": ["a"],
        "cut": ["one"],
        "spread": ["one"],
        "total": ["campaign"],
    }


def test_changed_leg_does_not_touch_the_logs(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    (campaign / "campaign.yaml").write_text(
        MANIFEST.replace("log: a, use: training", "log: a, use: training, end_s: 40")
    )
    assert ran(open_run(campaign, runs)) == {"cut": ["one"]}


def test_legs_are_looked_through_as_often_whatever_their_number(tmp_path: Path) -> None:
    """Not once more for each leg, as where ingest of 20,000 legs took above 20 s."""

    class Counted(list[dict[str, Any]]):
        looks = 0

        def __iter__(self) -> Iterator[dict[str, Any]]:
            self.looks += 1
            return super().__iter__()

    looks = []
    for count in (1, 4):
        legs = [f"  - {{id: leg{number}, log: a, use: training}}\n" for number in range(count)]
        text = MANIFEST.partition("legs:\n")[0] + "legs:\n" + "".join(legs)
        run = open_run(write_campaign(tmp_path / str(count), text), tmp_path / "runs")
        file = run.campaign.file
        counted = Counted(file.value["legs"])
        value = {**file.value, "legs": counted}
        run.campaign = replace(run.campaign, file=replace(file, value=value))
        run.execute(STAGES[:2], Serial())
        looks.append(counted.looks)
    assert looks[0] == looks[1]


def test_removed_leg_leaves_no_files(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    (campaign / "campaign.yaml").write_text(
        MANIFEST.replace("  - {id: three, log: b, use: validation}\n", "")
    )
    run_all(open_run(campaign, runs))
    assert not list(runs.rglob("*three*"))


def test_other_number_of_segments_replaces_the_old_ones(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    run = open_run(campaign, runs, cut={"parts": 2})
    run_all(run)
    names = ["one.1", "one.2", "two.1", "two.2", "three.1", "three.2"]
    assert [place.item for place in run.places("segment")] == names
    assert sorted(
        path.name for path in (runs / "toy" / "spread").iterdir() if path.is_dir()
    ) == sorted(names)
    assert [path.stem for path in sorted((runs / "toy" / "total" / "mode").iterdir())] == sorted(
        names
    )


def test_changed_code_reruns_the_stage(
    campaign: Path, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_all(open_run(campaign, runs))
    true = fingerprints.stage_code
    monkeypatch.setattr(
        runner, "stage_code", lambda stage, _: "edited" if stage.name == "cut" else true(stage)
    )
    assert sorted(ran(open_run(campaign, runs))) == ["cut"]


@pytest.mark.parametrize("damage", ["remove", "alter"])
def test_lost_or_altered_artefact_is_made_again(campaign: Path, runs: Path, damage: str) -> None:
    run_all(open_run(campaign, runs))
    first = contents(runs)
    victim = runs / "toy" / "spread" / "two" / "range.parquet"
    victim.unlink() if damage == "remove" else victim.write_bytes(b"PAR1")
    assert ran(open_run(campaign, runs)) == {"spread": ["two"]}
    assert contents(runs) == first


def test_damaged_manifest_reruns_its_stage(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    (runs / "toy" / "cut" / "manifest.json").write_text("{")
    assert sorted(ran(open_run(campaign, runs))) == ["cut"]


def test_force_runs_everything_and_gives_the_same(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    first = contents(runs)
    assert run_all(open_run(campaign, runs), force=True) == 9
    assert contents(runs) == first


def test_processes_give_the_same_bytes(
    campaign: Path, runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(ROOT)  # the workers unpickle the toy stages of tests.support
    run_all(open_run(campaign, runs, cut={"parts": 3}))
    run = open_run(campaign, tmp_path / "other", cut={"parts": 3})
    engine = Processes(2)
    monkeypatch.setattr(engine, "close", lambda: None)
    run.execute(run.graph.stages, engine)
    assert contents(tmp_path / "other") == contents(runs)
    assert engine._pool is not None
    threads = "__import__('auvid.hydro.long_series.threads', fromlist=['THREADS']).THREADS"
    assert engine._pool.submit(eval, threads).result() == max(1, THREADS // 2)
    assert engine._pool.submit(eval, "__import__('gc').get_threshold()[0]").result() == NEW_OBJECTS
    Processes.close(engine)
    (campaign / "b.log").write_bytes(b"CRASH")
    crashing = open_run(campaign, tmp_path / "other")
    with pytest.raises(InternalFault, match=r"decode, log 'b': ZeroDivisionError: toy crash"):
        crashing.execute(crashing.graph.stages, Processes(2), force=True)


def test_workers_that_the_system_lets_not_start_are_named_with_the_remedy(
    campaign: Path, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SemLock, "_make_name", staticmethod(lambda: "/no/such/folder"))
    run = open_run(campaign, runs)
    with pytest.raises(PipelineError, match=r"no worker process can be started.*/dev/shm.*--jobs"):
        run.execute(run.graph.stages, Processes(2))
    assert run_all(open_run(campaign, runs)) == 9


def test_every_collects_by_stage_and_item(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    lines = (runs / "toy" / "total" / "tables_text.txt").read_text().splitlines()
    assert lines == [
        *("decode/a", "decode/b", "spread/one", "spread/two", "spread/three"),
        *("decode/a/depth", "decode/b/depth", "decode/b/battery"),
        *("cut/one/samples_depth", "cut/two/samples_depth", "cut/three/samples_depth"),
        *("spread/one/range", "spread/two/range", "spread/three/range"),
    ]


def test_optional_input_is_none_where_the_log_has_none(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    streams = {
        item: (runs / "toy" / "spread" / item / "section.json").read_text()
        for item in ("one", "two")
    }
    assert ("battery" in streams["one"], "battery" in streams["two"]) == (False, True)


def test_missing_required_input_names_stage_item_and_artefact(campaign: Path, runs: Path) -> None:
    @dataclass(frozen=True)
    class Needs(toy_stages.SpreadInputs):
        battery: pa.Table = port("battery")

    run = open_run(campaign, runs)
    run.graph = Graph((*STAGES[:2], replace(STAGES[2], inputs=Needs), STAGES[3]))
    with pytest.raises(
        StageFault, match=r"spread, segment 'one': needs 'battery' .*stage decode gave none for 'a'"
    ):
        run_all(run)
    assert list(Manifest(runs / "toy" / "spread").records) == ["two", "three"]


def test_fault_of_one_item_keeps_the_others(campaign: Path, runs: Path) -> None:
    good = (campaign / "a.log").read_bytes()
    (campaign / "a.log").write_bytes(b"BAD")
    with pytest.raises(StageFault, match=r"decode, log 'a': a.log: not a toy log"):
        run_all(open_run(campaign, runs))
    (campaign / "a.log").write_bytes(good)
    assert ran(open_run(campaign, runs))["decode"] == ["a"]


def test_a_fault_of_a_stage_parameter_names_the_file_of_the_campaign(
    campaign: Path, runs: Path
) -> None:
    def refuse(inputs: object, params: object) -> None:
        raise CampaignError("not so", field="stages.spread.width")

    run = open_run(campaign, runs)
    run.graph = Graph((*STAGES[:2], replace(STAGES[2], run=refuse), STAGES[3]))
    with pytest.raises(StageFault, match=r"campaign\.yaml, field 'stages\.spread\.width': not so"):
        run_all(run)


def test_all_faults_of_a_stage_come_together(campaign: Path, runs: Path) -> None:
    for name in ("a.log", "b.log"):
        (campaign / name).write_bytes(b"BAD")
    with pytest.raises(PipelineError, match=r"(?s)2 faults.*log 'a'.*log 'b'"):
        run_all(open_run(campaign, runs))


def test_crash_names_stage_and_item_and_keeps_the_trace(campaign: Path, runs: Path) -> None:
    (campaign / "b.log").write_bytes(b"CRASH")
    run = open_run(campaign, runs)
    with pytest.raises(
        InternalFault, match=r"decode, log 'b': ZeroDivisionError: toy crash"
    ) as caught:
        run_all(run)
    assert "toy_stages.py" in caught.value.trace


def test_empty_log_is_an_empty_buffer(campaign: Path, runs: Path) -> None:
    (campaign / "a.log").write_bytes(b"")
    run = open_run(campaign, runs)
    run.execute(select(run.graph, only="decode"), Serial())
    assert (runs / "toy" / "decode" / "a" / "depth.parquet").is_file()


def test_log_that_changes_while_it_is_read_is_refused(
    campaign: Path, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def grows(inputs: Any, params: Any) -> Any:
        with (campaign / "a.log").open("ab") as file:
            file.write(b"more")
        return toy_stages.decode(inputs, params)

    run = open_run(campaign, runs)
    run.graph = Graph((replace(STAGES[0], run=grows), *STAGES[1:]))
    with pytest.raises(
        PipelineError, match=r"a.log: the file of log 'a' changed while it was read"
    ):
        run_all(run)


def test_python_warnings_are_counted_and_stay_in_the_manifest(campaign: Path, runs: Path) -> None:
    (campaign / "a.log").write_bytes(b"WARN of something")
    run_all(open_run(campaign, runs))
    again = open_run(campaign, runs)
    assert warnings(again) == ["decode, a: RuntimeWarning: toy warning"]


def test_leg_without_segments_is_a_warning(campaign: Path, runs: Path) -> None:
    run = open_run(campaign, runs, cut={"parts": 0})
    run.execute(select(run.graph, only="decode"), Serial())
    run.execute(select(run.graph, only="cut"), Serial())
    assert warnings(run) == [f"cut: leg '{leg}' gave no segment" for leg in ("one", "two", "three")]


@pytest.fixture
def break_writing(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[BaseException | None]]:
    """A list to which a test adds what the next writes raise in the middle; None lets
    one through.
    """
    plan: list[BaseException | None] = []
    true = os.fsync

    def fsync(handle: int) -> None:
        fault = plan.pop(0) if plan else None
        if fault is not None:
            raise fault
        true(handle)

    monkeypatch.setattr(files.os, "fsync", fsync)
    return plan


@pytest.mark.parametrize(
    "fault", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")]
)
def test_broken_write_leaves_nothing_half_done(
    campaign: Path, runs: Path, break_writing: list[BaseException | None], fault: BaseException
) -> None:
    run_all(open_run(campaign, runs))
    writes_per_artefact = 2  # file and folder
    break_writing += [*[None] * writes_per_artefact * 2, fault]
    expected = KeyboardInterrupt if isinstance(fault, KeyboardInterrupt) else StageFault
    with pytest.raises(expected) as caught:
        run_all(open_run(campaign, runs, decode={"scale": 2.0}))
    assert not list(runs.rglob(f"*{TEMPORARY}"))
    records = Manifest(runs / "toy" / "decode").records
    assert "a" not in records, (
        "the manifest must not vouch for a log whose artefacts are half replaced"
    )
    if expected is StageFault:
        assert "No space left on device" in str(caught.value)
        assert "Free some space" in str(caught.value)
    break_writing.clear()
    assert "a" in ran(open_run(campaign, runs, decode={"scale": 2.0}))["decode"]


def test_a_file_in_place_of_a_folder_of_results_is_named(campaign: Path, runs: Path) -> None:
    (runs / "toy").mkdir(parents=True)
    (runs / "toy" / "decode").touch()
    with pytest.raises(PipelineError, match=r"a/depth\.parquet: cannot be .*Not a directory"):
        run_all(open_run(campaign, runs))


def test_parts_of_killed_writers_are_swept(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    part = runs / "toy" / "decode" / "a" / f".depth.parquet.123{TEMPORARY}"
    part.write_bytes(b"half")
    run_all(open_run(campaign, runs))
    assert not part.exists()


def test_two_runs_of_one_campaign_exclude_each_other(campaign: Path, runs: Path) -> None:
    with (
        locked(runs / "toy"),
        pytest.raises(
            PipelineError, match=rf"another run .* under way; found 'process {os.getpid()}'"
        ),
    ):
        run_all(open_run(campaign, runs))
    assert run_all(open_run(campaign, runs)) == 9


def test_a_folder_of_runs_that_cannot_be_used_is_named(
    campaign: Path, runs: Path, tmp_path: Path
) -> None:
    runs.symlink_to(tmp_path / "disk")
    with pytest.raises(PipelineError, match=r"runs: a link to a folder.* found '.*disk'. Connect"):
        run_all(open_run(campaign, runs))
    runs.unlink()
    with pytest.raises(PipelineError, match=r"no UTF-8 text\. Rename the folder"):
        run_all(open_run(campaign, Path(os.fsdecode(bytes(tmp_path) + b"/\xff"))))


def test_lock_of_a_dead_process_is_free(campaign: Path, runs: Path) -> None:
    (runs / "toy").mkdir(parents=True)
    (runs / "toy" / LOCK).write_text("999999999\n")
    assert run_all(open_run(campaign, runs)) == 9


@pytest.mark.parametrize("link", ["spread", "spread/one"])
def test_linked_folder_of_a_stage_is_refused_before_anything_is_written(
    campaign: Path, runs: Path, tmp_path: Path, link: str
) -> None:
    mine = tmp_path / "mine" / "range.parquet"
    mine.parent.mkdir()
    mine.write_text("mine")
    (runs / "toy" / link).parent.mkdir(parents=True)
    (runs / "toy" / link).symlink_to(mine.parent)
    with pytest.raises(PipelineError, match=f"{link}: the folder of results is a link"):
        run_all(open_run(campaign, runs))
    assert [path.name for path in mine.parent.iterdir()] == ["range.parquet"]
    assert not (runs / "toy" / "decode").exists()


def test_a_run_that_was_killed_before_its_end_is_ended_by_the_next(
    campaign: Path, runs: Path
) -> None:
    ended: list[Run] = []
    run = open_run(campaign, runs)
    run.execute(run.graph.stages, Serial())
    assert run.execute(run.graph.stages, Serial(), after=ended.append) == 0
    assert ended == [run]


def test_files_of_others_in_the_folder_of_a_stage_stay(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs))
    (runs / "toy" / "spread" / "notes.md").write_text("mine")
    run_all(open_run(campaign, runs), force=True)
    assert (runs / "toy" / "spread" / "notes.md").read_text() == "mine"


def test_temporary_files_of_a_killed_run_are_removed(campaign: Path, runs: Path) -> None:
    for place in ("", "history", "decode/a"):
        (runs / "toy" / place).mkdir(parents=True, exist_ok=True)
        (runs / "toy" / place / f".x.json.77{TEMPORARY}").touch()
    code = runs / ".code"
    code.mkdir()
    (code / f".cut.txt.4194305{TEMPORARY}").touch()
    runner.write_code_files(STAGES, code)
    run_all(open_run(campaign, runs))
    assert not list(runs.rglob(f"*{TEMPORARY}"))


@pytest.mark.parametrize("operation", ["ftruncate", "unlink", "rmdir"])
def test_full_or_faulty_disk_is_named_wherever_it_shows(
    campaign: Path, runs: Path, monkeypatch: pytest.MonkeyPatch, operation: str
) -> None:
    run_all(open_run(campaign, runs))
    (campaign / "campaign.yaml").write_text(
        MANIFEST.replace("  - {id: three, log: b, use: validation}\n", "")
    )

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EDQUOT, "Disk quota exceeded")

    monkeypatch.setattr(os, operation, refuse)
    with pytest.raises(PipelineError, match=r"Disk quota exceeded\. Free some space"):
        run_all(open_run(campaign, runs))
    monkeypatch.undo()
    assert run_all(open_run(campaign, runs)) <= 1
    assert not list(runs.rglob("*three*"))


@pytest.mark.release
def test_workers_end_with_a_killed_parent(tmp_path: Path) -> None:
    code = (
        "import os, time; from concurrent.futures import ProcessPoolExecutor as Pool;"
        "from auvid.pipeline.execution.engines import _context, _end_with_parent;"
        "pool = Pool(1, mp_context=_context(), initializer=_end_with_parent);"
        "print(pool.submit(os.getpid).result(), flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        parent.kill()
    deadline = time.monotonic() + 20.0
    while _running(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _running(worker)


def _running(process: int) -> bool:
    """Return whether a process runs; one that has ended and waits for its parent does not."""
    try:
        return ") Z " not in Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False


def test_only_needs_what_came_before(campaign: Path, runs: Path) -> None:
    run = open_run(campaign, runs)
    with pytest.raises(
        PipelineError, match=r"stage cut has not been run.*auvid run toy --until cut"
    ):
        run.execute(select(run.graph, only="spread"), Serial())


def test_until_runs_what_is_needed(campaign: Path, runs: Path) -> None:
    run = open_run(campaign, runs)
    assert [stage.name for stage in select(run.graph, until="cut")] == ["decode", "cut"]
    with pytest.raises(PipelineError, match=r"no such stage.*Did you mean 'spread'"):
        select(run.graph, until="spred")


def test_stages_that_do_not_fit_together_are_refused() -> None:
    with pytest.raises(
        WiringError, match=r"cut.depth needs one earlier stage that outputs 'depth'; there is: none"
    ):
        Graph(STAGES[1:])
    twin = replace(STAGES[0], name="decode_too")
    with pytest.raises(WiringError, match="there is: decode, decode_too"):
        Graph((STAGES[0], twin, STAGES[1]))


@dataclass(frozen=True)
class AddInputs:
    mode: Collection[pa.Table] = port("mode", many=True)


@dataclass(frozen=True)
class AddOutputs:
    mode: Mapping[str, pa.Table] = port("mode", many=True)


@dataclass(frozen=True)
class ListOutputs:
    tables_text: bytes = port("tables_text")


def test_artefacts_by_key_come_from_all_stages_that_give_them(campaign: Path, runs: Path) -> None:
    """As model cards by model: the later stage reads those of the earlier one."""

    def add(inputs: AddInputs, params: TotalParams) -> AddOutputs:
        return AddOutputs({f"{name}_more": table for name, table in inputs.mode.items()})

    def names(inputs: AddInputs, params: TotalParams) -> ListOutputs:
        return ListOutputs(" ".join(inputs.mode).encode())

    total = replace(
        STAGES[3], outputs=AddOutputs, run=lambda i, p: AddOutputs(STAGES[3].run(i, p).mode)
    )
    more = Stage("add", "More of them", "campaign", AddInputs, TotalParams, AddOutputs, add)
    last = Stage("names", "Their names", "campaign", AddInputs, TotalParams, ListOutputs, names)
    run = open_run(campaign, runs)
    stages = (*STAGES[:3], total, more, last)
    params = {**run.params, "add": TotalParams(), "names": TotalParams()}
    joined = Run(run.campaign, Graph(stages), params, run.folder)
    run_all(joined)
    (names_of,) = joined.artefacts_of(joined.graph.producers("tables_text")[0], "campaign").values()
    assert names_of.load() == b"one two three one_more two_more three_more"


def test_engine_names_and_jobs_are_checked() -> None:
    with pytest.raises(PipelineError, match="Did you mean 'processes'"):
        make_engine("process")
    for name, jobs in (("processes", 0), ("serial", 2)):
        with pytest.raises(PipelineError, match="'--jobs': does not fit the engine"):
            make_engine(name, jobs)
    assert isinstance(make_engine(), Serial)
    assert isinstance(make_engine(jobs=2), Processes)


def test_params_of_a_record_are_those_of_the_run(campaign: Path, runs: Path) -> None:
    run_all(open_run(campaign, runs, spread={"floor": 1.0, "plan": {"x": 2.0}}))
    assert Manifest(runs / "toy" / "spread").records["one"].params == {
        "floor": 1.0,
        "plan": {"x": 2.0},
    }
    assert make_params(toy_stages.SpreadParams, {}, stage="spread").floor == 0.0
