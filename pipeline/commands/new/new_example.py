"""The log of a new workspace's example campaign, from a simulated small vehicle.

It has four thrusters; what its sensors measure carries noise.
"""

from __future__ import annotations

import io

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.equations_of_motion import Control, actuator_force
from auvid.hydro.dynamics.simulation.simulation import (
    Actuation,
    SimulatedVehicle,
    integrate_open_loop,
)
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel

SEED, RATE_HZ, DURATION_S, HOLD_S = 7, 10.0, 90.0, 3.0
LINEAR = np.array([-8.0, -14.0, -18.0, -0.6, -0.6, -0.9])
QUADRATIC = np.array([-30.0, -70.0, -90.0, -0.8, -0.8, -1.2])
NOISE = {"gyro": 0.002, "attitude": 0.05, "depth": 0.005, "velocity": 0.01}
HEADER = (
    "time_s,pulse_1,pulse_2,pulse_3,pulse_4,roll_deg,pitch_deg,yaw_deg,"
    "gyro_x,gyro_y,gyro_z,depth_m,u,v,w"
)


def example_log(vehicle: Vehicle) -> bytes:
    """Return the log as CSV.

    Pulses in microseconds, attitude in degrees, rates in rad/s, depth in m, velocity in
    m/s; body FRD.
    """
    rng = np.random.default_rng(SEED)
    t_s = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    steps = rng.uniform(-250.0, 250.0, (int(DURATION_S / HOLD_S), 4)) * [1.0, 1.0, 1.0, 0.5]
    pulses: Array = 1500.0 + np.round(np.repeat(steps, int(HOLD_S * RATE_HZ), axis=0)).astype(
        np.float64
    )
    state = simulate(vehicle, pulses)

    def noisy(values: Array, sensor: str) -> Array:
        return values + rng.normal(0.0, NOISE[sensor], values.shape)

    attitude = (noisy(np.degrees(state[:, 9:]), "attitude") + 180.0) % 360.0 - 180.0
    depth = noisy(state[:, 8:9], "depth")
    velocity, gyro = noisy(state[:, :3], "velocity"), noisy(state[:, 3:6], "gyro")
    buffer = io.StringIO()
    columns = np.hstack([t_s[:, None], pulses, attitude, gyro, depth, velocity])
    np.savetxt(
        buffer,
        columns,
        delimiter=",",
        header=HEADER,
        comments="",
        fmt=["%.2f", *["%.0f"] * 4, *["%.3f"] * 3, *["%.4f"] * 7],
    )
    return buffer.getvalue().encode()


def simulate(vehicle: Vehicle, pulses: Array) -> Array:
    """Return states [nu, eta] (n, 12) under pulses (n, 4) that change every HOLD_S.

    Drag is linear and quadratic per axis.
    """
    drag = {
        axis: {name: float(linear), f"{name}*|{name}|": float(quadratic)}
        for axis, name, linear, quadratic in zip(AXES, VELOCITIES, LINEAR, QUADRATIC, strict=True)
    }
    simulated = SimulatedVehicle(vehicle, IdentifiedModel("example", drag))
    samples = int(HOLD_S * RATE_HZ)
    control = Control(thruster_pwm_us=pulses[::samples])
    state, states = np.zeros(12), []
    state[8] = 5.0
    for force in actuator_force(vehicle, np.zeros(6), control)["thrusters"]:
        steady = Actuation(np.zeros(2), np.zeros((2, 4)), np.tile(force, (2, 1)))
        path = integrate_open_loop(
            simulated, state, steady, step_s=1.0 / RATE_HZ, steps_per_knot=samples
        )
        states.append(path[:-1])
        state = path[-1]
    return np.concatenate(states)
