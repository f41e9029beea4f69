"""Scale of the thrust curve: recovered from a made-up leg, with its interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.identification.coasting import thrust_scale as module
from auvid.hydro.identification.coasting.decay import CoastDecay
from auvid.hydro.identification.coasting.thrust_scale import (
    PoweredLeg,
    drag_and_scale,
    thrust_lag,
    thrust_scale,
)

MASS, D1, D2, STEP_S, LAG_S = 20.0, 0.4, 4.5, 0.02, 0.1
NONE = np.array([], dtype=np.int64)


def decay(covariance: np.ndarray) -> CoastDecay:
    return CoastDecay(
        np.array([D1, D2]),
        np.zeros(0),
        covariance,
        np.full(5, 0.6),
        np.zeros(0),
        (0.0, 0.0, 0.0),
        np.arange(5),
        NONE,
        (),
    )


def leg(scale: float, *, noise: float, seed: int, seconds: float = 120.0) -> PoweredLeg:
    """A leg driven by held random thrust, of which the vehicle file has `scale` times."""
    random = np.random.default_rng(seed)
    count = int(seconds / STEP_S)
    thrust = np.repeat(random.choice([-30.0, 0.0, 15.0, 30.0], count // 100 + 1), 100)[:count]
    acting = first_order_lag(thrust, lag_s=LAG_S, step_s=STEP_S)
    x = np.zeros(count)
    for i in range(count - 1):
        x[i + 1] = x[i] + STEP_S * (acting[i] / MASS - D1 * x[i] - D2 * x[i] * abs(x[i]))
    force = acting - MASS * (D1 * x + D2 * x * np.abs(x)) + noise * random.standard_normal(count)
    return PoweredLeg(force, scale * thrust, x, np.zeros((count, 0)), STEP_S)


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.25])
def test_the_scale_of_the_thrust_in_the_vehicle_file_is_found(scale: float) -> None:
    legs = [leg(scale, noise=4.0, seed=seed) for seed in (1, 2)]
    scaled = thrust_scale(legs, decay(np.zeros((2, 2))), mass=MASS)
    assert scaled.scale == pytest.approx(scale, rel=0.01)
    assert scaled.lag.lag_s == pytest.approx(LAG_S, abs=0.021)
    assert abs(scaled.scale - scale) < 4.0 * scaled.standard_error + 0.005 * scale


def test_the_lag_of_the_thrust_is_told_without_drag_or_curve() -> None:
    """Neither the curve, twice too strong, nor a current under the speed takes part."""
    flown = leg(2.0, noise=4.0, seed=3)
    drift = np.ones((flown.speed.size, 1))
    over_ground = replace(flown, speed=flown.speed + 0.2, drift=drift)
    lag = thrust_lag([over_ground], np.array([0.2]))
    assert abs(lag.lag_s - LAG_S) < 3.0 * lag.sd_s
    assert lag.sd_s < 0.015


def test_the_error_of_the_coasts_is_in_the_error_of_the_scale() -> None:
    exact = thrust_scale([leg(1.0, noise=1.0, seed=3)], decay(np.zeros((2, 2))), mass=MASS)
    doubtful = thrust_scale(
        [leg(1.0, noise=1.0, seed=3)], decay(np.diag([0.0, 0.45**2])), mass=MASS
    )
    # A tenth of the quadratic part, which is most of the drag.
    assert exact.standard_error < 0.01
    assert 0.05 < doubtful.standard_error < 0.11


def test_coasts_that_determine_no_drag_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands on a late clock made coasts under full thrust: their search ends in nan."""
    unknown = replace(decay(np.eye(2)), drag=np.full(2, np.nan))
    monkeypatch.setattr(module, "fit_decay", lambda records, **_: unknown)
    with pytest.raises(DataError, match="determine no drag"):
        drag_and_scale([], [leg(1.0, noise=0.0, seed=1)], mass=20.0)
