"""What errors of velocities, splines and the force do to coefficients, against fits."""

from __future__ import annotations

from functools import reduce

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.identification.regression.least_squares import (
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.normal_changes import (
    AT_ONCE,
    STRIDE,
    NormalChange,
    StridedLeg,
    TrueEquations,
    widened,
)

TERMS = ("v", "r", "v*|v|")
TRUTH = np.array([-111.0, 42.0, -30.0])
SD = np.array([0.0, 0.01, 0.0, 0.0, 0.0, 0.0])
NO_SLOPE = np.zeros((800, 6, 6))


def fit_of(nu: Array, force: Array) -> AxisFit:
    factor = TriangularFactor.empty(TERMS).update(basis_rows(nu.T, None, TERMS), force)
    return solve_axis(factor, "Y", TERMS, trim=True)


def flown(seed: int, n: int = 4000) -> tuple[Array, Array]:
    """Sway that follows yaw rate, as in closed loop, and its force."""
    random = np.random.default_rng(seed)
    nu = np.zeros((n, 6))
    nu[:, 5] = 0.4 * np.sin(np.linspace(0.0, 90.0, n)) + 0.1 * random.standard_normal(n)
    nu[:, 1] = -0.4 * nu[:, 5] + 0.03 * random.standard_normal(n)
    force = np.zeros((n, 6))
    force[:, 1] = TRUTH @ basis_rows(nu.T, None, TERMS) + 0.5 * random.standard_normal(n)
    return nu, force


def measured(seed: int, *, coriolis: float = 0.0) -> tuple[AxisFit, tuple[NormalChange, ...]]:
    """Return the fit on measured sway, and the changes that its errors are expected to make.

    coriolis: [N s/m] by which measured sway enters the force.
    """
    nu, force = flown(seed)
    error = SD[1] * np.random.default_rng([seed, 1]).standard_normal(len(nu))
    nu[:, 1] += error
    force[:, 1] += coriolis * error
    slopes = NO_SLOPE.copy()
    slopes[:, 1, 1] = coriolis
    leg = StridedLeg.of(nu, force, TERMS, ratio=None)
    return fit_of(nu, force), leg.random(np.broadcast_to(SD, nu.shape), slopes)


@pytest.mark.parametrize("coriolis", [0.0, -200.0])
def test_the_expected_shift_by_velocity_errors_is_that_of_the_fit(coriolis: float) -> None:
    """Force errors that go with those of sway turn the sign of the shift."""
    shifts, expected = [], []
    for seed in range(20):
        fit, changes = measured(seed, coriolis=coriolis)
        shifts.append(fit.solution[:3] - TRUTH)
        expected.append(sum(change.shift(fit) for change in changes)[:3])
    mean, shift = np.mean(shifts, axis=0), np.mean(expected, axis=0)
    # Sway's error takes a tenth of what it does beside yaw rate: v is off by 10.
    assert abs(mean[0]) > 7.0
    assert np.sign(mean[0]) == (1.0 if coriolis == 0.0 else -1.0)
    np.testing.assert_allclose(shift[:2], mean[:2], rtol=0.15)


def test_what_sway_has_of_its_own_may_be_as_large_as_its_errors() -> None:
    """A torpedo sways as it turns: the first order says too little."""
    first, exact = [], []
    for seed in range(10):
        nu, force = flown(seed)
        nu[:, 1] = -0.4 * nu[:, 5] + 0.3 * (nu[:, 1] + 0.4 * nu[:, 5])
        force[:, 1] = TRUTH @ basis_rows(nu.T, None, TERMS)
        nu[:, 1] += 0.012 * np.random.default_rng([seed, 1]).standard_normal(len(nu))
        leg, fit = StridedLeg.of(nu, force, TERMS, ratio=None), fit_of(nu, force)
        changes = leg.random(np.broadcast_to(1.2 * SD, nu.shape), NO_SLOPE)
        equations = TrueEquations.of(fit, changes)
        lean = fit.solution[0] - TRUTH[0]
        first.append(sum(change.shift(fit)[0] for change in changes) / lean)
        exact.append(sum(equations.shift(change)[0] for change in changes) / lean)
        assert equations.noise(fit.covariance)[0, 0] > 4.0 * fit.covariance[0, 0]
        same = TrueEquations.of(fit, ())
        np.testing.assert_allclose(same.shift(changes[1]), changes[1].shift(fit), rtol=1e-8)
    assert np.mean(first) < 0.6
    assert np.mean(exact) == pytest.approx(1.0, abs=0.25)


def test_a_lean_that_is_measured_counts_to_second_order() -> None:
    """Sway over ground in a current, of which the value is measured."""
    nu, force = flown(3)
    flow = np.zeros_like(nu)
    flow[:, 1] = 0.06 * np.sin(np.linspace(0.0, 7.0, len(nu)))
    rows = TERMS[:2]
    leg = StridedLeg.of(nu + flow, force, rows, ratio=None)
    factors = [
        TriangularFactor.empty(rows).update(basis_rows(own.T, None, rows), force)
        for own in (nu, nu + flow)
    ]
    right, wrong = (solve_axis(factor, "Y", rows, trim=True) for factor in factors)
    d_nu, still = -flow[::STRIDE], np.zeros_like(flow[::STRIDE])
    change = leg.definite(still, d_nu).merge(leg.squared(still, d_nu))
    shift = TrueEquations.of(wrong, (), [change]).shift(change)
    lean = right.solution - wrong.solution
    assert abs(lean[0]) > 20.0
    np.testing.assert_allclose(shift[:2], lean[:2], rtol=0.1)
    assert abs(leg.definite(still, d_nu).shift(wrong)[0] - lean[0]) > 0.3 * abs(lean[0])


def test_intervals_hold_the_truth_only_when_widened() -> None:
    plain = wide = 0
    for seed in range(40):
        fit, changes = measured(seed)
        total = widened(fit.covariance, [change.shift(fit) for change in changes])
        off = np.abs(fit.solution[:3] - TRUTH)[:2]
        plain += int(np.sum(off < 1.96 * fit.standard_errors[:2]))
        wide += int(np.sum(off < 1.96 * np.sqrt(np.diag(total))[:2]))
    assert plain / 80 < 0.2
    assert wide / 80 > 0.95


def test_a_known_error_moves_the_fit_by_its_shift() -> None:
    """A little more force and motion, as another arm would give: against a second fit."""
    nu, force = flown(3)
    d_nu, d_force = np.zeros_like(nu), np.zeros_like(force)
    d_nu[:, 1] = -1e-4 * nu[:, 5]
    d_force[:, 1] = 0.02 * nu[:, 5] + 0.01
    # Exact only over the samples that the sums take.
    chosen = slice(None, None, STRIDE)
    fit = fit_of(nu[chosen], force[chosen])
    other = fit_of((nu + d_nu)[chosen], (force + d_force)[chosen])
    leg = StridedLeg.of(nu, force, TERMS, ratio=None)
    change = leg.definite(d_force[chosen], d_nu[chosen])
    per_sample = NormalChange(change.terms, change.moment / leg.weight, change.target / leg.weight)
    np.testing.assert_allclose(
        per_sample.shift(fit), other.solution - fit.solution, rtol=5e-3, atol=1e-4
    )


def test_exact_velocities_and_other_terms_change_nothing() -> None:
    nu, force = flown(1)
    fit, leg = fit_of(nu, force), StridedLeg.of(nu, force, TERMS, ratio=None)
    for sd in (np.zeros(6), np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])):
        for change in leg.random(np.broadcast_to(sd, nu.shape), NO_SLOPE):
            assert not change.shift(fit).any()


