"""Decode the files of one log into sensor streams, each on its own clock.

Streams are in SI, forward-right-down and north-east-down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.signals.pose.track import PoseTrack
from auvid.hydro.long_series.long_arrays import let_go
from auvid.stages.base import Document, RawLog, Stage, param, port
from auvid.stages.columns import ACCELEROMETER, GYRO
from auvid.stages.ingest.fix_motion import fix_motion
from auvid.stages.ingest.health.health_check import check_health, health_blocks, other_sources
from auvid.stages.ingest.health.log_info import (
    dropped_table,
    log_info,
    report_section,
    report_views,
)
from auvid.stages.ingest.multi_file import (
    DecodedFile,
    chosen_sources,
    decode_file,
    forced_readers,
    merge_streams,
    on_one_clock,
    vehicle_sources,
)
from auvid.stages.ingest.pose_motion import pose_motion
from auvid.stages.ingest.rejection import (
    BACKWARD,
    FEW,
    IMPOSSIBLE,
    REPEATED,
    USUAL_UNITS,
    Rejected,
    clock_set,
    reject_samples,
    usual_time,
)
from auvid.stages.ingest.streams.common import Columns
from auvid.stages.ingest.streams.mapping import OtherSource, Stream
from auvid.stages.ingest.yaw_rate import YawRateMotion, yaw_rate_motion


@dataclass(frozen=True)
class Inputs:
    """One log; the manifest may name sources of streams, the vehicle its barometer."""

    raw_log: RawLog = port("raw_log")
    campaign: Document | None = port("campaign", optional=True)
    vehicle: Vehicle | None = port("vehicle", optional=True)


@dataclass(frozen=True)
class Params:
    """Largest share of rejected samples, and what counts as a gap."""

    max_dropped_share: float = param(
        "1",
        0.5,
        meaning="largest share of a stream's samples that may be rejected",
        low=0.0,
        high=1.0,
    )
    gap_s: float = param(
        "s", 1.0, meaning="a pause longer than this is listed as a gap of the stream", low=0.0
    )


@dataclass(frozen=True)
class Outputs:
    """The streams that the log has, rejected samples, and a description of the log."""

    dropped: pa.Table = port("dropped")
    log_info: LogInfo = port("log_info")
    health: dict[str, Any] = port("health")
    section: dict[str, Any] = port("section")
    views: dict[str, Any] = port("views")
    imu: pa.Table | None = port("imu", optional=True)
    attitude: pa.Table | None = port("attitude", optional=True)
    depth: pa.Table | None = port("depth", optional=True)
    velocity: pa.Table | None = port("velocity", optional=True)
    position: pa.Table | None = port("position", optional=True)
    actuators: pa.Table | None = port("actuators", optional=True)
    battery: pa.Table | None = port("battery", optional=True)
    range: pa.Table | None = port("range", optional=True)
    mode: pa.Table | None = port("mode", optional=True)
    events: pa.Table | None = port("events", optional=True)
    water_velocity: pa.Table | None = port("water_velocity", optional=True)
    sticks: pa.Table | None = port("sticks", optional=True)
    glider: pa.Table | None = port("glider", optional=True)
    pose: pa.Table | None = port("pose", optional=True)
    tow: pa.Table | None = port("tow", optional=True)
    fixes: pa.Table | None = port("fixes", optional=True)


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return the streams of one log.

    Raises `LogError` for a file that is no log, `CampaignError` for a source that the
    log does not have, and `DataError` for a log without any usable sample or with too
    many unusable ones.
    """
    read = _read(inputs, params)
    health = check_health(
        read.tables,
        read.info,
        read.dropped,
        vehicle=inputs.vehicle,
        others=read.others,
        track=read.track,
    )
    blocks = health_blocks(health, force_model=not _is_without_forces(inputs.campaign))
    return Outputs(
        dropped=read.dropped,
        log_info=read.info,
        health=health,
        section=report_section(read.info, read.rejected, blocks),
        views=report_views(read.tables),
        **read.tables,
    )


@dataclass(frozen=True)
class _Read:
    """What is read of a log; its files, messages and unusable samples are gone."""

    tables: dict[str, pa.Table]
    info: LogInfo
    dropped: pa.Table
    rejected: list[Rejected]
    others: list[OtherSource]
    track: PoseTrack | None


