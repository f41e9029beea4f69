"""One triangular factor against the literal form of McCarter (4.14)-(4.21), known
truths, and what data do not determine.
"""

from __future__ import annotations

import tracemalloc
from functools import reduce

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError, PipelineError
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.models import MODELS, ViscousModel, model_named
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    TriangularFactor,
    solve_axis,
)
from tests.support.velocity_waves import velocity_waves

AXES = "XYZKMN"


def literal_synthesis(
    xi: np.ndarray, tau: np.ndarray, model: ViscousModel, terms: tuple[str, ...]
) -> np.ndarray:
    """K (6, n_xi) as (4.14)-(4.21) have it: Kronecker product, selection matrix, one
    least-squares problem over all axes.
    """
    chosen = [
        (i, j)
        for i, axis in enumerate(AXES)
        for j, term in enumerate(terms)
        if term in model.terms[axis]
    ]
    mask = np.zeros((len(chosen), 6 * len(terms)))
    for row, (i, j) in enumerate(chosen):
        mask[row, i * len(terms) + j] = 1.0
    big = np.kron(np.eye(6), xi.T) @ mask.T
    kappa = np.linalg.lstsq(big, tau.reshape(-1), rcond=None)[0]
    return (mask.T @ kappa).reshape(6, len(terms))


@pytest.mark.parametrize("name", ["gertler_hagen", "prestero", "linear", "coe", "fossen"])
def test_equals_the_literal_kronecker_form(name: str) -> None:
    model = model_named(name)
    nu, eta, force = velocity_waves(400)
    terms = model.distinct_terms
    xi = basis_rows(nu, eta, terms)
    K = literal_synthesis(xi, force.T, model, terms)
    factor = TriangularFactor.empty(terms).update(xi, force)
    for i, axis in enumerate(AXES):
        fit = solve_axis(factor, axis, model.terms[axis])
        expected = K[i, [terms.index(term) for term in model.terms[axis]]]
        np.testing.assert_allclose(
            fit.solution, expected, rtol=0, atol=1e-9 * np.abs(expected).max(initial=0.0)
        )
        residual = force[:, i] - expected @ xi[[terms.index(term) for term in model.terms[axis]]]
        assert fit.sse == pytest.approx(residual @ residual, rel=1e-10)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_recovers_in_span_coefficients_from_velocity_waves(model: ViscousModel) -> None:
    nu, eta, _ = velocity_waves(12_000)
    rng = np.random.default_rng(9)
    terms = model.distinct_terms
    rows = basis_rows(nu, eta, terms)
    K = rng.uniform(-50.0, 50.0, (6, len(terms)))
    mask = np.array([[term in model.terms[axis] for term in terms] for axis in AXES])
    factor = TriangularFactor.empty(terms).update(rows, ((K * mask) @ rows).T)
    for i, axis in enumerate(AXES):
        fit = solve_axis(factor, axis, model.terms[axis])
        assert fit.rank == len(model.terms[axis])
        np.testing.assert_allclose(fit.coefficients, K[i, mask[i]], rtol=1e-6, atol=1e-6)


def test_noise_is_met_by_the_standard_errors() -> None:
    rng = np.random.default_rng(10)
    rows = rng.standard_normal((4, 5000))
    truth = np.array([1.0, -2.0, 0.5, 0.0])
    force = np.zeros((5000, 6))
    force[:, 2] = truth @ rows + 3.0 * rng.standard_normal(5000)
    fit = solve_axis(TriangularFactor.empty("uvwp").update(rows, force), "Z", "uvwp")
    # 3 / sqrt(5000): independent columns of unit variance.
    np.testing.assert_allclose(fit.standard_errors, 3.0 / np.sqrt(5000), rtol=0.05)
    assert (np.abs(fit.coefficients - truth) < 4 * fit.standard_errors).all()
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), fit.standard_errors, rtol=1e-10)
    np.testing.assert_allclose(fit.vif, 1.0, atol=0.02)
    assert fit.rms == pytest.approx(3.0, rel=0.03)
    assert fit.j0 == pytest.approx(np.sqrt(np.mean(force[:, 2] ** 2)), rel=1e-12)
    assert fit.condition == pytest.approx(1.0, abs=0.1)


