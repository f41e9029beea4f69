"""Independent samples, the BIC, and the simplest model that is as good as the best."""

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.structures import diagonal, symmetric
from auvid.hydro.identification.constrained.equations import viscous_equations
from auvid.hydro.identification.constrained.fit import fit_within, force_error
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.selection.folds import without_each
from auvid.hydro.identification.selection.information import bic, inflation
from auvid.hydro.identification.selection.ranking import (
    RankedModel,
    choose,
    error_ratios,
    least_squares_error,
)
from tests.support.constrained import TERMS, Dive

MODELS = {
    "diagonal": diagonal(),
    "symmetric": symmetric(),
    "symmetric quadratic": symmetric(quadratic=True),
}


def within(name):
    """Return how a structure is fitted to some legs and judged on another."""
    equations = viscous_equations(MODELS[name], trim=True)
    return lambda others, leg: force_error(leg, equations, fit_within(others, equations).values)


def left_out(legs, error_on):
    """Return J/J0 (L, 7) of each leg, predicted from the others."""
    folds = zip(legs, without_each(legs), strict=True)
    return np.array([error_ratios(leg, error_on(others, leg)) for leg, others in folds])


def candidate(name, left_out, *, terms=10, information=np.nan, is_sound=True):
    return RankedModel(name, terms, np.asarray(left_out, dtype=float), information, is_sound)


@pytest.mark.parametrize(("rho", "expected"), [(0.0, 1.0), (0.8, 9.0), (0.95, 39.0)])
def test_samples_per_independent_one_are_those_of_an_autoregression(rho, expected):
    random = np.random.default_rng(0)
    n = 200_000
    e = np.zeros(n)
    noise = random.normal(size=n)
    for i in range(1, n):
        e[i] = rho * e[i - 1] + noise[i]
    # Bartlett's taper of finite length leaves some of the tail out.
    assert inflation([e]) == pytest.approx(expected, rel=0.12)
    assert inflation([e[: n // 2], e[n // 2 :]]) == pytest.approx(expected, rel=0.12)


def test_the_criterion_is_twice_the_log_of_the_likelihood_and_refuses_nothing_to_count():
    n, sse = 200, 30.0
    likelihood = -0.5 * n * (np.log(2 * np.pi * sse / n) + 1.0)
    direct = -2.0 * likelihood + 3 * np.log(n)
    assert bic(sse, 3, n_samples=n) == pytest.approx(direct - n * (np.log(2 * np.pi) + 1.0))
    with pytest.raises(DataError, match="no residual"):
        inflation([])


def test_a_left_out_leg_is_predicted_from_the_others_alone():
    dives = [Dive(500, seed=seed, noise=0.3) for seed in range(3)]
    legs = [dive.factor() for dive in dives]
    model = MODELS["symmetric"]

    def least_squares(others, leg):
        fits = [solve_axis(others, axis, model.terms[axis], trim=True) for axis in AXES]
        return least_squares_error(fits, leg)

    ratios = left_out(legs, least_squares)
    others = legs[0].merge(legs[2])
    for i, axis in enumerate(AXES):
        fit = solve_axis(others, axis, model.terms[axis], trim=True)
        columns = [dives[1].nu[:, "uvwpqr".index(term)] for term in fit.terms[:-1]]
        predicted = np.column_stack([*columns, np.ones(500)]) @ fit.solution
        force = dives[1].force[:, i]
        error = np.sqrt(np.mean((force - predicted) ** 2) / np.mean(force**2))
        assert ratios[1, 1 + i] == pytest.approx(error, rel=1e-9)
    # Without limits and priors the constrained fit is the same least squares.
    np.testing.assert_allclose(ratios, left_out(legs, within("symmetric")), rtol=1e-6)
    still = TriangularFactor.empty(TERMS).update(np.zeros((len(TERMS), 3)), np.eye(3, 6))
    assert np.isnan(error_ratios(still, np.ones(6))[4:]).all(), "no force on K, M and N"


def test_the_simplest_model_as_good_as_the_best_is_taken():
    legs = [Dive(500, seed=seed, noise=0.3).factor() for seed in range(5)]
    choice = choose(
        [
            candidate(name, left_out(legs, within(name))[:, 0], terms=MODELS[name].n_bar)
            for name in MODELS
        ]
    )
    assert choice is not None
    assert choice.name == "symmetric"
    assert "5 legs" in choice.rule


def test_a_simple_model_is_taken_within_one_error_and_not_beyond():
    best = candidate("best", [0.30, 0.32, 0.28, 0.30], terms=30)
    near = candidate("near", [0.34, 0.30, 0.31, 0.29], terms=5)
    worse = candidate("worse", [0.34, 0.36, 0.32, 0.33], terms=5)
    assert choose([best, near]).name == "near"
    assert choose([best, near]).rule.startswith("the simplest within one standard error of the")
    assert choose([best, worse]).name == "best"
    assert choose([best, worse]).rule.startswith("the best over 4 legs"), "it is not the simplest"


def test_a_model_that_breaks_physics_is_taken_only_where_all_do():
    good = candidate("good", [0.1, 0.1, 0.1], is_sound=False)
    sound = candidate("sound", [0.5, 0.6, 0.5])
    assert choose([good, sound]).name == "sound"
    assert choose([good]).name == "good"


def test_one_leg_is_ranked_by_information():
    rich = candidate("rich", [], terms=20, information=10.0)
    equal = candidate("equal", [], terms=5, information=11.9)
    clear = candidate("clear", [], terms=5, information=12.1)
    choice = choose([rich, equal])
    assert choice.name == "equal"
    assert choice.best == "rich"
    assert "one training leg" in choice.rule
    assert choose([rich, clear]).name == "rich"
    assert choose([candidate("unknown", [])]) is None


def test_a_model_of_which_no_leg_was_left_out_does_not_compete_with_those_that_were():
    left = candidate("left", [0.4, 0.5, 0.45])
    assert choose([left, candidate("other", [], information=-100.0)]).name == "left"