def _read(inputs: Inputs, params: Params) -> _Read:
    """Return the usable samples of a log as tables."""
    log = inputs.raw_log
    sources = chosen_sources(log, inputs.campaign)
    preferred = {**vehicle_sources(inputs.vehicle), **sources}
    forced = forced_readers(log, inputs.campaign)
    decoded = [decode_file(file, forced.get(file.name), preferred) for file in log.files]
    files = on_one_clock(decoded, log=log.id)
    merged = merge_streams(files, sources, log=log.id)
    clocks = [stream.columns["time_us"] for stream in merged.values()]
    set_us = clock_set(clocks)
    usual_us = usual_time(clocks, set_us=set_us)
    rejected: list[Rejected] = []
    streams = {}
    for name, merged_stream in merged.items():
        let_go()
        stream, lost = reject_samples(merged_stream, set_us=set_us, usual_us=usual_us)
        rejected += lost
        _check_share(lost, len(merged_stream), params.max_dropped_share, log.id)
        if len(stream):
            streams[name] = stream
    if not streams:
        raise _no_streams(log, files)
    of_yaw = "imu" in streams and GYRO[0] not in streams["imu"].columns
    yaw_rate = streams.pop("imu") if of_yaw else None
    motion = pose_motion(streams, inputs.vehicle, yaw_rate_logged=of_yaw)
    streams |= motion.streams
    turning = YawRateMotion()
    if yaw_rate is not None:
        turning = yaw_rate_motion(yaw_rate, streams, inputs.vehicle)
        streams |= turning.streams
        rejected += turning.rejected
    acoustic = fix_motion(streams, inputs.vehicle)
    streams |= acoustic.streams
    tables = {}
    for name, stream in streams.items():
        let_go()
        tables[name] = make_table(name, _columns(stream))
    info = log_info(log, files, streams, rejected, gap_s=params.gap_s, set_us=set_us)
    info.notes.extend((*motion.notes, *turning.notes, *acoustic.notes))
    if acoustic.track is not None and "velocity" in acoustic.streams:
        smoothed = {"smoothed_s": acoustic.track.smoothed_s}
        info.streams["velocity"] = info.streams["velocity"].model_copy(update=smoothed)
    return _Read(
        tables,
        info,
        dropped_table(files, rejected),
        rejected,
        other_sources(files, streams, set_us=set_us),
        motion.track,
    )


def _is_without_forces(campaign: Document | None) -> bool:
    return str((campaign or {}).get("kind", "")).startswith(("bench", "glide", "passive"))


def _columns(stream: Stream) -> Columns:
    """Return the columns, with NaN for a missing accelerometer."""
    absent = ACCELEROMETER if stream.name == "imu" else ()
    return {**dict.fromkeys(absent, np.full(len(stream), np.nan)), **stream.columns}


def _check_share(rejected: list[Rejected], count: int, share: float, log: str) -> None:
    lost = sum(item.count for item in rejected)
    if count > FEW and lost > share * count:
        reasons = ", ".join(f"{item.reason} ({item.count})" for item in rejected)
        stream = rejected[0].stream
        impossible = sum(item.count for item in rejected if item.reason == IMPOSSIBLE)
        usual = (
            f"Impossible are {USUAL_UNITS[stream]}. "
            if impossible > 0.5 * lost and stream in USUAL_UNITS
            else ""
        )
        if sum(item.count for item in rejected if item.reason == REPEATED) > 0.5 * lost:
            usual = "Stamps repeat where a time in s is declared as us, or is cut to seconds. "
        if sum(item.count for item in rejected if item.reason == BACKWARD) > 0.5 * lost:
            usual = "Rows of a CSV log that run backwards or in no order: sort them by time. "
        raise DataError(
            f"{lost} of {count} samples of stream '{rejected[0].stream}' cannot be used: {reasons}",
            file=f"log '{log}'",
            value=round(lost / count, 3),
            allowed=f"at most {share:g} of a stream",
            remedy=usual
            + (
                f"Choose another source for the stream, or none (sources: {{{rejected[0].stream}:"
                " none} in the manifest), or raise stages.ingest.max_dropped_share."
            ),
        )


def _no_streams(log: RawLog, files: Sequence[DecodedFile]) -> DataError:
    counts = {name: count for item in files for name, count in item.log.counts.items()}
    most = sorted(counts, key=lambda name: -counts[name])[:8]
    notes = "".join(f". {note.rstrip('.')}" for item in files for note in item.log.notes)
    return DataError(
        f"the log has no message that auvid reads{notes}",
        file=", ".join(file.name for file in log.files) or f"log '{log.id}'",
        value=", ".join(f"{name} ({counts[name]})" for name in most) or "no records",
        remedy="docs/streams.md lists the messages that streams are made from.",
    )


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="ingest",
    summary="Decode logs into sensor streams in SI units and account for every byte",
    maps_over="log",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
)
