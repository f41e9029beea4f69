"""Long arrays in files without a name, which go with the process however it ends."""

from __future__ import annotations

import errno
import mmap
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO
from weakref import WeakSet

import numpy as np
import numpy.typing as npt

from auvid.pipeline.store.atomic_files import TEMPORARY, readable, writable

PIECE_BYTES = 1 << 22
NO_MAPS = {errno.ENODEV, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP}
"""What file systems say that map no files."""
OPEN_SHARE = 0.5
"""Of the files that a process may have open; each mapped array holds one."""


class ArrayFile:
    """Arrays of one task, in the folder of its results.

    An array has a file of its own, which is mapped and goes when nobody holds the array.
    It is written before it is mapped, so that a full disk is a fault and no signal. Where no
    more can be mapped, arrays stay in memory. Threads may use it at once.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._maps: WeakSet[mmap.mmap] = WeakSet()
        self._changing = Lock()
        self._most_maps = _most_maps()

    def lay_down(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the values as they lie in a file, read-only."""
        if len(self._maps) >= self._most_maps:
            return values
        octets = np.ascontiguousarray(values).reshape(-1).view(np.uint8)
        starts = range(0, octets.size, PIECE_BYTES)
        laid = self._laid(octets[start : start + PIECE_BYTES].data for start in starts)
        return values if laid is None else laid.view(values.dtype).reshape(values.shape)

    def copied(self, path: str) -> npt.NDArray[np.uint8] | None:
        """Return the bytes of another file, which nobody can cut short now."""
        with open(path, "rb") as source:
            return self._laid(_pieces(source, Path(path)))

    def let_go(self) -> None:
        """Take what was read of the arrays out of memory."""
        with self._changing:
            there = list(self._maps)
        for mapped in there:
            mapped.madvise(mmap.MADV_DONTNEED)

    def _laid(self, pieces: Iterator[bytes | memoryview]) -> npt.NDArray[np.uint8] | None:
        """Return pieces as they lie in a file; None where the file system maps none."""
        with writable(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(
                prefix=".array.", suffix=f".{os.getpid()}{TEMPORARY}", dir=self._folder
            ) as file:
                for piece in pieces:
                    file.write(piece)
                file.flush()
                try:
                    mapped = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)
                except OSError as fault:
                    if fault.errno in NO_MAPS:
                        return None
                    raise
        with self._changing:
            self._maps.add(mapped)
        return np.ndarray(len(mapped), np.uint8, mapped)


def _pieces(source: BinaryIO, path: Path) -> Iterator[bytes]:
    """Yield a file in pieces; what the system refuses is a fault of this file."""
    with readable(path, file=path, what="file"):
        while piece := source.read(PIECE_BYTES):
            yield piece


def _most_maps() -> int:
    import resource

    most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return int(OPEN_SHARE * most) if most != resource.RLIM_INFINITY else 1 << 20
