"""Error measures (4.22)-(4.27) against their definitions."""

from __future__ import annotations

from functools import reduce

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES
from auvid.hydro.identification.regression.error_measures import (
    TOTAL,
    ErrorSums,
    MiddleErrors,
    error_table,
)


@pytest.fixture
def forces() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    measured = rng.standard_normal((101, 6)) * [10, 5, 5, 1, 2, 3]
    return measured, measured + rng.standard_normal((101, 6))


def test_definitions(forces: tuple[np.ndarray, np.ndarray]) -> None:
    measured, predicted = forces
    sigma = (predicted - measured).T.reshape(-1)
    total = error_table(measured, predicted)[TOTAL]
    assert total.sse == pytest.approx(sum(value**2 for value in sigma))
    assert total.mae == pytest.approx(sum(abs(value) for value in sigma) / (6 * 101))
    assert total.mse == pytest.approx(total.sse / (6 * 101))
    assert total.rms == pytest.approx(total.mse**0.5)
    assert total.mad == pytest.approx(sum(sorted(abs(row))[50] for row in (predicted - measured).T))
    assert total.j0 == pytest.approx(np.sqrt(np.mean(measured**2)))
    assert total.normalised == pytest.approx(total.rms / total.j0)
    assert total.n == 101


def test_axes_add_up_to_the_total(forces: tuple[np.ndarray, np.ndarray]) -> None:
    axes = error_table(*forces)
    total = axes.pop(TOTAL)
    assert list(axes) == list("XYZKMN")
    assert sum(axis.sse for axis in axes.values()) == pytest.approx(total.sse)
    assert np.mean([axis.mse for axis in axes.values()]) == pytest.approx(total.mse)
    assert sum(axis.mad for axis in axes.values()) == pytest.approx(total.mad)
    assert axes["K"].j0 == pytest.approx(np.sqrt(np.mean(forces[0][:, 3] ** 2)))


def test_perfect_and_absent_models(forces: tuple[np.ndarray, np.ndarray]) -> None:
    measured, _ = forces
    assert error_table(measured, measured)[TOTAL].normalised == 0.0
    assert error_table(measured, np.zeros_like(measured))[TOTAL].normalised == pytest.approx(1.0)
    assert np.isnan(error_table(np.zeros((3, 6)), np.ones((3, 6)))[TOTAL].normalised)


@pytest.mark.parametrize("sizes", [(1,), (2, 1), (40, 61), (900, 13, 2500, 700)])
def test_segments_accumulate_to_the_whole(sizes: tuple[int, ...]) -> None:
    """Segments of unlike length and unlike size of error; ties among the errors too."""
    rng = np.random.default_rng(2)
    parts = [
        (rng.normal(size=(n, 6)), scale * np.round(rng.normal(size=(n, 6)), digits))
        for n, scale, digits in zip(sizes, (1.0, 30.0, 0.1, 2.0), (9, 1, 0, 2), strict=False)
    ]
    segments = [(force, force + error) for force, error in parts]
    sums = reduce(ErrorSums.merge, (ErrorSums.of(*segment) for segment in segments))
    middle = MiddleErrors.between(*sums.bracket())
    for segment in segments:
        middle = middle.add(*segment)
    table = sums.measures(middle.medians(sums.n))
    force, model = (np.concatenate(series) for series in zip(*segments, strict=True))
    medians = np.median(np.abs(model - force), axis=0)
    assert [table[axis].mad for axis in AXES] == pytest.approx(list(medians), rel=1e-12)
    assert table[TOTAL].mad == pytest.approx(medians.sum(), rel=1e-12)
    assert table[TOTAL].mae == pytest.approx(np.mean(np.abs(model - force)), rel=1e-12)
    assert table["Y"].rms == pytest.approx(np.sqrt(np.mean((model - force)[:, 1] ** 2)), rel=1e-12)
    assert table["N"].j0 == pytest.approx(np.sqrt(np.mean(force[:, 5] ** 2)), rel=1e-12)
    # what is kept of 4113 samples: a few entries of each segment
    assert all(sum(map(len, kept)) < 0.1 * sum(sizes) + 40 for kept in middle.inside)


def test_refusals(forces: tuple[np.ndarray, np.ndarray]) -> None:
    measured, predicted = forces
    with pytest.raises(DataError, match=r"\(n, 6\)"):
        error_table(measured, predicted[:, :5])
    with pytest.raises(DataError, match="no sample"):
        error_table(measured[:0], predicted[:0])
    with pytest.raises(DataError, match="not finite"):
        error_table(measured, np.full_like(measured, np.nan))
