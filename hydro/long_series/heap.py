"""What a process has freed and its heap keeps, given back to the system."""

from __future__ import annotations

import ctypes
import os


def give_back_heap() -> None:
    """Give the system what is free on the heap of glibc.

    It keeps freed arrays below 32 MB, and lays on top what fits into no piece of them.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.name == "posix" else None
    if trim is not None:  # glibc
        trim(0)
