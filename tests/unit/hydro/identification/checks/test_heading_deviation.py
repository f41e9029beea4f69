"""Deviation of a heading by the gyro: of once a turn, and not what soft iron makes."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.identification.checks.attitude.rate_agreement import deviation


@pytest.mark.parametrize(("hard_deg", "soft_deg"), [(0.9, 1.5), (12.0, 1.5)])
def test_soft_iron_is_no_deviation_of_once_a_turn(hard_deg: float, soft_deg: float) -> None:
    t = np.arange(0.0, 240.0, 0.1)
    heading = 2.1 * np.sin(0.05 * t) + 0.3 * np.sin(0.4 * t)
    rate = 0.105 * np.cos(0.05 * t) + 0.12 * np.cos(0.4 * t)
    swing = hard_deg * np.sin(heading + 2.0) + soft_deg * np.sin(2.0 * heading + 0.7)
    angles = np.column_stack([0.0 * t, 0.0 * t, heading + np.radians(swing)])
    noise = 1e-3 * np.random.default_rng(1).standard_normal((t.size, 3))
    gyro = np.column_stack([0.0 * t, 0.0 * t, rate]) + noise
    measured = deviation(t, angles, t, gyro)
    assert measured is not None
    assert np.degrees(measured.angle) == pytest.approx(hard_deg, rel=0.15, abs=0.5)
