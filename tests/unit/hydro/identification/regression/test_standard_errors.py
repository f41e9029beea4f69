"""Coloured standard errors: the cumulative-sum form against the definition, and
coverage on a known truth.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import butter, lfilter, sosfiltfilt
from scipy.stats import norm
from scipy.stats import t as student

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.regression.least_squares import (
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.standard_errors import (
    LeftOutBlocks,
    automatic_lags,
    block_count,
    hac_covariance,
    long_run_moment,
    mapped,
    stationary_covariance,
    updated_together,
)
from auvid.hydro.identification.regression.verdicts import T_LIMIT


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


def coloured_errors(fit: AxisFit, segments: Iterable[tuple[Array, Array]]) -> Array:
    """Return the standard errors (k,) of a fit, from its segments one at a time."""
    blocks = LeftOutBlocks.empty(fit)
    for rows, force in segments:
        blocks = blocks.update(rows, force)
    return np.sqrt(np.diag(blocks.covariance()))


def test_a_left_out_block_changes_coefficients_as_a_fit_without_it_does() -> None:
    """Against numpy's least squares on the samples that remain, two segments, a constant."""
    rng = np.random.default_rng(11)
    segments = []
    for n in (240, 150):
        rows = lfilter([1.0], [1.0, -0.8], rng.standard_normal((2, n)), axis=1) * [[1.0], [0.01]]
        segments.append((rows, [3.0, -40.0] @ rows + 0.7 + rng.standard_normal(n)))
    factor = TriangularFactor.empty(["u", "v"])
    for rows, force in segments:
        factor = factor.update(rows, np.column_stack([force, np.zeros((len(force), 5))]))
    fit = solve_axis(factor, "X", ["u", "v"], trim=True)
    design = np.vstack([np.vstack([rows, np.ones(rows.shape[1])]).T for rows, _ in segments])
    target = np.concatenate([force for _, force in segments])
    edges = [0]
    for rows, force in segments:
        count = block_count(force - fit.solution @ np.vstack([rows, np.ones(len(force))]))
        edges += list(edges[-1] + np.linspace(0, len(force), count + 1).astype(int)[1:])
    changes = []
    for start, stop in pairwise(edges):
        left = np.r_[0:start, stop : len(target)]
        changes.append(np.linalg.lstsq(design[left], target[left])[0] - fit.solution)
    g = len(changes)
    expected = (g - 1) / g * np.array(changes).T @ np.array(changes)
    expected *= (student.ppf(0.975, g - 1) / norm.ppf(0.975)) ** 2
    blocks = LeftOutBlocks.empty(fit)
    for rows, force in segments:
        blocks = blocks.update(rows, force)
    assert blocks.count == g == 24
    np.testing.assert_allclose(
        blocks.covariance(), expected, rtol=1e-7
    )  # NORMAL_95 has seven digits

    # Of another axis with a longer memory beside it: each has its own blocks.
    other = replace(fit, solution=0.0 * fit.solution)
    both = [LeftOutBlocks.empty(each) for each in (fit, other)]
    single = LeftOutBlocks.empty(other)
    for rows, force in segments:
        slow = np.cumsum(force - force.mean())
        both = updated_together(both, rows, np.column_stack([force, slow]))
        single = single.update(rows, slow)
    assert single.count < g
    for one, expect in zip(both, (blocks, single), strict=True):
        assert one.count == expect.count
        np.testing.assert_array_equal(one.squares, expect.squares)


