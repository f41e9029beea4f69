"""Bands widened to what other legs did hold as often as they say."""

import numpy as np
import pytest

from auvid.hydro.identification.selection.conformal import LEAST_LEGS, conformal_scale


def test_a_further_leg_is_within_at_least_as_often_as_asked():
    random = np.random.default_rng(3)
    scores = random.gamma(2.0, size=(4000, LEAST_LEGS))
    inside = np.array([row[0] <= conformal_scale(row[1:], 0.9) for row in scores])
    # The largest of nine others: 9 in 10, whatever the distribution.
    assert inside.mean() == pytest.approx(0.9, abs=0.015)


def test_each_quantity_has_its_own_scale_and_few_legs_give_none():
    scores = np.column_stack([np.arange(1.0, 20.0), np.full(19, 2.0)])
    assert conformal_scale(scores, 0.9).tolist() == [18.0, 2.0]
    assert np.isinf(conformal_scale(scores[:8], 0.9)).all()
