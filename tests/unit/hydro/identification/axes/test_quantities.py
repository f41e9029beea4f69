"""Figures without newtons: those that the data leave open by a factor of ten are none."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.identification.axes.quantities import normalised_quantities

VALUES = np.array([-0.5, -1.0, 2.0, 0.0])


@pytest.mark.parametrize(("error", "open_"), [(0.05, False), (2.0, True)])
def test_a_time_constant_that_is_open_is_none(error: float, open_: bool) -> None:
    """1 / 0.5 s; with a deviation of 2 1/s its interval would span many decades."""
    covariance = np.diag([error**2, 0.01, 0.01, 0.01])
    rows = normalised_quantities("N", VALUES, covariance, width=1.96, speed=0.3)
    by_name = {row.name: row for row in rows}
    rest = by_name["time constant from rest"]
    assert np.isnan([rest.value, rest.low, rest.high]).all() == open_
    assert by_name["N_r/M"].value == -0.5
    if not open_:
        assert rest.value == pytest.approx(2.0)
        assert rest.low == pytest.approx(2.0 * np.exp(-1.96 * error / 0.5), rel=1e-6)
