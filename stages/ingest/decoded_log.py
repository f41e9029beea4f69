"""Columns by message type and an account of every byte: what a log reader returns.

A reader is a value (`LogReader`) with two functions: `recognises` looks at the first
bytes, `decode` reads the file. docs/streams.md says what a new format needs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.errors import LogError
from auvid.hydro.arrays import Array, Ints
from auvid.stages.base import RawFile

LogStatus = Literal["complete", "truncated", "damaged"]
Column = npt.NDArray[np.generic]


@dataclass(frozen=True)
class Messages:
    """All records of one message type as columns of equal length, in file order.

    Values are in the unit that the format declares (multipliers applied), not yet SI
    and not yet in auvid's frames. Strings are fixed-width bytes (dtype `S`), cut at the
    first NUL. Array fields are two-dimensional. `offset` is the byte offset of each
    record in its file. `units` holds the unit text of the format where it gives one.
    """

    name: str
    columns: Mapping[str, Column]
    offset: Ints
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return int(self.offset.size)

    def floats(self, name: str) -> Array:
        """Return a column as float64; damage can leave a signalling NaN in it."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.columns[name], dtype=np.float64)

    def ints(self, name: str) -> Ints:
        """Return a column as int64."""
        return np.asarray(self.columns[name]).astype(np.int64)

    def rows(self, rows: npt.NDArray[np.generic]) -> Messages:
        """Return some of the records."""
        columns = {key: values[rows] for key, values in self.columns.items()}
        return replace(self, columns=columns, offset=self.offset[rows])


@dataclass(frozen=True)
class Skipped:
    """Bytes (or records) that gave nothing, for one reason.

    How many bytes in how many places, and the first and last offset.
    """

    reason: str
    bytes: int
    count: int
    first_offset: int
    last_offset: int


@dataclass(frozen=True)
class ByteAccount:
    """Bytes of a file: each is in exactly one of records, definitions, skipped."""

    size: int
    record_bytes: int
    definition_bytes: int
    skipped: tuple[Skipped, ...] = ()

    @property
    def skipped_bytes(self) -> int:
        """Return the bytes that gave nothing."""
        return sum(part.bytes for part in self.skipped)


@dataclass(frozen=True)
class DecodedLog:
    """A decoded log file.

    `messages` holds the decoded types only; `counts` the number of records of every
    type in the file, decoded or not. `parameters` are the last values of the vehicle's
    parameters, `texts` the (time_us, text) messages of the vehicle. `seconds_lost` is
    the recording time covered by damage, as far as the clock on either side tells.
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

    def get(self, name: str, *columns: str) -> Messages | None:
        """Return a message type if it has records with all these columns, else None."""
        messages = self.messages.get(name)
        there = messages is not None and len(messages) and set(columns) <= set(messages.columns)
        return messages if there else None


@dataclass(frozen=True)
class LogReader:
    """One log format: how to recognise a file by its first bytes, and how to read it.

    `decode` takes the message types to decode (None: all); all types are counted.
    """

    name: str
    recognises: Callable[[bytes], bool]
    decode: Callable[[RawFile, frozenset[str] | None], DecodedLog]

    def read(self, file: RawFile, message_types: frozenset[str] | None = None) -> DecodedLog:
        """Decode a log held in memory or memory-mapped.

        Raises:
            LogError: the file is empty, or nothing of it can be read as this format.
        """
        buffer = np.ascontiguousarray(file.buffer, np.uint8).reshape(-1)
        if not buffer.size:
            remedy = "Copy the log from the vehicle again."
            raise LogError("the file is empty", file=file.name, remedy=remedy)
        return self.decode(replace(file, content=buffer), message_types)
