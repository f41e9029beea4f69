"""Where a sign changes under way, of made targets."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.identification.checks.sign_change import SignTarget, sign_change

TURNED, SAME = np.array([-1.0, 1.0]), np.array([1.0, 1.0])


@pytest.mark.parametrize(("until_s", "after"), [(30.0, True), (70.0, False), (None, True)])
def test_a_sign_that_changes_is_placed_and_a_constant_is_no_sign(
    until_s: float | None, after: bool
) -> None:
    rng, at = np.random.default_rng(3), np.arange(0.0, 100.0)
    parts = rng.normal(0.5, 1.0, (at.size, 2))
    values = parts.sum(axis=1) + rng.normal(0.0, 0.1, at.size) + 3.0 * (at > 50.0)
    if until_s is not None:
        parts[(at >= until_s) == after, 0] *= -1.0
    change = sign_change([SignTarget(at, values, parts)], [[TURNED], [-SAME]])
    assert change is not None
    if until_s is None:
        assert change.odds < 10.0
        return
    assert (change.choice, change.after) == (0, after)
    assert change.at_s == pytest.approx(until_s, abs=2.0)
    assert change.odds > 60.0
    assert change.explained[0] > 0.9
    assert change.shorter_s == pytest.approx(30.0, abs=2.0)
