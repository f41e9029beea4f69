"""Fits within limits against CVXPY with Clarabel on all samples, to 1e-7 of the scale."""

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError, PipelineError
from auvid.hydro.dynamics.viscous.models import MODELS, model_named, without_propeller_terms
from auvid.hydro.dynamics.viscous.structures import diagonal, symmetric
from auvid.hydro.identification.constrained.equations import (
    Unknown,
    added_mass_change,
    inertia_equations,
    lag_equations,
    viscous_equations,
)
from auvid.hydro.identification.constrained.fit import ConstrainedFit, fit_within
from auvid.hydro.identification.constrained.limits import (
    added_mass_bounds,
    bounds,
    damping,
    damping_limits,
    dissipation,
    dissipation_cuts,
    envelope,
    flown_box,
    linear_dissipation,
    positive_inertia,
)
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.regression.least_squares import CONSTANT, solve_axis
from tests.support.constrained import AXES, VELOCITIES, Dive, index, oracle

LOW, HIGH = np.full(6, -0.3), np.full(6, 0.3)


SEMIDEFINITE = 1e-9
"""Tolerance of Clarabel under semidefinite constraints: near them its equations are so
ill-conditioned that later steps go astray (measured on two kernels: within 6e-9 of the
fit at this tolerance, up to 4e-6 at 1e-13)."""


def close(fit, expected, scale, rtol=1e-7):
    size = np.abs(expected * scale).max()
    np.testing.assert_allclose(fit.values * scale, expected * scale, atol=rtol * size)


@pytest.fixture(scope="module")
def dive():
    return Dive()


@pytest.fixture(scope="module")
def factor(dive):
    return dive.factor()


@pytest.mark.parametrize("model", [m.name for m in MODELS if m.name in ("linear", "fossen", "coe")])
def test_without_limits_it_is_least_squares(factor, model):
    form = next(without_propeller_terms(m) for m in MODELS if m.name == model)
    fit = fit_within(factor, viscous_equations(form, trim=True))
    for axis in AXES:
        own = solve_axis(factor, axis, form.terms[axis], trim=True)
        for term, value, error in zip(own.terms, own.solution, own.standard_errors, strict=True):
            place = fit.unknowns.index(Unknown(axis, term))
            assert fit.values[place] == pytest.approx(value, rel=1e-7)
            assert fit.standard_errors[place] == pytest.approx(error, rel=1e-7)
            assert np.sqrt(fit.data_variances[place]) == pytest.approx(error, rel=1e-7)
        assert fit.rms[AXES.index(axis)] == pytest.approx(own.rms, rel=1e-9)
    assert fit.cost == 0.0
    assert fit.active == ()


def test_bounds_give_clarabel_s_minimum(dive, factor):
    equations = viscous_equations(symmetric(quadratic=True), trim=True)
    unknowns = equations.unknowns
    fit = fit_within(factor, equations, limits=[damping(unknowns)])
    damping_places = [i for i, u in enumerate(unknowns) if u.term in _own(u.axis)]
    expected, scale = oracle(dive, equations, fit.noise, lambda x: [x[damping_places] <= 0])
    close(fit, expected, scale)
    assert {limit.name for limit in fit.active} >= {"K_p <= 0", "M_q <= 0"}
    # Standard errors given the active limits: 0 where they fix the value.
    fixed = [unknowns.index(u) for limit in fit.active for u in limit.unknowns]
    np.testing.assert_allclose(fit.standard_errors[fixed], 0.0, atol=1e-12)
    assert fit.standard_errors[index(unknowns, "X", "u")] > 0.0
    # The bound of roll damping moves its neighbours; cost is small and not negative.
    assert 0.0 < fit.cost < 0.1
    assert fit.free[index(unknowns, "K", "p")] > 0.0


def test_the_power_condition_gives_clarabel_s_minimum(dive, factor):
    equations = viscous_equations(symmetric(quadratic=True), trim=True)
    unknowns = equations.unknowns
    rows = dissipation(unknowns, envelope(LOW, HIGH))
    fit = fit_within(factor, equations, limits=[rows])
    G = rows.rows
    expected, scale = oracle(dive, equations, fit.noise, lambda x: [G @ x <= 0])
    close(fit, expected, scale)
    assert any("power" in limit.name for limit in fit.active)


