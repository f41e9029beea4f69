"""Thrust that comes late, and a velocity with a constant: found with the figures of a
single-channel run, and not where there is none.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from auvid.hydro.identification.bench.channel_records import BOTH, ChannelRun
from auvid.hydro.identification.bench.output_error import SingleRun
from auvid.hydro.identification.bench.single_channel import estimate_channel
from auvid.hydro.identification.bench.thrust_lag import lagged

Array = npt.NDArray[np.float64]
TRUTH = np.array([129.85, -46.0, -130.0])
LEVELS, HOLD_S = (20.0, 38.0, 4.0, -7.0, -52.0, -3.0, 11.0, 64.0, 1.0, -1.0, -41.0, 15.0), 8.0
T = np.arange(0.0, HOLD_S * len(LEVELS), 0.125)
FORCE = np.repeat(LEVELS, round(HOLD_S / 0.125))[: T.size - 1]
NOTHING, NOWHERE = np.zeros(0), np.zeros(0, dtype=np.intp)


@cache
def velocity(lag_s: float) -> Array:
    """From rest under LEVELS, the thrust late by a first-order lag: DOP853 over each
    hold.
    """

    def slope(_: float, y: Array, force: float) -> list[float]:
        thrust = y[1] if lag_s else force
        return [
            (TRUTH[1] * y[0] + TRUTH[2] * y[0] * abs(y[0]) + thrust) / TRUTH[0],
            (force - y[1]) / lag_s if lag_s else 0.0,
        ]

    state, out = np.zeros(2), [0.0]
    for index, level in enumerate(LEVELS):
        begin = index * HOLD_S
        times = T[round(begin / 0.125) + 1 : round((begin + HOLD_S) / 0.125) + 1]
        solution = solve_ivp(
            slope,
            (begin, begin + HOLD_S),
            state,
            method="DOP853",
            t_eval=times,
            args=(level,),
            rtol=1e-10,
            atol=1e-12,
        )
        out += list(solution.y[0])
        state = solution.y[:, -1]
    return np.array(out)


def run_of(lag_s: float, bias: float = 0.0) -> ChannelRun:
    x = velocity(lag_s) + bias + 0.01 * np.random.default_rng(4).standard_normal(T.size)
    at = np.arange(T.size)
    return ChannelRun(
        SingleRun(T, FORCE, FORCE, at, x, NOWHERE, NOTHING),
        x,
        at,
        current=True,
        noise=0.03,
        lag=True,
    )


@pytest.mark.parametrize("lag_s", [0.15, 0.6])
def test_lag_is_found_and_taken_from_the_mass(lag_s: float) -> None:
    estimate = estimate_channel(run_of(lag_s), filter_rate=1.0)
    fit = estimate.fits[BOTH]
    assert estimate.lag is not None
    assert abs(estimate.lag.value_s - lag_s) < 4.0 * estimate.lag.standard_error_s
    assert estimate.lag.standard_error_s < 0.2 * lag_s
    assert np.all(np.abs(fit.values[:3] - TRUTH) < 4.0 * fit.standard_errors[:3])
    assert estimate.recursive[BOTH].values[-1, 0] == pytest.approx(TRUTH[0], rel=0.05)


def test_no_lag_where_there_is_none() -> None:
    estimate = estimate_channel(run_of(0.0), filter_rate=1.0)
    assert estimate.lag is None
    assert np.all(
        np.abs(estimate.fits[BOTH].values[:3] - TRUTH)
        < 4.0 * estimate.fits[BOTH].standard_errors[:3]
    )


def test_constant_of_the_velocity() -> None:
    estimate = estimate_channel(run_of(0.0, bias=0.05), filter_rate=1.0)
    fit = estimate.fits[BOTH]
    assert fit.fit.bias[0] == pytest.approx(
        0.05, abs=0.004
    )  # 0.01 m/s of noise in 768 samples: 4e-4, and what the drag adds
    assert np.all(np.abs(fit.values[:3] - TRUTH) < 4.0 * fit.standard_errors[:3])
    assert estimate.recursive[BOTH].values[-1, 0] == pytest.approx(TRUTH[0], rel=0.05)


def test_a_single_step_tells_neither() -> None:
    at = np.arange(T.size)
    x = np.tanh(np.maximum(T - 4.0, 0.0) / 3.0) * 0.4 + 0.01 * np.random.default_rng(
        1
    ).standard_normal(T.size)
    force = np.where(T[:-1] >= 4.0, 30.0, 0.0)
    run = ChannelRun(
        SingleRun(T, force, force, at, x, NOWHERE, NOTHING),
        x,
        at,
        current=True,
        noise=0.03,
        lag=True,
    )
    estimate = estimate_channel(run, filter_rate=1.0)
    assert estimate.excitation["quadratic"].status == "not persistently exciting"
    assert estimate.lag is None
    assert estimate.fits[BOTH].fit.bias[0] == 0.0


def test_force_of_a_lag_follows_its_equation() -> None:
    """Over a ramp y = t - lag (1 - exp(-t / lag)); a held force from rest is 1 - exp(-t
    / lag).
    """
    grid = np.array([0.0, 0.4, 1.0, 2.5])
    ramp = lagged(SingleRun(grid, grid[:-1], grid[1:], NOWHERE, NOTHING, NOWHERE, NOTHING), 0.3)
    np.testing.assert_allclose(
        ramp.force_right, ramp.grid_s[1:] - 0.3 * (1.0 - np.exp(-ramp.grid_s[1:] / 0.3)), atol=1e-12
    )
    ones = np.ones(3)
    constant = lagged(
        SingleRun(grid, ones, ones, np.array([1, 3]), np.zeros(2), NOWHERE, NOTHING),
        0.3,
        from_rest=True,
    )
    np.testing.assert_allclose(
        constant.force_right, 1.0 - np.exp(-constant.grid_s[1:] / 0.3), atol=1e-12
    )
    np.testing.assert_array_equal(constant.grid_s[constant.rate_at], [0.4, 2.5])
