"""Bytes of a ULog file that gave nothing, and the reasons."""

from __future__ import annotations

from typing import NamedTuple

HEADER_DAMAGED = "damaged file header"
DAMAGED = "damaged bytes"
NO_SUBSCRIPTION = "data without a subscription of their number"
WRONG_SIZE = "data whose size does not fit their format"
CUT_OFF = "message cut off by the end of the file"
CUT_BY_APPENDED = "message cut off where appended data begin"
BLANK = "zero bytes"
BLANK_END = "zero bytes at the end of the file"
UNKNOWN_TYPE = "message of an unknown type"
UNREADABLE = "message whose content cannot be read"
HARMLESS = (CUT_BY_APPENDED, UNKNOWN_TYPE)


class SkippedBytes(NamedTuple):
    """Buffer `start:stop` that gave nothing, and why."""

    start: int
    stop: int
    reason: str
