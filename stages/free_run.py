"""Free runs on the validation segments: simulated from measured controls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import make_table, matrix
from auvid.hydro.arrays import STATES, Array, Mask
from auvid.hydro.dynamics.simulation.free_run import FreeRuns, MeasuredMotion, free_runs
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.columns import ATTITUDE, POSE, VELOCITY, clock, control_of

FASTEST_HZ = 50.0
"""A free run steps at most this often: vehicles turn over seconds, and RK4 at 20 ms is
exact to 1e-7.
"""
LONG_S = 10.0
"""Horizon at which a simulation is judged, or the longest below it."""
PERSISTENCE = "persistence"
"""The reference row: the state stays as it was at the start."""
REST = "rest"
"""The reference row: the vehicle does not move, and its angles stay."""
ANGLE_OF = {"p": "phi", "q": "theta", "r": "psi"}
COMPARED = [0, 1, 2, 3, 4, 5, 9, 10, 11]
"""Places of `NAMES` in the state [nu, eta]: all but the position."""
NAMES = tuple(
    name.replace("_m_s", "_rms_m_s").replace("_rad", "_rms_rad", 1)
    for name in (*VELOCITY, *ATTITUDE)
)


def measured_motion(fused: pa.Table, controls: pa.Table) -> MeasuredMotion:
    """Return what free runs over a segment start from, at `FASTEST_HZ` at most."""
    t_s = clock(fused)
    rows = slice(None, None, max(1, round(1.0 / (FASTEST_HZ * float(np.mean(np.diff(t_s)))))))
    control, level = control_of(controls, rows)
    state = matrix(fused, (*VELOCITY, *POSE))[rows]
    return MeasuredMotion(t_s[rows], state, control, level)


def run_segment(
    vehicle: Vehicle,
    models: Sequence[IdentifiedModel],
    trims: Array,
    added_mass: Array,
    motion: MeasuredMotion,
    *,
    horizons_s: Sequence[float],
    every_s: float,
    minimum_speed: float,
    as_measured: Sequence[str] = (),
    lags_s: Array | None = None,
) -> FreeRuns | None:
    """Return free runs over one segment, None if shorter than the shortest horizon.

    added_mass (m, 6, 6): what the inertia of each model adds to the vehicle's.
    as_measured: velocities put in as measured, with their angles. lags_s (m,): lag of
    the actuators of each model.
    """
    length = motion.t_s[-1] - motion.t_s[0]
    if length < horizons_s[0]:
        return None
    return free_runs(
        vehicle,
        models,
        trims,
        motion,
        starts_s=np.arange(0.0, length, every_s),
        horizons_s=np.asarray(horizons_s),
        minimum_speed=minimum_speed,
        added_mass=added_mass,
        imposed=imposed_states(as_measured),
        lags_s=lags_s,
    )


def imposed_states(velocities: Sequence[str]) -> Mask:
    """Return which states (12,) are put in: velocities, and angles of rotations."""
    names = {*velocities, *(ANGLE_OF[name] for name in velocities if name in ANGLE_OF)}
    return np.array([name in names for name in STATES])


def free_run_table(runs_of: Mapping[tuple[str, str], FreeRuns], names: Sequence[str]) -> pa.Table:
    """Return a row per segment, model and horizon that the segment reaches.

    runs_of: (segment, velocities put in as measured) -> runs. A run counts for a horizon
    that its data reach. The last rows of each horizon are `PERSISTENCE` and `REST`, the
    errors of expecting no change and no motion.
    """
    heads = (
        "segment", "model", "as_measured", "horizon_s", "starts", "diverged",
        "first_divergence_s", *NAMES,
    )  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for (segment, put_in), runs in runs_of.items():
        error = runs.rms()[:, :, COMPARED]
        for place, horizon in enumerate(runs.horizons_s):
            reached = runs.reached[:, place]
            if not reached.any():
                continue
            for index, name in enumerate(names):
                lost = runs.diverged_s[index, reached]
                lost = lost[np.isfinite(lost) & (lost <= horizon)]
                first = float(lost.min()) if lost.size else np.nan
                counts = (int(reached.sum()), int(lost.size), first)
                own = error[index, place].tolist()
                rows.append((segment, name, put_in, float(horizon), *counts, *own))
            change = runs.persistence[reached, place]
            still = change.copy()
            still[:, :6] += runs.starts[reached, :6]
            count = int(reached.sum())
            for name, missed in ((PERSISTENCE, change), (REST, still)):
                rms = np.sqrt(np.mean(missed**2, axis=0))[COMPARED]
                rows.append((segment, name, put_in, float(horizon), count, 0, np.nan, *rms))
    return make_table(
        "free_run", {head: [row[place] for row in rows] for place, head in enumerate(heads)}
    )
