"""Free runs of a model against a measured motion.

The model moves by itself from measured controls and one measured state.

A force error hides what a model does over time: a small bias turns into a wrong
heading, an unstable coefficient set leaves the run. Several starting points and several
models run at once as one batch (McCarter 2.60-2.66 with the identified tau_nu).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Index, Mask
from auvid.hydro.dynamics.equations_of_motion import Control, state_derivative
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.simulation.runge_kutta import runge_kutta_4
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import (
    basis,
    basis_term_names,
    eta_ratio,
    needs_propeller_speed,
)
from auvid.hydro.dynamics.viscous.models import IdentifiedModel, coefficient_matrix

SPEED_LIMIT, RATE_LIMIT = 10.0, 10.0
"""Speeds [m/s] and rates [rad/s] beyond which a run has diverged: no vehicle of ours
comes near them.
"""


@dataclass(frozen=True)
class FreeRuns:
    """Runs of m models from w starting points.

    State errors (m, w, k, 12) at `horizons_s` (k,), simulated minus measured, yaw error
    wrapped; nan where the run had diverged. `diverged_s` (m, w): seconds after the
    start, nan for a run that stayed bounded. `reached` (w, k): whether the data go on
    to that horizon. `persistence` (w, k, 12): what the measured state changed by, the
    error of expecting no change. `starts` (w, 12): measured states at the starts.
    """

    horizons_s: Array
    errors: Array
    diverged_s: Array
    reached: Mask
    persistence: Array
    starts: Array

    def rms(self) -> Array:
        """Return the RMS over the starts that stayed bounded: (m, k, 12).

        nan where none did.
        """
        count = np.sum(np.isfinite(self.errors), axis=1)
        total = np.nansum(self.errors**2, axis=1)
        return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def free_runs(
    vehicle: Vehicle,
    models: Sequence[IdentifiedModel],
    trims: ArrayLike,
    t_s: ArrayLike,
    state: ArrayLike,
    control: Control,
    *,
    level_speed: ArrayLike | None = None,
    starts_s: ArrayLike,
    horizons_s: ArrayLike,
    minimum_speed: float = 0.05,
    added_mass: ArrayLike | None = None,
) -> FreeRuns:
    """Simulate every model from every start with RK4.

    Its steps are those of the uniform clock t_s (n,) [s].

    state (n, 12): measured [eta, nu]; control: series (n, ...); level_speed (n,) u_c(n)
    [m/s] where models have terms with eta; trims (m, 6) [N, N m]; starts_s (w,),
    horizons_s (k,) ascending [s]. added_mass (m, 6, 6): what each model's inertia adds
    to M_A of the vehicle: (M - dM_A) nu_dot = M nu_dot_0 + C(dM_A, nu) nu, with nu_dot_0
    the acceleration at the vehicle's own inertia. A horizon beyond the end of the data
    counts as nan. Raises `DataError` when no start leaves room for the shortest horizon.
    """
    t, measured = np.asarray(t_s, dtype=np.float64), np.asarray(state, dtype=np.float64)
    starts, horizons = (
        np.asarray(starts_s, dtype=np.float64),
        np.asarray(horizons_s, dtype=np.float64),
    )
    starts = starts[starts + horizons[0] <= t[-1] - t[0] + 1e-9]
    if not len(starts):
        raise DataError(
            "the segment is shorter than the shortest horizon of the free run",
            value=float(t[-1] - t[0]),
            allowed=f"{horizons[0]} s",
        )
    step = float(t[-1] - t[0]) / (len(t) - 1)
    first = np.round(starts / step).astype(np.intp)
    after = np.round(horizons / step).astype(np.intp)
    force = _forces(
        models, np.asarray(trims, dtype=np.float64), level_speed is not None, minimum_speed
    )
    M = vehicle.mass_matrix
    change = np.zeros((len(models), 1, 6, 6))
    if added_mass is not None:
        change[:, 0] = np.asarray(added_mass, dtype=np.float64)
    gain = np.linalg.solve(M - change, np.broadcast_to(M, change.shape))
    level = None if level_speed is None else np.asarray(level_speed, dtype=np.float64)
    x = np.broadcast_to(measured[first], (len(models), len(first), 12)).copy()
    errors = np.full((len(models), len(first), len(after), 12), np.nan)
    diverged = np.full(x.shape[:2], np.nan)
    last = len(t) - 1

    with np.errstate(all="ignore"):
        for count in range(int(after[-1])):
            low = np.minimum(first + count, last)

            def derivative(now: Array, share: float, low: Index = low) -> Array:
                high = np.minimum(low + 1, last)
                speed = None if level is None else _between(level, low, high, share)
                slope = state_derivative(
                    vehicle,
                    now,
                    _control_at(control, low, high, share),
                    lambda nu: force(nu, speed) + coriolis_force(change, nu),
                )
                slope[..., 6:] = (gain @ slope[..., 6:, None])[..., 0]
                return slope

            x = runge_kutta_4(derivative, x, step)
            gone = ~(
                np.all(np.abs(x[..., 6:9]) < SPEED_LIMIT, axis=-1)
                & np.all(np.abs(x[..., 9:]) < RATE_LIMIT, axis=-1)
            )
            inside = first + count + 1 <= last
            diverged = np.where(gone & np.isnan(diverged) & inside, (count + 1) * step, diverged)
            x[gone] = np.nan
            for place in np.flatnonzero(after == count + 1):
                there = np.minimum(first + count + 1, last)
                errors[:, inside, place] = (x - measured[there])[:, inside]
    reached = first[:, None] + after <= last
    kept = measured[first][:, None] - measured[np.minimum(first[:, None] + after, last)]
    kept[~reached] = np.nan
    for part in (errors, kept):
        part[..., 5] = (part[..., 5] + np.pi) % (2 * np.pi) - np.pi
    return FreeRuns(horizons, errors, diverged, reached, kept, measured[first])


def _forces(
    models: Sequence[IdentifiedModel], trims: Array, with_ratio: bool, minimum_speed: float
) -> Callable[[Array, Array | None], Array]:
    """tau_nu of all models at once: nu (m, w, 6), u_c (w,) -> (m, w, 6)."""
    used = {term for model in models for axis in model.coefficients.values() for term in axis}
    terms = tuple(term for term in basis_term_names() if term in used)
    if not with_ratio and any(needs_propeller_speed(term) for term in terms):
        raise DataError(
            "a model has terms with the propulsion ratio, but the propeller speed is not known"
        )
    gains = (
        np.stack([coefficient_matrix(model.coefficients, terms) for model in models])
        if terms
        else np.zeros((len(models), 6, 0))
    )

    def force(nu: Array, level: Array | None) -> Array:
        ratio = None if level is None else eta_ratio(level, nu, minimum_speed)
        return np.asarray(
            np.einsum("mij,mwj->mwi", gains, basis(nu, ratio, terms)) + trims[:, None, :]
        )

    return force


def _between(values: ArrayLike, low: Index, high: Index, share: float) -> Array:
    array = np.asarray(values, dtype=np.float64)
    return np.asarray((1.0 - share) * array[low] + share * array[high])


def _control_at(control: Control, low: Index, high: Index, share: float) -> Control:
    """The control series linearly between two samples, per starting point."""
    return Control(
        **{
            name: None if series is None else _between(series, low, high, share)
            for name, series in vars(control).items()
        }
    )
