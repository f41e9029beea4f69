"""Field logs in Python: their streams and what is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import pandas as pd

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.records.logs import LogInfo
from auvid.frames import as_frame
from auvid.pipeline.commands.check.log_page import LogPage, log_pages

COLUMNS = (
    "log",
    "severity",
    "id",
    "stream",
    "text",
    "value",
    "threshold",
    "unit",
    "at_s",
    "remedy",
)


@dataclass(frozen=True)
class LogContents:
    """A log that was read.

    Attributes
    ----------
    name : str
        Name of the file.
    streams : dict of str to pandas.DataFrame
        Sensor stream -> samples on its own clock, in SI, body forward-starboard-down;
        units in ``attrs["units"]``.
    findings : pandas.DataFrame
        What is wrong with it, as `check` returns it.
    info : LogInfo
        Formats, bytes, parameters, vehicle and clock.
    """

    name: str
    streams: dict[str, pd.DataFrame] = field(repr=False)
    findings: pd.DataFrame = field(repr=False)
    info: LogInfo = field(repr=False)


def read_log(
    path: str | PathLike[str], *, columns: str | PathLike[str] | None = None
) -> LogContents:
    """Read a log of any format that auvid knows.

    Parameters
    ----------
    path : path
        The log: DataFlash, telemetry log, ULog, CSV.
    columns : path, optional
        Column map of a CSV log.

    Returns
    -------
    LogContents
        Streams, findings and a description of the log.

    Raises
    ------
    PipelineError
        The log cannot be read; the message says where and what helps.
    """
    (page,) = _pages(fspath(path), columns)
    if page.outputs is None:
        raise LogError(str(page.refused))
    streams = {name: as_frame(table, name) for name, table in page.streams.items()}
    return LogContents(page.name, streams, _findings([page]), page.outputs.log_info)


def check(
    *targets: str | PathLike[str], columns: str | PathLike[str] | None = None
) -> pd.DataFrame:
    """Check logs, or all logs of campaigns, as the command ``auvid check`` does.

    Parameters
    ----------
    *targets : str or path
        Log files, or campaigns by name or folder.
    columns : path, optional
        Column map of CSV logs.

    Returns
    -------
    pandas.DataFrame
        A row per finding: log, severity, id (docs/checks.md), stream, text, value,
        threshold, unit, at_s, remedy. A log that cannot be read is a row ``refused``.
        ``attrs["verdicts"]`` has, by log, what it can be used for.
    """
    return _findings([page for target in targets for page in _pages(fspath(target), columns)])


def _pages(target: str, columns: str | PathLike[str] | None) -> list[LogPage]:
    return log_pages(target, None if columns is None else Path(columns))


def _findings(pages: list[LogPage]) -> pd.DataFrame:
    rows: list[dict[str, Any]] = []
    for page in pages:
        if page.health is None:
            rows.append({"severity": "error", "id": "refused", "text": page.refused})
        else:
            rows += [dict(item) for item in page.health["findings"]]
        for row in rows:
            row.setdefault("log", page.name)
    frame = pd.DataFrame(rows, columns=list(COLUMNS))
    frame.attrs["verdicts"] = {
        page.name: page.health["verdict"] for page in pages if page.health is not None
    }
    return frame
