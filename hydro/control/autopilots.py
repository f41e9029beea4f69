"""Autopilots of the twin: heading and depth by four fins.

Deflection and rate of the fins are limited.

The controller asks for a rudder and an elevator angle; the fins' own moment
coefficients say how four fins give them. It knows the true state, so that a flight does
not depend on the noise of the sensors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle


@dataclass(frozen=True)
class Gains:
    """Gains of rudder and elevator.

    Rudder per rad of heading error, rad/s of yaw rate and rad s of its integral;
    elevator likewise; desired pitch per m of depth error.
    """

    heading: float = 1.8
    yaw_rate: float = 0.9
    heading_integral: float = 0.06
    pitch: float = 1.5
    pitch_rate: float = 0.8
    pitch_integral: float = 0.6
    depth: float = 0.22
    depth_integral: float = 0.02
    largest_pitch_rad: float = math.radians(25.0)
    integral_zone_rad: float = math.radians(6.0)
    """Heading error beyond which its integral stands still, so that a step does not
    wind it up.
    """


def fin_mixing(vehicle: Vehicle) -> Array:
    """Return fin deflections (4, 2) per unit of elevator and rudder.

    Elevator: moment M > 0, bow up; rudder: N > 0, bow to starboard.

    Least deflection that gives the moment alone (pseudo-inverse of the rows M, N of the
    linear fin coefficients), scaled so that the fin that moves most moves by 1. Raises
    `CampaignError` for a vehicle whose fins cannot do both.
    """
    if vehicle.fins is None:
        raise CampaignError(
            "the autopilot steers by fins; this vehicle has none",
            field="vehicle",
            value=vehicle.name,
        )
    moments = vehicle.fins.linear[4:6]
    if np.linalg.matrix_rank(moments, tol=1e-6) < 2:
        raise CampaignError(
            "the fins cannot give pitch and yaw moments apart",
            field="vehicle.actuators.fins.linear",
        )
    inverse = np.linalg.pinv(moments)
    return np.asarray(inverse / np.abs(inverse).max(axis=0))


@dataclass
class StepAutopilot:
    """An autopilot for heading `yaw_rad` (k,) and depth `depth_m` (k,) per tick.

    It remembers its integrals: one autopilot per flight.

    Fins move at most `rate_rad_s` and stay within +-`limit_rad`; elevator and rudder
    are cut before mixing.
    """

    mixing: Array
    yaw_rad: Array
    depth_m: Array
    tick_s: float
    limit_rad: float
    rate_rad_s: float
    gains: Gains = field(default_factory=Gains)
    heading_sum: float = 0.0
    depth_sum: float = 0.0
    pitch_sum: float = 0.0

    def __call__(self, tick: int, state: Array, fins: Array) -> Array:
        """Return the fins (4,) [rad] at the next tick from [nu, eta] (12,)."""
        # In numbers of Python: numpy takes ten times as long for four fins.
        g = self.gains
        now = state.tolist()
        z, theta, psi, q, r = now[8], now[10], now[11], now[4], now[5]
        heading = math.remainder(float(self.yaw_rad[tick]) - psi, 2.0 * math.pi)
        if abs(heading) < g.integral_zone_rad:
            self.heading_sum += heading * self.tick_s
        rudder = g.heading * heading - g.yaw_rate * r + g.heading_integral * self.heading_sum
        below = z - float(self.depth_m[tick])
        if abs(below) < 0.5:
            self.depth_sum += below * self.tick_s
        pitch = _cut(g.depth * below + g.depth_integral * self.depth_sum, g.largest_pitch_rad)
        if abs(pitch - theta) < g.integral_zone_rad:
            self.pitch_sum += (pitch - theta) * self.tick_s
        elevator = g.pitch * (pitch - theta) - g.pitch_rate * q + g.pitch_integral * self.pitch_sum
        target = self.mixing @ np.array(
            [_cut(elevator, self.limit_rad), _cut(rudder, self.limit_rad)]
        )
        reach = self.rate_rad_s * self.tick_s
        return np.array(
            [
                _cut(min(max(aim, fin - reach), fin + reach), self.limit_rad)
                for aim, fin in zip(target.tolist(), fins.tolist(), strict=True)
            ]
        )


def _cut(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
