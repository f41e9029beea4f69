"""Trends over the time of dives: the line's interval, and silence where nothing is clear."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import linregress, t

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.fleet import trend as module
from auvid.hydro.identification.fleet.trend import Trend, clear_trends, trend

TIMES = np.array([0.0, 3.0, 5.0, 11.0, 20.0, 24.0, 30.0])


def test_without_errors_of_fits_and_correlation_it_is_the_least_squares_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "CORRELATIONS", (0.0,))
    monkeypatch.setattr(module, "GRID", 160)
    values = 10.0 + 0.2 * TIMES + np.random.default_rng(0).standard_normal(7)
    result, line = trend(TIMES, values, np.full(7, 1e-5)), linregress(TIMES, values)
    assert result is not None
    half = t.ppf(0.975, 5) * line.stderr
    # 1 %: the step of the grid of tau, against the width.
    assert_allclose(result.slope, line.slope, rtol=1e-6)
    assert_allclose(result.interval, (line.slope - half, line.slope + half), atol=0.01 * half)
    assert_allclose(result.middle, values.mean(), rtol=1e-6)
    assert_allclose(result.p, line.pvalue, atol=1e-3)


@pytest.mark.parametrize(
    ("fleets", "bound"), [(40, 0.154), pytest.param(1000, 0.071, marks=pytest.mark.release)]
)
def test_dives_that_drift_slowly_rarely_have_a_trend(fleets: int, bound: float) -> None:
    random = np.random.default_rng(1)
    times = np.arange(12.0)
    distance = np.abs(np.subtract.outer(times, times))
    for rho in (0.0, 0.5):
        slow = np.linalg.cholesky(np.power(rho, distance) if rho else np.eye(12))
        errors = 0.4 * np.exp(0.4 * random.standard_normal((fleets, 12)))
        values = random.standard_normal((fleets, 12)) @ slow.T
        values += errors * random.standard_normal((fleets, 12))
        small = [
            (line := trend(times, *pair)) is not None and line.p < 0.05
            for pair in zip(values, errors, strict=True)
        ]
        # .05, and three standard errors of so many fleets.
        assert np.mean(small) < bound


def test_of_many_figures_without_a_trend_few_fleets_have_one() -> None:
    random = np.random.default_rng(2)
    clear = [
        bool(
            clear_trends({place: Trend(9, 1.0, (0.0, 2.0), 1.0, p) for place, p in enumerate(row)})
        )
        for row in random.uniform(size=(400, 40))
    ]
    # .05, and three standard errors of so many fleets; 1 in 2 at .02 each.
    assert np.mean(clear) < 0.083


def test_a_clear_trend_is_seen_and_many_dives_are_averaged() -> None:
    random = np.random.default_rng(3)
    for dives in (12, 400):
        times = np.sort(random.uniform(0.0, 100.0, dives))
        values = 10.0 + 0.05 * times + 0.5 * random.standard_normal(dives)
        result = trend(times, values, np.full(dives, 0.1))
        assert result is not None
        assert (result.dives, result.p < 0.05) == (dives, True)
        assert result.interval[0] < 0.05 < result.interval[1]


def test_dives_without_a_number_do_not_count() -> None:
    values = 1.0 + 0.1 * TIMES
    errors = np.full(7, 0.01)
    one, other = trend(TIMES, values, errors), trend(
        np.append(TIMES, [2.0, np.nan]), np.append(values, [np.nan, 1.0]), np.append(errors, [1, 1])
    )  # fmt: skip
    assert one == other


def test_four_dives_say_nothing() -> None:
    assert trend(TIMES[:4], TIMES[:4], np.ones(4)) is None
    with pytest.raises(DataError, match="one time"):
        trend(np.zeros(7), TIMES, np.ones(7))


def test_of_many_dives_those_that_are_hardly_known_hide_no_trend() -> None:
    random, times = np.random.default_rng(1), np.arange(400.0)
    errors = np.where(np.arange(400) % 7 == 0, 50.0, 0.1)
    drift = trend(times, times / 400.0 + errors * random.standard_normal(400), errors)
    assert drift is not None
    assert drift.p < 1e-6
    assert drift.slope == pytest.approx(1.0 / 400.0, rel=0.1)
