"""A lock on a run folder: one run of a campaign at a time.

The system holds it as long as the process lives.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.store.atomic_files import refusal, writable

FILE = ".lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a run folder.

    Raises `PipelineError` while another live process holds it.
    """
    _refuse_unusable(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / FILE, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as fault:
        raise refusal(fault, "the run folder cannot be used", folder) from fault
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as fault:
            if not isinstance(fault, BlockingIOError):
                raise refusal(fault, "the run folder cannot be locked", folder) from fault
            holder = os.pread(handle, 32, 0).decode(errors="replace").strip() or "unknown"
            remedy = "Wait until it has finished."
            raise PipelineError(
                "another run of this campaign is under way",
                file=folder,
                value=f"process {holder}",
                remedy=remedy,
            ) from None
        with writable(folder / FILE):
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(handle)


def _refuse_unusable(folder: Path) -> None:
    """Raise `PipelineError` for a link to nothing, or a name that is no text."""
    for path in (folder, folder.parent):
        if path.is_symlink() and not path.exists():
            raise PipelineError(
                "a link to a folder that is not there",
                file=path,
                value=str(path.readlink()),
                remedy="Connect the disk that it leads to, or remove the link.",
            )
    try:
        str(folder.resolve()).encode("utf-8")
    except UnicodeEncodeError:
        raise PipelineError(
            "the name of a folder is no UTF-8 text", file=folder, remedy="Rename the folder."
        ) from None
