"""Smoothing splines: scipy's own, the exact trace, the filter they are, and the refusal
to extrapolate.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.signals import splines
from auvid.hydro.identification.signals.splines import (
    SmoothingSpline,
    cutoff_from_lambda,
    derivative,
    lambda_from_cutoff,
    smoothing_spline,
)
from auvid.hydro.long_series.compiled_bands import factor_sum


def noisy_sine(n: int, seed: int, noise: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0.0, 10.0, n))
    return t, np.sin(t) + noise * rng.standard_normal(n)


@pytest.mark.compiles("hydro/long_series/compiled_bands.py")
@pytest.mark.parametrize("n", [5, 6, 300])
def test_a_long_series_is_smoothed_as_a_short_one(n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled loops in threads give what LAPACK does, but for rounding.

    LAPACK's bits are those of the processor's kernel. Over four kernels the chosen lambda
    departed by 8e-7 of itself, and the spline with it.
    """
    t, y = noisy_sine(n, seed=n)
    both = np.column_stack([y, 2.0 * y + t])
    fits: list[list[SmoothingSpline]] = []
    for long in (n, 0):
        monkeypatch.setattr(splines, "LONG", long)
        fixed = smoothing_spline(t, both, lam=0.1)
        fits.append([fixed, smoothing_spline(t, both), smoothing_spline(t, both, shared=True)])
    for short, compiled, near in zip(*fits, (1e-9, 1e-5, 1e-5), strict=True):
        for order in (0, 1):
            expected = short.evaluate(t, order)
            np.testing.assert_allclose(compiled.evaluate(t, order), expected, rtol=0.0, atol=near)
        np.testing.assert_allclose(compiled.lambda_, short.lambda_, rtol=near)
        np.testing.assert_allclose(compiled.edf, short.edf, rtol=near)
    bands = np.zeros((3, 4), order="F")
    assert not factor_sum(bands, bands, 1.0, np.empty_like(bands))


def test_rounding_does_not_choose_the_smoothing() -> None:
    """A factor and a line leave the score as it is; 2e-3 when the search stopped early."""
    t, y = noisy_sine(300, seed=300)
    lambdas = smoothing_spline(t, np.column_stack([y, 2.0 * y + t, 0.3 * y - 5.0 * t])).lambda_
    np.testing.assert_allclose(lambdas, lambdas[0], rtol=1e-5)


def test_rounding_does_not_choose_the_smoothing_of_a_slow_signal() -> None:
    """Where the score is flat, rounding of log det moved log lambda by .3."""
    t = np.arange(3000) / 50.0
    y = np.sin(t / 20.0) + 0.1 * np.random.default_rng(0).standard_normal(t.size)
    lambdas = smoothing_spline(t, np.column_stack([y, 2.0 * y + t, 0.3 * y - 5.0 * t])).lambda_
    np.testing.assert_allclose(lambdas, lambdas[0], rtol=1e-3)


@pytest.mark.parametrize("lam", [1e-6, 1e-2, 1.0, 50.0])
@pytest.mark.parametrize("n", [5, 6, 40])
def test_equals_scipy_at_a_given_lambda(n: int, lam: float) -> None:
    t, y = noisy_sine(n, seed=n)
    ours, theirs = smoothing_spline(t, y, lam=lam), make_smoothing_spline(t, y, lam=lam)
    fine = np.linspace(t[0], t[-1], 200)
    for order in (0, 1, 2):
        expected = theirs(fine, order)
        np.testing.assert_allclose(
            ours.evaluate(fine, order), expected, atol=1e-8 * max(1.0, np.abs(expected).max())
        )


def test_equals_scipy_with_weights_and_several_columns() -> None:
    t, y = noisy_sine(30, seed=3)
    w = np.random.default_rng(4).uniform(0.5, 3.0, 30)
    both = np.column_stack([y, np.cos(t)])
    theirs = make_smoothing_spline(t, both, w=w, lam=0.3)
    np.testing.assert_allclose(
        smoothing_spline(t, both, lam=0.3, weights=w).evaluate(t), theirs(t), atol=1e-9
    )


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_chooses_scipys_gcv_parameter(seed: int) -> None:
    t, y = noisy_sine(60, seed)
    spline = smoothing_spline(t, y)
    # scipy searches lambda to 1e-5 absolute, we search log lambda to 1e-3; the minimum
    # is flat.
    np.testing.assert_allclose(spline.evaluate(t), make_smoothing_spline(t, y)(t), atol=1e-3 * 0.2)


def gcv_score(fitted: np.ndarray, y: np.ndarray, edf: float) -> float:
    return float(np.mean((y - fitted) ** 2) / (1.0 - edf / len(y)) ** 2)


def test_is_not_caught_in_a_local_minimum_of_the_gcv_score() -> None:
    t, y = noisy_sine(60, seed=3)
    best = smoothing_spline(t, y)
    local = smoothing_spline(t, y, lam=0.0853707)
    np.testing.assert_allclose(local.evaluate(t), make_smoothing_spline(t, y)(t), atol=1e-5)
    assert gcv_score(best.evaluate(t), y, float(best.edf)) < 0.97 * gcv_score(
        local.evaluate(t), y, float(local.edf)
    )


