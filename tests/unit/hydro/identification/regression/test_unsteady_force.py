"""A force that moves the vehicle leans least squares; its own past says how far."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from auvid.hydro.arrays import Array
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.regression.normal_changes import STRIDE, StridedLeg
from auvid.hydro.identification.regression.unsteady_force import (
    LINEARISED,
    REACH_S,
    caused_motion,
    no_more_than,
    unsteady_changes,
    without_gain,
)

STEP_S, MASS, DRAG = 0.02, 20.0, 40.0
COUNT = 30_000


def lean(velocity: Array, force: Array, sd: float = 0.0) -> tuple[float, float]:
    """Return X_u of least squares, and how far the force error may have moved it.

    Less what an error of the velocity by `sd` does.
    """
    nu, forces = np.zeros((2, COUNT, 6))
    nu[:, 0], forces[:, 0] = velocity, force
    factor = TriangularFactor.empty(("u",)).update(velocity[None], forces)
    fit = solve_axis(factor, "X", ("u",))
    values = np.zeros((6, 2))
    values[0, 0] = fit.solution[0]
    leg, slopes = StridedLeg.of(nu, forces, ("u",), ratio=None), np.zeros((COUNT // STRIDE, 6, 6))
    changes = unsteady_changes(
        leg,
        values,
        slopes[::LINEARISED],
        MASS * np.eye(6),
        nu_dot=np.zeros_like(nu[::STRIDE]),
        step_s=STRIDE * STEP_S,
    )
    errors = leg.random(np.full((COUNT, 6), sd), slopes)
    shifts = np.array([change.shift(fit)[0] for change in changes])
    shifts -= [change.shift(fit)[0] for change in errors]
    assert np.allclose(shifts[1:], 0.0), "sway and the others do not move"
    return float(fit.solution[0]), float(shifts[0])


@pytest.mark.parametrize("correlation_s", [0.4, 1.5])
def test_lean_by_a_force_that_moves_the_vehicle_is_seen_and_noise_is_none(
    correlation_s: float,
) -> None:
    """MASS u' = -DRAG u + thrust + unsteady force; u is known, or has noise of a sensor.

    The past of what a noise does to the force is the noise itself: errors of the velocities
    count it already.
    """
    rng = np.random.default_rng(3)
    kept = np.exp(-STEP_S / correlation_s)
    unsteady = 6.0 * np.sqrt(1.0 - kept**2) * lfilter([1.0], [1.0, -kept], rng.normal(size=COUNT))
    t_s = STEP_S * np.arange(COUNT)
    thrust = 8.0 * np.sign(np.sin(2.0 * np.pi * t_s / 9.0))

    def speed(push: Array) -> Array:
        decay = np.exp(-DRAG / MASS * STEP_S)
        return np.asarray(lfilter([0.0, (1.0 - decay) / DRAG], [1.0, -decay], push))

    u = speed(thrust + unsteady)
    value, moved = lean(u, unsteady - DRAG * u)
    assert value + DRAG > 4.0, "least squares takes the force for less drag"
    assert 0.4 < moved / (value + DRAG) < 1.1, "most of that is seen in the first step"
    noise = gaussian_filter1d(rng.normal(scale=0.3, size=COUNT), 12.0)
    u = speed(thrust)
    measured, force = u + noise, MASS * np.gradient(noise, STEP_S) - DRAG * u
    value, twice = lean(measured, force)
    assert value + DRAG > 0.8
    assert twice == pytest.approx(value + DRAG, rel=0.3)
    assert abs(lean(measured, force, float(np.std(noise)))[1]) < 0.3 * twice


def test_a_force_causes_no_more_than_what_was_measured() -> None:
    """Slow motion that a controller holds to a fifth, and fast motion that it does not."""
    t_s = 0.1 * np.arange(900)
    slow, fast = np.sin(0.5 * t_s)[:, None] * np.ones(6), 0.3 * np.sin(9.0 * t_s)[:, None]
    left = no_more_than(0.2 * slow + 2.0 * fast, slow + fast, 0.1)
    inner = slice(100, -100)
    assert left[inner] == pytest.approx((0.2 * slow + fast)[inner], abs=0.05)
    assert no_more_than(slow, slow, 0.1) == pytest.approx(slow, abs=1e-9)
    # Of a vehicle that is held at rest the force moves nothing, and leans no inertia.
    names = [f"{name}_dot" for name in "uvwpqr"]
    leg = StridedLeg.of(slow, slow, (), ratio=None)
    leg = leg.with_columns(names, np.zeros_like(leg.forces))

    def pull(share: float) -> float:
        changes = unsteady_changes(
            leg,
            np.zeros((6, 7)),
            np.zeros((len(leg.rows[::LINEARISED]), 6, 6)),
            np.eye(6),
            nu_dot=share * leg.forces,
            step_s=0.1 * STRIDE,
            accelerations=names,
        )
        return float(changes[0].target[0, 0])

    assert pull(0.2) == pytest.approx(0.2 * pull(1.0), rel=0.05)
    assert pull(0.0) == pytest.approx(0.0, abs=1e-6)


def test_rates_that_gain_energy_are_left_out_and_others_stay() -> None:
    """Of diag(-1, 2, ...) in equal masses the gain goes; a turn without loss stays."""
    rates = np.diag([-1.0, 2.0, -3.0, 0.0, 0.0, 0.0])
    rates[3, 4], rates[4, 3] = 5.0, -5.0
    expected = rates.copy()
    expected[1, 1] = 0.0
    assert without_gain(rates[None], 4.0 * np.eye(6))[0] == pytest.approx(expected)


def test_motion_of_a_second_goes_on_by_the_rates_of_each_sample() -> None:
    """Against the sum over what acted, sample by sample, in three stretches of rates."""
    rng, step_s, count = np.random.default_rng(5), 0.1, 2 * LINEARISED + 7
    rates, pushes = rng.normal(size=(3, 6, 6)), rng.normal(size=(count, 6))
    half, unit = 0.5 * step_s * rates, np.eye(6)
    onward = np.linalg.solve(unit - half, unit + half)
    expected, lags = 0.5 * step_s * pushes, round(REACH_S / step_s)
    for now in range(count):
        reached = unit
        for lag in range(1, min(lags, now) + 1):
            reached = reached @ onward[(now - lag + 1) // LINEARISED]
            weight = step_s if lag < lags else 0.5 * step_s
            expected[now] += weight * reached @ pushes[now - lag]
    assert caused_motion(rates, pushes, step_s) == pytest.approx(expected, rel=1e-12)
