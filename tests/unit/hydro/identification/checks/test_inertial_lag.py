"""Attitude and gyro that are late together, and an accelerometer that is."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.attitude.inertial_lag import inertial_lag
from auvid.hydro.identification.checks.motion_checks import down_at

G = 9.81


def _motion(t: Array) -> tuple[Array, Array, Array]:
    """Angles, gyro and velocity of a small swing about roll and pitch."""
    roll, pitch = 0.2 * np.sin(0.9 * t) + 0.1 * np.sin(2.1 * t), 0.15 * np.sin(0.7 * t + 1.0)
    angles = np.column_stack([roll, pitch, 0.0 * t])
    rates = np.gradient(angles, t, axis=0)
    gyro = np.column_stack([rates[:, 0], np.cos(roll) * rates[:, 1], -np.sin(roll) * rates[:, 1]])
    speed = np.column_stack([0.5 + 0.2 * np.sin(0.3 * t), 0.1 * np.cos(0.4 * t), 0.0 * t])
    return angles, gyro, speed


@pytest.mark.parametrize(
    ("late_s", "force_late_s", "expected", "sign"),
    [(0.0, 0.0, 0.0, 0), (0.3, 0.0, 0.3, 1), (0.0, 0.3, -0.3, -1)],
)
def test_the_late_one_is_told_by_gravity_and_depth(
    late_s: float, force_late_s: float, expected: float, sign: int
) -> None:
    t = np.arange(0.0, 60.0, 0.02)
    angles, gyro, speed = _motion(t)
    down = down_at(t, t, angles)
    force = np.gradient(speed, t, axis=0) + np.cross(gyro, speed) - G * down
    depth = np.cumsum((down * speed).sum(axis=1)) * 0.02
    noise = np.random.default_rng(0).normal(0.0, 0.01, force.shape)
    answer = inertial_lag(
        (t, _motion(t - late_s)[1], np.array(_at(t, t + force_late_s, force)) + noise),
        (t, _motion(t - late_s)[0]),
        (t, speed + 0.1 * noise),
        (t, depth),
        gravity=G,
        arm_m=np.zeros(3),
    )
    assert answer is not None
    assert answer.lag_s == pytest.approx(expected)
    if sign:
        assert answer.better_than_none > 30.0
        assert answer.better_than_velocity > 10.0
        assert answer.by_depth is not None
        assert sign * answer.by_depth > 10.0


def test_a_late_velocity_explains_more_than_a_lag_of_the_attitude() -> None:
    """Thrusters that push as the hull tilts make both look alike."""

    def motion(t: Array) -> tuple[Array, Array, Array]:
        angles, gyro, speed = _motion(t)
        pushed = 9.0 * 0.02 * np.cumsum(angles, axis=0)
        return angles, gyro, speed + np.column_stack([-pushed[:, 1], pushed[:, 0], 0.0 * t])

    t = np.arange(0.0, 60.0, 0.02)
    angles, gyro, speed = motion(t)
    force = np.gradient(speed, t, axis=0) + np.cross(gyro, speed) - G * down_at(t, t, angles)
    noise = np.random.default_rng(0).normal(0.0, 0.01, force.shape)
    late = motion(t - 0.2)[2] + 0.1 * noise
    answer = inertial_lag(
        (t, gyro, force + noise), (t, angles), (t, late), None, gravity=G, arm_m=np.zeros(3)
    )
    assert answer is not None
    assert answer.better_than_none > 30.0
    assert answer.better_than_velocity < -30.0


def test_a_velocity_log_at_another_arm_is_no_lag() -> None:
    """At a speed u ahead, an arm x adds x of the yaw acceleration, as a lag x/u does."""
    t, arm = np.arange(0.0, 60.0, 0.02), np.array([0.5, 0.0, 0.0])
    yaw = 0.5 * np.sin(0.8 * t) + 0.2 * np.sin(1.7 * t)
    angles = np.column_stack([0.0 * t, 0.0 * t, yaw])
    gyro = np.gradient(angles, t, axis=0)
    speed = np.column_stack([1.6 + 0.0 * t, 0.1 * np.cos(0.4 * t), 0.0 * t])
    force = np.gradient(speed, t, axis=0) + np.cross(gyro, speed) - G * down_at(t, t, angles)
    noise = np.random.default_rng(0).normal(0.0, 0.01, force.shape)

    def better(other_arm_m: Array | None) -> float:
        answer = inertial_lag(
            (t, gyro, force + noise),
            (t, angles),
            (t, speed + np.cross(gyro, arm) + 0.1 * noise),
            None,
            gravity=G,
            arm_m=np.zeros(3),
            other_arm_m=other_arm_m,
        )
        assert answer is not None
        assert answer.better_than_none > 30.0
        return answer.better_than_velocity

    assert better(None) > 10.0
    assert better(arm) < -30.0


def _at(t: Array, clock: Array, values: Array) -> Array:
    return np.column_stack([np.interp(t, clock, column) for column in values.T])
