"""Dives in memory: balances, the truth behind tau_bar, sensors, seeds, holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.errors import CampaignError, DataError, PipelineError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.rov.dive import Dive, fly_dive
from auvid.hydro.dynamics.simulation.rov.open_frame import OpenFrame
from auvid.hydro.dynamics.simulation.rov.sensors import START_US, dive_in_memory
from auvid.hydro.dynamics.simulation.rov.truth import (
    NO_LOSS,
    RovTruth,
    physical_truth,
    tau_bar_of,
    truth_of_model,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import basis
from auvid.hydro.dynamics.viscous.models import IdentifiedModel

ROOT = Path(__file__).parents[6]


def vehicle(name: str) -> Any:
    return vehicle_from_document(
        read_yaml((ROOT / f"vehicles/{name}.yaml").read_text(encoding="utf-8"))
    )


HEAVY = vehicle("bluerov2_heavy")
PHYSICS = physical_truth(HEAVY)
STICKS = {
    "forward": {"kind": "random", "amplitude": 0.6},
    "lateral": {"kind": "random", "amplitude": 0.6},
    "heave": {"kind": "multisine", "amplitude": 0.6},
    "yaw": {"kind": "random", "amplitude": 0.5},
    "roll": {"kind": "multisine", "amplitude": 0.6},
    "pitch": {"kind": "multisine", "amplitude": 0.6},
}
LEG = {
    "id": "a",
    "duration_s": 30,
    "use": "training",
    "modes": [{"at_s": 0, "mode": "alt_hold"}],
    "sticks": STICKS,
}
NOISE = {
    "imu": {"gyro_sd_rad_s": 0.001, "gyro_bias_sd_rad_s": 0.002, "accel_sd_m_s2": 0.01},
    "attitude": {"tilt_sd_deg": 0.2, "heading_sd_deg": 1.0},
    "dvl": {"sd_m_s": 0.002, "slow_share": 0.2, "lost_share": 0.05, "jitter_s": 0.01},
    "depth": {"sd_m": 0.004, "step_m": 0.001},
    "battery": {"sd_V": 0.01},
}


def plan(**changes: object) -> DivePlanDocument:
    document = {"kind": "dives", "title": "a dive", "settle_s": 5, "legs": [LEG], **changes}
    return parse(DivePlanDocument, document)


def leg(**changes: object) -> DivePlanDocument:
    return plan(legs=[LEG | changes])


def dived(truth: RovTruth, flown: DivePlanDocument, *, seed: int = 1) -> Dive:
    return fly_dive(truth, flown, flown.legs[0], seed=seed)


@pytest.fixture(scope="module")
def dive() -> Dive:
    water = {
        "unsteady": {
            "force_sd_N": [1, 1, 1],
            "moment_sd_N_m": [0.1, 0.1, 0.1],
            "correlation_s": 1.0,
        },
        "current_m_s": [0.1, -0.05, 0.0],
    }
    flown = plan(water=water)
    truth = replace(PHYSICS, current_m_s=np.array(flown.water.current_m_s))
    return dived(truth, flown)


T = np.arange(0.0, 30.0, 0.037)


@pytest.mark.compiles("hydro/dynamics/simulation/rov/loop.py")
def test_the_loop_agrees_with_numpy(dive: Dive) -> None:
    rows = slice(100, 3000, 29)
    state = dive.state[rows]
    goal = dive.goals[np.arange(len(dive.state))[rows] // dive.steps_per_tick]
    push = np.random.default_rng(0).normal(size=(len(state), 6))
    for compiled, numpy in zip(
        dive.truth.rate(state, goal, push),
        dive.truth.rate(state, goal, push, compiled=False),
        strict=True,
    ):
        np.testing.assert_allclose(compiled, numpy, rtol=1e-11, atol=1e-11)


def test_an_independent_integrator_flies_the_same_dive(dive: Dive) -> None:
    """One tick after another with the pulses of the dive; 1e-7 m and rad are the steps."""
    start, ticks = 300, 8
    x = dive.state[start * dive.steps_per_tick].copy()
    for tick in range(start, start + ticks):
        low, high = dive.push[tick], dive.push[tick + 1]

        def rate(t: float, x: Any, tick: int = tick, low: Any = low, high: Any = high) -> Any:
            push = low + t / dive.tick_s * (high - low)
            goal = dive.goals[[tick]]
            return dive.truth.rate(x[None], goal, push[None])[0][0]

        x = solve_ivp(rate, (0.0, dive.tick_s), x, rtol=1e-8, atol=1e-10).y[:, -1]
    end = dive.state[(start + ticks) * dive.steps_per_tick]
    np.testing.assert_allclose(x[:12], end[:12], atol=1e-6)


def test_the_parts_add_up_to_what_a_model_has_to_explain(dive: Dive) -> None:
    """tau_bar by the numbers of the vehicle file, from the motion alone."""
    motion = dive.motion(T)
    residual = tau_bar_of(HEAVY, motion.eta, motion.nu, motion.nu_dot, motion.bollard)
    np.testing.assert_allclose(residual, motion.tau_bar, atol=1e-10)


def test_power_and_energy_balance(dive: Dive) -> None:
    """d/dt (nu' M nu / 2) is the power of all forces but the Coriolis force's none."""
    motion = dive.motion(T)
    forces, M = motion.forces, dive.truth.mass_matrix
    rest = residual_force(
        HEAVY, motion.eta, motion.nu, motion.nu_dot, Control(thruster_force_N=motion.bollard)
    ).restoring
    acting = rest + forces["thrusters"]
    acting = acting + sum(
        forces[name] for name in ("hull", "tether", "buoyancy", "thrust_loss", "unsteady")
    )
    gained = np.sum(motion.nu * (motion.nu_dot @ M.T), axis=1)
    np.testing.assert_allclose(np.sum(motion.nu * acting, axis=1), gained, atol=1e-9)


def test_motion_is_the_derivative_of_the_pose(dive: Dive) -> None:
    step = 1e-4
    ahead, behind, at = (dive.motion(T[5:-5] + shift) for shift in (step, -step, 0.0))
    velocity = (ahead.eta[:, :3] - behind.eta[:, :3]) / (2 * step)
    turned = np.einsum("nij,nj->ni", rotation_body_to_ned(at.eta[:, 3:]), at.ground[:, :3])
    np.testing.assert_allclose(velocity, turned, atol=1e-5)
    change = (ahead.ground - behind.ground) / (2 * step)
    assert np.sqrt(np.mean((change - at.ground_dot) ** 2)) < 0.02  # jumps of the pulses


def test_without_lag_and_losses_the_pulses_give_the_force() -> None:
    """Exact pulses, voltage and states: the residual force is hull, tether, buoyancy."""
    truth = replace(PHYSICS, loss=replace(NO_LOSS, lag_s=0.0), added_mass=HEAVY.added_mass)
    flown = plan(sensors={"battery": {"rate_hz": 50}, "outputs": {"rate_hz": 50}})
    dive, record = dive_in_memory(truth, flown, "a", seed=2)
    actuators, battery = record.streams["actuators"], record.streams["battery"]
    t = (actuators["time_us"] - START_US)[:-1] / 1e6 + 0.005  # inside the ticks
    motion = dive.motion(t)
    pulses = np.column_stack([actuators[f"pwm_{i}_us"][:-1] for i in range(1, 9)])
    voltage = dive.supply[dive.tick_of(t), 0]
    assert battery["voltage_v"][:5] == pytest.approx(
        dive.supply[dive.tick_of((battery["time_us"][:5] - START_US) / 1e6), 0]
    )
    residual = residual_force(
        HEAVY,
        motion.eta,
        motion.nu,
        motion.nu_dot,
        Control(thruster_pwm_us=pulses, voltage_v=voltage),
    ).tau_bar
    true = motion.forces["hull"] + motion.forces["tether"] + motion.forces["buoyancy"]
    np.testing.assert_allclose(residual, true, atol=1e-9)


def test_a_truth_inside_a_form_gives_its_coefficients_back() -> None:
    coefficients = {
        "X": {"u": -5.0, "u*|u|": -60.0},
        "Y": {"v": -6.0, "v*|v|": -80.0, "r": 1.0},
        "Z": {"w": -8.0, "w*|w|": -120.0},
        "K": {"p": -1.0, "p*|p|": -0.5},
        "M": {"q": -1.0, "q*|q|": -0.4},
        "N": {"r": -1.0, "r*|r|": -0.6, "v": 0.5},
    }
    dive = dived(truth_of_model(HEAVY, IdentifiedModel("own", coefficients)), plan())
    motion = dive.motion(T)
    tau = tau_bar_of(HEAVY, motion.eta, motion.nu, motion.nu_dot, motion.bollard)
    for index, (axis, terms) in enumerate(coefficients.items()):
        assert axis == "XYZKMN"[index]
        fit = np.linalg.lstsq(basis(motion.nu, None, tuple(terms)), tau[:, index], rcond=None)[0]
        assert fit == pytest.approx(list(terms.values()), rel=1e-9)


def test_equal_seeds_give_equal_dives_and_others_do_not() -> None:
    flown = plan(sensors=NOISE)
    one, other, third = (dive_in_memory(PHYSICS, flown, "a", seed=seed) for seed in (4, 4, 5))
    for stream, columns in one[1].streams.items():
        for name, values in columns.items():
            assert np.array_equal(values, other[1].streams[stream][name])
    assert np.array_equal(one[0].state, other[0].state)
    assert not np.array_equal(one[0].pulses_us, third[0].pulses_us)


def test_noise_of_one_sensor_leaves_the_others() -> None:
    """The battery's noise is seen by no loop: all else stays to the last bit."""
    quiet, loud = (
        dive_in_memory(PHYSICS, plan(sensors=sensors), "a", seed=4)[1]
        for sensors in (NOISE, NOISE | {"battery": {"sd_V": 0.5}})
    )
    assert np.array_equal(quiet.streams["velocity"]["u_m_s"], loud.streams["velocity"]["u_m_s"])
    assert not np.array_equal(
        quiet.streams["battery"]["voltage_v"], loud.streams["battery"]["voltage_v"]
    )


def test_sensors_see_the_motion_at_their_own_times() -> None:
    dive, record = dive_in_memory(PHYSICS, plan(), "a", seed=3)
    velocity, depth = record.streams["velocity"], record.streams["depth"]
    t = (velocity["time_us"] - START_US) / 1e6 - HEAVY.dvl.lag_s
    motion = dive.motion(t)
    local = motion.ground[:, :3] + np.cross(motion.ground[:, 3:], HEAVY.dvl.arm_m)
    measured = np.column_stack([velocity[f"{axis}_m_s"] for axis in "uvw"])
    np.testing.assert_allclose(measured, local, atol=1e-12)
    at = (depth["time_us"] - START_US) / 1e6
    np.testing.assert_allclose(depth["depth_m"], dive.motion(at).eta[:, 2], atol=1e-12)


def test_the_velocity_log_has_gaps_slow_pings_and_held_rows() -> None:
    sensors = {"dvl": {"slow_share": 0.2, "lost_share": 0.05, "held_share": 0.1}}
    _, record = dive_in_memory(PHYSICS, plan(sensors=sensors), "a", seed=3)
    velocity = record.streams["velocity"]
    steps = np.diff(velocity["time_us"]) / 1e6
    assert np.median(steps) == pytest.approx(1 / 9.2, abs=2e-3)
    assert 0.1 < np.mean(steps > 0.15) < 0.4
    assert 0.02 < np.mean(np.diff(velocity["u_m_s"]) == 0.0) < 0.25


def test_alt_hold_keeps_depth_and_attitude() -> None:
    """Level thrusters sit below the origin, so that driving ahead pitches the vehicle."""
    flown = leg(sticks={"forward": {"kind": "random", "amplitude": 0.2}}, duration_s=60)
    motion = dived(PHYSICS, flown).motion(np.arange(0.0, 60.0, 0.1))
    assert np.abs(motion.eta[:, 2] - 8.0).max() < 0.1
    assert np.degrees(np.abs(motion.eta[:, 3])).max() < 3.0
    assert np.degrees(np.abs(motion.eta[:, 4])).max() < 12.0
    assert np.degrees(np.abs(motion.eta[:, 5])).max() < 5.0


def test_guided_follows_its_route() -> None:
    route = {
        "times_s": [5, 30],
        "north_m": [3, 3],
        "east_m": [0, 2],
        "deeper_m": [0.5, 0.5],
        "heading_deg": [0, 60],
    }
    flown = leg(modes=[{"at_s": 0, "mode": "guided"}], route=route, sticks={}, duration_s=60)
    end = dived(PHYSICS, flown).motion(np.array([58.0, 60.0]))
    np.testing.assert_allclose(end.eta[:, :3], [[3.0, 2.0, 8.5]] * 2, atol=0.15)
    assert np.degrees(end.eta[-1, 5]) == pytest.approx(60.0, abs=3.0)


def test_the_battery_sags_with_load() -> None:
    flown = leg(sticks={"forward": {"kind": "steps", "times_s": [10], "values": [0.8]}})
    supply = dived(PHYSICS, flown).supply
    voltage, current = supply[:, 0], supply[:, 1]
    assert voltage.min() < voltage[:100].mean() - 0.1
    assert current.max() > 5.0
    assert np.all(voltage < 16.03)


def test_a_vehicle_that_surfaces_ends_its_dive() -> None:
    flown = leg(
        modes=[{"at_s": 0, "mode": "manual"}],
        sticks={"heave": {"kind": "steps", "times_s": [1], "values": [-0.6]}},
        duration_s=60,
    )
    dive = dived(PHYSICS, flown)
    assert dive.stop is not None
    assert dive.reached
    assert dive.end_s < 40.0


def test_a_dive_that_pitches_over_says_so() -> None:
    """Nothing holds the attitude in manual mode; the thrusters sit below the centre."""
    flown = leg(
        modes=[{"at_s": 0, "mode": "manual"}],
        sticks={"forward": {"kind": "steps", "times_s": [0], "values": [0.6]}},
        duration_s=60,
    )
    dive = dived(truth_of_model(HEAVY, IdentifiedModel("none", {"X": {"u": -20.0}})), flown)
    assert dive.stop is not None
    assert "it pitches over: smaller sticks" in dive.stop


def test_the_frame_is_that_of_a_vehicle_with_thrusters() -> None:
    assert isinstance(PHYSICS.hull, OpenFrame)
    with pytest.raises(CampaignError, match="thrusters alone"):
        physical_truth(vehicle("vt690"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"modes": [{"at_s": 0, "mode": "guided"}]}, "needs a route"),
        ({"modes": [{"at_s": 0, "mode": "acro"}]}, "unknown value"),
        ({"sticks": {"yaw": {"kind": "steps", "times_s": [2, 1], "values": [0, 0]}}}, "increase"),
        ({"sticks": {"yaw": {"kind": "steps", "times_s": [2], "values": [0, 0]}}}, "as many"),
        ({"sticks": {"yaw": {"kind": "random", "hold": 2}}}, "unknown key"),
        ({"sticks": {"throttle": {"kind": "random"}}}, "throttle"),
        ({"modes": []}, "at least 1"),
    ],
)
def test_impossible_plans_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(PipelineError, match=message):
        leg(**changes)


def test_a_dive_that_ends_while_it_settles_has_no_log() -> None:
    """A truth that drives itself: it leaves the water before its leg begins."""
    runaway = truth_of_model(HEAVY, IdentifiedModel("own", {"Z": {"w*|w|": 300.0}}))
    push = {"force_sd_N": [0, 0, 50], "moment_sd_N_m": [0, 0, 0], "correlation_s": 9}
    drifting = LEG | {"modes": [{"at_s": 0, "mode": "manual"}], "sticks": {}}
    flown = plan(water={"unsteady": push}, legs=[drifting])
    with pytest.raises(DataError, match="no log of leg 'a'"):
        dive_in_memory(runaway, flown, "a", seed=1)
