"""The made-up log of a new workspace's example: a small vehicle with thrusters.

It has four of them, and is simulated and measured with noise.
"""

from __future__ import annotations

import io

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.equations_of_motion import Control, state_derivative
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle

SEED, RATE_HZ, DURATION_S, HOLD_S = 7, 10.0, 90.0, 3.0
LINEAR = np.array([-8.0, -14.0, -18.0, -0.6, -0.6, -0.9])
QUADRATIC = np.array([-30.0, -70.0, -90.0, -0.8, -0.8, -1.2])
NOISE = {"gyro": 0.002, "attitude": 0.05, "depth": 0.005, "velocity": 0.01}
HEADER = (
    "time_s,pulse_1,pulse_2,pulse_3,pulse_4,roll_deg,pitch_deg,yaw_deg,"
    "gyro_x,gyro_y,gyro_z,depth_m,u,v,w"
)


def example_log(vehicle: Vehicle) -> bytes:
    """Return the log as CSV, in body axes FRD.

    Pulses in microseconds, attitude in degrees, rates in rad/s, depth in m, velocity in
    m/s.
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

    attitude = (noisy(np.degrees(state[:, 3:6]), "attitude") + 180.0) % 360.0 - 180.0
    depth = noisy(state[:, 2:3], "depth")
    velocity, gyro = noisy(state[:, 6:9], "velocity"), noisy(state[:, 9:12], "gyro")
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
    """Return states [eta, nu] (n, 12) under pulses (n, 4).

    Each pulse holds for one step of Runge-Kutta; drag is linear and quadratic per axis.
    """

    def drag(nu: Array) -> Array:
        return np.asarray((LINEAR + QUADRATIC * np.abs(nu)) * nu)

    state = np.zeros(12)
    state[2] = 5.0
    states, step = np.empty((len(pulses), 12)), 1.0 / RATE_HZ
    for index, pulse in enumerate(pulses):
        states[index] = state
        control = Control(thruster_pwm_us=pulse)
        first = state_derivative(vehicle, state, control, drag)
        second = state_derivative(vehicle, state + step / 2 * first, control, drag)
        third = state_derivative(vehicle, state + step / 2 * second, control, drag)
        fourth = state_derivative(vehicle, state + step * third, control, drag)
        state = state + step / 6 * (first + 2 * second + 2 * third + fourth)
    return states
