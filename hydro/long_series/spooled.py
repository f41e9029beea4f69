"""Items that are gone through several times, in a file where they take much memory."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator
from os import SEEK_END
from tempfile import SpooledTemporaryFile
from typing import Generic, TypeVar

Item = TypeVar("Item")
IN_MEMORY_BYTES = 16 << 20
"""What stays in memory: the legs of an hour at 20 Hz."""


class Spooled(Generic[Item]):
    """Items in their order, one in memory at a time once they are long together.

    One passage through them has to end before the next begins.

    >>> with Spooled(iter(["one", "two"])) as legs:
    ...     list(legs), list(legs)
    (['one', 'two'], ['one', 'two'])
    """

    def __init__(self, items: Iterable[Item] = (), *, in_memory: int = IN_MEMORY_BYTES) -> None:
        self._file = SpooledTemporaryFile(in_memory)  # noqa: SIM115 - closed by `__exit__`
        self._count = 0
        try:
            for item in items:
                self.append(item)
        except BaseException:
            self._file.close()
            raise

    def append(self, item: Item) -> None:
        """Take in one more item, as its values are now."""
        self._file.seek(0, SEEK_END)
        pickle.dump(item, self._file, protocol=5)
        self._count += 1

    def __iter__(self) -> Iterator[Item]:
        self._file.seek(0)
        for _ in range(self._count):
            yield pickle.load(self._file)

    def __enter__(self) -> Spooled[Item]:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
