"""Headers of ULog data messages in a stretch of bytes, found in bulk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from data_schemas.formats import ulog as layout

from .ulog_contents import Numbers

Ints = npt.NDArray[np.int64]
Buffer = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Block:
    """Headers of data messages that begin in `start:stop`; `breaks` are the indices of those that end where no other begins."""

    start: int
    stop: int
    offset: Ints
    end: Ints
    stream: npt.NDArray[np.int32]
    breaks: Ints


def data_headers(buffer: Buffer, words: npt.NDArray[np.uint16], numbers: Numbers, start: int, stop: int, limit: int) -> Block:
    """All headers in `start:stop` whose number and size agree with a subscription and whose message ends within the limit."""
    first = start + 2
    offset = np.flatnonzero(buffer[first : min(stop + 2, limit - 2)] == layout.DATA) + start
    size = words[offset]
    index, stream = numbers.select(words[offset + 3], size)
    offset = offset[index]
    end = offset + (size[index].astype(np.int64) + layout.MESSAGE_HEADER_BYTES)
    if offset.size and int(offset[-1]) + layout.MAX_CONTENT_BYTES + layout.MESSAGE_HEADER_BYTES > limit:
        inside = np.flatnonzero(end <= limit)
        offset, end, stream = offset[inside], end[inside], stream[inside]
    breaks = np.append(np.flatnonzero(end[:-1] != offset[1:]), offset.size - 1)
    return Block(start, stop, offset, end, stream, breaks)
