"""Files that are whole or not there: temporary file, fsync, rename."""

from __future__ import annotations

import difflib
import errno
import os
import re
import stat
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from auvid.data_schemas.errors import PipelineError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

TEMPORARY = ".part"
OF_PROCESS = re.compile(rf"\..+\.(\d+){re.escape(TEMPORARY)}", re.DOTALL)
NAMED_FILES = 5
LARGEST_DOCUMENT = 16 << 20
"""Bytes of a document that somebody writes: ten times those of 20 000 legs."""
LARGEST_IN_MEMORY = 1 << 30
FILES_READ: set[Path] = set()
"""Documents and logs that this process has read, or has looked for."""
SYSTEM_REFUSALS: list[OSError] = []
"""What the system refused this process, in order: disk, memory, permission. It says nothing
of a log or a campaign, so what comes of it is no result to keep.
"""
SPACE = "Free some space and run again: what was finished is kept."
OWNER = "Check who owns the folder."
DISK = "The disk or its connection has a fault: see the system's log, then run again."
REMEDIES = {
    errno.ENOSPC: SPACE,
    errno.EDQUOT: SPACE,
    errno.EFBIG: "No larger file is allowed: see ulimit -f, or use another file system.",
    errno.EACCES: OWNER,
    errno.EPERM: OWNER,
    errno.EROFS: "The file system is read-only.",
    errno.EIO: DISK,
    errno.ESTALE: DISK,
    errno.ENAMETOOLONG: "Shorten the name.",
    errno.EMFILE: "Too many files are open: raise the limit (ulimit -n).",
    errno.ENFILE: "Too many files are open on this machine.",
    errno.ENOMEM: "Free some memory and run again: what was finished is kept.",
}
"""Refusals of the system that no change of auvid can mend, with what helps."""


def refusal(fault: OSError, words: str, file: object = None) -> PipelineError:
    """Return what the system refused as a fault with file and remedy."""
    _remember(fault)
    return PipelineError(
        f"{words}: {fault.strerror or fault}",
        file=fault.filename if file is None else file,
        remedy=REMEDIES.get(fault.errno or 0),
    )


def _remember(fault: OSError) -> None:
    if fault.errno in REMEDIES:
        SYSTEM_REFUSALS.append(fault)


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """Turn a refusal to write or remove into a fault that names the file."""
    try:
        yield
    except OSError as fault:
        raise refusal(fault, "cannot be written", path) from fault


def write_atomically(path: Path, content: bytes | Generator[bytes]) -> None:
    """Write a file so that readers see the old content or the new, never a part.

    Content may come in pieces, of which one is in memory at a time.

    A link is replaced, a file keeps its mode. Raises `PipelineError` where the system
    refuses.
    """
    with writable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _write(path, content)


def write_output(path: Path, content: bytes) -> None:
    """Write a file that a user named: as `write_atomically`, but a link stays a link.

    Devices and pipes are written into. Raises `PipelineError` where the system refuses.
    """
    with writable(path):
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        if path.exists() and (not path.is_file() or _of_the_system(path)):
            with path.open("ab") as device:
                device.write(content)
            return
        target = path.resolve()
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_temporary_files(target.parent, of=target.name)
        _write(target, content)


def _of_the_system(path: Path) -> bool:
    """Return whether a path names an open file (/dev/fd/3), not one of a RAM disk."""
    top, *rest = path.absolute().parts[1:]
    return top == "proc" or (top == "dev" and rest[:1] != ["shm"])


def _write(path: Path, content: bytes | Generator[bytes]) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY}")
    pieces = (piece for piece in [content]) if isinstance(content, bytes) else content
    try:
        with closing(pieces), part.open("wb") as file:
            if path.is_file() and not path.is_symlink():
                os.fchmod(file.fileno(), stat.S_IMODE(path.stat().st_mode))
            for piece in pieces:
                file.write(piece)
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