def test_blocks_are_as_long_as_the_residual_remembers() -> None:
    white = np.random.default_rng(12).standard_normal(6000)
    assert block_count(white) == 12
    assert block_count(lfilter([1.0], [1.0, -0.99], white)) in range(6, 13)  # half after 69
    assert block_count(np.cumsum(white)) == 3
    for pole in (0.9, 0.99, 0.997):  # half after 7, 69 and 230 samples
        coloured = lfilter([1.0], [1.0, -pole], white) - 3.0
        centred = coloured - coloured.mean()
        moments = np.correlate(centred, centred, "full")[len(centred) - 1 :]
        memory = int(np.argmax(moments < 0.5 * moments[0]))
        assert block_count(coloured) == np.clip(6000 // (8 * memory), 3, 12)
    assert block_count(white[:2]) == 3


@pytest.mark.parametrize(("elsewhere", "least"), [(0.0, 0.9), (1e-7, 0.9), (0.02, 0.75)])
def test_one_manoeuvre_that_carries_a_coefficient_widens_its_interval(
    elsewhere: float, least: float
) -> None:
    """Sway of 1 m/s in 200 of 4000 samples, under an error of .5 N that remembers 50.

    With a hundredth of the information elsewhere, the other blocks know of the one that
    counts by its residual alone, and the interval is short: .80.
    """
    z = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        n = 4000
        u, v = rng.standard_normal(n), elsewhere * rng.standard_normal(n)
        v[1000:1200] += 1.0
        rows = np.vstack([u, v])
        force = 2.0 * u + 0.5 * wander(rng, n, 50.0, 1)[:, 0]
        factor = TriangularFactor.empty(["u", "v"]).update(
            rows, np.column_stack([force, np.zeros((n, 5))])
        )
        fit = solve_axis(factor, "X", ["u", "v"])
        z.append(np.abs(fit.solution - [2.0, 0.0]) / coloured_errors(fit, [(rows, force)]))
    surge, sway = np.mean(np.array(z) < NORMAL_95, axis=0)
    assert surge >= 0.9
    assert sway >= least


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
        coloured = coloured_errors(fit, [(rows, force[:, 0])])
        white_hits += int(np.sum(np.abs(fit.solution - truth) < 2 * fit.standard_errors))
        coloured_hits += int(np.sum(np.abs(fit.solution - truth) < 2 * coloured))
    # Two standard errors should cover 95 %; the kernel's covariance gave 88 % here.
    assert coloured_hits / (3 * runs) > 0.92
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
    errors = coloured_errors(
        fit, [(rows[[2, 1, 0], :200], force[:200, 0]), (rows[[2, 1, 0], 200:], force[200:, 0])]
    )
    assert np.isnan(errors[2])
    # 24 blocks know a standard error to some 15 %.
    np.testing.assert_allclose(errors[:2], fit.standard_errors[:2], rtol=0.3)


def test_refusals() -> None:
    with pytest.raises(DataError, match="negative"):
        long_run_moment(np.zeros((3, 1)), lags=-1)
    with pytest.raises(DataError, match="fewer samples"):
        hac_covariance(np.zeros((2, 2)), np.eye(2), lags=0)
    rows, force = np.random.default_rng(8).standard_normal((2, 30)), np.ones((30, 6))
    fit = solve_axis(TriangularFactor.empty(["u", "v"]).update(rows, force), "X", ["u", "v"])
    with pytest.raises(DataError, match="do not agree"):
        coloured_errors(fit, [(rows[:1], force[:, 0])])


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


def wander(rng: np.random.Generator, n: int, memory: float, count: int) -> Array:
    """Return stationary first-order noise (n, count) of variance 1 that remembers samples."""
    kept, start = np.exp(-1.0 / memory), int(10 * memory)
    white = rng.standard_normal((n + start, count))
    return np.asarray(lfilter([np.sqrt(1 - kept**2)], [1, -kept], white, axis=0)[start:])


def test_intervals_of_a_leg_of_a_minute_and_a_half_hold_and_zeros_are_not_identified() -> None:
    """90 s at 20 Hz, velocities that remember 3 s, a force error that remembers 1 s.

    The kernel with automatic lags holds .81 here and identifies 3 % of the zeros.
    """
    terms, truth, n = ["u", "u*|u|", "v", "w", "p", "q", "r"], np.zeros(8), 1800
    truth[:2] = -20.0, -30.0
    lowpass = butter(2, 0.1, output="sos")  # 1 Hz
    inside, zeros = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        nu = 0.15 * sosfiltfilt(lowpass, wander(rng, n, 60.0, 6), axis=0)
        rows = np.vstack([nu[:, 0], nu[:, 0] * np.abs(nu[:, 0]), nu[:, 1:].T])
        force = truth[:7] @ rows + sosfiltfilt(lowpass, wander(rng, n, 20.0, 1)[:, 0])
        factor = TriangularFactor.empty(terms).update(
            rows, np.column_stack([force, np.zeros((n, 5))])
        )
        fit = solve_axis(factor, "X", terms, trim=True)
        z = np.abs(fit.solution - truth) / coloured_errors(fit, [(rows, force)])
        inside.append(z < NORMAL_95)
        zeros.append(z[2:7] >= T_LIMIT)
    assert 0.92 < np.mean(inside) < 0.99
    assert np.mean(zeros) <= 0.01
