"""What a run printed, kept for as long as nothing that it depends on changes.

Nothing heavy is imported here: where there is nothing to do, `auvid run` looks at files
and prints this again.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.campaigns.workspace import PARAMS_FILE, SHIPPED_VEHICLES, workspace_of
from auvid.pipeline.execution.code_stamp import PRINTING, source_files, source_stamp
from auvid.pipeline.output import plain_values
from auvid.pipeline.store.atomic_files import FILES_READ, regular_text, write_atomically
from auvid.pipeline.store.file_hashes import HASHES, SETTLED_S, FileHashes
from auvid.pipeline.store.package_versions import package_versions

if TYPE_CHECKING:
    from auvid.pipeline.execution.runner import Run

FILE = ".printed.json"
ABSENT = "absent"
"""In place of the hash of a file that is not there."""
SET_BACK_S = 1.0
"""A clock set back by less makes no file look older than the settling time allows."""
TERMINAL = ("TERM", "COLUMNS", "NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE")


@dataclass(frozen=True)
class Beginning:
    """When a command began, by the clock of files and by one that nobody sets."""

    time_s: float = field(default_factory=time.time)
    steady_s: float = field(default_factory=time.monotonic)

    def may_precede_change_of(self, paths: Iterable[Path]) -> bool:
        """Return whether one of the files may have changed since.

        It could change again within a tick of the clock, and once the clock was set back
        a file that changes looks old.
        """
        passed_s = time.monotonic() - self.steady_s
        if time.time() < self.time_s + passed_s - SET_BACK_S:
            return True
        return any(changed_at(path) > self.time_s - SETTLED_S for path in paths)


@dataclass
class Recorder:
    """A stream that passes on what is written, and keeps it."""

    stream: TextIO
    parts: list[str] = field(default_factory=list)

    def write(self, text: str) -> int:
        self.parts.append(text)
        return self.stream.write(text)

    def __getattr__(self, name: str) -> object:
        return getattr(self.stream, name)


@dataclass(frozen=True)
class Printed:
    """What a run prints that has nothing to do, its exit code and its answer."""

    text: str
    status: int
    answer: Mapping[str, Any]


def printed_before(campaign: str, *, strict: bool) -> Printed | None:
    """Return what a run of a campaign would print; None where that must be found out.

    Nothing is returned unless every file that the last run read or wrote, the sources
    of auvid, the versions of packages and the terminal are as they were then.
    """
    return _kept(campaign, _setting(strict))


def is_as_last_run(campaign: str) -> bool:
    """Return whether all is as the last run of a campaign left it."""
    setting = _setting(strict=False)
    return _kept(campaign, {name: setting[name] for name in ("code", "packages")}) is not None


def _kept(campaign: str, setting: Mapping[str, Any]) -> Printed | None:
    """Return what the last run printed, if files and this setting stand."""
    try:
        workspace = workspace_of(campaign)
        name = workspace.campaign_folder(campaign).name
        kept = json.loads(regular_text(workspace.runs / name / FILE))
        files, folders = kept["files"], kept["folders"]
        same = all(kept["setting"][key] == value for key, value in setting.items())
        if not same or not {str(path) for path in files_in(map(Path, folders))} <= set(files):
            return None
        hashes = FileHashes(workspace.runs / name / HASHES)
        if any(_hash_of(Path(path), hashes) != digest for path, digest in files.items()):
            return None
        hashes.save()
        return Printed(kept["text"], kept["status"], kept["answer"])
    except (PipelineError, OSError, ValueError, TypeError, KeyError):
        return None  # the run says what is wrong


def keep_printed(printed: Printed, run: Run, *, start: Beginning, strict: bool) -> None:
    """Keep what a run printed, unless a file that it read, or a source, changed since.

    Nothing is kept of a run that read a pipe or a device.
    `start`: when it began, before the first file was read.
    """
    root = run.folder.parents[1]
    outside = folders_of_vehicles(root, run.campaign.vehicle_file)
    folders = [*outside, *(run.folder / stage.name for stage in run.graph.stages)]
    written = {
        artefact.path: artefact.hash
        for stage in run.graph.stages
        for *_, artefact in run.artefacts(stage)
    }
    read = {*files_in(outside), *FILES_READ, root / PARAMS_FILE} - set(written)
    if start.may_precede_change_of((*read, *source_files(PRINTING))):
        return
    hashes = FileHashes(run.folder / HASHES)
    others = read | files_in(folders) - set(written)
    try:
        digests = written | {path: _hash_of(path, hashes) for path in others}
    except OSError:  # a pipe or device was read: it cannot be looked at again
        return
    document: Mapping[str, Any] = {
        "setting": _setting(strict),
        "folders": [str(path) for path in folders],
        "files": {str(path): digest for path, digest in sorted(digests.items())},
        "text": printed.text,
        "status": printed.status,
        "answer": printed.answer,
    }
    content = json.dumps(plain_values(document), allow_nan=False)
    write_atomically(run.folder / FILE, content.encode())
    hashes.save()


def folders_of_vehicles(root: Path, vehicle_file: Path) -> list[Path]:
    """Return folders in which a new file may change which vehicle a campaign has.

    Coefficients of a vehicle may lie beside its file.
    """
    return [SHIPPED_VEHICLES, root / "vehicles", vehicle_file.with_suffix("")]


def _setting(strict: bool) -> dict[str, Any]:
    """Return what else the text depends on: options, code, packages, terminal."""
    return {
        "strict": strict,
        "code": source_stamp(PRINTING),
        "packages": {"python": sys.version, **package_versions()},
        "folder": str(Path.cwd()),
        "terminal": [
            sys.stdout.isatty(),
            sys.stdout.encoding,
            *(shutil.get_terminal_size() if sys.stdout.isatty() else ()),
            *(os.environ.get(name) for name in TERMINAL),
        ],
    }


def files_in(folders: Iterable[Path]) -> set[Path]:
    """Return all files under folders, hidden ones left out."""
    return {
        Path(top, name)
        for folder in folders
        for top, _, names in os.walk(folder)
        for name in names
        if not name.startswith(".")
    }


def _hash_of(path: Path, hashes: FileHashes) -> str:
    try:
        return hashes.of(path)
    except FileNotFoundError:
        return ABSENT


def changed_at(path: Path) -> float:
    """Return when a file was changed last; 0 where there is none."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return 0.0
    return max(status.st_mtime, status.st_ctime)
