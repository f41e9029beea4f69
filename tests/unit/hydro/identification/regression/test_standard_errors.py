"""Coloured standard errors: the cumulative-sum form against the definition, and
coverage on a known truth.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.regression.least_squares import (
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.standard_errors import (
    CoefficientScores,
    automatic_lags,
    hac_covariance,
    long_run_moment,
    mapped,
    stationary_covariance,
)


def direct_moment(s: np.ndarray, lags: int) -> np.ndarray:
    """Newey and West's sum, term by term."""
    total = s.T @ s
    for lag in range(1, lags + 1):
        gamma = s[lag:].T @ s[:-lag]
        total = total + (1.0 - lag / (lags + 1)) * (gamma + gamma.T)
    return total


@pytest.mark.parametrize("lags", [0, 1, 7, 199])
def test_equals_the_direct_sum(lags: int) -> None:
    s = np.random.default_rng(2).standard_normal((200, 3))
    expected = direct_moment(s, lags)
    np.testing.assert_allclose(
        long_run_moment(s, lags=lags), expected, atol=1e-11 * np.abs(expected).max()
    )


def test_covariance_is_the_sandwich_and_segments_add() -> None:
    rng = np.random.default_rng(3)
    s, bread = rng.standard_normal((300, 2)), np.array([[2.0, 0.3], [0.3, 1.0]])
    middle = direct_moment(s[:100], 5) + direct_moment(s[100:], 5)
    np.testing.assert_allclose(
        hac_covariance([s[:100], s[100:]], bread, lags=5),
        bread @ middle @ bread * 300 / 298,
        rtol=1e-11,
    )


def test_no_lags_is_the_heteroscedastic_form() -> None:
    s = np.random.default_rng(4).standard_normal((50, 2))
    np.testing.assert_allclose(hac_covariance(s, np.eye(2), lags=0), s.T @ s * 50 / 48, rtol=1e-12)


@pytest.mark.parametrize("lags", [0, 1, 6])
def test_stationary_covariance_is_that_of_a_tapered_toeplitz_matrix(lags: int) -> None:
    """bread J' R J bread n / (n - k), R_ij = r(|i - j|) (1 - |i - j| / (L + 1))."""
    rng = np.random.default_rng(9)
    jacobians = [rng.standard_normal((n, 2)) for n in (40, 25)]
    residuals = [lfilter([1.0], [1.0, -0.8], rng.standard_normal(len(j))) for j in jacobians]
    bread = np.linalg.inv(sum(j.T @ j for j in jacobians))
    middle = np.zeros((2, 2))
    for rows, error in zip(jacobians, residuals, strict=True):
        n = len(error)
        moments = [error[: n - lag] @ error[lag:] / n for lag in range(n)]
        taper = np.maximum(1.0 - np.arange(n) / (lags + 1), 0.0)
        middle += rows.T @ toeplitz(moments * taper) @ rows
    np.testing.assert_allclose(
        stationary_covariance(jacobians, residuals, bread, lags=lags),
        bread @ middle @ bread * 65 / 63,
        rtol=1e-11,
    )


def test_lags_follow_the_colour() -> None:
    white = np.random.default_rng(5).standard_normal((20_000, 1))
    coloured = lfilter([1.0], [1.0, -0.95], white, axis=0)
    assert automatic_lags(white) <= 5
    # Andrews: 1.1447 (4 rho^2 n / (1 - rho^2)^2)^(1/3) = 226 at rho = 0.95.
    assert automatic_lags(coloured) == pytest.approx(226, rel=0.1)
    assert automatic_lags(np.ones((100, 1))) == 0
    assert automatic_lags(white[:5]) == 0


def hac_standard_errors(
    fit: AxisFit, segments: Iterable[tuple[Array, Array]], *, lags: int | None = None
) -> Array:
    """Return the standard errors (k,) of a fit, from its segments one at a time."""
    scores = CoefficientScores.empty(fit, lags=lags)
    for rows, force in segments:
        scores = scores.update(rows, force)
    return np.sqrt(np.diag(scores.covariance()))


