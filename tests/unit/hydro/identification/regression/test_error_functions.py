"""Error functions against statsmodels, exact programmes and outliers."""

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.identification.regression.error_functions import (
    HUBER_THRESHOLD,
    deviation_weights,
    huber,
    least_median,
    least_moduli,
    least_squares,
    median_of_moduli,
    minimise_error,
    nelder_mead,
    sum_of_moduli,
    sum_of_squares,
    total_error,
)

TERMS = ("v", "v*|v|", "u*r")
TRUTH = np.array([-40.0, -180.0, 12.0])


def data(n=400, *, noise=1.0, outliers=0.0, seed=0):
    random = np.random.default_rng(seed)
    nu = random.normal(size=(n, 6)) * [1.0, 0.4, 0.3, 0.1, 0.1, 0.3]
    rows = basis_rows(nu.T, None, TERMS)
    force = TRUTH @ rows + noise * random.standard_t(3, size=n)
    bad = random.random(n) < outliers
    return nu, rows, np.where(bad, force + 200.0, force)


def test_huber_is_that_of_statsmodels():
    import statsmodels.api as sm  # here, since it takes seconds

    _, rows, force = data(outliers=0.1)
    fit = huber(rows, force)
    model = sm.RLM(force, rows.T, M=sm.robust.norms.HuberT(t=HUBER_THRESHOLD))
    oracle = model.fit(tol=1e-12, maxiter=500, conv="coefs")
    np.testing.assert_allclose(fit.coefficients, oracle.params, rtol=1e-7)
    assert fit.scale == pytest.approx(oracle.scale, rel=1e-7)
    assert fit.weights.min() < 0.1
    assert fit.weights.max() == 1.0


def test_least_moduli_is_the_median_regression_and_its_optimum_is_proven():
    _, rows, force = data()
    fit = least_moduli(rows, force)
    error = force - fit @ rows
    # Duality: a vector z with |z| <= 1, A'z = 0 and z'b = sum |e| proves the minimum.
    zero = np.abs(error) < 1e-8 * np.abs(force).max()
    assert zero.sum() == len(TERMS)
    z = np.sign(error)
    z[zero] = np.linalg.solve(rows[:, zero], -rows[:, ~zero] @ z[~zero])
    assert np.abs(z).max() <= 1.0 + 1e-9
    assert z @ force == pytest.approx(sum_of_moduli(error), rel=1e-9)
    # And far fewer than all points move it: an outlier's size does not matter.
    far = force.copy()
    worst = int(np.argmax(error))
    far[worst] += 1e4
    np.testing.assert_allclose(least_moduli(rows, far), fit, rtol=1e-7)


def test_weights_are_repeated_samples():
    _, rows, force = data(60)
    weights = np.where(np.arange(60) % 2 == 0, 3.0, 1.0)
    many, again = (
        np.repeat(rows, weights.astype(int), axis=1),
        np.repeat(force, weights.astype(int)),
    )
    np.testing.assert_allclose(
        least_squares(rows, force, weights=weights), least_squares(many, again), rtol=1e-9
    )
    np.testing.assert_allclose(
        least_moduli(rows, force, weights=weights), least_moduli(many, again), rtol=1e-7
    )


def test_the_least_median_bears_forty_percent_of_outliers():
    _, rows, force = data(500, noise=0.5, outliers=0.4)
    fit = least_median(rows, force)
    np.testing.assert_allclose(fit, TRUTH, rtol=0.15)
    assert median_of_moduli(force - fit @ rows) < median_of_moduli(
        force - least_squares(rows, force) @ rows
    )
    assert np.abs(least_squares(rows, force) / TRUTH - 1.0).max() > 0.3


def test_nelder_mead_finds_the_minimum_of_any_function():
    _, rows, force = data()
    squares = least_squares(rows, force)
    np.testing.assert_allclose(
        nelder_mead(rows, force, sum_of_squares, start=squares + 5.0), squares, rtol=1e-5
    )
    moduli = nelder_mead(rows, force, sum_of_moduli, start=squares)
    assert sum_of_moduli(force - moduli @ rows) == pytest.approx(
        sum_of_moduli(force - least_moduli(rows, force) @ rows), rel=1e-4
    )


def test_least_moduli_is_the_quantile_regression_of_scikit_learn():
    from sklearn.linear_model import QuantileRegressor  # here, since it takes seconds

    _, rows, force = data(200)
    oracle = QuantileRegressor(quantile=0.5, alpha=0.0, fit_intercept=False, solver="highs-ipm")
    np.testing.assert_allclose(
        least_moduli(rows, force), oracle.fit(rows.T, force).coef_, rtol=1e-7
    )


def test_a_function_by_name_counts_errors_in_their_own_deviations():
    _, rows, force = data(100)
    weights = np.linspace(0.2, 2.0, 100)
    root = np.sqrt(weights)
    for name, own in (("squares", least_squares), ("absolute", least_moduli)):
        minimum = minimise_error(rows, force, name, weights=weights)
        np.testing.assert_allclose(minimum, own(rows * root, force * root), rtol=1e-9)
        simplex = minimise_error(rows, force, name, weights=weights, minimiser="nelder_mead")
        np.testing.assert_allclose(simplex, minimum, rtol=1e-2)
    minimum = minimise_error(rows, force, "huber", weights=weights)
    np.testing.assert_array_equal(minimum, huber(rows * root, force * root).coefficients)
    with pytest.raises(DataError, match="scale of Huber"):
        minimise_error(rows, force, "huber", minimiser="nelder_mead")


def test_errors_of_axes_are_weighted():
    errors = np.array([[1.0, 2.0, 0, 0, 0, 0], [1.0, -2.0, 0, 0, 0, 0]])
    weights = [1.0, 0.5, 1, 1, 1, 1]
    assert total_error(errors, sum_of_squares, axis_weights=weights) == 6.0
    assert total_error(errors, sum_of_moduli, axis_weights=weights) == 4.0


def test_deviations_of_the_state_weigh_a_sample():
    nu = np.zeros((2, 6))
    nu[1, 0] = 2.0
    sd = np.zeros((2, 6))
    sd[:, 5] = 0.1
    # u*r with K = 12 N s2/(m rad): 12 * 2 m/s * .1 rad/s = 2.4 N beside 1 N of noise.
    weights = deviation_weights(("u*r",), [12.0], nu, sd, noise=1.0)
    np.testing.assert_allclose(weights, [1.0, 1.0 / (1.0 + 2.4**2)])


def test_faults_are_named():
    _, rows, force = data(50)
    for method in (least_squares, least_moduli, huber, least_median):
        with pytest.raises(DataError, match="fewer samples"):
            method(rows[:, :2], force[:2])
        with pytest.raises(DataError, match="depend"):
            method(np.vstack([rows, rows[:1]]), force)
        with pytest.raises(DataError, match="disagree"):
            method(rows, force[:-1])
    with pytest.raises(DataError, match="weights"):
        least_moduli(rows, force, weights=-np.ones(50))
