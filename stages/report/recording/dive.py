"""The first tab of a run with a dive: modes, legs, depth, attitude and actuators.

Training and validation are entities of their own: depth and yaw have the colours of the
use, roll and pitch their own ones, brighter on validation.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array
from auvid.stages.base import part_of
from auvid.stages.columns import FINS
from auvid.stages.number_format import visible
from auvid.stages.page.colours import AXIS_INKS, ROLES, Ink, distinct
from auvid.stages.report.clock import Clock
from auvid.stages.report.recording.blueprint import LoggedSeries, outer, spans_view, time_plot
from auvid.stages.report.recording.rerun_stream import Recording

DIVE = "Dive"
DEGREES = 180.0 / np.pi
FAINT, FULL = 150, 255
PLOTS = {
    "dive/depth": "depth below the surface, downwards [m]",
    "dive/tilt": "roll and pitch [°]",
    "dive/yaw": "yaw [°]",
    "dive/thrusters": "thrusters [N]",
    "dive/propeller": "propeller [rev/s]",
    "dive/fins": "fins [°]",
}
Ranges = dict[str, LoggedSeries]


def send_dive(
    out: Recording,
    fused: Mapping[str, pa.Table],
    tables: Mapping[str, pa.Table],
    segments: Mapping[str, SegmentRecord],
    logs: Mapping[str, LogInfo],
    clock: Clock,
) -> Ranges:
    """Send the series of the tab and return their ranges by plot; empty without a dive.

    Rerun draws larger values higher, so the depth has a minus sign.
    """
    ranges: Ranges = {}
    there = [name for name in segments if name in fused]
    if not there:
        return ranges
    _send_depths(out, ranges, tables, logs, clock)
    for use in dict.fromkeys(str(segments[name].use) for name in there):
        strength = FAINT if use == "training" else FULL
        tilt = [AXIS_INKS["phi"], AXIS_INKS["theta"]]
        _describe(out, ranges, f"dive/depth/{use}", [use], [ROLES[use]], FULL)
        _describe(out, ranges, f"dive/tilt/{use}", [f"roll {use}", f"pitch {use}"], tilt, strength)
        _describe(out, ranges, f"dive/yaw/{use}", [use], [ROLES[use]], FULL)
    actuators: dict[str, list[str]] = {}
    for name in there:
        table, use = fused[name], str(segments[name].use)
        times = column(table, "t_s") + clock.segments[name]
        _send(out, ranges, f"dive/depth/{use}", times, -matrix(table, ("z_m",)))
        angles = DEGREES * matrix(table, ("phi_rad", "theta_rad", "psi_rad"))
        _send(out, ranges, f"dive/tilt/{use}", times, angles[:, :2])
        _send(out, ranges, f"dive/yaw/{use}", times, angles[:, 2:])
        controls = tables.get(f"residual/{name}/controls")
        for kind, columns in _actuators(controls).items():
            entity = f"dive/{kind}/all"
            if kind not in actuators:
                actuators[kind] = columns
                inks = list(distinct(columns).values())
                labels = [words.rsplit("_", 1)[0].replace("_", " ") for words in columns]
                _describe(out, ranges, entity, labels, inks, FULL)
            if controls is not None and has_columns(controls, actuators[kind]):
                factor = DEGREES if kind == "fins" else 1.0
                values = factor * matrix(controls, actuators[kind])
                _send(out, ranges, entity, column(controls, "t_s") + clock.segments[name], values)
        out.stream.flush()  # else what is not yet written of all legs waits in memory
    return {
        plot: LoggedSeries(
            outer(item.values for item in items), outer(item.times for item in items)
        )
        for plot in PLOTS
        if (items := [item for entity, item in ranges.items() if entity.startswith(f"{plot}/")])
    }


def _send_depths(
    out: Recording,
    ranges: Ranges,
    tables: Mapping[str, pa.Table],
    logs: Mapping[str, LogInfo],
    clock: Clock,
) -> None:
    """Send the depth of the logs, in the legs and outside."""
    for name in logs:
        place = f"ingest/{name}/depth"
        depth = part_of(tables, place, ("depth_m",)) if place in tables else None
        times = None if depth is None else clock.seconds(place, depth)
        if depth is not None and times is not None and times.size:
            entity = "dive/depth/outside_the_legs"
            _describe(out, ranges, entity, ["outside the legs"], [ROLES["raw"]], FAINT)
            _send(out, ranges, entity, times, -column(depth, "depth_m")[:, None])


def _actuators(controls: pa.Table | None) -> dict[str, list[str]]:
    """Return kind -> columns of a table of controls."""
    kinds: dict[str, list[str]] = defaultdict(list)
    for name in [] if controls is None else controls.column_names:
        if name.startswith("thruster_"):
            kinds["thrusters"].append(name)
        elif name == "propeller_rev_s":
            kinds["propeller"].append(name)
        elif name in FINS:
            kinds["fins"].append(name)
    return kinds


def _describe(
    out: Recording,
    ranges: Ranges,
    entity: str,
    names: Sequence[str],
    inks: Sequence[Ink],
    alpha: int,
) -> None:
    if entity in ranges:
        return
    ranges[entity] = LoggedSeries()
    out.static(
        entity,
        rr.SeriesLines(
            names=[str(visible(name)) for name in names],
            colors=[(*item.rgb, alpha) for item in inks],
            widths=[item.width for item in inks],
            aggregation_policy="MinMax",
        ),
    )


def _send(out: Recording, ranges: Ranges, entity: str, times: Array, values: Array) -> None:
    out.series(entity, times, values)
    ranges[entity] = ranges[entity].add(times, values)


def dive_view(plots: Ranges, spans: tuple[float, float] | None, words: Any) -> Any:
    """Return the tab: lanes of modes and legs above the plots, on one range of time.

    `words`: the view of the summary, which stands beside them.
    """
    span = outer(item.times for item in plots.values())
    rows: list[Any] = [] if spans is None else [spans_view("Modes and legs", span)]
    rows += [
        time_plot(origin, PLOTS[origin], span, item.values, legend=True)
        for origin, item in plots.items()
    ]
    shares = [1.7 if isinstance(row, rrb.StateTimelineView) else 1.6 for row in rows]
    left = rrb.Vertical(*rows, row_shares=shares)
    return rrb.Horizontal(left, words, column_shares=[7, 3], name=DIVE)
