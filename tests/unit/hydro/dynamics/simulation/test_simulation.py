"""Simulation: the compiled loop against numpy, both against an independent integrator,
batches, energy, limits, interpolation.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.propeller import propeller_force
from auvid.hydro.dynamics.simulation.physical_viscous import PhysicalViscous, physical_viscous
from auvid.hydro.dynamics.simulation.plant_constants import FACTORS
from auvid.hydro.dynamics.simulation.simulation import (
    Actuation,
    SimulatedVehicle,
    StopLimits,
    constant_actuation,
    gauss_markov,
    integrate_open_loop,
    motion_at,
    simulate_autopilot,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from tests.support.dynamics_oracles import integrate_numpy, inverse_dynamics

ROOT = Path(__file__).parents[5]
VT690 = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text(encoding="utf-8")))
PHYSICS = SimulatedVehicle(VT690, physical_viscous(VT690))
DAMPING = {
    "Y": {"v": -200.0},
    "Z": {"w": -200.0},
    "K": {"p": -5.0},
    "M": {"q": -200.0},
    "N": {"r": -200.0},
}
MODELS = (
    "gertler_hagen",
    "prestero",
    "pitch_yaw",
    "linear",
    "mcfarland",
    "uncoupled",
    "fossen",
    "coe",
)


def published(name: str) -> IdentifiedModel:
    coefficients: dict[str, dict[str, float]] = {}
    with (ROOT / f"vehicles/vt690/coefficients/{name}.csv").open(
        newline="", encoding="utf-8"
    ) as file:
        for row in csv.DictReader(file):
            coefficients.setdefault(row["axis"], {})[row["term"]] = float(row["value"])
    return IdentifiedModel(name, coefficients)


def plants() -> dict[str, SimulatedVehicle]:
    return {"physics": PHYSICS, "lag": replace(PHYSICS, lag_s=0.3)} | {
        name: SimulatedVehicle(VT690, published(name)) for name in MODELS
    }


def random_states(n: int, states: int = 12) -> np.ndarray:
    random = np.random.default_rng(0)
    x = random.normal(size=(n, states)) * 0.3
    x[:, 0] += 1.5
    return x


@pytest.mark.parametrize("name", ["physics", "lag", *MODELS])
def test_compiled_right_hand_side_is_that_of_numpy(name: str) -> None:
    """The same maths: the mean rates over a step differ by rounding (1e-12 of the
    largest).
    """
    plant = plants()[name]
    x, random = random_states(20, plant.states), np.random.default_rng(1)
    n, fins, force = (
        np.repeat(values[:, None], 2, axis=1)  # the same at both knots
        for values in (
            random.uniform(20.0, 45.0, 20),
            random.normal(size=(20, 4)) * 0.3,
            random.normal(size=(20, 6)),
        )
    )
    inputs, step_s = Actuation(n, fins, force), 0.01
    fast, slow = (
        (integrate(plant, x, inputs, step_s=step_s, steps_per_knot=1)[:, 1] - x) / step_s
        for integrate in (integrate_open_loop, integrate_numpy)
    )
    assert np.max(np.abs(slow)) > 10.0
    assert np.max(np.abs(fast - slow)) < 1e-12 * np.max(np.abs(slow))


def test_every_factor_of_the_basis_is_known_to_the_compiled_loop() -> None:
    assert {factor for term in BASIS_TERMS.values() for factor in term.factors} <= set(FACTORS)


def test_batch_of_vehicles_under_moving_inputs_agrees_with_numpy() -> None:
    random = np.random.default_rng(2)
    inputs = Actuation(
        random.uniform(30.0, 43.0, (5, 4, 6)),
        random.normal(size=(5, 4, 6, 4)) * 0.1,
        random.normal(size=(5, 4, 6, 6)),
    )
    x = random_states(20).reshape(5, 4, 12)
    fast = integrate_open_loop(PHYSICS, x, inputs, step_s=0.01, steps_per_knot=2)
    slow = integrate_numpy(PHYSICS, x, inputs, step_s=0.01, steps_per_knot=2)
    assert fast.shape == (5, 4, 11, 12)
    assert np.allclose(fast, slow, rtol=0.0, atol=1e-12)
    part = Actuation(inputs.propeller_rev_s[3], inputs.fins_rad[3], inputs.force[3])
    assert np.array_equal(
        integrate_open_loop(PHYSICS, x[3], part, step_s=0.01, steps_per_knot=2), fast[3]
    )
    single = Actuation(inputs.propeller_rev_s[1, 2], inputs.fins_rad[1, 2], inputs.force[1, 2])
    assert np.array_equal(
        integrate_open_loop(PHYSICS, x[1, 2], single, step_s=0.01, steps_per_knot=2), fast[1, 2]
    )


@pytest.mark.parametrize("name", ["lag", *MODELS])
def test_batch_under_every_truth_agrees_with_one_vehicle_at_a_time(name: str) -> None:
    """To the last bit: a vehicle does not know how many others there are."""
    plant, random = plants()[name], np.random.default_rng(4)
    x = 0.1 * random_states(11, plant.states)
    x[:, 0] = 1.5
    inputs = Actuation(
        np.linspace(30.0, 43.0, 11)[:, None] + np.zeros(5),
        random.normal(size=(11, 5, 4)) * 0.1,
        random.normal(size=(11, 5, 6)),
    )
    together = integrate_open_loop(plant, x, inputs, step_s=0.01)
    for i in range(11):
        own = Actuation(inputs.propeller_rev_s[i], inputs.fins_rad[i], inputs.force[i])
        assert np.array_equal(integrate_open_loop(plant, x[i], own, step_s=0.01), together[i])


def test_angles_of_many_turns_keep_their_sine_and_cosine() -> None:
    """Position after one step at headings up to 1e5 rad: numpy's to 1e-12 m."""
    x = random_states(16)
    x[:, 9:] = np.random.default_rng(6).uniform(-1e5, 1e5, (16, 3))
    inputs = constant_actuation(np.full(16, 35.0), np.zeros((16, 4)), knots=2)
    fast = integrate_open_loop(PHYSICS, x, inputs, step_s=0.001)
    slow = integrate_numpy(PHYSICS, x, inputs, step_s=0.001, steps_per_knot=1)
    assert np.allclose(
        fast[..., [0, 1, 2, 3, 4, 5, 6, 7, 8]],
        slow[..., [0, 1, 2, 3, 4, 5, 6, 7, 8]],
        rtol=0.0,
        atol=1e-12,
    )


