"""PX4 logs (.ulg): recognise, and decode to columns with an account of every byte.

The message chain is found by `scan`; `messages` judges contents that are not data.
Instance 0 of a topic is named `topic`, instance N `topic.N`. Columns are named as
pyulog does (`field`, `field[0]`, `nested.field`) and have pyulog's values, except that
padding is left out, an array of characters is one column of bytes, and `bool` is an
unsigned byte. The column `timestamp` is uint64, microseconds since boot.
"""

from __future__ import annotations

import numpy as np

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import ulog as layout
from auvid.hydro.arrays import Buffer, Ints
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import ByteAccount, Column, DecodedLog, LogReader, Messages
from auvid.stages.ingest.formats.accounting import (
    GATHER_BYTES,
    Losses,
    covered_seconds,
    cut_at_nul,
    overlapping,
    split_by,
    status_of,
)
from auvid.stages.ingest.formats.ulog.scan import Scan
from auvid.stages.ingest.formats.ulog.skipped_bytes import (
    BLANK_END,
    CUT_OFF,
    HARMLESS,
    HEADER_DAMAGED,
    NO_SUBSCRIPTION,
    WRONG_SIZE,
    SkippedBytes,
)
from auvid.stages.ingest.formats.ulog.subscribed_data import (
    UNDEFINED_STREAM,
    WRONG_SIZE_STREAM,
    StreamNumbers,
)

FORMAT = "PX4 ULog"
NEIGHBOURS = 64
STRAY_US = 60_000_000
BACK_US = 1_000_000


def recognises(head: bytes) -> bool:
    """Return whether a file begins with the magic bytes of ULog."""
    return head.startswith(layout.MAGIC)


def decode_ulog(file: RawFile, message_types: frozenset[str] | None) -> DecodedLog:
    """Decode the topics `message_types` with all their instances, or single instances.

    Raises:
        LogError: the file does not begin as a ULog file and holds no ULog message.
    """
    buffer = file.buffer
    head = buffer[: layout.HEADER_BYTES].tobytes()
    scan = Scan(buffer).run()
    if recognises(head):
        scan.definition_bytes += len(head)
    elif scan.streams:
        scan.gaps.insert(0, SkippedBytes(0, len(head), HEADER_DAMAGED))
    else:
        raise LogError(
            "no ULog message can be read",
            file=file.name,
            allowed=f"a log that begins with {layout.MAGIC!r}, then formats and subscriptions",
            remedy="Check that the file is a PX4 .ulg log and that its beginning is not cut off.",
        )
    offset = np.concatenate([np.empty(0, np.int64), *(part for part, _ in scan.data)])
    stream = np.concatenate([np.empty(0, np.int32), *(part for _, part in scan.data)])
    scan.data.clear()
    account = _byte_account(scan, offset, stream)

    unread = [-1, -1]  # what the negative stream numbers point at
    time_at = np.array([item.layout.time for item in scan.streams] + unread, np.int64)
    timed = time_at[stream] >= 0
    at, by = (offset, stream) if timed.all() else (offset[timed], stream[timed])
    times = overlapping(buffer, "<u8")[at + time_at[by] + layout.DATA_HEADER_BYTES]
    times = times.astype(np.int64)
    damaged = [gap for gap in scan.gaps if gap.reason not in HARMLESS and gap.stop < buffer.size]
    seconds_lost = covered_seconds(at, times, sorted(gap.start for gap in damaged))
    notes = _notes(head, scan) + _clock_notes(scan, at, times, by)
    del timed, at, by, times

    places = [offset[rows] for rows in split_by(stream, len(scan.streams))]
    del offset, stream
    streams = [pair for pair in zip(scan.streams, places, strict=True) if pair[1].size]
    untimed = [item.name for item, _ in streams if item.layout.time < 0]
    if untimed:
        notes.append(f"Topics without a time stamp: {', '.join(untimed)}.")
    return DecodedLog(
        format=FORMAT,
        messages={
            item.name: Messages(item.name, _unpack(buffer, place, item.topic, scan.formats), place)
            for item, place in streams
            if message_types is None or item.name in message_types or item.topic in message_types
        },
        counts={item.name: place.size for item, place in streams},
        account=account,
        status=status_of(account.skipped, at_end=(CUT_OFF, BLANK_END), harmless=HARMLESS),
        seconds_lost=seconds_lost,
        parameters=scan.parameters,
        texts=tuple(scan.texts),
        notes=tuple(notes),
    )


