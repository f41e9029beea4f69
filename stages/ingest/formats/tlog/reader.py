"""MAVLink telemetry logs (.tlog), as ground stations record them.

Every frame is checked by its checksum; columns equal pymavlink's decoding field by
field. One table holds one sender: the chosen vehicle's autopilot, or, for types that it
does not send, the component of no other vehicle that sends most of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import mavlink
from auvid.hydro.arrays import Buffer
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog, LogReader
from auvid.stages.ingest.formats.accounting import split_by
from auvid.stages.ingest.formats.tlog.byte_account import explain
from auvid.stages.ingest.formats.tlog.clock import YEAR_2000_US, leap_notes
from auvid.stages.ingest.formats.tlog.columns import decode, parameters, status_texts
from auvid.stages.ingest.formats.tlog.frames import Frames, frames_at, places, proven

Sender = tuple[int, int]
HEAD_BYTES = 8192
_PARTS = ("PARAM_VALUE", "STATUSTEXT")
GROUND_STATION = 6
_ROLES = {
    GROUND_STATION: "ground station",
    18: "companion computer",
    26: "gimbal",
    27: "ADSB",
    30: "camera",
}  # MAV_TYPE


@dataclass(frozen=True)
class Senders:
    """Senders of a log: messages by sender and by type, heartbeats, the chosen one.

    `heartbeat` holds MAV_AUTOPILOT and MAV_TYPE.
    """

    counts: dict[Sender, int]
    by_type: dict[str, int]
    heartbeat: dict[Sender, tuple[int, int]]
    chosen: Sender | None

    @property
    def vehicles(self) -> list[Sender]:
        """Return the autopilots, those with most messages first."""
        pilots = [
            sender
            for sender, (autopilot, _) in self.heartbeat.items()
            if autopilot != mavlink.AUTOPILOT_INVALID
        ]
        return sorted(pilots, key=lambda sender: (-self.counts[sender], sender))


def recognises(head: bytes) -> bool:
    """Return whether the first bytes are a frame or hold two frames in a row.

    Where their time stamps are not of this century, as those of a recorder whose clock was
    never set, their checksums must be right.
    """
    buffer = np.frombuffer(head[:HEAD_BYTES], dtype=np.uint8)
    frames = frames_at(buffer, places(buffer, 0, HEAD_BYTES))
    frames = frames.take(frames.length > 0)
    frames = frames.take((frames.stamp >= YEAR_2000_US) | proven(buffer, frames))
    if np.any(np.isin(frames.stop, frames.start)):
        return True
    return bool(len(frames) and frames.start[0] == 0 and frames.stop[0] >= len(head))


def decode_tlog(
    file: RawFile, message_types: frozenset[str] | None, *, system: int | None = None
) -> DecodedLog:
    """Decode the `message_types`; damage is counted, never an error.

    `system` chooses the vehicle by its MAVLink system id (None: the one with most
    messages).
    """
    buffer = file.buffer
    content = explain(buffer)
    senders = _senders(buffer, content.records, system)
    notes = (
        *_sender_notes(senders, system),
        *_frame_notes(
            content.recut, "read although a router cut trailing zeros after the checksum was made"
        ),
        *_frame_notes(content.mismatched, "wrong checksum, not read"),
        *leap_notes(content.records.stamp, content.records.start),
    )
    account, status, seconds_lost = content.account, content.status, content.seconds_lost
    groups = _by_type(content.records, senders, message_types)
    # The records are copied in groups: columns and both copies would be the peak of memory.
    del content
    tables = {}
    for frames in groups:
        table = decode(buffer, frames, mavlink.layout(int(frames.message_id[0])))
        tables[table.name] = table
    px4 = mavlink.AUTOPILOT_PX4 in senders.heartbeat.get(senders.chosen or (0, 0), ())[:1]
    values, texts = (tables.get(name) for name in _PARTS)
    return DecodedLog(
        format="tlog",
        messages={
            name: table
            for name, table in tables.items()
            if message_types is None or name in message_types
        },
        counts=senders.by_type,
        account=account,
        status=status,
        seconds_lost=seconds_lost,
        parameters=parameters(values, bytewise=px4) if values else {},
        texts=status_texts(texts) if texts else (),
        notes=notes,
    )


def _keys(frames: Frames) -> npt.NDArray[np.uint16]:
    return frames.system.astype(np.uint16) << np.uint16(8) | frames.component


def _count_senders(frames: Frames) -> dict[Sender, int]:
    counts = np.bincount(_keys(frames))
    return {(key >> 8, key & 0xFF): int(counts[key]) for key in np.flatnonzero(counts).tolist()}


def _senders(buffer: Buffer, records: Frames, system: int | None) -> Senders:
    counts = _count_senders(records)
    names = mavlink.definitions()
    ids = np.bincount(records.message_id)
    by_type = {
        str(names[number].msgname): int(ids[number]) for number in np.flatnonzero(ids).tolist()
    }
    heartbeat: dict[Sender, tuple[int, int]] = {}
    beats = records.take(records.message_id == 0)
    if len(beats):
        columns = decode(buffer, beats, mavlink.layout(0)).columns
        four = np.stack(
            [columns[name] for name in ("sysid", "compid", "autopilot", "type")], axis=1
        )
        rows, times = np.unique(four.view(">u4"), return_counts=True)
        for row in np.argsort(times, kind="stable"):
            sysid, compid, autopilot, kind = int(rows[row]).to_bytes(4, "big")
            heartbeat[sysid, compid] = (autopilot, kind)
    vehicles = Senders(counts, by_type, heartbeat, None).vehicles
    if system is not None:
        others = [sender for sender in counts if sender[0] == system]
        vehicles = [sender for sender in vehicles if sender[0] == system]
    else:
        others = [sender for sender in counts if heartbeat.get(sender, (0, 0))[1] != GROUND_STATION]
        others = others or list(counts)
    most = max(others, key=lambda sender: (counts[sender], sender), default=None)
    chosen = vehicles[0] if vehicles else most
    return Senders(counts, by_type, heartbeat, chosen)


def _by_type(
    records: Frames, senders: Senders, message_types: frozenset[str] | None
) -> list[Frames]:
    """Return the frames of each wanted type and of parameters and texts, by message id.

    Each type is from one sender.
    """
    if senders.chosen is None:
        return []
    ids = mavlink.ids_by_name()
    names = [
        n for n in senders.by_type if message_types is None or n in message_types or n in _PARTS
    ]
    types = np.array(sorted(ids[name] for name in names), dtype=np.int64)
    place = np.zeros(int(records.message_id.max()) + 1, dtype=np.int32)
    place[types] = np.arange(1, types.size + 1)
    others = list(senders.counts)
    number = np.zeros(1 << 16, dtype=np.int32)
    number[[system << 8 | component for system, component in others]] = np.arange(len(others))
    # Of type and sender.
    pair = place[records.message_id] * np.int32(len(others)) + number[_keys(records)]
    counts = np.bincount(pair, minlength=(types.size + 1) * len(others)).reshape(-1, len(others))
    own = others.index(senders.chosen)
    foreign = {sender[0] for sender in senders.vehicles} - {senders.chosen[0]}
    allowed = np.where([sender[0] in foreign for sender in others], 0, counts)
    allowed[0] = 0
    speaker = np.where(allowed[:, own] > 0, own, allowed.argmax(axis=1))
    rows = np.arange(types.size + 1)
    rank = np.full(counts.shape, -1, dtype=np.int16)
    rank[rows, speaker] = np.where(allowed.max(axis=1) > 0, rows, -1)
    key = rank.ravel()[pair]
    del pair
    return [records.take(part) for part in split_by(key, types.size + 1) if part.size]


def _sender_notes(senders: Senders, system: int | None) -> list[str]:
    if senders.chosen is None:
        return [] if system is None else [f"system {system} sends no message in this log"]
    notes = []
    vehicles = senders.vehicles
    if senders.chosen not in vehicles:
        notes.append(
            f"no heartbeat of an autopilot: {_named(senders.chosen)} sends most messages and is"
            " taken for the vehicle"
        )
    if len({system for system, _ in vehicles}) > 1:
        every = " and ".join(
            f"{_named(sender)} ({senders.counts[sender]} messages)" for sender in vehicles
        )
        notes.append(f"several vehicles: {every}; {_named(senders.chosen)} is read")
    for sender, count in senders.counts.items():
        if sender not in (senders.chosen, *vehicles):
            role = _ROLES.get(senders.heartbeat.get(sender, (0, -1))[1])
            notes.append(f"{_named(sender)}: {count} messages" + (f" ({role})" if role else ""))
    return notes


def _named(sender: Sender) -> str:
    return f"system {sender[0]} component {sender[1]}"


def _frame_notes(frames: Frames, what: str) -> list[str]:
    notes = []
    defined = mavlink.definitions()
    for sender, _ in sorted(_count_senders(frames).items(), key=lambda item: -item[1])[:5]:
        rows = (frames.system == sender[0]) & (frames.component == sender[1])
        ids, counts = np.unique(frames.message_id[rows], return_counts=True)
        text = ", ".join(
            f"{counts[k]} {defined[ids[k]].msgname if ids[k] in defined else f'id {ids[k]}'}"
            for k in np.argsort(-counts, kind="stable")[:5]
        )
        notes.append(f"{_named(sender)}: {what}: {text}")
    return notes


TLOG = LogReader("tlog", recognises, decode_tlog)
