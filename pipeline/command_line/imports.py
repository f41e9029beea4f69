"""Imports of a command that works for seconds."""

from __future__ import annotations

import gc
from collections.abc import Generator
from contextlib import contextmanager

_frozen = False
"""Whether imports of this process are kept: to count them takes longer than to keep them."""


@contextmanager
def kept_for_good() -> Generator[None]:
    """Let the garbage collector pass over what is imported within.

    Modules stay until the end; to look through their objects again and again takes half
    a second of a run of seven.
    """
    global _frozen
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if not _frozen:  # once in a process, else its garbage would stay too
            gc.freeze()
            _frozen = True
        if was_enabled:
            gc.enable()
