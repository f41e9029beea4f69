"""Definitions of a DataFlash log: which FMT records hold, and where in the file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer, Ints, Mask

WRONG_LENGTH = "definition whose length does not match its format"
WRONG_COLUMNS = "definition whose field names do not match its format"
UNKNOWN_FORMAT = "definition with an unknown format character"
UNNAMED = "definition without a readable name"
WRONG_FMT = "definition of FMT itself with another layout"
CONTRADICTED = "definition contradicted by the records"
REASONS = ("", UNNAMED, WRONG_COLUMNS, WRONG_LENGTH, UNKNOWN_FORMAT, WRONG_FMT, CONTRADICTED)

Entries = npt.NDArray[np.int32]
ROWS = 4096  # FMT records judged at a time
LABELS_START = 25  # in a FMT record, behind header, id, length, name and formats
DAMAGED_LABEL_BYTES = 2  # two firmwares that name fields of one format differently differ in more


@dataclass(frozen=True)
class Proposals:
    """FMT records at the header candidates, whether or not in the record chain.

    `offset` and `raw` (the 89 bytes) have one row per FMT that agrees with itself;
    `unsound` and `reason` (into REASONS) one per other.
    """

    offset: Ints
    raw: Buffer
    unsound: Ints
    reason: npt.NDArray[np.int8]

    def definition(self, row: int) -> layout.Definition:
        record = self.raw[row].tobytes()
        formats = _text(record[9:25])
        columns = _text(record[25:89])
        names = tuple(columns.split(",")) if columns else ()
        return layout.Definition(
            record[3], record[4], _text(record[5:9]), formats, names[: len(formats)]
        )


def _text(raw: bytes) -> str:
    return raw.split(b"\0", 1)[0].decode("ascii", "backslashreplace")


def propose(buffer: Buffer, offsets: Ints) -> Proposals:
    """Parse the FMT records at `offsets` and judge each by itself.

    All of them are whole inside the buffer.
    """
    raws, reasons = [np.zeros((0, layout.FMT_BYTES), np.uint8)], [np.zeros(0, np.int8)]
    for start in range(0, offsets.size, ROWS):
        raw = buffer[offsets[start : start + ROWS, None] + np.arange(layout.FMT_BYTES)]
        reasons.append(judge(raw))
        raws.append(raw[reasons[-1] == 0])
    reason = np.concatenate(reasons)
    return Proposals(
        offsets[reason == 0], np.concatenate(raws), offsets[reason > 0], reason[reason > 0]
    )


def judge(raw: Buffer) -> npt.NDArray[np.int8]:
    """Return the reason to refuse each FMT record (one row of 89 bytes).

    It is an index into REASONS; 0 if the record agrees with itself.
    """
    formats, columns, name = raw[:, 9:25], raw[:, 25:89], raw[:, 5:9]
    in_format, in_columns, in_name = (
        np.logical_and.accumulate(part != 0, axis=1) for part in (formats, columns, name)
    )
    sizes = layout.FIELD_BYTES[formats]
    fields = in_format.sum(axis=1)
    names = ((columns == ord(",")) & in_columns).sum(axis=1) + in_columns[:, 0]
    # Sixty-four bytes without a NUL are a list of names that was cut off: the fields
    # that have a name are still sound.
    cut_off = in_columns.all(axis=1) & (names < fields)
    of_fmt = raw[:, 3] == layout.FMT_ID
    reason = np.zeros(raw.shape[0], np.int8)
    for code, fault in (
        (1, ~in_name[:, 0] | (in_name & ((name < 0x20) | (name > 0x7E))).any(axis=1)),
        (
            2,
            ((names != fields) & ~cut_off)
            | (in_columns & ((columns < 0x20) | (columns > 0x7E))).any(axis=1),
        ),
        (3, raw[:, 4] != layout.HEADER_BYTES + (sizes * in_format).sum(axis=1)),
        (4, ((sizes == 0) & in_format).any(axis=1)),
    ):
        reason[fault & ~of_fmt] = code
    reason[of_fmt & (raw[:, 4] != layout.FMT_BYTES)] = 5
    return reason


@dataclass(frozen=True)
class Definitions:
    """Definitions in force; entry 0 is FMT.

    `first[id]` is the entry for an id before any redefinition (-1: undefined).

    `length[entry]` is the size of a record; a last 0 in it serves entry -1.

    `changes[id]` holds, for an id declared with several layouts, the offsets where each
    begins and its entry. `row[entry]` is the row in `Proposals` (-1 for the built-in
    FMT).
    """

    first: Entries
    length: Entries
    row: Ints
    changes: dict[int, tuple[Ints, Entries]]

    def entries(self, offset: Ints, types: Buffer) -> Entries:
        """Return the entry that holds for each type at each offset (ascending).

        It is -1 where the type is undefined. A record before the first definition of
        its type is read with that definition.
        """
        entry = self.first[types]
        for id, (begins, entries) in self.changes.items():
            where = np.flatnonzero(types == id)
            entry[where] = entries[
                np.maximum(np.searchsorted(begins, offset[where], side="right") - 1, 0)
            ]
        return entry


def _is_repetition(before: bytes, after: bytes, *, new_log: bool) -> bool:
    """Return whether two FMT records declare the same.

    Only the field names may differ, and those by no more than `DAMAGED_LABEL_BYTES` if
    a new log, perhaps of another firmware, begins between the two. Within one log no
    type is declared with other names.
    """
    if before[:LABELS_START] != after[:LABELS_START]:
        return False
    differences = sum(one != other for one, other in zip(before, after, strict=True))
    return not new_log or differences <= DAMAGED_LABEL_BYTES


def resolve(proposals: Proposals, rows: Iterable[int], torn: Mask) -> Definitions:
    """Put the proposals `rows` (ascending) in force.

    A repeated declaration is no change, nor is one with other field names in the same
    log: that is a damaged repetition, and of the two the first holds unless it is
    `torn` (touches damage) and the other is not.
    """
    first = np.full(256, -1, np.int32)
    first[layout.FMT_ID] = 0
    kept = [-1]
    current: dict[int, tuple[bytes, int]] = {}  # id -> FMT record in force, number of its log
    changes: dict[int, list[tuple[int, int]]] = {}
    log = 0
    for row in rows:
        identity = proposals.raw[row].tobytes()
        id = identity[3]
        if id == layout.FMT_ID:
            log += 1
            continue
        before, of_log = current.get(id, (b"", log))
        if before and _is_repetition(before, identity, new_log=of_log != log):
            entry = changes[id][-1][1]
            if torn[kept[entry]] and not torn[row]:
                kept[entry] = row
                current[id] = (identity, log)
            continue
        if not before:
            first[id] = len(kept)
        current[id] = (identity, log)
        changes.setdefault(id, []).append((int(proposals.offset[row]), len(kept)))
        kept.append(row)
    several = {
        id: (np.array(begins, np.int64), np.array(entries, np.int32))
        for id, steps in changes.items()
        if len(steps) > 1
        for begins, entries in [zip(*steps, strict=True)]
    }
    lengths = [proposals.raw[row, 4] for row in kept[1:]]
    return Definitions(
        first,
        np.array([layout.FMT_BYTES, *lengths, 0], np.int32),
        np.array(kept, np.int64),
        several,
    )
