"""Fixed-step simulation (Runge-Kutta 4) of a vehicle with a viscous truth.

Open loop for one vehicle or a batch, and under an autopilot. State [nu, eta] (12), or
with the lagged viscous force after it (18). Inputs are given at knots and linear
between them. Equations of McCarter 2014.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import STATES, Array
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.equations_of_motion import Control, state_derivative
from auvid.hydro.dynamics.simulation.physical_viscous import PhysicalViscous
from auvid.hydro.dynamics.simulation.plant_constants import Tables, plant_tables
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import eta_ratio, needs_propeller_speed
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.long_series.threads import THREADS, at_once


@dataclass(frozen=True)
class Actuation:
    """What acts on a vehicle at knots (..., k).

    Propeller speed [rev/s], fins (..., k, 4) [rad], any further force (..., k, 6) [N, N
    m].
    """

    propeller_rev_s: Array
    fins_rad: Array
    force: Array

    @property
    def control(self) -> Control:
        """Return the part that actuators give."""
        return Control(propeller_rev_s=self.propeller_rev_s, fins_rad=self.fins_rad)

    def between(self, knot: Array) -> Actuation:
        """Return the values at real-valued knot numbers (m,), linear between knots.

        The knots are the first axis.
        """
        low = np.clip(np.floor(knot).astype(int), 0, max(len(self.propeller_rev_s) - 2, 0))
        high, share = np.minimum(low + 1, len(self.propeller_rev_s) - 1), knot - low

        def mix(values: Array) -> Array:
            weight = share.reshape(-1, *(1,) * (values.ndim - 1))
            return np.asarray(values[low] + weight * (values[high] - values[low]))

        return Actuation(mix(self.propeller_rev_s), mix(self.fins_rad), mix(self.force))


def constant_actuation(propeller_rev_s: ArrayLike, fins_rad: ArrayLike, *, knots: int) -> Actuation:
    """Return the same values at every knot: n (...), fins (..., 4)."""
    n, fins = np.asarray(propeller_rev_s, dtype=np.float64), np.asarray(fins_rad, dtype=np.float64)
    return Actuation(
        np.repeat(n[..., None], knots, axis=-1),
        np.repeat(fins[..., None, :], knots, axis=-2),
        np.zeros((*n.shape, knots, 6)),
    )


@dataclass(frozen=True)
class SimulatedVehicle:
    """A vehicle with the viscous force that acts on it.

    `lag_s` > 0: the force follows its quasi-steady value with this time constant.
    `minimum_speed` bounds U in the propulsion ratio, as `eta_ratio` does.
    """

    vehicle: Vehicle
    truth: PhysicalViscous | IdentifiedModel
    lag_s: float = 0.0
    minimum_speed: float = 0.05

    @property
    def states(self) -> int:
        """12, or 18 with lag."""
        return 18 if self.lag_s > 0.0 else 12

    @cached_property
    def tables(self) -> Tables:
        """Return the constants for the compiled loop."""
        return plant_tables(
            self.vehicle, self.truth, lag_s=self.lag_s, minimum_speed=self.minimum_speed
        )

    @cached_property
    def _needs_level_speed(self) -> bool:
        terms = self.truth.terms if isinstance(self.truth, IdentifiedModel) else ()
        return any(map(needs_propeller_speed, terms))

    def level_speed(self, propeller_rev_s: ArrayLike) -> Array:
        """Return u_c(n) [m/s]; 0 where the truth does not need it.

        Raises `DataError` where it does and the table does not reach.
        """
        n = np.asarray(propeller_rev_s, dtype=np.float64)
        propeller = self.vehicle.propeller
        if propeller is None or not self._needs_level_speed:
            return np.zeros(n.shape)
        speed = level_speed(propeller, n)
        if np.isnan(speed).any():
            low, high = propeller.level_speed_rev_s[[0, -1]]
            raise DataError(
                "the propeller speed leaves the table of level speeds",
                value=float(n[np.isnan(speed)][0]),
                allowed=f"{low:g} to {high:g} rev/s",
            )
        return speed

    def viscous_force(self, nu: ArrayLike, level_speed_m_s: ArrayLike) -> Array:
        """Return the quasi-steady tau_nu (..., 6) of nu (..., 6) and u_c (...)."""
        if isinstance(self.truth, PhysicalViscous):
            return self.truth.force(nu)
        return self.truth.force(nu, eta_ratio(level_speed_m_s, nu, self.minimum_speed))

    def derivative(self, state: ArrayLike, actuation: Actuation) -> Array:
        """Return d/dt of states (..., 12 or 18), one knot of `actuation` for each.

        tau_nu_dot = (tau_nu(nu) - tau_nu) / lag_s where the force lags.
        """
        state = np.asarray(state, dtype=np.float64)
        level = self.level_speed(actuation.propeller_rev_s)
        steady = self.viscous_force(state[..., :6], level)
        acting = state[..., 12:] if self.lag_s > 0.0 else steady
        motion = state_derivative(
            self.vehicle, state[..., :12], actuation.control, lambda _: acting + actuation.force
        )
        if self.lag_s <= 0.0:
            return motion
        return np.concatenate([motion, (steady - acting) / self.lag_s], axis=-1)

    def start(self, eta: ArrayLike, nu: ArrayLike, propeller_rev_s: ArrayLike = 0.0) -> Array:
        """Return a state; a lagged force starts at its quasi-steady value."""
        eta, nu = np.asarray(eta, dtype=np.float64), np.asarray(nu, dtype=np.float64)
        parts = [nu, eta]
        if self.lag_s > 0.0:
            parts.append(self.viscous_force(nu, self.level_speed(propeller_rev_s)))
        return np.concatenate(parts, axis=-1)


def integrate_open_loop(
    simulated: SimulatedVehicle,
    state: ArrayLike,
    actuation: Actuation,
    *,
    step_s: float,
    steps_per_knot: int = 1,
) -> Array:
    """Return states (..., n, s) of a batch (...) from `state` (..., s), one per step.

    k knots (..., k) give n = (k - 1) steps_per_knot + 1. Rows after a state that is not
    finite are nan. The vehicles are shared among threads.
    """
    # Imported here, since numba takes a second.
    from auvid.hydro.dynamics.simulation.compiled import integrate

    start = np.asarray(state, dtype=np.float64)
    batch, knots = start.shape[:-1], actuation.propeller_rev_s.shape[-1]

    def rows(values: Array, *size: int) -> Array:
        # Copies: numba compiles the loop once more for arrays that cannot be written to.
        full = np.broadcast_to(values, (*batch, *size))
        return np.array(full, dtype=np.float64, order="C").reshape(-1, *size)

    x0, n = rows(start, start.shape[-1]), rows(actuation.propeller_rev_s, knots)
    fins, force = rows(actuation.fins_rad, knots, 4), rows(actuation.force, knots, 6)
    level, tables = simulated.level_speed(n), simulated.tables
    out = np.empty((len(x0), (knots - 1) * steps_per_knot + 1, start.shape[-1]))
    share = -(-len(out) // THREADS)

    def run(first: int) -> None:
        stop = min(first + share, len(out))
        integrate(x0, n, level, fins, force, step_s, steps_per_knot, tables, out, first, stop)

    at_once(run, range(0, len(out), share))
    return out.reshape(*batch, *out.shape[1:])


@dataclass(frozen=True)
class StopLimits:
    """Where a simulation stops.

    The motion means nothing any more, or the vehicle has left the water.
    """

    speed_m_s: float = 8.0
    angular_rate_rad_s: float = 8.0
    pitch_rad: float = 1.5
    shallowest_m: float = 0.0
    deepest_m: float = 500.0

    def breach(self, state: Array) -> str | None:
        """Return why a state (12 or 18,) is outside the limits, or None."""
        now = state.tolist()
        z, pitch = now[8], now[10]
        speed, turning = math.hypot(*now[:3]), math.hypot(*now[3:6])
        if not math.isfinite(speed + turning + z + pitch):
            return "the motion grew without bound"
        if speed > self.speed_m_s:
            return f"speed above {self.speed_m_s:g} m/s"
        if turning > self.angular_rate_rad_s:
            return f"angular rate above {self.angular_rate_rad_s:g} rad/s"
        if abs(pitch) > self.pitch_rad:
            return f"pitch beyond {self.pitch_rad:g} rad"
        if z > self.deepest_m:
            return f"deeper than {self.deepest_m:g} m"
        if z < self.shallowest_m:
            return f"above {self.shallowest_m:g} m of depth"
        return None


@dataclass(frozen=True)
class Stop:
    """Why and when a simulation ended early.

    `state` (12,) is the last one inside the limits.
    """

    time_s: float
    reason: str
    state: Array

    def __str__(self) -> str:
        values = ", ".join(
            f"{name} {value:.3g}" for name, value in zip(STATES, self.state, strict=True)
        )
        return f"{self.reason} at {self.time_s:.2f} s; last state: {values}"


@dataclass(frozen=True)
class Flight:
    """A simulated motion: `t_s` (n,), `state` (n, 12 or 18) at every step.

    The actuation stands at knots, `knot_s` apart; `stop` if the flight ended early.
    """

    t_s: Array
    state: Array
    actuation: Actuation
    knot_s: float
    stop: Stop | None = None


Autopilot = Callable[[int, Array, Array], Array]
"""(tick, state (12,), fins (4,) [rad]) -> where the fins are at the next tick."""


def simulate_autopilot(
    simulated: SimulatedVehicle,
    autopilot: Autopilot,
    state: ArrayLike,
    *,
    propeller_rev_s: Array,
    force: Array,
    tick_s: float,
    steps_per_tick: int,
    limits: StopLimits | None = None,
) -> Flight:
    """Simulate under an autopilot that is called once per tick.

    Fins start at 0 and move linearly from tick to tick. `propeller_rev_s` (k,), `force`
    (k, 6). A motion that leaves the limits ends there: `stop` says when and why, and
    what was flown before is kept.
    """
    # Imported here, since numba takes a second.
    from auvid.hydro.dynamics.simulation.compiled import integrate

    limits = limits or StopLimits()
    # Copies, as in integrate_open_loop.
    n, force = np.array(propeller_rev_s, order="C"), np.array(force, order="C")
    level, tables, step_s = simulated.level_speed(n), simulated.tables, tick_s / steps_per_tick
    fins = np.zeros((len(n), 4))
    states = np.full(((len(n) - 1) * steps_per_tick + 1, simulated.states), np.nan)
    states[0] = state
    reason, row = limits.breach(states[0]), 0
    for tick in range(len(n) - 1):
        if reason is not None:
            break
        fins[tick + 1] = autopilot(tick, states[row, :12], fins[tick])
        pair = slice(tick, tick + 2)
        knots = n[None, pair], level[None, pair], fins[None, pair], force[None, pair]
        out = states[None, row : row + steps_per_tick + 1]
        integrate(out[:, 0].copy(), *knots, step_s, steps_per_tick, tables, out, 0, 1)
        reason = limits.breach(states[row + steps_per_tick])
        row += 0 if reason else steps_per_tick
    stop = None if reason is None else Stop(row * step_s, reason, states[row, :12].copy())
    kept = row // steps_per_tick + 1
    return Flight(
        step_s * np.arange(row + 1, dtype=np.float64),
        states[: row + 1],
        Actuation(n[:kept], fins[:kept], force[:kept]),
        tick_s,
        stop,
    )


@dataclass(frozen=True)
class Motion:
    """What happened at times `t_s` (n,).

    eta, nu, nu_dot (n, 6), the actuation, and the viscous force that acted (n, 6), lag
    included.
    """

    t_s: Array
    eta: Array
    nu: Array
    nu_dot: Array
    actuation: Actuation
    viscous: Array


def motion_at(simulated: SimulatedVehicle, flight: Flight, t_s: ArrayLike) -> Motion:
    """Return the motion at any times inside a flight.

    States by cubic Hermite interpolation between steps (error below 1e-7 at 100
    steps/s). Derivatives and forces come from the equations of motion at these states,
    so that they hold exactly.
    """
    t = np.asarray(t_s, dtype=np.float64)
    step_s = flight.t_s[1] - flight.t_s[0]
    low = np.clip(np.floor(t / step_s + 1e-9).astype(int), 0, len(flight.t_s) - 2)
    # Slopes at both ends of each step, and the cubic through values and slopes.
    ends = np.concatenate([low, low + 1])
    at_ends = flight.actuation.between(flight.t_s[ends] / flight.knot_s)
    slope = simulated.derivative(flight.state[ends], at_ends).reshape(2, t.size, -1) * step_s
    s = ((t - flight.t_s[low]) / step_s)[:, None]
    a, b = flight.state[low], flight.state[low + 1]
    bend = 3.0 * (b - a) - 2.0 * slope[0] - slope[1]
    state = a + s * (slope[0] + s * (bend + s * (2.0 * (a - b) + slope[0] + slope[1])))
    here = flight.actuation.between(t / flight.knot_s)
    nu = state[:, :6]
    viscous = (
        state[:, 12:]
        if simulated.lag_s > 0.0
        else simulated.viscous_force(nu, simulated.level_speed(here.propeller_rev_s))
    )
    nu_dot = simulated.derivative(state, here)[:, :6]
    return Motion(t, state[:, 6:12], nu, nu_dot, here, viscous)


def gauss_markov(
    random: np.random.Generator, *, sd: ArrayLike, correlation_s: float, step_s: float, samples: int
) -> Array:
    """Return a stationary first-order Gauss-Markov process (samples, k).

    x(i+1) = a x(i) + sd sqrt(1 - a^2) e(i), a = exp(-step_s / correlation_s): the exact
    discretisation; `sd` (k,).
    """
    scale = np.atleast_1d(np.asarray(sd, dtype=np.float64))
    from scipy.signal import lfilter  # a second to import, and most commands do not simulate

    a = float(np.exp(-step_s / correlation_s)) if correlation_s > 0.0 else 0.0
    white = random.standard_normal((samples, scale.size))
    white[1:] *= np.sqrt(1.0 - a * a)
    return np.asarray(lfilter([1.0], [1.0, -a], white, axis=0) * scale)
