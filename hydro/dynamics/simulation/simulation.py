"""Fixed-step simulation (Runge-Kutta 4) of a vehicle with a viscous truth: open loop
for one vehicle or a batch, and under a controller.

State [eta, nu] (12), or with the lagged viscous force behind it (18). Inputs are given
at knots and linear between them.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.equations_of_motion import Control, forward_dynamics
from auvid.hydro.dynamics.mechanics.kinematics import eta_dot
from auvid.hydro.dynamics.simulation.physical_viscous import PhysicalViscous
from auvid.hydro.dynamics.simulation.plant_constants import WIDTH, Tables, plant_tables
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import eta_ratio, needs_propeller_speed
from auvid.hydro.dynamics.viscous.models import IdentifiedModel

STATE = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")


@dataclass(frozen=True)
class Plant:
    """A vehicle with the viscous force that acts on it. `lag_s` > 0: the force follows
    its quasi-steady value with this time constant.

    `minimum_speed` bounds U in the propulsion ratio of a model with terms in eta, as
    `eta_ratio` does.
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
        """The constants for the compiled loop."""
        return plant_tables(
            self.vehicle, self.truth, lag_s=self.lag_s, minimum_speed=self.minimum_speed
        )

    def level_speed(self, propeller_rev_s: ArrayLike) -> Array:
        """u_c(n) [m/s]; 0 where the truth does not need it. Raises `DataError` where it
        does and the table does not reach.
        """
        n = np.asarray(propeller_rev_s, dtype=np.float64)
        terms = self.truth.terms if isinstance(self.truth, IdentifiedModel) else ()
        if self.vehicle.propeller is None or not any(map(needs_propeller_speed, terms)):
            return np.zeros(n.shape)
        speed = level_speed(self.vehicle.propeller, n)
        if np.isnan(speed).any():
            reach = (
                f"{self.vehicle.propeller.level_speed_rev_s[0]:g} to"
                f" {self.vehicle.propeller.level_speed_rev_s[-1]:g} rev/s"
            )
            raise DataError(
                "the propeller speed leaves the table of level speeds",
                value=float(n[np.isnan(speed)][0]),
                allowed=reach,
            )
        return speed

    def viscous_force(self, nu: ArrayLike, level_speed_m_s: ArrayLike) -> Array:
        """The quasi-steady viscous force: nu (..., 6), u_c (...) -> (..., 6) [N, N m]."""
        if isinstance(self.truth, PhysicalViscous):
            return self.truth.force(nu)
        return self.truth.force(nu, eta_ratio(level_speed_m_s, nu, self.minimum_speed))

    def rate(self, state: ArrayLike, inputs: Inputs) -> Array:
        """d/dt of states (..., 12 or 18) under inputs (...) of one instant each: the
        one right-hand side, batched.
        """
        state = np.asarray(state, dtype=np.float64)
        eta, nu = state[..., :6], state[..., 6:12]
        steady = self.viscous_force(nu, self.level_speed(inputs.propeller_rev_s))
        acting = state[..., 12:] if self.lag_s > 0.0 else steady
        nu_dot = forward_dynamics(self.vehicle, eta, nu, inputs.control, acting + inputs.force)
        parts = [eta_dot(eta, nu), nu_dot]
        if self.lag_s > 0.0:
            parts.append((steady - acting) / self.lag_s)
        return np.concatenate(parts, axis=-1)

    def start(self, eta: ArrayLike, nu: ArrayLike, propeller_rev_s: ArrayLike = 0.0) -> Array:
        """A state from pose and velocity; a lagged force starts at its quasi-steady
        value.
        """
        eta, nu = np.asarray(eta, dtype=np.float64), np.asarray(nu, dtype=np.float64)
        parts = [eta, nu]
        if self.lag_s > 0.0:
            parts.append(self.viscous_force(nu, self.level_speed(propeller_rev_s)))
        return np.concatenate(parts, axis=-1)


