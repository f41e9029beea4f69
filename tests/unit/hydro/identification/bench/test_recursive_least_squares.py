"""Static form, recursive estimator, persistence of excitation and output-error fit
against known truth (Alberti, chapter III).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.identification.bench.output_error import Nuisance, SingleRun, fit_output_error
from auvid.hydro.identification.bench.persistence_of_excitation import (
    NOT_EXCITED,
    NOT_PERSISTENT,
    PERSISTENT,
    excitation,
)
from auvid.hydro.identification.bench.recursive_least_squares import (
    StaticRegression,
    batch_least_squares,
    recursive_least_squares,
    static_form,
)
from tests.support.single_channel import stepped_run

Array = npt.NDArray[np.float64]
MASS, LINEAR, QUADRATIC = 20.9 + 13.5778, -5.0, -27.7411
"""m - X_udot and X_u|u| of Table 4; the linear drag is ours."""
THETA = np.array([LINEAR, QUADRATIC, 1.0]) / MASS
LEVELS = np.random.default_rng(1).uniform(-20.0, 20.0, 15)


def slope(x: float, _: float, force: float) -> float:
    return (force + LINEAR * x + QUADRATIC * x * abs(x)) / MASS


def varying_steps(rate_hz: float) -> tuple[Array, Array, Array]:
    t, u, _, force = stepped_run(LEVELS, 4.0, rate_hz, slope)
    return t, u, force


def form_of(t: Array, u: Array, force: Array, rate: float = 1.0) -> StaticRegression:
    regressor_after = np.full((len(force), 3), np.nan)
    regressor_after[:, 2] = force
    return static_form(
        t,
        u,
        np.column_stack([u, u * np.abs(u), np.append(force, 0.0)]),
        rate=rate,
        regressor_after=regressor_after,
    )


def random_form(n: int) -> StaticRegression:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.01, 0.03, n))
    regressor = rng.standard_normal((n, 3)) * [1.0, 0.2, 5.0]
    return StaticRegression(
        t, regressor @ [0.3, -2.0, 0.1] + 0.1 * rng.standard_normal(n), regressor, 1.0
    )


@pytest.mark.compiles("hydro/identification/bench/compiled_loops.py")
@pytest.mark.parametrize("constant", [True, False])
def test_filter_is_exact_for_its_hold(constant: bool) -> None:
    t = np.array([0.0, 0.1, 0.4, 0.401, 2.0])
    values = np.array([1.0, -2.0, 0.5, 3.0, 1.0])
    after = values[:-1, None] if constant else None
    form = static_form(t, np.ones(5), values[:, None], rate=0.7, regressor_after=after)
    fine = np.linspace(0.0, 2.0, 400_001)
    signal = (
        values[np.searchsorted(t, fine[:-1], side="right") - 1]
        if constant
        else np.interp(0.5 * (fine[1:] + fine[:-1]), t, values)
    )
    expected = np.sum(signal * np.exp(-0.7 * (2.0 - 0.5 * (fine[1:] + fine[:-1])))) * (
        fine[1] - fine[0]
    )
    # The sum is a midpoint rule with 5e-6 s steps; a jump inside a step costs one step
    # times its height.
    assert form.regressor[-1, 0] == pytest.approx(expected, abs=2e-5)
    np.testing.assert_allclose(form.z, 0.0, atol=1e-14)  # x is constant, and x_f starts at x(0)


def test_exact_states_give_the_truth_to_a_millionth() -> None:
    # Prior gamma_0 = 1e9, filter rate 1 rad/s, samples of 1 kHz joined by straight
    # lines, force held.
    form = form_of(*varying_steps(1000.0))
    theta = recursive_least_squares(form, prior_spread=1e9).theta[-1]
    np.testing.assert_allclose(theta, THETA, rtol=1e-6)


@pytest.mark.compiles("hydro/identification/bench/compiled_loops.py")
def test_prior_and_start_are_obeyed() -> None:
    form = random_form(50)
    tight = recursive_least_squares(form, prior_spread=1e-12, start=[1.0, 2.0, 3.0])
    np.testing.assert_allclose(tight.theta[-1], [1.0, 2.0, 3.0], atol=1e-6)


@pytest.mark.parametrize("prior", [1e3, 1e8])
def test_end_equals_batch_least_squares(prior: float) -> None:
    form = random_form(100_000)
    recursive = recursive_least_squares(form, prior_spread=prior, start=[0.1, 0.2, 0.3])
    theta, gamma = batch_least_squares(form, prior_spread=prior, start=[0.1, 0.2, 0.3])
    np.testing.assert_allclose(recursive.theta[-1], theta, rtol=1e-9)
    np.testing.assert_allclose(recursive.gamma, gamma, rtol=1e-8, atol=1e-9 * np.abs(gamma).max())
    np.testing.assert_allclose(recursive.spread[-1], np.diag(gamma), rtol=1e-8)


def test_forgetting_follows_a_change_and_its_limits_hold() -> None:
    form = random_form(20_000)
    half = 10_000
    z = form.z.copy()
    z[half:] += form.regressor[half:] @ [1.0, 0.0, 0.0]
    changed = StaticRegression(form.t_s, z, form.regressor, 1.0)
    assert recursive_least_squares(changed, memory_s=5.0).theta[-1, 0] == pytest.approx(
        1.3, abs=0.02
    )
    assert recursive_least_squares(changed).theta[-1, 0] == pytest.approx(0.8, abs=0.02)
    quiet = StaticRegression(
        form.t_s, form.z, form.regressor * (np.arange(20_000) < half)[:, None], 1.0
    )
    assert recursive_least_squares(quiet, prior_spread=1.0, memory_s=5.0).spread[-1].sum() > 1e3
    assert (
        recursive_least_squares(quiet, prior_spread=1.0, memory_s=5.0, highest_trace=2.0)
        .spread[-1]
        .sum()
        <= 3.0 + 1e-12
    )
    awake = recursive_least_squares(form, prior_spread=1.0, lowest_trace=0.5)
    assert np.trace(awake.gamma) >= 0.5 - 1e-12


def test_callers_arrays_stay_untouched_and_bad_values_are_refused() -> None:
    form = random_form(20)
    for values in (form.t_s, form.z, form.regressor):
        values.flags.writeable = False
    start = np.zeros(3)
    recursive_least_squares(form, start=start)
    assert not start.any()
    with pytest.raises(DataError, match="positive"):
        recursive_least_squares(form, prior_spread=0.0)
    with pytest.raises(DataError, match="increase"):
        static_form([0.0, 0.0], [1.0, 1.0], [[1.0], [1.0]], rate=1.0)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_varying_steps_excite_and_a_step_does_not(noise: float) -> None:
    rng = np.random.default_rng(3)
    for levels, hold, status in ((LEVELS, 4.0, PERSISTENT), ([10.0], 60.0, NOT_PERSISTENT)):
        t, u, _, force = stepped_run(levels, hold, 8.0, slope)
        form = form_of(t, u + noise * rng.standard_normal(len(u)), force)
        verdict = excitation(form.t_s, form.regressor[:, 1:])
        assert verdict.status == status
        assert verdict.smallest[-1] == pytest.approx(np.linalg.eigvalsh(verdict.matrix)[0])
        np.testing.assert_allclose(np.diag(verdict.matrix), 1.0)


def test_a_channel_that_stays_still_is_not_excited() -> None:
    t = np.arange(100) / 8.0
    verdicts = excitation(t, np.column_stack([np.full(100, 1e-3), np.sin(t)]), floor=[0.03, 0.0])
    assert verdicts.status == NOT_EXCITED
    zero = excitation(t, np.column_stack([np.zeros(100), np.sin(t)]))
    assert zero.status == NOT_EXCITED
    assert "u stayed at zero" in zero.words(("u", "X"))


@pytest.mark.parametrize(
    ("sizes", "status"), [([1.0, 0.5], NOT_PERSISTENT), ([1.0, 0.5, 0.3], PERSISTENT)]
)
def test_information_must_come_from_two_of_ten_windows(sizes: list[float], status: str) -> None:
    """Two regressors that differ in one window each by these parts of the information.

    Participation ratio (sum s)^2 / sum s^2: 1.5^2 / 1.25 = 1.8, 1.8^2 / 1.34 = 2.4.
    """
    t = np.linspace(0.0, 100.0, 10_001)
    first = np.sin(2.0 * np.pi * t)
    other = np.zeros_like(t)
    for window, size in enumerate(sizes):
        inside = (t > 20.0 * window) & (t <= 20.0 * window + 10.0)
        other[inside] = np.sqrt(size) * np.cos(2.0 * np.pi * t[inside])
    result = excitation(t, np.column_stack([first, other]) @ np.array([[1.0, 1.0], [1e-3, 0.0]]))
    assert result.spread == pytest.approx(sum(sizes) ** 2 / np.sum(np.square(sizes)), rel=1e-3)
    assert result.status == status


def model(p: Array) -> tuple[Array, Array]:
    coefficients, by = np.zeros(5), np.zeros((5, 3))
    coefficients[[0, 1, 2]] = p
    by[[0, 1, 2], [0, 1, 2]] = 1.0
    return coefficients, by


def run_of(t: Array, u: Array, force: Array) -> SingleRun:
    return SingleRun(t, force, force, np.arange(len(t)), u, np.zeros(0, dtype=np.intp), np.zeros(0))


def test_output_error_is_exact_without_noise_and_covers_the_truth_with_it() -> None:
    t, u, force = varying_steps(8.0)
    exact = fit_output_error(run_of(t, u, force), model, 1.2 * THETA, start=np.zeros(2))
    np.testing.assert_allclose(exact.parameters, THETA, rtol=1e-7)
    rng = np.random.default_rng(5)
    hits, seeds = np.zeros(3), 60
    for _ in range(seeds):
        fit = fit_output_error(
            run_of(t, u + 0.01 * rng.standard_normal(len(u)), force),
            model,
            THETA,
            start=np.zeros(2),
        )
        hits += np.abs(fit.parameters - THETA) < 1.96 * fit.standard_errors
    # 95 % nominal; the binomial standard deviation over 60 seeds is 2.8 %.
    assert np.all(hits / seeds > 0.86)


@pytest.mark.compiles("hydro/identification/bench/compiled_loops.py")
def test_output_error_fits_positions_and_a_drifting_rate_sensor() -> None:
    t, p, angle, force = stepped_run(
        LEVELS / 20.0, 4.0, 20.0, lambda x, s, f: f - 0.3 * x - 0.8 * x * abs(x) - 2.0 * np.sin(s)
    )

    def of(q: Array) -> tuple[Array, Array]:
        return np.append(q, 0.0), np.vstack([np.eye(4), np.zeros(4)])

    truth = np.array([-0.3, -0.8, 1.0, -2.0])
    at = np.arange(len(t))
    only_angle = SingleRun(t, force, force, np.zeros(0, dtype=np.intp), np.zeros(0), at, angle)
    fit = fit_output_error(
        only_angle, of, 0.9 * truth, start=np.zeros(2), nuisance=Nuisance(start_position=True)
    )
    np.testing.assert_allclose(fit.parameters, truth, rtol=1e-6)
    drifting = SingleRun(t, force, force, at, p + 0.05 + 0.001 * t, at[::3], angle[::3])
    nuisance = Nuisance(rate_bias=True, rate_drift=True, start_position=True)
    fit = fit_output_error(drifting, of, 0.9 * truth, start=np.zeros(2), nuisance=nuisance)
    np.testing.assert_allclose(fit.parameters, truth, rtol=1e-6)
    np.testing.assert_allclose(fit.bias, [0.05, 0.001, 0.0], rtol=1e-6)


def test_output_error_refuses_too_few_samples() -> None:
    t, u, force = varying_steps(8.0)
    run = run_of(t, u, force).until(0.3)
    assert run.grid_s.size == 3
    with pytest.raises(DataError, match="fewer samples"):
        fit_output_error(run, model, THETA, start=np.zeros(2))
