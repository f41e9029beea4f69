"""ArduPilot DataFlash logs (.BIN): recognise, and decode to columns with an account of
every byte.

The record chain is found by `dataflash_scan`, definitions are judged by
`dataflash_definitions`, records become columns in `dataflash_columns`. Values equal
those of pymavlink's DFReader; the units of `Messages.units` are those of the values.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer, Ints
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog, Messages
from auvid.stages.ingest.formats.dataflash.byte_account import (
    byte_account,
    clock_notes,
    lost_seconds,
    status_of,
)
from auvid.stages.ingest.formats.dataflash.columns import merge, unpack
from auvid.stages.ingest.formats.dataflash.definitions import (
    CONTRADICTED,
    REASONS,
    Definitions,
    Proposals,
    propose,
    settle,
)
from auvid.stages.ingest.formats.dataflash.metadata import (
    NEEDED,
    UNTIMED,
    Table,
    Units,
    parameters_of,
    texts_of,
)
from auvid.stages.ingest.formats.dataflash.scan import Chain, Walk, candidates

FORMAT = "ArduPilot DataFlash"
ROUNDS = 6  # of settling which definitions stand in the chain; two are enough unless a log is made to deceive
CONTRADICTIONS = 4

Part = tuple[
    layout.Definition, int, Ints
]  # layout, its entry in Definitions, offsets of its records


@dataclass(frozen=True)
class Index:
    """Where every record of the file is, and what it means: the result of one scan."""

    chain: Chain
    definitions: Definitions
    proposals: Proposals
    clock: npt.NDArray[np.int8]
    refused: dict[int, str]  # offset of a FMT record in the chain -> why it is not in force

    def definition(self, entry: int) -> layout.Definition:
        row = int(self.definitions.row[entry])
        return layout.FMT if row < 0 else self.proposals.definition(row)


class DataFlashReader:
    """Reader of binary DataFlash logs."""

    name = "dataflash"

    def recognises(self, head: bytes) -> bool:
        """True if the first bytes of a file hold a FMT record, at the start or behind
        damage.
        """
        data = np.frombuffer(head, np.uint8)
        offset = candidates(data)
        offset = offset[
            (data[offset + 2] == layout.FMT_ID) & (offset + layout.FMT_BYTES <= data.size)
        ]
        return head[:2] == layout.MAGIC or propose(data, offset).offset.size > 0

    def read(self, file: RawFile, wanted: frozenset[str] | None = None) -> DecodedLog:
        """Decode a log held in memory or memory-mapped.

        Args:
            file: name and bytes. wanted: message types to decode; None means all, FMT,
            FMTU, UNIT and MULT among them. All types are counted.

        Raises:
            LogError: the file is empty or holds no DataFlash record.
        """
        buffer = np.ascontiguousarray(file.buffer, np.uint8).reshape(-1)
        if buffer.size == 0:
            raise LogError(
                "the file is empty", file=file.name, remedy="Copy the log from the vehicle again."
            )
        index = build_index(buffer)
        if not (index.chain.entry >= 0).any():
            raise LogError(
                "no DataFlash record can be read",
                file=file.name,
                allowed="a log that starts with format definitions (FMT)",
                remedy=(
                    "Check that the file is an ArduPilot .BIN log and that its beginning is not cut"
                    " off."
                ),
            )
        return _decode(buffer, index, wanted)


def build_index(buffer: Buffer) -> Index:
    """Scan the file and settle its definitions: only FMT records that stand in the
    chain, and that the records bear out, are used.
    """
    offset = candidates(buffer)
    type = buffer[offset + 2]
    of_fmt = offset[type == layout.FMT_ID]
    proposals = propose(buffer, of_fmt[of_fmt + layout.FMT_BYTES <= buffer.size])
    usable = np.ones(proposals.offset.size, np.bool_)
    contradicted = np.zeros(proposals.offset.size, np.bool_)
    torn = np.zeros(proposals.offset.size, np.bool_)
    for _ in range(ROUNDS):
        definitions = settle(proposals, np.flatnonzero(usable).tolist(), torn)
        clock = _clocks(proposals, definitions)
        chain = Walk(buffer, offset, type, definitions, clock, proposals.offset).run()
        in_chain = np.isin(proposals.offset, chain.offset[chain.type == layout.FMT_ID])
        contradicted[_contradicted(chain, definitions)] = True
        believed = usable & in_chain & ~contradicted
        beside = _beside_gaps(proposals, chain)
        if (believed == usable).all() and (beside == torn).all():
            break
        usable, torn = believed, beside
    refused = dict.fromkeys(proposals.offset[in_chain & contradicted].tolist(), CONTRADICTED)
    unsound = np.isin(proposals.unsound, chain.offset[chain.type == layout.FMT_ID])
    reasons = [REASONS[code] for code in proposals.reason[unsound].tolist()]
    refused.update(zip(proposals.unsound[unsound].tolist(), reasons, strict=True))
    return Index(chain, definitions, proposals, clock, refused)


def _beside_gaps(proposals: Proposals, chain: Chain) -> npt.NDArray[np.bool_]:
    """True for the FMT records that touch damaged bytes, so that they may be two halves
    of different ones.
    """
    edges = [edge for gap in chain.gaps for edge in (gap.start - layout.FMT_BYTES, gap.stop)]
    return np.isin(proposals.offset, np.array(edges, np.int64))


def _clocks(proposals: Proposals, definitions: Definitions) -> npt.NDArray[np.int8]:
    """The kind of time stamp of each definition (1 TimeUS, 2 TimeMS, 0 none), then a 0
    for undefined types.
    """
    raw = proposals.raw[definitions.row[1:]]
    clock = np.zeros(definitions.row.size + 1, np.int8)
    for code, char, label in ((1, b"Q", b"TimeUS"), (2, b"I", b"TimeMS")):
        start = np.frombuffer(label, np.uint8)
        named = (raw[:, 25 : 25 + start.size] == start).all(axis=1) & np.isin(
            raw[:, 25 + start.size], (0, ord(","))
        )
        clock[1:-1][named & (raw[:, 9] == ord(char))] = code
    return clock


def _contradicted(chain: Chain, definitions: Definitions) -> list[int]:
    """Rows of the definitions whose length must be wrong.

    More often than not their records do not fit the chain, and mostly the next header
    stands at one and the same other distance.
    """
    defined = chain.failed > 0
    if np.count_nonzero(defined) < CONTRADICTIONS:
        return []
    fails = np.bincount(chain.failed[defined], minlength=definitions.row.size)
    taken = np.bincount(chain.entry[chain.entry >= 0], minlength=definitions.row.size)
    distances = np.split(
        chain.distance[defined][np.argsort(chain.failed[defined], kind="stable")],
        np.cumsum(fails)[:-1],
    )
    rows = []
    for entry in np.flatnonzero((fails >= CONTRADICTIONS) & (2 * fails > taken)).tolist():
        distance, votes = np.unique(distances[entry], return_counts=True)
        if 2 * votes.max() > fails[entry] and distance[votes.argmax()] != definitions.length[entry]:
            rows.append(int(definitions.row[entry]))
    return rows


def _decode(buffer: Buffer, index: Index, wanted: frozenset[str] | None) -> DecodedLog:
    groups = _groups(index)
    names = set(groups) if wanted is None else wanted & set(groups)
    tables = {
        name: _columns(buffer, parts)
        for name, parts in groups.items()
        if name in names or name in NEEDED
    }
    units = _units(index, groups, tables, names)
    defining = [entry for name in layout.DEFINITION_NAMES for _, entry, _ in groups.get(name, ())]
    account = byte_account(
        buffer, index.chain, index.definitions.length[:-1], defining, index.refused
    )
    return DecodedLog(
        format=FORMAT,
        messages={
            name: Messages(name, *tables[name], units[name]) for name in groups if name in names
        },
        counts={name: sum(offset.size for _, _, offset in parts) for name, parts in groups.items()},
        account=account,
        status=status_of(account),
        seconds_lost=lost_seconds(buffer, index.chain, index.clock),
        parameters=parameters_of(tables.get("PARM")),
        texts=texts_of(tables.get("MSG")),
        notes=tuple(_notes(buffer, index, groups)),
    )


def _groups(index: Index) -> dict[str, list[Part]]:
    """For each message name in alphabetical order its layouts, each with its entry and
    the offsets of its records.
    """
    entry = index.chain.entry
    narrow = (
        entry.astype(np.int16) if index.definitions.row.size < 1 << 15 else entry
    )  # 16 bits are sorted by radix
    order = np.argsort(narrow, kind="stable")
    offset = index.chain.offset[order]
    stops = np.searchsorted(
        entry[order], np.arange(index.definitions.row.size), side="right"
    ).tolist()
    start = int((entry < 0).sum())
    groups: dict[str, list[Part]] = {}
    for number, stop in enumerate(stops):
        if stop > start:
            definition = index.definition(number)
            groups.setdefault(definition.name, []).append((definition, number, offset[start:stop]))
        start = stop
    return dict(sorted(groups.items()))


def _columns(buffer: Buffer, parts: list[Part]) -> Table:
    tables = [(unpack(buffer, definition, offset), offset) for definition, _, offset in parts]
    return tables[0] if len(tables) == 1 else merge(tables)


def _units(
    index: Index, groups: dict[str, list[Part]], tables: Mapping[str, Table], names: Iterable[str]
) -> dict[str, dict[str, str]]:
    units = Units.of(tables)
    texts: dict[str, dict[str, str]] = {name: {} for name in names}
    for name in texts:
        for definition, entry, _ in groups[name]:
            begins, entries = index.definitions.changes.get(
                definition.id, (np.zeros(0, np.int64), np.zeros(0, np.int32))
            )
            later = begins[entries.searchsorted(np.int32(entry), side="right") :]
            texts[name].update(units.texts(definition, int(later[0]) if later.size else None))
    return texts


def _notes(buffer: Buffer, index: Index, groups: dict[str, list[Part]]) -> list[str]:
    notes = clock_notes(buffer, index.chain, index.clock)
    if set(groups) <= layout.DEFINITION_NAMES:
        notes.append("The log holds definitions only, no recorded data.")
    several = [name for name, parts in groups.items() if len(parts) > 1]
    if several:
        notes.append(f"Declared with several layouts, joined by field name: {', '.join(several)}.")

    def is_timed(part: Part) -> bool:
        return (
            bool(index.clock[part[1]]) or "T" in part[0].columns
        )  # GPS records of old firmware have it as T

    timeless = [
        name
        for name, parts in groups.items()
        if name not in UNTIMED and not any(map(is_timed, parts))
    ]
    if timeless:
        notes.append(f"Without a time field of the vehicle's clock: {', '.join(timeless)}.")
    return notes


DATAFLASH = DataFlashReader()
