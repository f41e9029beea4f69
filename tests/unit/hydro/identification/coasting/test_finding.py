"""Coasts: found where thrust ends in motion, and counted where they are none."""

from __future__ import annotations

import numpy as np

from auvid.hydro.identification.coasting.finding import CoastRule, find_coasts, idle_axes
from tests.support.motions import shipped_vehicle

RULE = CoastRule(least_speed=0.1, wait_s=0.2, least_s=1.0, longest_s=3.0)
T_S = np.arange(0.0, 20.0, 0.05)


def rests(*spans: tuple[float, float]) -> np.ndarray:
    return np.any([(first - 1e-9 <= T_S) & (last - 1e-9 > T_S) for first, last in spans], axis=0)


def test_a_coast_begins_after_the_wait_and_ends_with_the_rest_or_the_longest() -> None:
    speed = np.full(T_S.size, -0.4)
    search = find_coasts(T_S, rests((2.0, 4.0), (6.0, 16.0)), speed, RULE)
    times = [(item.stop_s, item.start_s, item.end_s) for item in search.coasts]
    np.testing.assert_allclose(times, [(2.0, 2.2, 3.95), (6.0, 6.2, 9.2)], atol=1e-9)
    assert search.idle_s == np.sum(rests((2.0, 4.0), (6.0, 16.0))) * (T_S[1] - T_S[0])


def test_rests_that_are_short_or_slow_or_hold_from_the_start_are_no_coasts() -> None:
    speed = np.where(T_S < 10.0, 0.4, 0.01)
    search = find_coasts(T_S, rests((0.0, 3.0), (5.0, 5.8), (12.0, 16.0)), speed, RULE)
    assert not search.coasts
    assert search.slow == 1
    np.testing.assert_allclose(search.short, [(5.0, 5.75)])


def test_a_body_that_is_let_go_of_at_the_start_coasts_from_there() -> None:
    idle = rests((0.0, 3.0))
    search = find_coasts(T_S, idle, np.full(T_S.size, 0.4), RULE, released=True)
    times = [(item.stop_s, item.start_s, item.end_s) for item in search.coasts]
    np.testing.assert_allclose(times, [(0.0, 0.2, 2.95)], atol=1e-9)
    everywhere = np.ones(T_S.size, dtype=np.bool_)
    assert (
        len(find_coasts(T_S, everywhere, np.full(T_S.size, 0.4), RULE, released=True).coasts) == 1
    )
    assert not find_coasts(T_S, everywhere, np.full(T_S.size, 0.4), RULE).coasts


def test_thrust_that_never_stops_leaves_nothing() -> None:
    search = find_coasts(T_S, np.zeros(T_S.size, dtype=np.bool_), np.ones(T_S.size), RULE)
    assert (search.coasts, search.short, search.slow, search.idle_s) == ((), (), 0, 0.0)


def test_horizontal_thrusters_at_rest_leave_surge_sway_and_yaw_idle() -> None:
    thrusters = shipped_vehicle("bluerov2_heavy").thrusters
    assert thrusters is not None
    thrust = np.zeros((2, 8))
    thrust[0, 4:] = 5.0  # it holds its depth
    thrust[1, 0] = 5.0
    idle = idle_axes(thrust, thrusters.allocation, largest_N=50.0)
    assert idle[0].tolist() == [True, True, False, False, False, True]
    assert not idle[1, [0, 1, 5]].any()
    assert idle[1, 2]
