"""Memory of arrays that are freed: kept for the next, up to a limit."""

from __future__ import annotations

import ctypes

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""What the C library of GNU calls the two, by number (malloc.h)."""
LEFT_BYTES, LARGE_BYTES = 64 << 20, 32 << 20
"""What is kept at most of freed memory at its end, and arrays whose memory goes at once."""


def keep_freed_memory() -> bool:
    """Keep the memory of freed arrays for the next; return whether the C library can.

    Else each array of more than .1 MB comes from the system page by page, each filled
    with zeros, and goes back at once: half the time of arithmetic on such arrays.
    """
    try:
        set_option = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return False  # another C library
    return all((set_option(TRIM_THRESHOLD, LEFT_BYTES), set_option(MMAP_THRESHOLD, LARGE_BYTES)))
