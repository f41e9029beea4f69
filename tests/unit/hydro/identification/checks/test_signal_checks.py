"""The measures behind the health page, against signals whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.dynamics.mechanics.kinematics import euler_rate_matrix_inverse
from auvid.hydro.identification.checks.attitude import rate_agreement as comparison
from auvid.hydro.identification.checks.attitude.rate_agreement import (
    OTHER_ORDERS,
    other_order,
    rate_agreement,
)
from auvid.hydro.identification.checks.response import response_lag
from auvid.hydro.identification.checks.signal_checks import (
    attitude_difference,
    clock_statistics,
    flat_top,
    following,
    gravity,
    repeats,
    thinned,
)

LAG_S = 0.23


def tumbling(t: np.ndarray) -> np.ndarray:
    """Attitude (n, 3) of a vehicle that is turned over by hand: roll through all
    angles, pitch to 89.9 degrees, yaw round and round.
    """
    return np.stack([2.0 * t, 1.569 * np.sin(0.3 * t), 0.7 * t], axis=1)


def body_rates(t: np.ndarray) -> np.ndarray:
    step = 1e-6
    dot = (tumbling(t + step) - tumbling(t - step)) / (2.0 * step)
    return np.einsum("nij,nj->ni", euler_rate_matrix_inverse(tumbling(t)), dot)


def test_gyro_agrees_with_a_tumbling_attitude_through_the_singularity_and_wraps() -> None:
    t, at = np.arange(0.0, 60.0, 0.1), np.arange(0.0, 60.0, 0.02)
    wrapped = np.angle(np.exp(1j * tumbling(t)))
    agreement = rate_agreement(t, wrapped, at, body_rates(at))
    assert agreement is not None
    # The mean rate over 0.1 s differs from the mean of the body rates by the turning of
    # the axes within it: about 1 %.
    assert np.diag(agreement.correlation) == pytest.approx([1.0] * 3, abs=2e-3)
    assert agreement.scale == pytest.approx([1.0] * 3, abs=0.02)
    assert agreement.lag_s == pytest.approx(0.0, abs=0.01)
    assert agreement.jumps == 0


def test_orders_of_turns_are_compared_on_the_attitudes_that_are_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a log of an hour all samples were turned into five other orders and back."""
    turned: list[int] = []
    in_order = comparison.in_order

    def counted(euler: np.ndarray, order: str) -> np.ndarray:
        turned.append(len(euler))
        return in_order(euler, order)

    monkeypatch.setattr(comparison, "in_order", counted)
    at = np.arange(0.0, 60.0, 0.02)
    other = other_order(at, in_order(tumbling(at), "ZYX"), at, body_rates(at))
    assert other is not None
    assert other[1] > 1.0  # the others leave more
    assert turned == [len(at) // 5] * len(OTHER_ORDERS)


@pytest.mark.parametrize(("scale", "within"), [(1.0, 0.05), (2.0, 0.25), (57.3, 0.25)])
def test_noise_of_an_attitude_is_no_scale_of_the_gyro(scale: float, within: float) -> None:
    """2 mrad of noise at 20 Hz: the standard deviations alone say .8 for an exact gyro."""
    t, at = np.arange(0.0, 200.0, 0.05), np.arange(0.0, 200.0, 0.02)
    swing = 0.1 * np.sin(0.5 * np.outer(t, [1.0, 1.3, 1.7]))
    rate = 0.1 * 0.5 * np.array([1.0, 1.3, 1.7]) * np.cos(0.5 * np.outer(at, [1.0, 1.3, 1.7]))
    noisy = swing + np.random.default_rng(1).normal(0.0, 2e-3, swing.shape)
    agreement = rate_agreement(t, noisy, at, scale * rate)
    assert agreement is not None
    assert agreement.scale[1:] == pytest.approx([scale] * 2, rel=within)


@pytest.mark.parametrize("lag_s", [-0.3, 0.0, LAG_S])
def test_lag_of_a_late_gyro(lag_s: float) -> None:
    t, at = np.arange(0.0, 60.0, 0.1), np.arange(0.0, 60.0, 0.04)
    slow = np.stack([0.1 * np.sin(2.0 * t), 0.1 * np.sin(1.5 * t), np.sin(t)], axis=1)
    late = at - lag_s
    dot = np.stack([0.2 * np.cos(2.0 * late), 0.15 * np.cos(1.5 * late), np.cos(late)], axis=1)
    there = np.stack([0.1 * np.sin(2.0 * late), 0.1 * np.sin(1.5 * late), np.sin(late)], axis=1)
    agreement = rate_agreement(
        t, slow, at, np.einsum("nij,nj->ni", euler_rate_matrix_inverse(there), dot)
    )
    assert agreement is not None
    assert agreement.lag_s == pytest.approx(lag_s, abs=0.01)


def test_a_turn_across_a_pause_of_the_gyro_is_not_compared() -> None:
    t, at = np.arange(0.0, 60.0, 0.1), np.arange(0.0, 60.0, 0.02)
    kept = (at < 20.0) | (at > 22.0)
    agreement = rate_agreement(t, tumbling(t), at[kept], body_rates(at)[kept])
    unbroken = rate_agreement(t, tumbling(t), at, body_rates(at))
    assert agreement is not None
    assert unbroken is not None
    assert unbroken.count - agreement.count == pytest.approx(20, abs=2)
    assert agreement.jumps == 0


def test_repeats_and_the_longest_run() -> None:
    values = np.array([[1.0, 1.0], [1.0, 2.0], [1.0, 2.0], [1.0, 2.0], [9.0, 2.0], [9.0, 2.0]])
    counts = repeats(values)
    assert counts.share == pytest.approx(3 / 5)
    assert (counts.run_start, counts.run_count) == (1, 3)
    assert repeats(values[:1]).share == 0.0
    steps = repeats(np.round(np.random.default_rng(1).uniform(0.0, 1.2, (500, 1))))
    assert steps.leap == 1.0


def test_flat_top_counts_runs_at_the_extremes_only() -> None:
    assert flat_top(np.array([0.0, 2.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0, -3.0])) == 4
    assert flat_top(np.sin(np.arange(0.0, 20.0, 0.1))) == 0
    assert flat_top(np.zeros(2)) == 0


def test_clock_statistics_of_a_pause() -> None:
    t = np.concatenate([np.arange(0.0, 10.0, 0.1), np.arange(15.0, 20.0, 0.1)])
    clock = clock_statistics(t)
    assert clock is not None
    assert clock.rate_hz == pytest.approx(10.0)
    assert clock.longest_s == pytest.approx(5.1)
    assert clock.longest_at_s == pytest.approx(9.9)
    assert clock.jitter_s == pytest.approx(0.0, abs=1e-9)
    assert clock_statistics(t[:2]) is None


def test_bursts_come_no_faster_for_arriving_together() -> None:
    t = (np.arange(0.0, 60.0, 1.0)[:, None] + np.array([0.0, 0.007, 0.014, 0.021])).ravel()
    clock = clock_statistics(t)
    assert clock is not None
    assert clock.rate_hz == pytest.approx(4.0, rel=0.02)
    assert clock.step_s == pytest.approx(0.007)


def test_every_jump_of_a_long_record_is_counted_the_first_samples_included() -> None:
    t = np.arange(0.0, 1500.0, 0.1)
    at = np.arange(0.0, 1500.0, 0.04)
    turned = np.zeros((t.size, 3))
    for jump in (0.15, 400.05, 400.75, 901.35):
        turned[t > jump, 2] += 0.5
    agreement = rate_agreement(
        t, turned, at, 1e-3 * np.random.default_rng(1).standard_normal((at.size, 3))
    )
    assert agreement is not None
    assert agreement.jumps == 4
    assert agreement.largest_jump == pytest.approx(0.5, abs=0.01)
    assert np.allclose(agreement.std, 0.0, atol=1e-3), "jumps are left out of the comparison"


def test_attitude_difference_is_the_angle_between_rotations() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    euler = 0.2 * np.stack([np.sin(t), np.cos(t), t], axis=1)
    turned = euler + np.array([0.0, 0.0, 0.6 - 2.0 * np.pi])
    difference = attitude_difference(t, euler, t, turned)
    assert difference is not None
    assert (difference.angle, difference.heading) == pytest.approx((0.6, 0.6))
    assert difference.tilt == pytest.approx(0.0, abs=1e-6)
    rolled = attitude_difference(t, 0.0 * euler, t, np.array([0.3, 0.0, 0.0]) + 0.0 * euler)
    assert rolled is not None
    assert (rolled.angle, rolled.tilt, rolled.heading) == pytest.approx((0.3, 0.3, 0.0))
    assert attitude_difference(t, euler, t + 1000.0, euler) is None


def test_gravity_without_attitude_has_no_angle() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    level = gravity(t, np.tile([0.0, 0.0, -9.8], (t.size, 1)))
    assert level is not None
    assert level.magnitude == pytest.approx(9.8)
    assert level.angle is None
    assert gravity(t, np.full((t.size, 3), np.nan)) is None


def test_following_is_not_pulled_down_by_noise() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    random = np.random.default_rng(4)
    clean = np.sin(0.3 * t)
    noisy = [clean + 0.5 * random.standard_normal(t.size) for _ in range(2)]
    relation = following(t, noisy[0], t, -2.0 * noisy[1])
    assert relation is not None
    assert relation.scale == pytest.approx(-2.0, abs=0.1)
    assert relation.correlation == pytest.approx(-0.67, abs=0.05)
    assert following(t, np.ones(t.size), t, clean) is None


def test_response_to_several_commands_at_once() -> None:
    random = np.random.default_rng(6)
    t = np.arange(0.0, 120.0, 0.1)
    commands = np.cumsum(random.standard_normal((t.size, 3)), axis=0)
    commands -= np.stack(
        [np.convolve(column, np.ones(31) / 31, mode="same") for column in commands.T], axis=1
    )
    fine = np.arange(0.0, 119.0, 0.05)
    answer = sum(
        weight * np.interp(fine - LAG_S, t, column)
        for weight, column in zip((1.0, -2.0, 0.5), commands.T, strict=True)
    )
    response = response_lag(
        t,
        commands,
        fine,
        answer + 0.2 * random.standard_normal(fine.size),
        lags_s=(-0.5, 2.0),
        rate_hz=20.0,
    )
    assert response is not None
    assert response.lag_s == pytest.approx(LAG_S, abs=0.02)
    assert (
        response.explained > 0.7
    )  # the noise and the halves of the steps that the grid cuts off are the rest
    chance = response_lag(
        t, commands, fine, random.standard_normal(fine.size), lags_s=(-0.5, 2.0), rate_hz=20.0
    )
    assert chance is not None
    assert chance.explained < 0.1
    assert (
        response_lag(t, np.ones((t.size, 2)), fine, np.sin(fine), lags_s=(-0.5, 2.0), rate_hz=20.0)
        is None
    )
    assert (
        response_lag(t[:50], commands[:50], fine, np.sin(fine), lags_s=(-0.5, 2.0), rate_hz=20.0)
        is None
    )


def test_long_records_are_thinned() -> None:
    assert thinned(np.arange(100_001)).size <= 4000
    assert thinned(np.arange(10)).tolist() == list(range(10))
