"""The two work items of each log: its survey, and the run of its campaign.

They are tasks as those of stages, so that every engine takes them; other than stages
they write a campaign and its results, all under the folder of the fleet.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.records.fleet import FleetRun, LogSurvey
from auvid.data_schemas.records.logs import FindingRecord
from auvid.pipeline.commands.check.log_page import LogPage
from auvid.pipeline.commands.check.motion_trace import motion_of
from auvid.pipeline.commands.fleet.discovery import FleetLog, hash_of_file
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder
from auvid.pipeline.commands.fleet.run_results import results_of
from auvid.pipeline.commands.fleet.surveys.log_traits import (
    conditions,
    start_utc,
    unnamed,
)
from auvid.pipeline.commands.fleet.surveys.repeated_rows import row_hashes
from auvid.pipeline.commands.new.campaign_command import WrittenCampaign, write_campaign
from auvid.pipeline.commands.new.log_survey import survey
from auvid.pipeline.commands.new.refusal import NoCampaignError, unreadable
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.run.run_command import discard_stale_report, execute
from auvid.pipeline.execution.code_stamp import source_hash
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.execution.task import Task
from auvid.pipeline.execution.task_inputs import Value
from auvid.pipeline.graph import AnyStage, Port
from auvid.pipeline.store.atomic_files import SYSTEM_REFUSALS, writable, write_atomically
from auvid.pipeline.store.file_hashes import FileHashes, hash_file, hash_value
from auvid.stages.base import Stage

AGAIN = ""
"""Key of a document that is no result to keep: the next call makes it anew."""
GROWING = "still growing: it changed while it was read; the next auvid fleet run takes it"
MARK = "at_work"
"""File that stands in the folder of a log while a process works on it."""
WRITTEN = ".written.json"
"""File of a campaign: hashes of its texts as auvid wrote them, to know edits by."""
MOST_LETTERS = 400


@dataclass(frozen=True)
class Inputs:
    """One log on the disk, and the folder of its fleet."""

    log: FleetLog
    fleet: FleetFolder
    key: str


@dataclass(frozen=True)
class Params:
    """Nothing: what can be set stands in the campaigns."""


@dataclass(frozen=True)
class SurveyOutputs:
    survey: LogSurvey


@dataclass(frozen=True)
class RunOutputs:
    result: FleetRun


def survey_task(log: FleetLog, fleet: FleetFolder) -> Task:
    """Return the task that decodes a log, checks it and writes its campaign."""
    key = hash_value(
        {
            "hash": log.hash,
            "files": log.paths,
            "fault": log.fault,
            "vehicle": hash_of_file(log.vehicle),
            "auvid": code_hash(),
        }
    )
    return _task(SURVEY, "survey", "log_survey", log, fleet, key)


def run_task(log: FleetLog, fleet: FleetFolder, hashes: FileHashes) -> Task:
    """Return the task that runs the campaign of a log; edits of its files count."""
    defaults = hashes.of(fleet.root / "params.yaml")
    texts = _texts(fleet.campaign(log.id), hashes.of)
    document = {"texts": texts, "defaults": defaults, "hash": log.hash}
    key = hash_value({**document, "auvid": code_hash()})
    return _task(RUN, "result", "fleet_run", log, fleet, key)


@cache
def code_hash() -> str:
    """Return the hash of auvid's own files: each of them may change a result."""
    return source_hash()


def _task(
    stage: Stage[Inputs, Params, SurveyOutputs] | Stage[Inputs, Params, RunOutputs],
    name: str,
    schema: str,
    log: FleetLog,
    fleet: FleetFolder,
    key: str,
) -> Task:
    sources = {
        "log": Value(log, str(log)),
        "fleet": Value(fleet, str(fleet)),
        "key": Value(key),
    }
    outputs = (Port(stage, name, schema, many=False),)
    return Task(stage, log.id, Params(), sources, outputs, fleet.logs, key, "")


