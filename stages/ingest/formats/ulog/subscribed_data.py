"""Which data messages of a ULog file belong to which stream, by number and size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import ulog as layout
from auvid.hydro.arrays import Ints

UNDEFINED_STREAM, WRONG_SIZE_STREAM = -1, -2
Words = npt.NDArray[np.uint16]
StreamNumbers = npt.NDArray[np.int32]


@dataclass(frozen=True)
class TopicInstance:
    """One instance of one topic."""

    topic: str
    instance: int
    layout: layout.RecordSizes

    @property
    def name(self) -> str:
        return f"{self.topic}.{self.instance}" if self.instance else self.topic


class Numbers:
    """Stream of a data message by its number and size.

    Table 0 holds what is subscribed, 1 the size with padding or what was subscribed
    before, 2 what was met without explanation.
    """

    def __init__(self) -> None:
        self.size = np.zeros((3, 1 << 16), np.int32)
        self.stream = np.full((3, 1 << 16), UNDEFINED_STREAM, np.int32)
        self.sizes_met: set[int] = set()
        self.version = 0
        self.shared: dict[int, tuple[int, int]] = {}
        self._places: dict[int, int] = {}
        self._free: set[int] = set()

    def put(self, table: int, id: int, size: int, stream: int) -> None:
        """Set what one table holds for a number."""
        self.size[table, id], self.stream[table, id] = size, stream
        self.sizes_met.add(size)
        self.version += 1

    def is_subscribed(self, id: int) -> bool:
        """Return whether the number is subscribed."""
        return bool(self.size[0, id])

    def free(self, id: int) -> None:
        """Let another stream have a number; data of the one before stay readable."""
        self._free.add(id)

    def subscribe(self, id: int, stream: int, sizes: layout.RecordSizes) -> None:
        """Put a stream in force.

        What it replaces, if that has another size, stays readable: one of the two may
        be damaged. If both have one size, the number itself of one of them is: writers
        count subscriptions, so the one stands that has the number of its place. `shared`
        holds such numbers with the streams that have them.
        """
        written, padded = sizes.written + 2, sizes.padded + 2
        before, other = int(self.size[0, id]), int(self.stream[0, id])
        place = self._places.setdefault(stream, len(self._places))
        free = id in self._free
        self._free.discard(id)
        if before == written and other != stream and not free:
            self.shared[id] = (other, stream)
            if self._places.get(other) == id != place:
                return
        if before not in (0, written):
            self.put(1, id, before, other)
        elif padded != written:
            self.put(1, id, padded, stream)
        self.put(0, id, written, stream)

    def sizes(self, id: int) -> list[int]:
        """Return the sizes that data of this number have had, the subscribed first."""
        return [size for size in self.size[:, id].tolist() if size]

    def match(self, id: int, size: int) -> int | None:
        """Return the stream of one data message; None if no table explains it."""
        for table in range(3):
            if self.size[table, id] == size:
                return int(self.stream[table, id])
        return None

    def select(self, id: Words, size: Words) -> tuple[Ints, StreamNumbers]:
        """Return the indices of the pairs that match, ascending, and their streams."""
        stream = self.stream[0][id]
        hit = self.size[0][id] == size
        rest = np.flatnonzero(~hit)
        for table in (1, 2):
            matching = rest[self.size[table][id[rest]] == size[rest]]
            matching = matching[~hit[matching]]
            hit[matching] = True
            stream[matching] = self.stream[table][id[matching]]
        index = np.flatnonzero(hit)
        return index, stream[index]


@dataclass(frozen=True)
class Block:
    """Headers of data messages that begin in `start:stop`.

    `breaks` are the indices of those that end where no other begins.
    """

    start: int
    stop: int
    offset: Ints
    end: Ints
    stream: StreamNumbers
    breaks: Ints

    def is_filled(self, index: int) -> bool:
        """Return whether whole messages stand inside message `index`, up to its end."""
        inner = index + 1
        end, size = int(self.end[index]), self.offset.size
        while inner < size and int(self.end[inner]) < end:
            behind = int(self.offset.searchsorted(self.end[inner]))
            if behind == size or self.offset[behind] != self.end[inner]:
                return False
            inner = behind
        return inner > index + 1 and inner < size and int(self.end[inner]) == end


def put_fitting_format(formats: layout.Formats, topic: str, sizes: Ints) -> None:
    """Put that one of several formats of a topic in force whose size fits most data.

    sizes (k,): number of data messages by size.
    """
    most, best = -1, formats.by_name[topic]
    for declared in (best, *formats.rivals.pop(topic)):
        formats.replace(declared)
        topic_layout = formats.layout(topic)
        tried = set() if topic_layout is None else {topic_layout.written, topic_layout.padded}
        votes = sum(int(sizes[size + 2]) for size in tried) if tried else -1
        if votes > most:
            most, best = votes, declared
    formats.replace(best)
