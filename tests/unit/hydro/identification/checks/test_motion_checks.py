"""Gains between two records of one motion, and the lag between them."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.identification.checks import motion_checks
from auvid.hydro.identification.checks.motion_checks import (
    BLOCK_ROWS,
    angles_at,
    depth_gains,
    down_at,
    gains_by_lag,
    integrals,
    velocity_lag,
)
from auvid.hydro.identification.checks.robust_gains import AxisGains, fitted_gains

T_ATTITUDE, T_VELOCITY = np.arange(0.0, 60.0, 0.1), np.arange(0.03, 60.0, 0.125)


def euler(t: Array) -> Array:
    """Attitude (n, 3) [rad] whose yaw wraps."""
    yaw = np.angle(np.exp(1j * 0.2 * t))
    return np.column_stack([0.3 * np.sin(0.5 * t), 0.2 * np.cos(0.7 * t), yaw])


def speed(t: Array) -> Array:
    """Body velocity (n, 3) [m/s]."""
    return np.column_stack([np.sin(0.9 * t), 0.5 * np.cos(1.3 * t), 0.4 * np.sin(1.7 * t)])


def depth(t: Array) -> Array:
    """Depth (n,) [m] that this attitude and velocity give, by fine steps."""
    fine = np.arange(-5.0, 65.0, 1e-3)
    rate = np.einsum("ni,ni->n", rotation_body_to_ned(euler(fine))[:, 2], speed(fine))
    return np.interp(t, fine, np.cumsum(rate) * 1e-3)


def test_down_is_the_third_row_of_the_rotation_whatever_the_yaw() -> None:
    own = down_at(T_VELOCITY, T_ATTITUDE, euler(T_ATTITUDE))
    angles = angles_at(T_VELOCITY, T_ATTITUDE, euler(T_ATTITUDE))
    np.testing.assert_allclose(own, rotation_body_to_ned(angles)[:, 2], atol=1e-15)


def test_integrals_are_those_of_one_sum_of_trapezoids_block_after_block() -> None:
    rng = np.random.default_rng(4)
    count = 9 * BLOCK_ROWS + 7
    t = np.cumsum(rng.uniform(0.01, 0.03, count))
    values = rng.normal(size=(count, 2))
    ends = np.append(t[[0, BLOCK_ROWS, 2 * BLOCK_ROWS - 1, -1]] - 0.25, (t[0] - 9.0, t[-1] + 9.0))
    at = np.concatenate([t[0] + np.arange(0.0, t[-1] - t[0] - 0.5, 7.0), ends])
    tracemalloc.start()
    own = integrals(t, values, at, 0.5)
    used = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t)[:, None]
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    for column in range(2):
        sides = [np.interp(side, t, total[:, column]) for side in (at, at + 0.5)]
        np.testing.assert_array_equal(own[:, column], sides[1] - sides[0])
    assert used < values.nbytes  # one sum of all samples takes 3 times as much


def test_outliers_are_left_out_and_the_rest_is_the_plain_fit() -> None:
    rng = np.random.default_rng(3)
    design = rng.normal(size=(80, 2))
    y = design @ [1.5, -0.5] + 0.2 + 0.01 * rng.normal(size=80)
    y[::20] += 5.0
    sound = np.arange(80) % 20 != 0
    gains = fitted_gains(y, design)
    assert gains is not None
    assert gains.count == 76
    full = np.column_stack([design, np.ones(80)])[sound]
    plain, rest, _, _ = np.linalg.lstsq(full, y[sound], rcond=None)
    np.testing.assert_allclose(gains.gain, plain[:2], rtol=1e-12)
    covariance = np.linalg.inv(full.T @ full) * rest[0] / 73.0
    np.testing.assert_allclose(gains.sd, np.sqrt(np.diag(covariance))[:2], rtol=1e-9)
    assert gains.explained == pytest.approx(1.0 - rest[0] / 73.0 / np.var(y[sound]), rel=1e-9)


def test_a_column_without_motion_has_no_deviation_and_few_windows_no_gains() -> None:
    rng = np.random.default_rng(4)
    design = np.column_stack([rng.normal(size=40), np.full(40, 2.0)])
    gains = fitted_gains(design[:, 0] + 1e-3 * rng.normal(size=40), design)
    assert gains is not None
    assert np.isinf(gains.sd[1])
    assert fitted_gains(np.zeros(13), design[:13]) is None


@pytest.mark.parametrize("late_s", [-0.8, 0.0, 0.5])
def test_lag_is_that_of_the_best_of_all_fits(late_s: float) -> None:
    """Either record may be the late one; each lag is judged by a fit of its own."""
    lags = np.round(np.arange(-10, 11) * 0.1, 1)
    z, turned, seen_s = depth(T_ATTITUDE), euler(T_ATTITUDE), T_VELOCITY + late_s
    velocity = speed(T_VELOCITY)

    def gains(t_depth: Array, t_velocity: Array) -> AxisGains:
        fit = depth_gains(t_depth, z, T_ATTITUDE, turned, t_velocity, velocity)
        assert fit is not None
        return fit

    result = velocity_lag(T_ATTITUDE, z, T_ATTITUDE, turned, seen_s, velocity, lags_s=lags)
    assert result is not None
    lag, there, at_zero = result
    assert lag == pytest.approx(late_s)
    assert there == max(
        gains(T_ATTITUDE, seen_s - lag).explained, gains(T_ATTITUDE + lag, seen_s).explained
    )
    assert at_zero == gains(T_ATTITUDE, seen_s).explained
    np.testing.assert_allclose(gains(T_ATTITUDE, T_VELOCITY).gain, 1.0, atol=0.02)


def test_a_velocity_log_ahead_of_the_depth_sensor_is_no_scale_of_its_heave() -> None:
    """Nobody states the arm of .4 m: the hull pitches, and the log moves 7 times as much."""
    fine, arm = np.arange(-5.0, 65.0, 1e-3), np.array([0.4, 0.0, 0.0])
    down = rotation_body_to_ned(euler(fine))[:, 2]
    depth_of_log = 0.02 * np.sin(1.7 * fine) + down @ arm
    heave = np.gradient(depth_of_log, fine) / down[:, 2]
    velocity = np.zeros((T_VELOCITY.size, 3))
    velocity[:, 2] = np.interp(T_VELOCITY, fine, heave)
    z = 0.02 * np.sin(1.7 * T_ATTITUDE)
    poses = (T_ATTITUDE, z, T_ATTITUDE, euler(T_ATTITUDE), T_VELOCITY, velocity)
    plain, freed = depth_gains(*poses), depth_gains(*poses, arm_unknown=True)
    assert plain is not None
    assert freed is not None
    assert plain.gain[2] + 4.0 * plain.sd[2] < 0.5
    assert freed.gain[2] == pytest.approx(1.0, abs=0.05)
    assert freed.gain.shape == freed.sd.shape == (3,)


def test_many_lags_take_the_memory_of_a_few_and_give_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(6)
    t = 0.1 * np.arange(20_000)
    force, motion = np.cumsum(rng.normal(size=(2, t.size)), axis=1) * 0.01
    lags = np.linspace(-1.0, 1.0, 41)
    every = gains_by_lag(t, force[:, None], t, motion, lags_s=lags)
    monkeypatch.setattr(motion_checks, "MOST_WINDOWS", 12_000)
    tracemalloc.start()
    few = gains_by_lag(t, force[:, None], t, motion, lags_s=lags)
    used = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    for one, other in zip(few, every, strict=True):
        assert one is not None
        assert other is not None
        for name, value in vars(one).items():
            np.testing.assert_allclose(value, getattr(other, name), rtol=1e-9, err_msg=name)
    assert len({None if gains is None else float(gains.gain[0]) for gains in few}) == len(lags)
    windows_of_all = 8 * lags.size * t.size * 0.1 / 0.5
    assert used < 8 * windows_of_all  # all at once take 32 times as much as their begins
    monkeypatch.setattr(motion_checks, "MOST_WINDOWS_OF_A_LAG", 10_000)
    (full,) = gains_by_lag(t, force[:, None], t, motion, lags_s=[0.0])
    thinned = every[lags.size // 2]  # each second window of a long log says the same
    assert full is not None
    assert thinned is not None
    assert (thinned.count, full.count) == pytest.approx((2000, 4000), rel=0.02)
    assert abs(thinned.gain[0] - full.gain[0]) < 2.0 * thinned.sd[0]


def test_roll_and_pitch_from_0_to_360_degrees_are_those_about_zero() -> None:
    """They leap at rest, and values between two samples must not lie halfway round."""
    counted = np.column_stack([euler(T_ATTITUDE)[:, :2] % (2.0 * np.pi), euler(T_ATTITUDE)[:, 2]])
    down = down_at(T_VELOCITY, T_ATTITUDE, counted)
    np.testing.assert_allclose(down, down_at(T_VELOCITY, T_ATTITUDE, euler(T_ATTITUDE)), atol=1e-9)
    tilts = [
        angles_at(T_VELOCITY, T_ATTITUDE, each)[:, :2] for each in (counted, euler(T_ATTITUDE))
    ]
    np.testing.assert_allclose(np.sin(tilts[0]), np.sin(tilts[1]), atol=1e-9)
