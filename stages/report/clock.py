"""One clock for all logs of a campaign: one after the other, with a gap between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column
from auvid.hydro.arrays import Array

LOG_GAP_S = 10.0
NO_WINDOWS: Mapping[str, AxisWindowsRecord] = {}


@dataclass(frozen=True)
class Clock:
    """Where each log and segment stands on the recording's timeline, in seconds."""

    segments: Mapping[str, float]
    logs: Mapping[str, float]
    boot_s: Mapping[str, float]
    legs: Mapping[str, float] = field(default_factory=dict)
    """Where the record of a leg starts that was not cut into segments."""

    def seconds(self, name: str, table: pa.Table) -> Array | None:
        """Return the times (n,) of a table stored under `stage/item/port`.

        None if it has no clock or belongs to no log.

        A table with `t_s` that belongs to no segment (a bench leg, a closed-loop run)
        keeps its own seconds.
        """
        parts = name.split("/")
        leg = next((part for part in parts if part in self.legs), None)
        if "t_us" in table.column_names and leg is not None and table.num_rows:
            stamps = column(table, "t_us")
            return np.asarray((stamps - stamps[0]) * 1e-6 + self.legs[leg])
        log = next((part for part in parts if part in self.logs), None)
        if "time_us" in table.column_names and log is not None:
            seconds = column(table, "time_us") * 1e-6
            seconds -= self.boot_s[log]  # in place: of a log of hours
            seconds += self.logs[log]
            return seconds
        segment = next((part for part in parts if part in self.segments), None)
        if "t_s" in table.column_names:
            return np.asarray(
                column(table, "t_s") + (self.segments[segment] if segment is not None else 0.0)
            )
        return None


def log_seconds(log: LogInfo) -> float:
    """Length of a log from its first to its last time-stamped record."""
    return float(log.end_us - log.start_us) * 1e-6


def make_clock(
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    windows: Mapping[str, AxisWindowsRecord] = NO_WINDOWS,
) -> Clock:
    """Return the clock of logs one after the other, `LOG_GAP_S` apart.

    A segment starts at its place in its log, and so does the record of a leg of which
    single axes are fitted (`windows`, by leg).
    """
    starts, place = {}, 0.0
    for name, log in logs.items():
        starts[name] = place
        place += log_seconds(log) + LOG_GAP_S
    return Clock(
        segments={
            name: starts.get(item.log, 0.0) + item.leg_start_s for name, item in segments.items()
        },
        logs=starts,
        boot_s={name: log.start_us * 1e-6 for name, log in logs.items()},
        legs={item.leg: starts.get(item.log, 0.0) + item.start_s for item in windows.values()},
    )
