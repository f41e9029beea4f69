"""Headers of ULog data messages in a stretch of bytes, found in bulk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import ulog as layout
from auvid.hydro.arrays import Buffer, Ints
from auvid.stages.ingest.formats.ulog.contents import Numbers
from auvid.stages.ingest.formats.ulog.messages import Subscription


@dataclass(frozen=True)
class Block:
    """Headers of data messages that begin in `start:stop`; `breaks` are the indices of
    those that end where no other begins.
    """

    start: int
    stop: int
    offset: Ints
    end: Ints
    stream: npt.NDArray[np.int32]
    breaks: Ints

    def is_filled(self, index: int) -> bool:
        """Whether two or more of the messages stand one behind the other inside message
        `index`, up to its end.
        """
        inner = index + 1
        end, size = int(self.end[index]), self.offset.size
        while inner < size and int(self.end[inner]) < end:
            behind = int(self.offset.searchsorted(self.end[inner]))
            if behind == size or self.offset[behind] != self.end[inner]:
                return False
            inner = behind
        return inner > index + 1 and inner < size and int(self.end[inner]) == end


def data_headers(
    buffer: Buffer,
    words: npt.NDArray[np.uint16],
    numbers: Numbers,
    start: int,
    stop: int,
    limit: int,
) -> Block:
    """All headers in `start:stop` whose number and size agree with a subscription and
    whose message ends within the limit.
    """
    first = start + 2
    offset = np.flatnonzero(buffer[first : min(stop + 2, limit - 2)] == layout.DATA) + start
    size = words[offset]
    index, stream = numbers.select(words[offset + 3], size)
    offset = offset[index]
    end = offset + (size[index].astype(np.int64) + layout.MESSAGE_HEADER_BYTES)
    if (
        offset.size
        and int(offset[-1]) + layout.MAX_CONTENT_BYTES + layout.MESSAGE_HEADER_BYTES > limit
    ):
        inside = np.flatnonzero(end <= limit)
        offset, end, stream = offset[inside], end[inside], stream[inside]
    breaks = np.append(np.flatnonzero(end[:-1] != offset[1:]), offset.size - 1)
    return Block(start, stop, offset, end, stream, breaks)


def choose_format(
    buffer: npt.NDArray[np.uint8],
    words: npt.NDArray[np.uint16],
    formats: layout.Formats,
    found: Subscription,
) -> None:
    """Of several formats of a topic, put the one in force of whose size most data
    messages of its number are.

    Args:
        buffer, words: the file, and the two bytes at each place of it.
        formats: with rivals of the topic.
        found: the subscription that gives the topic its number.
    """
    last = words.size - (layout.DATA_HEADER_BYTES - 2)
    place = np.flatnonzero(buffer[2 : last + 2] == layout.DATA)
    sizes = np.bincount(
        words[place[words[place + layout.MESSAGE_HEADER_BYTES] == found.id]], minlength=1 << 16
    )
    most, best = -1, formats.by_name[found.topic]
    for declared in (best, *formats.rivals.pop(found.topic)):
        formats.replace(declared)
        known = formats.layout(found.topic)
        votes = (
            -1
            if known is None
            else sum(int(sizes[size + 2]) for size in {known.written, known.padded})
        )
        if votes > most:
            most, best = votes, declared
    formats.replace(best)
