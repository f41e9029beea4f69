"""Free swings against the pendulum that made them, and releases against known times."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.passive.free_swing import fit_free_swing
from auvid.hydro.identification.passive.releases import fading, onsets, released, towed
from tests.support.towed_body import D_1, D_2, STEP_S, K, towed_body


def test_a_swing_of_roll_gives_restoring_and_damping_over_inertia() -> None:
    body = towed_body(4)
    part = slice(495, 655)
    swing = fit_free_swing(body["time_s"][part], body["phi_rad"][part])
    assert swing.start_s == pytest.approx(25.0, abs=STEP_S)
    # The swing was made by steps of 5 ms, which shifts its frequency by 0.1 %.
    assert swing.values[0] == pytest.approx(K, rel=0.004)
    assert swing.values[1:] == pytest.approx([D_1, D_2], rel=0.1)
    assert swing.rms < 0.004


def test_a_swing_that_dies_early_in_a_long_record_is_found() -> None:
    t_s = np.arange(0.0, 30.0, 0.05)
    roll = 0.27 * np.exp(-0.4 * t_s) * np.cos(2.8 * t_s)
    swing = fit_free_swing(t_s, roll + 0.003 * np.random.default_rng(1).normal(size=t_s.size))
    assert swing.frequency[0] == pytest.approx(2.83, rel=0.02)
    assert swing.values[1] == pytest.approx(0.8, rel=0.1)


@pytest.mark.parametrize("held_s", [0.0, 0.5, 4.0])
def test_a_body_that_is_held_before_it_is_let_go_swings_from_then_on(held_s: float) -> None:
    t_s, rng = np.arange(0.0, 24.0, 0.05), np.random.default_rng(2)
    since = np.maximum(t_s - held_s, 0.0)
    decay, damped = 0.3, np.sqrt(4.5**2 - 0.3**2)
    swing = np.exp(-decay * since) * (
        np.cos(damped * since) + decay / damped * np.sin(damped * since)
    )
    fitted = fit_free_swing(t_s, 0.26 * swing + 0.002 * rng.normal(size=t_s.size))
    assert fitted.frequency[0] == pytest.approx(4.5, rel=0.005)
    assert fitted.values[1] == pytest.approx(2.0 * decay, rel=0.08)
    assert fitted.start_s == pytest.approx(held_s, abs=0.15)


def test_a_depth_that_swings_has_no_sine() -> None:
    t_s = np.arange(0.0, 40.0, 0.1)
    depth = 3.0 + 1.5 * np.exp(-0.1 * t_s) * np.cos(0.8 * t_s)
    swing = fit_free_swing(t_s, depth, is_depth=True)
    assert swing.values[0] == pytest.approx(0.8**2 + 0.1**2, rel=0.01)
    assert swing.values[1] == pytest.approx(0.2, rel=0.05)
    assert swing.amplitude == pytest.approx(1.5, rel=0.05)


def test_noise_and_a_drift_are_no_swing() -> None:
    t_s = np.arange(0.0, 40.0, 0.1)
    noise = 0.1 * np.random.default_rng(5).standard_normal(t_s.size)
    with pytest.raises(DataError):
        fit_free_swing(t_s, noise)
    with pytest.raises(DataError):
        fit_free_swing(t_s, 0.02 * t_s)


def test_tows_releases_and_swings_are_found_at_their_times() -> None:
    body = towed_body(6)
    pulled = towed(body["tow_force_n"], STEP_S)
    assert [first for first, _ in pulled] == [0, 660, 1320, 1980]
    free = released(body["tow_force_n"], STEP_S, 8.0)
    assert [first for first, _ in free] == [500, 1160, 1820, 2480]
    swings = onsets(body["phi_rad"], STEP_S)
    assert [first for first, _ in swings] == [500, 1160, 1820, 2480]


def test_speed_that_only_falls_is_fading_and_speed_that_grows_ends_it() -> None:
    t_s = np.arange(0.0, 20.0, STEP_S)
    speed = np.where(t_s < 5.0, 0.2 * t_s, np.exp(-(t_s - 5.0)))
    speed[t_s > 12.0] = 0.3
    ((first, last),) = fading(speed, STEP_S, least=0.1, longest_s=30.0)
    assert t_s[first] == pytest.approx(5.0, abs=STEP_S)
    assert t_s[last - 1] == pytest.approx(12.0, abs=STEP_S)


def test_a_motion_without_a_leap_has_no_swing() -> None:
    """A deflection that grows slowly to its largest, and one at rest."""
    grows = np.exp(np.arange(0.0, 60.0, STEP_S) / 20.0)
    assert onsets(grows, STEP_S) == []
