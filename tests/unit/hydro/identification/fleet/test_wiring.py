"""Exchanged and reversed thrusters: every single fault of a leg whose truth is known."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.identification.fleet.thruster_strength import ThrusterLeg
from auvid.hydro.identification.fleet.wiring import missing_thruster, wiring_fault

ROOT = Path(__file__).parents[5]
HEAVY: Any = vehicle_from_document(
    read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text(encoding="utf-8"))
)
B: Array = HEAVY.thrusters.allocation


def leg(wiring: Array, *, seed: int = 0, noise: float = 2.0, drive: float = 10.0) -> ThrusterLeg:
    """A leg of 100 s of a vehicle whose true allocation is `wiring` (6, 8); lag .1 s."""
    random, t_s = np.random.default_rng(seed), np.arange(0.0, 100.0, 0.1)
    smooth = np.sin(t_s[:, None] * random.uniform(0.2, 2.0, 14) + random.uniform(0.0, 6.0, 14))
    nu, thrust = 0.4 * smooth[:, :6], drive * smooth[:, 6:]
    hull = -nu * [5.0, 6.0, 8.0, 0.3, 0.3, 0.4] - nu * np.abs(nu) * [20.0, 40.0, 60.0, 1, 1, 2]
    delivered = 0.8 * first_order_lag(thrust, lag_s=0.1, step_s=0.1) @ wiring.T
    scatter = noise * random.standard_normal((len(t_s), 6)) * [1.0, 1, 1, 0.2, 0.2, 0.2]
    return ThrusterLeg(t_s, nu, hull + delivered - thrust @ B.T + scatter, thrust)


def dive(seed: int, strength: Array, *, tether_N: float, tether_s: float) -> ThrusterLeg:
    """A dive of 120 s, wired rightly; feedback answers .8 of a force off the origin."""
    random, t_s, step_s = np.random.default_rng(seed), np.arange(0.0, 120.0, 0.1), 0.1
    want = np.zeros((len(t_s), 6))
    pilot = np.repeat(random.normal(size=(len(t_s) // 20, 4)), 20, axis=0)
    want[:, [0, 1, 2, 5]] = pilot * [20.0, 15.0, 15.0, 4.0]
    keep = np.exp(-step_s / tether_s)
    pull = lfilter([np.sqrt(1 - keep**2)], [1, -keep], random.normal(size=(len(t_s), 3)), axis=0)
    pull = tether_N * np.hstack([pull, np.cross([[0.3, 0.1, -0.2]], pull)])
    thrust = (want - 0.8 * pull * [1, 1, 1, 0, 0, 1]) @ np.linalg.pinv(B).T
    force = (thrust * strength) @ B.T + pull
    drag, inertia = np.array([15.0, 25.0, 30.0, 1.0, 1.0, 2.0]), np.diag(HEAVY.mass_matrix)
    nu = np.zeros_like(force)
    for i in range(1, len(nu)):
        nu[i] = nu[i - 1] + step_s * (force[i - 1] - drag * nu[i - 1]) / inertia
    scatter = random.normal(size=force.shape) * [1.0, 1, 1, 0.1, 0.1, 0.1]
    return ThrusterLeg(t_s, nu, force - drag * nu - thrust @ B.T + scatter, thrust)


def test_dead_thrusters_name_no_fault_of_the_wiring() -> None:
    for i in range(8):
        dead = np.where(np.arange(8) == i, 0.0, 1.0)
        for seed in (100, 101):
            assert wiring_fault([leg(B * dead, seed=seed)], B) is None
            assert wiring_fault([dive(seed, dead, tether_N=5.0, tether_s=2.0)], B) is None


def test_a_tether_that_feedback_answers_names_nothing() -> None:
    for seed in range(100, 110):
        assert wiring_fault([dive(seed, np.ones(8), tether_N=10.0, tether_s=3.0)], B) is None
        assert wiring_fault([dive(seed, np.ones(8), tether_N=20.0, tether_s=4.0)], B) is None


def test_every_exchange_and_every_reversed_thruster_is_named() -> None:
    for i, j in combinations(range(8), 2):
        wiring = B.copy()
        wiring[:, [i, j]] = wiring[:, [j, i]]
        fault = wiring_fault([leg(wiring, seed=10 * i + j)], B)
        assert fault is not None
        assert fault.outputs == (i + 1, j + 1)
    for i in range(8):
        turned = B * np.where(np.arange(8) == i, -1.0, 1.0)
        fault = wiring_fault([leg(turned, seed=i), leg(turned, seed=50 + i)], B)
        assert fault is not None
        assert fault.outputs == (i + 1,)


def test_right_wiring_is_not_questioned_nor_are_uneven_thrusters() -> None:
    strengths = np.array([1.0, 0.5, 1.0, 0.9, 1.0, 1.0, 0.4, 1.1])
    for seed in range(10):
        assert wiring_fault([leg(B, seed=seed)], B) is None
        assert wiring_fault([leg(B * strengths, seed=seed)], B) is None


def test_a_leg_that_shows_nothing_names_nothing() -> None:
    wiring = B[:, [1, 0, *range(2, 8)]]
    assert wiring_fault([leg(wiring, noise=1000.0, drive=0.1)], B) is None
    short = leg(wiring)
    assert wiring_fault([ThrusterLeg(*(part[:200] for part in vars(short).values()))], B) is None


@pytest.mark.parametrize(("logged", "named"), [(1.0, None), (0.7, None), (-1.0, (3,))])
def test_a_thruster_that_never_pushes_alone_and_is_logged_reversed_is_missing(
    logged: float, named: tuple[int, ...] | None
) -> None:
    """Two vertical thrusters with one command: the other seems to do it all by itself."""
    pair = np.zeros((6, 3))
    pair[0, 0], pair[2, 1:], pair[4, 1:] = 1.0, 1.0, (-0.6, 0.55)
    random, t_s = np.random.default_rng(3), np.arange(0.0, 150.0, 0.1)
    smooth = np.sin(t_s[:, None] * random.uniform(0.2, 2.0, 8) + random.uniform(0.0, 6.0, 8))
    thrust, nu = 15.0 * smooth[:, [6, 7, 7]], 0.3 * smooth[:, :6]
    scatter = random.standard_normal(nu.shape) * [2.0, 2.0, 2.0, 0.3, 0.3, 0.3]
    force = -20.0 * nu - 40.0 * nu * np.abs(nu) + thrust @ pair.T + scatter
    pulses = thrust * [1.0, 1.0, logged]
    fault = missing_thruster([ThrusterLeg(t_s, nu, force - pulses @ pair.T, pulses)], pair)
    assert (fault and fault.outputs) == named


def test_uneven_thrusters_and_a_tether_make_none_missing() -> None:
    strengths = np.array([1.0, 0.5, 1.0, 0.9, 1.0, 1.0, 0.4, 1.1])
    for seed in range(5):
        assert missing_thruster([leg(B * strengths, seed=seed)], B) is None
        assert missing_thruster([dive(seed, strengths, tether_N=20.0, tether_s=4.0)], B) is None
