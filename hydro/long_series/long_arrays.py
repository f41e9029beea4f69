"""Long arrays outside of the memory of a process, where its runner has a place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from mmap import mmap
from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

LONG_BYTES = 1_000_000
"""A column of three quarters of an hour at 50 Hz."""
Values = TypeVar("Values", bound=npt.NDArray[Any])


class OutsidePlace(Protocol):
    """Where a runner lays long arrays down."""

    def lay_down(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the values as they lie there, read-only."""

    def copied(self, path: str) -> npt.NDArray[np.uint8] | None:
        """Return the bytes of a file as they lie there; None where they cannot."""

    def let_go(self) -> None:
        """Take what was read out of memory; it is read again where needed."""


_places: list[OutsidePlace] = []


@contextmanager
def laid_down_in(place: OutsidePlace | None) -> Iterator[None]:
    """Lay long arrays down in a place meanwhile; without one they stay in memory."""
    if place is None:
        yield
        return
    _places.append(place)
    try:
        yield
    finally:
        _places.remove(place)


def laid_down(values: Values, least_bytes: int = LONG_BYTES) -> Values:
    """Return an array, a long one as it lies outside of memory, read-only.

    `least_bytes`: size from which it is long; of one of many it is smaller.

    >>> laid_down(np.ones(2))
    array([1., 1.])
    """
    if not _places or values.nbytes < least_bytes or values.dtype.hasobject or is_mapped(values):
        return values
    let_go()
    return _places[-1].lay_down(values)  # type: ignore[return-value]


def copied_file(path: str, size: int) -> npt.NDArray[np.uint8] | None:
    """Return the bytes of a long file as they are laid down, else None."""
    return _places[-1].copied(path) if _places and size >= LONG_BYTES else None


def is_mapped(values: object) -> bool:
    """Return whether an array, or each of several, lies in a file that is mapped.

    >>> is_mapped(np.ones(2))
    False
    """
    if isinstance(values, tuple):
        return all(map(is_mapped, values))
    while isinstance(values, np.ndarray):
        values = values.base
    return isinstance(values, mmap)


def let_go() -> None:
    """Take what was read of long arrays out of memory."""
    for place in _places:
        place.let_go()
