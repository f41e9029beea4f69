"""Reader of MAVLink telemetry logs (.tlog), as ground stations record them.

Every frame is checked by its checksum; columns equal pymavlink's decoding field by field. One table holds one sender: the chosen
vehicle's autopilot, or, for types that it does not send, the component of no other vehicle that sends most of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from data_schemas.formats import mavlink
from stages.ingest.decoded import DecodedLog, Messages, RawFile
from stages.ingest.tlog_clock import leap_notes
from stages.ingest.tlog_columns import decode, parameters, status_texts
from stages.ingest.tlog_frames import Frames, explain, frames_at, places

Sender = tuple[int, int]
HEAD_BYTES = 8192
_YEAR_2000_US = 946_684_800_000_000
_PARTS = ("PARAM_VALUE", "STATUSTEXT")
_ROLES = {6: "ground station", 18: "companion computer", 26: "gimbal", 30: "camera", 27: "ADSB", 32: "servo", 34: "parachute"}


@dataclass(frozen=True)
class Senders:
    """Who sends what: messages by sender, MAV_AUTOPILOT and MAV_TYPE of those that send heartbeats, the autopilot that was chosen."""

    counts: dict[Sender, int]
    heartbeat: dict[Sender, tuple[int, int]]
    chosen: Sender | None

    @property
    def vehicles(self) -> list[Sender]:
        pilots = [sender for sender, (autopilot, _) in self.heartbeat.items() if autopilot != mavlink.AUTOPILOT_INVALID]
        return sorted(pilots, key=lambda sender: (-self.counts[sender], sender))


@dataclass(frozen=True)
class TlogReader:
    """Telemetry log reader; `system` chooses the vehicle by its MAVLink system id (None: the one with most messages)."""

    name: str = "tlog"
    system: int | None = None

    def recognises(self, head: bytes) -> bool:
        """True if the first bytes hold two frames in a row with time stamps of this century, or are one such frame."""
        buffer = np.frombuffer(head[:HEAD_BYTES], dtype=np.uint8)
        frames = frames_at(buffer, places(buffer))
        frames = frames.take((frames.stamp >= _YEAR_2000_US) & (frames.length > 0))
        if np.any(np.isin(frames.stop, frames.start)):
            return True
        return bool(len(frames) and frames.start[0] == 0 and frames.stop[0] >= len(head))

    def read(self, file: RawFile, wanted: frozenset[str] | None = None) -> DecodedLog:
        """Decode the wanted message types (None: all); damage is counted, never an error."""
        buffer = np.ascontiguousarray(file.buffer)
        found = explain(buffer)
        records = found.records
        groups = _by_type(records)
        senders = _senders(buffer, records, groups, self.system)
        messages: dict[str, Messages] = {}
        parts: dict[str, Messages] = {}
        for name, rows in groups.items():
            keep = wanted is None or name in wanted
            if keep or name in _PARTS:
                rows = _of_one_sender(records, rows, senders)
                if rows.size:
                    table = decode(buffer, records.take(rows), mavlink.layout(mavlink.ids_by_name()[name]))
                    parts.update({name: table} if name in _PARTS else {})
                    messages.update({name: table} if keep else {})
        autopilot = senders.heartbeat[senders.chosen][0] if senders.chosen in senders.heartbeat else mavlink.AUTOPILOT_INVALID
        values = parameters(parts["PARAM_VALUE"], bytewise=autopilot == mavlink.AUTOPILOT_PX4) if "PARAM_VALUE" in parts else {}
        return DecodedLog(
            format=self.name,
            messages=messages,
            counts={name: int(rows.size) for name, rows in groups.items()},
            account=found.account,
            status=found.status,
            seconds_lost=found.seconds_lost,
            parameters=values,
            texts=status_texts(parts["STATUSTEXT"]) if "STATUSTEXT" in parts else (),
            notes=(
                *_sender_notes(senders, self.system),
                *_frame_notes(found.recut, "read although a router cut trailing zeros after the checksum was made"),
                *_frame_notes(found.mismatched, "wrong checksum, not read"),
                *leap_notes(records.stamp, records.start),
            ),
        )


def _by_type(records: Frames) -> dict[str, npt.NDArray[np.intp]]:
    """Rows of each message type, ascending; types in order of first appearance do not matter, so in order of id."""
    order = np.argsort(records.message_id.astype(np.uint16), kind="stable")
    ids = records.message_id[order]
    edges = np.flatnonzero(np.diff(ids)) + 1
    groups = np.split(order, edges) if order.size else []
    return {str(mavlink.definitions()[int(records.message_id[rows[0]])].msgname): rows for rows in groups}


def _senders(buffer: npt.NDArray[np.uint8], records: Frames, groups: dict[str, npt.NDArray[np.intp]], system: int | None) -> Senders:
    counts = _count_senders(records)
    heartbeat: dict[Sender, tuple[int, int]] = {}
    if "HEARTBEAT" in groups:
        beats = decode(buffer, records.take(groups["HEARTBEAT"]), mavlink.layout(0)).columns
        names = ("sysid", "compid", "autopilot", "type")
        rows, times = np.unique(np.stack([beats[name] for name in names]), axis=1, return_counts=True)
        for row in np.argsort(times, kind="stable"):
            sysid, compid, autopilot, kind = rows[:, row].tolist()
            heartbeat[sysid, compid] = (autopilot, kind)
    vehicles = Senders(counts, heartbeat, None).vehicles
    if system is not None:
        others = [sender for sender in counts if sender[0] == system]
        vehicles = [sender for sender in vehicles if sender[0] == system]
    else:
        others = [sender for sender in counts if heartbeat.get(sender, (0, 0))[1] != 6] or list(counts)
    chosen = vehicles[0] if vehicles else max(others, key=lambda sender: (counts[sender], sender), default=None)
    return Senders(counts, heartbeat, chosen)


def _count_senders(records: Frames) -> dict[Sender, int]:
    keys, counts = np.unique(records.system.astype(np.uint16) << 8 | records.component, return_counts=True)
    return {(int(key) >> 8, int(key) & 0xFF): int(count) for key, count in zip(keys, counts, strict=True)}


def _of_one_sender(records: Frames, rows: npt.NDArray[np.intp], senders: Senders) -> npt.NDArray[np.intp]:
    if senders.chosen is None:
        return rows[:0]
    system, component = records.system[rows], records.component[rows]
    own = (system == senders.chosen[0]) & (component == senders.chosen[1])
    if own.all():
        return rows
    if not own.any():
        foreign = [sender[0] for sender in senders.vehicles if sender[0] != senders.chosen[0]]
        own = ~np.isin(system, foreign)
        if own.any():
            counts = _count_senders(records.take(rows[own]))
            most = max(counts, key=lambda sender: (counts[sender], sender))
            own = (system == most[0]) & (component == most[1])
    return np.asarray(rows[own])


def _sender_notes(senders: Senders, system: int | None) -> list[str]:
    if senders.chosen is None:
        return [] if system is None else [f"system {system} sends no message in this log"]
    notes = []
    vehicles = senders.vehicles
    if not any(sender == senders.chosen for sender in vehicles):
        notes.append(f"no heartbeat of an autopilot: {_named(senders.chosen)} sends most messages and is taken for the vehicle")
    if len({sender[0] for sender in vehicles}) > 1:
        every = " and ".join(f"{_named(sender)} ({senders.counts[sender]} messages)" for sender in vehicles)
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
        text = ", ".join(f"{counts[row]} {mavlink.definitions()[int(ids[row])].msgname}" for row in most)
        notes.append(f"{_named(sender)}: {what}: {text}")
    return notes


TLOG = TlogReader()
