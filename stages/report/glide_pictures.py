"""The pictures of a glide campaign: the yos with their settled glides, and the fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
from markupsafe import Markup

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import column, split_by
from auvid.hydro.arrays import Array, Mask
from auvid.hydro.constants import STANDARD_GRAVITY
from auvid.stages.page.pictures.answer_picture import ForceCloud, cloud_picture
from auvid.stages.page.pictures.drawing import CurveRow, SignalCurve
from auvid.stages.page.pictures.signal_picture import signal_picture

DEGREES = 180.0 / np.pi
MOST_GAP_S = 5.0
"""A longer pause of the log is a gap of the curve."""


def glide_pictures(
    glides: pa.Table, tables: Mapping[str, pa.Table], logs: Mapping[str, LogInfo]
) -> tuple[Markup, ...]:
    """Return depth, pitch, depth rate and speed of the first leg, and the fit."""
    by_leg = split_by(glides, "recording")
    leg, table = next(iter(by_leg.items()))
    t_s, glide = column(table, "t_s"), column(table, "glide")
    depth = column(table, "pressure_pa") / (column(table, "density_kg_m3") * STANDARD_GRAVITY)
    curves = _yos(tables, logs, float(np.mean(depth / column(table, "pressure_pa"))))
    span = (float(t_s[0]), float(t_s[-1]))
    if curves:
        span = (min(span[0], float(curves[0].x[0])), max(span[1], float(curves[0].x[-1])))
    settled = SignalCurve("fused", *_with_gaps(t_s, depth, glide))
    rows = [CurveRow("depth", "m", (*curves, settled), downwards=True)]
    pitch = DEGREES * column(table, "pitch_rad")
    rows.append(CurveRow("pitch", "°", (SignalCurve("fused", *_with_gaps(t_s, pitch, glide)),)))
    clouds = []
    for name, label in (("depth_rate", "depth rate"), ("speed", "speed through the water")):
        measured, fitted = (column(table, f"{name}_{item}_m_s") for item in ("measured", "fitted"))
        there = np.isfinite(measured)
        if there.any():
            pair = (("measured", measured), ("predicted", fitted))
            drawn = [SignalCurve(role, *_with_gaps(t_s, item, glide)) for role, item in pair]
            rows.append(CurveRow(label, "m/s", tuple(drawn)))
            clouds.append(ForceCloud(label, "m/s", measured[there], fitted[there]))
    note = f"first of {len(by_leg)} legs" if len(by_leg) > 1 else ""
    entries = [("settled glides", "fused"), ("measured", "measured"), ("fitted", "predicted")]
    return (
        signal_picture(
            f"Settled glides of leg {leg}", note, [(row, span) for row in rows], entries
        ),
        cloud_picture("Fitted (up) against measured (across)", note, clouds),
    )


def _yos(
    tables: Mapping[str, pa.Table], logs: Mapping[str, LogInfo], m_per_pa: float
) -> tuple[SignalCurve, ...]:
    """Return the depth of the whole log where there is one log only."""
    if len(logs) != 1:
        return ()
    ((name, log),) = logs.items()
    table = tables.get(f"ingest/{name}/glider")
    if table is None or "pressure_pa" not in table.column_names:
        return ()
    depth = m_per_pa * column(table, "pressure_pa")
    good: Mask = np.isfinite(depth)
    t_s = (table["time_us"].to_numpy()[good] - log.start_us) / 1e6
    part = np.cumsum(np.diff(t_s, prepend=t_s[:1]) > MOST_GAP_S)
    return (SignalCurve("measured", *_with_gaps(t_s, depth[good], part), thin=True),)


def _with_gaps(t_s: Array, values: Array, part: Array) -> tuple[Array, Array]:
    """Return times and values with a nan between two parts."""
    breaks = np.flatnonzero(np.diff(part)) + 1
    return np.insert(t_s, breaks, t_s[breaks]), np.insert(values, breaks, np.nan)
