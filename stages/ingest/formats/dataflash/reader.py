"""ArduPilot DataFlash logs (.BIN): recognise, and decode to columns.

`scan` finds the record chain, `definitions` judges definitions, `columns` unpacks
records, `byte_account` accounts for every byte. Values equal those of pymavlink's
DFReader; the units of `Messages.units` are those of the values.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.errors import LogError
from auvid.data_schemas.formats import dataflash as layout
from auvid.hydro.arrays import Buffer, Ints, Mask
from auvid.hydro.long_series.long_arrays import laid_down
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog, LogReader, Messages
from auvid.stages.ingest.formats.accounting import split_by
from auvid.stages.ingest.formats.dataflash.byte_account import (
    byte_account,
    clock_notes,
    lost_seconds,
)
from auvid.stages.ingest.formats.dataflash.columns import Table, merge, unpack
from auvid.stages.ingest.formats.dataflash.definitions import (
    CONTRADICTED,
    REASONS,
    Definitions,
    Proposals,
    propose,
    resolve,
)
from auvid.stages.ingest.formats.dataflash.metadata import (
    METADATA,
    Units,
    layout_notes,
    parameters_of,
    texts_of,
)
from auvid.stages.ingest.formats.dataflash.scan import Chain, Clock, Walk, candidates, types_at

FORMAT = "ArduPilot DataFlash"
ROUNDS = 6
"""Rounds of deciding which definitions stand in the chain; two are enough unless a log
is made to deceive.
"""
CONTRADICTIONS = 4
REMEDY = "Check that the file is an ArduPilot .BIN log and that its beginning is not cut off."
EMPTY = (np.zeros(0, np.int64), np.zeros(0, np.int32))

# Layout, its entry in Definitions, offsets of its records.
Layout = tuple[layout.Definition, int, Ints]


@dataclass(frozen=True)
class Index:
    """Place and meaning of every record of a file: the result of one scan."""

    chain: Chain
    definitions: Definitions
    proposals: Proposals
    clock: Clock
    refused: dict[int, str]  # offset of a FMT record in the chain -> why it is not in force

    def definition(self, entry: int) -> layout.Definition:
        row = int(self.definitions.row[entry])
        return layout.FMT if row < 0 else self.proposals.definition(row)


def recognises(head: bytes) -> bool:
    """Return whether a FMT record stands in the first bytes, behind damage or not."""
    data = np.frombuffer(head, np.uint8)
    if head[:2] == layout.MAGIC:
        return True
    offset = candidates(data)
    return _whole_fmt(data, offset, types_at(data, offset)).offset.size > 0


def decode_dataflash(file: RawFile, message_types: frozenset[str] | None) -> DecodedLog:
    """Decode the `message_types` of a binary log, FMT, FMTU, UNIT and MULT among them.

    Raises:
        LogError: the file holds no DataFlash record.
    """
    index = build_index(file.buffer)
    if not (index.chain.entry >= 0).any():
        raise LogError(
            "no DataFlash record can be read",
            file=file.name,
            allowed="a log that starts with format definitions (FMT)",
            remedy=REMEDY,
        )
    return _decode(file.buffer, index, message_types)


def _whole_fmt(buffer: Buffer, offset: Ints, type: Buffer) -> Proposals:
    """Return the FMT records among the candidates that are whole inside the buffer."""
    fmt = offset[type == layout.FMT_ID]
    return propose(buffer, fmt[fmt + layout.FMT_BYTES <= buffer.size])


def build_index(buffer: Buffer) -> Index:
    """Scan the file and decide which definitions hold.

    Only FMT records that stand in the chain, and that the records confirm, are used.
    """
    offset = candidates(buffer)
    type = types_at(buffer, offset)
    proposals = _whole_fmt(buffer, offset, type)
    usable, contradicted, torn = np.zeros((3, proposals.offset.size), np.bool_)
    usable[:] = True
    for _ in range(ROUNDS):
        definitions = resolve(proposals, np.flatnonzero(usable).tolist(), torn)
        clock = _clocks(proposals, definitions)
        chain = Walk(buffer, offset, type, definitions, clock, proposals.offset).run()
        in_chain = np.isin(proposals.offset, chain.offset[chain.type == layout.FMT_ID])
        contradicted[_contradicted(chain, definitions)] = True
        confirmed = usable & in_chain & ~contradicted
        touching = _touching_gaps(proposals, chain)
        if (confirmed == usable).all() and (touching == torn).all():
            break
        usable, torn = confirmed, touching
    refused = dict.fromkeys(proposals.offset[in_chain & contradicted].tolist(), CONTRADICTED)
    unsound = np.isin(proposals.unsound, chain.offset[chain.type == layout.FMT_ID])
    reasons = [REASONS[code] for code in proposals.reason[unsound].tolist()]
    refused.update(zip(proposals.unsound[unsound].tolist(), reasons, strict=True))
    return Index(chain, definitions, proposals, clock, refused)


def _touching_gaps(proposals: Proposals, chain: Chain) -> Mask:
    """Return which FMT records touch damaged bytes: maybe halves of two."""
    edges = [edge for gap in chain.gaps for edge in (gap.start - layout.FMT_BYTES, gap.stop)]
    return np.isin(proposals.offset, np.array(edges, np.int64))


def _clocks(proposals: Proposals, definitions: Definitions) -> Clock:
    """Return the kind of time stamp of each definition (1 TimeUS, 2 TimeMS, 0 none).

    A last 0 serves undefined types.
    """
    raw = proposals.raw[definitions.row[1:]]
    clock = np.zeros(definitions.row.size + 1, np.int8)
    for code, char, label in ((1, b"Q", b"TimeUS"), (2, b"I", b"TimeMS")):
        first = raw[:, 25 : 25 + len(label)] == np.frombuffer(label, np.uint8)
        ends_label = np.isin(raw[:, 25 + len(label)], (0, ord(",")))
        clock[1:-1][first.all(axis=1) & ends_label & (raw[:, 9] == ord(char))] = code
    return clock


def _contradicted(chain: Chain, definitions: Definitions) -> list[int]:
    """Return the rows of the definitions whose length must be wrong.

    More often than not their records do not fit the chain, and mostly the next header
    stands at one and the same other distance.
    """
    defined = chain.failed > 0
    entries, distances = chain.failed[defined], chain.distance[defined]
    fails = np.bincount(entries, minlength=definitions.row.size)
    records = np.bincount(chain.entry[chain.entry >= 0], minlength=definitions.row.size)
    rows = []
    for entry in np.flatnonzero((fails >= CONTRADICTIONS) & (2 * fails > records)).tolist():
        distance, votes = np.unique(distances[entries == entry], return_counts=True)
        if 2 * votes.max() > fails[entry] and distance[votes.argmax()] != definitions.length[entry]:
            rows.append(int(definitions.row[entry]))
    return rows


def _decode(buffer: Buffer, index: Index, message_types: frozenset[str] | None) -> DecodedLog:
    layouts = _layouts(index)
    names = set(layouts) if message_types is None else message_types & set(layouts)
    tables = {
        name: merge(
            [(unpack(buffer, definition, offset), offset) for definition, _, offset in parts]
        )
        for name, parts in layouts.items()
        if name in names or name in METADATA
    }
    units = _units(index, layouts, tables, names)
    defining = [entry for name in layout.DEFINITION_NAMES for _, entry, _ in layouts.get(name, ())]
    account, status = byte_account(
        buffer, index.chain, index.definitions.length[:-1], defining, index.refused
    )
    kinds = {
        name: [(definition, int(index.clock[entry])) for definition, entry, _ in parts]
        for name, parts in layouts.items()
    }
    return DecodedLog(
        format=FORMAT,
        messages={
            name: Messages(name, *tables[name], units[name]) for name in layouts if name in names
        },
        counts={name: sum(offset.size for *_, offset in parts) for name, parts in layouts.items()},
        account=account,
        status=status,
        seconds_lost=lost_seconds(buffer, index.chain, index.clock),
        parameters=parameters_of(tables.get("PARM")),
        texts=texts_of(tables.get("MSG")),
        notes=layout_notes(kinds, clock_notes(buffer, index.chain, index.clock)),
    )


def _layouts(index: Index) -> dict[str, list[Layout]]:
    """Return the layouts of each message name, in alphabetical order."""
    groups: dict[str, list[Layout]] = {}
    for entry, rows in enumerate(split_by(index.chain.entry, index.definitions.row.size)):
        if rows.size:
            definition = index.definition(entry)
            part = (definition, entry, laid_down(index.chain.offset[rows]))
            groups.setdefault(definition.name, []).append(part)
    return dict(sorted(groups.items()))


def _units(
    index: Index,
    layouts: Mapping[str, list[Layout]],
    tables: Mapping[str, Table],
    names: Iterable[str],
) -> dict[str, dict[str, str]]:
    units = Units.of(tables)
    texts: dict[str, dict[str, str]] = {name: {} for name in names}
    for name in texts:
        for definition, entry, _ in layouts[name]:
            begins, entries = index.definitions.changes.get(definition.id, EMPTY)
            later = begins[entries.searchsorted(np.int32(entry), side="right") :]
            texts[name].update(units.texts(definition, int(later[0]) if later.size else None))
    return texts


DATAFLASH = LogReader("dataflash", recognises, decode_dataflash)