def test_ahead_motion_names_the_pairs_and_gives_the_sums() -> None:
    """Uncoupled X in ahead motion has rank 2 of 4: u = |u| and u*u = u*|u|."""
    u = np.random.default_rng(11).uniform(0.5, 2.5, 2000)
    nu = np.zeros((6, 2000))
    nu[0] = u
    terms = ("u", "|u|", "u*u", "u*|u|")
    force = np.zeros((2000, 6))
    force[:, 0] = -7.69 * u - 1.288 * u * u
    fit = solve_axis(
        TriangularFactor.empty(terms).update(basis_rows(nu, None, terms), force), "X", terms
    )
    assert fit.rank == 2
    assert [group.terms for group in fit.groups] == [("u", "|u|"), ("u*u", "u*|u|")]
    assert [str(group.combinations[0]) for group in fit.groups] == [
        "u + |u|: -7.69",
        "u*u + u*|u|: -1.288",
    ]
    assert np.isnan(fit.coefficients).all()
    np.testing.assert_allclose(fit.solution, [-7.69, 0.0, -1.288, 0.0], rtol=1e-9, atol=1e-9)
    assert np.isinf(fit.vif[[1, 3]]).all()


def test_separable_terms_beside_an_inseparable_group_keep_their_numbers() -> None:
    rng = np.random.default_rng(12)
    a, b, c = rng.standard_normal((3, 500))
    rows = np.vstack([a, b, 2.0 * a - b, c])
    force = np.zeros((500, 6))
    force[:, 1] = 4.0 * a + 5.0 * c
    fit = solve_axis(
        TriangularFactor.empty(["a", "b", "d", "c"]).update(rows, force), "Y", ["a", "b", "d", "c"]
    )
    assert fit.rank == 3
    assert fit.groups[0].terms == ("a", "b", "d")
    weights = [combination.weights for combination in fit.groups[0].combinations]
    assert [list(weight) for weight in weights] == [["a", "d"], ["b", "d"]]
    np.testing.assert_allclose([weight["d"] for weight in weights], [2.0, -1.0], rtol=1e-9)
    np.testing.assert_allclose(
        [item.value for item in fit.groups[0].combinations], [4.0, 0.0], atol=1e-9
    )
    assert fit.coefficients[3] == pytest.approx(5.0)


def test_a_zero_column_is_named_and_left_out() -> None:
    rng = np.random.default_rng(13)
    rows = np.vstack([rng.standard_normal(100), np.zeros(100)])
    force = np.zeros((100, 6))
    force[:, 3] = 2.0 * rows[0]
    fit = solve_axis(TriangularFactor.empty(["p", "r"]).update(rows, force), "K", ["p", "r"])
    assert fit.zero_terms == ("r",)
    assert np.isnan(fit.coefficients[1])
    assert fit.solution[1] == 0.0
    assert fit.coefficients[0] == pytest.approx(2.0)


def test_an_axis_without_terms_leaves_all_of_its_force() -> None:
    rows, force = np.ones((1, 50)), np.full((50, 6), 3.0)
    factor = TriangularFactor.empty(["u"]).update(rows, force)
    fit = solve_axis(factor, "K", ())
    assert fit.sse == pytest.approx(450.0)
    trimmed = solve_axis(factor, "K", (), trim=True)
    assert trimmed.terms == (CONSTANT,)
    assert trimmed.coefficients[0] == pytest.approx(3.0)
    assert trimmed.sse == pytest.approx(0.0, abs=1e-20)


def test_badly_scaled_and_nearly_dependent_columns_keep_their_digits() -> None:
    """QR keeps condition 1e7 where normal equations would keep only two digits."""
    rng = np.random.default_rng(14)
    a, b = rng.standard_normal((2, 3000))
    rows = np.vstack([1e6 * a, 1e-6 * (a + 1e-6 * b)])
    force = np.zeros((3000, 6))
    force[:, 0] = 2.0 * rows[0] + 3e12 * rows[1]
    fit = solve_axis(TriangularFactor.empty("uv").update(rows, force), "X", "uv")
    assert fit.rank == 2
    assert fit.condition > 1e6
    np.testing.assert_allclose(fit.coefficients, [2.0, 3e12], rtol=1e-8)


