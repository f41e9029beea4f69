"""Checksums of many MAVLink frames as a compiled loop.

Import this module only where frames are read: numba takes a second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

F = TypeVar("F", bound=Callable[..., Any])
Bytes = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]
Words = npt.NDArray[np.uint16]


def _compiled(function: F) -> F:
    compiled: Any = numba.njit(cache=True, nogil=True)(function)
    return cast(F, compiled)


@_compiled
def checksum_states(
    buffer: Bytes, start: Integers, stop: Integers, table: Words, first: int, out: Words
) -> None:
    """Fill in the checksum state (n,) after bytes start:stop, from the state `first`.

    table (4, 256): row k is the state after k more zero bytes, so that four bytes take
    one step.
    """
    for row in range(start.size):
        state = np.uint32(first)
        at, end = start[row], stop[row]
        while end - at >= 4:
            state ^= np.uint32(buffer[at]) | (np.uint32(buffer[at + 1]) << np.uint32(8))
            state = (
                np.uint32(table[3, state & np.uint32(0xFF)])
                ^ np.uint32(table[2, state >> np.uint32(8)])
                ^ np.uint32(table[1, buffer[at + 2]])
                ^ np.uint32(table[0, buffer[at + 3]])
            )
            at += 4
        while at < end:
            low = (state ^ np.uint32(buffer[at])) & np.uint32(0xFF)
            state = np.uint32(table[0, low]) ^ (state >> np.uint32(8))
            at += 1
        out[row] = state
