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

from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class ForceField:
    """The force field of section 4.4 in NED, from `start_s` on.

    `constant_N` + `amplitude_N` sin(`rate_rad_s` t + `phase_rad`), each (3,).
    """

    constant_N: ArrayLike = (0.0, 0.0, 0.0)
    amplitude_N: ArrayLike = (0.0, 0.0, 0.0)
    rate_rad_s: ArrayLike = (0.0, 0.0, 0.0)
    phase_rad: ArrayLike = (0.0, 0.0, 0.0)
    start_s: float = 0.0

    def at(self, t_s: Array) -> Array:
        """Return the force (n, 3) [N] at times (n,)."""
        t = t_s[:, None]
        angle = t * np.asarray(self.rate_rad_s) + np.asarray(self.phase_rad)
        force = np.asarray(self.constant_N) + np.asarray(self.amplitude_N) * np.sin(angle)
        return np.where(t >= self.start_s, force, 0.0)


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

    At each tick U = U_eq + Gamma d - k (chi_hat - chi_eq - Pi d), (3.22) and (5.9)
    corrected, within the limits of the inputs; without an observer chi_hat is chi and d
    is 0. The observer's Z = [chi_hat - chi_eq; d] moves by Z[k+1] = phi Z[k] + by_input
    (U - U_eq) + by_state (chi - chi_eq), the measured deviation being its mean over the
    tick.

    It lasts as long as the (first) schedule, or `duration_s`.

    `start` (12,) or (b, 12): default on the trajectory. `force_ned_N` (n, 3) or (b, n,
    3) over time; `current_ned_m_s` (3,) or (b, 3); `use_observer` () or (b,).
    `waiting`: None for a reference that keeps to the clock, as in the thesis. `switch`:
    between two schedules of one path at two speeds, which needs a waiting reference.
    `members`: b, where no argument tells it. A member that diverges is nan from there
    on. Raises `CampaignError` where schedules, switch and reference do not go together.
    """
    from auvid.hydro.dynamics.simulation.compiled_step import step

    schedules = (schedules,) if isinstance(schedules, Schedule) else tuple(schedules)
    if len(schedules) != (1 if switch is None else 2) or (switch is not None and waiting is None):
        raise CampaignError(
            "a mode switch needs two schedules and a waiting reference",
            field="switch",
            value=len(schedules),
        )
    equilibrium, step_s = schedules[0].equilibrium, schedules[0].equilibrium.step_s
    n, m = equilibrium.U.shape
    if duration_s is not None:
        n = min(n, round(duration_s / step_s) + 1)
    # Everything as a batch of b members.
    use = np.asarray(use_observer, dtype=np.float64)
    first = equilibrium.chi[0] if start is None else np.asarray(start, dtype=np.float64)
    force = np.zeros((n, 3)) if force_ned_N is None else np.asarray(force_ned_N, dtype=np.float64)
    b = members or max(
        np.size(use), len(first) if first.ndim == 2 else 1, len(force) if force.ndim == 3 else 1
    )
    force = np.broadcast_to(force[..., :n, :], (b, n, 3))
    flow = np.zeros(3) if current_ned_m_s is None else np.asarray(current_ned_m_s)
    current = np.array(np.broadcast_to(flow, (b, 3)), dtype=np.float64, order="C")
    has_observer = schedules[0].observer is not None
    use = np.broadcast_to(use, (b,))[:, None]
    # State and inputs of the vehicle, and Z of the observer.
    chi = np.broadcast_to(first, (b, N)).copy()
    U = np.broadcast_to(
        np.clip(equilibrium.U[0], plant.inputs.low, plant.inputs.high), (b, m)
    ).copy()
    Z = np.concatenate([chi - equilibrium.chi[0], np.zeros((b, D))], axis=1)
    flown = Flights(
        equilibrium.t_s[:n], *(np.zeros((b, n, *size)) for size in ((N,), (m,), (D,), (), ()))
    )
    reference = Reference(schedules, b, waiting)
    with np.errstate(all="ignore"):  # a member that diverges becomes nan
        for tick in range(n):
            # Where the controller aims. A switch of mode moves that, and Z counts from it.
            aim = reference.aim()
            if switch is not None:
                before_switch = aim.chi
                if reference.switch(switch, plant, chi, Z[:, N:] * use, aim.mass_kg):
                    aim = reference.aim()
                    Z[:, :N] += before_switch - aim.chi
            # The controller: deviation from the aim, and what holds the disturbance.
            deviation, U_hold = chi - aim.chi, aim.U
            if has_observer:
                d = Z[:, N:] * use
                deviation = Z[:, :N] - matrix_product(reference.value("state"), d)
                U_hold = aim.U + matrix_product(reference.value("inputs"), d)
            U_asked = U_hold - matrix_product(reference.value("k"), deviation)
            U = limited(U_asked, U, plant.inputs, step_s)
            flown.chi[:, tick], flown.U[:, tick], flown.disturbance[:, tick] = chi, U, Z[:, N:]
            flown.reference_s[:, tick], flown.powered[:, tick] = reference.time_s, reference.mode
            if tick == n - 1:
                break
            # The observer moves on with the inputs; its gains are those of this tick.
            if has_observer:
                Z = matrix_product(reference.value("phi"), Z) + matrix_product(
                    reference.value("by_input"), U - aim.U
                )
                by_state = reference.value("by_state")
            # The vehicle moves on; one that is too far away is lost.
            deviation_before = chi - aim.chi
            before, chi = chi, np.empty((b, N))
            acting, push = plant.acting(U), np.array(force[:, tick], order="C")
            rows = plant.members(aim.mass_kg)
            step(before, acting, push, current, rows, plant.tables, step_s, chi)
            chi_ahead, shift = reference.advance(chi, step_s * (tick + 1))
            deviation_after = chi - chi_ahead
            chi[~(np.abs(deviation_after[:, 6:9]).max(axis=1) < LOST_M)] = np.nan
            # The observer measures; a reference that waits stays behind by `shift`.
            if has_observer:
                Z = Z + matrix_product(by_state, 0.5 * (deviation_before + deviation_after))
                Z[:, :N] += shift
    return flown


def limited(U: Array, before: Array, limits: InputLimits, step_s: float) -> Array:
    """Return inputs (..., m) within their limits and limits of their rates."""
    reach = limits.rate * step_s
    return np.clip(np.clip(U, before - reach, before + reach), limits.low, limits.high)


def linear_response(
    equilibrium: Equilibrium, A: Array, B: Array, U: ArrayLike, *, start: ArrayLike
) -> Array:
    """Return chi (n, 12) of the linear model (3.18) along an equilibrium.

    A (n, 12, 12), B (n, 12, m), under inputs U (n, m) from `start` (12,).

    Exact over each tick with A and B held. The equilibrium's own residual, which (3.18)
    leaves out, is left out here too.
    """
    m = B.shape[-1]
    augmented = np.zeros((len(A), N + m, N + m))
    augmented[:, :N, :N], augmented[:, :N, N:] = A, B
    flow = exponential(augmented * equilibrium.step_s)[:, :N]
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
    desired_chi: Array,
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
    turned = flights.chi[..., 9:] - desired_chi[:n, 9:]
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
