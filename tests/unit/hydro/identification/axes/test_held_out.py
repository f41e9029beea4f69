"""Which of two fits flies better what was held out."""

from __future__ import annotations

import numpy as np

from auvid.hydro.identification.axes.held_out import HeldOut, legs_flown_better

STRAIGHT = (60.0, 55.0, 70.0, 62.0, 58.0, 64.0)
"""Fits [%] of six legs, each left out, with commands along a straight line."""


def legs(percents: tuple[float, ...]) -> list[HeldOut]:
    return [HeldOut(f"leg {i}", {"w": value}, 4) for i, value in enumerate(percents)]


def flown(*percents: float) -> bool:
    return legs_flown_better(legs(STRAIGHT), legs(percents))


def test_one_leg_of_many_that_is_a_hair_worse_forbids_no_dead_band() -> None:
    """With a true dead band errors are .8 times as large, but not on every leg."""
    assert flown(68.0, 64.0, 69.5, 70.0, 66.0, 71.0)


def test_what_flies_legs_no_better_is_no_dead_band() -> None:
    assert not flown(60.5, 55.5, 70.5, 62.5, 58.5, 64.5)
    assert not flown(*STRAIGHT)


def test_a_leg_that_is_flown_much_worse_forbids_a_dead_band() -> None:
    """The mean of the others does not outweigh it."""
    assert not flown(80.0, 80.0, 55.0, 80.0, 80.0, 80.0)


def test_a_leg_without_motion_is_not_judged_and_a_lost_one_is() -> None:
    still = (*STRAIGHT[:5], np.nan)
    better = (68.0, 64.0, 75.0, 70.0, 66.0, np.nan)
    assert legs_flown_better(legs(still), legs(better))
    assert not flown(*better)
    assert not flown(68.0, 64.0, 75.0, 70.0, 66.0, -np.inf)