@contextmanager
def _holding(inputs: Inputs) -> Iterator[None]:
    """Leave a mark while a process works on a log: it stays where that process dies."""
    mark = inputs.fleet.logs / inputs.log.id / MARK
    mark.parent.mkdir(parents=True, exist_ok=True)
    mark.touch()
    try:
        yield
    finally:
        mark.unlink(missing_ok=True)


def one_line(words: object) -> str:
    """Return a text on one line that is not too long for a table."""
    line = " ".join(str(words).split())
    return line if len(line) <= MOST_LETTERS else f"{line[: MOST_LETTERS - 4]} ..."


def refused_survey(log: FleetLog, key: str, reason: str) -> LogSurvey:
    """Return the survey of a log of which nothing can be told but why."""
    return LogSurvey(
        key=key,
        id=log.id,
        files=list(log.paths),
        hash=log.hash,
        reason=one_line(reason),
    )


def _survey(inputs: Inputs, _: Params) -> SurveyOutputs:
    log, before = inputs.log, len(SYSTEM_REFUSALS)
    with _holding(inputs):
        if log.fault:
            return SurveyOutputs(refused_survey(log, inputs.key, log.fault))
        if not log.unchanged:
            return SurveyOutputs(refused_survey(log, AGAIN, GROWING))
        try:
            document = _surveyed(inputs)
        except PipelineError as fault:
            document = refused_survey(log, inputs.key, str(fault))
        if not log.unchanged:
            return SurveyOutputs(refused_survey(log, AGAIN, GROWING))
    return SurveyOutputs(document.model_copy(update={"key": _kept(inputs, before)}))


def _surveyed(inputs: Inputs) -> LogSurvey:
    log = inputs.log
    surveyed = survey(log.files)
    page = surveyed[0].page
    if page.health is None:
        return refused_survey(log, inputs.key, unreadable(surveyed[0].name, page).reason)
    try:
        with _new_campaign(inputs.fleet.campaign(log.id)) as folder:
            campaign = write_campaign(folder, surveyed, vehicle=log.vehicle, link=True)
    except NoCampaignError as fault:
        refusal = fault.refusals[0]
        routes = [one_line(words) for words in refusal.routes]
        return _described(inputs, page, one_line(refusal.reason), routes=routes)
    except PipelineError as fault:
        return _described(inputs, page, one_line(fault))
    return _described(inputs, campaign.page, "", campaign)


