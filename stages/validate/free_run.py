"""Free runs of every model on the validation segments: simulated from measured
controls, against the measured motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import has_columns, make_table, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.equations_of_motion import Control
from auvid.hydro.dynamics.simulation.free_run import FreeRuns, free_runs
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.columns import ATTITUDE, POSE, VELOCITY, clock
from auvid.stages.presentation import Block, remark, table

FASTEST_HZ = 50.0
"""A free run steps at most this often: vehicles turn over seconds, and RK4 at 20 ms is
exact to 1e-7.
"""
FINS = ("fin_s_rad", "fin_p_rad", "fin_b_rad", "fin_t_rad")
SHOWN = (6, 7, 8, 9, 10, 11, 3, 4, 5)
NAMES = tuple(
    name.replace("_m_s", "_rms_m_s").replace("_rad", "_rms_rad", 1)
    for name in (*VELOCITY, *ATTITUDE)
)


def control_of(controls: pa.Table, rows: slice) -> tuple[Control, Array | None]:
    """Control series and level speed u_c (n,) of a `controls` table."""
    thrusters = [name for name in controls.column_names if name.startswith("thruster_")]

    def given(names: Sequence[str]) -> Array | None:
        return matrix(controls, names)[rows] if names and has_columns(controls, names) else None

    propeller = given(("propeller_rev_s",))
    level = given(("level_speed_m_s",))
    control = Control(
        propeller_rev_s=None if propeller is None else propeller[:, 0],
        fins_rad=given(FINS),
        thruster_force_N=given(thrusters),
    )
    return control, None if level is None else level[:, 0]


def run_segment(
    vehicle: Vehicle,
    models: Sequence[IdentifiedModel],
    trims: Array,
    fused: pa.Table,
    controls: pa.Table,
    *,
    horizons_s: Sequence[float],
    every_s: float,
    minimum_speed: float,
) -> FreeRuns | None:
    """Free runs over one segment, or None if it is shorter than the shortest horizon."""
    t_s = clock(fused)
    if t_s[-1] - t_s[0] < horizons_s[0]:
        return None
    rows = slice(None, None, max(1, round(1.0 / (FASTEST_HZ * float(np.mean(np.diff(t_s)))))))
    control, level = control_of(controls, rows)
    state = np.hstack([matrix(fused, POSE), matrix(fused, VELOCITY)])[rows]
    return free_runs(
        vehicle,
        models,
        trims,
        t_s[rows],
        state,
        control,
        level_speed=level,
        starts_s=np.arange(0.0, t_s[-1] - t_s[0], every_s),
        horizons_s=np.asarray(horizons_s),
        minimum_speed=minimum_speed,
    )


def free_run_table(found: Mapping[str, FreeRuns], names: Sequence[str]) -> pa.Table:
    """Rows per segment, model and horizon that the segment reaches."""
    heads = ("segment", "model", "horizon_s", "starts", "diverged", "first_divergence_s", *NAMES)
    rows: dict[str, list[Any]] = {head: [] for head in heads}
    for segment, runs in found.items():
        spread = runs.rms()[:, :, SHOWN]
        for place, horizon in enumerate(runs.horizons_s):
            for index, name in enumerate(names):
                gone = runs.diverged_s[index]
                ended = gone[np.isfinite(gone) & (gone <= horizon)]
                bounded = int(np.isfinite(runs.errors[index, :, place, 6]).sum())
                if not bounded and not ended.size:
                    continue
                values = (
                    segment,
                    name,
                    float(horizon),
                    bounded + ended.size,
                    int(ended.size),
                    float(ended.min()) if ended.size else np.nan,
                )
                for head, value in zip(
                    heads, (*values, *(float(x) for x in spread[index, place])), strict=True
                ):
                    rows[head].append(value)
    return make_table("free_run", rows)


def free_run_blocks(results: pa.Table, titles: Mapping[str, str]) -> list[Block]:
    """One table per segment, of what stayed bounded, and one warning that names what
    left the bounds.
    """
    if not results.num_rows:
        return []
    blocks: list[Block] = []
    data = results.to_pydict()
    heads: list[str | tuple[str, str]] = [
        "model",
        ("after", "s"),
        "starts",
        "diverged",
        *((name.split("_")[0], unit) for name, unit in _units()),
    ]
    for segment in dict.fromkeys(data["segment"]):
        rows = [
            [
                titles[data["model"][i]],
                data["horizon_s"][i],
                data["starts"][i],
                data["diverged"][i],
                *(data[name][i] for name in NAMES),
            ]
            for i in range(results.num_rows)
            if data["segment"][i] == segment and data["diverged"][i] < data["starts"][i]
        ]
        note = (
            "RMS of simulated minus measured state at that time after a measured start, over the"
            " runs that stayed bounded."
        )
        left_out = data["segment"].count(segment) - len(rows)
        note += f" {left_out} rows without a bounded run are left out." if left_out else ""
        if rows:
            blocks.append(
                table(f"Free run on {segment}: error of the state", heads, rows, note=note)
            )
    lost = [
        item
        for item in (_divergence(model, title, results) for model, title in titles.items())
        if item
    ]
    if lost:
        words = (
            f"Run freely, {len(lost)} of {len(titles)} models leave all bounds (10 m/s or 10"
            " rad/s), first after: "
        )
        words += ", ".join(f"{title} {first_s:.1f} s" for title, first_s, _ in lost) + "."
        for horizon in sorted({never for *_, never in lost if never is not None}):
            names = [title for title, _, never in lost if never == horizon]
            words += (
                f" No run of {horizon:g} s held:"
                f" {'all models' if len(names) == len(titles) > 1 else ', '.join(names)}."
            )
        blocks.insert(0, remark(words, "warning"))
    return blocks


def _divergence(
    model: str, title: str, results: pa.Table
) -> tuple[str, float, float | None] | None:
    """Title, when a model first left the bounds, and the shortest horizon that no run
    reached; None for a model that stayed.
    """
    rows = [row for row in results.to_pylist() if row["model"] == model]
    gone = [float(row["first_divergence_s"]) for row in rows if row["diverged"]]
    horizons = {float(row["horizon_s"]) for row in rows} - {
        float(row["horizon_s"]) for row in rows if row["diverged"] < row["starts"]
    }
    return (title, min(gone), min(horizons, default=None)) if gone else None


def _units() -> list[tuple[str, str]]:
    return [
        (name, "m/s" if name.endswith("m_s") else "rad/s" if name.endswith("rad_s") else "rad")
        for name in NAMES
    ]
