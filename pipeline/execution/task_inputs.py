"""Inputs of a work item: manifest values, artefacts, collections of them, raw logs.

Sources are small and picklable; they are opened by the process that runs the item.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from auvid.data_schemas.documents import written
from auvid.data_schemas.errors import DataError, LogError, PipelineError
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.campaign import Campaign, LogFile
from auvid.pipeline.execution.memory import give_back
from auvid.pipeline.graph import Port
from auvid.pipeline.store import artefacts
from auvid.pipeline.store.atomic_files import contents, readable
from auvid.pipeline.store.file_hashes import hash_value
from auvid.pipeline.store.manifest import Manifest
from auvid.stages.base import Collection, RawFile, RawLog

LONG_FILE_BYTES = 8_000_000
"""Before a longer file is loaded, memory of what was loaded earlier is given back."""


class Source(Protocol):
    """An input: `fingerprint` stands for its content, `load` gives it."""

    @property
    def fingerprint(self) -> Any: ...

    def load(self) -> Any: ...


@dataclass(frozen=True)
class Value:
    """A document of the manifest, or None for an optional input without a source.

    `written` is what its fingerprint is formed of, where the value has no plain form.
    """

    value: Any
    written: object = None

    @property
    def fingerprint(self) -> Any:
        return None if self.value is None else hash_value(self.written or written(self.value))

    def load(self) -> Any:
        return self.value


def vehicle_source(vehicle: Vehicle) -> Value:
    """Return the source of a vehicle; its fingerprint follows its document."""
    return Value(vehicle, vehicle.document.model_dump(exclude_unset=True))


def shelf_source(shelf: Mapping[str, Vehicle]) -> Value:
    """Return the source of published vehicles by name; None where there are none."""
    documents = {
        name: vehicle.document.model_dump(exclude_unset=True) for name, vehicle in shelf.items()
    }
    return Value(dict(shelf) or None, documents)


@dataclass(frozen=True)
class Artefact:
    """One artefact on disk, by its content."""

    path: Path
    schema: str
    hash: str

    @property
    def fingerprint(self) -> str:
        return self.hash

    def load(self, columns: Sequence[str] = (), times: tuple[float, float] | None = None) -> Any:
        """Return the artefact; with `columns` or `times` a part of a table."""
        with suppress(OSError):  # the loading says what is wrong
            if self.path.stat().st_size > LONG_FILE_BYTES:
                give_back()
        return artefacts.load(self.path, self.schema, self.hash, columns, times)


@dataclass(frozen=True)
class RowsOnDisk:
    """A table whose rows are loaded when the stage asks for them (`Rows`)."""

    artefact: Artefact

    @property
    def fingerprint(self) -> str:
        return self.artefact.fingerprint

    def load(self) -> RowsOnDisk:
        return self

    def between(self, start_us: float, end_us: float) -> Any:
        """Return the rows of these times, and others of their groups."""
        return self.artefact.load(times=(start_us, end_us))


@dataclass(frozen=True)
class ColumnsOnDisk:
    """A table of which a stage takes some columns; which is part of its code."""

    artefact: Artefact
    columns: tuple[str, ...]

    @property
    def fingerprint(self) -> str:
        return self.artefact.fingerprint

    def load(self) -> Any:
        return self.artefact.load(self.columns)


def artefacts_of(manifest: Manifest, port: Port, item: str) -> dict[str | None, Artefact]:
    """Return what a port gave for an item, by key (None for a single one).

    Empty if it gave none.
    """
    record = manifest.records.get(item)
    hashes = record.outputs.get(port.name) if record is not None else None
    if hashes is None:
        return {}
    named = [(None, hashes)] if isinstance(hashes, str) else hashes.items()
    return {
        key: Artefact(manifest.folder / port.path(item, key), port.schema, value)
        for key, value in named
    }


@dataclass(frozen=True)
class Many:
    """Artefacts by key, loaded one at a time when asked for."""

    entries: Mapping[str, Artefact]

    @property
    def fingerprint(self) -> dict[str, str]:
        return {key: entry.hash for key, entry in self.entries.items()}

    def load(self) -> Collection[Any]:
        return Collection(
            {key: partial(Artefact.load, entry) for key, entry in self.entries.items()},
            lambda key, columns: self.entries[key].load(columns),
        )


@dataclass(frozen=True)
class LogPart:
    """One file of a raw log as it was when its hash was taken."""

    file: LogFile
    hash: str
    size: int
    changed_ns: int


@dataclass(frozen=True)
class Log:
    """A raw log whose files must be the same after reading as before."""

    id: str
    reader: str | None
    parts: tuple[LogPart, ...]

    @property
    def fingerprint(self) -> dict[str, Any]:
        files = [
            {
                "name": part.file.name,
                "content": part.hash,
                "columns": part.file.columns and hash_value(part.file.columns),
            }
            for part in self.parts
        ]
        return {"id": self.id, "reader": self.reader, "files": files}

    def load(self) -> RawLog:
        self.check_unchanged()
        what = f"file of log '{self.id}'"
        files = (
            RawFile(
                file.name, partial(contents, file.path, file=file.name, what=what), file.columns
            )
            for file in (part.file for part in self.parts)
        )
        return RawLog(self.id, tuple(files), self.reader)

    def check_unchanged(self) -> None:
        """Raise `LogError` if a file is not what it was when its hash was taken."""
        for part in self.parts:
            with readable(part.file.path, file=part.file.name, what=f"file of log '{self.id}'"):
                status = part.file.path.stat()
            if (status.st_size, status.st_mtime_ns) != (part.size, part.changed_ns):
                raise LogError(
                    f"the file of log '{self.id}' changed while it was read",
                    file=part.file.name,
                    remedy="Wait until the copy or download has finished, and run again.",
                )


def log_files(campaign: Campaign, log: str, simulated: Path) -> tuple[LogFile, ...]:
    """Return the files of a log; those of a twin lie in the folder `simulated`.

    Raises `PipelineError` for files that are missing or outside the campaign, and where
    the twin has not been simulated or did not reach the leg of this log.
    """
    if campaign.twin is None:
        return campaign.log_files(log)
    if not simulated.is_dir():
        raise PipelineError(
            "the logs of this twin have not been simulated",
            file=campaign.file.path,
            remedy=f"auvid run {campaign.name} --only simulate",
        )
    from auvid.stages.simulate.csv_writer import column_maps

    maps = column_maps(accelerometer=campaign.twin.accelerometer)
    entry = campaign.logs[log]
    files = []
    for item in entry.get("files") or [entry]:
        columns = maps[Path(item["columns"]).stem] if "columns" in item else None
        files.append(LogFile(item["file"], simulated / item["file"], columns))
        if not files[-1].path.is_file():
            raise DataError(
                f"the twin did not reach leg '{log}', so there is no log of it",
                value=item["file"],
                remedy="The report of stage simulate says when and why the simulation stopped.",
            )
    return tuple(files)


def log_source(
    log: str,
    files: Sequence[LogFile],
    *,
    reader: str | None = None,
    hash_of: Callable[[Path], str] | None = None,
    named_in: Path | None = None,
) -> Log:
    """Return the source of a log; without `hash_of` its fingerprint is not valid.

    Faults of files name the manifest `named_in`, or the file itself.
    """
    parts = []
    for file in files:
        with readable(file.path, file=named_in or file.path, what=f"file of log '{log}'"):
            status = file.path.stat()
            content = hash_of(file.path) if hash_of is not None else ""
        parts.append(LogPart(file, content, status.st_size, status.st_mtime_ns))
    return Log(log, reader, tuple(parts))
