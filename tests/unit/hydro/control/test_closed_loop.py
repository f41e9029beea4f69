"""Equilibrium, linearisation and closed loop of the H-AUV and of a vehicle with an
identified model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.errors import CampaignError, PipelineError
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.arrays import Array
from auvid.hydro.control.closed_loop import ForceField, fly, limited, linear_response, performance
from auvid.hydro.control.controllers import Schedule, Weights, design
from auvid.hydro.control.equilibrium import (
    Equilibrium,
    equilibrium,
    minimum_turning_radius,
    require_reachable,
)
from auvid.hydro.control.observer import N
from auvid.hydro.control.paths.paths import helix, path_of_pieces, saw_tooth
from auvid.hydro.control.paths.trajectories import Trajectory, fly_path
from auvid.hydro.control.plants import ControlledPlant, HybridPlant, hybrid_plant, identified_plant
from auvid.hydro.control.reference import ModeSwitch, Waiting
from auvid.hydro.control.riccati import uncontrollable_states
from auvid.hydro.dynamics.hybrid_vehicle import hybrid_vehicle
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.compiled_step import step
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document

ROOT = Path(__file__).parents[4]
CARD = ModelCard.model_validate_json((ROOT / "campaigns/vt690_control/linear.json").read_text())
LIMITS = {"fin_limit_rad": np.radians(20.0), "fin_rate_rad_s": 1.0}
HAUV = hybrid_plant(
    hybrid_vehicle(vehicle_from_document(read_yaml((ROOT / "vehicles/hauv.yaml").read_text()))),
    thrust_rate_N_s=100.0,
    **LIMITS,
)
VT690_VEHICLE = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text()))
VT690 = identified_plant(VT690_VEHICLE, CARD, **LIMITS)
Q = np.array([1, 1, 1, 10, 1, 1, 100, 100, 100, 100, 100, 100], dtype=np.float64)
Q_Z, R_Z = np.array([1e-2] * 6 + [1e-4] * 6 + [10.0] * 6), np.full(12, 1e-3)
HAUV_WEIGHTS = Weights(Q, np.array([0.01, 100.0, 100.0, 100.0]), Q_Z, R_Z)
TURN = fly_path(helix(radius_m=10.0, pitch_rad=-0.08, turns=1.0), speed_m_s=1.5, step_s=0.05)


@pytest.fixture(scope="module")
def trimmed() -> Equilibrium:
    return equilibrium(HAUV, TURN)


@pytest.fixture(scope="module")
def schedule(trimmed: Equilibrium) -> Schedule:
    return design(HAUV, trimmed, HAUV_WEIGHTS, observer="kalman", stride=10)


def central(
    plant: ControlledPlant, chi: np.ndarray, U: np.ndarray, mass: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    def rate(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return plant.rate(x, u, mass_kg=mass, force_ned_N=None, current_ned_m_s=None)

    def slope(at: Callable[[np.ndarray], np.ndarray], size: int) -> np.ndarray:
        steps = 1e-6 * np.eye(size)
        return np.stack([(at(step) - at(-step)) / 2e-6 for step in steps], axis=-1)

    return slope(lambda step: rate(chi + step, U), 12), slope(
        lambda step: rate(chi, U + step), U.shape[-1]
    )


@pytest.mark.compiles("hydro/dynamics/simulation/compiled_step.py")
@pytest.mark.parametrize("plant", [HAUV, VT690], ids=["hauv", "vt690"])
def test_the_compiled_step_moves_vehicles_as_the_equations_of_the_plant(
    plant: ControlledPlant,
) -> None:
    random, b, h = np.random.default_rng(5), 4, 0.2
    nominal = plant.viscous
    plant = plant.with_viscous(nominal * random.uniform(0.8, 1.2, (b, *nominal.shape)))
    chi: Array = random.normal(scale=0.3, size=(b, N))
    chi[:, 0] += 1.2
    U = random.uniform(
        0.1 * plant.inputs.high, 0.9 * plant.inputs.high, (b, len(plant.inputs.names))
    )
    U[0, 0] = plant.inputs.low[0]
    push, current = random.normal(scale=50.0, size=(b, 3)), random.normal(scale=0.2, size=(b, 3))
    masses: Array = np.full(b, plant.neutral_kg)
    masses += random.uniform(-0.5, 0.5, b) * isinstance(plant, HybridPlant)
    for mass in (plant.neutral_kg, masses):

        def rate(x: Array, mass: Array | float = mass) -> Array:
            return plant.rate(x, U, mass_kg=mass, force_ned_N=push, current_ned_m_s=current)

        k1 = rate(chi)
        k2 = rate(chi + 0.5 * h * k1)
        k3 = rate(chi + 0.5 * h * k2)
        moved = chi + h / 6.0 * (k1 + 2.0 * (k2 + k3) + rate(chi + h * k3))
        for seconds, expected in ((0.0, k1), (h, moved)):
            out = np.empty((b, N))
            acting, rows = plant.acting(U), plant.members(mass)
            step(chi, acting, push, current, rows, plant.tables, seconds, out)
            np.testing.assert_allclose(out, expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("plant", [HAUV, VT690], ids=["hauv", "vt690"])
def test_linearisation_agrees_with_central_differences(plant: ControlledPlant) -> None:
    random = np.random.default_rng(0)
    chi = random.normal(size=(6, 12)) * 0.3
    chi[:, 0] += 1.6
    U = random.normal(size=(6, len(plant.inputs.names))) * 0.1
    U[:, 0] += 36.0
    mass = plant.neutral_kg + random.uniform(-1.0, 1.0, 6) * isinstance(plant, HybridPlant)
    A, B = plant.linear(chi, U, mass_kg=mass)
    numeric = central(plant, chi, U, mass)
    assert np.abs(A - numeric[0]).max() < 1e-6 * np.abs(A).max()
    assert np.abs(B - numeric[1]).max() < 1e-6 * np.abs(B).max()


def test_terms_with_propulsion_ratio_are_differentiated_too() -> None:
    card = CARD.model_copy(deep=True)
    card.predictor["Y"]["(u*v)*(eta-1)"] = -12.0
    card.predictor["K"]["(u*u)*(eta-1)"] = 0.4
    card.predictor["Z"]["w*V"] = -30.0
    plant = identified_plant(VT690_VEHICLE, card, **LIMITS)
    chi = np.random.default_rng(1).normal(size=(4, 12)) * 0.2
    chi[:, 0] += 1.8
    U = np.tile([34.0, 0.02, -0.03, 0.05, 0.01], (4, 1))
    mass = np.full(4, plant.neutral_kg)
    A, B = plant.linear(chi, U, mass_kg=mass)
    numeric = central(plant, chi, U, mass)
    assert np.abs(A - numeric[0]).max() < 1e-6 * np.abs(A).max()
    assert np.abs(B - numeric[1]).max() < 1e-6 * np.abs(B).max()


def test_trimmed_turn_balances_all_forces_and_algorithm_1_reports_what_it_leaves(
    trimmed: Equilibrium,
) -> None:
    assert np.abs(trimmed.residual).max() < 1e-6
    printed = equilibrium(HAUV, TURN, method="algorithm_1")
    assert (
        np.abs(printed.residual[:, 1]).max() > 5.0
    )  # the side force of the turn has no input of its own
    rate = HAUV.rate(
        printed.chi, printed.U, mass_kg=printed.mass_kg, force_ned_N=None, current_ned_m_s=None
    )[:, :6]
    assert np.allclose(
        np.einsum("nij,nj->ni", HAUV.mass_matrix(printed.mass_kg), printed.nu_dot - rate),
        printed.residual,
    )
    B = HAUV.linear(printed.chi, printed.U, mass_kg=printed.mass_kg)[1][:, :6]
    normal = np.einsum("nij,ni->nj", B, printed.nu_dot - rate)
    assert np.abs(normal).max() < 1e-9  # least squares: what is left is orthogonal to the inputs


def test_glide_of_the_thesis_is_an_equilibrium_without_thrust() -> None:
    # The model's own glide: u 0.2004, w 0.0404 m/s, theta -0.2808 rad, so a path of
    # -0.2808 - atan(0.0404 / 0.2004).
    path = path_of_pieces((0, 0, 0), 0.0, -0.4797, [("dive", 3.0, 0.0, 0.0)])
    line = fly_path(path, speed_m_s=0.20443, step_s=0.5)
    trim = equilibrium(HAUV, line, epsilon_rad=0.05)
    assert trim.glides
    assert trim.mass_kg == pytest.approx(73.5, abs=1e-6)
    assert trim.chi[3, [0, 2, 10]] == pytest.approx([0.2004, 0.0404, -0.2808], abs=1e-3)
    assert abs(trim.U[3, 0]) < 0.05
    assert np.abs(trim.U[3, 1:]).max() < 0.01
    printed = equilibrium(HAUV, line, method="algorithm_1", epsilon_rad=0.05)
    assert printed.chi[3, [0, 2, 10]] == pytest.approx([0.2, 0.0402, -0.2796], abs=1e-6)


def test_a_known_side_force_is_met_by_crabbing(trimmed: Equilibrium) -> None:
    line = fly_path(
        path_of_pieces((0, 0, 0), 0.0, 0.0, [("line", 5.0, 0.0, 0.0)]), speed_m_s=1.5, step_s=0.1
    )
    trim = equilibrium(HAUV, line, force_ned_N=[0.0, 60.0, 0.0])
    assert np.abs(trim.residual).max() < 1e-6
    assert trim.chi[0, 11] < -0.02  # bow into the force


def test_trajectories_beyond_the_vehicle_name_the_input_or_the_pitch(trimmed: Equilibrium) -> None:
    fast = fly_path(helix(radius_m=30.0, pitch_rad=0.0, turns=0.1), speed_m_s=2.5, step_s=0.1)
    with pytest.raises(
        CampaignError, match=r"more than the actuators have.*cannot hold 2\.5 m/s"
    ) as caught:
        require_reachable(HAUV, equilibrium(HAUV, fast), largest_pitch_rad=1.0)
    assert caught.value.field == "X_thrust"
    tight = fly_path(helix(radius_m=1.8, pitch_rad=0.0, turns=0.5), speed_m_s=1.5, step_s=0.1)
    with pytest.raises(CampaignError, match=r"tightest level turn .* radius of 2\.\d+ m") as caught:
        require_reachable(HAUV, equilibrium(HAUV, tight), largest_pitch_rad=1.0)
    assert caught.value.field == "delta_r"
    with pytest.raises(CampaignError, match="more pitch than allowed"):
        require_reachable(HAUV, trimmed, largest_pitch_rad=0.01)
    require_reachable(HAUV, trimmed, largest_pitch_rad=1.0)


def test_tightest_turn_is_the_one_that_uses_the_whole_rudder() -> None:
    radius = minimum_turning_radius(HAUV, 1.5)
    assert 2.0 < radius < 3.0
    turn = fly_path(
        helix(radius_m=1.02 * radius, pitch_rad=0.0, turns=0.2), speed_m_s=1.5, step_s=0.05
    )
    assert np.abs(equilibrium(HAUV, turn).U[:, 1:]).max() == pytest.approx(
        np.radians(20.0), rel=0.05
    )
    with pytest.raises(CampaignError, match="cannot hold this speed"):
        minimum_turning_radius(HAUV, 3.0)


def test_fins_without_flow_leave_states_out_of_reach() -> None:
    A, B = HAUV.linear(np.zeros(12), np.zeros(4), mass_kg=np.asarray(72.5))
    assert "psi" in uncontrollable_states(A, B) or "r" in uncontrollable_states(A, B)


def test_closed_loop_holds_the_turn_and_is_stable(trimmed: Equilibrium, schedule: Schedule) -> None:
    assert schedule.frozen_eigenvalues.real.max() < 0.0
    assert schedule.observer is not None
    assert schedule.observer.poles.real.max() < 0.0
    start = trimmed.chi[0].copy()
    start[:6], start[9:] = (
        [1.5, 0, 0, 0, 0, 0],
        TURN.attitude[0],
    )  # in the frame of the path, not in trim
    flown = fly(HAUV, schedule, start=start, use_observer=np.array([0.0, 1.0]))
    quality = performance(TURN, flown, trimmed.chi, HAUV.inputs, after_s=10.0)
    assert quality.steady_m.max() < 0.1
    assert quality.at_limit.max() < 0.05


def test_observer_sees_the_force_that_pushes(schedule: Schedule, trimmed: Equilibrium) -> None:
    force = np.array([0.0, 20.0, -15.0])
    field = ForceField(constant_N=force, start_s=5.0).at(TURN.t_s)
    flown = fly(HAUV, schedule, force_ned_N=field)
    estimated = np.einsum("ij,nj->ni", HAUV.mass_matrix(72.5), flown.disturbance[0])[-1, :3]
    pushed = rotation_body_to_ned(flown.chi[0, -1, 9:]).T @ force
    assert (
        np.abs(estimated - pushed).max() < 2.0
    )  # N; the observer is linear about the trim and lags by a fraction of a second
    without = fly(HAUV, schedule, force_ned_N=field, use_observer=False)
    forces = [
        performance(TURN, item, trimmed.chi, HAUV.inputs, after_s=10.0).cross_track_rms_m[0]
        for item in (flown, without)
    ]
    assert forces[0] < 0.5 * forces[1]


def test_waiting_reference_holds_the_path_where_thrust_saturates(
    schedule: Schedule, trimmed: Equilibrium
) -> None:
    field = ForceField(constant_N=[0.0, 225.0, 0.0], start_s=5.0).at(TURN.t_s)
    flown = fly(HAUV, schedule, force_ned_N=field, use_observer=False, waiting=Waiting(2.0, 30.0))
    quality = performance(TURN, flown, trimmed.chi, HAUV.inputs)
    assert flown.U[..., 0].max() == 272.0
    assert flown.U[..., 0].min() >= 0.0
    assert quality.cross_track_m.max() < 1.0
    assert flown.reference_s[0, -1] < TURN.t_s[-1] - 1.0
    assert np.all(np.diff(flown.reference_s[0]) >= 0.0)


def test_a_glider_starts_its_propeller_where_it_is_pushed_off_its_path() -> None:
    path = saw_tooth(leg_m=12.0, pitch_rad=0.478, tip_radius_m=5.0, legs=2, ramp_m=1.0)
    weights = Weights(
        np.ones(12), HAUV_WEIGHTS.R, np.array([1e-2] * 6 + [1e-4] * 6 + [1e-2] * 6), R_Z
    )
    pair = []
    for speed in (0.204, 0.5):
        trim = equilibrium(HAUV, fly_path(path, speed_m_s=speed, step_s=0.2), epsilon_rad=0.2)
        pair.append(design(HAUV, trim, weights, observer="kalman", stride=20))
    field = np.stack(
        [
            ForceField(constant_N=[0.0, y, 0.0], start_s=5.0).at(pair[0].equilibrium.t_s)
            for y in (0.0, 25.0)
        ]
    )
    rule = ModeSwitch(2.0, 0.3, 8.0, 4.0)
    flown = fly(HAUV, pair, force_ned_N=field, waiting=Waiting(1.0), switch=rule, duration_s=40.0)
    assert not flown.powered[0].any()
    assert flown.powered[1, -1] == 1.0
    assert np.abs(flown.chi[1, :, 7]).max() < 1.0  # m beside a path that lies in the plane y = 0
    with pytest.raises(CampaignError, match="two schedules"):
        fly(HAUV, pair[0], switch=rule)


def test_placed_observer_works_in_the_loop(trimmed: Equilibrium) -> None:
    poles = design(HAUV, trimmed, HAUV_WEIGHTS, observer="poles", stride=20)
    assert poles.observer is not None
    assert poles.observer.poles.real.max() < 4.9 * poles.eigenvalues.real.max()
    flown = fly(HAUV, poles, force_ned_N=ForceField([0.0, 20.0, 0.0]).at(TURN.t_s))
    assert (
        performance(TURN, flown, trimmed.chi, HAUV.inputs, after_s=10.0).cross_track_rms_m[0] < 0.2
    )


def test_linear_model_of_a_small_deviation_agrees_with_the_nonlinear_one(
    trimmed: Equilibrium,
) -> None:
    few = Trajectory(*(value[:81] for value in vars(TURN).values()))
    trim = equilibrium(HAUV, few)
    A, B = HAUV.linear(trim.chi, trim.U, mass_kg=trim.mass_kg)
    start = trim.chi[0] + np.array([1e-3] * 6 + [0.0] * 3 + [1e-3] * 3)
    calm = Weights(np.full(12, 1e-9), np.full(4, 1e9), Q_Z, R_Z)  # a regulator that does nothing
    free = replace(
        design(HAUV, trim, replace(HAUV_WEIGHTS, Q=Q), stride=10), k=np.zeros((81, 4, 12))
    )
    assert calm.R.min() > 0.0
    flown = fly(HAUV, free, start=start)
    linear = linear_response(trim, A, B, trim.U, start=start)
    moved = np.abs(flown.chi[0] - trim.chi).max()
    assert np.abs(linear - flown.chi[0]).max() < 0.05 * moved


def test_inputs_keep_their_limits_and_rates() -> None:
    limits = HAUV.inputs
    applied = limited(
        np.array([500.0, -1.0, 0.0, 0.04]), np.array([100.0, 0.0, 0.0, 0.0]), limits, 0.05
    )
    assert applied == pytest.approx([105.0, -0.05, 0.0, 0.04])
    assert limited(np.array([-50.0, 0.0, 0.0, 0.0]), np.zeros(4), limits, 1.0)[0] == 0.0


def test_wrong_weights_words_and_cards_are_named(trimmed: Equilibrium) -> None:
    with pytest.raises(CampaignError, match=r"'R'"):
        design(HAUV, trimmed, replace(HAUV_WEIGHTS, R=np.ones(3)))
    with pytest.raises(CampaignError, match=r"'R'"):
        design(HAUV, trimmed, replace(HAUV_WEIGHTS, R=np.zeros(4)))
    with pytest.raises(CampaignError, match="unknown method"):
        design(HAUV, trimmed, HAUV_WEIGHTS, observer="luenberger")
    with pytest.raises(CampaignError, match="unknown way"):
        equilibrium(HAUV, TURN, method="guess")
    with pytest.raises(CampaignError, match="another vehicle"):
        identified_plant(VT690_VEHICLE, CARD.model_copy(update={"vehicle": "remus100"}), **LIMITS)


def test_a_vehicle_that_cannot_move_sideways_is_refused() -> None:
    still = replace(HAUV, hybrid=replace(HAUV.hybrid, fins=np.zeros((6, 3))))
    line = fly_path(
        path_of_pieces((0, 0, 0), 0.0, 0.0, [("line", 15.0, 0.0, 0.0)]), speed_m_s=1.5, step_s=0.1
    )
    with pytest.raises(PipelineError, match="not controllable at"):
        design(still, equilibrium(still, line), HAUV_WEIGHTS)
