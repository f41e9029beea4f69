"""Change alarms: a change is dated and sized, fleets without one stay quiet."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.alarms import alarm_limit, change_alarms, change_odds
from auvid.hydro.identification.fleet.scatter import typical_error

VALUES = np.array([10.0, 10.3, 9.8, 10.1, 9.9, 12.1, 12.0, 12.3])
ERRORS = np.array([0.1, 0.2, 0.1, 0.1, 0.15, 0.1, 0.2, 0.1])


def likelihood(values: Array, errors: Array, tau: float, size: float, first: int) -> float:
    """Density of the contrasts with a change of a normal size from dive `first` on."""
    k = len(values)
    contrasts = null_space(np.ones((1, k))).T
    step = (np.arange(k) >= first).astype(float)
    covariance = np.diag(errors**2 + tau**2)
    wide = size**2 * (tau**2 + typical_error(errors) ** 2)
    covariance = contrasts @ (covariance + wide * np.outer(step, step)) @ contrasts.T
    return float(multivariate_normal.pdf(contrasts @ values, cov=covariance))


def test_odds_are_the_ratio_of_two_integrals() -> None:
    y, s = VALUES[:6], ERRORS[:6]

    def integral(size: float, first: int) -> float:
        def density(x: float) -> float:
            tau = float(np.exp(x))
            share = tau / (tau + float(typical_error(s)))
            return likelihood(y, s, tau, size, first) * share

        return float(quad(density, np.log(1e-4), np.log(1e3), limit=200)[0])

    expected = [np.log(integral(1.0, first) / integral(0.0, first)) for first in (3, 4, 5)]
    # .003: the sum over the grid in place of the integral.
    assert_allclose(change_odds(y, s), expected, atol=3e-3)


def test_a_change_is_dated_and_sized() -> None:
    figures = {"drag X": (VALUES, ERRORS), "drag Y": (VALUES[::-1] * 0 + 5.0, ERRORS)}
    (alarm,) = change_alarms(figures)
    assert (alarm.figure, alarm.first_dive) == ("drag X", 5)
    assert alarm.dive <= 7
    low, high = alarm.change_interval
    assert low < 2.1 < high
    assert 0.19 < alarm.share < 0.23
    assert alarm.log_odds > alarm.limit


def test_dives_without_a_number_do_not_count() -> None:
    values = np.insert(VALUES, 2, np.nan)
    (alarm,) = change_alarms({"drag X": (values, np.insert(ERRORS, 2, 0.1))})
    (before,) = change_alarms({"drag X": (VALUES, ERRORS)})
    assert (alarm.dive, alarm.first_dive) == (before.dive + 1, before.first_dive + 1)
    assert alarm.change == before.change


def test_figures_of_unlike_dives_are_watched_as_each_by_itself() -> None:
    """They share batches: of other lengths, with gaps, one with a change."""
    gaps = np.insert(-VALUES, 2, np.nan), np.insert(ERRORS, 2, 0.1)
    figures = {"a": (VALUES, ERRORS), "b": gaps, "c": (VALUES + 5.0, ERRORS)}
    together = change_alarms(figures, false_alarms=0.06)
    single = [change_alarms({name: pair}, false_alarms=0.02) for name, pair in figures.items()]
    assert len(together) == 3
    assert set(together) == {alarm for alarms in single for alarm in alarms}


def test_rises_have_their_part_of_the_false_alarms_and_falls_the_rest() -> None:
    """A change between the two limits is an alarm on the side that has the larger part."""
    values = np.array([10.0, 10.3, 9.8, 10.1, 9.9, 10.48, 10.58, 10.38, 10.53])
    errors = np.full(9, 0.1)
    for sign in (1.0, -1.0):
        figures = {"drag X": (sign * values, errors)}
        odds = max(change_odds(sign * values[:k], errors[:k]).max() for k in range(4, 10))
        assert alarm_limit(2 * 0.02 * 0.9) < odds < alarm_limit(0.02) < alarm_limit(2 * 0.02 * 0.1)
        assert change_alarms(figures, false_alarms=0.02) == ()
        alarms = change_alarms(figures, false_alarms=0.02, rises={"drag X": 0.9})
        assert [alarm.limit for alarm in alarms] == [alarm_limit(0.036)] * (sign > 0.0)


def test_a_second_change_is_counted_from_the_first() -> None:
    values = np.concatenate([VALUES, [12.2, 12.1, 9.9, 10.0, 10.2, 10.1]])
    errors = np.concatenate([ERRORS, np.full(6, 0.1)])
    up, down = change_alarms({"drag X": (values, errors)})
    assert (up.first_dive, down.first_dive) == (5, 10)
    assert up.change > 0.0 > down.change


def test_few_dives_have_no_alarm() -> None:
    assert change_alarms({"a": ([1.0, 9.0, 1.0], [0.1] * 3)}) == ()
    assert change_alarms({}) == ()


def test_limits_grow_with_the_number_of_figures() -> None:
    limits = [alarm_limit(0.05 / count) for count in (1, 2, 5, 50, 500)]
    assert np.all(np.diff(limits) > 0.0)
    assert limits[0] == 2.04


def test_limits_grow_with_the_number_of_dives() -> None:
    limits = [alarm_limit(0.05, dives) for dives in (4, 10, 20, 30, 100, 1000)]
    assert limits[0] == limits[1]
    assert np.all(np.diff(limits[1:]) > 0.5)


def test_long_fleets_without_a_change_stay_quiet() -> None:
    random = np.random.default_rng(11)
    values, errors = random.standard_normal((60, 30)), np.full((60, 30), 0.5)
    odds = [change_odds(values[:, :k], errors[:, :k]).max(axis=-1) for k in range(4, 31, 2)]
    # .05, and three standard errors of so many fleets; the limit of ten dives: a third.
    assert np.mean(np.max(odds, axis=0) > alarm_limit(0.05, 30)) < 0.135


@pytest.mark.parametrize(
    ("scatter", "fleets", "bound"),
    [
        (0.0, 500, 0.079),
        (0.9, 500, 0.079),
        *(pytest.param(scatter, 1500, 0.067, marks=pytest.mark.release)
          for scatter in (0.0, 0.5, 0.9)),
    ],
)  # fmt: skip
def test_false_alarms_are_as_rare_as_stated(scatter: float, fleets: int, bound: float) -> None:
    random = np.random.default_rng(8)
    errors = np.exp(0.4 * random.standard_normal((fleets, 10))) * np.sqrt(1.0 - scatter)
    noise = random.standard_normal((2, fleets, 10))
    values = np.sqrt(scatter) * noise[0] + errors * noise[1]
    odds = [change_odds(values[:, :k], errors[:, :k]).max(axis=-1) for k in range(4, 11)]
    # .05, and three standard errors of so many fleets.
    assert np.mean(np.max(odds, axis=0) > alarm_limit(0.05)) < bound


def test_a_fifth_more_is_found_within_five_dives() -> None:
    random = np.random.default_rng(9)
    errors = 0.035 * np.exp(0.4 * random.standard_normal((500, 10)))
    noise = random.standard_normal((2, 500, 10))
    values = 1.0 + 0.035 * noise[0] + errors * noise[1]
    values[:, 5:] *= 1.2
    odds = [change_odds(values[:, :k], errors[:, :k]).max(axis=-1) for k in range(4, 11)]
    assert np.mean(np.max(odds, axis=0) > alarm_limit(0.05)) > 0.9


def test_a_change_after_many_dives_is_dated() -> None:
    random = np.random.default_rng(12)
    values = 10.0 + 0.3 * random.standard_normal(200)
    values[150:] += 3.0
    (alarm,) = change_alarms({"drag X": (values, np.full(200, 0.1))})
    assert alarm.first_dive == 150
    assert alarm.dive <= 155
