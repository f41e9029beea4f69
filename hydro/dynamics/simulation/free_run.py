"""Free runs of a model against a measured motion.

The model moves by itself from measured controls and one measured state.

A force error hides what a model does over time: a small bias turns into a wrong
heading, an unstable coefficient set leaves the run. Several starting points and several
models run at once as one batch (McCarter 2.60-2.66 with the identified tau_nu).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Index, Mask
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.equations_of_motion import Control, actuator_force
from auvid.hydro.dynamics.simulation.plant_constants import Tables, padded, plant_tables
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import needs_propeller_speed
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.long_series.threads import THREADS, at_once

SPEED_LIMIT, RATE_LIMIT = 10.0, 10.0
"""Speeds [m/s] and rates [rad/s] beyond which a run has diverged: no vehicle of ours
comes near them.
"""
LIMITS = np.array([SPEED_LIMIT] * 3 + [RATE_LIMIT] * 3 + [np.inf] * 6)
"""Of each state; a position or an angle has none but to be finite."""
LOOKED_AT = 40
"""Measured states at which a lost run is looked at."""


@dataclass(frozen=True)
class FreeRuns:
    """Runs of m models from w starting points.

    State errors (m, w, k, 12) at `horizons_s` (k,), simulated minus measured, angles
    between -pi and pi; nan where the run had diverged. `diverged_s` (m, w): seconds after the
    start, nan for a run that stayed bounded. `reached` (w, k): whether the data go on
    to that horizon. `persistence` (w, k, 12): what the measured state changed by, the
    error of expecting no change. `starts` (w, 12): measured states at the starts.
    `lost_motion`: model -> measured states (n, 12) of the run that it loses soonest.
    """

    horizons_s: Array
    errors: Array
    diverged_s: Array
    reached: Mask
    persistence: Array
    starts: Array
    lost_motion: Mapping[int, Array]

    def rms(self) -> Array:
        """Return the RMS over the starts that stayed bounded: (m, k, 12).

        nan where none did.
        """
        count = np.sum(np.isfinite(self.errors), axis=1)
        total = np.nansum(self.errors**2, axis=1)
        return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


@dataclass(frozen=True)
class MeasuredMotion:
    """A motion on a uniform clock that free runs start from, with its actuators.

    t_s (n,) [s]; state (n, 12): measured [nu, eta]; control: series (n, ...);
    level_speed (n,): u_c(n) [m/s] where models have terms with eta.
    """

    t_s: Array
    state: Array
    control: Control
    level_speed: Array | None = None

    @property
    def step_s(self) -> float:
        """Return the step of the clock [s]."""
        return float(self.t_s[-1] - self.t_s[0]) / (len(self.t_s) - 1)

    def samples(self, seconds: ArrayLike) -> Index:
        """Return samples of times after the first."""
        return np.round(np.asarray(seconds, dtype=np.float64) / self.step_s).astype(np.intp)

    def some_states(self, start: int, seconds: float) -> Array:
        """Return some measured states (n, 12) from a sample on, over `seconds`."""
        last = min(start + max(int(self.samples(seconds)), 1), len(self.state) - 1)
        at = np.unique(np.linspace(start, last, LOOKED_AT).astype(np.intp))
        return self.state[at]

    def inputs(self, vehicle: Vehicle) -> Array:
        """Return what acts (n, 12): propeller, u_c(n), fins (4), thruster force (6).

        Raises `DataError` for an actuator of the vehicle without a command.
        """
        acting = np.zeros((len(self.t_s), 12))
        forces = actuator_force(vehicle, self.state[:, :6], self.control)
        if vehicle.propeller is not None:
            acting[:, 0] = self.control.propeller_rev_s
        if self.level_speed is not None:
            acting[:, 1] = self.level_speed
        if vehicle.fins is not None:
            acting[:, 2:6] = self.control.fins_rad
        acting[:, 6:] = forces.get("thrusters", 0.0)
        return acting


@dataclass(frozen=True)
class WanderingForce:
    """A force beside the model: a normal disturbance that wanders, by model and axis.

    deviation (m, 6) [N, N m]; time_s (6,): over which it forgets itself, as exp(-t /
    time_s); seed.
    """

    deviation: Array
    time_s: Array
    seed: int = 0


def fly_freely(
    vehicle: Vehicle,
    coefficients: Sequence[IdentifiedModel],
    trims: Array,
    motion: MeasuredMotion,
    *,
    first: Index,
    steps: Index,
    added_mass: Array | None = None,
    imposed: Mask | None = None,
    minimum_speed: float = 0.05,
    disturbance: WanderingForce | None = None,
    lags_s: Array | None = None,
    coriolis: bool = True,
) -> tuple[Array, Array]:
    """Return states (m, w, k, 12) at `steps` (k,) after each start, and losses (m, w).

    RK4 with the steps of the clock. first (w,): samples of the starts; steps ascending
    from 0. added_mass (m, 6, 6): what each model adds to M_A of the vehicle; imposed
    (12,): states put in as measured. lags_s (m,): by which the actuators of each model
    are late, over all of the motion. coriolis: whether that force acts. A loss is seconds
    after the start until a velocity is beyond its limit, nan for never; states after a
    loss, and after the end of the motion, are nan. Models of one set of terms and one lag
    fly as one batch.
    """
    # Imported here, since numba takes a second.
    from auvid.hydro.dynamics.simulation.compiled import FACTOR_COUNT
    from auvid.hydro.dynamics.simulation.compiled_free_run import Course, ModelRows, fly

    if motion.level_speed is None and any(
        needs_propeller_speed(term) for model in coefficients for term in model.terms
    ):
        raise DataError(
            "a model has terms with the propulsion ratio, but the propeller speed is not known"
        )
    count = len(coefficients)
    inputs, lags = motion.inputs(vehicle), np.zeros(count) if lags_s is None else lags_s
    # Copies: numba compiles the loop once more for arrays that cannot be written to.
    courses = {
        lag_s: Course(
            motion.state.flatten(),
            first_order_lag(inputs, lag_s=lag_s, step_s=motion.step_s).flatten(),
            np.array(first, dtype=np.int64),
            np.array(steps, dtype=np.int64),
            np.zeros(12) if imposed is None else np.array(imposed, dtype=np.float64),
            LIMITS,
            len(motion.t_s),
            motion.step_s,
        )
        for lag_s in set(lags.tolist())
    }
    states = np.full((count, len(first), len(steps), 12), np.nan)
    lost = np.empty((count, len(first)))
    masses = np.broadcast_to(vehicle.mass_matrix, (count, 6, 6))
    if added_mass is not None:
        masses = masses - added_mass
    batches: dict[tuple[tuple[str, ...], float], list[int]] = {}
    for i, model in enumerate(coefficients):
        batches.setdefault((model.terms, float(lags[i])), []).append(i)
    for (_, lag_s), members in batches.items():
        tables = plant_tables(
            vehicle, coefficients[members[0]], lag_s=0.0, minimum_speed=minimum_speed
        )
        wander = np.zeros((len(members), 6)) if disturbance is None else disturbance.deviation
        rho = np.zeros(6) if disturbance is None else np.exp(-motion.step_s / disturbance.time_s)
        models = ModelRows(
            coriolis * masses[members].reshape(-1, 36),
            np.asarray(np.linalg.inv(masses[members]), dtype=np.float64).reshape(-1, 36),
            padded(np.stack([coefficients[i].matrix for i in members])).reshape(len(members), -1),
            trims[members],
            np.ascontiguousarray(wander if disturbance is None else wander[members]),
            rho,
            np.array(members, dtype=np.int64) + (0 if disturbance is None else disturbance.seed),
        )
        out, gone = np.full((len(members), *states.shape[1:]), np.nan), lost[members]
        share = -(-len(members) // THREADS)

        def run(
            start: int,
            models: ModelRows = models,
            tables: Tables = tables,
            out: Array = out,
            gone: Array = gone,
            share: int = share,
            course: Course = courses[lag_s],
        ) -> None:
            scratch, factors = np.empty((6, 12)), np.empty(FACTOR_COUNT + tables.counts[0])
            stop = min(start + share, len(out))
            fly(course, models, tables, start, stop, scratch, factors, out, gone)

        at_once(run, range(0, len(members), share))
        states[members], lost[members] = out, gone
    return states, lost


def free_runs(
    vehicle: Vehicle,
    models: Sequence[IdentifiedModel],
    trims: ArrayLike,
    motion: MeasuredMotion,
    *,
    starts_s: ArrayLike,
    horizons_s: ArrayLike,
    minimum_speed: float = 0.05,
    added_mass: Array | None = None,
    imposed: Mask | None = None,
    lags_s: Array | None = None,
) -> FreeRuns:
    """Simulate every model from every start, and compare at horizons.

    trims (m, 6) [N, N m]; starts_s (w,), horizons_s (k,) ascending [s]; the rest as
    `fly_freely`. A horizon beyond the end of the data counts as nan. Raises `DataError`
    when no start leaves room for the shortest horizon.
    """
    measured, horizons = motion.state, np.asarray(horizons_s, dtype=np.float64)
    length = float(motion.t_s[-1] - motion.t_s[0])
    starts = np.asarray(starts_s, dtype=np.float64)
    starts = starts[starts + horizons[0] <= length + 1e-9]
    if not len(starts):
        raise DataError(
            "the segment is shorter than the shortest horizon of the free run",
            value=length,
            allowed=f"{horizons[0]} s",
        )
    first, after = motion.samples(starts), motion.samples(horizons)
    states, diverged = fly_freely(
        vehicle,
        models,
        np.asarray(trims, dtype=np.float64),
        motion,
        first=first,
        steps=np.concatenate([[0], after]),
        added_mass=added_mass,
        imposed=imposed,
        minimum_speed=minimum_speed,
        lags_s=lags_s,
    )
    last = len(motion.t_s) - 1
    reached = first[:, None] + after <= last
    there = measured[np.minimum(first[:, None] + after, last)]
    errors, kept = states[:, :, 1:] - there, measured[first][:, None] - there
    kept[~reached] = np.nan
    for part in (errors, kept):
        part[..., 9:] = wrapped(part[..., 9:])
    soonest = {
        i: int(np.nanargmin(lost)) for i, lost in enumerate(diverged) if np.isfinite(lost).any()
    }
    lost_motion = {i: motion.some_states(first[w], diverged[i, w]) for i, w in soonest.items()}
    return FreeRuns(horizons, errors, diverged, reached, kept, measured[first], lost_motion)


def wrapped(angle: Array) -> Array:
    """Return angles [rad] between -pi and pi."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
