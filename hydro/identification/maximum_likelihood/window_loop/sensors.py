"""What ideal sensors measure at a state with its rate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numba.extending
import numpy as np

from auvid.hydro.arrays import Array, cross_components
from auvid.hydro.dynamics.simulation.sensor_models import (
    point_velocity_components,
    specific_force_components,
)
from auvid.hydro.identification.maximum_likelihood.records import SensorGeometry
from auvid.hydro.identification.maximum_likelihood.window_loop.compiling import OPTIONS, compiled

SENSOR_EQUATIONS: tuple[Callable[..., Any], ...] = (
    cross_components,
    specific_force_components,
    point_velocity_components,
)
_extending: Any = numba.extending
for _equation in SENSOR_EQUATIONS:
    _extending.register_jitable(no_cfunc_wrapper=True, **OPTIONS)(_equation)


class SensorPlaces(NamedTuple):
    """Sensors for the loop: rotations sensor to body, arms [m], gravity [m/s^2]."""

    imu: Array
    imu_arm: Array
    log: Array
    log_arm: Array
    depth_arm: Array
    gravity: float


def sensor_places(places: SensorGeometry) -> SensorPlaces:
    """Return the installation of sensors for the loop.

    As copies: numba would compile once more for arrays that are read-only.
    """
    return SensorPlaces(
        np.array(places.imu.rotation, dtype=np.float64, order="C"),
        np.array(places.imu.arm_m, dtype=np.float64),
        np.array(places.velocity.rotation, dtype=np.float64, order="C"),
        np.array(places.velocity.arm_m, dtype=np.float64),
        np.array(places.depth.arm_m, dtype=np.float64),
        float(places.gravity),
    )


@compiled
def outputs(x: Array, rate: Array, g: SensorPlaces, y: Array) -> None:
    """Write what ideal sensors measure (13,) at a state with its rate."""
    nu = (x[4], x[5], x[6], x[7], x[8], x[9])
    nu_dot = (rate[4], rate[5], rate[6], rate[7], rate[8], rate[9])
    sf, cf, st, ct = np.sin(x[0]), np.cos(x[0]), np.sin(x[1]), np.cos(x[1])
    down = (-st, ct * sf, ct * cf)
    arm = (g.imu_arm[0], g.imu_arm[1], g.imu_arm[2])
    force = specific_force_components(nu, nu_dot, arm, down, g.gravity)
    local = point_velocity_components(nu, (g.log_arm[0], g.log_arm[1], g.log_arm[2]))
    for i in range(3):
        y[i] = x[i]
        y[3 + i] = g.imu[0, i] * nu[3] + g.imu[1, i] * nu[4] + g.imu[2, i] * nu[5]
        y[6 + i] = g.imu[0, i] * force[0] + g.imu[1, i] * force[1] + g.imu[2, i] * force[2]
        y[9 + i] = g.log[0, i] * local[0] + g.log[1, i] * local[1] + g.log[2, i] * local[2]
    depth_arm = g.depth_arm
    y[12] = x[3] + down[0] * depth_arm[0] + down[1] * depth_arm[1] + down[2] * depth_arm[2]


@compiled
def accelerometer(g: SensorPlaces, a: Array | tuple[Array, ...]) -> Any:
    """Return what an accelerometer (3,) makes of an acceleration (6,) alone."""
    arm = (g.imu_arm[0], g.imu_arm[1], g.imu_arm[2])
    inner = cross_components((a[3], a[4], a[5]), arm)
    x, y, z = a[0] + inner[0], a[1] + inner[1], a[2] + inner[2]
    return (
        g.imu[0, 0] * x + g.imu[1, 0] * y + g.imu[2, 0] * z,
        g.imu[0, 1] * x + g.imu[1, 1] * y + g.imu[2, 1] * z,
        g.imu[0, 2] * x + g.imu[1, 2] * y + g.imu[2, 2] * z,
    )