@dataclass(frozen=True)
class Inputs:
    """What acts on the plant at knots (..., k): propeller speed [rev/s], fins (..., k,
    4) [rad], any further force (..., k, 6) [N, N m].
    """

    propeller_rev_s: Array
    fins_rad: Array
    force: Array

    @property
    def control(self) -> Control:
        return Control(propeller_rev_s=self.propeller_rev_s, fins_rad=self.fins_rad)

    def between(self, knot: Array) -> Inputs:
        """Inputs (k on the first axis) at real-valued knot numbers (m,), linear between
        knots.
        """
        low = np.clip(np.floor(knot).astype(int), 0, max(len(self.propeller_rev_s) - 2, 0))
        high, share = np.minimum(low + 1, len(self.propeller_rev_s) - 1), knot - low

        def mix(values: Array) -> Array:
            weight = share.reshape(-1, *(1,) * (values.ndim - 1))
            return np.asarray(values[low] + weight * (values[high] - values[low]))

        return Inputs(mix(self.propeller_rev_s), mix(self.fins_rad), mix(self.force))


def constant_inputs(propeller_rev_s: ArrayLike, fins_rad: ArrayLike, *, knots: int) -> Inputs:
    """The same inputs at every knot: n (...), fins (..., 4)."""
    n, fins = np.asarray(propeller_rev_s, dtype=np.float64), np.asarray(fins_rad, dtype=np.float64)
    rows = [
        np.repeat(values[..., None, :], knots, axis=-2)
        for values in (n[..., None], fins, np.zeros((*n.shape, 6)))
    ]
    return Inputs(rows[0][..., 0], rows[1], rows[2])


@dataclass(frozen=True)
class Limits:
    """Where a simulation stops, because the motion means nothing any more or the
    vehicle has left the water.
    """

    speed_m_s: float = 8.0
    rate_rad_s: float = 8.0
    pitch_rad: float = 1.5
    shallowest_m: float = 0.0
    deepest_m: float = 500.0


@dataclass(frozen=True)
class Stop:
    """Why and when a simulation ended early: `state` (12,) is the last one inside the
    limits.
    """

    time_s: float
    reason: str
    state: Array

    def __str__(self) -> str:
        values = ", ".join(
            f"{name} {value:.3g}" for name, value in zip(STATE, self.state, strict=True)
        )
        return f"{self.reason} at {self.time_s:.2f} s; last state: {values}"


@dataclass(frozen=True)
class Flight:
    """A simulated motion: `t_s` (n,), `state` (n, 12 or 18) at every step; inputs at
    knots, `knot_s` apart; `stop` if it ended early.
    """

    t_s: Array
    state: Array
    inputs: Inputs
    knot_s: float
    stop: Stop | None = None


def integrate_open_loop(
    plant: Plant,
    state: ArrayLike,
    inputs: Inputs,
    *,
    step_s: float,
    steps_per_knot: int = 1,
    compiled: bool = True,
) -> Array:
    """States (..., n, s) of a batch (...) from `state` (..., s), one row per step, n =
    (knots - 1) steps_per_knot + 1.

    Inputs hold k knots (..., k). `compiled` False takes the numpy path, the reference.
    Rows after a state that is not finite are nan.
    """
    start = np.asarray(state, dtype=np.float64)
    knots = inputs.propeller_rev_s.shape[-1]
    shape = (*start.shape[:-1], (knots - 1) * steps_per_knot + 1, start.shape[-1])
    if not compiled:
        return _numpy_path(plant, start, inputs, step_s, steps_per_knot, shape)
    from auvid.hydro.dynamics.simulation.compiled import (
        THREADS,
        integrate,
    )  # here, since numba takes a second to import

    out = np.empty((int(np.prod(shape[:-2], dtype=int)), *shape[-2:]))
    n = np.ascontiguousarray(np.broadcast_to(inputs.propeller_rev_s, (*shape[:-2], knots))).reshape(
        -1, knots
    )
    fins = np.ascontiguousarray(np.broadcast_to(inputs.fins_rad, (*shape[:-2], knots, 4))).reshape(
        -1, knots, 4
    )
    force = np.ascontiguousarray(np.broadcast_to(inputs.force, (*shape[:-2], knots, 6))).reshape(
        -1, knots, 6
    )
    first, level = np.ascontiguousarray(start.reshape(len(out), -1)), plant.level_speed(n)

    def run(vehicle: int) -> None:
        integrate(
            first,
            n,
            fins,
            force,
            level,
            step_s,
            steps_per_knot,
            plant.tables,
            out,
            vehicle,
            min(vehicle + share, len(out)),
        )

    share = WIDTH * -(-len(out) // (WIDTH * THREADS))
    if len(out) <= share:
        run(0)
    else:
        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(run, range(0, len(out), share)))
    return out.reshape(shape)


