"""Motion of the three bench experiments of Alberti 2015, integrated to 1e-10.

Single channels in a tank, free decay, quadrifilar pendulum.

Each returns a function of time, so that every sensor can be sampled at its own times.
Rates are exact: they come from the equation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.simplified import SimplifiedModel, state_rate

RELATIVE, ABSOLUTE = 1e-10, 1e-12
LONGEST_STEP_S = 2.0
Rate = Callable[[Array], Array]


@dataclass(frozen=True)
class BenchMotion:
    """A motion: `state` and `rate` (n, k) at times (n,) [s] from its start.

    Before 0 it stands as it starts.
    """

    at: Callable[[Array], tuple[Array, Array]]

    def __call__(self, t_s: Array) -> tuple[Array, Array]:
        return self.at(np.asarray(t_s, dtype=np.float64))


def drive(
    model: SimplifiedModel, start: Array, changes_s: Array, tau: Array, end_s: float
) -> BenchMotion:
    """Integrate the simplified model from rest under propulsion tau (m, 6) [N, N m].

    Each row acts from `changes_s` (m,) on, the first from 0.

    `start`: pose eta (6,). State [nu, eta] (n, 12). Raises `DataError` where the motion
    cannot be followed (pitch of 90 degrees).
    """
    pieces, state = [], np.concatenate([np.zeros(6), start])
    edges = np.append(changes_s, end_s)
    for index, force in enumerate(tau):
        piece = _follow(
            partial(state_rate, model, tau=force), state, edges[index], edges[index + 1]
        )
        pieces.append(piece)
        state = piece(edges[index + 1])

    def at(t_s: Array) -> tuple[Array, Array]:
        inside = np.clip(t_s, 0.0, end_s)
        which = np.clip(np.searchsorted(changes_s, inside, side="right") - 1, 0, len(tau) - 1)
        states = np.empty((t_s.size, 12))
        for index, piece in enumerate(pieces):
            mask = which == index
            if mask.any():
                states[mask] = piece(inside[mask]).T
        rates = state_rate(model, states, tau[which])
        rates[t_s < 0.0] = 0.0
        return states, rates

    return BenchMotion(at)


@dataclass(frozen=True)
class PhysicalPendulum:
    """A pendulum in water.

    `inertia` [kg m^2] about the pivot with all added mass, `restoring` [N m] at 90
    degrees of angle (weight less buoyancy, each at its own arm), `linear` and
    `quadratic` [N m s, N m s^2] of the angular rate, both <= 0.
    """

    inertia: float
    restoring: float
    linear: float
    quadratic: float

    def rate(self, state: Array) -> Array:
        """Return d/dt [theta, theta_dot] (..., 2): Alberti (70).

        Every part at its own arm.
        """
        angle, speed = state[..., 0], state[..., 1]
        moment = (
            -self.restoring * np.sin(angle)
            + self.linear * speed
            + self.quadratic * speed * np.abs(speed)
        )
        return np.stack([speed, moment / self.inertia], axis=-1)


def free_decay(pendulum: PhysicalPendulum, angle_rad: float, end_s: float) -> BenchMotion:
    """Return the motion [theta, theta_dot] (n, 2) after a release at rest at 0 s.

    Raises `DataError` where nothing restores it.
    """
    if pendulum.restoring <= 0.0 or pendulum.inertia <= 0.0:
        raise DataError(
            "the pendulum does not hang: buoyancy is above weight, or it has no inertia",
            value=pendulum,
        )
    return _released(pendulum.rate, angle_rad, end_s)


@dataclass(frozen=True)
class Quadrifilar:
    """A loaded tray on four lines of length `line` [m].

    They hang between circles of radius R_1 (ceiling) and R_2 (tray).

    `inertia` [kg m^2] about the vertical through the centre, `mass` [kg], `damping` [N
    m s] >= 0 of the air.
    """

    inertia: float
    mass: float
    radius_ceiling: float
    radius_tray: float
    line: float
    damping: float
    gravity: float

    def rate(self, state: Array) -> Array:
        """Return d/dt [psi, psi_dot] (..., 2), exact in the angle.

        The tray rises as it turns. For small angles it is Alberti (54).

        With depth h(psi) = sqrt(line^2 - R_1^2 - R_2^2 + 2 R_1 R_2 cos psi) below the
        ceiling, Lagrange's equation is (I + m h'^2) psi_ddot + m h' h'' psi_dot^2 = m g
        h' - c psi_dot.
        """
        psi, speed = state[..., 0], state[..., 1]
        product = self.radius_ceiling * self.radius_tray
        depth = np.sqrt(
            self.line**2
            - self.radius_ceiling**2
            - self.radius_tray**2
            + 2.0 * product * np.cos(psi)
        )
        first = -product * np.sin(psi) / depth
        second = -product * np.cos(psi) / depth - first**2 / depth
        moment = self.mass * first * (self.gravity - second * speed**2) - self.damping * speed
        return np.stack([speed, moment / (self.inertia + self.mass * first**2)], axis=-1)


def swing(tray: Quadrifilar, angle_rad: float, end_s: float) -> BenchMotion:
    """Release at rest from an angle at 0 s: state [psi, psi_dot] (n, 2)."""
    return _released(tray.rate, angle_rad, end_s)


def _released(rate: Rate, angle: float, end_s: float) -> BenchMotion:
    path = _follow(rate, np.array([angle, 0.0]), 0.0, end_s)

    def at(t_s: Array) -> tuple[Array, Array]:
        states = path(np.clip(t_s, 0.0, end_s)).T
        rates = rate(states)
        rates[t_s < 0.0] = 0.0
        return states, rates

    return BenchMotion(at)


def _follow(
    rate: Rate, start: Array, first_s: float, last_s: float
) -> Callable[[Array | float], Array]:
    """Integrate by Dormand and Prince of eighth order: states (k, n) at times (n,).

    The method's own interpolation gives the states between its steps.
    """
    from scipy.integrate import solve_ivp

    solution = solve_ivp(
        lambda _, state: rate(state),
        (first_s, last_s),
        start,
        method="DOP853",
        rtol=RELATIVE,
        atol=ABSOLUTE,
        max_step=LONGEST_STEP_S,
        dense_output=True,
    )
    if not solution.success or not np.all(np.isfinite(solution.y)):
        raise DataError(
            f"the motion cannot be followed beyond {solution.t[-1]:.3g} s",
            value=str(solution.message),
        )
    path: Callable[[Array | float], Array] = solution.sol
    return path
