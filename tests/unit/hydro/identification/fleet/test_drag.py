"""Drag at one speed from linear and quadratic terms."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from auvid.hydro.identification.fleet.drag import common_speed, drag_at_speed

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
        assert drag.terms_trade == trades


def test_one_term_or_none() -> None:
    drag = drag_at_speed(("r*|r|",), [-4.0], np.eye(1), axis="N", speed=0.5)
    assert drag is not None
    assert drag.force == 1.0
    assert np.isnan(drag.trade)
    assert not drag.terms_trade
    assert drag_at_speed(("u",), [-4.0], np.eye(1), axis="N", speed=0.5) is None
    assert drag_at_speed(("r",), [np.nan], np.eye(1), axis="N", speed=0.5) is None


def test_common_speed_is_that_of_the_middle_dive() -> None:
    assert common_speed([{"v": 0.2}, {"v": 0.9}, {"v": 0.3}], "Y") == 0.3
