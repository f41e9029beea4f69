"""Outputs at 2 Hz, rebuilt from what made them."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.dynamics.actuators.slow_outputs import rebuild_outputs

CLOCK = np.arange(0.0, 120.0, 0.05)


def causes(t: np.ndarray) -> np.ndarray:
    """A stick that is kicked, and a rate."""
    stick = np.sign(np.sin(2.9 * t)) * (np.sin(0.31 * t) > 0.0)
    return np.column_stack([stick, 0.3 * np.sin(2.1 * t)])


def output(t: np.ndarray, mode: np.ndarray) -> np.ndarray:
    x = causes(t)
    mixed = 1500.0 + np.where(mode == 0, 150.0, 60.0) * x[:, 0] - 80.0 * x[:, 1]
    return np.column_stack([mixed, 1500.0 + 40.0 * np.sin(0.2 * t)])


def rebuilt(*, remainders: bool = False):
    slow = np.arange(0.0, 120.0, 0.5)
    modes = [(t > 60.0).astype(np.intp) for t in (slow, CLOCK)]
    result = rebuild_outputs(
        slow,
        output(slow, modes[0]),
        causes(slow),
        modes[0],
        clock_s=CLOCK,
        clock_causes=causes(CLOCK),
        clock_mode=modes[1],
        remainders=remainders,
    )
    return result, output(CLOCK, modes[1])


def test_what_sticks_make_is_rebuilt_mode_by_mode():
    result, true = rebuilt()
    assert result.used.tolist() == [True, False]
    assert result.rebuilt[0] > 0.99 > 0.8 > result.interpolated[0]
    assert np.abs(result.values[:, 0] - true[:, 0]).max() < 0.1  # the ridge alone


def test_what_they_do_not_make_is_interpolated():
    result, true = rebuilt()
    assert result.values[:-10, 1] == pytest.approx(true[:-10, 1], abs=0.3)


def test_what_remains_at_the_samples_is_added_between_them():
    result, true = rebuilt(remainders=True)
    assert result.used[0]
    assert result.rebuilt[1] > rebuilt()[0].rebuilt[1] + 0.5
    assert np.abs(result.values[:-10] - true[:-10]).max() < 0.5
