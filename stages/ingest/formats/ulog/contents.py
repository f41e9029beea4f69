"""What a scan of a ULog file finds: streams, places of data messages, gaps with their
reasons, parameters and texts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import ulog as layout
from auvid.hydro.arrays import Ints

DAMAGED = "damaged bytes"
CUT_OFF = "message cut off by the end of the file"
CUT_BY_APPENDED = "message cut off where appended data begin"
BLANK = "zero bytes"
BLANK_END = "zero bytes at the end of the file"
NO_SUBSCRIPTION = "data without a subscription of their number"
WRONG_SIZE = "data whose size does not fit their format"
UNKNOWN_TYPE = "message of an unknown type"
UNREADABLE = "message whose content cannot be read"
TAIL_BYTES, PARTS_BACK = 4, 8
UNDEFINED_STREAM, WRONG_SIZE_STREAM = -1, -2


@dataclass(frozen=True)
class Stream:
    """One instance of one topic."""

    topic: str
    instance: int
    layout: layout.Layout

    @property
    def name(self) -> str:
        return f"{self.topic}.{self.instance}" if self.instance else self.topic


@dataclass(frozen=True)
class Gap:
    """Bytes `start:stop` that gave nothing, and why."""

    start: int
    stop: int
    reason: str


@dataclass
class Contents:
    """What a scan found. `data` are offsets and stream numbers of the data messages in
    file order, in parts; a negative stream number is a message that no subscription
    explains. `definition_bytes` and `other_bytes` are the bytes of the other messages.
    """

    formats: layout.Formats = field(default_factory=layout.Formats)
    streams: list[Stream] = field(default_factory=list)
    data: list[tuple[Ints, npt.NDArray[np.int32]]] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    definition_bytes: int = 0
    other_bytes: int = 0
    parameters: dict[str, float] = field(default_factory=dict)
    texts: list[tuple[int, str]] = field(default_factory=list)
    dropouts_ms: list[int] = field(default_factory=list)
    unknown_flags: bool = False

    def add_gap(
        self, buffer: npt.NDArray[np.uint8], start: int, stop: int, reason: str = DAMAGED
    ) -> None:
        """Account for `start:stop`, damaged unless said; zeros are named as such."""
        if start >= stop:
            return
        if reason == DAMAGED and not buffer[start:stop].any():
            reason = BLANK_END if stop == buffer.size else BLANK
        self.gaps.append(Gap(start, stop, reason))

    def drop_last(self) -> None:
        """Take the last data message away again."""
        offset, stream = self.data.pop()
        self.data.append((offset[:-1], stream[:-1]))

    def ends_as_before(self, buffer: npt.NDArray[np.uint8], last: int, stop: int) -> bool:
        """Whether the last data message, `last:stop`, ends in the same bytes as the one
        of its stream before it: so it has all of them.
        """
        for offset, stream in reversed(self.data[-PARTS_BACK:]):
            earlier = offset[(stream == self.data[-1][1][-1]) & (offset < last)]
            if earlier.size:
                end = int(earlier[-1]) + stop - last
                return bool(
                    (buffer[stop - TAIL_BYTES : stop] == buffer[end - TAIL_BYTES : end]).all()
                )
        return False


class Numbers:
    """Which stream a data message belongs to, by its number and size.

    Table 0 holds what is subscribed, 1 the size with padding or what was subscribed
    before, 2 what was met without explanation.
    """

    def __init__(self) -> None:
        self.size = [np.zeros(1 << 16, np.int32) for _ in range(3)]
        self.stream = [np.full(1 << 16, UNDEFINED_STREAM, np.int32) for _ in range(3)]
        self.sizes_met: set[int] = set()
        self.version = 0

    def put(self, table: int, id: int, size: int, stream: int) -> None:
        self.size[table][id] = size
        self.stream[table][id] = stream
        self.sizes_met.add(size)
        self.version += 1

    def known(self, id: int) -> bool:
        return bool(self.size[0][id])

    def subscribe(self, id: int, stream: int, sizes: layout.Layout) -> None:
        """Put a stream in force. What it replaces, if that has another size, stays
        readable: one of the two may be damaged.
        """
        written, padded = sizes.written + 2, sizes.padded + 2
        before, other = int(self.size[0][id]), int(self.stream[0][id])
        if before not in (0, written):
            self.put(1, id, before, other)
        elif padded != written:
            self.put(1, id, padded, stream)
        self.put(0, id, written, stream)

    def sizes(self, id: int) -> list[int]:
        """The sizes that data with this number have had, the subscribed one first."""
        return [int(table[id]) for table in self.size if table[id]]

    def match(self, id: int, size: int) -> int | None:
        for sizes, streams in zip(self.size, self.stream, strict=True):
            if sizes[id] == size:
                return int(streams[id])
        return None

    def select(
        self, id: npt.NDArray[np.uint16], size: npt.NDArray[np.uint16]
    ) -> tuple[Ints, npt.NDArray[np.int32]]:
        """Indices of the pairs that match, ascending, and their streams."""
        stream = self.stream[0][id]
        hit = self.size[0][id] == size
        rest = np.flatnonzero(~hit)
        for table in (1, 2):
            found = rest[self.size[table][id[rest]] == size[rest]]
            found = found[~hit[found]]
            hit[found] = True
            stream[found] = self.stream[table][id[found]]
        index = np.flatnonzero(hit)
        return index, stream[index]
