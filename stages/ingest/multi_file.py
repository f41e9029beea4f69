"""The files of one log: each read by its reader, their streams put together on the one
clock that they share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError, LogError, nearest
from auvid.data_schemas.streams import STREAMS
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Document, RawFile, RawLog
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.csv.reader import NAME as CSV_NAME
from auvid.stages.ingest.formats.csv.reader import declared_start_us, read_csv
from auvid.stages.ingest.registry import MAPPINGS, reader_of
from auvid.stages.ingest.streams.mapping import Rules, Stream, map_streams

LEFT_OUT = "none"  # as a source: the stream is not wanted
FIRST_BYTES = 1 << 18  # enough to find the first time stamp of a log whatever it starts with


@dataclass(frozen=True)
class Part:
    """One decoded file of a log.

    `first_us` is the time of its first time-stamped record; `start_us` the time from
    which legs count where the file's column map says so; `epoch` is what zero means on
    its clock; `accelerometer` what its accelerometer measures (None without one).
    """

    file: RawFile
    log: DecodedLog
    streams: Mapping[str, Stream]
    first_us: int | None
    start_us: int | None = None
    epoch: str = "boot"
    utc_offset_us: int | None = None
    accelerometer: str | None = None
    notes: tuple[str, ...] = ()


def wanted_sources(log: RawLog, campaign: Document | None) -> Mapping[str, str]:
    """The sources that the manifest names for the streams of this log. Raises
    `CampaignError` for an unknown stream.
    """
    found = _entry(log, campaign)
    wanted = {str(stream): str(source) for stream, source in found.get("sources", {}).items()}
    for stream in wanted:
        if stream not in STREAMS:
            raise CampaignError(
                "unknown stream",
                field=f"logs.{log.id}.sources",
                value=stream,
                allowed=STREAMS,
                remedy=nearest(stream, STREAMS),
            )
    return wanted


def _entry(log: RawLog, campaign: Document | None) -> Mapping[str, Any]:
    entries = campaign.get("logs", ()) if campaign else ()
    return next((entry for entry in entries if entry.get("id") == log.id), {})


def forced_readers(log: RawLog, campaign: Document | None) -> Mapping[str, str]:
    """File name -> reader, where the manifest forces one for the log or for a file of
    several.
    """
    forced = {} if log.reader is None else {file.name: log.reader for file in log.files}
    return forced | {
        item["file"]: item["reader"]
        for item in _entry(log, campaign).get("files", ())
        if "reader" in item
    }


def vehicle_sources(vehicle: Vehicle | None) -> Mapping[str, str]:
    """The source of depth that the vehicle prefers: the instance of the barometer that
    sits in the water.
    """
    if vehicle is None or vehicle.barometer_instance is None:
        return {}
    return {"depth": f"BARO[{vehicle.barometer_instance}]"}


def read_part(file: RawFile, forced: str | None, wanted: Mapping[str, str]) -> Part:
    """Decode one file and map its messages to streams; only the message types that
    streams need are decoded.
    """
    reader = reader_of(file, forced)
    if reader.name == CSV_NAME:
        return _csv_part(file)
    mapping, rules = MAPPINGS[reader.name]
    log = reader.read(file, rules.messages(mapping))
    streams = map_streams(log, mapping, rules, wanted)
    first_us = (
        _first_us(reader.read(replace(file, buffer=file.buffer[:FIRST_BYTES])), rules)
        if streams
        else None
    )
    return Part(
        file,
        log,
        streams,
        first_us,
        utc_offset_us=rules.utc(log),
        accelerometer="specific_force" if "imu" in streams else None,
    )


def _csv_part(file: RawFile) -> Part:
    log, mapping = read_csv(file)
    used = {"source": file.name, "columns": "", "status": "used"}
    streams = {
        name: Stream(name, dict(item.columns), item.offset, file.name, (used,))
        for name, item in log.messages.items()
    }
    stamps = [
        item.columns["time_us"][np.isfinite(item.columns["time_us"].astype(np.float64))]
        for item in streams.values()
    ]
    first = min((float(values[0]) for values in stamps if values.size), default=None)
    return Part(
        file,
        log,
        streams,
        None if first is None else round(first),
        start_us=declared_start_us(mapping, file.name),
        epoch=mapping.epoch,
        utc_offset_us=0 if mapping.epoch == "unix" else None,
        accelerometer=mapping.accelerometer if "imu" in streams else None,
    )


def _first_us(log: DecodedLog, rules: Rules) -> int | None:
    """Time of the first record, in the order of the file, that has a time stamp."""
    found: list[tuple[int, int]] = []
    for messages in log.messages.values():
        if len(messages):
            stamps = rules.clock(messages, log)
            if stamps is not None:
                found.append((int(messages.offset[0]), int(stamps[0])))
    return min(found)[1] if found else None


def merge_parts(parts: Sequence[Part], wanted: Mapping[str, str], *, log: str) -> dict[str, Stream]:
    """Each stream from the one file that has it, or from the one that the manifest
    names.

    Raises `CampaignError` if several files have a stream and the manifest does not
    choose, or if it names a source that is not there.
    """
    merged = {}
    for name in STREAMS:
        if wanted.get(name) == LEFT_OUT:
            continue
        holders = [part for part in parts if name in part.streams]
        if name in wanted:
            holders = [part for part in holders if _is_source(part, name, wanted[name])]
            if not holders:
                raise _no_source(parts, name, wanted[name], log)
        if len(holders) > 1:
            raise CampaignError(
                f"several files of log '{log}' have stream '{name}'",
                field=f"logs.{log}.sources.{name}",
                value=", ".join(part.file.name for part in holders),
                remedy=f"Choose one: sources: {{{name}: {holders[0].file.name}}}.",
            )
        if holders:
            merged[name] = holders[0].streams[name]
    return merged


def _is_source(part: Part, stream: str, wanted: str) -> bool:
    label = part.streams[stream].source
    return wanted in (label, label.split("[")[0], part.file.name, part.file.name.rsplit("/", 1)[-1])


def _no_source(parts: Sequence[Part], stream: str, wanted: str, log: str) -> CampaignError:
    there = [part.streams[stream] for part in parts if stream in part.streams]
    labels = [
        item["source"]
        for one in there
        for item in one.alternatives
        if not item["status"].startswith(("not logged", "has no"))
    ]
    return CampaignError(
        f"log '{log}' has no such source of stream '{stream}'",
        field=f"logs.{log}.sources.{stream}",
        value=wanted,
        allowed=labels or "none: nothing in the log could fill this stream",
        remedy=nearest(wanted, labels),
    )


def on_one_clock(parts: Sequence[Part], *, log: str) -> list[Part]:
    """The parts on one clock: files in Unix time are moved to the boot clock of the
    file that knows its UTC offset.

    Raises `LogError` where the clocks differ and nothing ties them together.
    """
    epochs = {part.epoch for part in parts}
    if len(epochs) <= 1:
        return list(parts)
    offset = next(
        (
            part.utc_offset_us
            for part in parts
            if part.epoch == "boot" and part.utc_offset_us is not None
        ),
        None,
    )
    if epochs != {"boot", "unix"} or offset is None:
        raise LogError(
            f"the files of log '{log}' are not on one clock",
            file=", ".join(part.file.name for part in parts),
            value=", ".join(f"{part.file.name}: {part.epoch}" for part in parts),
            remedy="Give them one epoch in their column maps, or make them separate logs.",
        )
    return [_moved(part, offset) if part.epoch == "unix" else part for part in parts]


def _moved(part: Part, offset: int) -> Part:
    streams = {
        name: replace(
            stream, columns={**stream.columns, "time_us": stream.columns["time_us"] - offset}
        )
        for name, stream in part.streams.items()
    }
    note = (
        f"{part.file.name}: moved from Unix time to the vehicle's boot clock by"
        f" {-offset / 1e6:.3f} s"
    )
    return replace(
        part,
        streams=streams,
        first_us=None if part.first_us is None else part.first_us - offset,
        start_us=None if part.start_us is None else part.start_us - offset,
        utc_offset_us=None,
        epoch="boot",
        notes=(note,),
    )
