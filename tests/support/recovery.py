"""Judge what a reader makes of a damaged log: what it must give back, what it must not,
and that every byte is explained.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.errors import PipelineError
from auvid.stages.ingest.decoded_log import DecodedLog, Messages
from auvid.stages.ingest.formats.tlog.byte_account import explain
from auvid.stages.ingest.formats.tlog.frames import Frames
from tests.support.mutate import Kept
from tests.support.small_logs import Ints, SmallLog, line_ends

SLOW_S = 2.0
Mask = npt.NDArray[np.bool_]


@dataclass
class Judgement:
    """Of one damaged log: `expected` records whose bytes and definition are whole,
    those `lost`, records `invented`, and the faults.

    `refused` is the clear error with which the reader declined, if it did; it may do so
    only where nothing whole is left, or for a CSV file whose cells are no numbers.
    """

    expected: int = 0
    lost: int = 0
    invented: int = 0
    refused: str = ""
    faults: list[str] = field(default_factory=list)


def judge(source: SmallLog, damaged: bytes, kept: Sequence[Kept]) -> Judgement:
    """Read the damaged form of `source`, of which the ranges `kept` are unchanged, and
    hold the result against the whole log.
    """
    result = Judgement()
    ranges = _Ranges(kept)
    intact, moved = _intact(source, ranges)
    result.expected = int(intact.sum())
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            source.reader.recognises(damaged)
            log = source.read(damaged)
    except PipelineError as fault:
        result.refused = str(fault)
        if result.expected and source.name != "csv":
            result.faults.append(f"refused with {result.expected} whole records: {fault}")
            result.lost = result.expected
        return result
    except Exception as crash:
        result.faults.append(f"crash: {type(crash).__name__}: {crash}")
        result.lost = result.expected
        return result
    seconds = time.process_time() - begin
    if seconds > SLOW_S:
        result.faults.append(f"slow: {seconds:.1f} s")
    result.faults += _account_faults(log, len(damaged))
    frames = explain(np.frombuffer(damaged, np.uint8)).records if source.name == "tlog" else None
    offsets_by_type = (
        {name: _offsets(table, source, damaged) for name, table in log.messages.items()}
        if frames is None
        else {"frame": frames.start.astype(np.int64)}
    )
    result.lost = result.expected - _count_recovered(source, offsets_by_type, intact, moved)
    result.invented = (
        _invented(source, ranges, offsets_by_type)
        if frames is None
        else _invented_frames(source, damaged, frames)
    )
    result.faults += _wrong_values(source, log, damaged, intact, moved)
    return result


class _Ranges:
    """Kept ranges as arrays."""

    def __init__(self, kept: Sequence[Kept]) -> None:
        columns = np.array([tuple(part) for part in kept], np.int64).reshape(-1, 3).T
        self.start, self.stop, self.offset = columns

    def intact(self, start: Ints, stop: Ints) -> tuple[Mask, Ints]:
        """Which ranges of the source are whole in the damaged log, and by how much they
        moved.
        """
        if not self.start.size:
            return np.zeros(start.shape, np.bool_), np.zeros(start.shape, np.int64)
        part = np.maximum(np.searchsorted(self.start, start, side="right") - 1, 0)
        return (self.start[part] <= start) & (stop <= self.stop[part]), self.offset[
            part
        ] - self.start[part]

    def origin(self, offset: Ints) -> tuple[Ints, Ints]:
        """Where bytes of the damaged log come from, and where that range ends in the
        source; -1 for new bytes.
        """
        if not self.start.size:
            return np.full(offset.shape, -1), np.full(offset.shape, -1)
        part = np.maximum(np.searchsorted(self.offset, offset, side="right") - 1, 0)
        source = offset - self.offset[part] + self.start[part]
        inside = (source >= self.start[part]) & (source < self.stop[part])
        return np.where(inside, source, -1), np.where(inside, self.stop[part], -1)


def _intact(source: SmallLog, ranges: _Ranges) -> tuple[Mask, Ints]:
    """Which records are whole with all that defines them, and where they are now."""
    places = source.places
    # A range that begins one byte before the file (the line feed of the first line) has
    # no such byte to lose.
    intact, shift = ranges.intact(np.maximum(places.start, 0), places.stop)
    defined = np.array(
        [ranges.intact(np.maximum(spans[:, 0], 0), spans[:, 1])[0].all() for spans in places.needs],
        np.bool_,
    )
    return intact & defined[places.type], places.first + shift


def _offsets(table: Messages, source: SmallLog, damaged: bytes) -> Ints:
    """Byte offsets of the records; those of a CSV are rows."""
    if source.name != "csv":
        return table.offset
    return np.concatenate([[0], line_ends(damaged)])[table.offset - 1]


def _account_faults(log: DecodedLog, size: int) -> list[str]:
    account, faults = log.account, []
    if (
        account.record_bytes + account.definition_bytes + account.skipped_bytes != size
        or account.size != size
    ):
        faults.append(f"account: {account} does not add up to {size}")
    if (
        any(part.bytes < 0 or part.count < 1 for part in account.skipped)
        or min(account.record_bytes, account.definition_bytes) < 0
    ):
        faults.append(f"account: {account}")
    for name, table in log.messages.items():
        if any(len(column) != len(table) for column in table.columns.values()):
            faults.append(f"columns of {name} differ in length")
    if not 0.0 <= log.seconds_lost < np.inf:
        faults.append(f"seconds lost: {log.seconds_lost}")
    return faults


def _count_recovered(
    source: SmallLog, offsets_by_type: dict[str, Ints], intact: Mask, moved: Ints
) -> int:
    """Whole records that were read as what they are."""
    count = 0
    for index, name in enumerate(source.places.types):
        if name in offsets_by_type:
            intact_moved = moved[intact & (source.places.type == index)]
            count += int(_among(intact_moved, offsets_by_type[name]).sum())
    return count


def _invented_frames(source: SmallLog, damaged: bytes, frames: Frames) -> int:
    """Frames with a checksum whose content the source does not have."""
    starts, stops = source.places.start.tolist(), source.places.stop.tolist()
    pieces = {source.data[a + 8 : b] for a, b in zip(starts, stops, strict=True)}
    return sum(
        damaged[a + 8 : b] not in pieces
        for a, b in zip(frames.start.tolist(), frames.stop.tolist(), strict=True)
    )


def _invented(source: SmallLog, ranges: _Ranges, offsets_by_type: dict[str, Ints]) -> int:
    """Records where the source has none: those that begin in kept bytes but at no
    record of the source. What begins in repeated or spliced bytes may be a true copy.
    """
    count = 0
    before = int((source.places.first - source.places.start).max())
    for offset in offsets_by_type.values():
        origin, end = ranges.origin(offset)
        # A line behind a line feed that is not of the source is the rest of a damaged
        # one.
        own = (
            (origin >= 0)
            & (origin + source.header <= end)
            & ((origin == 0) | (ranges.origin(offset - before)[0] == origin - before))
        )
        count += int((own & ~_among(origin, source.places.first)).sum())
    return count


def _wrong_values(
    source: SmallLog, log: DecodedLog, damaged: bytes, intact: Mask, moved: Ints
) -> list[str]:
    """Types of which a whole record does not have the values of the source."""
    faults = []
    for name, table in log.messages.items():
        clean = source.log.messages.get(name)
        if clean is None:
            continue
        if source.name == "tlog":
            member = np.searchsorted(source.places.first, clean.offset)
        else:
            member = np.flatnonzero(source.places.type == source.places.types.index(name))
        rows = np.flatnonzero(intact[member])
        offset = _offsets(table, source, damaged)
        if not rows.size or not offset.size:
            continue
        at = np.minimum(np.searchsorted(offset, moved[member[rows]]), offset.size - 1)
        there = offset[at] == moved[member[rows]]
        rows, at = rows[there], at[there]
        for key, column in clean.columns.items():
            if key not in table.columns and _has_earlier_rival(source, name, damaged):
                continue
            if key not in table.columns or not _equal(column[rows], table.columns[key][at]):
                faults.append(f"values of {name}.{key}")
                break
    return faults


def _has_earlier_rival(source: SmallLog, name: str, damaged: bytes) -> bool:
    """Whether damage has put a copy of the definition of a type, with other field
    names, before it: nothing tells which is true.
    """
    spans = (
        source.places.needs[source.places.types.index(name)]
        if name in source.places.types
        else np.empty((0, 2), np.int64)
    )
    if source.name not in ("dataflash", "dataflash_text") or not len(spans):
        return False
    intact = source.data[int(spans[0, 0]) : int(spans[0, 1])]
    head = intact[:25] if source.name == "dataflash" else intact[: intact.index(b"TimeUS")]
    return 0 <= damaged.find(head) < damaged.find(intact)


def _among(values: Ints, others: Ints) -> Mask:
    """Return which values are among others, as `np.isin`, which takes longer for few."""
    if not others.size:
        return np.zeros(values.shape, np.bool_)
    ascending = np.sort(others)
    at = np.minimum(np.searchsorted(ascending, values), ascending.size - 1)
    present: Mask = ascending[at] == values
    return present


def _equal(first: npt.NDArray[np.generic], second: npt.NDArray[np.generic]) -> bool:
    if first.dtype == second.dtype and first.dtype.kind != "O":
        return first.tobytes() == second.tobytes()
    return bool(np.array_equal(first, second, equal_nan=first.dtype.kind == "f"))
