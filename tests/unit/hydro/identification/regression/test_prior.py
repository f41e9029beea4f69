"""Priors appended to the triangular factor: the textbook posterior, the limits of much
and little data, and what stays of the data.
"""

import numpy as np
import pytest

from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.regression.prior import posterior

TERMS = ("u*v", "v*|v|")
MEANS = {"u*v": -40.0, "v*|v|": -180.0}


def data(n, *, noise, collinear=False, seed=2):
    random = np.random.default_rng(seed)
    rows = random.normal(size=(2, n))
    if collinear:
        rows[1] = 2.0 * rows[0]
    force = np.zeros((n, 6))
    force[:, 1] = np.array([-30.0, -150.0]) @ rows + noise * random.normal(size=n)
    return rows, force


def fitted(rows, force):
    factor = TriangularFactor.empty(TERMS).update(rows, force)
    fit = solve_axis(factor, "Y", TERMS)
    return factor, fit, fit.covariance


def test_the_posterior_is_that_of_the_normal_model():
    rows, force = data(40, noise=20.0)
    factor, fit, white = fitted(rows, force)
    values, covariance = posterior(factor, fit, white, MEANS, relative_sd=0.25)
    mean = np.array([MEANS[term] for term in TERMS])
    precision = np.diag(1.0 / (0.25 * np.abs(mean)) ** 2)
    s2 = fit.rms**2 * 1.0
    inverse = np.linalg.inv(rows @ rows.T / s2 + precision)
    np.testing.assert_allclose(
        values.solution, inverse @ (rows @ force[:, 1] / s2 + precision @ mean), rtol=1e-10
    )
    # The white covariance divides by the degrees of freedom, the noise level by the
    # samples: 5 % here.
    np.testing.assert_allclose(covariance, inverse, rtol=0.06)


def test_little_data_gives_the_prior_and_much_data_the_data():
    few = fitted(*data(5, noise=500.0))
    values, _ = posterior(*few, MEANS, relative_sd=0.01)
    np.testing.assert_allclose(values.solution, list(MEANS.values()), rtol=0.02)
    many = fitted(*data(20000, noise=1.0))
    values, _ = posterior(*many, MEANS, relative_sd=1.0)
    np.testing.assert_allclose(values.solution, many[1].solution, rtol=1e-4)


def test_coloured_residuals_weigh_the_data_less():
    factor, fit, white = fitted(*data(200, noise=50.0))
    distance = []
    for inflation in (1.0, 100.0):
        values, _ = posterior(factor, fit, inflation * white, MEANS, relative_sd=0.1)
        distance.append(np.abs(values.solution - list(MEANS.values())).max())
    assert distance[1] < 0.5 * distance[0]


def test_a_prior_decides_what_the_data_leave_open_and_keeps_what_they_say():
    factor, fit, white = fitted(*data(500, noise=0.1, collinear=True))
    assert fit.groups
    values, covariance = posterior(factor, fit, white, MEANS, relative_sd=0.5)
    assert values.groups == ()
    np.testing.assert_allclose(
        values.solution @ [1.0, 2.0], -330.0, rtol=1e-3
    )  # the sum that the data determine
    assert np.all(np.isfinite(covariance))
    assert np.sqrt(covariance[0, 0]) > 1.0 > np.sqrt(np.array([1.0, 2.0]) @ covariance @ [1.0, 2.0])


def test_figures_of_the_fit_count_the_data_alone():
    factor, fit, white = fitted(*data(100, noise=10.0))
    values, _ = posterior(factor, fit, white, MEANS, relative_sd=0.05)
    assert values.sse > fit.sse
    assert values.j0 == fit.j0
    assert values.n_samples == fit.n_samples
    rows, force = data(100, noise=10.0)
    assert values.sse == pytest.approx(float(np.sum((force[:, 1] - values.solution @ rows) ** 2)))


def test_a_prior_of_nothing_changes_nothing():
    factor, fit, white = fitted(*data(50, noise=10.0))
    values, covariance = posterior(factor, fit, white, {"p*|p|": -1.0, "u*v": 0.0}, relative_sd=0.5)
    assert values is fit
    assert covariance is white
