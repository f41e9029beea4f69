"""Thrust of a thruster at work: what inflow and the hull take, and what it draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import Array


def delivered_components(
    loss: Array,
    bollard: Array,
    axis: tuple[Array, ...],
    position: tuple[Array, ...],
    nu: tuple[Array, ...],
) -> Array:
    """Return the thrust of one thruster that reaches the vehicle [N].

    f = f_0 h (1 - a tanh(s / (U_j + U_0))), with f_0 the bollard thrust, s the inflow
    along it, U_j = sqrt(|f_0| / (rho A)) the speed of its jet, and h the share that the
    hull leaves, one along the axis and another against it. `loss` (5,): h along, h
    against, a, 1 / (rho A), U_0 [m/s]; `axis` and `position` (3,) in body axes.

    Arrays of one shape, or numbers in the compiled loop.
    """
    u, v, w, p, q, r = nu
    vx = u + q * position[2] - r * position[1]
    vy = v + r * position[0] - p * position[2]
    vz = w + p * position[1] - q * position[0]
    size = abs(bollard)
    # f_0 h and |f_0| h, without a sign of f_0 to take.
    left = 0.5 * (loss[0] * (bollard + size) + loss[1] * (bollard - size))
    right = 0.5 * (loss[0] * (bollard + size) - loss[1] * (bollard - size))
    jet = np.sqrt(size * loss[3]) + loss[4]
    along = vx * axis[0] + vy * axis[1] + vz * axis[2]
    delivered: Array = left - right * loss[2] * np.tanh(along / jet)
    return delivered


@dataclass(frozen=True)
class ThrustLoss:
    """What inflow and hull take of the bollard thrust, and the lag of the thrusters.

    `along` and `against`: shares left by the hull when the jet leaves against and along
    the axis; `advance`: share lost at high inflow; `lag_s`: of the thrust, 0 for none.
    """

    lag_s: float = 0.1
    along: float = 0.96
    against: float = 0.90
    advance: float = 0.55
    disc_m2: float = 0.0045
    idle_jet_m_s: float = 0.8

    def row(self, density: float) -> Array:
        """Return the constants of `delivered_components` (5,)."""
        return np.array(
            [
                self.along,
                self.against,
                self.advance,
                1.0 / (density * self.disc_m2),
                self.idle_jet_m_s,
            ]
        )


def drawn_current(bollard: Array, per_thrust: float) -> Array:
    """Return the current that one thruster draws [A].

    I = k |f|^1.5: power goes with the 3/2 power of thrust (momentum theory).
    """
    size = abs(bollard)
    return per_thrust * size * np.sqrt(size)


@dataclass(frozen=True)
class Battery:
    """A battery that sags: V = V_0 - s Q - R I, Q the charge drawn [Ah].

    `idle_A` is drawn by computer and lights, each thruster draws `per_thrust` |f|^1.5.
    0.047 A/N^1.5, 0.93 A and 0.037 ohm are those of the dive at Pier 59, Seattle.
    """

    full_V: float = 16.02
    per_charge_V_Ah: float = 0.08
    resistance_ohm: float = 0.037
    idle_A: float = 0.93
    per_thrust: float = 0.047
