"""Contents of ULog messages that are not data: what they mean, if credible.

ULog has no checksum. Every function here returns None (or False) for content that
breaks a rule of its type, so that a reader which lost the chain does not take damage
for a message.
"""

from __future__ import annotations

import re
import struct
from typing import NamedTuple

from auvid.data_schemas.formats import ulog as layout

_KEY = re.compile(rb"([A-Za-z_]\w{0,63}+)(?:\[([0-9]{1,5})\])?+ ([!-~]{1,254}+)")
_TEXT = re.compile(rb"[^\x00-\x08\x0b\x0c\x0e-\x1a\x1c-\x1f\x7f]*+\x00*+")
_NAME = re.compile(rb"[A-Za-z_][\w/-]{0,127}+")
LONGEST_SUBSCRIPTION = 3 + 128
LATEST_TEXT_US = 1 << 52  # 142 years


class Subscription(NamedTuple):
    """Number `id` stands for instance `instance` of `topic` from here on."""

    id: int
    instance: int
    topic: str


def information(content: bytes) -> bool:
    """Check an `I` message: key length, `type name`, value.

    Characters up to the first NUL must be text.
    """
    entry = _value(content)
    return entry is not None and (
        entry[0] != "char" or _TEXT.fullmatch(entry[3].split(b"\0", 1)[0]) is not None
    )


def information_multiple(content: bytes) -> bool:
    """Check an `M` message: 0 or 1, then as `I`."""
    return content[:1] in (b"\x00", b"\x01") and information(content[1:])


def parameter(content: bytes) -> tuple[str, float] | None:
    """Return name and value that a `P` message sets."""
    entry = _value(content)
    if entry is None or entry[0] not in ("float", "int32_t") or entry[1] is not None:
        return None
    (value,) = struct.unpack("<f" if entry[0] == "float" else "<i", entry[3])
    return entry[2], float(value)


def parameter_default(content: bytes) -> bool:
    """Check a `Q` message: bit mask of the kinds of default, then as `P`."""
    return content[:1] not in (b"", b"\x00") and parameter(content[1:]) is not None


def _value(content: bytes) -> tuple[str, int | None, str, bytes] | None:
    """Return type, array length, name and value bytes.

    None if the length of the value does not fit its type.
    """
    if len(content) < 2:
        return None
    match = _KEY.fullmatch(content, 1, 1 + content[0])
    if match is None:
        return None
    kind, length = match[1].decode("ascii"), None if match[2] is None else int(match[2])
    value = content[1 + content[0] :]
    if len(value) != layout.FIELD_BYTES.get(kind, 0) * (1 if length is None else length):
        return None
    return kind, length, match[3].decode("ascii"), value


def subscription(content: bytes) -> Subscription | None:
    """Return what an `A` message subscribes."""
    if not 4 <= len(content) <= LONGEST_SUBSCRIPTION or _NAME.fullmatch(content, 3) is None:
        return None
    instance, id = struct.unpack_from("<BH", content)
    return Subscription(id, instance, content[3:].decode("ascii"))


def logged_text(content: bytes, *, tagged: bool) -> tuple[int, str] | None:
    """Return time in us and text of an `L` message, or of a `C` message (`tagged`).

    The content is level, two bytes of tag if it has one, time in us, text.
    """
    level, rest = content[:1], content[3 if tagged else 1 :]
    if not level or (level not in b"01234567" and level[0] > 7) or len(rest) < 8:
        return None
    time_us = int.from_bytes(rest[:8], "little")
    if time_us >= LATEST_TEXT_US or _TEXT.fullmatch(rest, 8) is None:
        return None
    return time_us, rest[8:].rstrip(b"\0").decode("utf-8", "replace")
