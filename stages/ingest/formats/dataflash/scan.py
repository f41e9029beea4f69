"""Find the chain of records in a DataFlash log.

A candidate is any place with the two magic bytes. The chain goes from a record to the
candidate at its end; a log has no other framing and no checksum. That is vectorised;
only where the chain breaks it is followed step by step. Behind a break the chain goes
on at the next candidate that is itself followed by a header (or by the end of the
file), or that is a definition which agrees with itself; between the two, single records
are taken only if their own time stamp fits the clock on both sides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from statistics import median_high

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer, Ints, Mask
from auvid.hydro.long_series.long_arrays import laid_down, let_go
from auvid.stages.ingest.formats.accounting import LATEST_US, overlapping
from auvid.stages.ingest.formats.dataflash.definitions import Definitions, Entries

BLOCK = 1 << 17
LET_GO_BYTES = 64 * BLOCK
"""After which pages of a long file go."""
NEAR = 16  # candidates that show the clock on either side of a break
TWO_SIDES_US = 1_000_000  # tolerance of a time stamp between two that show the clock
ONE_SIDE_US = 10_000_000  # where only one side shows the clock
UNKNOWN_SHARE = 0.6  # share of equal gaps from which the length of an undefined type is inferred
UNKNOWN_LEAST = 4

Clock = npt.NDArray[np.int8]


@dataclass(frozen=True)
class ChainGap:
    """Buffer `start:stop` outside the chain.

    `id` is the type of the undefined message at `start`, -1 for damage.
    """

    start: int
    stop: int
    id: int = -1


@dataclass(frozen=True)
class Chain:
    """Records in file order, by `offset`, `type` and `entry` (into Definitions).

    Entry -1 is an undefined type of inferred `length`.
    """

    offset: Ints
    type: Buffer
    entry: Entries
    length: Entries
    gaps: list[ChainGap]
    failed: Entries  # entries of the candidates that do not fit the chain
    distance: Ints  # from each of them to the next candidate


def candidates(buffer: Buffer) -> Ints:
    """Return the offsets of all magic byte pairs with a type id, ascending."""
    places = [np.zeros(0, np.int64)]
    first, second = layout.MAGIC
    for start in range(0, buffer.size, BLOCK):
        if start % LET_GO_BYTES == 0:
            let_go()
        part = buffer[start : start + BLOCK + 1]
        places.append(np.flatnonzero((part[:-1] == first) & (part[1:] == second)) + start)
    offsets = np.concatenate(places)
    del places
    return laid_down(offsets[: np.searchsorted(offsets, buffer.size - 2)])


def types_at(buffer: Buffer, offset: Ints) -> Buffer:
    """Return the type ids of the candidates at `offset`."""
    types = np.empty(offset.size, np.uint8)
    for place in _blocks(offset.size):
        types[place] = buffer[offset[place] + 2]
    return types


def header_at(buffer: Buffer, offset: Ints) -> Mask:
    """Return where magic bytes stand at `offset`; False past the end of the file."""
    there: Mask = np.empty(offset.size, np.bool_)
    for place in _blocks(offset.size):
        inside = np.minimum(offset[place], buffer.size - 2)
        there[place] = (
            (buffer[inside] == layout.MAGIC[0])
            & (buffer[inside + 1] == layout.MAGIC[1])
            & (inside == offset[place])
        )
    return there


def _blocks(size: int) -> Iterator[slice]:
    """Yield the places of records by blocks, between which pages of a file go."""
    for start in range(0, size, BLOCK):
        let_go()
        yield slice(start, start + BLOCK)


def infer_lengths(
    offset: Ints,
    types: Buffer,
    entry: Entries,
    length: Entries,
) -> None:
    """Set the length of undefined types to the usual distance of the next header."""
    where = np.flatnonzero(entry[:-1] < 0)
    if where.size < UNKNOWN_LEAST:
        return
    gap = offset[where + 1] - offset[where]
    fits = (gap >= layout.HEADER_BYTES) & (gap <= layout.MAX_RECORD_BYTES)
    id = types[where].astype(np.int64)
    votes = np.bincount(id[fits] * 256 + gap[fits], minlength=65536).reshape(256, 256)
    best, most, total = votes.argmax(axis=1), votes.max(axis=1), np.bincount(id, minlength=256)
    clear = (most >= UNKNOWN_LEAST) & (most >= UNKNOWN_SHARE * total)
    unknown = np.flatnonzero(entry < 0)
    length[unknown] = np.where(clear, best, 0)[types[unknown]]


@dataclass
class Walk:
    """One walk along the chain. Arrays have one entry per candidate.

    `clock` is the kind of time stamp (see `read_times`) of each definition, and a last
    0 which serves entry -1, the undefined types. `sound` are the offsets of the FMT
    records that agree with themselves, which is proof enough to take them next to
    damage.
    """

    buffer: Buffer
    offset: Ints
    type: Buffer
    definitions: Definitions
    clock: Clock
    sound: Ints

    def __post_init__(self) -> None:
        self.size, self.count = self.buffer.size, self.offset.size
        self.entry = self.definitions.entries(self.offset, self.type)
        self.length = self.definitions.length[self.entry]
        infer_lengths(self.offset, self.type, self.entry, self.length)
        self.entry, self.length = laid_down(self.entry), laid_down(self.length)
        self.end = laid_down(self.offset + self.length)
        self.valid = (self.length > 0) & (self.end <= self.size)
        self.runs: list[tuple[int, int]] = []
        self.gaps: list[ChainGap] = []
        self.failed: list[int] = []

    # What only a break needs is computed at the first break.

    @cached_property
    def confirmed(self) -> Ints:
        """Return candidates right before a header or the end, and sound definitions."""
        followed = self.valid & (header_at(self.buffer, self.end) | (self.end == self.size))
        followed[self.offset.searchsorted(self.sound)] = True
        return np.flatnonzero(followed)

    @cached_property
    def times_us(self) -> Ints:
        """Return the time stamps of the valid candidates; -1 where there is none."""
        kind = np.where(self.valid, self.clock[self.entry], 0)
        return laid_down(read_times(self.buffer, self.offset, kind))

    @cached_property
    def pairs(self) -> Ints:
        """Count pairs of types that follow each other, at first * 256 + second."""
        return np.bincount(self.type[:-1].astype(np.uint16) << 8 | self.type[1:], minlength=1 << 16)

    def run(self) -> Chain:
        linked = np.zeros(self.count, np.bool_)
        linked[:-1] = (self.end[:-1] == self.offset[1:]) & self.valid[1:]
        breaks = np.flatnonzero(~linked)
        at = self._begin()
        while at < self.count:
            at = self._across(at, int(breaks[breaks.searchsorted(at)]))
        taken = np.zeros(self.count + 1, np.int8)
        for start, stop in self.runs:
            taken[start] += 1
            taken[stop] -= 1
        inside = np.cumsum(taken[:-1], dtype=np.int8).view(np.bool_)
        kept = slice(None) if inside.all() else inside  # of a sound log nothing need be copied
        missed = self._missed()
        following = self.offset[np.minimum(missed + 1, self.count - 1)]
        behind = np.where(missed + 1 < self.count, following, self.size)
        return Chain(
            laid_down(self.offset[kept]),
            self.type[kept],
            laid_down(self.entry[kept]),
            laid_down(self.length[kept]),
            self.gaps,
            self.entry[missed],
            behind - self.offset[missed],
        )

    def _missed(self) -> Ints:
        """Return the candidates that do not fit the chain.

        These have no header at their end, or stand in gaps, as close together as
        records do.
        """
        missed = np.zeros(self.count, np.bool_)
        if self.gaps:
            start, stop = (
                np.array([gap.start for gap in self.gaps]),
                np.array([gap.stop for gap in self.gaps]),
            )
            gap = start.searchsorted(self.offset, side="right") - 1
            close = np.diff(self.offset, append=self.size) <= layout.MAX_RECORD_BYTES
            missed = (gap >= 0) & (self.offset < stop[gap]) & close
        missed[self.failed] = True
        return np.flatnonzero(missed)

    def _begin(self) -> int:
        if self.count and self.offset[0] == 0 and self.valid[0]:
            return 0
        first = self._next_confirmed(0)
        self._fill(0, self._place(first), -1, first)
        return first

    def _across(self, at: int, last: int) -> int:
        """Take the run `at..last`; return where the chain goes on behind it.

        That is the number of candidates at the end of the file.
        """
        end = int(self.end[last])
        following = last + 1
        if following < self.count and self.offset[following] < end:
            following += int(
                self.offset[following : following + layout.MAX_RECORD_BYTES].searchsorted(end)
            )
        meets = following < self.count and int(self.offset[following]) == end
        if end == self.size or (meets and self.valid[following]):
            inner = self._inner_record(last, following)
            if inner < 0:
                self.runs.append((at, last + 1))
                return following if end < self.size else self.count
            self.runs.append((at, last))
            self._fill(int(self.offset[last]), self._place(inner), last, inner)
            return inner
        if meets:
            self.runs.append((at, last + 1))
            resume = self._next_confirmed(following)
            self._fill(
                end,
                self._place(resume),
                last,
                resume,
                int(self.type[following]) if self.entry[following] < 0 else -1,
            )
            return resume
        self.failed.append(last)
        resume = self._behind_soft_header(end)
        damaged = False
        if resume < 0:
            resume = self._next_confirmed(last + 1)
            damaged = (
                self._place(resume) < end
                or self._misnamed(last, resume)
                or self._out_of_time(last, resume)
            )
        self.runs.append((at, last if damaged else last + 1))
        self._fill(int(self.offset[last]) if damaged else end, self._place(resume), last, resume)
        return resume

    def _place(self, index: int) -> int:
        return int(self.offset[index]) if index < self.count else self.size

    def _next_confirmed(self, index: int) -> int:
        """Return the first confirmed candidate from `index`, or their number."""
        place = int(self.confirmed.searchsorted(index))
        return int(self.confirmed[place]) if place < self.confirmed.size else self.count

    def _inner_record(self, last: int, following: int) -> int:
        """Return a candidate inside record `last` that is a record of its own, or -1.

        It has a successor there and a fitting time stamp.
        """
        end = int(self.end[last])
        for inner in range(last + 1, following):
            complete = (
                self.valid[inner] and self.end[inner] <= end and self.clock[self.entry[inner]] > 0
            )
            if complete and (
                self.end[inner] == end or header_at(self.buffer, self.end[inner : inner + 1])[0]
            ):
                low, high = self._window(last - 1, following)
                if low <= self.times_us[inner] <= high:
                    return inner
        return -1

    def _behind_soft_header(self, end: int) -> int:
        """Return the record behind one at `end` with a damaged magic byte, or -1.

        The type id and the place of the damaged one must be right.
        """
        if end + layout.HEADER_BYTES > self.size or (
            self.buffer[end] != layout.MAGIC[0] and self.buffer[end + 1] != layout.MAGIC[1]
        ):
            return -1
        entry = self.definitions.entries(np.array([end]), self.buffer[end + 2 : end + 3])[0]
        if entry < 0:
            return -1
        behind = end + int(self.definitions.length[entry])
        place = int(self.offset.searchsorted(behind))
        meets = place < self.count and self.offset[place] == behind and self.valid[place]
        return place if meets else -1

    def _misnamed(self, last: int, resume: int) -> bool:
        """Return whether record `last` looks like another one with a damaged type id.

        Its true length would end where the chain resumes, and its type follows that of
        the record before it nowhere else.
        """
        if last == 0 or self._place(resume) - int(self.offset[last]) not in self.definitions.length:
            return False
        return int(self.pairs[int(self.type[last - 1]) << 8 | int(self.type[last])]) <= 1

    def _out_of_time(self, last: int, resume: int) -> bool:
        """Return whether the time stamp of record `last` does not fit its clock."""
        if last == 0 or not self.clock[self.entry[last]]:
            return False
        low, high = self._window(last - 1, resume)
        return low <= high and not low <= self.times_us[last] <= high

    def _window(self, before: int, after: int) -> tuple[int, int]:
        """Return the times that a record between `before` and `after` can have.

        No time is possible if neither side shows a clock.
        """
        early = self._steps(max(before + 1 - 2 * NEAR, 0), before + 1)[: -NEAR - 1 : -1]
        late = self._steps(after, min(after + 2 * NEAR, self.count))[:NEAR]
        # The median of the first five stamps; one damaged stamp cannot move it far.
        sides = [
            [time for time in self.times_us[side].tolist() if time >= 0][:5]
            for side in (early, late)
        ]
        clock = [median_high(side) for side in sides if side]
        if not clock:
            return 1, 0
        slack = TWO_SIDES_US if len(clock) == 2 else ONE_SIDE_US
        return max(min(clock) - slack, 0), max(clock) + slack

    def _steps(self, start: int, stop: int) -> list[int]:
        """Return the candidates `start:stop` without those inside a record before them.

        For 65 ms every 72 minutes all time stamps hold the magic bytes, and what
        follows these is no time.
        """
        steps, end = [], 0
        for place in range(start, stop):
            if self.offset[place] >= end:
                steps.append(place)
                end = int(self.end[place]) if self.valid[place] else 0
        return steps

    def _fill(self, start: int, stop: int, before: int, after: int, undefined: int = -1) -> None:
        """Account for `start:stop`: candidates whose time fits the clock, else gaps.

        The candidates are those between `before` and `after`.
        """
        if start < stop and after > before + 1:
            between = np.arange(before + 1, after)
            timed = self.valid[between] & (self.clock[self.entry[between]] > 0)
            between = between[timed & (self.offset[between] >= start) & (self.end[between] <= stop)]
            if between.size:
                low, high = self._window(before, after)
                for single in between[
                    (self.times_us[between] >= low) & (self.times_us[between] <= high)
                ].tolist():
                    place = int(self.offset[single])
                    if place < start:
                        continue
                    if place > start:
                        self.gaps.append(ChainGap(start, place, undefined))
                        undefined = -1
                    self.runs.append((single, single + 1))
                    self.failed.append(single)
                    start = int(self.end[single])
        if start < stop:
            self.gaps.append(ChainGap(start, stop, undefined))


def read_times(buffer: Buffer, offset: Ints, kind: Clock) -> Ints:
    """Return time stamps in us of records at `offset`.

    `kind` 1 is TimeUS (uint64), 2 is TimeMS (uint32), 0 has none and gives -1.
    """
    times = np.full(offset.size, -1, np.int64)
    for place in _blocks(offset.size):
        own, at = times[place], offset[place] + layout.HEADER_BYTES
        for code, dtype, factor in ((1, "<u8", 1), (2, "<u4", 1000)):
            where = np.flatnonzero(kind[place] == code)
            stamps = overlapping(buffer, dtype)[at[where]]
            own[where] = np.minimum(stamps.astype(np.uint64), LATEST_US).astype(np.int64) * factor
    return times
