"""Lag and turn of a velocity log on a vehicle that goes round."""

import math

import numpy as np
import pytest

from auvid.hydro.identification.checks.velocity_answer import velocity_answer

T_S = 0.02 * np.arange(4000)
LAGS_S = tuple(0.1 * np.arange(-5, 16))


@pytest.mark.parametrize(("degrees", "late_s"), [(0.0, 0.0), (45.0, 0.0), (-60.0, 0.3)])
def test_a_log_that_is_turned_far_is_not_late(degrees: float, late_s: float) -> None:
    """On a circle a velocity that is turned looks like one that is early or late."""
    noise = np.random.default_rng(2)
    rate = 0.5 + 0.2 * np.sin(0.5 * T_S)
    speed = np.column_stack([1.0 + 0.3 * np.sin(0.35 * T_S), 0.1 * np.cos(0.8 * T_S), 0.0 * T_S])
    gyro = np.column_stack([0.0 * T_S, 0.0 * T_S, rate])
    force = np.gradient(speed, T_S, axis=0) + np.cross(gyro, speed) - [0.0, 0.0, 9.81]
    force += noise.normal(0.0, 0.02, force.shape)
    angle = math.radians(degrees)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    read = np.column_stack([speed[:, :2] @ turn, speed[:, 2]])
    euler = np.column_stack([0.0 * T_S, 0.0 * T_S, np.cumsum(rate) * 0.02])
    answer = velocity_answer(
        (T_S, gyro, force),
        (T_S, euler),
        (T_S[::5] + late_s, read[::5] + noise.normal(0.0, 0.005, read[::5].shape)),
        gravity=9.81,
        lags_s=LAGS_S,
    )
    assert answer is not None
    assert answer.turn is not None
    assert answer.lag_s == pytest.approx(late_s, abs=0.11)
    assert math.degrees(answer.turn.angle) == pytest.approx(degrees, abs=1.5)
    assert answer.turn.explained > 0.95


@pytest.mark.parametrize("seed", [0, 4])
def test_few_steps_tell_scale_and_lag_of_a_vehicle_that_is_steady_else(seed: int) -> None:
    """Noise of the steady windows makes no other scale or lag likely."""
    noise = np.random.default_rng(seed)
    t_s = 0.125 * np.arange(960)
    goals = np.repeat(noise.uniform(-0.8, 0.8, 16), 60)
    surge = np.zeros(t_s.size)
    for row in range(1, t_s.size):
        surge[row] = surge[row - 1] + 0.1 * (goals[row] - surge[row - 1])
    still = np.zeros(t_s.size)
    speed = np.column_stack([surge, still, still])
    force = np.gradient(speed, t_s, axis=0) - [0.0, 0.0, 9.81]
    force += noise.normal(0.0, 0.22, force.shape)
    answer = velocity_answer(
        (t_s, np.zeros((t_s.size, 3)), force),
        (t_s, np.zeros((t_s.size, 3))),
        (t_s, speed + noise.normal(0.0, 0.01, speed.shape)),
        gravity=9.81,
        lags_s=LAGS_S,
    )
    assert answer is not None
    assert answer.turn is not None
    assert answer.lag_s == pytest.approx(0.0, abs=0.11)
    assert answer.turn.bounds[0] < 1.0
    assert answer.turn.bounds[1] * (1.0 + 4.0 * answer.turn.scale_sd) > 1.0
