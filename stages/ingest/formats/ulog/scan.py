"""Find the chain of messages in a ULog file.

A data message shows a subscribed number and the size that goes with it: five bytes that
must agree. Such headers are found for a whole block at once, and a run in which each
ends where the next begins is taken in one step; all other messages are read one by one.
Behind damage the chain goes on at the next message that is credible by itself or by
what follows it. Subscriptions and formats count only where they stand in the chain.

The block doubles as long as the subscriptions stay the same and starts small when they
change, so the work stays in proportion to the size of the file whatever it holds.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from auvid.data_schemas.formats import ulog as layout
from auvid.hydro.arrays import Buffer, Ints
from auvid.stages.ingest.formats.accounting import overlapping
from auvid.stages.ingest.formats.ulog import messages
from auvid.stages.ingest.formats.ulog.skipped_bytes import (
    BLANK,
    BLANK_END,
    CUT_BY_APPENDED,
    CUT_OFF,
    DAMAGED,
    UNKNOWN_TYPE,
    UNREADABLE,
    SkippedBytes,
)
from auvid.stages.ingest.formats.ulog.subscribed_data import (
    UNDEFINED_STREAM,
    WRONG_SIZE_STREAM,
    Block,
    Numbers,
    StreamNumbers,
    TopicInstance,
    put_fitting_format,
)

TAIL_BYTES, PARTS_BACK = 4, 8  # compared to tell whether a message is whole
FIRST_BLOCK, LAST_BLOCK = 1 << 12, 1 << 22
FIRST_SEARCH, LAST_SEARCH = 1 << 9, 1 << 18
MAX_BOUNDARIES = 3
MOST_CHOICES = 16  # between formats, each of which looks through the whole file
FRAMES_TO_FOLLOW = 5
MIN_FRAMES = 4  # in a row, to be credible
LOOSE_TYPES = b"IMLC"
BLANK_BYTES = 16
SMALL = 1024  # sizes and numbers of most messages are smaller; those of damaged bytes are not
NEAR_END = 256
"""Buffer in which a message that is not data may be cut off and still confirm the one
before.
"""
Action = Callable[[], object]
_searchable = np.zeros(256, np.bool_)
_searchable[list(b"FIMPQASLC")] = True


class Scan:
    """One pass over a file; `run` fills the lists.

    `data` are offsets and stream numbers of the data messages in file order, in parts;
    a negative stream number is a message that no subscription explains.
    `definition_bytes` and `other_bytes` are the bytes of the other messages. `shared`
    holds numbers that two streams are subscribed with.
    """

    def __init__(self, buffer: Buffer) -> None:
        self.formats = layout.Formats()
        self.streams: list[TopicInstance] = []
        self.data: list[tuple[Ints, StreamNumbers]] = []
        self.gaps: list[SkippedBytes] = []
        self.definition_bytes = self.other_bytes = 0
        self.parameters: dict[str, float] = {}
        self.texts: list[tuple[int, str]] = []
        self.dropouts_ms: list[int] = []
        self.unknown_flags = False
        self.shared: dict[int, tuple[int, int]] = {}

        self.buffer, self.bytes, self.size = buffer, buffer.data, buffer.size
        self.words = overlapping(buffer, "<u2")
        self.numbers = Numbers()
        self.stream_index: dict[tuple[str, int], int] = {}
        self.limit = self.size
        self.boundaries: list[int] = []
        self.block: Block | None = None
        self.block_version = -1
        self.block_bytes = FIRST_BLOCK
        self.choices = MOST_CHOICES
        self.chained = -1  # offset of the data message that ends at the present place

    def run(self) -> Scan:
        """Scan the file from end to end."""
        place = min(layout.HEADER_BYTES, self.size)
        while place < self.size:
            if place == self.limit:
                self._next_limit()
            elif self._data_at(place)[1] >= 0:
                place = self._take_run(place)
            elif (end := self._other_at(place, apply=True, confirm=True)) >= 0:
                self.chained, place = -1, end
            else:
                place = self._across(place)
        self.shared = self.numbers.shared
        del self.numbers, self.block  # large tables that nobody needs any more
        return self

    def _next_limit(self) -> None:
        self.limit = self.boundaries.pop(0) if self.boundaries else self.size
        self.block_version = -1

    def _add_gap(self, start: int, stop: int, reason: str = DAMAGED) -> None:
        """Account for `start:stop`; zeros among damaged bytes are named as such."""
        if start < stop:
            if reason == DAMAGED and not self.buffer[start:stop].any():
                reason = BLANK_END if stop == self.size else BLANK
            self.gaps.append(SkippedBytes(start, stop, reason))

    def _drop_last(self) -> None:
        """Remove the last data message."""
        offset, stream = self.data.pop()
        self.data.append((offset[:-1], stream[:-1]))

    def _ends_as_before(self, last: int, stop: int) -> bool:
        """Return whether the last data message, `last:stop`, has all of its bytes.

        It has if it ends in the same bytes as the message of its stream before it.
        """
        for offset, stream in reversed(self.data[-PARTS_BACK:]):
            earlier = offset[(stream == self.data[-1][1][-1]) & (offset < last)]
            if earlier.size:
                end = int(earlier[-1]) + stop - last
                tail, other = (self.buffer[at - TAIL_BYTES : at] for at in (stop, end))
                return np.array_equal(tail, other)
        return False

    # ---- single messages

    def _data_at(self, place: int) -> tuple[int, int]:
        """Return stream and end of the data message at `place`; end -1: none there."""
        if place + layout.DATA_HEADER_BYTES > self.limit or self.bytes[place + 2] != layout.DATA:
            return 0, -1
        size, _, id = struct.unpack_from("<HBH", self.bytes, place)
        end = place + layout.MESSAGE_HEADER_BYTES + size
        stream = self.numbers.match(id, size)
        return (0, -1) if stream is None or end > self.limit else (stream, end)

    def _header(self, place: int) -> tuple[int, int]:
        """Return end and type that the header at `place` declares.

        The end is beyond the limit if the header itself is cut off.
        """
        if place + layout.MESSAGE_HEADER_BYTES > self.limit:
            return self.limit + 1, 0
        size, kind = struct.unpack_from("<HB", self.bytes, place)
        return place + layout.MESSAGE_HEADER_BYTES + size, kind

    def _other_at(self, place: int, *, apply: bool = False, confirm: bool = False) -> int:
        """Return the end of a credible message at `place` that is not data, or -1.

        `apply` does what it says; `confirm` wants a message whose content shows little
        of its end to be followed by another.
        """
        end, kind = self._header(place)
        if end > self.limit or kind == layout.DATA or kind not in layout.TYPES:
            return -1
        content = self.bytes[place + layout.MESSAGE_HEADER_BYTES : end].tobytes()
        action = self._action(chr(kind), content, place, apply)
        if action is None or (confirm and kind in LOOSE_TYPES and not self._follows(end)):
            return -1
        if apply:
            action()
            if kind in layout.DEFINITION_TYPES:
                self.definition_bytes += end - place
            else:
                self.other_bytes += end - place
        return end

    def _action(self, kind: str, content: bytes, place: int, apply: bool) -> Action | None:
        """Return what a message does, or None if its content is not credible."""
        credible = False
        match kind:
            case "F":
                declared = layout.parse_format(content)
                return None if declared is None else partial(self.formats.add, declared)
            case "I":
                credible = messages.information(content)
            case "M":
                credible = messages.information_multiple(content)
            case "Q":
                credible = messages.parameter_default(content)
            case "P":
                setting = messages.parameter(content)
                return None if setting is None else partial(self.parameters.__setitem__, *setting)
            case "A":
                return self._subscription(content, apply)
            case "R":  # never written by PX4; data that follow all the same are read as before
                id = int.from_bytes(content, "little")
                if len(content) == 2 and self.numbers.is_subscribed(id):
                    return partial(self.numbers.free, id)
            case "L" | "C":
                text = messages.logged_text(content, tagged=kind == "C")
                return None if text is None else partial(self.texts.append, text)
            case "S":
                credible = content == layout.SYNC
            case "O":
                if len(content) == 2:
                    return partial(self.dropouts_ms.append, int.from_bytes(content, "little"))
            case _:
                end = place + layout.MESSAGE_HEADER_BYTES + len(content)
                excess = len(content) - layout.FLAG_BITS_BYTES
                if (
                    place == layout.HEADER_BYTES
                    and excess >= 0
                    and (excess == 0 or self._follows(end))
                ):
                    return partial(self._take_flags, content)
        return int if credible else None

    def _subscription(self, content: bytes, apply: bool) -> Action | None:
        subscription = messages.subscription(content)
        if (
            apply
            and subscription is not None
            and subscription.topic in self.formats.rivals
            and self.choices
        ):
            self.choices -= 1
            self._choose_format(subscription)
        sizes = None if subscription is None else self.formats.layout(subscription.topic)
        if subscription is None or sizes is None:
            return None
        return partial(self._subscribe, subscription, sizes)

    def _subscribe(self, subscription: messages.Subscription, sizes: layout.RecordSizes) -> None:
        number = self.stream_index.setdefault(
            (subscription.topic, subscription.instance), len(self.streams)
        )
        if number == len(self.streams):
            self.streams.append(TopicInstance(subscription.topic, subscription.instance, sizes))
        self.numbers.subscribe(subscription.id, number, sizes)

    def _choose_format(self, subscription: messages.Subscription) -> None:
        """Put one of several formats of a topic in force.

        It is the one whose size fits most data messages of the subscribed number.
        """
        last = self.words.size - (layout.DATA_HEADER_BYTES - 2)
        place = np.flatnonzero(self.buffer[2 : last + 2] == layout.DATA)
        of_number = place[self.words[place + layout.MESSAGE_HEADER_BYTES] == subscription.id]
        sizes = np.bincount(self.words[of_number], minlength=1 << 16)
        put_fitting_format(self.formats, subscription.topic, sizes)

    def _take_flags(self, content: bytes) -> None:
        flags = content[8:16]
        self.unknown_flags = bool(flags[0] & ~layout.DATA_APPENDED or any(flags[1:]))
        if flags[0] & layout.DATA_APPENDED:
            offsets = struct.unpack_from(f"<{MAX_BOUNDARIES}Q", content, 16)
            first = layout.HEADER_BYTES + len(content)
            self.boundaries = sorted({place for place in offsets if first < place < self.size})
            self._next_limit()

    # ---- runs of data messages

    def _data_headers(self, start: int, stop: int) -> Block:
        """Return the headers of data messages in `start:stop`.

        Their number and size agree with a subscription; they end within the limit.
        """
        kinds = self.buffer[start + 2 : min(stop + 2, self.limit - 2)]
        offset = np.flatnonzero(kinds == layout.DATA) + start
        size = self.words[offset]
        index, stream = self.numbers.select(self.words[offset + 3], size)
        offset = offset[index]
        end = offset + (size[index].astype(np.int64) + layout.MESSAGE_HEADER_BYTES)
        longest = layout.MAX_CONTENT_BYTES + layout.MESSAGE_HEADER_BYTES
        if offset.size and int(offset[-1]) + longest > self.limit:
            inside = np.flatnonzero(end <= self.limit)
            offset, end, stream = offset[inside], end[inside], stream[inside]
        breaks = np.append(np.flatnonzero(end[:-1] != offset[1:]), offset.size - 1)
        return Block(start, stop, offset, end, stream, breaks)

    def _take_run(self, place: int) -> int:
        """Take the data message at `place` and its followers; return where they end.

        These are the messages of one block that follow it without a break.
        """
        block = self.block
        changed = self.block_version != self.numbers.version
        if block is None or changed or not block.start <= place < block.stop:
            if changed:
                self.block_bytes = FIRST_BLOCK
            stop = min(place + self.block_bytes, self.limit)
            block = self.block = self._data_headers(place, stop)
            self.block_version = self.numbers.version
            self.block_bytes = min(2 * self.block_bytes, LAST_BLOCK)
        at = int(block.offset.searchsorted(place))
        last = int(block.breaks[block.breaks.searchsorted(at)])
        torn = block.is_filled(last)  # a message that only happens to end where others do
        run = slice(at, last if torn else last + 1)
        self.data.append((block.offset[run], block.stream[run]))
        self.chained = -1 if torn else int(block.offset[last])
        if torn:
            resume = int(block.offset[last + 1])
            self._add_gap(int(block.offset[last]), resume)
            return resume
        return int(block.end[last])

    # ---- damage

    def _across(self, place: int) -> int:
        """Account for what stands at a break of the chain; return where it goes on."""
        before = self.chained
        self.chained = -1
        resume = self._search(before + 1 if before >= 0 else place + 1)
        if resume < place:  # a message begins inside the one before: that one lost bytes
            self._drop_last()
            self._add_gap(before, resume)
            return resume
        framed = self._framed(place, resume)
        if framed > place:
            return framed
        if resume == self.limit and self._cut_off(place):
            reason = CUT_OFF if resume == self.size else CUT_BY_APPENDED
            self._add_gap(place, resume, reason)
            return self._pass_boundary(place, resume)
        behind = self._behind_misread_header(place)
        if place < behind <= resume:
            self._add_gap(place, behind)
            return behind
        complete = (
            before < 0
            or self._blank_behind(place, resume)
            or self._damage_starts_behind(place)
            or self._ends_as_before(before, place)
        )
        if not complete:
            self._drop_last()
            cut = resume == self.size and not self.buffer[place:].any()
            self._add_gap(before, place, CUT_OFF if cut else DAMAGED)
        self._add_gap(place, resume)
        return resume

    def _blank_behind(self, place: int, resume: int) -> bool:
        """Return whether zeros begin at `place` and not before it.

        A message that ends in zeros may have been cut by them.
        """
        blank = self.buffer[place : min(resume, place + BLANK_BYTES)]
        return bool(self.buffer[place - 1]) and not blank.any()

    def _damage_starts_behind(self, place: int) -> bool:
        """Return whether the message before `place` has all of its bytes.

        It has if the first bytes at `place` are those of a header: one with small
        numbers, a size that data have, or the low byte of a size behind which the chain
        goes on.
        """
        if place + layout.DATA_HEADER_BYTES > self.limit:
            return False
        size, kind, id = struct.unpack_from("<HBH", self.bytes, place)
        if size in self.numbers.sizes_met or (
            kind in layout.TYPES and size < SMALL and (kind != layout.DATA or id < SMALL)
        ):
            return True
        near = [other for other in self.numbers.sizes_met if (other ^ size) & 0xFF == 0]
        return any(self._follows(place + layout.MESSAGE_HEADER_BYTES + other) for other in near)

    def _pass_boundary(self, place: int, boundary: int) -> int:
        """Return where to go on when appended data cut a message.

        That is the message itself if the offset of the appended data proves wrong.
        """
        if boundary == self.size:
            return boundary
        self._next_limit()
        if self._stands(boundary):
            return boundary
        self.gaps.pop()
        return place

    def _cut_off(self, place: int) -> bool:
        """Return whether a message begins at `place` that the limit cuts."""
        end, kind = self._header(place)
        if end <= self.limit:
            return False
        if place + layout.DATA_HEADER_BYTES <= self.limit and kind == layout.DATA:
            size, _, id = struct.unpack_from("<HBH", self.bytes, place)
            return self.numbers.match(id, size) is not None
        return self.limit - place < layout.DATA_HEADER_BYTES or kind in layout.TYPES

    def _behind_misread_header(self, place: int) -> int:
        """Return the end of the data message at `place` if only its size is damaged.

        The size that its number has must then lead on to another message; -1 if not.
        """
        if place + layout.DATA_HEADER_BYTES > self.limit or self.bytes[place + 2] != layout.DATA:
            return -1
        for expected in self.numbers.sizes(int(self.words[place + 3])):
            end = place + layout.MESSAGE_HEADER_BYTES + expected
            if end <= self.limit and self._follows(end):
                return end
        return -1

    def _framed(self, place: int, resume: int) -> int:
        """Follow sizes from `place` towards `resume` over messages without meaning.

        Account for these and return where they end (`place` if they are not credible).
        The first may be of any type if they lead all the way. Else they are credible as
        far as the last data message with a size that its number has had, or, where
        there are several, but for the last, whose size may be the damaged one. Numbers
        of data that are met this way are known from here on, without meaning.
        """
        frames = list(self._frames(place, resume))
        if not frames or frames[-1][1] != resume:
            met = [k for k, frame in enumerate(frames) if self._data_at(frame[0])[1] >= 0]
            sound = sum(kind in layout.TYPES for _, _, kind in frames)
            if not met and sound < MIN_FRAMES:
                return place
            del frames[met[-1] + 1 if met else -1 :]
        for start, stop, kind in frames:
            if kind == layout.DATA and stop - start >= layout.DATA_HEADER_BYTES:
                id, size = int(self.words[start + 3]), stop - start - layout.MESSAGE_HEADER_BYTES
                stream = self.numbers.match(id, size)
                if stream is None:
                    stream = (
                        WRONG_SIZE_STREAM if self.numbers.is_subscribed(id) else UNDEFINED_STREAM
                    )
                    self.numbers.put(2, id, size, stream)
                self.data.append((np.array([start]), np.array([stream], np.int32)))
            else:
                self._add_gap(start, stop, UNREADABLE if kind in layout.TYPES else UNKNOWN_TYPE)
        return frames[-1][1]

    def _frames(self, place: int, resume: int) -> Iterator[tuple[int, int, int]]:
        start = place
        while start < resume:
            end, kind = self._header(start)
            empty = end == start + layout.MESSAGE_HEADER_BYTES  # zero bytes; no message is
            if end > resume or empty or (start > place and kind not in layout.TYPES):
                return
            yield start, end, kind
            start = end

    def _search(self, start: int) -> int:
        """Return the first place from `start` with a credible message, or the limit."""
        step = FIRST_SEARCH
        while start < self.limit:
            stop = min(start + step, self.limit)
            place = self._search_block(start, stop)
            if place >= 0:
                return place
            start, step = stop, min(2 * step, LAST_SEARCH)
        return self.limit

    def _search_block(self, start: int, stop: int) -> int:
        data = self._data_headers(start, stop)
        matches = zip(data.offset.tolist(), data.end.tolist(), data.stream.tolist(), strict=True)
        first = next((at for at, end, by in matches if by >= 0 and self._follows(end)), -1)
        kinds = self.buffer[start + 2 : min((first if first >= 0 else stop) + 2, self.limit)]
        place = np.flatnonzero(_searchable[kinds]) + start
        fits = place + self.words[place] + layout.MESSAGE_HEADER_BYTES <= self.limit
        others = place[fits].tolist()
        return next((at for at in others if self._other_at(at, confirm=True) >= 0), first)

    def _follows(self, place: int) -> bool:
        """Return whether the end, or a message, stands at `place`.

        The message may stand behind one with a damaged header or some without meaning;
        `FRAMES_TO_FOLLOW` sound frames in a row are proof enough, whatever they mean.
        """
        if place >= self.limit - layout.MESSAGE_HEADER_BYTES or self._stands(place):
            return True
        if place + layout.DATA_HEADER_BYTES > self.limit:
            return self._header(place)[1] in layout.TYPES
        expected = int(self.numbers.size[0, self.words[place + 3]])
        other = place + layout.MESSAGE_HEADER_BYTES + expected
        if expected > 0 and other <= self.limit and self._stands(other):
            return True
        for _ in range(FRAMES_TO_FOLLOW):
            end, kind = self._header(place)
            if end > self.limit:
                near = kind == layout.DATA or self.limit - place < NEAR_END
                return near and self._cut_off(place)
            if kind not in layout.TYPES or end == place + layout.MESSAGE_HEADER_BYTES:
                return False
            if end == self.limit or self._stands(end):
                return True
            place = end
        return True

    def _stands(self, place: int) -> bool:
        return self._data_at(place)[1] >= 0 or self._other_at(place) >= 0
