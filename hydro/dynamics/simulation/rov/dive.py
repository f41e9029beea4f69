"""A dive in memory: a truth flown under orders, and its motion at any time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.documents.plans.dive_plan import DiveLegEntry, DivePlanDocument
from auvid.hydro.arrays import Array, Ints, cross
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.rov.autopilot import AutopilotGains
from auvid.hydro.dynamics.simulation.rov.orders import (
    FILTER,
    PUSH,
    Orders,
    orders_of,
    random_numbers,
)
from auvid.hydro.dynamics.simulation.rov.truth import RovTruth
from auvid.hydro.dynamics.simulation.simulation import Motion, constant_actuation, gauss_markov

GAINS = AutopilotGains()
"""Those of ArduSub."""
TIPPED_RAD = 1.3
"""Pitch beyond which a dive that ended did so by its pitch; the loop ends at 1.4."""
FORCES = ("hull", "tether", "buoyancy", "thrust_loss", "inertia", "unsteady")
"""Parts of tau_bar of a dive."""


@dataclass(frozen=True)
class DiveMotion:
    """What happened at times `t_s` (m,) from the start of the log.

    `eta` (m, 6) over ground; `nu`, `nu_dot` (m, 6) through the water; `ground`,
    `ground_dot` (m, 6) over ground; `bollard` (m, n): bollard thrust after the lag [N];
    `forces`: each part of FORCES (m, 6), and `thrusters`, the bollard thrust.
    """

    t_s: Array
    eta: Array
    nu: Array
    nu_dot: Array
    ground: Array
    ground_dot: Array
    bollard: Array
    forces: Mapping[str, Array]

    @property
    def tau_bar(self) -> Array:
        """The force that a model of the vehicle file has to explain (m, 6) [N, N m]."""
        return np.asarray(sum(self.forces[name] for name in FORCES))

    def sensed(self) -> Motion:
        """Return the motion over ground, as sensors take it."""
        unused = constant_actuation(0.0, np.zeros(4), knots=self.t_s.size)
        return Motion(
            self.t_s, self.eta, self.ground, self.ground_dot, unused, np.zeros(self.nu.shape)
        )


@dataclass(frozen=True)
class Dive:
    """A flown dive. Times count from the start of its log, `offset_s` into the flight.

    At the ticks (k,) `tick_s` apart: `pulses_us` (k, n), `supply` (k, 2) voltage and
    current, `goals` (k, n) bollard thrust of the pulses, `push` (k, 6), `errors` (k,
    12) of what the autopilot saw. `state` (s, 12 + n) at every step: [nu, eta, bollard
    thrust]. `stop`: why it ended early.
    """

    truth: RovTruth
    leg: DiveLegEntry
    orders: Orders
    tick_s: float
    steps_per_tick: int
    state: Array
    pulses_us: Ints
    supply: Array
    goals: Array
    push: Array
    errors: Array
    offset_s: float
    start_s: float
    end_s: float
    log_end_s: float
    stop: str | None

    @property
    def reached(self) -> bool:
        """Return whether the flight lasted into the leg."""
        return self.end_s - self.start_s >= 1.0

    def tick_of(self, t_s: ArrayLike) -> Ints:
        """Return the tick that holds at times of the log: its orders and pulses."""
        at = (np.asarray(t_s, dtype=np.float64) + self.offset_s) / self.tick_s
        return np.clip(np.floor(at + 1e-6), 0, len(self.goals) - 1).astype(np.int64)

    def motion(self, t_s: ArrayLike) -> DiveMotion:
        """Return the motion at any times of the log.

        States by cubic Hermite interpolation between steps; derivatives and forces come
        from the right-hand side at these states, so that the equation of motion holds
        exactly.
        """
        t = np.asarray(t_s, dtype=np.float64)
        step_s = self.tick_s / self.steps_per_tick
        at = (t + self.offset_s) / step_s
        low = np.clip(np.floor(at + 1e-6).astype(np.int64), 0, len(self.state) - 2)
        goal = self.goals[low // self.steps_per_tick]
        s = (at - low)[:, None]
        a, b = self.state[low], self.state[low + 1]
        slope_a = self.truth.rate(a, goal, self._push(low))[0] * step_s
        slope_b = self.truth.rate(b, goal, self._push(low + 1.0))[0] * step_s
        state = a + s * (
            slope_a
            + s
            * (3.0 * (b - a) - 2.0 * slope_a - slope_b + s * (2.0 * (a - b) + slope_a + slope_b))
        )
        if self.truth.loss.lag_s == 0.0:
            state[:, 12:] = goal
        push = self._push(at)
        rate, hull = self.truth.rate(state, goal, push)
        nu, eta, nu_dot, bollard = state[:, :6], state[:, 6:12], rate[:, :6], state[:, 12:]
        # The current in body axes turns against the body.
        drift = np.einsum("mji,j->mi", rotation_body_to_ned(eta[:, 3:]), self.truth.current_m_s)
        ground, ground_dot = nu.copy(), nu_dot.copy()
        ground[:, :3] += drift
        ground_dot[:, :3] -= cross(nu[:, 3:], drift)
        forces = self.truth.forces(eta, nu, nu_dot, bollard) | {"hull": hull, "unsteady": push}
        return DiveMotion(t, eta, nu, nu_dot, ground, ground_dot, bollard, forces)

    def _push(self, step: ArrayLike) -> Array:
        """Return the unsteady force (m, 6) at real steps, linear between ticks."""
        at = np.asarray(step, dtype=np.float64) / self.steps_per_tick
        ticks = np.arange(len(self.push))
        return np.column_stack([np.interp(at, ticks, values) for values in self.push.T])


def fly_dive(
    truth: RovTruth,
    plan: DivePlanDocument,
    leg: DiveLegEntry,
    *,
    seed: int,
) -> Dive:
    """Settle in the leg's first mode, fly it, and go on for the margin of its log.

    A dive ends early where it surfaces or its motion grows without bound.
    """
    from auvid.hydro.dynamics.simulation.rov.loop import fly  # numba takes a second to import

    orders = orders_of(plan, leg, seed=seed)
    ticks, tick_s = len(orders.t_s), 1.0 / plan.control_hz
    steps = int(np.ceil(tick_s / plan.step_s - 1e-9))
    count = len(truth.thrusters.outputs)
    push = np.zeros((ticks, 6))
    unsteady = plan.water.unsteady
    if unsteady is not None:
        push = gauss_markov(
            random_numbers(seed, leg.id, PUSH),
            sd=[*unsteady.force_sd_N, *unsteady.moment_sd_N_m],
            correlation_s=unsteady.correlation_s,
            step_s=tick_s,
            samples=ticks,
        )
    errors = filter_errors(plan, leg, seed=seed, ticks=ticks)
    start = np.zeros(12 + count)
    start[8], start[11] = plan.depth_m, np.radians(plan.heading_deg)
    state = np.full(((ticks - 1) * steps + 1, 12 + count), np.nan)
    pulses, supply = np.zeros((ticks, count), np.int64), np.zeros((ticks, 2))
    goals = np.zeros((ticks, count))
    last = fly(
        start, orders.modes, orders.sticks, orders.targets, errors, push, tick_s, steps, GAINS,
        truth.tables, state, pulses, supply, goals,
    )  # fmt: skip
    stop = None
    if last < ticks - 1:
        x = state[last * steps]
        stop = (
            f"the dive ended at {orders.t_s[last]:.2f} s of the leg: depth {x[8]:.2f} m,"
            f" pitch {np.degrees(x[10]):.0f} deg, speed {np.sqrt(x[:3] @ x[:3]):.2f} m/s"
        )
        if abs(x[10]) > TIPPED_RAD:
            stop += "; it pitches over: smaller sticks, or a mode that holds the attitude"
    offset = plan.settle_s - plan.margin_s
    log_end = last * tick_s - offset
    return Dive(
        truth=truth,
        leg=leg,
        orders=orders,
        tick_s=tick_s,
        steps_per_tick=steps,
        state=state[: last * steps + 1],
        pulses_us=pulses[: last + 1],
        supply=supply[: last + 1],
        goals=goals[: last + 1],
        push=push[: last + 1],
        errors=errors[: last + 1],
        offset_s=offset,
        start_s=plan.margin_s,
        end_s=min(plan.margin_s + leg.duration_s, log_end),
        log_end_s=log_end,
        stop=stop,
    )


def filter_errors(plan: DivePlanDocument, leg: DiveLegEntry, *, seed: int, ticks: int) -> Array:
    """Return the errors (k, 12) of velocity and pose that the autopilot steers by.

    Attitude drifts slowly (the log's attitude has the same error), depth and rates have
    the noise of their sensors, velocity half of that of the velocity log.
    """
    random, sensors = random_numbers(seed, leg.id, FILTER), plan.sensors
    errors = np.zeros((ticks, 12))
    attitude = sensors.attitude
    errors[:, 9:] = gauss_markov(
        random,
        sd=np.radians([attitude.tilt_sd_deg, attitude.tilt_sd_deg, attitude.heading_sd_deg]),
        correlation_s=attitude.correlation_s,
        step_s=1.0 / plan.control_hz,
        samples=ticks,
    )
    errors[:, 8] = sensors.depth.sd_m * random.standard_normal(ticks)
    errors[:, :3] = 0.5 * sensors.dvl.sd_m_s * random.standard_normal((ticks, 3))
    errors[:, 3:6] = sensors.imu.gyro_sd_rad_s * random.standard_normal((ticks, 3))
    return errors
