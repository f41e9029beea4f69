"""Properties of the identification tools that hold for any data."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvid.hydro.identification.regression.error_measures import error_table
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.regression.standard_errors import long_run_moment
from auvid.hydro.identification.signals.bias import fit_bias_linear
from auvid.hydro.identification.signals.resampling import gaps, hold, linear
from auvid.hydro.identification.signals.splines import smoothing_spline

seeds = st.integers(0, 2**32 - 1)
QUICK = settings(max_examples=25, deadline=None)
TERMS = ("u", "v", "w", "p")


def leg(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    return rng.standard_normal((len(TERMS), n)) * rng.uniform(
        0.1, 10.0, (len(TERMS), 1)
    ), rng.standard_normal((n, 6))


@QUICK
@given(seeds, st.integers(1, 60), st.integers(1, 60), st.integers(1, 60))
def test_merging_is_associative_and_equals_one_pass(seed: int, a: int, b: int, c: int) -> None:
    rng = np.random.default_rng(seed)
    rows, force = leg(rng, a + b + c + 20)
    cuts = [slice(0, a), slice(a, a + b), slice(a + b, None)]
    x, y, z = (TriangularFactor.empty(TERMS).update(rows[:, part], force[part]) for part in cuts)
    one_pass = TriangularFactor.empty(TERMS).update(rows, force)
    scale = np.abs(one_pass.R).max()
    left, right = x.merge(y).merge(z), x.merge(y.merge(z))
    np.testing.assert_allclose(left.R, right.R, atol=1e-10 * scale)
    np.testing.assert_allclose(left.R, one_pass.R, atol=1e-10 * scale)


@QUICK
@given(seeds)
def test_order_of_samples_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, force = leg(rng, 80)
    order = rng.permutation(80)
    one = solve_axis(TriangularFactor.empty(TERMS).update(rows, force), "N", TERMS, trim=True)
    other = solve_axis(
        TriangularFactor.empty(TERMS).update(rows[:, order], force[order]), "N", TERMS, trim=True
    )
    np.testing.assert_allclose(one.solution, other.solution, rtol=1e-9, atol=1e-10)
    assert one.sse == pytest.approx(other.sse, rel=1e-9)


@QUICK
@given(seeds, st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_units_scale_coefficients_and_change_nothing_else(
    seed: int, length: float, force_unit: float
) -> None:
    rng = np.random.default_rng(seed)
    rows, force = leg(rng, 60)
    plain = solve_axis(TriangularFactor.empty(TERMS).update(rows, force), "X", TERMS)
    scaled_rows = rows * np.array([length, 1.0, 1.0, 1.0])[:, None]
    scaled = solve_axis(
        TriangularFactor.empty(TERMS).update(scaled_rows, force * force_unit), "X", TERMS
    )
    np.testing.assert_allclose(
        scaled.solution * [length, 1, 1, 1] / force_unit, plain.solution, rtol=1e-8, atol=1e-9
    )
    np.testing.assert_allclose(scaled.vif, plain.vif, rtol=1e-8)
    assert scaled.rank == plain.rank
    assert scaled.sse == pytest.approx(plain.sse * force_unit**2, rel=1e-9)


@QUICK
@given(seeds, st.permutations(range(4)))
def test_fitted_force_and_groups_do_not_depend_on_the_order_of_terms(
    seed: int, order: list[int]
) -> None:
    rng = np.random.default_rng(seed)
    rows, force = leg(rng, 50)
    rows[3] = 2.0 * rows[1] - rows[2]
    factor = TriangularFactor.empty(TERMS).update(rows, force)
    names = [TERMS[i] for i in order]
    fit = solve_axis(factor, "X", names)
    reference = solve_axis(factor, "X", TERMS)
    assert fit.rank == 3
    assert [set(group.terms) for group in fit.groups] == [{"v", "w", "p"}]
    np.testing.assert_allclose(fit.solution @ rows[order], reference.solution @ rows, atol=1e-8)
    assert fit.coefficients[names.index("u")] == pytest.approx(
        reference.coefficients[0], rel=1e-8, abs=1e-10
    )


@QUICK
@given(seeds, st.floats(1e-6, 1e3), st.floats(-100, 100), st.floats(0.01, 100))
def test_smoothing_is_linear_in_the_values(
    seed: int, lam: float, offset: float, factor: float
) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.1, 1.0, 30))
    a, b = rng.standard_normal((2, 30))
    both = smoothing_spline(t, factor * a + b + offset, lam=lam).evaluate(t)
    parts = (
        factor * smoothing_spline(t, a, lam=lam).evaluate(t)
        + smoothing_spline(t, b, lam=lam).evaluate(t)
        + offset
    )
    np.testing.assert_allclose(both, parts, atol=1e-8 * (1 + abs(offset) + factor))


@QUICK
@given(seeds, st.integers(0, 50))
def test_long_run_moment_is_positive_semidefinite(seed: int, lags: int) -> None:
    moment = long_run_moment(np.random.default_rng(seed).standard_normal((40, 3)), lags=lags)
    assert np.linalg.eigvalsh(moment).min() > -1e-9


@QUICK
@given(seeds, st.floats(0.05, 2.0))
def test_segments_cover_every_sample_once(seed: int, longest: float) -> None:
    t = np.cumsum(np.random.default_rng(seed).exponential(0.5, 40))
    parts = gaps(t, longest)
    assert [i for start, end in parts for i in range(start, end)] == list(range(40))
    assert all((np.diff(t[start:end]) <= longest).all() for start, end in parts)


@QUICK
@given(seeds)
def test_resampling_invents_no_value_beyond_its_neighbours(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t, y = np.cumsum(rng.uniform(0.1, 1.0, 20)), rng.standard_normal(20)
    new = rng.uniform(-1.0, t[-1] + 1.0, 50)
    for out in (linear(t, y, new, max_gap_s=0.7), hold(t, y, new, max_gap_s=0.7)):
        inside = np.isfinite(out)
        assert not inside[(new < t[0]) | (new > t[-1])].any()
        left = np.searchsorted(t, new[inside], side="right") - 1
        right = np.minimum(left + 1, 19)
        assert (out[inside] >= np.minimum(y[left], y[right]) - 1e-12).all()
        assert (out[inside] <= np.maximum(y[left], y[right]) + 1e-12).all()


@QUICK
@given(seeds, st.floats(-1.0, 1.0), st.floats(-5.0, 5.0))
def test_a_shifted_rate_shifts_the_bias_alone(seed: int, shift: float, start: float) -> None:
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 10.0, 60)
    rate, measured = rng.standard_normal((2, 60))
    base = fit_bias_linear(t, rate, measured)
    moved = fit_bias_linear(t, rate + shift, measured + start)
    np.testing.assert_allclose(moved.bias - base.bias, shift, atol=1e-9)
    np.testing.assert_allclose(moved.initial - base.initial, start, atol=1e-8)


@QUICK
@given(seeds)
def test_error_measures_ignore_the_order_of_samples(seed: int) -> None:
    rng = np.random.default_rng(seed)
    measured, predicted = rng.standard_normal((2, 31, 6))
    order = rng.permutation(31)
    for name, expected in error_table(measured, predicted).items():
        assert vars(error_table(measured[order], predicted[order])[name]) == pytest.approx(
            vars(expected), rel=1e-12
        )
