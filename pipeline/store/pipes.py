"""Files that save themselves, read through a named pipe meanwhile; ends of threads."""

from __future__ import annotations

import ctypes
import os
import select
import tempfile
import threading
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path

NAME = "saving"
PIECE_BYTES = 1 << 20
POLL_S = 0.1
CLOSED_S = 0.005


def saved_pieces(save: Callable[[str], None]) -> Generator[bytes]:
    """Give what `save` writes to a path, in pieces, while it writes.

    The path is a named pipe: nothing piles up in memory or on disk, and a disk that is
    full is met by whoever writes the pieces. Raises what `save` raises. Where nobody asks
    for more, `save` is ended by `SystemExit`; what it still writes then is read and dropped.
    """
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1, NAME) as writer:
        path = Path(folder) / "pipe"
        os.mkfifo(path)
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0) as pipe:
            saving = writer.submit(save, str(path))
            try:
                while True:
                    is_over = saving.done()
                    select.select([pipe], [], [], POLL_S)
                    if piece := pipe.read(PIECE_BYTES):
                        yield piece
                    elif is_over:
                        break
                    else:  # a pipe closed by its writer is ready at once, and empty
                        wait([saving], timeout=CLOSED_S)
            finally:
                if not saving.done():
                    stop_threads(NAME)
                while not saving.done():
                    select.select([pipe], [], [], POLL_S)
                    pipe.read(PIECE_BYTES)
        saving.result()


def stop_threads(name: str) -> None:
    """Raise `SystemExit` in the threads of a pool, each at its next line of Python.

    Whoever waits for them, as a pool does at its end, else waits for all of their work.
    """
    for thread in threading.enumerate():
        if thread.ident is not None and thread.name.startswith(name):
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(thread.ident), ctypes.py_object(SystemExit)
            )
