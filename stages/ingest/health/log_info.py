"""Description of a log: bytes, streams, rates, gaps, rejected samples, report."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.records.logs import (
    FileInfo,
    LogInfo,
    SkippedInFile,
    SourceRecord,
    StreamInfo,
)
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import make_table
from auvid.hydro.identification.checks.signal_checks import clock_statistics
from auvid.stages.base import RawLog
from auvid.stages.ingest.multi_file import DecodedFile
from auvid.stages.ingest.rejection import Rejected
from auvid.stages.ingest.streams.mapping import Stream
from auvid.stages.presentation import Block, remark, section, table

ORDER = 90
"""Behind the results; losses and faults are warnings, which the first screen shows."""
ON_CHANGE = ("mode", "events")
STATUS = ("complete", "truncated", "damaged")
FIRMWARE = re.compile(r"^(Ardu\w+|PX4|APM:\w+) ?V?\d")
LATEST_START_S = 3600.0
RECORDED_STREAMS = (
    "depth",
    "velocity",
    "imu",
    "attitude",
    "actuators",
    "position",
    "range",
    "battery",
)
"""Streams in the recording, in this order."""


def log_info(
    log: RawLog,
    parts: Sequence[DecodedFile],
    streams: Mapping[str, Stream],
    rejected: Sequence[Rejected],
    *,
    gap_s: float,
    set_us: int | None,
) -> LogInfo:
    """Return the `log_info` document of a log."""
    notes = [note for part in parts for note in (*part.notes, *part.log.notes)]
    notes += [note for stream in streams.values() for note in stream.notes]
    if set_us is not None:
        notes.append("the clock of the log was set while it ran; samples before that are rejected")
    stream_info = {
        name: describe(stream, rejected, gap_s=gap_s) for name, stream in streams.items()
    }
    texts = sorted(text for part in parts for text in part.log.texts)
    return LogInfo(
        log=log.id,
        files=[_file(part) for part in parts],
        status=max((part.log.status for part in parts), key=STATUS.index),
        start_us=_start_us(parts, streams, set_us, notes),
        end_us=max(item.end_us for item in stream_info.values()),
        utc_offset_us=next(
            (part.utc_offset_us for part in parts if part.utc_offset_us is not None), None
        ),
        vehicle=next((text for _, text in texts if FIRMWARE.match(text)), None),
        parameters={
            key: value if math.isfinite(value) else None
            for part in parts
            for key, value in part.log.parameters.items()
        },
        accelerometer=next(
            (part.accelerometer for part in parts if part.accelerometer is not None), None
        ),
        streams=stream_info,
        counts={name: count for part in parts for name, count in part.log.counts.items()},
        notes=notes,
    )


def _file(part: DecodedFile) -> FileInfo:
    account = part.log.account
    return FileInfo(
        name=part.file.name,
        format=part.log.format,
        size_bytes=account.size,
        record_bytes=account.record_bytes,
        definition_bytes=account.definition_bytes,
        skipped=[
            SkippedInFile(reason=item.reason, bytes=item.bytes, count=item.count)
            for item in account.skipped
        ],
        status=part.log.status,
        seconds_lost=part.log.seconds_lost,
    )


def _start_us(
    parts: Sequence[DecodedFile],
    streams: Mapping[str, Stream],
    set_us: int | None,
    notes: list[str],
) -> int:
    """Return the time from which legs count.

    A column map declares it; else it is that of the first time-stamped record, if that
    is credible.
    """
    declared = [part.start_us for part in parts if part.start_us is not None]
    if declared:
        return min(declared)
    earliest = min(int(stream.columns["time_us"][0]) for stream in streams.values())
    if set_us is not None:
        return earliest
    first = [part.first_us for part in parts if part.first_us is not None]
    if not first or min(first) > earliest:
        return earliest
    if earliest - min(first) > LATEST_START_S * 1e6:
        notes.append(
            f"the first time stamp lies {(earliest - min(first)) / 1e6:.0f} s before the first"
            " sample and is not used"
        )
        return earliest
    return min(first)


def describe(stream: Stream, rejected: Sequence[Rejected], *, gap_s: float) -> StreamInfo:
    """Return source, rows, rate and gaps of one stream."""
    stamps = stream.columns["time_us"]
    steps = np.diff(stamps) / 1e6
    return StreamInfo(
        source=stream.source,
        alternatives=[SourceRecord(**item) for item in stream.alternatives],
        columns=[name for name in stream.columns if name != "time_us"],
        rows=len(stream),
        rejected=sum(item.count for item in rejected if item.stream == stream.name),
        rate_hz=_rate_hz(stamps / 1e6) if stream.name not in ON_CHANGE else None,
        start_us=int(stamps[0]),
        end_us=int(stamps[-1]),
        duration_s=float(stamps[-1] - stamps[0]) / 1e6,
        longest_gap_s=float(steps.max()) if steps.size else 0.0,
        gaps=int(np.count_nonzero(steps > gap_s)) if stream.name not in ON_CHANGE else 0,
    )


def _rate_hz(t_s: npt.NDArray[np.float64]) -> float | None:
    clock = clock_statistics(t_s)
    return None if clock is None else clock.rate_hz


def dropped_table(parts: Sequence[DecodedFile], rejected: Sequence[Rejected]) -> pa.Table:
    """Return the `dropped` table.

    It holds bytes that gave no record (by file) and rejected samples (by stream).
    """
    rows: list[tuple[object, ...]] = [
        (part.file.name, item.reason, item.count, item.bytes, item.first_offset, item.last_offset)
        for part in parts
        for item in part.log.account.skipped
    ]
    rows += [
        (item.stream, item.reason, item.count, None, item.first, item.last) for item in rejected
    ]
    names = ("stream", "reason", "count", "bytes", "first", "last")
    return make_table(
        "dropped", {name: [row[index] for row in rows] for index, name in enumerate(names)}
    )


def report_section(
    info: LogInfo, rejected: Sequence[Rejected], health_blocks: Sequence[Block] = ()
) -> dict[str, Any]:
    """Return the section of the report: files, streams, rejected samples, findings."""
    files = [_file_row(item) for item in info.files]
    streams = [_stream_row(name, item, info.start_us) for name, item in info.streams.items()]
    blocks = [
        table(
            "Files",
            ["file", "format", ("size", "bytes"), ("skipped", "bytes"), "status", ("lost", "s")],
            files,
        ),
        table(
            "Streams",
            [
                "stream",
                "source",
                "samples",
                ("rate", "Hz"),
                ("from", "s"),
                ("to", "s"),
                ("longest gap", "s"),
                "rejected",
            ],
            streams,
            note=(
                "Seconds count from the first time-stamped record of the log. The rate is the mean"
                " without pauses."
            ),
        ),
    ]
    if rejected:
        blocks.append(
            table(
                "Rejected samples",
                ["stream", "reason", "count"],
                [[item.stream, item.reason, item.count] for item in rejected],
            )
        )
    if info.status != "complete":
        blocks.append(
            remark(
                f"The log is {info.status}: the table of files says how much was lost.",
                "warning",
            )
        )
    blocks += [*health_blocks, *(remark(note) for note in info.notes)]
    return section(
        f"Health of log {info.log}",
        blocks,
        order=ORDER,
        look_for="Rates that differ from the sensor's, long gaps, rejected samples, damaged files.",
    )


def report_views(tables: Mapping[str, pa.Table]) -> dict[str, Any]:
    """Return the raw streams in the recording: one group per stream and unit."""
    groups = []
    for stream in (name for name in RECORDED_STREAMS if name in tables):
        units: dict[str, list[str]] = {}
        for item in schema(stream).columns.values():
            if (
                item.unit
                and item.name != schema(stream).clock
                and item.name in tables[stream].column_names
            ):
                units.setdefault(item.unit, []).append(item.name)
        for unit, columns in units.items():
            entity = (
                f"raw/{stream}"
                if len(units) == 1
                else f"raw/{stream}/{unit.replace('/', '_').replace('^', '')}"
            )
            groups.append(
                {
                    "entity": entity,
                    "table": stream,
                    "columns": columns,
                    "names": columns,
                    "roles": ["raw"] * len(columns),
                }
                | {"tab": "Logs", "unit": unit}
            )
    return {"groups": groups}


def _file_row(item: FileInfo) -> list[Any]:
    skipped = sum(part.bytes for part in item.skipped)
    return [
        item.name,
        item.format,
        item.size_bytes,
        skipped,
        item.status,
        item.seconds_lost,
    ]


def _stream_row(name: str, item: StreamInfo, start_us: int) -> list[Any]:
    span = [(time_us - start_us) / 1e6 for time_us in (item.start_us, item.end_us)]
    return [
        name,
        item.source,
        item.rows,
        item.rate_hz,
        *span,
        item.longest_gap_s,
        item.rejected,
    ]