def test_cuts_hold_the_power_between_the_points(factor):
    equations = viscous_equations(symmetric(quadratic=True), trim=True)
    unknowns = equations.unknowns
    fit = fit_within(
        factor,
        equations,
        limits=[dissipation(unknowns, envelope(LOW, HIGH))],
        cuts=[dissipation_cuts(unknowns, LOW, HIGH)],
    )
    other = np.random.default_rng(9).uniform(LOW, HIGH, size=(100_000, 6))
    check = dissipation(unknowns, other).rows
    gross = np.abs(check) @ np.abs(fit.values)
    assert np.max(check @ fit.values / gross) < 1e-4


@pytest.mark.parametrize("quadratic", [False, True])
def test_damping_that_dissipates_is_clarabel_s_semidefinite_minimum(dive, factor, quadratic):
    """With own x|x| too: no motion gains energy where K + K' does and no x|x| is above 0."""
    from cvxpy import bmat  # here, since it takes seconds

    equations = viscous_equations(symmetric(quadratic=quadratic), trim=True)
    unknowns = equations.unknowns
    limits, cuts = damping_limits(unknowns, "dissipative", (LOW, HIGH))
    fit = fit_within(factor, equations, limits=limits, cuts=cuts)
    drag = [i for i, u in enumerate(unknowns) if "|" in u.term]

    def constrain(x):
        K = [
            [
                x[unknowns.index(Unknown(a, v))] if Unknown(a, v) in unknowns else 0.0
                for v in VELOCITIES
            ]
            for a in AXES
        ]
        K = bmat(K)
        size = np.diag([7.0, 10.0, 8.0, 0.3, 0.3, 2.0])
        dissipates = -np.linalg.inv(size) @ (K + K.T) @ np.linalg.inv(size) >> 0
        return [dissipates, *(x[i] <= 0 for i in drag)]

    expected, scale = oracle(dive, equations, fit.noise, constrain, tolerance=SEMIDEFINITE)
    close(fit, expected, scale)
    K = np.zeros((6, 6))
    for u, value in zip(unknowns, fit.values, strict=True):
        if u.term in VELOCITIES:
            K[AXES.index(u.axis), VELOCITIES.index(u.term)] = value
    assert np.linalg.eigvalsh(K + K.T).max() < 1e-6


@pytest.mark.parametrize(
    ("surge", "low", "high", "within"),
    [
        ((0.7, 2.1), 0.0, 2.1, True),
        ((-0.7, 2.1), -2.1, 2.1, False),
        ((-1.0, 0.02), -1.0, 0.0, False),
    ],
)
def test_lift_takes_energy_where_the_vehicle_went_and_not_astern(surge, low, high, within):
    """Fins of a torpedo, Y = -56 u v + 26 u r and N = 26 u v - 18.5 u r: passive ahead."""
    lift = {"Y u*v": -56.0, "Y u*r": 26.0, "N u*v": 26.0, "N u*r": -18.5}
    unknowns = [Unknown(*name.split()) for name in lift]
    box = flown_box(dict.fromkeys(VELOCITIES, (-0.2, 0.1)) | {"u": surge})
    assert [side.tolist() for side in box] == [[low, *[-0.2] * 5], [high, *[0.2] * 5]]
    limits, (cut,) = damping_limits(unknowns, "dissipative", box)
    values = np.array(list(lift.values()))
    assert all(np.all(part.rows @ values <= 1e-9) for part in limits) == within
    assert (len(cut(values).rows) == 0) == within


