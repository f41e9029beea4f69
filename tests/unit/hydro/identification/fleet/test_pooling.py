"""Pooling over dives against statsmodels, SciPy and fleets of known scatter."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import null_space
from scipy.optimize import minimize_scalar
from scipy.stats import multivariate_normal, t
from statsmodels.stats.meta_analysis import combine_effects

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.pooling import outside_share, pool
from auvid.hydro.identification.fleet.scatter import between_dives, typical_error

VALUES = np.array([10.0, 11.2, 9.1, 10.5, 9.4, 12.0])
ERRORS = np.array([0.3, 0.4, 0.5, 0.3, 0.2, 0.6])


def fleets(count: int, dives: int, tau: float, seed: int) -> tuple[Array, Array, Array, Array]:
    """Values and errors (count, dives) of fleets about 0, and those of one dive more."""
    random = np.random.default_rng(seed)
    errors = np.exp(0.4 * random.standard_normal((count, dives + 1)))
    values = tau * random.standard_normal(errors.shape) + errors * random.standard_normal(
        errors.shape
    )
    return values[:, :-1], errors[:, :-1], values[:, -1], errors[:, -1]


def test_q_i2_and_mean_are_those_of_statsmodels() -> None:
    pooled, oracle = pool(VALUES, ERRORS), combine_effects(VALUES, ERRORS**2, method_re="dl")
    assert_allclose(pooled.q, oracle.q, rtol=1e-12)
    assert_allclose(pooled.q_p, oracle.test_homogeneity().pvalue, rtol=1e-9)
    # The mean is statsmodels' where its weights take the same tau.
    weights = 1.0 / (ERRORS**2 + pooled.tau**2)
    at_tau = combine_effects(VALUES, ERRORS**2 + pooled.tau**2)
    assert_allclose(pooled.mean, at_tau.mean_effect_fe, rtol=1e-12)
    assert_allclose(1.0 / np.sqrt(weights.sum()), at_tau.sd_eff_w_fe, rtol=1e-12)


def test_tau_is_where_the_contrasts_are_most_likely() -> None:
    contrasts = null_space(np.ones((1, len(VALUES)))).T

    def misfit(tau: float) -> float:
        covariance = contrasts @ np.diag(ERRORS**2 + tau**2) @ contrasts.T
        return -float(multivariate_normal.logpdf(contrasts @ VALUES, cov=covariance))

    best = minimize_scalar(misfit, bounds=(1e-3, 10.0), method="bounded", options={"xatol": 1e-8})
    # The grid has steps of 10 %; the parabola leaves a thousandth.
    assert_allclose(pool(VALUES, ERRORS).tau, best.x, rtol=2e-3)
    scatter = between_dives(VALUES, ERRORS)
    at = [30, 90, 100]
    assert_allclose(
        np.diff(scatter.log_likelihood[at]), -np.diff([misfit(x) for x in scatter.tau[at]])
    )


def test_without_errors_of_fits_a_further_dive_has_students_distribution() -> None:
    sure = pool(VALUES, np.full(6, 1e-5))
    half = t.ppf(0.975, 5) * np.std(VALUES, ddof=1) * np.sqrt(1.0 + 1.0 / 6.0)
    assert sure.next_dive is not None
    # 2e-3: the step of the grid.
    assert_allclose(sure.next_dive, (VALUES.mean() - half, VALUES.mean() + half), rtol=2e-3)
    assert sure.mean_interval is not None
    assert_allclose(np.ptp(sure.mean_interval) * np.sqrt(7.0), np.ptp(sure.next_dive), rtol=2e-3)


def test_scale_and_origin_do_not_matter() -> None:
    pooled, moved = pool(VALUES, ERRORS), pool(-1e4 * VALUES + 7e4, 1e4 * ERRORS)
    assert_allclose(moved.tau, 1e4 * pooled.tau)
    assert pooled.next_dive is not None
    assert moved.next_dive is not None
    assert_allclose(moved.next_dive[::-1], 7e4 - 1e4 * np.array(pooled.next_dive), rtol=1e-9)


@pytest.mark.parametrize("dives", [3, 4, 5, 10])
@pytest.mark.parametrize("tau", [0.0, 1.0, 3.0])
def test_the_interval_of_the_next_dive_holds(dives: int, tau: float) -> None:
    """Also without scatter, where weights of scatter alone hold in up to 99 %."""
    values, errors, further, _ = fleets(2000, dives, tau, seed=dives)
    scatter = between_dives(values, errors)
    outside = outside_share(scatter, errors, 0.05)
    share = scatter.next_dive_share(further, np.sqrt(np.mean(errors**2, axis=-1)))
    coverage = np.mean((share > 0.5 * outside) & (share < 1.0 - 0.5 * outside))
    # Three standard errors of 2000 fleets are .015; few dives are on the safe side.
    assert coverage > 0.93
    assert coverage < (0.97 if dives >= 5 else 1.0)


def test_the_next_dive_is_taken_to_be_as_sure_as_these() -> None:
    pooled = pool(VALUES, ERRORS)
    assert pooled.next_error == pytest.approx(np.sqrt(np.mean(ERRORS**2)))
    assert pooled == pool(VALUES, ERRORS, next_error=pooled.next_error)
    true = pool(VALUES, ERRORS, next_error=0.0)
    assert pooled.next_dive is not None
    assert true.next_dive is not None
    scatter = between_dives(VALUES, ERRORS)
    assert_allclose(true.next_dive, [scatter.next_dive_quantile(p) for p in (0.025, 0.975)])
    assert np.ptp(pooled.next_dive) > np.ptp(true.next_dive)


def test_a_dive_without_a_number_is_left_out() -> None:
    pooled = pool([*VALUES, np.nan, 3.0], [*ERRORS, 1.0, np.nan])
    assert pooled == pool(VALUES, ERRORS)
    assert pooled.dives == 6


def test_two_dives_are_refused_in_words() -> None:
    pooled = pool(VALUES[:2], ERRORS[:2])
    assert pooled.next_dive is None
    assert "2 dives" in pooled.refusal
    with pytest.raises(DataError, match="too few dives"):
        pool([1.0, np.nan], [1.0, 1.0])
    with pytest.raises(DataError, match="not positive"):
        pool([1.0, 2.0, 3.0], [1.0, 0.0, 1.0])


def test_typical_error_is_between_the_errors() -> None:
    assert ERRORS.min() < typical_error(ERRORS) < ERRORS.max()


def test_the_next_dive_after_a_change_is_of_the_new_level() -> None:
    """Levels that differ by 5: seven degrees of freedom about both."""
    values = np.concatenate([VALUES, VALUES[:3] + 5.0])
    levels = [0] * 6 + [1] * 3
    pooled = pool(values, np.full(9, 1e-5), levels=levels)
    mean = values[6:].mean()
    away = values - np.where(levels, mean, values[:6].mean())
    half = t.ppf(0.975, 7) * np.sqrt(away @ away / 7.0 * (1.0 + 1.0 / 3.0))
    assert (pooled.dives, pooled.earlier) == (3, 6)
    assert pooled.next_dive is not None
    assert_allclose(pooled.next_dive, (mean - half, mean + half), rtol=2e-3)
    assert_allclose(
        pool(values, np.full(9, 0.3), levels=levels).q_p,
        pool(values - np.repeat([0.0, 5.0], [6, 3]), np.full(9, 0.3), levels=levels).q_p,
    )


def test_dives_of_several_levels_are_too_few_in_words() -> None:
    pooled = pool([10.0, 11.0, 20.0, 21.0, 30.0], np.ones(5), levels=[0, 0, 1, 1, 2])
    assert pooled.next_dive is not None
    pooled = pool([10.0, 11.0, 20.0, 30.0], np.ones(4), levels=[0, 0, 1, 2])
    assert pooled.refusal == (
        "4 dives: no interval; the scatter between dives needs 3 and 2 more, one for each change"
    )


@pytest.mark.parametrize("share", [1e-6, 0.025, 0.5, 0.975])
def test_a_quantile_is_where_so_many_dives_lie_below(share: float) -> None:
    for errors in ([1.0, 1e-3, 1.0, 5.0], np.full(4, 1e-6), np.full(4, 100.0)):
        scatter = between_dives([10.0, 11.0, 30.0, 10.5], errors)
        at = scatter.next_dive_quantile(share)
        assert scatter.next_dive_share(at) == pytest.approx(share, rel=1e-6)
