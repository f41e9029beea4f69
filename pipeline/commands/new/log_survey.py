"""Logs that a campaign shall be written from: decoded, checked, CSV files joined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.campaign import LogFile
from auvid.pipeline.commands.check.log_page import LogPage, page_of_log
from auvid.pipeline.store.atomic_files import contents
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.csv.column_draft import ColumnDraft, draft_columns
from auvid.stages.ingest.formats.csv.column_map import dialect_map
from auvid.stages.ingest.formats.csv.draft_corrections import corrected
from auvid.stages.ingest.formats.csv.reader import CSV, header
from auvid.stages.ingest.registry import reader_of

SHARED = 0.5
"""Files of one dive share so much of the time of the shorter one."""
LISTED = 6
ROUNDS = 5
"""Corrections of a drafted column map, each after a new check of the log."""


@dataclass(frozen=True)
class SurveyedFile:
    """A file of a log, and the column map that was drafted for it."""

    path: Path
    draft: ColumnDraft | None = None


@dataclass(frozen=True)
class SurveyedLog:
    """A log: its files and its health page."""

    name: str
    files: tuple[SurveyedFile, ...]
    page: LogPage


def survey(paths: Sequence[Path]) -> list[SurveyedLog]:
    """Return the logs in files, in order; CSV files of one dive are one log.

    Raises `PipelineError` for a file that is not there or is named twice.
    """
    named: set[Path] = set()
    for path in paths:
        if not path.is_file():
            raise PipelineError("there is no such log", file=path)
        if path.resolve() in named:
            raise PipelineError("the log is named twice", file=path)
        named.add(path.resolve())
    logs: list[list[SurveyedFile]] = []
    refused: dict[Path, str] = {}
    for path in paths:
        try:
            draft = _draft(path)
        except PipelineError as fault:
            refused[path] = str(fault)
            draft = None
        _join(logs, SurveyedFile(path, draft))
    return [_surveyed(files, refused) for files in logs]


def _draft(path: Path) -> ColumnDraft | None:
    """Return the drafted column map of a CSV file; None for one that needs none."""
    file = RawFile(path.name, contents(path, file=path.name, what="log"), None)
    if reader_of(file) is not CSV or dialect_map(header(file, None).names) is not None:
        return None
    return draft_columns(file)


def _join(logs: list[list[SurveyedFile]], file: SurveyedFile) -> None:
    """Add a file to the log whose time it shares and whose streams it completes."""
    draft = file.draft
    for files in logs if draft is not None else ():
        drafts = [item.draft for item in files if item.draft is not None]
        if draft is None or not drafts or drafts[0].time["epoch"] != draft.time["epoch"]:
            continue
        there = {name for item in drafts for name in item.streams}
        new = set(draft.streams) - there
        if new and there and shared(drafts[0].span_s, draft.span_s) >= SHARED:
            files.append(SurveyedFile(file.path, draft.without(*there)))
            return
    logs.append([file])


def shared(first: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the share of the shorter span that both have."""
    common = min(first[1], other[1]) - max(first[0], other[0])
    return common / max(min(first[1] - first[0], other[1] - other[0]), 1e-9)


def _surveyed(files: Sequence[SurveyedFile], refused: Mapping[Path, str]) -> SurveyedLog:
    """Return a log with its health page, its drafted maps corrected by its findings."""
    name = files[0].path.name + (f" and {len(files) - 1} more" if len(files) > 1 else "")
    faults = [refused[file.path] for file in files if file.path in refused]
    empty = [file for file in files if file.draft is not None and not file.draft.columns]
    if empty:
        (draft,) = [file.draft for file in empty][:1]
        faults.append(_nothing(draft))
    if faults:
        return SurveyedLog(name, tuple(files), LogPage(name, refused="; ".join(faults)))
    return corrected_log(SurveyedLog(name, tuple(files), _page(files)))


def corrected_log(log: SurveyedLog, vehicle: Vehicle | None = None) -> SurveyedLog:
    """Return a log with its drafted column maps corrected by its checks.

    With a vehicle these know how the thrusters push.
    """
    if all(file.draft is None for file in log.files):
        return log
    if vehicle is not None:
        log = replace(log, page=_page(log.files, vehicle))
    for _ in range(ROUNDS):
        if log.page.health is None:
            break
        findings = log.page.health["findings"]
        files = tuple(
            replace(file, draft=file.draft and corrected(file.draft, findings))
            for file in log.files
        )
        if files == log.files:
            break
        log = replace(log, files=files, page=_page(files, vehicle))
    return log


def _nothing(draft: ColumnDraft | None) -> str:
    """Return in words that no column of a file fills a stream."""
    assert draft is not None
    remarks = " ".join(draft.remarks)
    return (
        f"{draft.file}: no columns fill a stream (columns: {', '.join(draft.unused[:LISTED])})."
        f" {remarks} Rename them so that they tell (depth_m, roll_deg, u_mps, pwm_1 ...)."
    )


def draft_remarks(log: SurveyedLog) -> list[str]:
    """Return what drafted column maps leave out, as sentences."""
    lines = []
    for file in log.files:
        if file.draft is not None:
            lines += [f"{file.path.name}: {remark}" for remark in file.draft.remarks]
            if file.draft.unused:
                names = ", ".join(file.draft.unused[:LISTED])
                lines.append(f"{file.path.name}: no meaning found for {names}")
    return lines


def _page(files: Sequence[SurveyedFile], vehicle: Vehicle | None = None) -> LogPage:
    logs = [
        LogFile(file.path.name, file.path, file.draft.document() if file.draft else None)
        for file in files
    ]
    return page_of_log(files[0].path.name, files[0].path.stem, logs, vehicle=vehicle)
