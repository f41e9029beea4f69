"""Output error: against scipy on an exact solution, coverage, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import t as student

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.maximum_likelihood import output_error
from auvid.hydro.identification.maximum_likelihood.gauss_newton import Optimum, maximise
from auvid.hydro.identification.maximum_likelihood.output_error import fit_output_error
from auvid.hydro.identification.maximum_likelihood.parameters import (
    ParameterPrior,
    UnknownParameters,
)
from tests.support.sway_runs import VEHICLE, simulate, square_wave, sway_leg

DAMPING, SD = -18.0, 0.01
MANY = (
    "u",
    "v",
    "w",
    "p",
    "q",
    "r",
    *(f"v*|{x}|" for x in "uvwpqr"),
    *(f"r*|{x}|" for x in "uvwpqr"),
)
SWAY = UnknownParameters(VEHICLE, {"Y": ("v",)})
KNOWN_SD = np.where(np.arange(13) == 10, SD, np.nan)


def noisy_run(seed: int, n: int = 525, sd: float = SD) -> tuple[np.ndarray, np.ndarray]:
    thrust = square_wave(n)
    noise = sd * np.random.default_rng(seed).standard_normal(n)
    return simulate(DAMPING, thrust, 0.1) + noise, thrust


def test_it_finds_what_scipy_finds_on_the_exact_solution() -> None:
    # Sensitivities hold to 1e-4 where thrust has corners: so far from it in standard errors.
    sd = 0.2 * SD
    measured, thrust = noisy_run(1, sd=sd)
    oracle = least_squares(
        lambda x: (simulate(x[0], thrust, x[1]) - measured) / sd,
        [-15.0, 0.0],
        jac="3-point",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    fit = fit_output_error(
        [sway_leg(measured, thrust)], SWAY, {"Y v": -15.0}, sensor_sd=0.2 * KNOWN_SD, tolerance=1e-8
    )
    assert fit.word == "converged"
    assert fit.theta[0] == pytest.approx(oracle.x[0], rel=1e-7)
    assert fit.theta[0] == pytest.approx(oracle.x[0], abs=1e-3 * fit.standard_errors[0])
    covariance = np.linalg.inv(oracle.jac.T @ oracle.jac)
    assert fit.information_covariance[0, 0] == pytest.approx(covariance[0, 0], rel=1e-3)


@pytest.mark.parametrize(
    ("runs", "most"),
    [
        # 95 % +- 5.6 % (one standard deviation); 4 misses have a chance of 0.5 %.
        (15, 3),
        # 95 % +- 2.8 %; 9 misses have a chance of 0.2 %.
        pytest.param(60, 8, marks=pytest.mark.release),
    ],
)
def test_intervals_hold_the_truth_as_often_as_they_say(runs: int, most: int) -> None:
    misses = 0
    for seed in range(runs):
        measured, thrust = noisy_run(seed, 250)
        fit = fit_output_error([sway_leg(measured, thrust)], SWAY, {"Y v": -15.0}, window_s=2.0)
        low, high = fit.intervals[0]
        misses += not low < DAMPING < high
        assert fit.noise.sensor_sd[10] == pytest.approx(SD, rel=0.2)
    assert misses <= most


def test_a_bound_holds_and_is_named() -> None:
    measured, thrust = noisy_run(3)
    bounded = UnknownParameters(VEHICLE, {"Y": ("v", "v*|v|")}, upper={"Y v": -30.0})
    fit = fit_output_error([sway_leg(measured, thrust)], bounded, {"Y v": -35.0})
    assert fit.theta[0] == -30.0
    assert fit.at_bound.tolist() == [True, False]
    assert np.isnan(fit.standard_errors[0])
    assert np.isfinite(fit.standard_errors[1])


def test_a_leg_left_out_by_one_step_is_the_fit_to_the_others() -> None:
    legs = [sway_leg(*noisy_run(seed)) for seed in (1, 2, 3)]
    start = {"Y v": -15.0}
    fit = fit_output_error(legs, SWAY, start, sensor_sd=KNOWN_SD)
    for number in range(3):
        others = [leg for i, leg in enumerate(legs) if i != number]
        again = fit_output_error(others, SWAY, start, sensor_sd=KNOWN_SD).theta[0]
        moved = abs(fit.theta[0] - again)
        assert abs(fit.without([number])[0] - again) < 0.02 * moved


def test_a_strong_prior_wins_and_a_weak_one_leaves_the_data_alone() -> None:
    measured, thrust = noisy_run(4)
    leg, start = sway_leg(measured, thrust), {"Y v": -15.0}
    free = fit_output_error([leg], SWAY, start, sensor_sd=KNOWN_SD)
    sd = free.standard_errors[0]
    for width, share in ((1e-3, 0.0), (1e3, 1.0)):
        prior = ParameterPrior(np.array([-25.0]), np.array([[(width * sd) ** -2]]))
        fit = fit_output_error([leg], SWAY, start, prior=prior, sensor_sd=KNOWN_SD)
        expected = -25.0 + share * (free.theta[0] + 25.0)
        assert fit.theta[0] == pytest.approx(expected, abs=0.02 * sd)


def test_windows_that_disagree_widen_the_errors_to_those_of_leaving_one_out() -> None:
    """Legs with dampings of their own, as a form has them that lacks a quadratic drag."""
    thrust = square_wave(275)
    noise = SD * np.random.default_rng(7).standard_normal((5, 275))
    fits = {}
    for spread in (0.0, 0.3):
        legs = [
            sway_leg(simulate(DAMPING * (1.0 + spread * k), thrust, 0.1) + own, thrust)
            for k, own in zip((-1.0, -0.5, 0.0, 0.5, 1.0), noise, strict=True)
        ]
        fits[spread] = fit_output_error(legs, SWAY, {"Y v": -15.0}, sensor_sd=KNOWN_SD)
    true, wrong = fits[0.0], fits[0.3]
    assert true.agreement is not None
    assert wrong.agreement is not None
    assert true.windows_agree
    assert true.agreement.degrees == len(legs) - 1
    assert true.agreement.ratio < 3.0  # chi-squared of 4, over 4: beyond it in 2 %
    assert not wrong.windows_agree
    without = np.array(
        [
            fit_output_error(
                [leg for leg in legs if leg is not left], SWAY, {"Y v": -15.0}, sensor_sd=KNOWN_SD
            ).theta[0]
            for left in legs
        ]
    )
    away = np.sqrt(0.8 * np.sum((without - wrong.theta[0]) ** 2)) * student.ppf(0.975, 4) / 1.96
    # A step from the optimum in place of a new fit.
    assert wrong.standard_errors[0] == pytest.approx(away, rel=0.1)
    assert wrong.standard_errors[0] > 3.0 * np.sqrt(wrong.information_covariance[0, 0])


@pytest.mark.parametrize(("gain", "rounds"), [(0.05, 6), (5.0, 1)])
def test_a_round_that_still_gains_at_its_end_is_the_last(
    monkeypatch: pytest.MonkeyPatch, gain: float, rounds: int
) -> None:
    # The leg is never converged on; noise of .2, .1, .2 ... keeps the rounds going.
    def unsettled(*arguments: Any, **options: Any) -> Optimum:
        optimum = maximise(*arguments, **options)
        end = optimum.objectives[-1]
        values = tuple(end + gain * left for left in range(11, -1, -1))
        return replace(optimum, word="no convergence", objectives=values)

    deviations = cycle([0.2, 0.1])
    monkeypatch.setattr(output_error, "maximise", unsettled)
    monkeypatch.setattr(output_error, "residual_sd", lambda *_: np.full(13, next(deviations)))
    fit = fit_output_error([sway_leg(*noisy_run(6))], SWAY, {"Y v": -15.0})
    assert fit.word == "no convergence"
    assert len(fit.log_likelihood) == 12 * rounds


def test_what_it_refuses() -> None:
    measured, thrust = noisy_run(5)
    leg = sway_leg(measured, thrust)
    with pytest.raises(DataError, match="no leg gives a window"):
        fit_output_error([sway_leg(measured[:200], thrust[:200])], SWAY, {"Y v": -15.0})
    with pytest.raises(DataError, match="fewer samples than unknowns"):
        fit_output_error(
            [sway_leg(measured, thrust, every=16)], UnknownParameters(VEHICLE, {"Y": MANY}), {}
        )
    with pytest.raises(DataError, match="diverges at the starting values"):
        fit_output_error([leg], SWAY, {"Y v": 1e5}, window_s=7.0)
