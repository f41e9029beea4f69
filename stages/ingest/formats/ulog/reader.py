"""PX4 logs (.ulg): recognise, and decode to columns with an account of every byte.

The message chain is found by `ulog_scan`, contents that are not data are judged by
`ulog_messages`, data become columns in `ulog_columns`. Instance 0 of a topic is named
`topic`, instance N `topic.N`. Columns are named as pyulog does (`field`, `field[0]`,
`nested.field`) and have pyulog's values, except that padding is left out, an array of
characters is one column of bytes, and `bool` is an unsigned byte. The column
`timestamp` is uint64, microseconds since boot.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import ulog as layout
from auvid.hydro.arrays import Ints
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog, Messages
from auvid.stages.ingest.formats.ulog.byte_account import (
    HEADER_DAMAGED,
    byte_account,
    clock_notes,
    lost_seconds,
    status_of,
)
from auvid.stages.ingest.formats.ulog.columns import read_times, unpack
from auvid.stages.ingest.formats.ulog.contents import Contents, Gap, Stream
from auvid.stages.ingest.formats.ulog.scan import Scan

FORMAT = "PX4 ULog"


class UlogReader:
    """Reader of PX4 ULog files."""

    name = "ulog"

    def recognises(self, head: bytes) -> bool:
        """True if a file begins with the magic bytes of ULog."""
        return head.startswith(layout.MAGIC)

    def read(self, file: RawFile, wanted: frozenset[str] | None = None) -> DecodedLog:
        """Decode a log held in memory or memory-mapped.

        Args:
            file: name and bytes. wanted: topics to decode, with all their instances, or
            single instances (`topic.1`); None means all. All are counted.

        Raises:
            LogError: the file is empty, or does not begin as a ULog file and holds no
            ULog message.
        """
        buffer = np.ascontiguousarray(file.buffer, np.uint8).reshape(-1)
        if buffer.size == 0:
            raise LogError(
                "the file is empty", file=file.name, remedy="Copy the log from the vehicle again."
            )
        recognised = self.recognises(buffer[: len(layout.MAGIC)].tobytes())
        contents = Scan(buffer).run()
        if not recognised and not contents.streams:
            raise LogError(
                "no ULog message can be read",
                file=file.name,
                allowed=f"a log that begins with {layout.MAGIC!r}, then formats and subscriptions",
                remedy=(
                    "Check that the file is a PX4 .ulg log and that its beginning is not cut off."
                ),
            )
        header = min(layout.HEADER_BYTES, buffer.size)
        if recognised:
            contents.definition_bytes += header
        else:
            contents.gaps.insert(0, Gap(0, header, HEADER_DAMAGED))

        offset = np.concatenate([np.empty(0, np.int64), *(part[0] for part in contents.data)])
        stream = np.concatenate([np.empty(0, np.int32), *(part[1] for part in contents.data)])
        contents.data.clear()
        words = (
            np.ndarray((max(0, buffer.size - 1),), "<u2", buffer, 0, (1,))
            if buffer.size > 1
            else np.empty(0, np.uint16)
        )
        length = words[offset].astype(np.int64) + layout.MESSAGE_HEADER_BYTES
        account = byte_account(
            buffer.size, contents.definition_bytes, contents, offset, length, stream
        )
        del length

        unread = [-1, -1]  # what the negative stream numbers point at
        time_at = np.array([item.layout.time for item in contents.streams] + unread, np.int64)
        timed = time_at[stream] >= 0
        at, by = (offset, stream) if timed.all() else (offset[timed], stream[timed])
        times = read_times(buffer, at, time_at[by])
        seconds_lost = lost_seconds(contents, buffer.size, at, times)
        header_notes = _notes(buffer[: layout.HEADER_BYTES].tobytes(), contents)
        notes = [*header_notes, *clock_notes(contents.streams, at, times, by)]
        del timed, at, by, times

        places = _by_stream(offset, stream, len(contents.streams))
        del offset, stream
        taken = [
            (item, place)
            for item, place in zip(contents.streams, places, strict=True)
            if place.size
        ]
        return DecodedLog(
            format=FORMAT,
            messages={
                item.name: Messages(
                    item.name,
                    unpack(buffer, place, topic=item.topic, formats=contents.formats),
                    place,
                )
                for item, place in taken
                if wanted is None or item.name in wanted or item.topic in wanted
            },
            counts={item.name: place.size for item, place in taken},
            account=account,
            status=status_of(account),
            seconds_lost=seconds_lost,
            parameters=contents.parameters,
            texts=tuple(contents.texts),
            notes=(*notes, *_untimed([item for item, _ in taken])),
        )


def _by_stream(
    offset: Ints, stream: np.ndarray[tuple[int], np.dtype[np.int32]], count: int
) -> list[Ints]:
    """Offsets of the records of each stream, in file order."""
    key = stream.astype(np.int16) if count < 1 << 15 else stream  # 16-bit keys are sorted by radix
    order = np.argsort(key, kind="stable")
    bounds = np.searchsorted(key, np.arange(count + 1), sorter=order)
    ordered = offset[order]
    return [ordered[start:stop] for start, stop in itertools.pairwise(bounds)]


def _untimed(streams: Sequence[Stream]) -> list[str]:
    names = [item.name for item in streams if item.layout.time < 0]
    return [f"Topics without a time stamp: {', '.join(names)}."] if names else []


def _notes(header: bytes, contents: Contents) -> list[str]:
    notes = []
    version = header[len(layout.MAGIC)] if len(header) > len(layout.MAGIC) else layout.VERSION
    if version > layout.VERSION:
        notes.append(
            f"The file says version {version} of ULog; it was read as version {layout.VERSION}."
        )
    if contents.unknown_flags:
        notes.append(
            "The file says that readers must know a feature that auvid does not know; what could be"
            " read was read all the same."
        )
    if contents.dropouts_ms:
        lost = sum(contents.dropouts_ms) * 1e-3
        notes.append(
            f"The vehicle could not keep up with writing {len(contents.dropouts_ms)} time(s),"
            f" {lost:.6g} s in all (dropouts)."
        )
    return notes


ULOG = UlogReader()
