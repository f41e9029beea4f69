"""Windows of an axis, and force that moves nothing."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from auvid.hydro.arrays import runs_of
from auvid.hydro.identification.selection.axis_windows import (
    driven,
    force_without_motion,
    windows_of_axis,
)

T = np.arange(0.0, 100.0, 0.05)


def test_windows_and_stretches_share_the_leg_between_them():
    surface, idle = T < 12.0, (T >= 8.0) & (T < 30.0)
    windows, left_out = windows_of_axis("N", T, [("surface", surface), ("idle", idle)])
    assert [(item.reason, round(item.end_s - item.start_s)) for item in left_out] == [
        ("surface", 12),
        ("idle", 18),
    ]
    assert windows[0][0] == np.flatnonzero(T >= 30.0)[0]
    assert windows[-1][1] == T.size
    assert all(first[1] == second[0] for first, second in itertools.pairwise(windows))
    lengths = [0.05 * (last - first) for first, last in windows]
    assert lengths == pytest.approx([10.0] * 7, abs=0.1)


def test_short_stretches_are_left_out_and_said():
    mask = ((T >= 20.0) & (T < 50.0)) | (T >= 53.0)
    windows, left_out = windows_of_axis("Z", T, [("idle", mask)])
    assert len(windows) == 2
    assert [item.reason for item in left_out] == ["idle", "shorter than 5 s beside: idle", "idle"]


def test_coasting_belongs_to_the_force_before_it():
    force = np.where((T > 40.0) & (T < 50.0), 5.0, 0.0)
    (span,) = runs_of(driven(force, 0.05, 0.1))
    assert T[span[0]] == pytest.approx(39.0, abs=0.1)
    assert T[span[1] - 1] == pytest.approx(54.0, abs=0.1)


def moving(force: np.ndarray) -> np.ndarray:
    """Velocity of 25 kg with a drag of 90 N s^2/m^2."""
    speed = np.zeros(force.size)
    for at in range(force.size - 1):
        drag = 90.0 * speed[at] * abs(speed[at])
        speed[at + 1] = speed[at] + 0.05 * (force[at] - drag) / 25.0
    return speed


def test_a_snag_is_found_where_it_is():
    force = 20.0 * np.sign(np.sin(2.0 * np.pi * T / 24.0))
    speed = moving(force)
    usable = np.ones(T.size, dtype=bool)
    assert not force_without_motion(T, force, speed, usable).any()
    snagged = (T >= 62.0) & (T < 71.0)
    stuck = force_without_motion(T, force, np.where(snagged, 0.0, speed), usable)
    (span,) = runs_of(stuck)
    assert T[span[0]] == pytest.approx(62.0, abs=1.5)
    assert T[span[1] - 1] == pytest.approx(71.0, abs=1.5)


def test_a_hold_that_ends_at_the_surface_is_a_hold():
    """It begins two seconds before the body is at the surface, too short to be judged alone."""
    force = 20.0 * np.sign(np.sin(2.0 * np.pi * T / 24.0))
    speed = np.where((T >= 62.0) & (T < 71.0), 0.0, moving(force))
    usable = (T < 65.0) | (T > 80.0)
    stuck = force_without_motion(T, force, speed, usable)
    (span,) = runs_of(stuck)
    assert T[span[0]] == pytest.approx(62.0, abs=1.5)
    nothing = force_without_motion(T, force, speed, usable & (T < 60.0))
    assert not nothing.any()


def test_a_constant_force_that_buoyancy_takes_is_no_snag():
    """The vehicle holds its depth against 15 N, and moves from there."""
    force = 15.0 + np.where((T % 30.0) < 10.0, 10.0, 0.0)
    speed = moving(force - 15.0)
    assert not force_without_motion(T, force, speed, np.ones(T.size, dtype=bool)).any()