def _numpy_path(
    plant: Plant, start: Array, inputs: Inputs, step_s: float, per_knot: int, shape: tuple[int, ...]
) -> Array:
    out = np.empty(shape)
    out[..., 0, :] = x = start
    values = [
        np.moveaxis(item, len(shape) - 2, 0)
        for item in (inputs.propeller_rev_s, inputs.fins_rad, inputs.force)
    ]
    knots = Inputs(values[0], values[1], values[2])

    def rate(x: Array, at: float) -> Array:
        here = knots.between(np.array([at]))
        return plant.rate(x, Inputs(here.propeller_rev_s[0], here.fins_rad[0], here.force[0]))

    for s in range(shape[-2] - 1):
        at = s / per_knot
        k1 = rate(x, at)
        k2 = rate(x + 0.5 * step_s * k1, at + 0.5 / per_knot)
        k3 = rate(x + 0.5 * step_s * k2, at + 0.5 / per_knot)
        k4 = rate(x + step_s * k3, at + 1.0 / per_knot)
        out[..., s + 1, :] = x = x + step_s / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return out


Controller = Callable[[int, Array, Array], Array]
"""(tick, state (12,), fins (4,) [rad]) -> where the fins are at the next tick."""


def fly(
    plant: Plant,
    controller: Controller,
    state: ArrayLike,
    *,
    propeller_rev_s: Array,
    force: Array,
    tick_s: float,
    steps_per_tick: int,
    limits: Limits | None = None,
) -> Flight:
    """Fly under a controller that is asked once per tick; fins move linearly from tick
    to tick. `propeller_rev_s` (k,), `force` (k, 6).

    A motion that leaves the limits ends there: `stop` says when and why, and what was
    flown before is kept. Starts with the fins at 0.
    """
    from auvid.hydro.dynamics.simulation.compiled import integrate

    limits = limits or Limits()
    knots = len(propeller_rev_s)
    fins = np.zeros((knots, 4))
    n, force = (
        np.ascontiguousarray(propeller_rev_s, dtype=np.float64),
        np.ascontiguousarray(force, dtype=np.float64),
    )
    level, tables, step_s = plant.level_speed(n), plant.tables, tick_s / steps_per_tick
    states = np.full(((knots - 1) * steps_per_tick + 1, plant.states), np.nan)
    states[0] = state
    reason, row = breach(states[0], limits), 0
    for tick in range(knots - 1):
        if reason is not None:
            break
        fins[tick + 1] = controller(tick, states[row, :12], fins[tick])
        pair = slice(tick, tick + 2)
        out = states[row : row + steps_per_tick + 1]
        given = n[None, pair], fins[None, pair], force[None, pair], level[None, pair]
        integrate(out[None, 0].copy(), *given, step_s, steps_per_tick, tables, out[None], 0, 1)
        reason = breach(out[-1], limits)
        row += 0 if reason else steps_per_tick
    stop = None if reason is None else Stop(row * step_s, reason, states[row, :12].copy())
    kept = row // steps_per_tick + 1
    return Flight(
        step_s * np.arange(row + 1, dtype=np.float64),
        states[: row + 1],
        Inputs(n[:kept], fins[:kept], force[:kept]),
        tick_s,
        stop,
    )