def test_total_inertia_stays_positive_definite_as_clarabel_has_it():
    from cvxpy import bmat  # here, since it takes seconds

    change = np.zeros((6, 6))
    change[1, 5] = change[5, 1] = 30.0
    dive = Dive(change=change, noise=2.0)
    mass = np.diag([20.0, 20.0, 32.0, 0.45, 0.36, 0.59])
    equations = viscous_equations(diagonal(), trim=True).with_unknowns_of(
        inertia_equations(["X_udot", "Y_vdot", "N_rdot", "Y_rdot"])
    )
    unknowns = equations.unknowns
    fit = fit_within(dive.factor(), equations, cuts=[positive_inertia(unknowns, mass, share=0.01)])
    places = {
        (i, j): unknowns.index(Unknown(AXES[i], f"{VELOCITIES[j]}dot"))
        for i, j in ((0, 0), (1, 1), (5, 5), (1, 5))
    }

    def constrain(x):
        M = [[mass[i, j] * (0.99 if i == j else 1.0) for j in range(6)] for i in range(6)]
        for (i, j), k in places.items():
            M[i][j] = M[i][j] - x[k]
            if i != j:
                M[j][i] = M[j][i] - x[k]
        size = np.diag(np.diag(mass) ** -0.5)
        return [size @ bmat(M) @ size >> 0]

    expected, scale = oracle(dive, equations, fit.noise, constrain, tolerance=SEMIDEFINITE)
    close(fit, expected, scale)
    assert {limit.name for limit in fit.active} == {"total inertia positive definite"}
    total = mass - added_mass_change(dict(zip(unknowns, fit.values, strict=True)))
    assert np.linalg.eigvalsh(total).min() > 0.0


def test_added_mass_and_lag_come_back_from_noise_free_data():
    change = np.diag([-3.0, 2.0, -1.0, 0.1, -0.05, -2.5])
    change[1, 5] = change[5, 1] = 0.4
    dive = Dive(change=change, lag_s=0.12, noise=0.0)
    names = [f"{a}_{v}dot" for a, v in zip(AXES, VELOCITIES, strict=True)] + ["N_vdot"]
    equations = (
        viscous_equations(symmetric(), trim=True)
        .with_unknowns_of(inertia_equations(names))
        .with_unknowns_of(lag_equations())
    )
    fit = fit_within(dive.factor(), equations)
    values = dict(zip(fit.unknowns, fit.values, strict=True))
    np.testing.assert_allclose(added_mass_change(values), change, atol=1e-8)
    assert values[Unknown("all", "lag")] == pytest.approx(0.12, abs=1e-9)
    assert values[Unknown("K", "v")] == pytest.approx(17.0, abs=1e-7)


def test_added_mass_is_bounded_by_theory():
    dive = Dive(change=np.diag([-300.0, 0, 0, 0, 0, 0]), noise=0.1)
    equations = viscous_equations(diagonal()).with_unknowns_of(inertia_equations(["X_udot"]))
    file, theory = np.diag([-6.0, 0, 0, 0, 0, 0]), np.diag([-4.0, 0, 0, 0, 0, 0])
    limit = added_mass_bounds(equations.unknowns, file, reference=theory)
    fit = fit_within(dive.factor(), equations, limits=[limit])
    assert file[0, 0] + fit.value("X", "udot") == pytest.approx(-20.0)
    free = Dive(change=np.diag([50.0, 0, 0, 0, 0, 0]), noise=0.1)
    limit = added_mass_bounds(equations.unknowns, file)
    fit = fit_within(free.factor(), equations, limits=[limit])
    assert file[0, 0] + fit.value("X", "udot") == pytest.approx(0.0, abs=1e-9)


def test_a_prior_with_its_covariance_is_the_posterior_of_the_normal_model(dive, factor):
    equations = viscous_equations(symmetric(), trim=True)
    u = equations.unknowns
    chosen = (Unknown("K", "p"), Unknown("K", "v"), Unknown("M", "q"))
    root = np.random.default_rng(3).normal(size=(3, 3)) * 0.2 + np.eye(3)
    prior = NormalPrior("campaign", chosen, np.array([-1.0, 10.0, -2.0]), root @ root.T)
    fit = fit_within(factor, equations, limits=[damping(u)], priors=[prior])
    damping_places = [i for i, unknown in enumerate(u) if unknown.term in _own(unknown.axis)]
    expected, scale = oracle(
        dive, equations, fit.noise, lambda x: [x[damping_places] <= 0], prior=prior.rows(u)
    )
    close(fit, expected, scale)
    without_prior = fit_within(factor, equations)
    places = [u.index(c) for c in chosen]
    assert np.all(fit.standard_errors[places] <= without_prior.standard_errors[places])


