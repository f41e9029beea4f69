"""Closed-loop flights of a batch of vehicles.

Plant, schedule of a controller, limits of the inputs, disturbances, observer in the
loop.

The controller is asked once per tick and its inputs are held; the plant moves by
Runge-Kutta 4 in between. Members of a batch share the trajectory and the schedule and
may differ in parameters, disturbance, start, and in whether the observer's estimate is
used.

Equations of Al Makdah 2016.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array, matrix_product
from auvid.hydro.control.controllers import Schedule
from auvid.hydro.control.equilibrium import Equilibrium
from auvid.hydro.control.observer import D, N
from auvid.hydro.control.paths.trajectories import Trajectory, tracking_error
from auvid.hydro.control.plants import ControlledPlant, InputLimits
from auvid.hydro.control.reference import ModeSwitch, Reference, Waiting
from auvid.hydro.control.riccati import exponential

LOST_M = 1e4
"""A member further than this from its path has diverged; it is nan from there on."""


@dataclass(frozen=True)
class Flights:
    """Motion, inputs and estimates of flights over `t_s` (n,).

    `chi` (..., n, 12), `U` (..., n, m) as applied, `disturbance` (..., n, 6): the
    observer's estimate [m/s^2, rad/s^2], `reference_s` (..., n): the time on the
    (first) trajectory at which the controller aims; `powered` (..., n): 1 while the
    second of two schedules is in force.
    """

    t_s: Array
    chi: Array
    U: Array
    disturbance: Array
    reference_s: Array
    powered: Array


def force_field(t_s: Array, given: Mapping[str, Any]) -> Array:
    """The force field of section 4.4 in NED (n, 3) [N] at `t_s`.

    `constant_N` (3,) plus `amplitude_N` (3,) sin(`rate_rad_s` t + `phase_rad`), from
    `start_s` on. Raises `CampaignError` where a list has not three numbers.
    """
    columns = {}
    for key in ("constant_N", "amplitude_N", "rate_rad_s", "phase_rad"):
        values = np.asarray(given.get(key, [0.0, 0.0, 0.0]), dtype=np.float64)
        if values.shape != (3,):
            raise CampaignError(
                "a force field has three components, north, east and down",
                field=f"disturbance.{key}",
                value=values.tolist(),
            )
        columns[key] = values
    wave = columns["amplitude_N"] * np.sin(
        t_s[:, None] * columns["rate_rad_s"] + columns["phase_rad"]
    )
    return np.where(
        t_s[:, None] >= float(given.get("start_s", 0.0)), columns["constant_N"] + wave, 0.0
    )


def fly(
    plant: ControlledPlant,
    schedules: Schedule | Sequence[Schedule],
    *,
    start: ArrayLike | None = None,
    force_ned_N: ArrayLike | None = None,
    current_ned_m_s: ArrayLike | None = None,
    use_observer: ArrayLike = True,
    waiting: Waiting | None = None,
    switch: ModeSwitch | None = None,
    duration_s: float | None = None,
    members: int | None = None,
) -> Flights:
    """Fly a batch of b members along the schedule of a controller.

    It lasts as long as the (first) schedule, or `duration_s`.

    `start` (12,) or (b, 12): default on the trajectory. `force_ned_N` (n, 3) or (b, n,
    3) over time; `current_ned_m_s` (3,) or (b, 3); `use_observer` () or (b,).
    `waiting`: None for a reference that keeps to the clock, as in the thesis. `switch`:
    between two schedules of one path at two speeds, which needs a waiting reference.
    `members`: b, where no argument tells it. A member that diverges is nan from there
    on. Raises `CampaignError` where schedules, switch and reference do not go together.
    """
    given = (schedules,) if isinstance(schedules, Schedule) else tuple(schedules)
    if len(given) != (1 if switch is None else 2) or (switch is not None and waiting is None):
        raise CampaignError(
            "a mode switch needs two schedules and a waiting reference",
            field="switch",
            value=len(given),
        )
    equilibrium = given[0].equilibrium
    n = (
        len(equilibrium.t_s)
        if duration_s is None
        else min(len(equilibrium.t_s), round(duration_s / equilibrium.step_s) + 1)
    )
    m = equilibrium.U.shape[1]
    use = np.asarray(use_observer, dtype=np.float64)
    first = equilibrium.chi[0] if start is None else np.asarray(start, dtype=np.float64)
    force = np.zeros((n, 3)) if force_ned_N is None else np.asarray(force_ned_N, dtype=np.float64)
    b = members or max(
        np.size(use), len(first) if first.ndim == 2 else 1, len(force) if force.ndim == 3 else 1
    )
    force = np.broadcast_to(force[..., :n, :], (b, n, 3))
    pushed, observed = bool(np.any(force)), given[0].observer is not None
    use = np.broadcast_to(use, (b,))[:, None]
    chi = np.broadcast_to(first, (b, N)).copy()
    U = np.broadcast_to(
        np.clip(equilibrium.U[0], plant.inputs.low, plant.inputs.high), (b, m)
    ).copy()
    Z = np.concatenate([chi - equilibrium.chi[0], np.zeros((b, D))], axis=1)
    flown = Flights(
        equilibrium.t_s[:n], *(np.zeros((b, n, *size)) for size in ((N,), (m,), (D,), (), ()))
    )
    reference = Reference(given, b, waiting)
    with np.errstate(all="ignore"):  # a member that diverges becomes nan
        for tick in range(n):
            wanted_chi, U_eq, mass = (
                reference.value("chi"),
                reference.value("U"),
                reference.value("mass_kg"),
            )
            if switch is not None and reference.switch(switch, plant, chi, Z[:, N:] * use, mass):
                Z[:, :N] += wanted_chi - reference.value("chi")
                wanted_chi, U_eq, mass = (
                    reference.value("chi"),
                    reference.value("U"),
                    reference.value("mass_kg"),
                )
            wanted, deviation = U_eq, chi - wanted_chi
            if observed:
                d = Z[:, N:] * use
                wanted = wanted + matrix_product(reference.value("inputs"), d)
                deviation = Z[:, :N] - matrix_product(reference.value("state"), d)
            U = limited(
                wanted - matrix_product(reference.value("k"), deviation),
                U,
                plant.inputs,
                equilibrium.step_s,
            )
            flown.chi[:, tick], flown.U[:, tick], flown.disturbance[:, tick] = chi, U, Z[:, N:]
            flown.reference_s[:, tick], flown.powered[:, tick] = reference.time_s, reference.mode
            if tick == n - 1:
                break
            if observed:
                Z = matrix_product(reference.value("phi"), Z) + matrix_product(
                    reference.value("by_input"), U - U_eq
                )
                by_state = reference.value("by_state")
            before = chi - wanted_chi
            chi = _advance(
                plant,
                chi,
                U,
                mass,
                force[:, tick] if pushed else None,
                current_ned_m_s,
                equilibrium.step_s,
            )
            ahead, shift = reference.advance(chi, equilibrium.step_s * (tick + 1))
            after = chi - ahead
            chi[~(np.abs(after[:, 6:9]).max(axis=1) < LOST_M)] = np.nan
            if observed:
                Z = Z + matrix_product(by_state, 0.5 * (before + after))
                Z[:, :N] += shift
    return flown


def limited(wanted: Array, before: Array, limits: InputLimits, step_s: float) -> Array:
    """Return inputs (..., m) within their limits and limits of their rates."""
    reach = limits.rate * step_s
    return np.clip(np.clip(wanted, before - reach, before + reach), limits.low, limits.high)


def _advance(
    plant: ControlledPlant,
    chi: Array,
    U: Array,
    mass: ArrayLike,
    force: Array | None,
    current: ArrayLike | None,
    h: float,
) -> Array:
    def rate(x: Array) -> Array:
        return plant.rate(x, U, mass_kg=mass, force_ned_N=force, current_ned_m_s=current)

    k1 = rate(chi)
    k2 = rate(chi + 0.5 * h * k1)
    k3 = rate(chi + 0.5 * h * k2)
    return np.asarray(chi + h / 6.0 * (k1 + 2.0 * (k2 + k3) + rate(chi + h * k3)))


def linear_response(
    equilibrium: Equilibrium, A: Array, B: Array, U: ArrayLike, *, start: ArrayLike
) -> Array:
    """Return chi (n, 12) of the linear model (3.18) along an equilibrium.

    A (n, 12, 12), B (n, 12, m), under inputs U (n, m) from `start` (12,).

    Exact over each tick with A and B held. The equilibrium's own residual, which (3.18)
    leaves out, is left out here too.
    """
    m = B.shape[-1]
    whole = np.zeros((len(A), N + m, N + m))
    whole[:, :N, :N], whole[:, :N, N:] = A, B
    flow = exponential(whole * equilibrium.step_s)[:, :N]
    out = np.empty(equilibrium.chi.shape)
    deviation = np.asarray(start, dtype=np.float64) - equilibrium.chi[0]
    moved = np.asarray(U, dtype=np.float64) - equilibrium.U
    for tick in range(len(out)):
        out[tick] = equilibrium.chi[tick] + deviation
        deviation = flow[tick, :, :N] @ deviation + flow[tick, :, N:] @ moved[tick]
    return out


@dataclass(frozen=True)
class Performance:
    """Errors, inputs and effort of each member (...) of a batch.

    Errors after the transient [m], attitude RMS [rad] (..., 3), share of time at a
    limit and effort per input (..., m).

    `position_rms_m` is against the place of that time, `cross_track_rms_m` and
    `cross_track_max_m` against the nearest point of the path; `steady_m`: the largest
    distance to the place of that time over the last fifth.
    """

    position_rms_m: Array
    cross_track_rms_m: Array
    cross_track_max_m: Array
    steady_m: Array
    attitude_rms_rad: Array
    at_limit: Array
    effort: Array
    position_m: Array
    cross_track_m: Array


def performance(
    trajectory: Trajectory,
    flights: Flights,
    found_chi: Array,
    inputs: InputLimits,
    *,
    after_s: float = 0.0,
) -> Performance:
    """Return the performance of flights (..., n) from `after_s` on.

    Effort is the RMS of an input. A member that diverged has nan.

    Raises `CampaignError` where the flight is over by then.
    """
    position, n = flights.chi[..., 6:9], len(flights.t_s)
    error = tracking_error(trajectory, position)
    kept = flights.t_s >= after_s
    if not kept.any():
        limit = f"below {flights.t_s[-1]:g} s"
        raise CampaignError(
            "the transient that is left out is longer than the flight",
            field="transient",
            value=after_s,
            allowed=limit,
        )
    late = flights.t_s >= flights.t_s[-1] - 0.2 * (flights.t_s[-1] - flights.t_s[0])
    turned = flights.chi[..., 9:] - found_chi[:n, 9:]
    turned = np.arctan2(np.sin(turned), np.cos(turned))
    span = 1e-6 * (inputs.high - inputs.low)
    at_limit = (inputs.high - span <= flights.U) | (inputs.low + span >= flights.U)

    def rms(values: Array, axis: int = -1) -> Array:
        return np.asarray(np.sqrt(np.mean(values**2, axis=axis)))

    return Performance(
        position_rms_m=rms(error.position_m[..., kept]),
        cross_track_rms_m=rms(error.cross_track_m[..., kept]),
        cross_track_max_m=np.asarray(error.cross_track_m[..., kept].max(axis=-1)),
        steady_m=np.asarray(error.position_m[..., late].max(axis=-1)),
        attitude_rms_rad=rms(turned[..., kept, :], axis=-2),
        at_limit=np.asarray(at_limit.mean(axis=-2)),
        effort=rms(flights.U, axis=-2),
        position_m=error.position_m,
        cross_track_m=error.cross_track_m,
    )
