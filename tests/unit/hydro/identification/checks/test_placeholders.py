"""Numbers that stand for none, and numbers of sound sensors."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.identification.checks.placeholders import placeholder

T = np.arange(1000) / 10.0
DEPTH = 5.0 + np.sin(0.3 * T) + 0.004 * np.random.default_rng(0).standard_normal(T.size)


@pytest.mark.parametrize("number", [0.0, 9999.0, -1.0])
def test_a_number_that_is_written_for_none_is_found(number: float) -> None:
    values = DEPTH.copy()
    values[5::60] = number
    spotted = placeholder(T, values, 0.05)
    assert spotted is not None
    assert spotted[0] == number
    assert np.flatnonzero(spotted[1]).tolist() == list(range(5, 1000, 60))


def test_zero_is_found_in_a_speed_that_is_near_zero_itself() -> None:
    speed = 0.05 * np.random.default_rng(1).standard_normal(T.size)
    speed[3::20] = 0.0
    spotted = placeholder(T, speed, 0.02)
    assert spotted is not None
    assert spotted[0] == 0.0


@pytest.mark.parametrize(
    "values",
    [
        DEPTH,
        np.round(DEPTH, 1),
        np.where(np.abs(DEPTH - 5.0) < 0.1, 0.0, DEPTH - 5.0),
        np.clip(DEPTH, 4.2, 5.8),
        np.where(T % 20.0 < 6.0, 0.0, DEPTH),
        0.0192 + 0.0002 * np.round(np.random.default_rng(2).standard_normal(T.size)),
        0.2 * np.round((DEPTH[:100].repeat(10) + 0.02 * np.sin(7.0 * T)) / 0.2),
    ],
    ids=["noise", "rounded", "zero near zero", "clipped", "long rests", "still", "coarse"],
)
def test_a_sound_column_has_no_such_number(values: np.ndarray) -> None:  # type: ignore[type-arg]
    assert placeholder(T, values, 0.05) is None


def heading_about_north() -> np.ndarray:  # type: ignore[type-arg]
    """Return a heading in whole hundredths of a radian that turns from 0 to 6.28 and back."""
    turned = np.round(0.003 + 0.005 * np.random.default_rng(3).standard_normal(T.size), 2)
    return np.where(turned < 0.0, turned + 6.28, turned)


def test_a_heading_about_north_has_no_such_number() -> None:
    assert placeholder(T, heading_about_north(), 0.02) is not None
    assert placeholder(T, heading_about_north(), 0.02, angle=True) is None
    spotted = placeholder(
        T, np.where(T * 10 % 20 == 3, 1.5, heading_about_north()), 0.02, angle=True
    )
    assert spotted is not None
    assert spotted[0] == 1.5