def refuse_linked_folders(folder: Path) -> None:
    """Raise `PipelineError` where a folder or one under it is a link.

    What a link leads to is not ours: nothing may be written there or removed.
    """
    inner = (Path(top) / name for top, names, _ in os.walk(folder) for name in names)
    for path in (folder, *inner):
        if path.is_symlink():
            raise PipelineError(
                "the folder of results is a link, and files behind it could be lost",
                file=path,
                value=str(path.readlink()),
                remedy="Remove the link, or link the folder runs/ as a whole.",
            )


def remove_stale_files(folder: Path, keep: set[Path], names: set[str]) -> None:
    """Remove artefacts under a folder that are not in `keep`, and folders left empty.

    An artefact bears one of `names`, or lies in a folder that does; other files stay.
    """
    if not folder.is_dir():
        return
    for path in sorted(folder.rglob("*"), reverse=True):
        with writable(path):
            if path.is_dir() and not path.is_symlink():
                if not any(path.iterdir()):
                    path.rmdir()
            elif path not in keep and (path.stem in names or path.parent.name in names):
                path.unlink()


def remove_temporary_files(folder: Path, *, of: str | None = None, shared: bool = False) -> None:
    """Remove temporary files that killed writers left in a folder or below.

    With `of` only those of this name, in the folder itself. Where others may be writing
    (`shared`, or `of`), files of live processes stay.
    """
    leftovers = folder.rglob(f".*{TEMPORARY}") if of is None else folder.glob(f".*{TEMPORARY}")
    for path in leftovers:
        process = OF_PROCESS.fullmatch(path.name)
        if process is None or (of is not None and not path.name.startswith(f".{of}.")):
            continue
        with writable(path):
            if not (shared or of is not None) or not _lives(int(process[1])):
                path.unlink(missing_ok=True)


def _lives(process: int) -> bool:
    """Return whether another process of this number runs."""
    if process == os.getpid():
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


@contextmanager
def readable(path: Path, *, file: object, what: str) -> Iterator[None]:
    """Turn a refusal to read into a fault that says which entry of which file it is."""
    FILES_READ.add(path.absolute())
    try:
        if path.is_dir():
            raise PipelineError(
                f"{what} is a folder, not a file",
                file=file,
                value=str(path),
                remedy="Name one of its files.",
            )
        if path.exists() and not path.is_file():
            raise PipelineError(
                f"{what} is no regular file",
                file=file,
                value=str(path),
                remedy="Copy what it delivers into a file first.",
            )
        yield
    except FileNotFoundError as fault:
        raise PipelineError(
            f"{what} is not there", file=file, value=str(path), remedy=_neighbours(path)
        ) from fault
    except PermissionError as fault:
        _remember(fault)
        raise PipelineError(
            f"{what} cannot be read: no permission", file=file, value=str(path)
        ) from fault
    except OSError as fault:
        _remember(fault)
        raise PipelineError(
            f"{what} cannot be read: {fault.strerror or fault}", file=file, value=str(path)
        ) from fault


def document_bytes(path: Path, *, file: object, what: str) -> bytes:
    """Return the bytes of a document.

    Raises `PipelineError` as `readable` does, and for what is too large.
    """
    with readable(path, file=file, what=what):
        size = path.stat().st_size
        if size > LARGEST_DOCUMENT:
            raise PipelineError(
                f"{what} is too large for a document",
                file=file,
                value=f"{path}, {size / 1e6:.0f} MB",
                allowed=f"at most {LARGEST_DOCUMENT / 1e6:.0f} MB",
                remedy="Is it a log, or a file that another program has spoiled?",
            )
        return path.read_bytes()


def regular_text(path: Path) -> str:
    """Return the text of a file.

    Raises `OSError` for a pipe, which would keep us waiting.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "no regular file", str(path))
    return path.read_text(encoding="utf-8")


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
    what is larger than `LARGEST_IN_MEMORY` is mapped; a task maps a copy of a long one.
    """
    import numpy as np

    from auvid.hydro.long_series.long_arrays import copied_file

    with readable(path, file=file, what=what):
        size = path.stat().st_size
        if size > LARGEST_IN_MEMORY:
            return np.memmap(path, dtype=np.uint8, mode="r")
        copy = copied_file(str(path), size)
        content = np.fromfile(path, dtype=np.uint8) if copy is None else copy
    content.flags.writeable = False
    return content
