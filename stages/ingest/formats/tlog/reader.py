"""Reader of MAVLink telemetry logs (.tlog), as ground stations record them.

Every frame is checked by its checksum; columns equal pymavlink's decoding field by
field. One table holds one sender: the chosen vehicle's autopilot, or, for types that it
does not send, the component of no other vehicle that sends most of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.formats import mavlink
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.tlog.byte_account import explain
from auvid.stages.ingest.formats.tlog.clock import leap_notes
from auvid.stages.ingest.formats.tlog.columns import decode, parameters, status_texts
from auvid.stages.ingest.formats.tlog.frames import Frames, frames_at, places

Sender = tuple[int, int]
HEAD_BYTES = 8192
_YEAR_2000_US = 946_684_800_000_000
_PARTS = ("PARAM_VALUE", "STATUSTEXT")
_ROLES = {
    6: "ground station",
    18: "companion computer",
    26: "gimbal",
    27: "ADSB",
    30: "camera",
}  # MAV_TYPE


@dataclass(frozen=True)
class Senders:
    """Who sends what: messages by sender and by type, MAV_AUTOPILOT and MAV_TYPE of
    those with heartbeats, and whose messages are read.
    """

    counts: dict[Sender, int]
    by_type: dict[str, int]
    heartbeat: dict[Sender, tuple[int, int]]
    chosen: Sender | None

    @property
    def vehicles(self) -> list[Sender]:
        pilots = [
            sender
            for sender, (autopilot, _) in self.heartbeat.items()
            if autopilot != mavlink.AUTOPILOT_INVALID
        ]
        return sorted(pilots, key=lambda sender: (-self.counts[sender], sender))


@dataclass(frozen=True)
class TlogReader:
    """Telemetry log reader; `system` chooses the vehicle by its MAVLink system id
    (None: the one with most messages).
    """

    name: str = "tlog"
    system: int | None = None

    def recognises(self, head: bytes) -> bool:
        """True if the first bytes hold two frames in a row with time stamps of this
        century, or are one such frame.
        """
        buffer = np.frombuffer(head[:HEAD_BYTES], dtype=np.uint8)
        frames = frames_at(buffer, places(buffer, 0, HEAD_BYTES))
        frames = frames.take((frames.stamp >= _YEAR_2000_US) & (frames.length > 0))
        if np.any(np.isin(frames.stop, frames.start)):
            return True
        return bool(len(frames) and frames.start[0] == 0 and frames.stop[0] >= len(head))

    def read(self, file: RawFile, wanted: frozenset[str] | None = None) -> DecodedLog:
        """Decode the wanted message types (None: all); damage is counted, never an
        error.
        """
        buffer = np.ascontiguousarray(file.buffer)
        found = explain(buffer)
        senders = _senders(buffer, found.records, self.system)
        notes = (
            *_sender_notes(senders, self.system),
            *_frame_notes(
                found.recut, "read although a router cut trailing zeros after the checksum was made"
            ),
            *_frame_notes(found.mismatched, "wrong checksum, not read"),
            *leap_notes(found.records.stamp, found.records.start),
        )
        account, status, seconds_lost = found.account, found.status, found.seconds_lost
        groups = _by_type(found.records, senders, wanted)
        del found  # the records are copied in groups: columns and both copies together would be the peak of memory
        tables = {}
        for frames in groups:
            table = decode(buffer, frames, mavlink.layout(int(frames.message_id[0])))
            tables[table.name] = table
        autopilot = (
            senders.heartbeat[senders.chosen][0]
            if senders.chosen in senders.heartbeat
            else mavlink.AUTOPILOT_INVALID
        )
        values, texts = (tables.get(name) for name in _PARTS)
        return DecodedLog(
            format=self.name,
            messages={
                name: table for name, table in tables.items() if wanted is None or name in wanted
            },
            counts=senders.by_type,
            account=account,
            status=status,
            seconds_lost=seconds_lost,
            parameters=(
                parameters(values, bytewise=autopilot == mavlink.AUTOPILOT_PX4) if values else {}
            ),
            texts=status_texts(texts) if texts else (),
            notes=notes,
        )


def _keys(frames: Frames) -> npt.NDArray[np.uint16]:
    return frames.system.astype(np.uint16) << np.uint16(8) | frames.component


def _count_senders(frames: Frames) -> dict[Sender, int]:
    counts = np.bincount(_keys(frames))
    return {(key >> 8, key & 0xFF): int(counts[key]) for key in np.flatnonzero(counts).tolist()}


def _senders(buffer: npt.NDArray[np.uint8], records: Frames, system: int | None) -> Senders:
    counts = _count_senders(records)
    names = mavlink.definitions()
    ids = np.bincount(records.message_id)
    by_type = {
        str(names[number].msgname): int(ids[number]) for number in np.flatnonzero(ids).tolist()
    }
    heartbeat: dict[Sender, tuple[int, int]] = {}
    if "HEARTBEAT" in by_type:
        beats = decode(buffer, records.take(records.message_id == 0), mavlink.layout(0)).columns
        four = np.stack([beats[name] for name in ("sysid", "compid", "autopilot", "type")], axis=1)
        rows, times = np.unique(four.view(">u4"), return_counts=True)
        for row in np.argsort(times, kind="stable"):
            sysid, compid, autopilot, kind = int(rows[row]).to_bytes(4, "big")
            heartbeat[sysid, compid] = (autopilot, kind)
    vehicles = Senders(counts, by_type, heartbeat, None).vehicles
    if system is not None:
        others = [sender for sender in counts if sender[0] == system]
        vehicles = [sender for sender in vehicles if sender[0] == system]
    else:
        others = [sender for sender in counts if heartbeat.get(sender, (0, 0))[1] != 6] or list(
            counts
        )
    chosen = (
        vehicles[0]
        if vehicles
        else max(others, key=lambda sender: (counts[sender], sender), default=None)
    )
    return Senders(counts, by_type, heartbeat, chosen)


def _by_type(records: Frames, senders: Senders, wanted: frozenset[str] | None) -> list[Frames]:
    """Frames of each wanted type and of parameters and texts, each type from one
    sender, in order of message id.
    """
    if senders.chosen is None:
        return []
    ids = mavlink.ids_by_name()
    types = np.array(
        sorted(
            ids[name]
            for name in senders.by_type
            if wanted is None or name in wanted or name in _PARTS
        ),
        dtype=np.int64,
    )
    place = np.zeros(int(records.message_id.max()) + 1, dtype=np.int32)
    place[types] = np.arange(1, types.size + 1)
    others = list(senders.counts)
    number = np.zeros(1 << 16, dtype=np.int32)
    number[[system << 8 | component for system, component in others]] = np.arange(len(others))
    pair = (
        place[records.message_id] * np.int32(len(others)) + number[_keys(records)]
    )  # of type and sender
    sent = np.bincount(pair, minlength=(types.size + 1) * len(others)).reshape(-1, len(others))
    own = others.index(senders.chosen)
    foreign = {sender[0] for sender in senders.vehicles} - {senders.chosen[0]}
    allowed = np.where([sender[0] in foreign for sender in others], 0, sent)
    allowed[0] = 0
    speaker = np.where(allowed[:, own] > 0, own, allowed.argmax(axis=1))
    rows = np.arange(types.size + 1)
    rank = np.zeros(sent.shape, dtype=np.int16)  # zero for what is not read
    rank[rows, speaker] = np.where(allowed.max(axis=1) > 0, rows, 0)
    stops = np.cumsum(
        np.bincount(rank.ravel(), weights=sent.ravel(), minlength=types.size + 1).astype(np.int64)
    ).tolist()
    order = np.argsort(rank.ravel()[pair], kind="stable")[stops[0] :]
    del pair
    chosen = records.take(order)
    return [
        chosen.take(slice(first - stops[0], last - stops[0]))
        for first, last in pairwise(stops)
        if last > first
    ]


def _sender_notes(senders: Senders, system: int | None) -> list[str]:
    if senders.chosen is None:
        return [] if system is None else [f"system {system} sends no message in this log"]
    notes = []
    vehicles = senders.vehicles
    if not any(sender == senders.chosen for sender in vehicles):
        notes.append(
            f"no heartbeat of an autopilot: {_named(senders.chosen)} sends most messages and is"
            " taken for the vehicle"
        )
    if len({sender[0] for sender in vehicles}) > 1:
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
    for sender, _ in sorted(_count_senders(frames).items(), key=lambda item: -item[1])[:5]:
        rows = (frames.system == sender[0]) & (frames.component == sender[1])
        ids, counts = np.unique(frames.message_id[rows], return_counts=True)
        most = np.argsort(-counts, kind="stable")[:5]
        defined = mavlink.definitions()
        named = {
            number: defined[number].msgname if number in defined else f"id {number}"
            for number in ids.tolist()
        }
        text = ", ".join(f"{counts[row]} {named[int(ids[row])]}" for row in most)
        notes.append(f"{_named(sender)}: {what}: {text}")
    return notes


TLOG = TlogReader()
