"""Imports of a command that works for seconds."""

from __future__ import annotations

import gc
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def kept_for_good() -> Generator[None]:
    """Let the garbage collector pass over what is imported within.

    Modules stay until the end; to look through their objects again and again takes half
    a second of a run of seven.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():  # once in a process, else its garbage would stay too
            gc.freeze()
        if was_enabled:
            gc.enable()
