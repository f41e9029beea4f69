"""The record of a leg as table `axis_record` and document `axis_windows`, and back."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.records.axes import AxisWindowsRecord, ThrusterEffect
from auvid.data_schemas.tables import column, has_columns, make_table, matrix
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.identification.axes.record import AxisRecord, LeftOut, ThrusterForces
from auvid.stages.columns import ATTITUDE, VELOCITY, named

FORCES = tuple(f"force_{axis}" for axis in AXES)
WINDOWS = tuple(f"window_{axis}" for axis in AXES)


def axis_record_table(record: AxisRecord, start_us: int) -> pa.Table:
    """Return the table of a record; start_us: boot clock at the start of the log."""
    numbers = np.full((record.t_s.size, len(AXES)), -1, dtype=np.int16)
    for axis, windows in record.windows.items():
        for number, (first, last) in enumerate(windows):
            numbers[first:last, AXES.index(axis)] = number
    columns: dict[str, Array | npt.NDArray[np.integer]] = {
        "t_us": start_us + np.rint(record.t_s * 1e6).astype(np.int64)
    }
    columns |= {name: record.rate[axis] for name, axis in zip(VELOCITY, VELOCITIES, strict=True)}
    if record.depth_m is not None:
        columns["depth_m"] = record.depth_m
    columns |= named(ATTITUDE, record.attitude_rad)
    columns |= {name: record.force[axis] for name, axis in zip(FORCES, AXES, strict=True)}
    columns |= {name: numbers[:, at] for at, name in enumerate(WINDOWS)}
    if record.thrusters is not None:
        columns |= named(_thrust_columns(record.thrusters.outputs), record.thrusters.force)
    return make_table("axis_record", columns)


def effects_of(thrusters: ThrusterForces) -> list[ThrusterEffect]:
    """Return what each thruster does, for the document of a record."""
    return [
        ThrusterEffect(output=output, effect=effect.tolist())
        for output, effect in zip(thrusters.outputs, thrusters.effect.T, strict=True)
    ]


def axis_record_of(table: pa.Table, windows: AxisWindowsRecord) -> AxisRecord:
    """Return the record of a leg that table and document hold."""
    numbers = matrix(table, WINDOWS)
    by_axis: Mapping[str, tuple[tuple[int, int], ...]] = {
        axis: _windows(numbers[:, at]) for at, axis in enumerate(AXES)
    }
    depth = column(table, "depth_m") if has_columns(table, ("depth_m",)) else None
    return AxisRecord(
        t_s=windows.start_s + np.arange(table.num_rows) / windows.rate_hz,
        rate={axis: column(table, name) for name, axis in zip(VELOCITY, VELOCITIES, strict=True)},
        depth_m=depth,
        attitude_rad=matrix(table, ATTITUDE),
        force={axis: column(table, name) for name, axis in zip(FORCES, AXES, strict=True)},
        normalised=windows.normalised,
        windows={axis: own for axis, own in by_axis.items() if own},
        left_out=tuple(
            LeftOut(item.axis, item.start_s, item.end_s, item.reason) for item in windows.left_out
        ),
        measured_by={str(axis): words for axis, words in windows.measured_by.items()},
        thrusters=_thrusters_of(table, windows),
    )


def _thrust_columns(outputs: Sequence[int]) -> tuple[str, ...]:
    """Return the columns of the forces of thrusters."""
    return tuple(f"thrust_{output}" for output in outputs)


def _thrusters_of(table: pa.Table, windows: AxisWindowsRecord) -> ThrusterForces | None:
    if not windows.thrusters:
        return None
    outputs = tuple(item.output for item in windows.thrusters)
    effect = np.array([item.effect for item in windows.thrusters]).T
    return ThrusterForces(outputs, matrix(table, _thrust_columns(outputs)), effect)


def _windows(numbers: Array) -> tuple[tuple[int, int], ...]:
    """Return first and last + 1 of each run of one number (n,) of 0 and above."""
    edges = [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), numbers.size]
    return tuple(
        (first, last)
        for first, last in itertools.pairwise(edges)
        if last > first and numbers[first] >= 0
    )