def posterior(fit: ConstrainedFit) -> NormalPrior:
    """What a fit says without limits, as a prior for other data; constants left out."""
    kept = [i for i, unknown in enumerate(fit.unknowns) if unknown.term != CONSTANT]
    covariance = fit.free_covariance[np.ix_(kept, kept)]
    return NormalPrior("campaign", tuple(fit.unknowns[i] for i in kept), fit.free[kept], covariance)


def test_the_posterior_of_one_dive_is_the_prior_of_the_next():
    first, second = Dive(800, seed=1), Dive(800, seed=2)
    equations = viscous_equations(symmetric())
    noise = dict.fromkeys(AXES, 0.5)
    both = fit_within(first.factor().merge(second.factor()), equations, noise=noise)
    prior = posterior(fit_within(first.factor(), equations, noise=noise))
    after = fit_within(second.factor(), equations, priors=[prior], noise=noise)
    np.testing.assert_allclose(after.values, both.values, rtol=1e-8)
    np.testing.assert_allclose(after.covariance, both.covariance, rtol=1e-7)
    # Constants are of the dive and stay behind; a smaller model takes its part.
    with_trim = viscous_equations(symmetric(), trim=True)
    of_all_unknowns = posterior(fit_within(first.factor(), with_trim, noise=noise))
    assert len(of_all_unknowns.unknowns) == 18
    few = viscous_equations(diagonal())
    assert fit_within(second.factor(), few, priors=[of_all_unknowns.of(few.unknowns)]).cost == 0.0


def test_relative_priors_leave_out_what_says_nothing():
    means = {"K": {"p": -2.0, "v": 0.0}, "M": {"q": -4.0}}
    prior = NormalPrior.relative("strip_theory", means, relative_sd=0.5)
    assert prior.unknowns == (Unknown("K", "p"), Unknown("M", "q"))
    np.testing.assert_allclose(prior.covariance, np.diag([1.0, 4.0]))


def test_what_nothing_determines_gets_the_shortest_solution(dive):
    still = Dive(size=np.array([0.2, 0.1, 0.1, 0.0, 0.05, 0.2]))
    fit = fit_within(still.factor(), viscous_equations(symmetric()))
    assert fit.value("K", "p") == 0.0
    assert np.isinf(fit.data_variances[index(fit.unknowns, "K", "p")])
    assert np.isfinite(fit.data_variances[index(fit.unknowns, "K", "v")])


def test_faults_are_named(factor, dive):
    equations = viscous_equations(diagonal())
    u = equations.unknowns
    with pytest.raises(PipelineError, match=r"no such unknown.*Did you mean"):
        bounds(u, upper={Unknown("X", "v"): 0.0})
    with pytest.raises(PipelineError, match="contradict each other"):
        bounds(u, lower={Unknown("X", "u"): 1.0}, upper={Unknown("X", "u"): 0.0})
    low = bounds(u, lower={Unknown("X", "u"): 1.0})
    with pytest.raises(DataError, match=r"X_u.*contradict"):
        fit_within(factor, equations, limits=[damping(u), low])
    with pytest.raises(DataError, match="fewer samples than terms"):
        fit_within(dive.factor(slice(0, 2)), viscous_equations(symmetric()))
    other = NormalPrior.independent("bench", {Unknown("X", "u*|u|"): (1.0, 1.0)})
    with pytest.raises(PipelineError, match="no such unknown"):
        fit_within(factor, equations, priors=[other])
    exact = NormalPrior.independent("bench", {Unknown("X", "u"): (1.0, 0.0)})
    with pytest.raises(PipelineError, match=r"bench: X_u.*deviation above 0"):
        fit_within(factor, equations, priors=[exact])
    twice = NormalPrior("campaign", u[:2], np.zeros(2), np.ones((2, 2)))
    with pytest.raises(PipelineError, match="not positive definite"):
        fit_within(factor, equations, priors=[twice])
    with pytest.raises(PipelineError, match="terms beside linear ones and drag"):
        linear_dissipation(viscous_equations(model_named("coe")).unknowns)
    with pytest.raises(PipelineError, match="Did you mean 'N_rdot'"):
        inertia_equations(["N_rdott"])


def _own(axis):
    x = VELOCITIES[AXES.index(axis)]
    return (x, f"{x}*|{x}|")