def test_more_samples_add_up() -> None:
    nu, force = flown(3, n=2000)
    sd = np.broadcast_to(SD, nu.shape)
    leg = StridedLeg.of(nu, force, TERMS, ratio=None)
    (once,) = leg.random(sd, NO_SLOPE[:400])[1:2]
    np.testing.assert_allclose(once.merge(once).moment, 2.0 * once.moment, rtol=1e-12)
    # The coefficient of v has slope 1 everywhere: n sd^2; a constant has none.
    assert once.moment[0, 0] == pytest.approx(2000 * 0.01**2, rel=1e-12)
    assert not once.moment[-1].any()


def test_pieces_of_a_leg_add_up_to_it() -> None:
    nu, force = flown(3, n=2 * STRIDE * AT_ONCE + 3)
    sd, shift = np.abs(nu), 0.1 * nu
    one_piece = StridedLeg.of(nu, force, TERMS, ratio=None)
    slopes = np.zeros((len(one_piece.rows), 6, 6))
    expected = (*one_piece.random(sd, slopes), one_piece.definite(shift[::STRIDE], shift[::STRIDE]))

    def of_piece(place: slice, part: StridedLeg) -> list[NormalChange]:
        own = nu[place][::STRIDE]
        slopes = np.zeros((len(own), 6, 6))
        return [*part.random(sd[place], slopes), part.definite(0.1 * own, 0.1 * own)]

    pieces = StridedLeg.of_parts(of_piece, nu, force, TERMS, ratio=None)
    assert len(pieces) == 3
    for other, *parts in zip(expected, *pieces, strict=True):
        one = reduce(NormalChange.merge, parts)
        assert one.moment == pytest.approx(other.moment, rel=1e-11, abs=1e-12)
        assert one.target == pytest.approx(other.target, rel=1e-11, abs=1e-12)


@pytest.mark.parametrize("sd", [np.full((10, 6), -1.0), np.full((10, 6), np.nan), np.zeros((4, 6))])
def test_deviations_that_are_none_are_refused(sd: Array) -> None:
    leg = StridedLeg.of(np.zeros((10, 6)), np.zeros((10, 6)), TERMS, ratio=None)
    with pytest.raises(DataError, match="one standard deviation per velocity"):
        leg.random(sd, NO_SLOPE[:2])
