"""The files of one log: each decoded, their streams merged on one common clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auvid.data_schemas.errors import CampaignError, LogError, nearest
from auvid.data_schemas.records.logs import Accelerometer
from auvid.data_schemas.streams import STREAMS
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.long_series.heap import give_back_heap
from auvid.hydro.long_series.long_arrays import LONG_BYTES
from auvid.stages.base import Document, RawFile, RawLog
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.csv.reader import declared_start_us, read_csv
from auvid.stages.ingest.registry import RULES, reader_of
from auvid.stages.ingest.streams.mapping import ABSENT, Rules, Stream, map_streams

LEFT_OUT = "none"  # as a source: the stream is not wanted
FIRST_BYTES = 1 << 18  # enough to find the first time stamp of a log whatever it starts with


@dataclass(frozen=True)
class DecodedFile:
    """One decoded file of a log, and the rules that made its streams (None: CSV).

    `first_us` is the time of its first time-stamped record; `start_us` the time from
    which legs count where the file's column map declares it; `epoch` is what zero means
    on its clock; `accelerometer` what its accelerometer measures (None without one).
    """

    file: RawFile
    log: DecodedLog
    streams: Mapping[str, Stream]
    first_us: int | None
    rules: Rules | None = None
    start_us: int | None = None
    epoch: str = "boot"
    utc_offset_us: int | None = None
    accelerometer: Accelerometer | None = None
    notes: tuple[str, ...] = ()


def chosen_sources(log: RawLog, campaign: Document | None) -> Mapping[str, str]:
    """Return the sources that the manifest names for the streams of this log.

    Raises `CampaignError` for an unknown stream.
    """
    sources = _entry(log, campaign).get("sources", {})
    for stream in sources:
        if stream not in STREAMS:
            raise CampaignError(
                "unknown stream",
                field=f"logs.{log.id}.sources",
                value=stream,
                allowed=STREAMS,
                remedy=nearest(stream, STREAMS),
            )
    return {stream: str(source) for stream, source in sources.items()}


def _entry(log: RawLog, campaign: Document | None) -> Mapping[str, Any]:
    entries = (campaign or {}).get("logs", ())
    return next((entry for entry in entries if entry.get("id") == log.id), {})


def forced_readers(log: RawLog, campaign: Document | None) -> Mapping[str, str]:
    """Return the readers that the manifest forces, by file name."""
    forced = {} if log.reader is None else {file.name: log.reader for file in log.files}
    files = _entry(log, campaign).get("files", ())
    return forced | {item["file"]: item["reader"] for item in files if "reader" in item}


def vehicle_sources(vehicle: Vehicle | None) -> Mapping[str, str]:
    """Return the depth source that the vehicle prefers: its wet barometer."""
    instance = vehicle and vehicle.barometer_instance
    return {} if instance is None else {"depth": f"BARO[{instance}]"}


def decode_file(file: RawFile, forced: str | None, sources: Mapping[str, str]) -> DecodedFile:
    """Decode one file and map its messages to streams.

    Only the message types that streams need are decoded, and the bytes are not kept.
    """
    loaded = file.loaded()
    reader = reader_of(loaded, forced)
    rules = RULES[reader.name]
    if rules is None:
        return replace(_decode_csv(loaded), file=file)
    log = reader.read(loaded, rules.messages)
    head = replace(file, content=loaded.buffer[:FIRST_BYTES].copy())
    del loaded  # streams need memory of their own
    if log.account.size > LONG_BYTES:
        give_back_heap()
    streams = map_streams(log, rules, sources)
    first_us = _first_us(reader.read(head), rules) if streams else None
    return DecodedFile(
        file,
        log,
        streams,
        first_us,
        rules,
        utc_offset_us=rules.utc(log),
        accelerometer="specific_force" if "imu" in streams else None,
    )


def _decode_csv(file: RawFile) -> DecodedFile:
    log, mapping = read_csv(file)
    used = {"source": file.name, "columns": "", "status": "used"}
    streams = {
        name: Stream(name, dict(item.columns), item.offset, file.name, (used,))
        for name, item in log.messages.items()
    }
    stamps = [item.floats("time_us") for item in log.messages.values()]
    first = [values[np.isfinite(values)][:1] for values in stamps]
    return DecodedFile(
        file,
        log,
        streams,
        min((round(value) for values in first for value in values.tolist()), default=None),
        start_us=declared_start_us(mapping, file.name),
        epoch=mapping.epoch,
        utc_offset_us=0 if mapping.epoch == "unix" else None,
        accelerometer=mapping.accelerometer if "imu" in streams else None,
    )


def _first_us(log: DecodedLog, rules: Rules) -> int | None:
    """Return the time of the first record of the file that has a time."""
    first: list[tuple[int, int]] = []
    for messages in log.messages.values():
        stamps = rules.clock(messages, log) if len(messages) else None
        if stamps is not None:
            first.append((int(messages.offset[0]), int(stamps[0])))
    return min(first)[1] if first else None


def merge_streams(
    files: Sequence[DecodedFile], sources: Mapping[str, str], *, log: str
) -> dict[str, Stream]:
    """Return each stream from the one file that has it, or that the manifest names.

    Raises `CampaignError` if several files have a stream and the manifest does not
    choose, or if it names a source that is not there.
    """
    merged = {}
    for name in STREAMS:
        if sources.get(name) == LEFT_OUT:
            continue
        holders = [item for item in files if name in item.streams]
        if name in sources:
            holders = [item for item in holders if _is_source(item, name, sources[name])]
            if not holders:
                raise _no_source(files, name, sources[name], log)
        if len(holders) > 1:
            raise CampaignError(
                f"several files of log '{log}' have stream '{name}'",
                field=f"logs.{log}.sources.{name}",
                value=", ".join(item.file.name for item in holders),
                remedy=f"Choose one: sources: {{{name}: {holders[0].file.name}}}.",
            )
        if holders:
            merged[name] = holders[0].streams[name]
    return merged


def _is_source(item: DecodedFile, stream: str, source: str) -> bool:
    label, name = item.streams[stream].source, item.file.name
    return source in (label, label.split("[")[0], name, name.rsplit("/", 1)[-1])


def _no_source(files: Sequence[DecodedFile], stream: str, source: str, log: str) -> CampaignError:
    labels = [
        other["source"]
        for item in files
        if stream in item.streams
        for other in item.streams[stream].alternatives
        if not other["status"].startswith(ABSENT)
    ]
    return CampaignError(
        f"log '{log}' has no such source of stream '{stream}'",
        field=f"logs.{log}.sources.{stream}",
        value=source,
        allowed=labels or "none: nothing in the log could fill this stream",
        remedy=nearest(source, labels),
    )


def on_one_clock(files: Sequence[DecodedFile], *, log: str) -> list[DecodedFile]:
    """Return the files on one clock.

    Files in Unix time are moved to the boot clock of the file that knows its UTC
    offset. Raises `LogError` where the clocks differ and nothing relates them.
    """
    epochs = {item.epoch for item in files}
    if len(epochs) <= 1:
        return list(files)
    offsets = [item.utc_offset_us for item in files if item.epoch == "boot"]
    offset = next((value for value in offsets if value is not None), None)
    if epochs != {"boot", "unix"} or offset is None:
        raise LogError(
            f"the files of log '{log}' are not on one clock",
            file=", ".join(item.file.name for item in files),
            value=", ".join(f"{item.file.name}: {item.epoch}" for item in files),
            remedy="Give them one epoch in their column maps, or make them separate logs.",
        )
    return [_moved(item, offset) if item.epoch == "unix" else item for item in files]


def _moved(item: DecodedFile, offset: int) -> DecodedFile:
    streams = {
        name: replace(
            stream, columns={**stream.columns, "time_us": stream.columns["time_us"] - offset}
        )
        for name, stream in item.streams.items()
    }
    note = (
        f"{item.file.name}: moved from Unix time to the vehicle's boot clock by"
        f" {-offset / 1e6:.3f} s"
    )
    first_us, start_us = (
        None if value is None else value - offset for value in (item.first_us, item.start_us)
    )
    return replace(
        item,
        streams=streams,
        first_us=first_us,
        start_us=start_us,
        utc_offset_us=None,
        epoch="boot",
        notes=(note,),
    )
