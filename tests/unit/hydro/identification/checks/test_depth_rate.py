"""The depth rate of a velocity, as body and as level axes, and jumps of a record."""

import numpy as np
import pytest

from auvid.hydro.identification.checks.attitude.depth_rate import DepthRates, depth_rates
from auvid.hydro.identification.checks.signal_checks import jumps

T_S = 0.1 * np.arange(1200)


def rates(
    later_s: float = 0.0, *, level: bool = False, waves_m_s: float = 0.0, wander_rad: float = 0.0
) -> DepthRates:
    """A body that surges at 0.5 m/s, heaves and pitches by 3 degrees."""
    noise = np.random.default_rng(5)
    heave = 0.1 * np.convolve(noise.normal(size=T_S.size), np.ones(30) / 5.0, "same")
    pitch = (0.0 if wander_rad else 0.05) * np.sin(0.9 * T_S)
    speed = np.column_stack([np.full(T_S.size, 0.5), 0.0 * T_S, heave])
    speed[:, 0] += 0.2 * np.sin(0.4 * T_S)
    down = heave * np.cos(pitch) - speed[:, 0] * np.sin(pitch)
    depth = 5.0 + np.cumsum(down) * 0.1 + noise.normal(0.0, 0.002, T_S.size)
    depth = np.interp(T_S - later_s, T_S, depth)
    slow = np.convolve(np.random.default_rng(6).normal(size=T_S.size), np.ones(50), "same")
    euler = np.column_stack([0.0 * T_S, pitch + wander_rad * slow / 7.0, 0.3 * T_S])
    if level:
        speed[:, 2] = down
    speed[:, 2] += waves_m_s * np.cos(2.0 * np.pi / 5.0 * T_S)  # no pressure changes with them
    compared = depth_rates(
        T_S, depth, T_S, euler, T_S, speed + noise.normal(0.0, 0.003, speed.shape)
    )
    assert compared is not None
    return compared


def test_level_axes_are_told_by_heave_that_the_tilt_does_not_turn() -> None:
    assert rates().level_odds() < -25.0
    assert rates(level=True).level_odds() > 25.0
    assert rates().correlation > 0.99
    assert rates(wander_rad=0.02).level_odds() <= 0.0  # a hull that does not tilt


@pytest.mark.parametrize("later_s", [14.0, -9.0])
def test_a_shift_is_measured_where_nothing_relates(later_s: float) -> None:
    shifted = rates(later_s)
    assert abs(shifted.correlation) < 0.3
    assert shifted.slow_correlation < 0.6
    shift_s, likeness = shifted.best_shift()
    assert shift_s == later_s
    assert likeness > 0.95


def test_only_steps_to_a_level_that_stays_are_jumps() -> None:
    values = 0.02 * np.sin(T_S)
    values[500:] += 0.5
    values[700] += 0.5  # and back
    values[900:] += np.minimum(0.09 * np.arange(300), 0.9)  # fast, and a motion
    assert jumps(T_S, values, least=0.1, rate=1.0).tolist() == [499]
    repeated = values[np.arange(T_S.size) // 20 * 20]  # each for two seconds
    assert jumps(T_S, repeated + 0.3 * np.sin(2.0 * repeated), least=0.1, rate=1.0).size == 0
    assert not jumps(T_S[:8], values[496:504], least=0.1, rate=1.0).size


def test_a_hull_that_rides_waves_is_still_of_one_dive() -> None:
    riding = rates(waves_m_s=2.0)
    assert riding.correlation < 0.3
    assert riding.slow_correlation > 0.8