def breach(state: Array, limits: Limits) -> str | None:
    """Why a state (12 or 18,) is outside the limits, or None."""
    z, pitch = float(state[2]), float(state[4])
    speed, rate = float(np.sqrt(state[6:9] @ state[6:9])), float(np.sqrt(state[9:12] @ state[9:12]))
    if not np.isfinite(speed + rate + z + pitch):
        return "the motion grew without bound"
    for value, limit, words in (
        (speed, limits.speed_m_s, "speed above {:g} m/s"),
        (rate, limits.rate_rad_s, "angular rate above {:g} rad/s"),
        (abs(pitch), limits.pitch_rad, "pitch beyond {:g} rad"),
        (z, limits.deepest_m, "deeper than {:g} m"),
        (limits.shallowest_m - z, 0.0, f"above {limits.shallowest_m:g} m of depth"),
    ):
        if value > limit:
            return words.format(limit)
    return None


@dataclass(frozen=True)
class Motion:
    """What happened at times `t_s` (n,): eta, nu, nu_dot (n, 6), inputs, and the
    viscous force that acted (n, 6), lag included.
    """

    t_s: Array
    eta: Array
    nu: Array
    nu_dot: Array
    inputs: Inputs
    viscous: Array


def motion_at(plant: Plant, flight: Flight, t_s: ArrayLike) -> Motion:
    """The motion at any times inside a flight: states by cubic Hermite interpolation
    between steps (error below 1e-7 at 100 steps/s).

    Derivatives and forces come from the right-hand side at these states, so that the
    equation of motion holds exactly.
    """
    t = np.asarray(t_s, dtype=np.float64)
    step_s = flight.t_s[1] - flight.t_s[0]
    low = np.clip(np.floor(t / step_s + 1e-9).astype(int), 0, len(flight.t_s) - 2)
    ends = np.stack([low, low + 1])
    inputs = flight.inputs.between(flight.t_s[ends.ravel()] / flight.knot_s)
    slope = plant.rate(flight.state[ends.ravel()], inputs).reshape(2, t.size, -1) * step_s
    s = ((t - flight.t_s[low]) / step_s)[:, None]
    a, b = flight.state[low], flight.state[low + 1]
    state = a + s * (
        slope[0]
        + s
        * (3.0 * (b - a) - 2.0 * slope[0] - slope[1] + s * (2.0 * (a - b) + slope[0] + slope[1]))
    )
    here = flight.inputs.between(t / flight.knot_s)
    rate = plant.rate(state, here)
    nu = state[:, 6:12]
    viscous = (
        state[:, 12:]
        if plant.lag_s > 0.0
        else plant.viscous_force(nu, plant.level_speed(here.propeller_rev_s))
    )
    return Motion(t, state[:, :6], nu, rate[:, 6:12], here, viscous)


def gauss_markov(
    random: np.random.Generator, *, sd: ArrayLike, correlation_s: float, step_s: float, samples: int
) -> Array:
    """A first-order Gauss-Markov process (samples, k) of standard deviation `sd` (k,),
    stationary from its first sample.

    x(i+1) = a x(i) + sd sqrt(1 - a^2) e(i), a = exp(-step_s / correlation_s): the exact
    discretisation.
    """
    scale = np.atleast_1d(np.asarray(sd, dtype=np.float64))
    a = float(np.exp(-step_s / correlation_s)) if correlation_s > 0.0 else 0.0
    white = random.standard_normal((samples, scale.size))
    white[1:] *= np.sqrt(1.0 - a * a)
    return np.asarray(lfilter([1.0], [1.0, -a], white, axis=0) * scale)
