"""Strength of thrusters on one dive: equations, twins of the BlueROV2 Heavy, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.simulation.rov.dive import fly_dive
from auvid.hydro.dynamics.simulation.rov.truth import physical_truth, tau_bar_of
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.identification.fleet.thruster_strength import ThrusterLeg, thruster_strengths

ROOT = Path(__file__).parents[5]
HEAVY: Any = vehicle_from_document(
    read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text(encoding="utf-8"))
)
B = HEAVY.thrusters.allocation
PLAN = parse(
    DivePlanDocument,
    {
        "kind": "dives",
        "title": "a dive",
        "settle_s": 5,
        "legs": [
            {
                "id": "a",
                "duration_s": 60,
                "use": "training",
                "modes": [{"at_s": 0, "mode": "alt_hold"}],
                "sticks": {
                    "forward": {"kind": "random", "amplitude": 0.4},
                    "lateral": {"kind": "random", "amplitude": 0.3},
                    "yaw": {"kind": "random", "amplitude": 0.4},
                },
            }
        ],
    },
)


def drawn(gains: list[float], *, noise: float, seed: int = 0) -> ThrusterLeg:
    """A leg of 100 s whose hull is a model of the fit; lag .1 s."""
    random, t_s = np.random.default_rng(seed), np.arange(0.0, 100.0, 0.05)
    smooth = np.sin(t_s[:, None] * random.uniform(0.2, 2.0, 14) + random.uniform(0.0, 6.0, 14))
    nu, thrust = 0.4 * smooth[:, :6], 10.0 * smooth[:, 6:]
    hull = -nu * [5.0, 6.0, 8.0, 0.3, 0.3, 0.4] - nu * np.abs(nu) * [20.0, 40.0, 60.0, 1, 1, 2]
    late = first_order_lag(thrust, lag_s=0.1, step_s=0.05)
    delivered = (late * gains) @ B.T
    force = hull + delivered - thrust @ B.T + noise * random.standard_normal((len(t_s), 6))
    return ThrusterLeg(t_s, nu, force, thrust)


def dive(strength: list[float], *, seed: int) -> ThrusterLeg:
    """A dive of flow physics, tether and losses, its motion exact."""
    truth = replace(physical_truth(HEAVY), strength=np.array(strength))
    flown = fly_dive(truth, PLAN, PLAN.legs[0], seed=seed)
    t_s = np.arange(flown.start_s, flown.end_s, 0.05)
    motion, bollard = flown.motion(t_s), flown.goals[flown.tick_of(t_s)]
    tau_bar = tau_bar_of(HEAVY, motion.eta, motion.nu, motion.nu_dot, bollard)
    return ThrusterLeg(t_s, motion.nu, tau_bar, bollard)


def test_gains_of_the_equation_come_out() -> None:
    gains = [1.0, 0.9, 0.4, 1.1, 1.0, 1.0, 0.9, 0.05]
    result = thruster_strengths([drawn(gains, noise=1e-6)], B)
    # Each over the median of those like it that give more than .7 of the best.
    expected = [1.0, 0.9 / 1.05, 0.4, 1.1 / 0.95, 1.0 / 0.95, 1.0 / 0.95, 0.9, 0.05]
    assert_allclose([item.strength for item in result], expected, rtol=1e-5)
    assert [item.thruster for item in result if item.verdict == "weak"] == [3]
    assert result[7].verdict == "dead"
    assert result[7].others == (5, 6, 7)


def test_errors_are_those_of_repeated_dives() -> None:
    gains = [1.0] * 8
    runs = [thruster_strengths([drawn(gains, noise=2.0, seed=k)], B) for k in range(30)]
    strengths = np.array([[item.strength for item in run] for run in runs])
    errors = np.array([[item.standard_error for item in run] for run in runs])
    score = (strengths - 1.0) / errors
    # 240 scores, those of one dive dependent.
    assert 0.7 < np.sqrt(np.mean(score**2)) < 1.4


@pytest.mark.parametrize("weak", [2, 7])
def test_half_a_thruster_is_named_within_one_dive(weak: int) -> None:
    strength = [1.0] * 8
    strength[weak - 1] = 0.5
    result = thruster_strengths([dive(strength, seed=weak)], B)
    assert [item.thruster for item in result if item.verdict != "as the others"] == [weak]
    assert abs(result[weak - 1].strength - 0.5) < 0.1


def test_healthy_thrusters_are_left_alone() -> None:
    result = thruster_strengths([dive([1.0] * 8, seed=3)], B)
    assert {item.verdict for item in result} == {"as the others"}


def test_thrusters_that_do_not_agree_name_none() -> None:
    result = thruster_strengths([drawn([1.0, 2, 0.5, 0.25, 1, 1, 1, 1], noise=0.1)], B)
    assert {item.verdict for item in result[:4]} == {"not separable"}
    assert {item.verdict for item in result[4:]} == {"as the others"}


def test_two_weak_thrusters_of_four() -> None:
    result = thruster_strengths([drawn([0.5, 1, 1, 0.5, 1, 1, 1, 1], noise=0.1)], B)
    assert [item.thruster for item in result if item.verdict == "weak"] == [1, 4]
    assert abs(result[1].strength - 1.0) < 0.1


def test_several_weak_thrusters_are_named_within_one_dive() -> None:
    strength = np.ones(8)
    strength[[0, 3, 5]] = 0.5
    result = thruster_strengths([dive(strength.tolist(), seed=4)], B)
    assert [item.thruster for item in result if item.verdict == "weak"] == [1, 4, 6]
    assert_allclose([item.strength for item in result], strength, atol=0.15)


def test_the_one_of_four_that_is_not_weak_is_called_stronger() -> None:
    result = thruster_strengths([drawn([0.5, 0.5, 0.5, 1, 1, 1, 1, 1], noise=0.1)], B)
    assert [item.thruster for item in result if item.verdict != "as the others"] == [4]
    assert result[3].verdict == "stronger"


def test_a_reversed_thruster() -> None:
    result = thruster_strengths([drawn([1.0, 1, 1, -1, 1, 1, 1, 1], noise=0.1)], B)
    assert result[3].verdict == "reversed"


def test_what_a_dive_does_not_separate() -> None:
    leg = drawn([1.0] * 8, noise=0.5)
    stopped = leg.thrust_N.copy()
    stopped[:, 4] = 0.0
    still = ThrusterLeg(leg.t_s, leg.nu, leg.tau_bar, stopped)
    result = thruster_strengths([still], B)
    assert result[4].verdict == "not excited"
    assert np.isnan(result[4].strength)
    stopped[:, 4] = 20.0
    assert thruster_strengths([still], B)[4].is_idle, "it always pushes as much"
    assert result[5].others == (7, 8)
    taken = thruster_strengths([drawn([0.1] * 7 + [0.05], noise=0.01)], B)
    assert {item.verdict for item in taken} == {"not separable"}, "the drag has the thrust"
    loud = thruster_strengths([drawn([1.0] * 8, noise=60.0)], B)
    assert {item.verdict for item in loud} == {"not separable"}


def test_two_thrusters_that_always_push_alike_are_not_separable() -> None:
    leg = drawn([1.0] * 8, noise=0.5)
    twice = np.column_stack([B, B[:, :1]])
    thrust = np.column_stack([leg.thrust_N, leg.thrust_N[:, 0]])
    result = thruster_strengths([replace(leg, thrust_N=thrust)], twice)
    assert [item.thruster for item in result if item.verdict == "not separable"] == [1, 9]


def test_short_or_no_legs_are_refused() -> None:
    leg = drawn([1.0] * 8, noise=0.1)
    short = ThrusterLeg(leg.t_s[:300], leg.nu[:300], leg.tau_bar[:300], leg.thrust_N[:300])
    with pytest.raises(DataError, match="too short"):
        thruster_strengths([short], B)
    with pytest.raises(DataError, match="no leg"):
        thruster_strengths([], B)


def test_lift_of_the_hull_is_no_strength_of_fore_and_aft_thrusters() -> None:
    """A lateral thruster fore, one aft, and a hull whose drift at speed pushes and turns it."""
    leg = drawn([1.0] * 8, noise=0.1)
    lateral = np.zeros((6, 4))
    lateral[0, :2], lateral[5, :2] = 1.0, (-0.3, 0.3)
    lateral[1, 2:], lateral[5, 2:] = 1.0, (0.8, -0.7)
    thrust = leg.thrust_N[:, :4]
    nu = leg.nu.copy()
    nu[:, 1] = 0.001 * np.cumsum(thrust[:, 2:].sum(axis=1))  # it drifts where they push
    u, v, r = nu[:, 0], nu[:, 1], nu[:, 5]
    late = first_order_lag(thrust, lag_s=0.1, step_s=0.05)
    random = np.random.default_rng(1)
    force = (late - thrust) @ lateral.T + 0.01 * random.standard_normal((len(u), 6))
    force[:, 1] -= 120.0 * u * v + 20.0 * r
    force[:, 5] -= 80.0 * u * v + 25.0 * v
    result = thruster_strengths([ThrusterLeg(leg.t_s, nu, force, thrust)], lateral)
    assert_allclose([item.strength for item in result], 1.0, atol=1e-3)
