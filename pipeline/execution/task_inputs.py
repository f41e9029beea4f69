"""Where an input of a work item comes from: values of the manifest, artefacts on disk,
collections of them, and raw logs.

Sources are small and picklable; they are opened by the process that runs the item.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from auvid.data_schemas.errors import DataError, LogError
from auvid.pipeline.campaigns.campaign import Campaign
from auvid.pipeline.store import artefacts
from auvid.pipeline.store.atomic_files import contents, readable
from auvid.pipeline.store.fingerprints import FileHashes, hash_value
from auvid.stages.base import Collection, RawFile, RawLog
from auvid.stages.simulate.csv_writer import column_maps


class Source(Protocol):
    """An input: `fingerprint` stands for its content, `load` gives it."""

    @property
    def fingerprint(self) -> Any: ...

    def load(self) -> Any: ...


@dataclass(frozen=True)
class Value:
    """A document of the manifest, or None for an optional input that nothing feeds."""

    value: Any

    @property
    def fingerprint(self) -> Any:
        return None if self.value is None else hash_value(self.value)

    def load(self) -> Any:
        return self.value


@dataclass(frozen=True)
class Artefact:
    """One artefact on disk, by its content."""

    path: Path
    schema: str
    hash: str

    @property
    def fingerprint(self) -> str:
        return self.hash

    def load(self) -> Any:
        return artefacts.load(self.path, self.schema, self.hash)


@dataclass(frozen=True)
class Many:
    """Artefacts by key, loaded one at a time when asked for."""

    entries: Mapping[str, Artefact]

    @property
    def fingerprint(self) -> dict[str, str]:
        return {key: entry.hash for key, entry in self.entries.items()}

    def load(self) -> Collection[Any]:
        return Collection(
            {key: partial(Artefact.load, entry) for key, entry in self.entries.items()}
        )


@dataclass(frozen=True)
class LogPart:
    """One file of a raw log as it was when its hash was taken."""

    name: str
    path: Path
    hash: str
    size: int
    changed_ns: int
    columns: Mapping[str, Any] | None


@dataclass(frozen=True)
class Log:
    """A raw log: its files must be the same after reading as they were before."""

    id: str
    reader: str | None
    parts: tuple[LogPart, ...]

    @property
    def fingerprint(self) -> dict[str, Any]:
        files = [
            {
                "name": part.name,
                "content": part.hash,
                "columns": part.columns and hash_value(part.columns),
            }
            for part in self.parts
        ]
        return {"id": self.id, "reader": self.reader, "files": files}

    def load(self) -> RawLog:
        self.check_unchanged()
        what = f"file of log '{self.id}'"
        files = (
            RawFile(part.name, contents(part.path, file=part.name, what=what), part.columns)
            for part in self.parts
        )
        return RawLog(self.id, tuple(files), self.reader)

    def check_unchanged(self) -> None:
        """Raises `LogError` if a file is not what it was when its hash was taken."""
        for part in self.parts:
            with readable(part.path, file=part.name, what=f"file of log '{self.id}'"):
                status = part.path.stat()
            if (status.st_size, status.st_mtime_ns) != (part.size, part.changed_ns):
                remedy = "Wait until the copy or download has finished, and run again."
                raise LogError(
                    f"the file of log '{self.id}' changed while it was read",
                    file=part.name,
                    remedy=remedy,
                )


def log_source(campaign: Campaign, log: str, hashes: FileHashes) -> Log:
    """The source of a log. Errors of missing or unreadable files name the manifest and
    the log.
    """
    parts = []
    for file in campaign.log_files(log):
        with readable(file.path, file=campaign.file.path, what=f"file of log '{log}'"):
            status = file.path.stat()
            parts.append(
                LogPart(
                    file.name,
                    file.path,
                    hashes.of(file.path),
                    status.st_size,
                    status.st_mtime_ns,
                    file.columns,
                )
            )
    return Log(log, campaign.logs[log].get("reader"), tuple(parts))


def simulated_log(
    entry: Mapping[str, Any], twin: Mapping[str, Any], files: Mapping[str, Artefact]
) -> Log:
    """The source of a log that the stage simulate wrote: `entry` of the manifest,
    `files` by name.

    Raises `DataError` where the twin did not reach the leg of this log.
    """
    maps = column_maps(accelerometer=twin["accelerometer"])
    parts = []
    for item in entry.get("files") or [entry]:
        name = item["file"]
        if name not in files:
            remedy = "The report of stage simulate says when and why the flight stopped."
            raise DataError(
                f"the twin did not reach leg '{entry['id']}', so there is no log of it",
                value=name,
                remedy=remedy,
            )
        status = files[name].path.stat()
        columns = maps[Path(item["columns"]).stem] if "columns" in item else None
        parts.append(
            LogPart(
                name,
                files[name].path,
                files[name].hash,
                status.st_size,
                status.st_mtime_ns,
                columns,
            )
        )
    return Log(entry["id"], None, tuple(parts))
