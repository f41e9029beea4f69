"""Find the chain of records in a DataFlash log: vectorised over header candidates, step by step only where the chain breaks.

A candidate is any place with the two magic bytes. The chain goes from a record to the candidate at its end; a log has no other
framing and no checksum. Behind a break the chain goes on at the next candidate that is itself followed by a header (or by the end of
the file); between the two, single records are taken only if their own time stamp fits the clock on both sides.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from data_schemas.formats import dataflash as layout

from .dataflash_definitions import Definitions

BLOCK = 1 << 17
TIME_SLACK_US = 1_000_000
LATEST_US = 1 << 62
UNKNOWN_SHARE = 0.6  # share of equal gaps from which the length of an undefined type is inferred
UNKNOWN_LEAST = 4

Buffer = npt.NDArray[np.uint8]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Gap:
    """Bytes `start:stop` outside the chain. `id` is the type of the undefined message found at `start`, -1 for damage."""

    start: int
    stop: int
    id: int = -1


@dataclass(frozen=True)
class Chain:
    """Records by position: `offset`, `type` and `entry` (into Definitions; -1: undefined type of inferred `length`), in file order."""

    offset: Ints
    type: npt.NDArray[np.uint8]
    entry: npt.NDArray[np.int32]
    length: npt.NDArray[np.int32]
    gaps: list[Gap]
    failed: npt.NDArray[np.int32]  # entries of the records at whose end no header was found


def candidates(buffer: Buffer) -> Ints:
    """Offsets of all magic byte pairs that have room for a type id behind them, ascending."""
    found = []
    first, second = layout.MAGIC
    for start in range(0, buffer.size, BLOCK):
        part = buffer[start : start + BLOCK + 1]
        found.append(np.flatnonzero((part[:-1] == first) & (part[1:] == second)) + start)
    offsets = np.concatenate(found) if found else np.zeros(0, np.int64)
    return offsets[: np.searchsorted(offsets, buffer.size - 2)]


def header_at(buffer: Buffer, offset: Ints) -> npt.NDArray[np.bool_]:
    """True where the magic bytes stand at `offset`; offsets past the end of the file give False."""
    inside = np.minimum(offset, buffer.size - 2)
    there: npt.NDArray[np.bool_] = (buffer[inside] == layout.MAGIC[0]) & (buffer[inside + 1] == layout.MAGIC[1]) & (inside == offset)
    return there


def infer_lengths(offset: Ints, types: npt.NDArray[np.uint8], entry: npt.NDArray[np.int32], length: npt.NDArray[np.int32]) -> None:
    """Give the records of undefined types, in `length`, the distance at which the next header nearly always stands."""
    where = np.flatnonzero(entry[:-1] < 0)
    if where.size < UNKNOWN_LEAST:
        return
    gap = offset[where + 1] - offset[where]
    fits = (gap >= layout.HEADER_BYTES) & (gap <= layout.MAX_RECORD_BYTES)
    id = types[where].astype(np.int64)
    votes = np.bincount(id[fits] * 256 + gap[fits], minlength=65536).reshape(256, 256)
    best, most, total = votes.argmax(axis=1), votes.max(axis=1), np.bincount(id, minlength=256)
    believed = np.where((most >= UNKNOWN_LEAST) & (most >= UNKNOWN_SHARE * total), best, 0).astype(np.int32)
    unknown = np.flatnonzero(entry < 0)
    length[unknown] = believed[types[unknown]]


class Walk:
    """One walk along the chain. Arrays have one entry per candidate.

    `clock` is the kind of time stamp (see `read_times`) of each definition, and a last 0 which serves entry -1, the undefined types.
    """

    def __init__(self, buffer: Buffer, offset: Ints, definitions: Definitions, clock: npt.NDArray[np.int8]) -> None:
        self.buffer, self.offset, self.definitions, self.clock = buffer, offset, definitions, clock
        self.size = buffer.size
        self.type = buffer[offset + 2]
        self.entry = definitions.entries(offset, self.type)
        length = definitions.length[self.entry]
        length[self.entry < 0] = 0
        infer_lengths(offset, self.type, self.entry, length)
        self.length = length
        self.end = offset + length
        self.valid = (length > 0) & (self.end <= self.size)

    @cached_property
    def confirmed(self) -> Ints:
        """Candidates of a known length with a header, or the end of the file, right behind them."""
        return np.flatnonzero(self.valid & (header_at(self.buffer, self.end) | (self.end == self.size)))

    @cached_property
    def pair(self) -> npt.NDArray[np.uint16]:
        """The types of each candidate and the next, as one number."""
        return (self.type[:-1].astype(np.uint16) << 8 | self.type[1:]).astype(np.uint16)

    @cached_property
    def pairs(self) -> Ints:
        """How often each pair of types occurs."""
        return np.bincount(self.pair, minlength=1 << 16)

    def next_confirmed(self, index: int) -> int:
        """The first confirmed candidate at or behind candidate `index`; the number of candidates if there is none."""
        place = int(np.searchsorted(self.confirmed, index))
        return int(self.confirmed[place]) if place < self.confirmed.size else self.offset.size

    def times_us(self, index: Ints) -> Ints:
        """The time stamps of the records at the candidates; -1 where their type has none."""
        return read_times(self.buffer, self.offset[index], self.clock[self.entry[index]])

    def near_us(self, index: int, step: int) -> int | None:
        """The median of the first five times found in direction `step`, within sixteen candidates."""
        around = np.arange(index, index + 16 * step, step)
        around = around[(around >= 0) & (around < self.offset.size)]
        times = self.times_us(around[self.valid[around]])
        times = np.sort(times[times >= 0][:5])
        return int(times[times.size // 2]) if times.size else None

    def in_time(self, index: Ints, before: int, after: int) -> Ints:
        """Those of the candidates whose time lies between the clocks at candidates `before` and `after` (either may be outside)."""
        if index.size == 0:
            return index
        early, late = self.near_us(before, -1), self.near_us(after, 1)
        if early is None and late is None:
            return index[:0]
        low = (late if early is None else early) - TIME_SLACK_US * (10 if early is None else 1)  # type: ignore[operator]
        high = (early if late is None else late) + TIME_SLACK_US * (10 if late is None else 1)  # type: ignore[operator]
        times = self.times_us(index)
        return index[(times >= max(low, 0)) & (times <= high)]

    def run(self) -> Chain:
        count = self.offset.size
        linked = np.zeros(count, np.bool_)
        linked[:-1] = (self.end[:-1] == self.offset[1:]) & self.valid[:-1] & self.valid[1:]
        breaks = np.flatnonzero(~linked).tolist()
        runs: list[tuple[int, int]] = []
        gaps: list[Gap] = []
        failed: list[int] = []
        at, behind = self._begin(runs, gaps)
        while at < count:
            behind = bisect_left(breaks, at, behind)
            last = breaks[behind]
            at = self._across(at, last, runs, gaps, failed)
        taken = np.zeros(count + 1, np.int8)
        for start, stop in runs:
            taken[start] += 1
            taken[stop] -= 1
        kept = np.cumsum(taken[:-1], dtype=np.int8).view(np.bool_)
        missed = self.entry[np.array(failed, np.int64)]
        return Chain(self.offset[kept], self.type[kept], self.entry[kept], self.length[kept], gaps, missed)

    def _begin(self, runs: list[tuple[int, int]], gaps: list[Gap]) -> tuple[int, int]:
        if self.offset.size and self.offset[0] == 0 and self.valid[0]:
            return 0, 0
        first = self.next_confirmed(0)
        self._fill(0, self._place(first), -1, first, runs, gaps)
        return first, 0

    def _place(self, index: int) -> int:
        return int(self.offset[index]) if index < self.offset.size else self.size

    def _across(self, at: int, last: int, runs: list[tuple[int, int]], gaps: list[Gap], failed: list[int]) -> int:
        """Take the run `at..last` and return where the chain goes on behind it (the number of candidates at the end)."""
        offset, end = self.offset, int(self.end[last])
        following = last + 1
        if following < offset.size and offset[following] < end:
            following += int(np.searchsorted(offset[following : following + layout.MAX_RECORD_BYTES], end))
        meets = following < offset.size and offset[following] == end
        if end == self.size or (meets and self.valid[following]):
            inner = self._inner_record(last, following) if following > last + 1 else -1
            if inner < 0:
                runs.append((at, last + 1))
                return following if end < self.size else offset.size
            runs.append((at, last))
            self._fill(int(offset[last]), int(offset[inner]), last - 1, inner, runs, gaps, spoilt=last)
            return inner
        if not meets:
            failed.append(last)
        undefined = int(self.type[following]) if meets and self.entry[following] < 0 else -1
        soft = -1 if meets else self._behind_soft_header(end)
        resume = soft if soft >= 0 else self.next_confirmed(following if meets else last + 1)
        spoilt = soft < 0 and not meets and (self._place(resume) < end or self._misnamed(last, resume) or self._out_of_time(last, resume))
        runs.append((at, last if spoilt else last + 1))
        start = int(offset[last]) if spoilt else end
        self._fill(start, self._place(resume), last - 1 if spoilt else last, resume, runs, gaps, undefined, last)
        return resume

    def _inner_record(self, last: int, following: int) -> int:
        """A candidate inside record `last` that is a record of its own: it has a successor there and a fitting time stamp."""
        inner = np.arange(last + 1, min(following, self.offset.size))
        inner = inner[self.valid[inner] & (self.end[inner] <= self.end[last]) & (self.clock[self.entry[inner]] > 0)]
        inner = inner[header_at(self.buffer, self.end[inner]) | (self.end[inner] == self.size)]
        inner = self.in_time(inner, last - 1, following)
        return int(inner[0]) if inner.size else -1

    def _behind_soft_header(self, end: int) -> int:
        """The record behind one at `end` of which a magic byte is damaged, its type id and its place being right; else -1."""
        if end + layout.HEADER_BYTES > self.size or (self.buffer[end] != layout.MAGIC[0] and self.buffer[end + 1] != layout.MAGIC[1]):
            return -1
        entry = self.definitions.entries(np.array([end]), self.buffer[end + 2 : end + 3])[0]
        if entry < 0:
            return -1
        behind = end + int(self.definitions.length[entry])
        place = int(np.searchsorted(self.offset, behind))
        return place if place < self.offset.size and self.offset[place] == behind and self.valid[place] else -1

    def _misnamed(self, last: int, resume: int) -> bool:
        """Whether record `last`, behind which the chain breaks, looks like another one with a damaged type id.

        Its true length would end where the chain resumes, and its type follows that of the record before it nowhere else.
        """
        span = self._place(resume) - int(self.offset[last])
        if last == 0 or span > layout.MAX_RECORD_BYTES:
            return False
        entry = self.definitions.entries(np.full(256, self.offset[last]), np.arange(256, dtype=np.uint8))
        return bool((self.definitions.length[entry[entry >= 0]] == span).any()) and int(self.pairs[self.pair[last - 1]]) <= 1

    def _out_of_time(self, last: int, resume: int) -> bool:
        """Whether the time stamp of record `last` does not fit the clock before it and behind the break."""
        index = np.array([last])
        return bool(self.clock[self.entry[last]] > 0) and last > 0 and self.in_time(index, last - 1, resume).size == 0

    def _fill(
        self,
        start: int,
        stop: int,
        before: int,
        after: int,
        runs: list[tuple[int, int]],
        gaps: list[Gap],
        undefined: int = -1,
        spoilt: int = -1,
    ) -> None:
        """Account for `start:stop`: single records whose time fits the clock between candidates `before` and `after`, else gaps."""
        if start >= stop:
            return
        index = np.arange(before + 1, min(after, self.offset.size))
        index = index[(index != spoilt) & (self.offset[index] >= start)]
        index = index[self.valid[index] & (self.entry[index] >= 0) & (self.end[index] <= stop)]
        for single in self.in_time(index[self.clock[self.entry[index]] > 0], before, after).tolist():
            place = int(self.offset[single])
            if place < start:
                continue
            if place > start:
                gaps.append(Gap(start, place, undefined))
                undefined = -1
            runs.append((single, single + 1))
            start = int(self.end[single])
        if start < stop:
            gaps.append(Gap(start, stop, undefined))


def read_times(buffer: Buffer, offset: Ints, kind: npt.NDArray[np.int8]) -> Ints:
    """Time stamps in us of records at `offset`: `kind` 1 is TimeUS (uint64), 2 is TimeMS (uint32), 0 has none and gives -1."""
    times = np.full(offset.size, -1, np.int64)
    for code, dtype, factor in ((1, "<u8", 1), (2, "<u4", 1000)):
        where = np.flatnonzero(kind == code)
        if where.size:
            width = np.dtype(dtype).itemsize
            stamps = np.ndarray((buffer.size - width + 1,), dtype, buffer, 0, (1,))[offset[where] + layout.HEADER_BYTES]
            times[where] = np.minimum(stamps.astype(np.uint64), LATEST_US).astype(np.int64) * factor
    return times
