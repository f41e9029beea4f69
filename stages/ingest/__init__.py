"""Decode the files of one log into sensor streams in SI, forward-right-down and
north-east-down, each on its own clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.streams import NEEDED, STREAMS
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Document, RawLog, Stage, param, port
from auvid.stages.ingest.health.health_check import check_health, health_blocks, other_sources
from auvid.stages.ingest.health.log_info import (
    dropped_table,
    log_info,
    report_section,
    report_views,
)
from auvid.stages.ingest.multi_file import (
    Part,
    forced_readers,
    merge_parts,
    on_one_clock,
    read_part,
    vehicle_sources,
    wanted_sources,
)
from auvid.stages.ingest.rejection import Rejected, clean, clock_set


@dataclass(frozen=True)
class Inputs:
    """One log; the manifest that may name the sources of its streams; the vehicle that
    may name its barometer.
    """

    raw_log: RawLog = port("raw_log")
    campaign: Document | None = port("campaign", optional=True)
    vehicle: Vehicle | None = port("vehicle", optional=True)


@dataclass(frozen=True)
class Params:
    """What may be rejected before a log is refused, and what counts as a gap."""

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
    """The streams that the log has, what was rejected, and what the log is."""

    dropped: pa.Table = port("dropped")
    log_info: dict[str, Any] = port("log_info")
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


def run(inputs: Inputs, params: Params) -> Outputs:
    """Streams of one log.

    Raises `LogError` for a file that is no log, `CampaignError` for a source that the
    log does not have, and `DataError` for a log without any usable sample or with too
    many unusable ones.
    """
    log = inputs.raw_log
    wanted = wanted_sources(log, inputs.campaign)
    preferred = {**vehicle_sources(inputs.vehicle), **wanted}
    forced = forced_readers(log, inputs.campaign)
    parts = on_one_clock(
        [read_part(file, forced.get(file.name), preferred) for file in log.files], log=log.id
    )
    merged = merge_parts(parts, wanted, log=log.id)
    set_us = clock_set({name: stream.columns for name, stream in merged.items()})
    rejected: list[Rejected] = []
    streams = {}
    for name in STREAMS:
        if name in merged:
            stream, lost = clean(merged[name], set_us=set_us)
            rejected += lost
            _check_share(lost, len(merged[name]), params.max_dropped_share, log.id)
            if len(stream):
                streams[name] = stream
    if not streams:
        raise _no_streams(log, parts)
    tables = {
        name: make_table(name, _columns(name, stream.columns)) for name, stream in streams.items()
    }
    info = log_info(log, parts, streams, rejected, gap_s=params.gap_s, set_us=set_us)
    dropped = dropped_table(parts, rejected)
    found = check_health(
        tables,
        info,
        dropped,
        vehicle=inputs.vehicle,
        others=other_sources(parts, forced, set_us=set_us),
    )
    return Outputs(
        dropped=dropped,
        log_info=info,
        health=found,
        section=report_section(
            info, rejected, health_blocks(found, force_model=not _is_bench(inputs.campaign))
        ),
        views=report_views(tables),
        **tables,
    )


def _is_bench(campaign: Document | None) -> bool:
    return str((campaign or {}).get("kind", "")).startswith("bench")


def _columns(stream: str, columns: Mapping[str, Any]) -> Mapping[str, Any]:
    """An inertial unit without accelerometer has NaN there, so that every reader of the
    table finds the columns.
    """
    if stream != "imu":
        return columns
    empty = columns[NEEDED["imu"][0]] * float("nan")
    return {**{f"accel_{axis}_m_s2": empty for axis in "xyz"}, **columns}


def _check_share(rejected: list[Rejected], count: int, share: float, log: str) -> None:
    lost = sum(item.count for item in rejected)
    if count and lost > share * count:
        reasons = ", ".join(f"{item.reason} ({item.count})" for item in rejected)
        raise DataError(
            f"{lost} of {count} samples of stream '{rejected[0].stream}' cannot be used: {reasons}",
            file=f"log '{log}'",
            value=round(lost / count, 3),
            allowed=f"at most {share:g} of a stream",
            remedy=(
                f"Choose another source for the stream, or none (sources: {{{rejected[0].stream}:"
                " none} in the manifest), or raise stages.ingest.max_dropped_share."
            ),
        )


def _no_streams(log: RawLog, parts: list[Part]) -> DataError:
    counts = {name: count for part in parts for name, count in part.log.counts.items()}
    most = sorted(counts, key=lambda name: -counts[name])[:8]
    said = "".join(f". {note.rstrip('.')}" for part in parts for note in part.log.notes)
    return DataError(
        f"the log has no message that fills a stream{said}",
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
