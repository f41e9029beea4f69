"""Drag at one speed from linear and quadratic terms."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from auvid.hydro.identification.fleet.alarms import change_alarms
from auvid.hydro.identification.fleet.drag import (
    common_drag,
    drag_at_speed,
    expected_scatters,
)
from auvid.hydro.identification.fleet.scatter import between_dives

TERMS = ("v", "r", "v*|v|", "constant")


def test_drag_has_the_scatter_of_its_terms() -> None:
    root = np.random.default_rng(0).standard_normal((4, 4))
    mean, covariance = np.array([-10.0, 3.0, -50.0, 1.0]), root @ root.T
    drag = drag_at_speed(TERMS, mean, covariance, axis="Y", speed=0.4)
    assert drag is not None
    draws = np.random.default_rng(1).multivariate_normal(mean, covariance, 200_000)
    forces = -(0.4 * draws[:, 0] + 0.16 * draws[:, 2])
    # Half a percent: the scatter of 200 000 draws.
    assert_allclose(drag.force, 12.0)
    assert_allclose(drag.standard_error, forces.std(), rtol=0.005)
    assert_allclose(drag.trade, np.corrcoef(draws[:, 0], draws[:, 2])[0, 1], atol=0.01)


def test_terms_trade_where_a_dive_has_one_speed() -> None:
    random = np.random.default_rng(2)
    for spread, trades in ((0.03, True), (0.5, False)):
        v = 0.4 + spread * random.standard_normal(400)
        rows = np.stack([v, v * np.abs(v)], axis=1)
        covariance = np.linalg.inv(rows.T @ rows)
        drag = drag_at_speed(("v", "v*|v|"), [-10, -50], covariance, axis="Y", speed=0.4)
        assert drag is not None
        assert (abs(drag.trade) > 0.95) == trades


def test_one_term_or_none() -> None:
    drag = drag_at_speed(("r*|r|",), [-4.0], np.eye(1), axis="N", speed=0.5)
    assert drag is not None
    assert drag.force == 1.0
    assert np.isnan(drag.trade)
    assert drag_at_speed(("u",), [-4.0], np.eye(1), axis="N", speed=0.5) is None
    assert drag_at_speed(("r",), [np.nan], np.eye(1), axis="N", speed=0.5) is None


def test_drag_of_all_axes_is_the_mean_of_shares_by_their_scatter() -> None:
    surge = np.array([10.0, 11.0, 9.0, 10.0]), np.full(4, 0.5)
    yaw = np.array([2.0, 1.6, np.nan, 2.4]), np.full(4, 0.1)
    drag = common_drag([surge, yaw, (np.array([1.0, -5.0, 4.0, 1.0]), np.full(4, 0.1))])
    assert drag is not None
    parts = []
    for y, s in ((surge[0], 0.5), (yaw[0][[0, 1, 3]], 0.1)):
        variance = float(between_dives(y, np.full(len(y), s)).tau_reml) ** 2 + s**2
        parts.append((y.mean(), y.mean() ** 2 / variance))
    (m, w), (n, v) = parts
    values = [(w * y / m + v * z / n) / (w + v) for y, z in zip(surge[0], yaw[0], strict=True)]
    values[2] = surge[0][2] / m
    assert_allclose(drag[0], values)
    assert_allclose(drag[1][0], np.hypot(w * 0.5 / m, v * 0.1 / n) / (w + v))
    assert_allclose(drag[1][2], 0.5 / m)
    assert common_drag([surge]) is None


def test_drag_of_all_axes_shows_a_change_that_no_axis_does() -> None:
    random = np.random.default_rng(4)
    change = np.where(np.arange(10) < 5, 1.0, 1.2)
    drags = {
        axis: (mean * change * (1.0 + 0.08 * random.standard_normal(10)), np.full(10, 0.03 * mean))
        for axis, mean in (("X", 9.0), ("Y", 14.0), ("N", 1.5), ("M", 2.0))
    }
    drag = common_drag(list(drags.values()))
    assert drag is not None
    assert change_alarms(drags) == ()
    (alarm,) = change_alarms({"all": drag, **drags}, shares={"all": 0.3})
    assert (alarm.figure, alarm.first_dive) == ("all", 5)
    assert 0.12 < alarm.share < 0.28


def test_an_axis_is_expected_to_scatter_like_the_median_of_the_others() -> None:
    steady = np.array([9.0, 11.0] * 5)
    stepped = np.array([9.0, 11.0] * 3 + [np.nan] + [19.0, 21.0] * 3)
    loud = 3.0 * (steady - 10.0) + 10.0
    first, second, third = expected_scatters([steady, stepped, loud])
    # Differences of 2, and one of 8; over the mean.
    of_stepped = np.sqrt((10 * 4.0 + 64.0) / 11 / 2) / 15.0
    assert_allclose(first, 10.0 * (of_stepped + np.sqrt(18.0) / 10.0) / 2.0)
    assert_allclose(second, 15.0 * (np.sqrt(2.0) + np.sqrt(18.0)) / 10.0 / 2.0)
    assert_allclose(third, 10.0 * (np.sqrt(2.0) / 10.0 + of_stepped) / 2.0)
    assert np.isnan(expected_scatters([steady, loud])).all(), "one other axis tells nothing"
    assert np.isnan(expected_scatters([np.full(3, np.nan), steady, loud])[0])
