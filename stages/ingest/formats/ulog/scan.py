"""Find the chain of messages in a ULog file: in bulk over data messages, step by step
over all others and where the chain breaks.

A data message shows a subscribed number and the size that goes with it: five bytes that
must agree. Such headers are found for a whole block at once, and a run in which each
ends where the next begins is taken in one step. Behind damage the chain goes on at the
next message that can be believed by itself or by what follows it. Subscriptions and
formats count only where they stand in the chain.

The block doubles as long as the subscriptions stay the same and starts small when they
change, so the work stays in proportion to the size of the file whatever it holds.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from auvid.data_schemas.formats import ulog as layout
from auvid.hydro.arrays import Buffer
from auvid.stages.ingest.formats.ulog import messages
from auvid.stages.ingest.formats.ulog.blocks import Block, choose_format, data_headers
from auvid.stages.ingest.formats.ulog.contents import (
    CUT_BY_APPENDED,
    CUT_OFF,
    DAMAGED,
    UNDEFINED_STREAM,
    UNKNOWN_TYPE,
    UNREADABLE,
    WRONG_SIZE_STREAM,
    Contents,
    Numbers,
    Stream,
)

FIRST_BLOCK, LAST_BLOCK = 1 << 12, 1 << 22
FIRST_SEARCH, LAST_SEARCH = 1 << 9, 1 << 18
MAX_BOUNDARIES = 3
MOST_CHOICES = 16  # between formats, each of which looks through the whole file
FRAMES_TO_FOLLOW = 5
FRAMES_TO_BELIEVE = 3
LOOSE_TYPES = b"IMLC"
BLANK_BYTES = 16
SMALL = 1024  # sizes and numbers of most messages are smaller; those of damaged bytes are not
NEAR_END = 256  # bytes in which a message that is not data may be cut off and still bear out the one before


_searchable = np.zeros(256, np.bool_)
_searchable[list(b"FIMPQASLC")] = True


class Scan:
    """One pass over a file; `run` returns the contents."""

    def __init__(self, buffer: Buffer) -> None:
        self.buffer = buffer
        self.bytes = buffer.data
        self.size = buffer.size
        count = max(0, self.size - 1)
        self.words = (
            np.ndarray((count,), "<u2", buffer, 0, (1,)) if count else np.zeros(0, np.uint16)
        )
        self.out = Contents()
        self.numbers = Numbers()
        self.stream_index: dict[tuple[str, int], int] = {}
        self.limit = self.size
        self.boundaries: list[int] = []
        self.block: Block | None = None
        self.block_version = -1
        self.block_bytes = FIRST_BLOCK
        self.choices = MOST_CHOICES
        self.chained = (
            -1
        )  # offset of the data message that ends at the present place, -1 if none does

    def run(self) -> Contents:
        place = min(layout.HEADER_BYTES, self.size)
        while place < self.size:
            if place == self.limit:
                self._next_limit()
                continue
            if self._data_at(place)[1] >= 0:
                place = self._take_run(place)
                continue
            end = self._other_at(place, apply=True, confirm=True)
            if end < 0:
                place = self._across(place)
            else:
                self.chained, place = -1, end
        return self.out

    def _next_limit(self) -> None:
        self.limit = self.boundaries.pop(0) if self.boundaries else self.size
        self.block_version = -1

    # ---- single messages

    def _data_at(self, place: int) -> tuple[int, int]:
        """Stream and end of the data message at `place`; end -1 if there is none that
        matches a subscription.
        """
        if place + layout.DATA_HEADER_BYTES > self.limit or self.bytes[place + 2] != layout.DATA:
            return 0, -1
        size, _, id = struct.unpack_from("<HBH", self.bytes, place)
        end = place + layout.MESSAGE_HEADER_BYTES + size
        stream = self.numbers.match(id, size)
        return (0, -1) if stream is None or end > self.limit else (stream, end)

    def _header(self, place: int) -> tuple[int, int]:
        """End and type that the header at `place` declares; end beyond the limit if the
        header itself is cut off.
        """
        if place + layout.MESSAGE_HEADER_BYTES > self.limit:
            return self.limit + 1, 0
        size, kind = struct.unpack_from("<HB", self.bytes, place)
        return place + layout.MESSAGE_HEADER_BYTES + size, kind

    def _other_at(self, place: int, *, apply: bool = False, confirm: bool = False) -> int:
        """End of a message at `place` that is not data and can be believed, -1 if there
        is none.

        `apply` takes what it says; `confirm` wants those whose content shows little of
        its end to be followed by a message.
        """
        end, kind = self._header(place)
        if end > self.limit or kind == layout.DATA or kind not in layout.TYPES:
            return -1
        content = self.bytes[place + layout.MESSAGE_HEADER_BYTES : end].tobytes()
        loose = confirm and kind in LOOSE_TYPES
        if loose and not (self._believe(chr(kind), content, place, False) and self._follows(end)):
            return -1
        if not self._believe(chr(kind), content, place, apply):
            return -1
        if apply:
            if kind in layout.DEFINITION_TYPES:
                self.out.definition_bytes += end - place
            else:
                self.out.other_bytes += end - place
        return end

    def _believe(self, kind: str, content: bytes, place: int, apply: bool) -> bool:
        match kind:
            case "F":
                return self._format(content, apply)
            case "I":
                return messages.information(content)
            case "M":
                return messages.information_multiple(content)
            case "Q":
                return messages.parameter_default(content)
            case "P":
                return self._parameter(content, apply)
            case "A":
                return self._subscribe(content, apply)
            case "R":  # never written by PX4; data that follow all the same are read as before
                return len(content) == 2 and self.numbers.known(int.from_bytes(content, "little"))
            case "L" | "C":
                return self._logged(
                    messages.logged_text(content) if kind == "L" else messages.tagged_text(content),
                    apply,
                )
            case "S":
                return content == layout.SYNC
            case "O":
                return self._dropout(content, apply)
            case _:
                return place == layout.HEADER_BYTES and self._flag_bits(content, apply)

    def _format(self, content: bytes, apply: bool) -> bool:
        declared = layout.parse_format(content)
        if declared is not None and apply:
            self.out.formats.add(declared)
        return declared is not None

    def _parameter(self, content: bytes, apply: bool) -> bool:
        found = messages.parameter(content)
        if found is not None and apply:
            self.out.parameters[found[0]] = found[1]
        return found is not None

    def _logged(self, found: messages.Text | None, apply: bool) -> bool:
        if found is not None and apply:
            self.out.texts.append((found.time_us, found.text))
        return found is not None

    def _dropout(self, content: bytes, apply: bool) -> bool:
        if len(content) == 2 and apply:
            self.out.dropouts_ms.append(int.from_bytes(content, "little"))
        return len(content) == 2

    def _subscribe(self, content: bytes, apply: bool) -> bool:
        found = messages.subscription(content)
        if apply and found is not None and found.topic in self.out.formats.rivals and self.choices:
            self.choices -= 1
            choose_format(self.buffer, self.words, self.out.formats, found)
        sizes = None if found is None else self.out.formats.layout(found.topic)
        if found is None or sizes is None:
            return False
        if apply:
            key = (found.topic, found.instance)
            if key not in self.stream_index:
                self.stream_index[key] = len(self.out.streams)
                self.out.streams.append(Stream(found.topic, found.instance, sizes))
            self.numbers.subscribe(found.id, self.stream_index[key], sizes)
        return True

    def _flag_bits(self, content: bytes, apply: bool) -> bool:
        end = layout.HEADER_BYTES + layout.MESSAGE_HEADER_BYTES + len(content)
        if len(content) < layout.FLAG_BITS_BYTES or (
            len(content) > layout.FLAG_BITS_BYTES and not self._follows(end)
        ):
            return False
        if apply:
            flags = content[8:16]
            self.out.unknown_flags = bool(flags[0] & ~layout.DATA_APPENDED or any(flags[1:]))
            offsets = struct.unpack_from(f"<{MAX_BOUNDARIES}Q", content, 16)
            if flags[0] & layout.DATA_APPENDED:
                self.boundaries = sorted(
                    {o for o in offsets if layout.HEADER_BYTES + len(content) < o < self.size}
                )
                self._next_limit()
        return True

    # ---- runs of data messages

    def _take_run(self, place: int) -> int:
        """Take the data message at `place` and all that follow it without a break in
        one block; return the end of the last.
        """
        block = self.block
        if self.block_version != self.numbers.version:
            self.block_bytes = FIRST_BLOCK
        if (
            block is None
            or self.block_version != self.numbers.version
            or not block.start <= place < block.stop
        ):
            block = self.block = data_headers(
                self.buffer,
                self.words,
                self.numbers,
                place,
                min(place + self.block_bytes, self.limit),
                self.limit,
            )
            self.block_version = self.numbers.version
            self.block_bytes = min(2 * self.block_bytes, LAST_BLOCK)
        at = int(block.offset.searchsorted(place))
        last = int(block.breaks[block.breaks.searchsorted(at)])
        if block.is_filled(
            last
        ):  # by whole messages: what began there was torn, and they only happen to end where it would
            self.out.data.append((block.offset[at:last], block.stream[at:last]))
            self.out.add_gap(self.buffer, int(block.offset[last]), int(block.offset[last + 1]))
            self.chained = -1
            return int(block.offset[last + 1])
        self.out.data.append((block.offset[at : last + 1], block.stream[at : last + 1]))
        self.chained = int(block.offset[last])
        return int(block.end[last])

    # ---- damage

    def _across(self, place: int) -> int:
        """Account for what stands at `place`, where the chain breaks, and return where
        it goes on.
        """
        before = self.chained
        self.chained = -1
        resume = self._search(before + 1 if before >= 0 else place + 1)
        if resume < place:  # a message begins inside the one before: that one lost bytes
            self.out.drop_last()
            self.out.add_gap(self.buffer, before, resume)
            return resume
        framed = self._framed(place, resume)
        if framed > place:
            return framed
        if resume == self.limit and self._cut_off(place):
            self.out.add_gap(
                self.buffer, place, resume, CUT_OFF if resume == self.size else CUT_BY_APPENDED
            )
            return self._pass_boundary(place, resume)
        behind = self._behind_misread_header(place)
        if place < behind <= resume:
            self.out.add_gap(self.buffer, place, behind)
            return behind
        if (
            before >= 0
            and not self._blank_behind(place, resume)
            and not (
                self._damage_starts_behind(place)
                or self.out.ends_as_before(self.buffer, before, place)
            )
        ):
            self.out.drop_last()
            cut = resume == self.size and not self.buffer[place:].any()
            self.out.add_gap(self.buffer, before, place, CUT_OFF if cut else DAMAGED)
        self.out.add_gap(self.buffer, place, resume)
        return resume

    def _blank_behind(self, place: int, resume: int) -> bool:
        """Whether zeros begin at `place`, and not before: a message that ends in zeros
        may have been cut by them.
        """
        return (
            bool(self.buffer[place - 1])
            and not self.buffer[place : min(resume, place + BLANK_BYTES)].any()
        )

    def _damage_starts_behind(self, place: int) -> bool:
        """Whether the message before `place` has all of its bytes: the first ones at
        `place` are those of a header (one with small numbers, a size that data have, or
        the low byte of a size behind which the chain goes on).
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
        """Where to go on when a message is cut by appended data; back to it if the
        offset of the appended data proves wrong.
        """
        if boundary == self.size:
            return boundary
        self._next_limit()
        if self._data_at(boundary)[1] >= 0 or self._other_at(boundary) >= 0:
            return boundary
        self.out.gaps.pop()
        return place

    def _cut_off(self, place: int) -> bool:
        """Whether what stands at `place` is the beginning of a message that the limit
        cuts.
        """
        end, kind = self._header(place)
        if end <= self.limit:
            return False
        if place + layout.DATA_HEADER_BYTES <= self.limit and kind == layout.DATA:
            size, _, id = struct.unpack_from("<HBH", self.bytes, place)
            return self.numbers.match(id, size) is not None
        return self.limit - place < layout.DATA_HEADER_BYTES or kind in layout.TYPES

    def _behind_misread_header(self, place: int) -> int:
        """The end of the data message at `place` if only its size is damaged: the one
        that its number has leads on; -1 if not.
        """
        if place + layout.DATA_HEADER_BYTES > self.limit or self.bytes[place + 2] != layout.DATA:
            return -1
        for expected in self.numbers.sizes(int(self.words[place + 3])):
            end = place + layout.MESSAGE_HEADER_BYTES + expected
            if end <= self.limit and self._follows(end):
                return end
        return -1

    def _framed(self, place: int, resume: int) -> int:
        """How far sizes lead from `place` to `resume` over messages that have a frame
        but no meaning; these are accounted for.

        The first may be of any type if they lead all the way. Else they are believed as
        far as the last data message with a size that its number is known to have, or,
        where there are several, but for the last, whose size may be the damaged one.
        Numbers of data that are met this way are taken as known from here on, without
        meaning.
        """
        frames = list(self._frames(place, resume))
        if not frames or frames[-1][1] != resume:
            met = [
                index for index, (start, _, _) in enumerate(frames) if self._data_at(start)[1] >= 0
            ]
            sound = len(frames) - (frames[:1] != [] and frames[0][2] not in layout.TYPES)
            if not met and sound <= FRAMES_TO_BELIEVE:
                return place
            del frames[met[-1] + 1 if met else -1 :]
        for start, stop, kind in frames:
            if kind == layout.DATA and stop - start >= layout.DATA_HEADER_BYTES:
                id, size = int(self.words[start + 3]), stop - start - layout.MESSAGE_HEADER_BYTES
                stream = self.numbers.match(id, size)
                if stream is None:
                    stream = WRONG_SIZE_STREAM if self.numbers.known(id) else UNDEFINED_STREAM
                    self.numbers.put(2, id, size, stream)
                self.out.data.append((np.array([start]), np.array([stream], np.int32)))
            else:
                self.out.add_gap(
                    self.buffer, start, stop, UNREADABLE if kind in layout.TYPES else UNKNOWN_TYPE
                )
        return frames[-1][1]

    def _frames(self, place: int, resume: int) -> Iterator[tuple[int, int, int]]:
        start = place
        while start < resume:
            end, kind = self._header(start)
            empty = (
                end == start + layout.MESSAGE_HEADER_BYTES
            )  # as zero bytes would read; no message is
            if end > resume or empty or (start > place and kind not in layout.TYPES):
                return
            yield start, end, kind
            start = end

    def _search(self, start: int) -> int:
        """The first place from `start` on where a message stands that can be believed;
        the limit if there is none.
        """
        step = FIRST_SEARCH
        while start < self.limit:
            stop = min(start + step, self.limit)
            found = self._search_block(start, stop)
            if found >= 0:
                return found
            start, step = stop, min(2 * step, LAST_SEARCH)
        return self.limit

    def _search_block(self, start: int, stop: int) -> int:
        data = data_headers(self.buffer, self.words, self.numbers, start, stop, self.limit)
        first = -1
        for index in range(data.offset.size):
            if data.stream[index] >= 0 and self._follows(int(data.end[index])):
                first = int(data.offset[index])
                break
        last = first if first >= 0 else stop
        kinds = self.buffer[start + 2 : min(last + 2, self.limit)]
        place = np.flatnonzero(_searchable[kinds]) + start
        for candidate in place[
            place + self.words[place] + layout.MESSAGE_HEADER_BYTES <= self.limit
        ].tolist():
            if self._other_at(candidate, confirm=True) >= 0:
                return int(candidate)
        return first

    def _follows(self, place: int) -> bool:
        """Whether at `place` there is the end, or a message, if need be behind one with
        a damaged header or some without meaning.

        `FRAMES_TO_FOLLOW` sound frames in a row are proof enough, whatever they mean.
        """
        if place >= self.limit - layout.MESSAGE_HEADER_BYTES or self._stands(place):
            return True
        if place + layout.DATA_HEADER_BYTES > self.limit:
            return self._header(place)[1] in layout.TYPES
        expected = int(self.numbers.size[0][int(self.words[place + 3])])
        other = place + layout.MESSAGE_HEADER_BYTES + expected
        if expected > 0 and other <= self.limit and self._stands(other):
            return True
        for _ in range(FRAMES_TO_FOLLOW):
            end, kind = self._header(place)
            if end > self.limit:
                return (kind == layout.DATA or self.limit - place < NEAR_END) and self._cut_off(
                    place
                )
            if kind not in layout.TYPES or end == place + layout.MESSAGE_HEADER_BYTES:
                return False
            if end == self.limit or self._stands(end):
                return True
            place = end
        return True

    def _stands(self, place: int) -> bool:
        return self._data_at(place)[1] >= 0 or self._other_at(place) >= 0
