"""What every log reader returns: columns by message type, and an account of every byte
of the file.

A reader is a value with two functions (`LogReader`): `recognises` looks at the first
bytes, `read` decodes. A new format is one new module with such a value, named in
`stages/ingest/readers.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from auvid.stages.base import RawFile

LogStatus = Literal["complete", "truncated", "damaged"]


@dataclass(frozen=True)
class Messages:
    """All records of one message type as columns of equal length, in file order.

    Values are in the unit that the format declares (multipliers applied), not yet SI
    and not yet in auvid's frames. Strings are fixed-width bytes (dtype `S`), cut at the
    first NUL. Array fields are two-dimensional. `offset` is the byte offset of each
    record in its file. `units` holds the unit text of the format where it gives one.
    """

    name: str
    columns: Mapping[str, npt.NDArray[np.generic]]
    offset: npt.NDArray[np.int64]
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return int(self.offset.size)


@dataclass(frozen=True)
class Skipped:
    """Bytes (or records) that gave nothing: why, how many bytes in how many places, and
    the first and last offset.
    """

    reason: str
    bytes: int
    count: int
    first_offset: int
    last_offset: int


@dataclass(frozen=True)
class ByteAccount:
    """Every input byte is in exactly one of records, definitions, skipped; their sum is
    the size of the file.
    """

    size: int
    record_bytes: int
    definition_bytes: int
    skipped: tuple[Skipped, ...] = ()

    @property
    def skipped_bytes(self) -> int:
        return sum(part.bytes for part in self.skipped)


@dataclass(frozen=True)
class DecodedLog:
    """A decoded log file.

    `messages` holds the decoded types only; `counts` the number of records of every
    type in the file, decoded or not. `parameters` are the last values of the vehicle's
    parameters, `texts` the (time_us, text) messages of the vehicle. `seconds_lost` is
    the recording time covered by damage, as far as the clock on either side shows it.
    `notes` are sentences about the file that a user should read (an odd clock, a
    missing time field, other vehicles).
    """

    format: str
    messages: Mapping[str, Messages]
    counts: Mapping[str, int]
    account: ByteAccount
    status: LogStatus
    seconds_lost: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    texts: tuple[tuple[int, str], ...] = ()
    notes: tuple[str, ...] = ()


class LogReader(Protocol):
    """Recognise a log by its content, and read it. `wanted` names the message types to
    decode; None means all.
    """

    @property
    def name(self) -> str: ...

    def recognises(self, head: bytes) -> bool: ...

    def read(self, file: RawFile, wanted: frozenset[str] | None = None) -> DecodedLog: ...
