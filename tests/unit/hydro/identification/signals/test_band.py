"""The band of a motion is found in noise, over pauses, and is 0 where nothing tells it."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.identification.signals.band import motion_band_hz

T_S = np.arange(0.0, 120.0, 0.04)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("hz", [0.1, 0.7, 1.6])
def test_a_wave_is_found_in_white_noise(hz: float, noise: float) -> None:
    errors = noise * np.random.default_rng(4).normal(size=T_S.size)
    wave = 0.3 * np.sin(2.0 * np.pi * hz * T_S)
    assert motion_band_hz(T_S, wave + errors) == pytest.approx(hz, abs=0.15)


def test_slow_and_quick_motion_over_a_pause() -> None:
    both = np.sin(2.0 * np.pi * 0.1 * T_S) + 0.5 * np.sin(2.0 * np.pi * 1.2 * T_S)
    flown = (T_S < 50.0) | (T_S > 60.0)
    assert motion_band_hz(T_S[flown], both[flown]) == pytest.approx(1.2, abs=0.1)


def test_shaking_beyond_any_motion_is_left_out() -> None:
    shaken = np.sin(2.0 * np.pi * 0.3 * T_S) + 2.0 * np.sin(2.0 * np.pi * 9.0 * T_S)
    assert motion_band_hz(T_S, shaken) == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize("count", [0, 5, 200])
def test_a_short_or_resting_signal_has_no_band(count: int) -> None:
    assert motion_band_hz(T_S[:count], np.zeros(count)) == 0.0
    assert motion_band_hz(T_S, np.zeros(T_S.size)) == 0.0
