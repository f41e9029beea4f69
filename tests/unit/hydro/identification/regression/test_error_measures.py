"""Error measures (4.22)-(4.27) against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.regression.error_measures import (
    ErrorAccumulator,
    axis_errors,
    error_table,
    total_errors,
)


@pytest.fixture
def forces() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    measured = rng.standard_normal((101, 6)) * [10, 5, 5, 1, 2, 3]
    return measured, measured + rng.standard_normal((101, 6))


def test_definitions(forces: tuple[np.ndarray, np.ndarray]) -> None:
    measured, predicted = forces
    sigma = (predicted - measured).T.reshape(-1)
    total = total_errors(measured, predicted)
    assert total.sse == pytest.approx(sum(value**2 for value in sigma))
    assert total.mae == pytest.approx(sum(abs(value) for value in sigma) / (6 * 101))
    assert total.mse == pytest.approx(total.sse / (6 * 101))
    assert total.rms == pytest.approx(total.mse**0.5)
    assert total.mad == pytest.approx(sum(sorted(abs(row))[50] for row in (predicted - measured).T))
    assert total.j0 == pytest.approx(np.sqrt(np.mean(measured**2)))
    assert total.normalised == pytest.approx(total.rms / total.j0)
    assert total.n == 101


def test_axes_add_up_to_the_total(forces: tuple[np.ndarray, np.ndarray]) -> None:
    axes, total = axis_errors(*forces), total_errors(*forces)
    assert list(axes) == list("XYZKMN")
    assert sum(axis.sse for axis in axes.values()) == pytest.approx(total.sse)
    assert np.mean([axis.mse for axis in axes.values()]) == pytest.approx(total.mse)
    assert sum(axis.mad for axis in axes.values()) == pytest.approx(total.mad)
    assert axes["K"].j0 == pytest.approx(np.sqrt(np.mean(forces[0][:, 3] ** 2)))


def test_perfect_and_absent_models(forces: tuple[np.ndarray, np.ndarray]) -> None:
    measured, _ = forces
    assert total_errors(measured, measured).normalised == 0.0
    assert total_errors(measured, np.zeros_like(measured)).normalised == pytest.approx(1.0)
    assert np.isnan(total_errors(np.zeros((3, 6)), np.ones((3, 6))).normalised)


def test_segments_accumulate_to_the_whole(forces: tuple[np.ndarray, np.ndarray]) -> None:
    measured, predicted = forces
    first = ErrorAccumulator().add(measured[:40], predicted[:40])
    both = first.merge(ErrorAccumulator().add(measured[40:], predicted[40:])).table()
    for name, whole in error_table(measured, predicted).items():
        assert vars(both[name]) == pytest.approx(vars(whole), rel=1e-12)


def test_refusals(forces: tuple[np.ndarray, np.ndarray]) -> None:
    measured, predicted = forces
    with pytest.raises(DataError, match=r"\(n, 6\)"):
        total_errors(measured, predicted[:, :5])
    with pytest.raises(DataError, match="no sample"):
        total_errors(measured[:0], predicted[:0])
    with pytest.raises(DataError, match="not finite"):
        total_errors(measured, np.full_like(measured, np.nan))
    with pytest.raises(DataError, match="no segment"):
        ErrorAccumulator().table()
