"""One verdict per coefficient, by the rules written in its module; excitation of the
motion behind it.
"""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.identification.regression import verdicts as rules
from auvid.hydro.identification.regression.excitation import (
    LEAST_ERRORS,
    THRESHOLDS,
    axis_excitation,
    error_thresholds,
    term_floors,
)
from auvid.hydro.identification.regression.least_squares import (
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.separability import judge_with_motion, motion_floors
from auvid.hydro.identification.regression.verdicts import (
    T_LIMIT,
    clear_of_zero,
    discovery_limit,
    judge,
    sign_turns,
    strongest,
)


def fit_of(nu: np.ndarray, terms: tuple[str, ...], force: np.ndarray) -> AxisFit:
    forces = np.zeros((nu.shape[1], 6))
    forces[:, 0] = force
    return solve_axis(
        TriangularFactor.empty(terms).update(basis_rows(nu, None, terms), forces), "X", terms
    )


@pytest.fixture
def nu() -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.standard_normal((6, 4000)) * np.array([0.3, 0.2, 0.2, 0.001, 0.3, 0.3])[
        :, None
    ] + np.array([[2.0], [0], [0], [0], [0], [0]])


def test_every_verdict(nu: np.ndarray) -> None:
    noise = np.random.default_rng(2).standard_normal(4000)
    fit = fit_of(
        nu, ("u", "|u|", "v", "w", "p"), -8.0 * nu[0] + 5.0 * nu[1] + 400.0 * nu[3] + noise
    )
    verdicts = judge(fit, floors=term_floors(fit.terms, axis_excitation(nu.T)))
    assert {term: str(verdict) for term, verdict in verdicts.items()} == {
        "u": "inseparable from |u|",
        "|u|": "inseparable from u",
        "v": "identified",
        "w": "weak",
        "p": "not excited",
    }
    assert verdicts["v"].t_ratio > 20
    assert verdicts["w"].t_ratio < 2
    assert verdicts["p"].excitation < 0.1
    assert verdicts["v"].share == pytest.approx(5.0 * 0.2 / fit.j0, rel=0.1)


def test_without_floors_a_small_but_clear_term_is_identified(nu: np.ndarray) -> None:
    fit = fit_of(nu, ("p",), 400.0 * nu[3])
    assert judge(fit)["p"].status == "identified"


def test_larger_standard_errors_turn_identified_into_weak(nu: np.ndarray) -> None:
    fit = fit_of(nu, ("v",), 5.0 * nu[1] + np.random.default_rng(3).standard_normal(4000))
    assert judge(fit)["v"].status == "identified"
    assert judge(fit, standard_errors=[3.0])["v"].status == "weak"
    with pytest.raises(DataError, match="one standard error per term"):
        judge(fit, standard_errors=[1.0, 2.0])


def test_a_sign_that_rests_on_an_assumed_figure_is_weak(nu: np.ndarray) -> None:
    """Clear by noise, but a mass off by one deviation moves it by its own size."""
    fit = fit_of(nu, ("v",), 5.0 * nu[1] + np.random.default_rng(3).standard_normal(4000))
    for shift, word in ((2.0, "identified"), (3.0, "weak")):
        assert judge(fit, figures={"mass": np.array([shift])})["v"].status == word
    assert judge(fit, figures={"mass": np.array([2.0]), "arm": np.array([2.0])})["v"].status == (
        "weak"
    ), "assumed figures err independently"
    for lean, word in ((1.6, "identified"), (1.7, "weak")):
        for figures in (
            {"unsteady": lean},
            {"form": lean},
            {"unsteady": lean * 0.6, "form": lean * 0.8},
        ):
            shifts = {name: np.array([shift]) for name, shift in figures.items()}
            assert judge(fit, figures=shifts)["v"].status == word


def test_what_is_clear_of_zero() -> None:
    assert clear_of_zero(-4.0, 1.0)
    assert not clear_of_zero(3.9, 1.0)
    assert clear_of_zero(4.0, 0.0, [2.0])
    assert not clear_of_zero(4.0, 0.5, [2.0])
    assert not clear_of_zero(6.0, 1.0, quantile=12.7), "few degrees of freedom"
    assert not clear_of_zero(0.0, 0.0)
    assert not clear_of_zero(5.0, float("nan"))


def test_nearly_dependent_terms_are_inseparable_when_neither_is_clear() -> None:
    rng = np.random.default_rng(4)
    nu = np.zeros((6, 3000))
    nu[0] = rng.uniform(0.5, 2.0, 3000)
    nu[0, :3] = -0.2
    nu[1] = rng.standard_normal(3000)
    fit = fit_of(
        nu, ("u", "|u|", "v"), -8.0 * nu[0] + 4.0 * nu[1] + 5.0 * rng.standard_normal(3000)
    )
    assert fit.rank == 3
    assert {term: str(verdict) for term, verdict in judge(fit).items()} == {
        "u": "inseparable from |u|",
        "|u|": "inseparable from u",
        "v": "identified",
    }


def test_a_zero_column_is_not_excited() -> None:
    nu = np.zeros((6, 100))
    nu[0] = np.linspace(0.1, 1.0, 100)
    verdicts = judge(fit_of(nu, ("u", "r"), nu[0]))
    assert verdicts["r"].status == "not excited"
    assert verdicts["u"].status == "identified"


def test_excitation_of_a_motion() -> None:
    nu = np.zeros((200, 6))
    nu[:, 0] = 2.0
    nu[:, 1] = np.where(np.arange(200) % 2, 0.05, -0.05)
    excitations = axis_excitation([nu[:50], nu[50:]], eta_ratio=np.full(200, 1.2))
    assert excitations["u"].rms == pytest.approx(2.0)
    assert (excitations["u"].excited, excitations["u"].changes_sign, excitations["u"].std) == (
        True,
        False,
        pytest.approx(0.0, abs=1e-12),
    )
    assert (
        excitations["v"].excited,
        excitations["v"].changes_sign,
        excitations["v"].share_beyond,
    ) == (
        True,
        True,
        1.0,
    )
    assert (excitations["w"].excited, excitations["w"].share_beyond) == (False, 0.0)
    assert excitations["eta-1"].rms == pytest.approx(0.2)
    assert (excitations["v"].low, excitations["v"].high) == (-0.05, 0.05)


def test_excitation_of_legs_merges_to_that_of_all_samples() -> None:
    nu = np.random.default_rng(5).normal(0.3, [0.1, 0.02, 0.2, 0.3, 0.01, 1.0], (900, 6))
    legs = [axis_excitation(nu[rows]) for rows in (slice(0, 100), slice(100, 300), slice(300, 900))]
    for name, expected in axis_excitation(nu).items():
        merged = legs[0][name].merge(legs[1][name]).merge(legs[2][name])
        assert (merged.n, merged.low, merged.high) == (900, expected.low, expected.high)
        for field in ("mean", "rms", "std", "share_beyond"):
            assert getattr(merged, field) == pytest.approx(getattr(expected, field), rel=1e-13)


def test_a_product_counts_as_excited_only_if_each_factor_is() -> None:
    rng = np.random.default_rng(5)
    nu = np.zeros((6, 1000))
    nu[0], nu[1], nu[5] = 2.0, 0.01 * rng.standard_normal(1000), 0.3 * rng.standard_normal(1000)
    terms = ("u*v", "u*r", "u*u", "r*V", "v*|v|")
    floors = term_floors((*terms, "constant"), axis_excitation(nu.T))
    assert floors["u*v"] == pytest.approx(THRESHOLDS["v"] * 2.0)
    assert floors["constant"] == 0.0
    rms = dict(zip(terms, np.sqrt(np.mean(basis_rows(nu, None, terms) ** 2, axis=1)), strict=True))
    assert {term: bool(rms[term] >= floors[term]) for term in terms} == {
        "u*v": False,
        "u*r": True,
        "u*u": True,
        "r*V": False,
        "v*|v|": False,
    }


def test_a_linear_term_counts_as_excited_from_three_errors_of_its_velocity_on() -> None:
    """Products keep the fixed threshold; so does a velocity of unknown error."""
    rng = np.random.default_rng(7)
    nu = 0.012 * rng.standard_normal((1000, 6))
    thresholds = error_thresholds(np.full((1000, 6), 0.001))
    assert thresholds["v"] == pytest.approx(3.0 * np.hypot(0.001, LEAST_ERRORS["v"]))
    excitations = axis_excitation(nu, thresholds=thresholds)
    assert excitations["v"].excited
    assert not excitations["v"].excited_in_products
    floors = motion_floors(("v", "v*|v|", "v*r", "constant"), excitations)
    assert floors == {"v": thresholds["v"], "v*|v|": np.inf, "v*r": np.inf, "constant": 0.0}
    assert error_thresholds(None) == dict(THRESHOLDS)
    noisy = error_thresholds(np.full((9, 6), 0.1))
    assert axis_excitation(nu, thresholds=noisy)["v"].product_threshold == noisy["v"] > 0.3


def test_thresholds_of_legs_add_as_squares() -> None:
    nu = np.ones((300, 6))
    quiet, noisy = (
        axis_excitation(nu[rows], thresholds={**THRESHOLDS, "u": size})["u"]
        for rows, size in ((slice(0, 100), 0.01), (slice(100, 300), 0.04))
    )
    assert quiet.merge(noisy).threshold == pytest.approx(np.sqrt((0.01**2 + 2 * 0.04**2) / 3))


@pytest.mark.parametrize(("sign", "status"), [(-1.0, "identified"), (1.0, "weak")])
def test_own_damping_that_pushes_is_never_identified(sign: float, status: str) -> None:
    nu = np.random.default_rng(8).standard_normal((6, 500))
    fit = fit_of(nu, ("u", "v"), sign * 5.0 * nu[0] + 3.0 * nu[1])
    verdicts = judge_with_motion(fit, axis_excitation(nu.T), covariance=np.eye(2) * 1e-4)[0]
    assert verdicts["u"].status == status
    assert verdicts["v"].status == "identified"


def test_a_sum_of_dependent_columns_has_the_error_that_is_given() -> None:
    """u > 0, so that u and |u| are one: of white residuals the error is much smaller."""
    rng = np.random.default_rng(8)
    nu = rng.uniform(0.5, 2.0, (6, 500))
    fit = fit_of(nu, ("u", "|u|"), 5.0 * nu[0] + rng.standard_normal(500))
    verdicts, (total,) = judge_with_motion(
        fit, axis_excitation(nu.T), covariance=np.diag([4.0, np.nan])
    )
    assert {item.status for item in verdicts.values()} == {"inseparable"}
    assert (total.value, total.standard_error) == (pytest.approx(5.0, abs=0.2), 2.0)


def test_excitation_refuses_nothing_and_nan() -> None:
    with pytest.raises(DataError, match=r"\(n, 6\)"):
        axis_excitation(np.zeros((0, 6)))
    with pytest.raises(DataError, match="not finite"):
        axis_excitation(np.full((3, 6), np.nan))


def test_terms_without_a_force_are_not_discovered_among_many() -> None:
    """40 fits of 12 terms that have no part in the force: none is identified."""
    rng = np.random.default_rng(6)
    terms = ("u", "v", "w", "p", "q", "r", "u*v", "u*w", "v*r", "p*q", "w*q", "u*r")
    above_two = 0
    for _ in range(40):
        fit = fit_of(rng.standard_normal((6, 300)), terms, rng.standard_normal(300))
        verdicts = judge(fit).values()
        assert not [item.term for item in verdicts if item.status == "identified"]
        above_two += sum(item.t_ratio >= 2.0 for item in verdicts)
    assert above_two > 10
    assert discovery_limit(2, rate=0.05) < discovery_limit(133, rate=0.05) < T_LIMIT


def test_a_sign_that_one_leg_carries_is_not_identified() -> None:
    rng = np.random.default_rng(7)
    motion = [rng.standard_normal((6, 2000)) for _ in range(3)]
    # Sway has another sign in the third leg, which moves most.
    motion[2][1] *= 3.0
    drag = [2.0, 2.0, -2.0]
    force = [
        -8.0 * nu[0] + own * nu[1] + 0.1 * rng.standard_normal(2000)
        for nu, own in zip(motion, drag, strict=True)
    ]
    terms = ("u", "v")
    fit = fit_of(np.hstack(motion), terms, np.concatenate(force))
    others = {
        name: fit_of(
            np.hstack([nu for j, nu in enumerate(motion) if j != i]),
            terms,
            np.concatenate([part for j, part in enumerate(force) if j != i]),
        )
        for i, name in enumerate("abc")
    }
    turns = sign_turns(fit, others)
    assert turns == {"v": ("c",)}
    assert judge(fit)["v"].t_ratio > T_LIMIT
    assert {term: item.status for term, item in judge(fit, turns=turns).items()} == {
        "u": "identified",
        "v": "weak",
    }


def test_one_place_says_which_methods_may_identify(monkeypatch: pytest.MonkeyPatch) -> None:
    assert strongest("identified", "least squares") == "identified"
    monkeypatch.setattr(rules, "MAY_IDENTIFY", frozenset({"filter error"}))
    assert strongest("identified", "least squares") == "weak"
    assert strongest("identified", "filter error") == "identified"
    assert strongest("at its bound", "within limits") == "at its bound"
