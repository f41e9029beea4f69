"""What the stages of a campaign take from files, as small files on which DVC depends.

One per stage: the hash of the keys of the manifest, of the logs, the vehicle and the
parameters that it reads. Nothing heavy is imported here: DVC asks at each call.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvid.pipeline.campaigns.workspace import PARAMS_FILE, Workspace
from auvid.pipeline.execution.code_stamp import (
    FILE,
    PRINTING,
    hashes_of,
    source_files,
    source_stamp,
)
from auvid.pipeline.execution.kept_output import Beginning, files_in, folders_of_vehicles
from auvid.pipeline.store.atomic_files import (
    FILES_READ,
    regular_text,
    remove_temporary_files,
    write_atomically,
)
from auvid.pipeline.store.package_versions import package_versions

if TYPE_CHECKING:
    from auvid.pipeline.execution.runner import Run


def inputs_unchanged(workspace: Workspace, campaign: str) -> bool:
    """Return whether the files of a campaign's inputs are there and still right.

    Files are looked at and not read: size and times tell of a change.
    """
    folder = workspace.code / workspace.campaign_folder(campaign).name
    try:
        document = json.loads(regular_text(folder / FILE))
        looks = {path: _look(path) for path in _with_new(document["looks"], document["folders"])}
        return bool(
            document["setting"] == _setting()
            and document["looks"] == looks
            and document["files"] == hashes_of(folder, document["files"])
        )
    except (OSError, ValueError, TypeError, KeyError):
        return False


def write_inputs(run: Run, workspace: Workspace, *, start: Beginning) -> None:
    """Write a small file per stage with the hash of what it takes from files.

    Unchanged ones are left as they are. `start`: before the first file was read.
    """
    folder = workspace.code / run.campaign.name
    remove_temporary_files(folder, shared=True)
    setting = _setting()
    lines = {f"{stage.name}.txt": run.inputs_from_files(stage) for stage in run.graph.stages}
    for name, digest in lines.items():
        path, line = folder / name, f"{Path(name).stem} {digest}\n".encode()
        if not path.is_file() or path.read_bytes() != line:
            write_atomically(path, line)
    folders = [str(path) for path in folders_of_vehicles(workspace.root, run.campaign.vehicle_file)]
    read = _with_new([*map(str, FILES_READ), str(workspace.root / PARAMS_FILE)], folders)
    if start.may_precede_change_of((*map(Path, read), *source_files(PRINTING))):
        return
    document = {
        "setting": setting,
        "folders": folders,
        "looks": {path: _look(path) for path in read},
        "files": hashes_of(folder, lines),
    }
    write_atomically(folder / FILE, json.dumps(document).encode())


def _setting() -> Mapping[str, Any]:
    """Return what else the hashes depend on."""
    return {
        "code": source_stamp(PRINTING),
        "packages": {"python": sys.version, **package_versions()},
    }


def _with_new(paths: Iterable[str], folders: Iterable[str]) -> set[str]:
    """Return paths and those of all files under folders."""
    return {*paths, *map(str, files_in(map(Path, folders)))}


def _look(path: str) -> list[int] | None:
    """Return size and times of a file; None where there is none."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return None
    return [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
