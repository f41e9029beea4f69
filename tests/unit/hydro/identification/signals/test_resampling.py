"""To a uniform clock without invention: gaps stay, nothing is extrapolated, attitude
turns as a rotation.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.mechanics.kinematics import (
    euler_rate_matrix_inverse,
    rotation_body_to_ned,
)
from auvid.hydro.identification.signals.resampling import (
    gaps,
    hold,
    interpolate_rotation,
    linear,
    smooth_attitude,
    uniform_clock,
    unwrap_angles,
)


def test_gaps_split_where_a_step_is_too_long() -> None:
    t = [0.0, 0.1, 0.2, 1.0, 1.1, 3.0]
    assert gaps(t, 0.5) == [(0, 3), (3, 5), (5, 6)]
    assert gaps(t, 5.0) == [(0, 6)]
    assert gaps([], 1.0) == []


def test_uniform_clock_keeps_the_last_sample_and_no_later_one() -> None:
    np.testing.assert_allclose(uniform_clock(1.0, 1.3, 10.0), [1.0, 1.1, 1.2, 1.3])
    assert uniform_clock(0.0, 0.999, 10.0)[-1] == pytest.approx(0.9)
    with pytest.raises(DataError, match="positive rate"):
        uniform_clock(0.0, 1.0, 0.0)
    with pytest.raises(DataError, match="end after"):
        uniform_clock(1.0, 0.0, 1.0)


def test_linear_is_exact_between_and_nan_outside_and_in_gaps() -> None:
    t, y = (
        np.array([0.0, 1.0, 2.0, 6.0]),
        np.array([[0.0, 1.0], [2.0, 1.0], [4.0, 1.0], [0.0, 1.0]]),
    )
    out = linear(t, y, [-0.1, 0.0, 0.5, 2.0, 4.0, 6.0, 6.1], max_gap_s=1.5)
    np.testing.assert_allclose(out[:, 0], [np.nan, 0.0, 1.0, 4.0, np.nan, 0.0, np.nan])
    assert linear(t, y, [4.0])[0, 0] == pytest.approx(2.0)


def test_linear_gives_a_sample_beside_a_missing_one() -> None:
    out = linear([0.0, 1.0, 2.0], [5.0, np.nan, 7.0], [0.0, 0.5, 2.0])
    np.testing.assert_allclose(out, [5.0, np.nan, 7.0])


def test_hold_takes_the_previous_sample() -> None:
    out = hold(
        [0.0, 1.0, 5.0],
        [10.0, 20.0, 30.0],
        [-1.0, 0.0, 0.9, 1.0, 2.5, 4.0, 5.0, 5.5],
        max_gap_s=2.0,
    )
    np.testing.assert_allclose(out, [np.nan, 10.0, 10.0, 20.0, 20.0, np.nan, 30.0, np.nan])


@pytest.mark.parametrize("call", [linear, hold])
def test_clock_that_stands_still_is_refused(call: object) -> None:
    with pytest.raises(DataError, match="increase strictly"):
        call([0.0, 0.0], [1.0, 2.0], [0.0])  # type: ignore[operator]
    with pytest.raises(DataError, match="differ in length"):
        call([0.0, 1.0], [1.0], [0.0])  # type: ignore[operator]


def test_unwrap_angles_along_time() -> None:
    yaw = np.linspace(0.0, 20.0, 100)
    wrapped = np.column_stack([(yaw + np.pi) % (2 * np.pi) - np.pi, np.zeros(100)])
    np.testing.assert_allclose(unwrap_angles(wrapped)[:, 0], yaw, atol=1e-12)


def test_interpolated_attitude_turns_at_constant_rate_about_one_axis() -> None:
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    angle = np.linspace(0.0, 7.0, 15)
    euler = Rotation.from_rotvec(angle[:, None] * axis).as_euler("ZYX")[:, ::-1]
    new = np.linspace(0.0, 14.0, 113)
    got = interpolate_rotation(np.arange(15.0), euler, new)
    expected = Rotation.from_rotvec((new * 0.5)[:, None] * axis).as_matrix()
    np.testing.assert_allclose(rotation_body_to_ned(got), expected, atol=1e-12)


def test_attitude_crosses_north_the_short_way_and_keeps_its_turn_count() -> None:
    got = interpolate_rotation(
        [0.0, 1.0], np.array([[0.0, 0.0, 12.4], [0.0, 0.0, 12.7]]), [0.0, 0.5, 1.0, 2.0]
    )
    np.testing.assert_allclose(got[:3, 2], [12.4, 12.55, 12.7])
    assert np.isnan(got[3]).all()
    gap = interpolate_rotation([0.0, 5.0], np.zeros((2, 3)), [2.0], max_gap_s=1.0)
    assert np.isnan(gap).all()


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    euler = np.column_stack([0.2 * np.sin(t), 0.3 * np.sin(0.7 * t + 1.0), 3.0 * np.sin(0.4 * t)])
    rate = np.column_stack([0.2 * np.cos(t), 0.21 * np.cos(0.7 * t + 1.0), 1.2 * np.cos(0.4 * t)])
    return euler, np.einsum("nij,nj->ni", euler_rate_matrix_inverse(euler), rate)


def test_smooth_attitude_recovers_attitude_rates_and_accelerations() -> None:
    t = np.arange(2000) / 50.0
    euler, omega = motion(t)
    inner = slice(100, -100)
    clean = smooth_attitude(t, euler, t, lam=1e-9)
    np.testing.assert_allclose(clean.euler[inner], euler[inner], atol=1e-6)
    np.testing.assert_allclose(clean.omega[inner], omega[inner], atol=1e-5)
    np.testing.assert_allclose(
        clean.omega_dot[inner], np.gradient(omega, t, axis=0)[inner], atol=2e-3
    )
    noise = np.deg2rad(0.05) * np.random.default_rng(3).standard_normal(euler.shape)
    noisy = smooth_attitude(t, euler + noise, t)
    # 0.05 degrees at 50 Hz, spread over some ten samples and differentiated.
    assert np.sqrt(np.mean((noisy.omega - omega)[inner] ** 2)) < 5e-3
    assert np.isnan(smooth_attitude(t, euler, [-1.0, 100.0], cutoff_hz=2.0).omega).all()


def test_smooth_attitude_passes_through_vertical_pitch_and_does_not_depend_on_the_frame() -> None:
    t = np.arange(1000) / 50.0
    euler, _ = motion(t)
    loop = Rotation.from_euler("Y", (0.6 * t)[:, None]) * Rotation.from_euler("ZYX", euler[:, ::-1])
    level = smooth_attitude(t, loop.as_euler("ZYX")[:, ::-1], t, cutoff_hz=1.0)
    turned = smooth_attitude(
        t, (Rotation.from_euler("Y", 1.1) * loop).as_euler("ZYX")[:, ::-1], t, cutoff_hz=1.0
    )
    np.testing.assert_allclose(turned.omega, level.omega, atol=1e-9)
    assert np.abs(level.omega).max() < 3.0