def test_sixty_seconds_agree_with_dop853() -> None:
    """Twelve states to 1e-6 (m, rad, m/s, rad/s) of scipy's integrator at rtol 1e-10,
    fins held askew.
    """
    fins = np.array([0.02, -0.02, 0.05, -0.05])
    start = PHYSICS.start([0.0, 0.0, 5.0, 0.0, 0.0, 0.0], [1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    ours = integrate_open_loop(
        PHYSICS, start, constant_actuation(35.0, fins, knots=6001), step_s=0.01
    )
    constant = Actuation(np.array(35.0), fins, np.zeros(6))
    theirs = solve_ivp(
        lambda _, x: PHYSICS.derivative(x, constant),
        (0.0, 60.0),
        start,
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
    )
    assert np.max(np.abs(ours[-1] - theirs.y[:, -1])) < 1e-6


def test_error_falls_with_the_fourth_power_of_the_step() -> None:
    start = random_states(1)[0]

    def end(steps: int) -> np.ndarray:
        return integrate_open_loop(
            PHYSICS,
            start,
            constant_actuation(35.0, np.zeros(4), knots=steps + 1),
            step_s=0.8 / steps,
        )[-1]

    exact = end(640)
    errors = [np.max(np.abs(end(steps) - exact)) for steps in (20, 40)]
    assert (
        10.0 < errors[0] / errors[1] < 25.0
    )  # 16, and the force bends where a velocity changes its sign


def test_energy_is_kept_in_still_water_without_drag() -> None:
    """No viscous force, no propeller, neutral and balanced: 1/2 nu' M nu stays to 1e-9
    of itself over 5 s.
    """
    free = replace(
        VT690, mass_kg=VT690.displaced_mass_kg, r_G=np.zeros(3), inertia=np.diag([0.3, 10.0, 10.0])
    )
    plant = SimulatedVehicle(
        free,
        PhysicalViscous(np.zeros((0, 2)), np.zeros((0, 11)), np.zeros(3), np.zeros(2), np.zeros(6)),
    )
    start = plant.start([0.0, 0.0, 50.0, 0.0, 0.0, 0.0], [0.5, 0.2, -0.1, 0.1, 0.2, -0.3])
    idle = replace(free, propeller=replace(free.propeller, thrust=np.zeros(3), torque=np.zeros(3)))  # type: ignore[type-var]
    states = integrate_open_loop(
        replace(plant, vehicle=idle),
        start,
        constant_actuation(0.0, np.zeros(4), knots=2501),
        step_s=0.002,
    )
    nu = states[:, :6]
    energy = 0.5 * np.einsum("ni,ij,nj->n", nu, idle.mass_matrix, nu)
    assert np.ptp(energy) < 1e-9 * energy[0]


@pytest.mark.parametrize(
    ("name", "speeds"),
    [
        ("mcfarland", (1.528, 1.810, 1.994, 2.207)),
        ("linear", (1.070, 1.491, 1.795, 2.171)),
        ("fossen", (1.236, 1.629, 1.897, 2.214)),
    ],
)
def test_terminal_speeds_of_published_models(name: str, speeds: tuple[float, ...]) -> None:
    """Thrust of Table B.5 against the surge drag of Appendix E, to 1e-3 m/s."""
    model = published(name)
    assert VT690.propeller is not None

    def surplus(u: float, rev_s: float) -> float:
        nu = np.array([u, 0.0, 0.0, 0.0, 0.0, 0.0])
        assert VT690.propeller is not None
        return float(
            model.force(nu, 1.0)[0]
            + propeller_force(VT690.propeller, nu, rev_s, water_density=VT690.water_density)[0]
        )

    for rpm, speed in zip((1800, 2133, 2350, 2600), speeds, strict=True):
        assert brentq(surplus, 0.3, 4.0, args=(rpm / 60.0,)) == pytest.approx(speed, abs=1e-3)


def test_motion_satisfies_the_equation_of_motion() -> None:
    """Residual force of the interpolated motion less the true force: 1e-9 N."""
    ticks = 101
    force = np.random.default_rng(3).normal(size=(ticks, 6))
    flight = simulate_autopilot(
        PHYSICS,
        lambda tick, state, fins: np.full(4, 0.1 * np.sin(0.1 * tick)),
        random_states(1)[0] + np.eye(12)[8] * 5.0,
        propeller_rev_s=np.full(ticks, 35.0),
        force=force,
        tick_s=0.02,
        steps_per_tick=2,
    )
    motion = motion_at(PHYSICS, flight, np.linspace(0.0, 2.0, 333))
    bar = inverse_dynamics(VT690, motion.eta, motion.nu, motion.nu_dot, motion.actuation.control)
    assert np.max(np.abs(bar - motion.viscous - motion.actuation.force)) < 1e-9
    assert np.max(np.abs(motion_at(PHYSICS, flight, flight.t_s).nu - flight.state[:, :6])) < 1e-14


def test_interpolated_states_agree_with_a_finer_simulation() -> None:
    start = random_states(1)[0] + np.eye(12)[8] * 5.0
    common = {"propeller_rev_s": np.full(51, 35.0), "force": np.zeros((51, 6)), "tick_s": 0.02}
    coarse = simulate_autopilot(PHYSICS, lambda *_: np.zeros(4), start, steps_per_tick=2, **common)  # type: ignore[arg-type]
    fine = simulate_autopilot(PHYSICS, lambda *_: np.zeros(4), start, steps_per_tick=20, **common)  # type: ignore[arg-type]
    between = motion_at(PHYSICS, coarse, fine.t_s)
    assert (
        np.max(np.abs(np.hstack([between.nu, between.eta]) - fine.state)) < 2e-6
    )  # roll settles at 10 rad/s here


def test_lagged_force_follows_with_its_time_constant() -> None:
    plant = replace(PHYSICS, lag_s=0.5)
    start = plant.start([0.0, 0.0, 5.0, 0.0, 0.0, 0.0], [1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert np.array_equal(start[12:], PHYSICS.viscous_force(start[:6], 0.0))
    behind = plant.derivative(
        start + np.r_[np.zeros(12), np.ones(6)], Actuation(np.array(35.0), np.zeros(4), np.zeros(6))
    )
    assert np.allclose(behind[12:], -1.0 / 0.5)


def test_unstable_truth_stops_with_time_state_and_reason() -> None:
    """A driving force along u: the flight ends where the speed leaves its limit, and
    what was flown before is kept.
    """
    plant = SimulatedVehicle(VT690, IdentifiedModel("runaway", {"X": {"u": 40.0}} | DAMPING))
    start = plant.start([0.0, 0.0, 5.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    flight = simulate_autopilot(
        plant,
        lambda *_: np.zeros(4),
        start,
        propeller_rev_s=np.full(2001, 30.0),
        force=np.zeros((2001, 6)),
        tick_s=0.02,
        steps_per_tick=2,
    )
    assert flight.stop is not None
    assert flight.stop.reason == "speed above 8 m/s"
    assert 0.5 < flight.stop.time_s < 10.0
    assert np.isfinite(flight.state).all()
    assert np.linalg.norm(flight.state[-1, :3]) <= 8.0
    assert len(flight.actuation.propeller_rev_s) == (len(flight.t_s) - 1) // 2 + 1
    assert "u 7." in str(flight.stop)


def test_a_vehicle_that_comes_up_is_stopped_at_the_surface() -> None:
    start = PHYSICS.start([0.0, 0.0, 0.1, 0.0, 0.3, 0.0], [1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    common = {
        "propeller_rev_s": np.full(501, 35.0),
        "force": np.zeros((501, 6)),
        "tick_s": 0.02,
        "steps_per_tick": 2,
    }
    flight = simulate_autopilot(
        PHYSICS, lambda *_: np.zeros(4), start, limits=StopLimits(), **common
    )  # type: ignore[arg-type]
    assert flight.stop is not None
    assert "depth" in flight.stop.reason


@pytest.mark.compiles("hydro/dynamics/simulation/compiled.py")
def test_motion_that_grows_without_bound_leaves_nan_in_a_batch() -> None:
    plant = SimulatedVehicle(VT690, IdentifiedModel("explosion", {"X": {"u*u": 500.0}} | DAMPING))
    start = np.array([plant.start(np.zeros(6), [u, 0.0, 0.0, 0.0, 0.0, 0.0]) for u in (0.0, 3.0)])
    states = integrate_open_loop(
        plant, start, constant_actuation(np.zeros(2), np.zeros((2, 4)), knots=101), step_s=0.02
    )
    assert np.isfinite(states[0]).all()
    assert np.isnan(states[1, -1]).all()


def test_a_model_with_propulsion_ratio_needs_the_table_of_level_speeds() -> None:
    with pytest.raises(DataError, match="level speeds"):
        SimulatedVehicle(VT690, published("gertler_hagen")).level_speed(80.0)
    assert PHYSICS.level_speed(80.0) == 0.0


def test_gauss_markov_has_its_deviation_and_correlation() -> None:
    """200 000 samples, 10 000 correlation times: 3 % of the deviation, 0.02 of the
    correlation.
    """
    x = gauss_markov(
        np.random.default_rng(5), sd=[1.0, 3.0], correlation_s=0.4, step_s=0.02, samples=200_000
    )
    assert np.allclose(x.std(axis=0), [1.0, 3.0], rtol=0.03)
    lag = 20
    correlation = (x[lag:] * x[:-lag]).mean(axis=0) / x.var(axis=0)
    assert np.allclose(correlation, np.exp(-1.0), atol=0.02)
    assert np.allclose(
        gauss_markov(
            np.random.default_rng(5), sd=1.0, correlation_s=0.0, step_s=0.1, samples=3
        ).shape,
        (3, 1),
    )