def test_a_signal_that_is_nearly_interpolated_has_its_least_score() -> None:
    """The trace is small there: an error of 2e-3 of it moved log lambda by 2."""
    rng = np.random.default_rng(2)
    t, y = np.arange(600.0), rng.standard_normal(600)
    for _ in range(3):
        y = np.cumsum(y)
    y = y + 0.36 * rng.standard_normal(600)
    best = smoothing_spline(t, y)
    at_best = gcv_score(best.evaluate(t), y, float(best.edf))
    for factor in (0.3, 3.0):
        other = smoothing_spline(t, y, lam=float(best.lambda_) * factor)
        assert gcv_score(other.evaluate(t), y, float(other.edf)) > at_best


@pytest.mark.parametrize("lam", [1e-4, 0.1, 30.0])
def test_degrees_of_freedom_are_the_trace_of_the_hat_matrix(lam: float) -> None:
    t, _ = noisy_sine(40, seed=7)
    hat = make_smoothing_spline(t, np.eye(40), lam=lam)(t)
    # 2e-8: truncation of the difference quotient of log det.
    assert smoothing_spline(t, np.sin(t), lam=lam).edf == pytest.approx(np.trace(hat), rel=1e-7)


def test_finds_noise_level_and_derivative_of_a_long_signal() -> None:
    t = np.arange(10_000) / 50.0
    y = np.sin(t) + 0.1 * np.random.default_rng(0).standard_normal(t.size)
    spline = smoothing_spline(t, y)
    assert spline.sigma == pytest.approx(0.1, rel=0.03)
    inner = slice(200, -200)
    assert np.std((spline.evaluate(t, 1) - np.cos(t))[inner]) < 0.05


def test_halves_the_amplitude_at_the_cutoff() -> None:
    t = np.arange(4000) / 50.0
    lam = lambda_from_cutoff(1.5, 1 / 50)
    assert cutoff_from_lambda(lam, 1 / 50) == pytest.approx(1.5, rel=1e-12)
    smooth = smoothing_spline(t, np.sin(2 * np.pi * 1.5 * t), lam=lam).evaluate(t)
    inner = slice(500, -500)
    # Sampling at 50 Hz moves the half-amplitude point by well under a percent.
    assert np.abs(smooth[inner]).max() == pytest.approx(0.5, rel=0.01)


def test_lambda_zero_interpolates_and_a_line_stays_a_line() -> None:
    t, y = noisy_sine(50, seed=2)
    np.testing.assert_allclose(smoothing_spline(t, y, lam=0.0).evaluate(t), y, atol=1e-12)
    line = smoothing_spline(t, 2.0 - 3.0 * t)
    np.testing.assert_allclose(line.evaluate(t), 2.0 - 3.0 * t, atol=1e-9)
    np.testing.assert_allclose(line.evaluate(t, 1), -3.0, atol=1e-8)


def test_one_lambda_for_all_columns_when_shared() -> None:
    t, y = noisy_sine(200, seed=8)
    spline = smoothing_spline(t, np.column_stack([y, 1000.0 * np.cos(t) + y]), shared=True)
    assert spline.lambda_[0] == spline.lambda_[1]
    shared = smoothing_spline(t, np.column_stack([y, 1000.0 * np.cos(t) + y]))
    assert shared.lambda_[0] != shared.lambda_[1]


def test_each_column_has_the_lambda_that_it_has_alone() -> None:
    t, first = noisy_sine(300, 1)
    both = np.column_stack([first, noisy_sine(300, 2, noise=0.05)[1]])
    together = smoothing_spline(t, both)
    for column, lam in zip(both.T, together.lambda_, strict=True):
        assert smoothing_spline(t, column).lambda_ == pytest.approx(lam, rel=1e-9)


def test_never_extrapolates() -> None:
    t, y = noisy_sine(20, seed=1)
    outside = smoothing_spline(t, y, lam=0.1).evaluate([t[0] - 1e-9, t[0], t[-1], t[-1] + 1e-9])
    assert np.isnan(outside[[0, 3]]).all()
    assert np.isfinite(outside[[1, 2]]).all()


@pytest.mark.parametrize(
    ("t", "y", "words"),
    [
        ([0, 1, 2, 3], [0, 0, 0, 0], "at least 5"),
        ([0, 1, 1, 2, 3], [0, 0, 0, 0, 0], "increase strictly"),
        ([0, 1, 2, 3, 4], [0, 0, np.nan, 0, 0], "not finite"),
        ([0, 1, 2, 3, 4], [0, 0, 0, 0], "differ in length"),
    ],
)
def test_refuses_what_is_no_signal(t: list[float], y: list[float], words: str) -> None:
    with pytest.raises(DataError, match=words):
        smoothing_spline(t, y)


def test_refuses_bad_lambda_and_weights() -> None:
    t, y = noisy_sine(10, seed=1)
    with pytest.raises(DataError, match="lambda"):
        smoothing_spline(t, y, lam=-1.0)
    with pytest.raises(DataError, match="weights"):
        smoothing_spline(t, y, weights=np.zeros(10))


def test_interpolating_derivative() -> None:
    t = np.arange(500) / 50.0
    y = np.column_stack([np.sin(t), t**3])
    np.testing.assert_allclose(derivative(t, y), np.column_stack([np.cos(t), 3 * t**2]), atol=1e-6)
    np.testing.assert_allclose(derivative(t, y[:, 1], order=2), 6 * t, atol=1e-8)
