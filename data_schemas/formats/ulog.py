"""Byte layout of PX4 ULog files (.ulg).

A file is a 16-byte header and a chain of messages: size of the content (uint16), type
(one character), content; all little-endian, without checksum. `F` messages declare
formats, `A` messages subscribe a number (msg_id) to one instance of a format, `D`
messages hold the number and the packed fields. Trailing `_padding` fields are declared
but not written. `S` messages hold a fixed pattern for finding the chain again. The flag
bits (`B`, first message) give the offsets at which data were appended after the log was
closed, and at which a message may be cut off. Source: PX4 user guide, "ULog file
format", version 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

MAGIC = b"ULog\x01\x12\x35"
VERSION = 1
HEADER_BYTES = 16
MESSAGE_HEADER_BYTES = 3
DATA_HEADER_BYTES = 5  # message header and msg_id
MAX_CONTENT_BYTES = 0xFFFF
MAX_PAYLOAD_BYTES = MAX_CONTENT_BYTES - 2
SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"

DATA = ord("D")
TYPES = b"BFIMPQARDLCSO"
DEFINITION_TYPES = b"BFIMPQAR"

FLAG_BITS_BYTES = 40
DATA_APPENDED = 1  # bit of the first incompatible flag byte
MAX_RIVALS = 4
MAX_DEPTH = 16  # of nested formats; PX4 uses two

FIELD_DTYPES: Mapping[str, str] = {
    "int8_t": "<i1",
    "uint8_t": "<u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "<u1",
    "char": "S1",
}
FIELD_BYTES: Mapping[str, int] = {name: int(dtype[-1]) for name, dtype in FIELD_DTYPES.items()}

_FIELD = rb"[A-Za-z_][\w/-]*+(?:\[[0-9]{1,5}\])?+ [A-Za-z_]\w*+"
_FORMAT = re.compile(rb"([A-Za-z_][\w/-]{0,127}+):(%b(?:;%b)*+);?" % (_FIELD, _FIELD))


@dataclass(frozen=True)
class FormatField:
    """One declared field of a format.

    It has the name of a basic type or of another format, the length of the array (0:
    none) and its own name.
    """

    type: str
    length: int
    name: str

    @property
    def is_padding(self) -> bool:
        return self.name.startswith("_padding")


@dataclass(frozen=True)
class Format:
    """What one `F` message declares."""

    name: str
    fields: tuple[FormatField, ...]

    def pack(self) -> bytes:
        """Content of the `F` message that declares this format."""
        texts = [
            f"{f.type}[{f.length}] {f.name};" if f.length else f"{f.type} {f.name};"
            for f in self.fields
        ]
        return f"{self.name}:{''.join(texts)}".encode("ascii")


def parse_format(content: bytes) -> Format | None:
    """Return the format that the content of an `F` message declares.

    None if it is not one, or declares a field twice or of no length.
    """
    match = _FORMAT.fullmatch(content)
    if match is None:
        return None
    fields = []
    for text in match[2].decode("ascii").split(";"):
        kind, name = text.split(" ")
        kind, bracket, length = kind.partition("[")
        if bracket and int(length[:-1]) == 0:
            return None
        fields.append(FormatField(kind, int(length[:-1]) if bracket else 0, name))
    if len({f.name for f in fields}) < len(fields):
        return None
    return Format(match[1].decode("ascii"), tuple(fields))


@dataclass(frozen=True)
class RecordSizes:
    """Sizes in bytes of the payload of a topic's `D` messages.

    One size is as written, one with the trailing padding; `time` is the offset of the
    field `timestamp` in it (-1: there is none of type uint64).
    """

    written: int
    padded: int
    time: int


@dataclass
class Formats:
    """The formats of a file by name.

    The first declaration of a name holds, until `replace` puts one of its `rivals` in
    force.
    """

    by_name: dict[str, Format] = field(default_factory=dict)
    rivals: dict[str, list[Format]] = field(default_factory=dict)
    _sizes: dict[str, int] = field(default_factory=dict)
    _layouts: dict[str, RecordSizes] = field(default_factory=dict)

    def add(self, declared: Format) -> None:
        """Add a declaration.

        One that differs from that in force is kept as its rival, as one of the two must
        be damaged.
        """
        first = self.by_name.setdefault(declared.name, declared)
        rivals = self.rivals.get(declared.name, [])
        if first != declared and declared not in rivals and len(rivals) < MAX_RIVALS:
            self.rivals[declared.name] = [*rivals, declared]

    def replace(self, chosen: Format) -> None:
        """Put one of several declarations of a name in force."""
        self.by_name[chosen.name] = chosen
        self._sizes.clear()
        self._layouts.clear()

    def size(self, name: str, depth: int = 0) -> int:
        """Return the bytes of one `name`, padding included.

        0 if it cannot be: an unknown or circular type, or too large for a message.
        """
        if name in FIELD_BYTES:
            return FIELD_BYTES[name]
        size_bytes = self._sizes.get(name)
        if size_bytes is not None:
            return size_bytes
        if name not in self.by_name or depth > MAX_DEPTH:
            return 0
        total = 0
        for member in self.by_name[name].fields:
            one = self.size(member.type, depth + 1)
            total += one * max(1, member.length)
            if one == 0 or total > MAX_PAYLOAD_BYTES:
                return 0
        self._sizes[name] = total
        return total

    def layout(self, name: str) -> RecordSizes | None:
        """Return the sizes of a topic's records.

        None as long as `size` is 0: the formats that it needs may still come.
        """
        cached = self._layouts.get(name)
        if cached is None:
            cached = self._layout(name)
            if cached is not None:
                self._layouts[name] = cached
        return cached

    def _layout(self, name: str) -> RecordSizes | None:
        padded = self.size(name)
        if padded == 0:
            return None
        members = self.written_fields(name)
        offset, time = 0, -1
        for member in members:
            if member.name == "timestamp" and member.type == "uint64_t" and not member.length:
                time = offset
            offset += self.size(member.type) * max(1, member.length)
        return RecordSizes(offset, padded, time)

    def written_fields(self, name: str) -> tuple[FormatField, ...]:
        """Fields of a topic without those at its end that are padding."""
        members = self.by_name[name].fields
        last = len(members)
        while last and members[last - 1].is_padding:
            last -= 1
        return members[:last]

    def columns(self, name: str) -> Iterator[tuple[str, str, int]]:
        """Return name, dtype and payload offset of every basic field of a topic.

        Nested formats and arrays are taken apart, without padding.

        Names are `field`, `field[0]` and `field.member`; an array of characters is one
        column of dtype `S<length>`.
        """
        yield from self._flatten(self.written_fields(name), "", 0)

    def _flatten(
        self, members: tuple[FormatField, ...], prefix: str, offset: int
    ) -> Iterator[tuple[str, str, int]]:
        for member in members:
            one, path = self.size(member.type), prefix + member.name
            if member.is_padding:
                pass
            elif member.type == "char":
                yield path, f"S{max(1, member.length)}", offset
            else:
                for index in range(max(1, member.length)):
                    item = f"{path}[{index}]" if member.length else path
                    if member.type in FIELD_DTYPES:
                        yield item, FIELD_DTYPES[member.type], offset + index * one
                    else:
                        yield from self._flatten(
                            self.by_name[member.type].fields, item + ".", offset + index * one
                        )
            offset += one * max(1, member.length)
