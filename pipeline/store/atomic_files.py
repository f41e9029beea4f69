"""Files that are whole or not there: temporary file, fsync, rename."""

from __future__ import annotations

import difflib
import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.errors import PipelineError

TEMPORARY = ".part"
NAMED_FILES = 5
LARGEST_IN_MEMORY = 1 << 30
REMEDIES = {
    errno.ENOSPC: "Free some space and run again: what was finished is kept.",
    errno.EDQUOT: "Free some space and run again: what was finished is kept.",
    errno.EACCES: "Check who owns the folder.",
    errno.EROFS: "The file system is read-only.",
}


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that readers see the old content or the new, never a part.

    Raises `PipelineError` where the system refuses.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _write(path, content)
    except OSError as fault:
        raise PipelineError(
            f"cannot be written: {fault.strerror or fault}",
            file=path,
            remedy=REMEDIES.get(fault.errno or 0),
        ) from fault


def _write(path: Path, content: bytes) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY}")
    try:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Make renames and removals in a folder last through a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove_stale_files(folder: Path, keep: set[Path]) -> None:
    """Remove files under a folder that are not in `keep`, and folders left empty."""
    if not folder.is_dir():
        return
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and not path.is_symlink():
            if not any(path.iterdir()):
                path.rmdir()
        elif path not in keep:
            path.unlink()


def remove_temporary_files(folder: Path) -> None:
    """Remove temporary files that a killed writer left behind."""
    for path in folder.rglob(f".*{TEMPORARY}"):
        path.unlink(missing_ok=True)


@contextmanager
def readable(path: Path, *, file: object, what: str) -> Iterator[None]:
    """Turn a refusal to read into a fault that says which entry of which file it is."""
    try:
        if path.is_dir():
            raise PipelineError(f"{what} is a folder, not a file", file=file, value=str(path))
        yield
    except FileNotFoundError as fault:
        raise PipelineError(
            f"{what} is not there", file=file, value=str(path), remedy=_neighbours(path)
        ) from fault
    except PermissionError as fault:
        raise PipelineError(
            f"{what} cannot be read: no permission", file=file, value=str(path)
        ) from fault
    except OSError as fault:
        raise PipelineError(
            f"{what} cannot be read: {fault.strerror or fault}", file=file, value=str(path)
        ) from fault


def _neighbours(path: Path) -> str:
    """Return what there is in place of a missing file, as a remedy."""
    folder = next((parent for parent in path.absolute().parents if parent.is_dir()), Path("/"))
    if folder != path.absolute().parent:
        return f"There is no folder {path.absolute().parent}; there is {folder}."
    names = sorted(entry.name for entry in folder.iterdir() if not entry.name.startswith("."))
    close = difflib.get_close_matches(path.name, names, n=3, cutoff=0.5)
    if close:
        return f"Did you mean {' or '.join(close)}?"
    more = f" and {len(names) - NAMED_FILES} more" if len(names) > NAMED_FILES else ""
    return (
        f"The folder holds {', '.join(names[:NAMED_FILES])}{more}."
        if names
        else "The folder is empty."
    )


def contents(path: Path, *, file: object, what: str) -> npt.NDArray[np.uint8]:
    """Return the bytes of a file, read-only.

    A file that is cut short while it is mapped would end the process (SIGBUS), so only
    what is larger than `LARGEST_IN_MEMORY` is mapped.
    """
    with readable(path, file=file, what=what):
        if path.stat().st_size > LARGEST_IN_MEMORY:
            return np.memmap(path, dtype=np.uint8, mode="r")
        content = np.fromfile(path, dtype=np.uint8)
    content.flags.writeable = False
    return content
