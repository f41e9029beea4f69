"""Outlying dives: named, named rarely without reason, and with what was different."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ndtr
from scipy.stats import t

from auvid.hydro.identification.fleet.outlying import differences, outlying_dives

VALUES = [10.0, 10.3, 9.8, 10.1, 12.5, 9.9]
ERRORS = [0.1, 0.1, 0.2, 0.1, 0.1, 0.1]


def test_a_dive_is_named_with_what_was_different() -> None:
    conditions = {
        "battery_V": [16.0, 15.9, 15.8, 16.1, 13.1, 16.0],
        "firmware": ["4.1", "4.1", "4.1", "4.1", "4.1", "4.1"],
        "water_density_kg_m3": [1025.0] * 5 + [1000.0],
    }
    (dive,) = outlying_dives({"drag X": (VALUES, ERRORS), "drag Y": (ERRORS, ERRORS)}, conditions)
    assert (dive.dive, dive.figure, dive.value) == (4, "drag X", 12.5)
    assert dive.expected[1] < 12.5
    assert dive.deviation > 3.0
    assert [item.condition for item in dive.differences] == ["battery_V"]


def test_without_errors_of_fits_it_is_the_deleted_residual() -> None:
    values = np.array([1.0, 2.0, 1.5, 1.2, 1.7, 9.0])
    (dive,) = outlying_dives({"a": (values, np.full(6, 1e-5))})
    others = values[:5]
    deleted = (9.0 - others.mean()) / (np.std(others, ddof=1) * np.sqrt(1.2))
    # 2 %: a tail of a distribution on a grid.
    assert_allclose(dive.p, 2.0 * t.sf(deleted, 4), rtol=0.02)
    assert_allclose(2.0 * ndtr(-dive.deviation), dive.p, rtol=1e-9)


@pytest.mark.parametrize(
    ("fleets", "most"), [(60, 8), pytest.param(150, 15, marks=pytest.mark.release)]
)
def test_fleets_without_an_outlying_dive_rarely_have_one_named(fleets: int, most: int) -> None:
    random, named = np.random.default_rng(4), 0
    for _ in range(fleets):
        errors = np.exp(0.4 * random.standard_normal((2, 7)))
        values = random.standard_normal((2, 7)) * np.sqrt(errors**2 + 1.0)
        figures = {"a": (values[0], errors[0]), "b": (values[1], errors[1])}
        named += bool(outlying_dives(figures))
    # Expected 5 % at most; three standard deviations above.
    assert named <= most


def test_three_dives_are_not_looked_at() -> None:
    assert outlying_dives({"a": ([1.0, 1.0, 90.0, np.nan], [0.1] * 4)}) == ()


def test_conditions_differ_only_outside_what_others_have() -> None:
    rows = {
        "depth_m": [5.0, 6.0, 6.3],
        "tether": ["thin", None, "thick"],
        "operator": ["a", "b", "c"],
        "unknown": [1.0, 1.0, None],
    }
    assert [(item.condition, item.words) for item in differences(rows, 2)] == [
        ("operator", "c, the others a, b")
    ]
    assert [item.condition for item in differences({"depth_m": [5.0, 6.0, 6.6]}, 2)] == ["depth_m"]


def test_a_dive_is_held_against_those_of_its_level() -> None:
    values = np.array([10.0, 10.1, 13.0, 9.9, 10.0, 10.1, 19.9, 20.1, 20.0, 20.1, 30.0])
    levels = {"drag": np.array([0] * 6 + [1] * 4 + [2])}
    figures = {"drag": (values, np.full(11, 0.1))}
    assert outlying_dives(figures) == ()
    (dive,) = outlying_dives(figures, levels=levels)
    assert dive.dive == 2
    assert 9.0 < dive.expected[0] < 10.0 < dive.expected[1] < 11.0
