"""Terms switched off by the data, and pursuit against scikit-learn and pysindy."""

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.structures import diagonal, symmetric
from auvid.hydro.dynamics.viscous.symmetry import allowed_terms
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.selection.axis_terms import (
    INFORMATION,
    LEGS,
    pursue,
    switch_off,
)
from auvid.hydro.identification.selection.folds import without_each
from tests.support.constrained import TERMS, Dive

LEG_SEEDS = (0, 1, 2, 3)


@pytest.fixture(scope="module")
def legs():
    return [Dive(600, seed=seed, noise=0.3).factor() for seed in LEG_SEEDS]


def test_all_but_one_leg_is_the_factor_of_the_others(legs):
    for number, fold in enumerate(without_each(legs)):
        others = [leg for i, leg in enumerate(legs) if i != number]
        gram = sum(leg.R.T @ leg.R for leg in others)
        np.testing.assert_allclose(fold.R.T @ fold.R, gram, rtol=1e-9, atol=1e-9 * gram.max())
        assert fold.n_samples == sum(leg.n_samples for leg in others)
    with pytest.raises(DataError, match="two legs"):
        without_each(legs[:1])


def test_legs_keep_what_is_true_and_switch_off_what_is_not(legs):
    reduced = switch_off(legs, symmetric(), trim=True)
    assert reduced.basis == LEGS
    assert "v" in reduced.model.terms["K"]
    assert "u" in reduced.model.terms["M"]
    # The truth has no heave or pitch in surge; chance may leave one in a while.
    gone = {f"{axis}_{term}" for axis, term in reduced.reasons}
    assert len(gone) >= 5
    assert not gone & {"K_v", "M_u"}
    for axis, own in zip("XYZKMN", "uvwpqr", strict=True):
        assert own in reduced.model.terms[axis]
        assert set(reduced.model.terms[axis]) <= set(symmetric().terms[axis])


def test_a_sign_that_depends_on_the_leg_switches_a_term_off():
    dives = [Dive(600, seed=seed, noise=0.05) for seed in (0, 1)]
    for sign, dive in zip((1.0, -1.0), dives, strict=True):
        dive.force[:, 0] += sign * 20.0 * dive.nu[:, 2]
    reduced = switch_off([dive.factor() for dive in dives], symmetric(), trim=True)
    assert "sign" in reduced.reasons["X", "w"]


def test_one_leg_is_judged_by_information_and_says_so(legs):
    reduced = switch_off(
        legs[:1], symmetric(), trim=True, samples_per_one=dict.fromkeys("XYZKMN", 20.0)
    )
    assert reduced.basis == INFORMATION
    assert "one leg" in reduced.note
    assert {"u", "q"} <= set(reduced.model.terms["M"])
    # Fewer independent samples leave fewer terms.
    many = switch_off(legs[:1], symmetric(), trim=True)
    few = switch_off(
        legs[:1], symmetric(), trim=True, samples_per_one=dict.fromkeys("XYZKMN", 200.0)
    )
    assert few.model.n_bar <= reduced.model.n_bar <= many.model.n_bar
    with pytest.raises(DataError, match="no leg"):
        switch_off([], diagonal())


@pytest.mark.parametrize("axis", ["Y", "M"])
def test_pursuit_takes_the_terms_of_scikit_learn(axis):
    from sklearn.linear_model import orthogonal_mp  # here, since it takes seconds

    dive = Dive(800, seed=5, noise=0.2)
    factor = dive.factor()
    names = allowed_terms()[axis]
    pursued = pursue(factor, axis, names, always=(), most=8)
    columns = basis_rows(dive.nu.T, None, names).T
    length = np.linalg.norm(columns, axis=0)
    force = dive.force[:, "XYZKMN".index(axis)]
    for k in range(1, 9):
        oracle = orthogonal_mp(columns / length, force, n_nonzero_coefs=k) / length
        chosen = {names[i] for i in np.flatnonzero(oracle)}
        assert chosen == set(pursued.order[:k])
        fit = solve_axis(factor, axis, pursued.order[:k])
        values = np.array([oracle[names.index(term)] for term in pursued.order[:k]])
        scale = np.array([length[names.index(term)] for term in pursued.order[:k]])
        np.testing.assert_allclose(
            fit.solution * scale, values * scale, atol=1e-7 * np.abs(values * scale).max()
        )
        assert pursued.sse[k] == pytest.approx(fit.sse, rel=1e-9)


def test_pursuit_finds_what_pysindy_finds():
    """A sparse truth, by forward regression, and by least squares with a threshold."""
    from pysindy import FROLS, STLSQ  # here, since it takes seconds

    names = ("u", "v", "w", "p", "q", "r", "v*|v|", "r*|r|", "u*r", "p*q")
    dive = Dive(800, seed=3, noise=0.01)
    rows = basis_rows(dive.nu.T, None, names)
    noise = np.random.default_rng(4).normal(size=rows.shape[1])
    force = np.zeros((rows.shape[1], 6))
    force[:, 1] = -30.0 * rows[1] + 8.0 * rows[5] - 60.0 * rows[6] + 0.01 * noise
    factor = TriangularFactor.empty(names).update(rows, force)
    pursuit = pursue(factor, "Y", names, always=(), most=3)
    values = solve_axis(factor, "Y", pursuit.order).solution
    ours = dict(zip(pursuit.order, values, strict=True))
    assert set(ours) == {"v", "r", "v*|v|"}
    forward = FROLS(normalize_columns=True, max_iter=3)
    threshold = STLSQ(threshold=1.0, alpha=0.0)
    for oracle in (forward, threshold):
        coefficients = oracle.fit(rows.T, force[:, 1:2]).coef_[0]
        np.testing.assert_allclose(
            coefficients, [ours.get(name, 0.0) for name in names], rtol=1e-7, atol=1e-7
        )


def test_pursuit_finds_a_sparse_truth_and_stops():
    random = np.random.default_rng(0)
    rows = random.normal(size=(len(TERMS), 4000))
    force = np.zeros((4000, 6))
    force[:, 5] = -4.0 * rows[TERMS.index("r")] + 2.0 * rows[TERMS.index("v*|v|")] + 1.0
    force += 0.5 * random.normal(size=force.shape)
    factor = TriangularFactor.empty(TERMS).update(rows, force)
    pursued = pursue(factor, "N", allowed_terms()["N"])
    assert pursued.terms == ("r", "v*|v|")
    exact = TriangularFactor.empty(TERMS).update(rows, np.round(force * 0.0) + rows[:1].T)
    assert pursue(exact, "X", ("u", "w", "q")).order == ("u",)