def test_factor_holds_the_gram_matrix_and_does_not_touch_its_input() -> None:
    rng = np.random.default_rng(15)
    rows, force = rng.standard_normal((3, 2500)), rng.standard_normal((2500, 6))
    rows.flags.writeable = force.flags.writeable = False
    factor = (
        TriangularFactor.empty("uvw").update(rows[:, :7], force[:7]).update(rows[:, 7:], force[7:])
    )
    A = np.vstack([rows, np.ones(2500), force.T]).T
    np.testing.assert_allclose(factor.R.T @ factor.R, A.T @ A, rtol=1e-10, atol=1e-9)
    assert np.array_equal(factor.R, np.triu(factor.R))
    assert (np.diag(factor.R) >= 0).all()
    assert factor.n_samples == 2500
    np.testing.assert_allclose(factor.column_rms, np.sqrt(np.mean(A**2, axis=0)), rtol=1e-12)


def test_folds_merge_to_the_whole_bit_for_bit_in_the_same_order() -> None:
    nu, eta, force = velocity_waves(3000)
    terms = model_named("prestero").distinct_terms
    legs = [
        TriangularFactor.empty(terms).update(basis_rows(nu[:, s], eta[s], terms), force[s])
        for s in (slice(0, 900), slice(900, 3000))
    ]
    one_pass = TriangularFactor.empty(terms).update(basis_rows(nu, eta, terms), force)
    once, again = (reduce(TriangularFactor.merge, legs) for _ in range(2))
    assert np.array_equal(once.R, again.R)
    np.testing.assert_allclose(once.R, one_pass.R, atol=1e-10 * np.abs(one_pass.R).max())
    assert once.n_samples == 3000


def test_refusals() -> None:
    factor = TriangularFactor.empty(["u*v", "w"])
    with pytest.raises(DataError, match="factor is empty"):
        solve_axis(factor, "X", ["w"])
    with pytest.raises(DataError, match="do not fit"):
        factor.update(np.zeros((3, 5)), np.zeros((5, 6)))
    rows = np.zeros((2, 3000))
    rows[1, 2077] = np.nan
    with pytest.raises(DataError, match=r"row 2077, field 'w'"):
        factor.update(rows, np.zeros((3000, 6)))
    filled = factor.update(np.zeros((2, 5)), np.zeros((5, 6)))
    with pytest.raises(PipelineError, match=r"Did you mean 'u\*v'"):
        solve_axis(filled, "X", ["u*vv"])
    with pytest.raises(PipelineError, match="unknown axis"):
        solve_axis(filled, "U", ["w"])
    with pytest.raises(PipelineError, match="merged"):
        filled.merge(TriangularFactor.empty(["w"]))
    with pytest.raises(PipelineError, match="twice"):
        TriangularFactor.empty(["w", "w"])


def test_all_models_from_one_factor_agree_with_numpy_in_little_memory() -> None:
    """Every model from one factor, built in blocks, against lstsq on the whole basis."""
    nu, eta, force = velocity_waves(20_000)
    terms = tuple(dict.fromkeys(term for model in MODELS for term in model.distinct_terms))
    basis = basis_rows(nu, eta, terms).T
    tracemalloc.start()
    factor = TriangularFactor.empty(terms)
    for start in range(0, 20_000, 4096):
        block = slice(start, start + 4096)
        factor = factor.update(basis_rows(nu[:, block], eta[block], terms), force[block])
    fits = {
        (model.name, axis): solve_axis(factor, axis, model.terms[axis])
        for model in MODELS
        for axis in AXES
        if model.terms[axis]
    }
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(MODELS) == 8
    assert peak < 100e6  # bytes
    for (name, axis), fit in fits.items():
        columns = basis[:, [terms.index(term) for term in model_named(name).terms[axis]]]
        expected = np.linalg.lstsq(columns, force[:, AXES.index(axis)], rcond=None)[0]
        difference = np.linalg.norm(fit.solution - expected) / np.linalg.norm(expected)
        assert difference < 1e-9, (name, axis)
