"""Logs that a campaign shall be written from: decoded, checked, CSV files joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.campaigns.campaign import LogFile
from auvid.pipeline.commands.check.log_page import LogPage, page_of_log


@dataclass(frozen=True)
class SurveyedFile:
    """A file of a log, and the text of the column map that was drafted for it."""

    path: Path
    columns: str | None = None


@dataclass(frozen=True)
class SurveyedLog:
    """A log: its files and its health page."""

    name: str
    files: tuple[SurveyedFile, ...]
    page: LogPage


def survey(paths: Sequence[Path]) -> list[SurveyedLog]:
    """Return the logs that files hold, in their order.

    Raises `PipelineError` for a file that is not there or is named twice.
    """
    seen: set[Path] = set()
    for path in paths:
        if not path.is_file():
            raise PipelineError("there is no such log", file=path)
        if path.resolve() in seen:
            raise PipelineError("the log is named twice", file=path)
        seen.add(path.resolve())
    return [_single(path) for path in paths]


def _single(path: Path) -> SurveyedLog:
    page = page_of_log(path.name, path.stem, (LogFile(path.name, path),))
    return SurveyedLog(path.name, (SurveyedFile(path),), page)
