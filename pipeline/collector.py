"""The garbage collector of a process that works for seconds."""

from __future__ import annotations

import gc
from collections.abc import Generator
from contextlib import contextmanager

NEW_OBJECTS = 20_000
"""So many, since it looked last, make the collector look again: at 700, which is Python's
own number, it takes a thirtieth of a run.
"""
_frozen = False
"""Whether imports of this process are kept: to count them takes longer than to keep them."""


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
        pass_over_imports()
        if was_enabled:
            gc.enable()


def pass_over_imports() -> None:
    """Let the garbage collector pass over what is imported so far, and look seldom."""
    global _frozen
    if not _frozen:  # once in a process, else its garbage would stay too
        gc.freeze()
        gc.set_threshold(NEW_OBJECTS)
        _frozen = True
