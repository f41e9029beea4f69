"""Long arrays in files without a name, which go with the process however it ends."""

from __future__ import annotations

import mmap
import os
import tempfile
from pathlib import Path
from typing import Any, BinaryIO
from weakref import WeakSet

import numpy as np
import numpy.typing as npt

from auvid.pipeline.store.atomic_files import TEMPORARY, writable

PIECE_BYTES = 1 << 22


class ArrayFile:
    """Arrays of one task, in the folder of its results.

    An array has a file of its own, which is mapped and goes when nobody holds the array.
    It is written before it is mapped, so that a full disk is a fault and no signal.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._maps: WeakSet[mmap.mmap] = WeakSet()

    def lay_down(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the values as they lie in a file, read-only."""
        pieces = np.ascontiguousarray(values).reshape(-1).view(np.uint8)
        with self._opened() as file:
            for start in range(0, pieces.size, PIECE_BYTES):
                file.write(pieces[start : start + PIECE_BYTES].data)
            return self._mapped(file).view(values.dtype).reshape(values.shape)

    def copied(self, path: str) -> npt.NDArray[np.uint8]:
        """Return the bytes of another file, which nobody can cut short now."""
        with open(path, "rb") as source, self._opened() as file:
            while piece := source.read(PIECE_BYTES):
                file.write(piece)
            return self._mapped(file)

    def let_go(self) -> None:
        """Take what was read of the arrays out of memory."""
        for mapped in list(self._maps):
            mapped.madvise(mmap.MADV_DONTNEED)

    def _opened(self) -> BinaryIO:
        with writable(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
            return tempfile.TemporaryFile(
                prefix=".array.", suffix=f".{os.getpid()}{TEMPORARY}", dir=self._folder
            )

    def _mapped(self, file: BinaryIO) -> npt.NDArray[np.uint8]:
        with writable(self._folder):
            file.flush()
            mapped = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)
        self._maps.add(mapped)
        return np.ndarray(len(mapped), np.uint8, mapped)
