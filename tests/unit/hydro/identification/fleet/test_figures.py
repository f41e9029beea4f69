"""Figures of a dive from its records."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from auvid.data_schemas.records.models import AxisCard, CovarianceCard, TermCard
from auvid.data_schemas.records.motion import InstallationFigure, InstallationRecord
from auvid.hydro.identification.fleet.figures import (
    covariance_of,
    drag_of_axis,
    figures_of_installation,
)


def axis(values: dict[str, float | None], lower: list[list[float]]) -> AxisCard:
    terms = [
        TermCard(term=term, unit="N", value=value, standard_error=0.3, verdict="identified")
        for term, value in values.items()
    ]
    numbers = [term for term, value in values.items() if value is not None]
    return AxisCard(
        unit="N", samples=9, rank=2, j0=1.0, j=0.5, excitation="excited", terms=terms,
        covariance=CovarianceCard(terms=numbers, lower=lower), combinations=[],
    )  # fmt: skip


def test_drag_at_a_speed_has_the_errors_of_both_terms() -> None:
    x = axis({"u": -4.0, "u*|u|": -18.0, "r": 2.0}, [[1.0], [-0.5, 4.0], [0.1, 0.2, 1.0]])
    drag = drag_of_axis(x, "X", 0.5)
    assert drag is not None
    # 4 .5 + 18 .25; .25 1 - 2 (.5) (.25) .5 + .0625 4.
    assert_allclose((drag.force, drag.standard_error**2), (6.5, 0.25 - 0.125 + 0.25))
    assert_allclose(covariance_of(x), covariance_of(x).T)
    assert np.linalg.eigvalsh(covariance_of(x)).min() > 0.0


def test_departures_that_the_legs_show() -> None:
    def figure(name: str, error: float | None, verdict: str) -> InstallationFigure:
        return InstallationFigure.model_construct(
            name=name, unit="m", departure=0.1, standard_error=error, verdict=verdict
        )

    record = InstallationRecord.model_construct(
        figures=[
            figure("arm x", 0.01, "departs"),
            figure("arm y", 0.9, "not observable"),
            figure("arm z", None, "not observable"),
        ]
    )
    assert figures_of_installation(record) == {"arm x [m]": (0.1, 0.01)}
