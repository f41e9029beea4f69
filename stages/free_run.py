"""Free runs on the validation segments: simulated from measured controls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import make_table, matrix
from auvid.hydro.arrays import STATES, VELOCITIES, Array, Mask
from auvid.hydro.dynamics.simulation.free_run import FreeRuns, MeasuredMotion, free_runs
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.regression.excitation import THRESHOLDS
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
FEWEST_ENDS = 5
"""Runs of a horizon from which on a fit in % is one of a motion, not of a few points."""
FIT = tuple(f"{name}_fit_percent" for name in VELOCITIES)
"""Columns of the fits in %, of the six velocities."""
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
    errors of expecting no change and no motion. nan for a fit without motion.
    """
    heads = (
        "segment", "model", "as_measured", "horizon_s", "starts", "diverged",
        "first_divergence_s", *NAMES, *FIT,
    )  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for (segment, put_in), runs in runs_of.items():
        error = runs.rms()[:, :, COMPARED]
        for place, horizon in enumerate(runs.horizons_s):
            reached = runs.reached[:, place]
            if not reached.any():
                continue
            ends = runs.starts[:, :6] - runs.persistence[:, place, :6]
            for index, name in enumerate(names):
                lost = runs.diverged_s[index, reached]
                lost = lost[np.isfinite(lost) & (lost <= horizon)]
                first = float(lost.min()) if lost.size else np.nan
                counts = (int(reached.sum()), int(lost.size), first)
                own = error[index, place].tolist()
                fits = fits_in_percent(runs.errors[index, :, place, :6], ends)
                rows.append((segment, name, put_in, float(horizon), *counts, *own, *fits))
            change = runs.persistence[reached, place]
            still = change.copy()
            still[:, :6] -= runs.starts[reached, :6]
            count = int(reached.sum())
            for name, missed in ((PERSISTENCE, change), (REST, still)):
                rms = np.sqrt(np.mean(missed**2, axis=0))[COMPARED]
                fits = fits_in_percent(missed[:, :6], ends[reached])
                rows.append((segment, name, put_in, float(horizon), count, 0, np.nan, *rms, *fits))
    return make_table(
        "free_run", {head: [row[place] for row in rows] for place, head in enumerate(heads)}
    )


def fits_in_percent(errors: Array, ends: Array) -> list[float]:
    """Return 100 (1 - RMS error / RMS departure from the mean) of six velocities.

    errors and ends (w, 6): simulated minus measured, and measured, at the end of each run;
    runs with errors that are nan are left out. nan where fewer than `FEWEST_ENDS` are left,
    or where the measured ends differ by less than motion that counts as excited
    (`excitation.THRESHOLDS`): there the best model would be at -1000 %.

    >>> ends = np.outer([-0.2, -0.1, 0.0, 0.1, 0.2], [1, 1, 1, 0.1, 1, 1])
    >>> np.round(fits_in_percent(0.5 * ends, ends), 6).tolist()
    [50.0, 50.0, 50.0, nan, 50.0, 50.0]
    """
    kept = np.isfinite(errors).all(axis=1) & np.isfinite(ends).all(axis=1)
    if np.count_nonzero(kept) < FEWEST_ENDS:
        return [float("nan")] * 6
    departure = np.std(ends[kept], axis=0)
    moves = departure >= [THRESHOLDS[name] for name in VELOCITIES]
    rms = np.sqrt(np.mean(np.square(errors[kept]), axis=0))
    ratio = rms / np.where(moves, departure, np.nan)
    return [float(fit) for fit in 100.0 * (1.0 - ratio)]
