"""Truth of a twin at the times of a segment, and errors of fused biases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.tables import column
from auvid.hydro.arrays import Array
from auvid.stages.base import Document
from auvid.stages.columns import clock

BIASES = {"gyro_bias_rad_s": "gyro_rad_s", "accel_bias_m_s2": "accel_m_s2"}
"""Bias in the fusion document -> the one drawn, in the simulation document."""


def true_values(truth: pa.Table, names: Sequence[str], at: Array) -> Array:
    """Return columns of a truth table (n, k) at times (n,) [s] of its log.

    Straight between the ticks of the autopilot.
    """
    return np.column_stack([np.interp(at, clock(truth), column(truth, name)) for name in names])


def truth_of(truths: Mapping[str, pa.Table], segment: SegmentRecord, at: Array) -> pa.Table:
    """Return the truth of a segment's log.

    Raises `DataError` where there is none, or where it does not cover the times (n,)
    [s].
    """
    log = str(segment.log)
    if log not in truths:
        raise DataError(f"there is no truth of log '{log}'", allowed=tuple(truths))
    clock_s = clock(truths[log])
    if not len(at) or at[0] < clock_s[0] or at[-1] > clock_s[-1]:
        raise DataError(
            f"the truth of log '{log}' does not cover segment '{segment.id}'",
            value=(float(clock_s[0]), float(clock_s[-1])),
        )
    return truths[log]


def drawn_biases(simulation: Document) -> dict[str, Mapping[str, Sequence[float]]]:
    """Return the biases that a twin's sensors had, by log."""
    return {str(leg["id"]): leg["biases"] for leg in simulation["legs"]}


def bias_errors(
    fusion: FusionRecord, drawn: Mapping[str, Sequence[float]], rotation: npt.ArrayLike
) -> dict[str, tuple[Array, Array]]:
    """Return estimate minus truth, and truth (3,), of each fused bias.

    In body axes; `rotation` takes sensor axes to body axes.

    Keys as in `BIASES`; a bias is left out where the method found none or the twin says
    none.
    """
    errors = {}
    for name, sensor_bias in BIASES.items():
        fused: list[float] | None = getattr(fusion, name)
        if fused is not None and sensor_bias in drawn:
            true = np.asarray(rotation, dtype=np.float64) @ np.asarray(
                drawn[sensor_bias], dtype=np.float64
            )
            errors[name] = (np.asarray(fused, dtype=np.float64) - true, true)
    return errors
