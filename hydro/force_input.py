"""A vehicle whose actuators are replaced by the force that they give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array, read_only
from auvid.hydro.dynamics.actuators.thrusters import ThrustCurve, Thrusters
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle

HALF_RANGE_US = 400.0
"""Pulses of `force_pulses` lie within so much of the neutral pulse."""


def driven_by_force(vehicle: Vehicle, largest_N: float = 1.0) -> Vehicle:
    """Return the vehicle with six ideal thrusters, one along each component of tau.

    Thruster i gives component i of tau [N, N m] alone, linear in its pulse up to
    `largest_N`; so what is written for thrusters also takes a force.
    """
    pulses = NEUTRAL_US + HALF_RANGE_US * np.array([-1.0, 1.0])
    curve = ThrustCurve(read_only(pulses), read_only([-largest_N, largest_N]), 1.0, 0.0)
    return replace(
        vehicle,
        propeller=None,
        fins=None,
        thrusters=Thrusters(read_only(np.eye(6)), np.ones(6), tuple(range(1, 7)), curve),
    )


def force_pulses(tau: Array, largest_N: float) -> Array:
    """Return the pulses [us] that give forces tau (n, 6) on `driven_by_force`.

    >>> force_pulses(np.array([[0.5, 0, 0, 0, 0, -1.0]]), 1.0)[0, [0, 1, 5]].tolist()
    [1700.0, 1500.0, 1100.0]
    """
    return np.asarray(NEUTRAL_US + HALF_RANGE_US * tau / largest_N)