def test_coloured_errors_cover_the_truth_where_white_ones_do_not() -> None:
    rng = np.random.default_rng(6)
    n, truth, runs = 2000, np.array([2.0, -1.0, 0.5]), 60
    white_hits = coloured_hits = 0
    for _ in range(runs):
        rows = lfilter([1.0], [1.0, -0.95], rng.standard_normal((2, n)), axis=1)
        force = np.zeros((n, 6))
        force[:, 0] = (
            truth[:2] @ rows + truth[2] + lfilter([1.0], [1.0, -0.9], rng.standard_normal(n))
        )
        factor = TriangularFactor.empty(["u", "v"]).update(rows, force)
        fit = solve_axis(factor, "X", ["u", "v"], trim=True)
        coloured = hac_standard_errors(fit, [(rows, force[:, 0])])
        white_hits += int(np.sum(np.abs(fit.solution - truth) < 2 * fit.standard_errors))
        coloured_hits += int(np.sum(np.abs(fit.solution - truth) < 2 * coloured))
    # Two standard errors should cover 95 %; a Bartlett kernel on 2000 samples gives
    # some percent less.
    assert coloured_hits / (3 * runs) > 0.85
    assert white_hits / (3 * runs) < 0.6


def test_undetermined_terms_have_no_error_and_order_is_kept() -> None:
    rng = np.random.default_rng(7)
    u = rng.uniform(1.0, 2.0, 400)
    rows = np.vstack([u, u, rng.standard_normal(400)])
    force = np.zeros((400, 6))
    force[:, 0] = -7.7 * u + 3.0 * rows[2] + rng.standard_normal(400)
    fit = solve_axis(
        TriangularFactor.empty(["u", "|u|", "v"]).update(rows, force), "X", ["v", "|u|", "u"]
    )
    errors = hac_standard_errors(
        fit,
        [(rows[[2, 1, 0], :200], force[:200, 0]), (rows[[2, 1, 0], 200:], force[200:, 0])],
        lags=0,
    )
    assert np.isnan(errors[2])
    np.testing.assert_allclose(errors[:2], fit.standard_errors[:2], rtol=0.2)


def test_refusals() -> None:
    with pytest.raises(DataError, match="negative"):
        long_run_moment(np.zeros((3, 1)), lags=-1)
    with pytest.raises(DataError, match="fewer samples"):
        hac_covariance(np.zeros((2, 2)), np.eye(2), lags=0)
    rows, force = np.random.default_rng(8).standard_normal((2, 30)), np.ones((30, 6))
    fit = solve_axis(TriangularFactor.empty(["u", "v"]).update(rows, force), "X", ["u", "v"])
    with pytest.raises(DataError, match="do not agree"):
        hac_standard_errors(fit, [(rows[:1], force[:, 0])])


@pytest.mark.parametrize("lags", [0, 7, 40])
def test_hac_covariance_is_that_of_statsmodels(lags: int) -> None:
    import statsmodels.api as sm  # here, since it takes seconds

    rng = np.random.default_rng(6)
    rows = np.cumsum(rng.normal(size=(500, 3)), axis=0) * [0.1, 1.0, 0.01]
    error = np.convolve(rng.normal(size=540), np.exp(-np.arange(41) / 9.0), "valid")
    fit = sm.OLS(rows @ [1.0, -2.0, 30.0] + error, rows).fit()
    oracle = fit.get_robustcov_results("HAC", maxlags=lags, use_correction=True)
    own = hac_covariance(rows * fit.resid[:, None], np.linalg.inv(rows.T @ rows), lags=lags)
    np.testing.assert_allclose(own, oracle.cov_params(), rtol=1e-7)


def test_a_mapped_covariance_has_no_variance_below_zero() -> None:
    """Mass and damping that only their ratio tells: plain products round below 0."""
    random = np.random.default_rng(3)
    below = 0
    for _ in range(200):
        mass, damping = random.uniform(10.0, 1e3, 2)
        along = np.array([mass, damping])
        covariance = 1e8 * np.outer(along, along)
        by = np.array([[-damping / mass**2, 1.0 / mass]])
        below += float((by @ covariance @ by.T)[0, 0]) < 0.0
        assert mapped(covariance, by)[0, 0] >= 0.0
    assert below > 10
    full = np.array([[2.0, 0.3], [0.3, 1.0]])
    by = random.normal(size=(3, 2))
    assert mapped(full, by) == pytest.approx(by @ full @ by.T)
