"""Trends over the time of dives: the line's interval, and silence where nothing is clear."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import linregress, t

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.fleet.trend import slopes, trend

TIMES = np.array([0.0, 3.0, 5.0, 11.0, 20.0, 24.0, 30.0])


def test_without_errors_of_fits_it_is_the_least_squares_line() -> None:
    values = 10.0 + 0.2 * TIMES + np.random.default_rng(0).standard_normal(7)
    result, line = trend(TIMES, values, np.full(7, 1e-5)), linregress(TIMES, values)
    assert result is not None
    half = t.ppf(0.975, 5) * line.stderr
    # 1 %: the step of the grid of tau, against the width.
    assert_allclose(result.slope, line.slope, rtol=1e-6)
    assert_allclose(result.interval, (line.slope - half, line.slope + half), atol=0.01 * half)
    assert_allclose(result.middle, values.mean(), rtol=1e-6)
    assert result.clear


@pytest.mark.parametrize(
    ("fleets", "bound"),
    [(600, 0.037), pytest.param(3000, 0.028, marks=pytest.mark.release)],
)
def test_fleets_without_a_trend_rarely_have_one(fleets: int, bound: float) -> None:
    random = np.random.default_rng(1)
    errors = np.exp(0.4 * random.standard_normal((fleets, 7)))
    for tau in (0.0, 1.0, 5.0):
        noise = random.standard_normal((2, fleets, 7))
        line = slopes(TIMES, tau * noise[0] + errors * noise[1], errors)
        clear = (line.mean_quantile(0.01) > 0.0) | (line.mean_quantile(0.99) < 0.0)
        # .02, and three standard errors of so many fleets.
        assert clear.mean() < bound


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
