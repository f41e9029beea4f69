"""Independent samples, the BIC, and the simplest model that is as good as the best."""

from functools import partial

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.viscous.structures import diagonal, symmetric
from auvid.hydro.identification.constrained.equations import viscous_equations
from auvid.hydro.identification.constrained.fit import fit_within
from auvid.hydro.identification.selection.information import bic, inflation
from auvid.hydro.identification.selection.ranking import rank_models
from tests.support.constrained import Dive

MODELS = {
    "diagonal": viscous_equations(diagonal(), trim=True),
    "symmetric": viscous_equations(symmetric(), trim=True),
    "symmetric quadratic": viscous_equations(symmetric(quadratic=True), trim=True),
}


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


def test_the_simplest_model_as_good_as_the_best_is_taken():
    legs = [Dive(500, seed=seed, noise=0.3).factor() for seed in range(5)]
    ranking = rank_models(legs, MODELS)
    assert ranking.choice == "symmetric"
    assert "5 held-out legs" in ranking.rule
    by_name = {model.name: model for model in ranking.models}
    assert len(by_name["diagonal"].held_out) == 5
    assert by_name["diagonal"].held_out.mean() > by_name["symmetric"].held_out.mean()
    assert [m.held_out.mean() for m in ranking.models] == sorted(
        m.held_out.mean() for m in ranking.models
    )


def test_a_model_that_breaks_physics_is_not_taken():
    legs = [Dive(500, seed=seed, noise=0.3).factor() for seed in range(3)]
    sound = rank_models(legs, MODELS, physical=lambda fit: len(fit.unknowns) < 20)
    assert sound.choice == "diagonal"
    with pytest.raises(DataError, match="physical"):
        rank_models(legs, MODELS, physical=lambda fit: False)


def test_one_leg_is_ranked_by_information():
    legs = [Dive(1500, noise=3.0).factor()]
    ranking = rank_models(legs, MODELS, fit=partial(fit_within))
    assert ranking.choice == "symmetric"
    assert "one leg" in ranking.rule
    assert np.isnan(ranking.models[0].held_out).all()
    # With few independent samples couplings of small effect are not worth their terms.
    coarse = rank_models(legs, MODELS, samples_per_one=dict.fromkeys("XYZKMN", 150.0))
    assert coarse.choice == "diagonal"
