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