def _byte_account(scan: Scan, offset: Ints, stream: StreamNumbers) -> ByteAccount:
    """Put every byte into records, definitions or skipped."""
    length = scan.words[offset].astype(np.int64) + layout.MESSAGE_HEADER_BYTES
    losses = Losses()
    for code, reason in ((UNDEFINED_STREAM, NO_SUBSCRIPTION), (WRONG_SIZE_STREAM, WRONG_SIZE)):
        where = np.flatnonzero(stream == code)
        losses.add(reason, offset[where], length[where])
    for gap in scan.gaps:
        losses.add(gap.reason, gap.start, gap.stop - gap.start)
    records = int(length[stream >= 0].sum()) + scan.other_bytes
    return ByteAccount(scan.size, records, scan.definition_bytes, losses.skipped())


def _unpack(buffer: Buffer, offset: Ints, topic: str, formats: layout.Formats) -> dict[str, Column]:
    """Return one column per basic field of the data messages at `offset`.

    Each message must lie in the file with its whole payload. Fields stand in the order
    of declaration.
    """
    fields = list(formats.columns(topic))
    columns: dict[str, Column] = {name: np.empty(offset.size, dtype) for name, dtype, _ in fields}
    sizes = formats.layout(topic)
    if sizes is None or not fields or not offset.size:
        return columns
    row = np.dtype(
        {
            "names": list(columns),
            "formats": [dtype for _, dtype, _ in fields],
            "offsets": [place for _, _, place in fields],
            "itemsize": sizes.written,
        }
    )
    payloads = overlapping(buffer, f"V{sizes.written}")
    step = max(1, GATHER_BYTES // sizes.written)
    for start in range(0, offset.size, step):
        rows = payloads[offset[start : start + step] + layout.DATA_HEADER_BYTES].view(row)
        for name, column in columns.items():
            column[start : start + step] = rows[name]
    for column in columns.values():
        if column.dtype.kind == "S":
            cut_at_nul(column)
    return columns


def _notes(head: bytes, scan: Scan) -> list[str]:
    notes = []
    version = (head[len(layout.MAGIC) :] or bytes([layout.VERSION]))[0]
    if version > layout.VERSION:
        notes.append(
            f"The file says version {version} of ULog; it was read as version {layout.VERSION}."
        )
    if scan.unknown_flags:
        notes.append(
            "The file declares a feature that auvid does not know and that readers must know;"
            " whatever could be read was read all the same."
        )
    for number, (one, other) in scan.shared.items():
        notes.append(
            f"{scan.streams[one].name} and {scan.streams[other].name} are subscribed with one"
            f" number, {number}: one of the two subscriptions is damaged, and records of it may be"
            " of either."
        )
    if scan.dropouts_ms:
        notes.append(
            f"The vehicle could not keep up with writing {len(scan.dropouts_ms)} time(s),"
            f" {sum(scan.dropouts_ms) * 1e-3:.6g} s in all (dropouts)."
        )
    return notes


def _clock_notes(scan: Scan, offset: Ints, times_us: Ints, stream: StreamNumbers) -> list[str]:
    """Return sentences about stray time stamps and a clock that goes back.

    A time stamp strays if it is more than a minute ahead of the median of the records
    around it. Old ones are usual: a topic that is published rarely is written once with
    the time of its last publication.
    """
    count = times_us.size // NEIGHBOURS
    if count == 0:
        return []
    groups_us = times_us[: count * NEIGHBOURS].reshape(count, NEIGHBOURS)
    median = np.partition(groups_us, NEIGHBOURS // 2, axis=1)[:, NEIGHBOURS // 2]
    around = np.maximum(median, np.append(median[1:], 0))
    rest = groups_us.size + np.flatnonzero(times_us[groups_us.size :] > median[-1] + STRAY_US)
    stray = np.append(np.flatnonzero(groups_us > around[:, None] + STRAY_US), rest)
    notes = []
    for number in np.unique(stream[stray]).tolist():
        these = stray[stream[stray] == number]
        worst = these[np.argmax(times_us[these])]
        clock_s = median[min(worst // NEIGHBOURS, count - 1)] * 1e-6
        notes.append(
            f"{these.size} time stamp(s) of {scan.streams[number].name} stray ahead of the clock,"
            f" up to {times_us[worst] * 1e-6:.6g} s at byte {offset[worst]} where the clock shows"
            f" {clock_s:.6g} s."
        )
    back = np.flatnonzero(np.diff(median) < -BACK_US)
    if back.size:
        at = int(back[0])
        step_s = (median[at] - median[at + 1]) * 1e-6
        place = offset[(at + 1) * NEIGHBOURS]
        notes.append(
            f"The clock goes back by {step_s:.6g} s near byte {place}; it does so {back.size}"
            " time(s) in all."
        )
    return notes


ULOG = LogReader("ulog", recognises, decode_ulog)