@contextmanager
def _new_campaign(folder: Path) -> Iterator[Path]:
    """Give an empty folder that takes the place of a campaign; files of the user stay.

    The campaign of before is whole until then, whenever a process dies. Where none is
    written it goes, but for what the user wrote or changed.
    """
    before, fresh = (folder.with_name(f".{folder.name}.{word}") for word in ("before", "new"))
    with writable(folder):
        if before.is_dir() and not folder.is_dir():
            before.rename(folder)  # an earlier process died here
        for leftover in (before, fresh):
            shutil.rmtree(leftover, ignore_errors=True)
        fresh.mkdir(parents=True)
    try:
        try:
            yield fresh
        finally:
            write_atomically(fresh / WRITTEN, json.dumps(_texts(fresh)).encode())
            kept = _of_user(folder)
            with writable(folder):
                for name in kept:
                    (fresh / name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(folder / name, fresh / name)
                if folder.is_dir():
                    folder.rename(before)
                if kept or len(list(fresh.iterdir())) > 1:
                    fresh.rename(folder)
                shutil.rmtree(before, ignore_errors=True)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _texts(folder: Path, hash_of: Callable[[Path], str] = hash_file) -> dict[str, str]:
    """Return the hash of each text of a campaign."""
    return {str(path.relative_to(folder)): hash_of(path) for path in sorted(folder.rglob("*.yaml"))}


def _of_user(folder: Path) -> list[str]:
    """Return the files of a campaign that are not as auvid wrote them."""
    record = folder / WRITTEN
    written = json.loads(record.read_bytes()) if record.is_file() else {}
    files = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    return [
        name
        for path in sorted(files)
        if (name := str(path.relative_to(folder))) != WRITTEN
        and written.get(name) != hash_file(path)
    ]


def _described(
    inputs: Inputs,
    page: LogPage,
    reason: str,
    campaign: WrittenCampaign | None = None,
    routes: Sequence[str] = (),
) -> LogSurvey:
    """Return what a decoded log is; routes: why no kind of campaign takes it."""
    health, outputs = page.health, page.outputs
    assert health is not None
    assert outputs is not None
    info = outputs.log_info
    named = "" if campaign is None else campaign.vehicle.name
    return LogSurvey(
        key=inputs.key,
        id=inputs.log.id,
        files=list(inputs.log.paths),
        hash=inputs.log.hash,
        reason=reason,
        routes=list(routes),
        kind="" if campaign is None else campaign.kind,
        vehicle=named if named not in ("", "vehicle") else unnamed(health["vehicle"]),
        vehicle_why="" if campaign is None else campaign.vehicle.why,
        lacking="" if campaign is None else campaign.vehicle.lacking,
        formats=sorted(set(health["formats"])),
        bytes=health["bytes"],
        status=health["status"],
        duration_s=float(health["duration_s"]),
        start_utc=start_utc(info.start_us, info.utc_offset_us),
        rows=sum(stream.rows for stream in info.streams.values()),
        streams=sorted(health["streams"]),
        legs=0 if campaign is None else campaign.legs[0],
        legs_s=0.0 if campaign is None else float(campaign.legs[1]),
        excited=[axis for axis, item in health["excitation"].items() if item["excited"]],
        findings=[FindingRecord.model_validate(item) for item in health["findings"]],
        conditions=conditions(page),
        motion=motion_of(page),
        row_hashes=row_hashes(page.streams),
    )


def _run(inputs: Inputs, _: Params) -> RunOutputs:
    log, reason, before = inputs.log, "", len(SYSTEM_REFUSALS)
    with _holding(inputs):
        try:
            opened = open_run(str(inputs.fleet.campaign(log.id)), inputs.fleet.workspace)
        except PipelineError as fault:
            return RunOutputs(unfinished(log.id, _kept(inputs, before), str(fault)))
        try:
            execute(opened, _but_report(opened), quiet=True)
        except PipelineError as fault:
            reason = one_line(str(fault).partition("\nauvid check")[0])
        if not log.unchanged:
            return RunOutputs(unfinished(log.id, AGAIN, GROWING))
        discard_stale_report(opened)
        key = _kept(inputs, before)
        return RunOutputs(results_of(opened, inputs.fleet.root, key, reason))


def _but_report(run: Run) -> list[AnyStage]:
    """Return the stages of a dive that a fleet runs: pages are drawn when asked for."""
    return [stage for stage in run.graph.stages if stage.name != "report"]


def _kept(inputs: Inputs, before: int) -> str:
    """Return the key of a document: none where the system refused something meanwhile.

    before: how many refusals there were.
    """
    return inputs.key if len(SYSTEM_REFUSALS) == before else AGAIN


def unfinished(log: str, key: str, reason: str) -> FleetRun:
    """Return the result of a log that nothing was run on."""
    return FleetRun(
        key=key,
        id=log,
        state="refused",
        reason=one_line(reason),
        reached="",
        headline="",
        model="",
        verdicts=[],
        coefficients=[],
        speeds={},
        report="",
        recording="",
    )


def _item(
    name: str, summary: str, outputs: type, run: Callable[[Inputs, Params], Any]
) -> Stage[Inputs, Params, Any]:
    return Stage(name, summary, "log", Inputs, Params, outputs, run)


SURVEY = _item("survey", "decode a log, check it, write its campaign", SurveyOutputs, _survey)
RUN = _item("run", "run the campaign of a log", RunOutputs, _run)


def failed(task: Task, log: FleetLog, reason: str) -> LogSurvey | FleetRun:
    """Return the document of a task that could not give its own: it is tried again."""
    if task.stage.name == SURVEY.name:
        return refused_survey(log, AGAIN, reason)
    return unfinished(log.id, AGAIN, reason)


def document_path(task: Task) -> Path:
    """Return where the document of a task stands."""
    (port,) = task.outputs
    return task.folder / port.path(task.item)
